// SPDX-License-Identifier: Apache-2.0
#include "service/api/jobs.h"

#include <ctype.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "service/api/data_set.h"
#include "service/api/document_cache.h"
#include "service/api/files.h"
#include "service/api/uploads.h"
#include "service/api/job_json.h"
#include "service/api/job_lookup.h"
#include "service/api/parameters.h"
#include "service/api/paths.h"
#include "base/core/clock.h"
#include "base/core/frames.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "service/executor/cache.h"
#include "service/http/header_list.h"
#include "service/http/parameter.h"
#include "service/http/preconditions.h"
#include "service/results/own_spec.h"
#include "spec/file_names.h"
#include "spec/spec.h"
#include "files/file.h"

/* Jobs of a page without the parameter `limit`; parameters.c documents the same number. */
#define LIST_DEFAULT 50
/* Attempts in the document of a job; another route lists all. */
#define ATTEMPTS_SHOWN 100
/* Longest Idempotency-Key, in characters. */
#define KEY_LENGTH_MOST 255

/* The caller clears it. */
static job_json_live live_of(const http_context *c, const access_caller *caller, const queue_job *job)
{
    job_json_live live = {.ahead = -1};
    job_json_viewer viewer = job_json_viewer_of(caller, job->owner);
    if (viewer != JOB_JSON_READER && !queue_state_is_final(job->state))
        live.progress = executor_progress(c->x, job->id);
    job_json_find_names(&live, job, viewer, c->inputs, caller->user);
    int ahead = 0;
    if (job->state == QUEUE_QUEUED && !job->paused && queue_count_ahead(c->q, job, &ahead, NULL))
        live.ahead = ahead;
    return live;
}

/* Sets a reply with the complete document of a job, and stores it in the cache. */
static void answer_job(const http_context *c, const http_request *request, const queue_job *job, int status,
                       reply *r)
{
    error e = {0};
    cached_document made;
    queue_attempt *attempts = NULL;
    size_t count = 0;
    job_json_viewer viewer = job_json_viewer_of(request->caller, job->owner);
    bool own = viewer != JOB_JSON_READER;
    if (own && job->attempts &&
        !queue_list_attempts(c->q, job->id, -1, 0, ATTEMPTS_SHOWN, &attempts, &count, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    job_json_live live = live_of(c, request->caller, job);
    json *document = job_json_new(job, viewer, &live);
    job_json_put_spec(document, viewer, job->spec, job->paths);
    job_json_put_notes(document, c->work_dir, job->id, QUEUE_NO_FRAME,
                       own && !job->array && job->state == QUEUE_SUCCEEDED);
    json *list = json_put_array(document, "attempts");
    for (size_t i = 0; i < count; i++) job_json_append_attempt(list, job, &attempts[i]);
    queue_attempts_free(attempts, count);
    job_json_print_tag(job, &live, made.tag);
    reply_set_json(r, status, document);
    reply_add_header(r, "ETag", made.tag);
    made.text = r->body;
    made.length = r->length;
    /* the progress of a running job changes while its stamp does not */
    if (job_json_is_fixed(&live) && !job->tasks.running) document_cache_put(c->documents, job, viewer, &made);
    job_json_live_clear(&live);
}

void jobs_answer(const http_context *c, const http_request *request, const char *id, int status, reply *r)
{
    error e = {0};
    queue_job job = {0};
    bool found = false;
    if (!queue_get(c->q, id, &job, &found, &e)) {
        reply_set_error(r, &e, NULL);
    } else if (!found) {
        job_lookup_refuse(id, r);
    } else {
        answer_job(c, request, &job, status, r);
    }
    queue_job_clear(&job);
}

static void answer_faults(const spec_faults *faults, const error *e, reply *r)
{
    json *errors = json_new_array();
    for (size_t i = 0; i < faults->count; i++)
        reply_append_fault(errors, faults->item[i].pointer, faults->item[i].detail);
    reply_set_error(r, e, errors);
}

/* Parses a spec. If it is invalid, sets a problem and returns NULL. */
static spec *build_spec(const json *document, reply *r)
{
    error e = {0};
    spec_faults faults = {0};
    spec *s = spec_parse(document, &faults, &e);
    if (!s) answer_faults(&faults, &e, r);
    return s;
}

/* A submitted spec with the paths of this machine, and the list of mapped paths; NULL: none was mapped. */
typedef struct order {
    spec *s;
    json *paths;
    data_set set;
} order;

static void order_clear(order *o)
{
    spec_free(o->s);
    json_free(o->paths);
    data_set_clear(&o->set);
}

static int first_frame(const order *o)
{
    return o->set.count ? o->set.frame[0] : o->s->frames ? o->s->frame[0] : QUEUE_NO_FRAME;
}

/* The path of a member in the first frame, which the caller frees. */
static char *first_path(const order *o, const char *path)
{
    int frame = first_frame(o);
    char *numbered = frame == QUEUE_NO_FRAME ? mem_strdup(path) : frames_path(path, frame);
    char *named = file_names_path(numbered, o->set.count ? o->set.name[0] : NULL);
    free(numbered);
    return named;
}

/* Checks values that depend on the frame. This may take half a second of CPU time, so only one thread at a
 * time does it, and no check begins after the service has begun to stop. */
static bool check_frames(const http_context *c, const spec *s, reply *r)
{
    error e = {0};
    spec_faults faults = {0};
    if (!s->has_frame_values) return true;
    pthread_mutex_lock(c->frame_checks);
    bool goes_on = executor_takes_jobs(c->x);
    bool good = goes_on && spec_check_frames(s, &faults, &e);
    pthread_mutex_unlock(c->frame_checks);
    if (!goes_on)
        reply_set_unavailable(
            r, "the service is stopping or draining and does not check by_frame now: try again later");
    else if (!good)
        answer_faults(&faults, &e, r);
    return good;
}

/* Sets a problem about a member of the spec. If its path was mapped, the message contains both paths. */
static void refuse_member(const order *o, const char *pointer, const error *why, reply *r)
{
    const char *asked = paths_asked(o->paths, pointer);
    error fault = *why;
    if (asked)
        error_set(&fault, why->code, "%s (mapped from %s by the setting path_mappings)", why->message, asked);
    json *errors = json_new_array();
    reply_append_fault(errors, pointer, fault.message);
    reply_set_error(r, &fault, errors);
}

/* The first path with the place of a frame number. The parser requires one for FRAMES_ALL. */
static spec_input find_pattern(const spec *s)
{
    spec_input input = {0};
    for (size_t k = 0; spec_input_at(s, k, &input) && (input.is_slice || !frames_is_pattern(input.path));)
        k++;
    return input;
}

/* Replaces "all" in queue.frames by the numbers of the files that exist now, and parses the document again.
 * If there are none or too many, or the caller may not list directories, sets a problem and returns false. */
static bool resolve_frames(const http_context *c, const access_caller *caller, json *document, order *o,
                           reply *r)
{
    error e = {0};
    int *frames = NULL;
    size_t count = 0;
    if (!o->s->frames || strcmp(o->s->frames, FRAMES_ALL) != 0) return true;
    if (!(caller->scopes & SCOPE_SUBMIT)) {
        reply_set_problem(r, "forbidden", NULL,
                          "/queue/frames: \"" FRAMES_ALL
                          "\" requires the scope %s: use a token that has it, or "
                          "write the frame numbers",
                          scope_name(SCOPE_SUBMIT));
        return false;
    }
    char *text = NULL;
    if (files_find_frames(c, find_pattern(o->s).path, &frames, &count, &e)) {
        text = frames_print(frames, count);
        if (strlen(text) > SPEC_FRAMES_LENGTH_MAX) {
            error_set(
                &e, ERROR_SPEC_INVALID,
                "the numbers of the %zu files have too many gaps to list them: write the frame numbers, and "
                "submit several jobs",
                count);
            free(text);
            text = NULL;
        }
    }
    free(frames);
    if (!text) {
        refuse_member(o, "/queue/frames", &e, r);
        return false;
    }
    json_set_string(json_find(document, "/queue/frames"), text);
    free(text);
    spec_free(o->s);
    o->s = build_spec(document, r);
    return o->s;
}

/* Finds the files of a data set. If there are none or too many, or the caller may not use them, sets a problem
 * and returns false. */
static bool resolve_files(const http_context *c, const access_caller *caller, order *o, reply *r)
{
    error e = {0};
    char pointer[64];
    if (o->s->files.is_pattern && !(caller->scopes & SCOPE_SUBMIT)) {
        reply_set_problem(
            r, "forbidden", NULL,
            "/queue/files: a pattern requires the scope %s: use a token that has it, or list the "
            "files",
            scope_name(SCOPE_SUBMIT));
        return false;
    }
    if (data_set_find(c, caller, o->s, &o->set, pointer, &e)) return true;
    refuse_member(o, pointer, &e, r);
    return false;
}

/* Parses the body into an order. If it is invalid, sets a problem and returns false. */
static bool read_order(const http_context *c, const http_request *request, order *o, reply *r)
{
    error e = {0};
    json *document = json_parse(request->body, request->length, &e);
    if (!document) {
        reply_set_problem(r, "json_invalid", NULL, "a spec must be a valid JSON document: %s", e.message);
        return false;
    }
    o->s = build_spec(document, r);
    if (o->s) o->paths = paths_map(c->mappings, o->s, document);
    if (o->paths) {
        spec_free(o->s);
        o->s = build_spec(document, r);
    }
    bool ok =
        o->s && resolve_frames(c, request->caller, document, o, r) && resolve_files(c, request->caller, o, r);
    json_free(document);
    return ok && check_frames(c, o->s, r);
}

/* Checks that the input files exist and may be read, so that the submission fails and not the job. The worker
 * opens them again below the same roots. In a sequence, only the first frame is checked. */
static bool check_inputs(const http_context *c, const access_caller *caller, const order *o, reply *r)
{
    spec_input input;
    const spec *s = o->s;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        error e = {0};
        char *path = first_path(o, input.path);
        bool good = uploads_check(c, caller, path, &e);
        free(path);
        if (good) continue;
        refuse_member(o, input.pointer, &e, r);
        return false;
    }
    return true;
}

/* Checks that results may be copied to output.directory. In a sequence, only the directory of the first frame
 * is checked. */
static bool check_output(const http_context *c, const access_caller *caller, const order *o, reply *r)
{
    error e = {0};
    const spec *s = o->s;
    if (!s->directory) return true;
    char *path = output_place_directory(s->directory, first_frame(o));
    bool good = output_place_check(c->outputs, caller->user, path, &e);
    free(path);
    if (!good) refuse_member(o, "/output/directory", &e, r);
    return good;
}

static bool check_webhook(const http_context *c, const order *o, reply *r)
{
    error e = {0};
    if (!o->s->webhook || webhook_hosts_admit(c->webhooks, o->s->webhook, &e)) return true;
    refuse_member(o, "/queue/webhook", &e, r);
    return false;
}

/* Whether the setting slurm_allow contains the option, or its name without a value. */
static bool allows_option(const http_context *c, const char *option)
{
    size_t name = strcspn(option, "=");
    for (size_t i = 0; i < c->slurm_allow_count; i++) {
        const char *allowed = c->slurm_allow[i];
        if (strcmp(allowed, option) == 0 || (strlen(allowed) == name && strncmp(allowed, option, name) == 0))
            return true;
    }
    return false;
}

/* Checks the options of sbatch. The engine stores one option per line, so an option must not contain a
 * line end. */
static bool check_slurm(const http_context *c, const order *o, reply *r)
{
    for (size_t i = 0; i < o->s->slurm_count; i++) {
        const char *option = o->s->slurm[i];
        error e = {0};
        char pointer[48];
        if (allows_option(c, option) && !strchr(option, '\n')) continue;
        snprintf(pointer, sizeof pointer, "/queue/slurm/%zu", i);
        error_set(&e, ERROR_SPEC_INVALID,
                  "this service does not allow the option %s: choose one that its setting slurm_allow "
                  "lists",
                  option);
        refuse_member(o, pointer, &e, r);
        return false;
    }
    return true;
}

bool jobs_admit_priority(const http_context *c, const http_request *request, int priority,
                         const char *pointer, reply *r)
{
    const access_caller *caller = request->caller;
    bool admin = caller->scopes & SCOPE_ADMIN;
    double of_user = admin ? priority : user_numbers_of(c->priorities, caller->user, priority);
    bool by_token = caller->max_priority < of_user;
    double most = by_token ? caller->max_priority : of_user;
    if (priority <= most) return true;
    char detail[200];
    json *errors = json_new_array();
    snprintf(detail, sizeof detail, "the priority %d exceeds the limit of %s%s, %g (%s): lower the priority",
             priority, by_token ? "this token of " : "", caller->user, most,
             by_token ? "hexadctl token add --max-priority" : "setting user_priorities");
    reply_append_fault(errors, pointer, detail);
    reply_set_problem(r, "priority_forbidden", errors, "%s: %s", pointer, detail);
    return false;
}

static bool check_order(const http_context *c, const http_request *request, const order *o, reply *r)
{
    return jobs_admit_priority(c, request, o->s->priority, "/queue/priority", r) &&
           check_inputs(c, request->caller, o, r) && check_output(c, request->caller, o, r) &&
           check_webhook(c, o, r) && check_slurm(c, o, r);
}

static char *print_labels(const spec *s)
{
    json *labels = json_new_array();
    for (size_t i = 0; i < s->label_count; i++) json_append_string(labels, s->labels[i]);
    char *text = json_print(labels);
    json_free(labels);
    return text;
}

/* Sets a reply with the document of a job that was just submitted. It is made from the submission, because
 * the job is accepted even if the database cannot be read now. */
static void show_accepted(const http_context *c, const http_request *request, const queue_receipt *receipt,
                          const queue_submission *put, reply *r)
{
    queue_job job = {
        .seq = receipt->seq,
        .name = (char *)put->name,
        .owner = (char *)put->owner,
        .labels = (char *)put->labels,
        .trace = (char *)put->trace,
        .spec = (char *)put->spec,
        .revision = receipt->revision,
        .state = receipt->state,
        .priority = put->priority,
        .created_ms = ulid_time_ms(receipt->id),
        .array = put->frame_count > 0,
        .tasks = {.all = put->frame_count ? (int)put->frame_count : 1,
                  .waiting = put->frame_count ? (int)put->frame_count : 1},
        .max_attempts = put->max_attempts,
        .threads = put->threads,
        .memory_mb = put->memory_mb,
        .retention_s = put->retention_s,
    }; /* its texts are borrowed from `put` */
    char tag[JOB_JSON_TAG_SIZE];
    memcpy(job.id, receipt->id, sizeof job.id);
    job_json_live live = live_of(c, request->caller, &job);
    json *document = job_json_new(&job, JOB_JSON_OWNER, &live);
    job_json_put_spec(document, JOB_JSON_OWNER, put->spec, put->paths);
    json_put_null(document, "notes");
    json_put_null(document, "delivery");
    json_put_array(document, "attempts");
    job_json_print_tag(&job, &live, tag);
    job_json_live_clear(&live);
    reply_set_json(r, 201, document);
    reply_add_header(r, "ETag", tag);
}

/* The header traceparent (W3C Trace Context): hexadecimal numbers of 2, 32, 16 and 2 digits, separated by
 * "-". NULL if it is missing or malformed; the standard requires that a malformed one is ignored. */
static const char *read_trace(const http_request *request)
{
    static const size_t parts[] = {2, 32, 16, 2};
    const char *trace = request->header[HTTP_TRACEPARENT], *at = trace;
    if (!trace || strlen(trace) != 55 || strncmp(trace, "ff", 2) == 0) return NULL;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (strspn(at, "0123456789abcdef") != parts[i]) return NULL;
        at += parts[i];
        if (*at != (i + 1 < sizeof parts / sizeof *parts ? '-' : '\0')) return NULL;
        at++;
    }
    return trace;
}

/* Reads the Idempotency-Key (NULL: none), with which a client can repeat a submission safely, and hashes the
 * body. If the key is malformed, sets a problem and returns false. */
static bool read_key(const http_request *request, char hash[STORE_HASH_SIZE], const char **key, reply *r)
{
    *key = request->header[HTTP_IDEMPOTENCY_KEY];
    if (!*key) return true;
    size_t length = strlen(*key);
    for (const char *t = *key; *t; t++)
        if ((unsigned char)*t < 0x20 || (unsigned char)*t > 0x7E) length = 0;
    if (length == 0 || length > KEY_LENGTH_MOST) {
        reply_set_problem(r, "request_invalid", NULL,
                          "the Idempotency-Key must have 1 to %d printable ASCII characters",
                          KEY_LENGTH_MOST);
        return false;
    }
    store_hash(request->body, request->length, hash);
    return true;
}

/* Describes why a job may not depend on this one. */
static void describe_dependency(const queue_receipt *receipt, const char *id, char detail[256])
{
    if (receipt->admission == QUEUE_UNKNOWN_DEPENDENCY)
        snprintf(detail, 256, "the job %.100s does not exist: list the jobs for their IDs", id);
    else if (receipt->admission == QUEUE_FOREIGN_DEPENDENCY)
        snprintf(
            detail, 256,
            "the job %.100s belongs to another user, and frames wait for frames of own jobs only: name it in "
            "depends_on or after",
            id);
    else if (receipt->admission == QUEUE_REPEATED_DEPENDENCY)
        snprintf(
            detail, 256,
            "the job %.100s is listed twice, in after_frames and in depends_on, after or after_frames: remove one",
            id);
    else if (receipt->frame == QUEUE_NO_FRAME)
        snprintf(detail, 256, "the job %.100s has no frames: name it in depends_on", id);
    else
        snprintf(detail, 256, "the job %.100s has no frame %d: submit the frames that it has", id,
                 receipt->frame);
}

static void refuse_dependency(const queue_submission *put, const queue_receipt *receipt, reply *r)
{
    const struct {
        const char *name;
        const char *const *ids;
        size_t count;
    } lists[] = {{"depends_on", put->depends_on, put->depends_on_count},
                 {"after", put->after, put->after_count},
                 {"after_frames", put->after_frames, put->after_frames_count}};
    char pointer[64], detail[256];
    json *errors = json_new_array();
    size_t index = receipt->dependency, k = 0;
    for (; index >= lists[k].count; k++) index -= lists[k].count;
    snprintf(pointer, sizeof pointer, "/queue/%s/%zu", lists[k].name, index);
    describe_dependency(receipt, lists[k].ids[index], detail);
    reply_append_fault(errors, pointer, detail);
    reply_set_problem(r, receipt->admission == QUEUE_FOREIGN_DEPENDENCY ? "forbidden" : "spec_invalid",
                      errors, "%s: %s", pointer, detail);
}

static void refuse_full_disk(const http_context *c, reply *r)
{
    char detail[1024];
    executor_space space = executor_get_space(c->x);
    snprintf(
        detail, sizeof detail,
        "the job is not accepted: %lld MiB are free on the disk of %s, and the database keeps the rest (setting "
        "reserve_mb) for changes of jobs. Delete jobs that are not needed, free space on this disk, or try again "
        "later.",
        (long long)space.free_bytes >> 20, space.directory);
    reply_set_storage_full(r, detail);
}

static void refuse(const http_context *c, ledger_resource what, ledger_decision why, const char *user,
                   reply *r)
{
    reply_set_refusal(r, ledger_explain(c->counts, what, why, user));
}

/* Sets the reply to a submission. */
static void answer_receipt(const http_context *c, const http_request *request, const queue_submission *put,
                           const queue_receipt *receipt, reply *r)
{
    char *location = mem_printf("/v1/jobs/%s", receipt->id);
    switch (receipt->admission) {
    case QUEUE_CREATED:
        executor_wake(c->x);
        log_write(LOG_LEVEL_INFO, "job accepted job=%s user=%s trace=%s", receipt->id, put->owner,
                  put->trace ? put->trace : "-");
        show_accepted(c, request, receipt, put, r);
        reply_add_header(r, "Location", location);
        jobs_wait(c, request, receipt->id, r);
        break;
    case QUEUE_REPLAYED:
        jobs_answer(c, request, receipt->id, 201, r);
        if (r->status != 201) break;
        reply_add_header(r, "Location", location);
        jobs_wait(c, request, receipt->id, r);
        break;
    case QUEUE_MISMATCH:
        reply_set_problem(r, "idempotency_mismatch", NULL,
                          "this Idempotency-Key was used with another body, for the job %s: use another key",
                          receipt->id);
        break;
    case QUEUE_TOO_MANY:
        refuse(c, LEDGER_JOBS, LEDGER_HOLDER_FULL, put->owner, r);
        break;
    case QUEUE_TOO_MANY_TASKS:
        refuse(c, LEDGER_TASKS, LEDGER_HOLDER_FULL, put->owner, r);
        break;
    case QUEUE_RESULTS_FULL:
        refuse(c, LEDGER_RESULTS, LEDGER_ALL_FULL, put->owner, r);
        break;
    case QUEUE_USER_RESULTS_FULL:
        refuse(c, LEDGER_RESULTS, LEDGER_HOLDER_FULL, put->owner, r);
        break;
    case QUEUE_NO_SPACE:
        refuse_full_disk(c, r);
        break;
    case QUEUE_UNKNOWN_DEPENDENCY:
    case QUEUE_FOREIGN_DEPENDENCY:
    case QUEUE_REPEATED_DEPENDENCY:
    case QUEUE_UNKNOWN_FRAME:
        refuse_dependency(put, receipt, r);
        break;
    }
    free(location);
}

/* Whether the user may submit a job now; otherwise sets a problem with Retry-After. A repeated request (same
 * Idempotency-Key) submits no job, so it does not count. */
static bool check_rate(const http_context *c, const http_request *request, const char *key, reply *r)
{
    bool repeated = false;
    const char *user = request->caller->user;
    if (key && ledger_get_limits(c->counts, LEDGER_SUBMISSIONS).holder &&
        queue_has_key(c->q, user, key, &repeated, NULL) && repeated)
        return true;
    ledger_decision decision = ledger_take(c->counts, LEDGER_SUBMISSIONS, user, 1);
    if (decision == LEDGER_FITS) return true;
    refuse(c, LEDGER_SUBMISSIONS, decision, user, r);
    return false;
}

/* How long the answer may wait, in milliseconds: the seconds of `Prefer: wait=30` (RFC 7240), at most wait_s; 0: no
 * wait. */
static int64_t read_wait_ms(const http_context *c, const http_request *request)
{
    const char *wait = header_list_find(request->header[HTTP_PREFER], "wait");
    char *end;
    if (!wait || *wait++ != '=') return 0;
    wait += strspn(wait, " \t\"");
    const double seconds = strtod(wait, &end);
    if (!isdigit((unsigned char)*wait) || !strchr(" \t\";,", *end)) return 0;
    return (int64_t)(1000 * (seconds < c->wait_s ? seconds : c->wait_s));
}

static void add_applied(int64_t wait_ms, reply *r)
{
    char applied[32];
    snprintf(applied, sizeof applied, "wait=%g", clock_seconds(wait_ms));
    reply_add_header(r, "Preference-Applied", applied);
}

void jobs_wait(const http_context *c, const http_request *request, const char *id, reply *r)
{
    int64_t wait_ms = read_wait_ms(c, request);
    if (wait_ms <= 0) return;
    add_applied(wait_ms, r);
    snprintf(r->topic, sizeof r->topic, "%s", id);
    r->again_ms = request->came_ms + wait_ms;
    r->provisional = true;
}

/* Copies the member `dependents` and all headers except ETag from the provisional answer to the new one. */
static void keep_parts(const reply *old, reply *fresh)
{
    json *document = json_parse(old->body, old->length, NULL);
    json_at root = json_root(document), dependents = json_member(&root, "dependents");
    if (dependents.node) reply_add_member(fresh, "dependents", json_copy(dependents.node));
    json_free(document);
    for (size_t i = 0; i < old->header_count; i++)
        if (strcmp(old->header[i].name, "ETag") != 0)
            reply_add_header(fresh, old->header[i].name, old->header[i].value);
}

/* Replaces the provisional answer after the end of the job or of the wait. If the job cannot be read or was
 * deleted, the provisional answer is sent. */
void jobs_await(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    bool found = false, read = queue_get(c->q, r->topic, &job, &found, NULL) && found;
    bool patient = !request->last && clock_monotonic_ms() < r->again_ms;
    if (read && patient && !queue_state_is_final(job.state)) {
        queue_job_clear(&job);
        return;
    }
    r->provisional = false;
    if (read) {
        reply fresh = {.fd = -1};
        answer_job(c, request, &job, r->status, &fresh);
        if (fresh.status == r->status) {
            keep_parts(r, &fresh);
            reply_clear(r);
            *r = fresh;
        } else {
            reply_clear(&fresh);
        }
    }
    queue_job_clear(&job);
}

/* The names of the uploaded files that the job reads, `count` of them; to be freed by mem_free_texts. */
static char **list_sent(const spec *s, size_t *count)
{
    spec_input input;
    char name[STORE_INPUT_NAME_SIZE], **names = NULL;
    *count = 0;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        if (!sent_file_match(input.path, name)) continue;
        mem_add_text(&names, count, mem_strdup(name));
    }
    return names;
}

/* Milliseconds, rounded up, so that a positive time never becomes 0. */
static int64_t ms_of(double seconds)
{
    return (int64_t)ceil(1000 * seconds);
}

/* Offers the job to the executor if a stored result of an equal job can be used. So it ends at once even if
 * all workers are busy. */
static void offer(const http_context *c, const queue_submission *put, const queue_receipt *receipt)
{
    char equal[ULID_SIZE], *inputs = NULL;
    bool found = false;
    if (receipt->admission != QUEUE_CREATED || !put->cache_key || put->frame_count ||
        !queue_recall(c->q, put->cache_key, equal, &inputs, &found, NULL) || !found)
        return;
    if (cache_is_fresh(c->roots, inputs)) executor_offer(c->x, receipt->id);
    free(inputs);
}

/* The spec as text, without the list of files: each task has its file. */
static char *print_spec(const order *o)
{
    json *document = json_copy(o->s->normalised);
    if (o->set.count && !o->s->files.is_pattern) json_remove(json_find(document, "/queue"), "files");
    char *text = json_print(document);
    json_free(document);
    return text;
}

static void put_in_queue(const http_context *c, const http_request *request, const order *o, reply *r)
{
    const spec *s = o->s;
    error e = {0};
    queue_receipt receipt = {0};
    char hash[STORE_HASH_SIZE], result_key[STORE_HASH_SIZE];
    const char *key = NULL;
    size_t sent_count = 0;
    if (!read_key(request, hash, &key, r) || !check_rate(c, request, key, r)) return;
    char **sent = list_sent(s, &sent_count);
    char *labels = print_labels(s), *text = print_spec(o), *paths = o->paths ? json_print(o->paths) : NULL,
         *webhook = s->webhook ? webhook_address(s->webhook) : NULL;
    queue_submission submission = {
        .name = s->name,
        .owner = request->caller->user,
        .labels = labels,
        .trace = read_trace(request),
        .spec = text,
        .paths = paths,
        .priority = s->priority,
        .max_attempts = s->max_attempts > 0 ? s->max_attempts : c->max_attempts,
        .threads = s->threads,
        .memory_mb = s->memory_mb,
        .retention_s = s->retention_s > 0 ? s->retention_s : c->retention_s,
        .frames = o->set.count ? o->set.frame : s->frame,
        .frame_count = o->set.count ? o->set.count : s->frame_count,
        .files = (const char *const *)o->set.name,
        .file_inputs = (const char *const *)o->set.sent,
        .file_input_count = o->set.sent_count,
        .ordered = s->coherent,
        .depends_on = (const char *const *)s->depends_on,
        .depends_on_count = s->depends_on_count,
        .after = (const char *const *)s->after,
        .after_count = s->after_count,
        .after_frames = (const char *const *)s->after_frames,
        .after_frames_count = s->after_frames_count,
        .any_frames = request->caller->scopes & SCOPE_ADMIN,
        .accept = job_json_outcomes(s->accept),
        .max_running = s->max_running,
        .chunk = s->chunk,
        .inputs = (const char *const *)sent,
        .input_count = sent_count,
        .timeout_ms = ms_of(s->timeout_s),
        .stall_ms = ms_of(s->stall_s),
        .directory = s->directory,
        .cache_key = cache_key(s->normalised, result_key) ? result_key : NULL,
        .most_waiting = ledger_get_limits(c->counts, LEDGER_JOBS).holder,
        .most_tasks = ledger_get_limits(c->counts, LEDGER_TASKS).holder,
        .webhook = webhook,
        .key = key,
        .body_hash = key ? hash : NULL,
    };
    if (!executor_size(c->x, &submission.threads, &submission.memory_mb, &e))
        reply_set_error(r, &e, NULL);
    else if (queue_put(c->q, &submission, &receipt, &e)) {
        offer(c, &submission, &receipt);
        answer_receipt(c, request, &submission, &receipt, r);
    } else if (e.code == ERROR_DATABASE_DAMAGED || e.code == ERROR_STATE_LOST || e.code == ERROR_STORAGE_FULL)
        reply_set_error(r, &e, NULL);
    else
        reply_set_unavailable(r, e.message); /* not a fault of the service: try again */
    mem_free_texts(sent, sent_count);
    free(labels);
    free(text);
    free(paths);
    free(webhook);
}

void jobs_submit(const http_context *c, const http_request *request, reply *r)
{
    if (!executor_takes_jobs(c->x)) {
        reply_set_unavailable(
            r, executor_is_draining(c->x)
                   ? "the service accepts no jobs, because it is stopping: try again later"
                   : "the service accepts no jobs, because an administrator drained it: try again later, or "
                     "run hexadctl undrain");
        return;
    }
    order o = {0};
    if (read_order(c, request, &o, r) && check_order(c, request, &o, r)) put_in_queue(c, request, &o, r);
    order_clear(&o);
}

/* The spec of the first frame as text. */
static char *print_first(const order *o)
{
    char *text = json_print(o->s->normalised);
    char *own = o->set.count ? own_spec_make(text, o->set.name[0]) : NULL;
    if (own) free(text);
    return own ? own : text;
}

/* The names of the uploaded files that the first frame reads; to be freed by mem_free_texts. */
static char **list_sent_first(const order *o, size_t *count)
{
    char own[STORE_INPUT_NAME_SIZE], **names = list_sent(o->s, count);
    if (!o->set.count || !sent_file_match(o->set.name[0], own)) return names;
    mem_add_text(&names, count, mem_strdup(own));
    return names;
}

/* Adds `estimate`, or null with the reason in `estimate_missing`: the caller lacks the scope `submit`,
 * say. *busy: a later request may get an estimate. False if the job would fail: *r is then set to the
 * problem. */
static bool put_estimate(const http_context *c, const http_request *request, const order *o, json *document,
                         bool *busy, reply *r)
{
    error e = {0};
    int threads = o->s->threads;
    int64_t memory_mb = o->s->memory_mb;
    char *found = NULL;
    estimator_outcome outcome = ESTIMATOR_NONE;
    if (!executor_size(c->x, &threads, &memory_mb, &e)) {
        reply_set_error(r, &e, NULL);
        return false;
    }
    if (!(request->caller->scopes & SCOPE_SUBMIT)) {
        error_set(&e, ERROR_NONE, "an estimate requires the scope %s: use a token that has it",
                  scope_name(SCOPE_SUBMIT));
    } else if (c->estimator) {
        size_t sent_count = 0;
        char *text = print_first(o), **sent = list_sent_first(o, &sent_count);
        outcome = estimator_run(c->estimator, WORKER_COMMAND_ESTIMATE, text, (const char *const *)sent,
                                sent_count, first_frame(o), threads, memory_mb,
                                clock_seconds(parameter_integer(request, "within_ms", 0)), &found, &e);
        mem_free_texts(sent, sent_count);
        free(text);
    } else {
        error_set(&e, ERROR_NONE, "this service makes no estimates: the setting estimates is 0");
    }
    job_json_put_stored(document, "estimate", found);
    json_put_string(document, "estimate_missing", outcome == ESTIMATOR_MADE ? NULL : e.message);
    free(found);
    if (outcome == ESTIMATOR_FAULT) {
        job_json_name_files_of_error(&e, c->inputs, request->caller->user);
        reply_set_error(r, &e, NULL);
    }
    *busy = outcome == ESTIMATOR_BUSY;
    return outcome != ESTIMATOR_FAULT;
}

void jobs_validate(const http_context *c, const http_request *request, reply *r)
{
    order o = {0};
    json *document = json_new_object();
    bool busy = false;
    if (read_order(c, request, &o, r) && check_order(c, request, &o, r) &&
        put_estimate(c, request, &o, document, &busy, r)) {
        json *asked = json_copy(o.s->normalised);
        paths_restore(o.paths, asked);
        json_put(document, "spec", asked);
        json_put(document, "paths", o.paths ? json_copy(o.paths) : json_new_array());
        reply_set_json(r, 200, document);
        if (busy) reply_ask_again(r);
        document = NULL;
    }
    json_free(document);
    order_clear(&o);
}

static void write_pair(FILE *out, const char *key, const char *value)
{
    fprintf(out, "%s=", key);
    for (const char *t = value; *t; t++) {
        bool plain = isalnum((unsigned char)*t) || strchr("-._~", *t);
        fprintf(out, plain ? "%c" : "%%%02X", (unsigned char)*t);
    }
}

/* Adds the header Link with the URL of the next page of the same list. */
static void add_next(const http_request *request, const char *cursor, reply *r)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    fputs("</v1/jobs?", out);
    write_pair(out, "cursor", cursor);
    for (size_t i = 0; i < request->query_count; i++) {
        if (strcmp(request->query[i].key, "cursor") == 0) continue;
        fputc('&', out);
        write_pair(out, request->query[i].key, request->query[i].value);
    }
    fputs(">; rel=\"next\"", out);
    fclose(out);
    reply_add_header(r, "Link", text);
    free(text);
}

/* Bit s is set for each state s in a list separated by commas. NULL: 0. */
static unsigned read_states(const char *words)
{
    unsigned states = 0;
    for (const char *at = words; at && *at; at += strspn(at, ",")) {
        queue_state state = QUEUE_QUEUED;
        size_t n = strcspn(at, ",");
        char *name = mem_strndup(at, n);
        if (queue_state_from_name(name, &state)) states |= 1u << state;
        free(name);
        at += n;
    }
    return states;
}

/* A cursor is the number of the last job of the previous page, the order of the list and the sort key of the
 * job. `mark` is ":name:", ":-created:" and so on; "" in the default order, whose cursors have the number
 * only. */

/* False if the cursor of the request is not one of a list with this mark. */
static bool read_cursor(const http_request *request, const char *mark, queue_filter *filter)
{
    const char *text = parameter_text(request, "cursor", NULL);
    if (!text) return true;
    const size_t digits = strspn(text, "0123456789"), length = strlen(mark);
    if (digits == 0 || digits > 18 || strncmp(text + digits, mark, length) != 0) return false;
    const char *key = text + digits + length;
    filter->after_seq = strtoll(text, NULL, 10);
    filter->after_key = filter->order == QUEUE_BY_AGE ? NULL : key;
    return filter->after_seq > 0 && (filter->after_key || !*key);
}

static char *print_cursor(int64_t seq, const char *mark, const char *key, queue_order sorted_by)
{
    return mem_printf("%lld%s%s", (long long)seq, mark, sorted_by == QUEUE_BY_AGE ? "" : key);
}

/* The cursor of the next page, to be freed: behind job number `limit`, or where the search stopped. NULL:
 * this is the last page. */
static char *next_cursor(const queue_page *page, size_t limit, const char *mark, queue_order sorted_by)
{
    char key[QUEUE_SORT_KEY_SIZE];
    if (page->count > limit) {
        const queue_job *last = &page->jobs[limit - 1];
        return print_cursor(last->seq, mark, queue_sort_key(last, sorted_by, key), sorted_by);
    }
    return page->stop.seq ? print_cursor(page->stop.seq, mark, page->stop.key, sorted_by) : NULL;
}

/* Restricts a list by dependency to jobs of the caller, unless the caller is an administrator: dependencies
 * are part of specs, which only owners and administrators may read. If another owner is named, sets a
 * problem and returns false. */
static bool restrict_to_own(const http_request *request, queue_filter *filter, reply *r)
{
    if (request->caller->scopes & SCOPE_ADMIN) return true;
    if (filter->owner && !access_is_owner(request->caller, filter->owner)) {
        reply_set_problem(r, "forbidden", NULL,
                          "only an administrator may list the dependencies of jobs of %s", filter->owner);
        return false;
    }
    filter->owner = request->caller->user;
    return true;
}

/* Sets the answer of a list: at most `limit` jobs of the page, and the cursor of the next page. */
static void answer_page(const http_context *c, const http_request *request, const queue_page *page,
                        size_t limit, const char *mark, queue_order sorted_by, reply *r)
{
    char *cursor = next_cursor(page, limit, mark, sorted_by);
    json *document = json_new_object();
    json *list = json_put_array(document, "jobs");
    for (size_t i = 0; i < page->count && i < limit; i++) {
        const job_json_viewer viewer = job_json_viewer_of(request->caller, page->jobs[i].owner);
        job_json_live live = live_of(c, request->caller, &page->jobs[i]);
        json_append(list, job_json_new(&page->jobs[i], viewer, &live));
        job_json_live_clear(&live);
    }
    json_put_string(document, "next", cursor);
    reply_set_json(r, 200, document);
    if (cursor) add_next(request, cursor, r);
    free(cursor);
}

void jobs_list(const http_context *c, const http_request *request, reply *r)
{
    queue_filter filter = {
        .state = -1,
        .states = read_states(parameter_text(request, "state", NULL)),
        .owner = parameter_text(request, "owner", NULL),
        .label = parameter_text(request, "label", NULL),
        .name = parameter_text(request, "name", NULL),
        .text = parameter_text(request, "text", NULL),
        .needs = parameter_text(request, "depends_on", NULL),
        .since_ms = parameter_time(request, "created_after"),
        .until_ms = parameter_time(request, "created_before"),
        .limit = (int)parameter_integer(request, "limit", LIST_DEFAULT),
    };
    error e = {0};
    queue_page page = {0};
    size_t limit = (size_t)filter.limit;
    const char *sort = parameters_read_order(request, &filter.order, &filter.rising);
    char *mark = filter.order == QUEUE_BY_AGE && !filter.rising ? mem_strdup("") : mem_printf(":%s:", sort);
    filter.limit++; /* a further job means that there is a next page */
    if (!read_cursor(request, mark, &filter)) {
        reply_set_problem(r, "request_invalid", NULL,
                          "cursor must be `next` of a page of a list with the same `sort`");
    } else if (!filter.needs || restrict_to_own(request, &filter, r)) {
        if (queue_list_page(c->q, &filter, QUEUE_VISITS, &page, &e))
            answer_page(c, request, &page, limit, mark, filter.order, r);
        else
            reply_set_error(r, &e, NULL);
    }
    queue_page_clear(&page);
    free(mark);
}

/* Whether an ETag of If-None-Match has this revision, with any progress. */
static bool has_revision(const char *known, const queue_job *job)
{
    int64_t revision = 0;
    return job_json_read_tag(known, &revision) && revision == job->revision;
}

bool jobs_show_kept(const http_context *c, const http_request *request, reply *r)
{
    cached_document kept;
    const char *known = request->header[HTTP_IF_NONE_MATCH];
    if (request->header[HTTP_PREFER] ||
        !document_cache_find(c->documents, c->q, request->parameter[0], request->caller, &kept))
        return false;
    if (known && preconditions_match(known, kept.tag)) {
        reply_set_empty(r, 304);
        free(kept.text);
    } else {
        reply_set_text(r, "application/json", kept.text);
    }
    reply_add_header(r, "ETag", kept.tag);
    return true;
}

void jobs_show(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    char tag[JOB_JSON_TAG_SIZE];
    if (!job_lookup_find(c, request, &job, r)) return;
    const char *known = request->header[HTTP_IF_NONE_MATCH];
    int64_t wait_ms = read_wait_ms(c, request), until_ms = request->came_ms + wait_ms;
    bool patient = !request->last && clock_monotonic_ms() < until_ms;
    job_json_live live = live_of(c, request->caller, &job);
    job_json_print_tag(&job, &live, tag);
    job_json_live_clear(&live);
    /* at the first call, an outdated ETag is answered at once; after a wait, progress alone does not end
     * the wait */
    bool current = known && (request->waited ? has_revision(known, &job) : preconditions_match(known, tag));
    if (patient && (known ? current : !queue_state_is_final(job.state))) {
        reply_set_waiting(r, job.id, until_ms);
        queue_job_clear(&job);
        return;
    }
    if (known && preconditions_match(known, tag)) {
        reply_set_empty(r, 304);
        reply_add_header(r, "ETag", tag);
    } else {
        answer_job(c, request, &job, 200, r);
    }
    if (wait_ms > 0) add_applied(wait_ms, r);
    queue_job_clear(&job);
}
