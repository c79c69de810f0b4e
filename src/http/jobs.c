#include "http/jobs.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "config.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"
#include "executor/result.h"
#include "base/frames.h"
#include "spec/spec.h"
#include "store/file.h"

#define LIST_DEFAULT 50
#define LIST_MOST 500

/* Submitters are told to come again after that long; a restarted daemon is back by then. */
#define RETRY_AFTER_S "5"

static void put_time(json *object, const char *key, int64_t wall_ms)
{
    char text[CLOCK_TEXT_SIZE];
    if (wall_ms)
        json_put_string(object, key, clock_format_utc(wall_ms, text));
    else
        json_put_null(object, key);
}

/* A text that this service stored as JSON; null should it not parse. */
static void put_stored(json *object, const char *key, const char *text)
{
    json *value = text ? json_parse(text, strlen(text), NULL) : NULL;
    if (value)
        json_put(object, key, value);
    else
        json_put_null(object, key);
}

static json *describe_job(const jobs_context *c, const queue_job *job)
{
    json *o = json_new_object();
    char *progress = executor_progress(c->x, job->id);
    json_put_string(o, "id", job->id);
    json_put_string(o, "name", job->name);
    json_put_string(o, "state", queue_state_name(job->state));
    json_put_string(o, "outcome", queue_outcome_name(job->outcome));
    json_put_integer(o, "priority", job->priority);
    put_stored(o, "labels", job->labels);
    put_time(o, "created", job->created_ms);
    put_time(o, "started", job->started_ms);
    put_time(o, "finished", job->finished_ms);
    json_put_integer(o, "attempt", job->attempts);
    json_put_integer(o, "max_attempts", job->max_attempts);
    put_stored(o, "progress", queue_state_is_final(job->state) ? NULL : progress);
    json_put_string(o, "cached_from", job->cached_from);
    if (job->error_code) {
        json *fault = json_put_object(o, "error");
        json_put_string(fault, "code", job->error_code);
        json_put_string(fault, "message", job->error_message);
    } else {
        json_put_null(o, "error");
    }
    json *links = json_put_object(o, "links");
    char *self = mem_printf("/v1/jobs/%s", job->id);
    json_put_string(links, "self", self);
    if (job->state == QUEUE_SUCCEEDED) {
        char *results = mem_printf("%s/results", self);
        json_put_string(links, "results", results);
        free(results);
    }
    free(self);
    free(progress);
    return o;
}

static bool put_attempts(const jobs_context *c, const queue_job *job, json *object, error *e)
{
    queue_attempt *attempts = NULL;
    size_t count = 0;
    if (!queue_list_attempts(c->q, job->id, &attempts, &count, e)) return false;
    json *list = json_put_array(object, "attempts");
    for (size_t i = 0; i < count; i++) {
        const queue_attempt *a = &attempts[i];
        json *o = json_append_object(list);
        json_put_integer(o, "number", a->number);
        put_time(o, "started", a->started_ms);
        put_time(o, "finished", a->finished_ms);
        if (a->exit_status >= 0) json_put_integer(o, "exit_status", a->exit_status);
        if (a->signal >= 0) json_put_integer(o, "signal", a->signal);
        if (a->peak_memory_bytes > 0)
            json_put_integer(o, "peak_memory_bytes", a->peak_memory_bytes);
        if (a->reason) json_put_string(o, "reason", a->reason);
    }
    queue_attempts_free(attempts, count);
    return true;
}

/* Finds the job that the path names, or answers why not. */
static bool find_job(const jobs_context *c, const jobs_request *request, queue_job *job, reply *r)
{
    error e = {0};
    bool found = false;
    const char *id = request->parameter[0];
    if (ulid_is_valid(id) && !queue_get(c->q, id, job, &found, &e)) {
        reply_set_error(r, &e, NULL);
        return false;
    }
    if (!found) reply_set_problem(r, "not_found", NULL, "there is no job %s", id);
    return found;
}

/* The document of a job that is in the queue, read from there. */
static void show_job(const jobs_context *c, const char *id, int status, reply *r)
{
    error e = {0};
    queue_job job = {0};
    bool found = false;
    json *document = NULL;
    if (!queue_get(c->q, id, &job, &found, &e)) goto failed;
    if (!found) {
        error_set(&e, ERROR_INTERNAL, "the job %s is gone", id);
        goto failed;
    }
    document = describe_job(c, &job);
    put_stored(document, "spec", job.spec);
    if (!put_attempts(c, &job, document, &e)) goto failed;
    reply_set_json(r, status, document);
    queue_job_clear(&job);
    return;
failed:
    json_free(document);
    queue_job_clear(&job);
    reply_set_error(r, &e, NULL);
}

static void append_fault(json *errors, const char *pointer, const char *detail)
{
    json *o = json_append_object(errors);
    json_put_string(o, "pointer", pointer);
    json_put_string(o, "detail", detail);
}

/* Parses the body into a spec, or answers why not. */
static spec *read_spec(const jobs_request *request, reply *r)
{
    error e = {0};
    json *document = json_parse(request->body, request->length, &e);
    if (!document) {
        reply_set_problem(r, "json_invalid", NULL, "%s", e.message);
        return NULL;
    }
    spec_faults faults = {0};
    spec *s = spec_parse(document, &faults, &e);
    json_free(document);
    if (s) return s;
    json *errors = json_new_array();
    for (size_t i = 0; i < faults.count; i++)
        append_fault(errors, faults.item[i].pointer, faults.item[i].detail);
    reply_set_error(r, &e, errors);
    return NULL;
}

/* Looks whether the inputs may be read and are there, so that a mistake shows at once; the worker
 * opens them again under the same roots. Of a sequence the first frame is looked at. */
static bool check_inputs(const jobs_context *c, const spec *s, reply *r)
{
    spec_input input;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        error e = {0};
        char *path = s->frames ? frames_path(input.path, s->frame[0]) : mem_strdup(input.path);
        int fd = store_open_input(c->roots, path, &e);
        free(path);
        if (fd >= 0) {
            close(fd);
            continue;
        }
        json *errors = json_new_array();
        append_fault(errors, input.pointer, e.message);
        reply_set_error(r, &e, errors);
        return false;
    }
    return true;
}

static void refuse_for_now(reply *r, const char *code, const char *why)
{
    reply_set_problem(r, code, NULL, "%s", why);
    reply_add_header(r, "Retry-After", RETRY_AFTER_S);
}

/* Looks whether a copy of the results may go where the spec wants it. */
static bool check_output(const jobs_context *c, const spec *s, reply *r)
{
    error e = {0};
    if (!s->directory || store_output_check(c->outputs, s->directory, &e)) return true;
    json *errors = json_new_array();
    append_fault(errors, "/output/directory", e.message);
    reply_set_error(r, &e, errors);
    return false;
}

/* Answers why the job was not taken. */
static void refuse(const queue_receipt *receipt, const spec *s, reply *r)
{
    if (receipt->verdict != QUEUE_UNKNOWN_DEPENDENCY) {
        refuse_for_now(r, "too_many_jobs",
                       "you have as many unfinished jobs as this service allows (user_queued)");
        return;
    }
    error e = {0};
    char pointer[64];
    json *errors = json_new_array();
    snprintf(pointer, sizeof pointer, "/queue/depends_on/%zu", receipt->dependency);
    error_set(&e, ERROR_SPEC_INVALID, "there is no job %s to depend on", s->depends_on[receipt->dependency]);
    append_fault(errors, pointer, e.message);
    reply_set_error(r, &e, errors);
}

static char *print_labels(const spec *s)
{
    json *labels = json_new_array();
    for (size_t i = 0; i < s->label_count; i++) json_append_string(labels, s->labels[i]);
    char *text = json_print(labels);
    json_free(labels);
    return text;
}

/* The document of a job that was put in the queue just now. It is made of what was put: the job is
 * accepted, whatever another look at the database would say. */
static void show_accepted(const jobs_context *c, const queue_receipt *receipt, const queue_submission *put,
                          reply *r)
{
    queue_job job = {
        .name = (char *)put->name,
        .labels = (char *)put->labels,
        .state = receipt->state,
        .priority = put->priority,
        .created_ms = ulid_time_ms(receipt->id),
        .max_attempts = put->max_attempts,
    }; /* borrows its texts */
    memcpy(job.id, receipt->id, sizeof job.id);
    json *document = describe_job(c, &job);
    put_stored(document, "spec", put->spec);
    json_put_array(document, "attempts");
    reply_set_json(r, 201, document);
}

void jobs_submit(const jobs_context *c, const jobs_request *request, reply *r)
{
    if (executor_is_draining(c->x)) {
        refuse_for_now(r, "unavailable", "the service is about to end and takes no more jobs");
        return;
    }
    spec *s = read_spec(request, r);
    if (!s) return;
    if (!check_inputs(c, s, r) || !check_output(c, s, r)) {
        spec_free(s);
        return;
    }
    error e = {0};
    queue_receipt receipt;
    char *labels = print_labels(s), *text = json_print(s->normalised);
    queue_submission submission = {
        .name = s->name,
        .labels = labels,
        .spec = text,
        .priority = s->priority,
        .max_attempts = s->max_attempts > 0 ? s->max_attempts : c->max_attempts,
        .threads = s->threads,
        .memory_mb = s->memory_mb,
        .retention_s = s->retention_s > 0 ? s->retention_s : c->retention_s,
        .frames = s->frame,
        .frame_count = s->frame_count,
        .depends_on = (const char *const *)s->depends_on,
        .depends_on_count = s->depends_on_count,
        .most_waiting = c->most_waiting,
    };
    if (!executor_size(c->x, &submission.threads, &submission.memory_mb, &e)) {
        reply_set_error(r, &e, NULL);
    } else if (!queue_put(c->q, &submission, &receipt, &e)) {
        refuse_for_now(r, "unavailable",
                       e.message); /* a full disk: the submitter's to wait for, not a fault */
    } else if (receipt.verdict != QUEUE_CREATED) {
        refuse(&receipt, s, r);
    } else {
        executor_wake(c->x);
        log_write(LOG_LEVEL_INFO, "job accepted job=%s", receipt.id);
        show_accepted(c, &receipt, &submission, r);
        char *location = mem_printf("/v1/jobs/%s", receipt.id);
        reply_add_header(r, "Location", location);
        free(location);
    }
    free(labels);
    free(text);
    spec_free(s);
}

static bool read_integer(const char *text, int64_t low, int64_t high, int64_t *value)
{
    if (!text || !*text || strspn(text, "0123456789") != strlen(text) || strlen(text) > 18)
        return false;
    int64_t read = strtoll(text, NULL, 10);
    if (read < low || read > high) return false;
    *value = read;
    return true;
}

/* Reads the query of a listing, or answers what is wrong with it. */
static bool read_filter(const jobs_request *request, queue_filter *filter, reply *r)
{
    int64_t limit = LIST_DEFAULT;
    *filter = (queue_filter){.state = -1};
    for (size_t i = 0; i < request->query_count; i++) {
        const char *key = request->query[i].key, *value = request->query[i].value;
        queue_state state = QUEUE_QUEUED;
        for (size_t other = 0; other < i; other++) {
            if (strcmp(key, request->query[other].key) != 0) continue;
            reply_set_problem(r, "request_invalid", NULL, "query %.100s stands twice", key);
            return false;
        }
        if (strcmp(key, "state") == 0 && value && queue_state_from_name(value, &state)) {
            filter->state = (int)state;
        } else if (strcmp(key, "limit") == 0 && read_integer(value, 1, LIST_MOST, &limit)) {
            continue;
        } else if (strcmp(key, "cursor") == 0 &&
                   read_integer(value, 1, INT64_MAX, &filter->before_seq)) {
            continue;
        } else {
            reply_set_problem(
                r, "request_invalid", NULL,
                "query %.100s=%.100s: known are state (one of the states), limit (1 to %d) and"
                " cursor (the next of an earlier answer)",
                key, value ? value : "", LIST_MOST);
            return false;
        }
    }
    filter->limit = (int)limit;
    return true;
}

void jobs_list(const jobs_context *c, const jobs_request *request, reply *r)
{
    queue_filter filter;
    if (!read_filter(request, &filter, r)) return;
    error e = {0};
    queue_job *jobs = NULL;
    size_t count = 0, limit = (size_t)filter.limit;
    filter.limit++; /* one more tells whether there is a next page */
    if (!queue_list(c->q, &filter, &jobs, &count, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    json *document = json_new_object();
    json *list = json_put_array(document, "jobs");
    for (size_t i = 0; i < count && i < limit; i++) json_append(list, describe_job(c, &jobs[i]));
    if (count > limit) {
        char cursor[24];
        snprintf(cursor, sizeof cursor, "%lld", (long long)jobs[limit - 1].seq);
        json_put_string(document, "next", cursor);
    } else {
        json_put_null(document, "next");
    }
    queue_jobs_free(jobs, count);
    reply_set_json(r, 200, document);
}

void jobs_show(const jobs_context *c, const jobs_request *request, reply *r)
{
    queue_job job = {0};
    if (!find_job(c, request, &job, r)) return;
    show_job(c, job.id, 200, r);
    queue_job_clear(&job);
}

void jobs_cancel(const jobs_context *c, const jobs_request *request, reply *r)
{
    error e = {0};
    bool found = false, changed = false;
    queue_state now = QUEUE_QUEUED;
    const char *id = request->parameter[0];
    if (ulid_is_valid(id) && !executor_tell(c->x, id, QUEUE_CANCEL, &found, &changed, &now, &e))
        reply_set_error(r, &e, NULL);
    else if (!found)
        reply_set_problem(r, "not_found", NULL, "there is no job %s", id);
    else if (!changed && queue_state_is_final(now))
        reply_set_problem(r, "conflict", NULL, "the job %s has ended already: %s", id,
                          queue_state_name(now));
    else
        show_job(c, id, now == QUEUE_CANCELLED ? 200 : 202, r);
}

static const char *content_type_of(const char *name)
{
    static const struct {
        const char *ending, *type;
    } types[] = {
        {".json", "application/json"},
        {".png", "image/png"},
        {".exr", "image/x-exr"},
        {".ply", "model/ply"},
    };
    size_t length = strlen(name);
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        size_t n = strlen(types[i].ending);
        if (length > n && strcmp(name + length - n, types[i].ending) == 0) return types[i].type;
    }
    return "application/octet-stream";
}

/* Finds the result of the job that the path names, or answers why there is none. *directory is to
 * be freed, *found to be cleared. */
static bool find_result(const jobs_context *c, const jobs_request *request, char **directory,
                        result *found, reply *r)
{
    error e = {0};
    queue_job job = {0};
    if (!find_job(c, request, &job, r)) return false;
    bool ok = false;
    char *path = result_directory(c->state_dir, job.id, QUEUE_NO_FRAME);
    if (!queue_state_is_final(job.state))
        reply_set_problem(r, "conflict", NULL, "the job %s has not ended: %s", job.id,
                          queue_state_name(job.state));
    else if (job.state != QUEUE_SUCCEEDED)
        reply_set_problem(r, "not_found", NULL, "the job %s has no results: %s", job.id,
                          queue_state_name(job.state));
    else if (job.array)
        reply_set_problem(r, "not_found", NULL,
                          "the job %s has results for each of its frames, none of its own", job.id);
    else if (!result_read(path, found, &e))
        reply_set_error(r, &e, NULL);
    else
        ok = true;
    queue_job_clear(&job);
    if (ok)
        *directory = path;
    else
        free(path);
    return ok;
}

static void append_result(json *list, const char *id, const char *name, int64_t bytes,
                          const char *sha256)
{
    json *o = json_append_object(list);
    char *href = mem_printf("/v1/jobs/%s/results/%s", id, name);
    json_put_string(o, "name", name);
    json_put_integer(o, "bytes", bytes);
    json_put_string(o, "sha256", sha256);
    json_put_string(o, "content_type", content_type_of(name));
    json_put_string(o, "href", href);
    free(href);
}

void jobs_list_results(const jobs_context *c, const jobs_request *request, reply *r)
{
    char *directory = NULL;
    result found = {0};
    error e = {0};
    if (!find_result(c, request, &directory, &found, r)) return;
    json *document = json_new_object();
    json *list = json_put_array(document, "results");
    for (size_t i = 0; i < found.output_count; i++)
        append_result(list, request->parameter[0], found.output[i].name, found.output[i].bytes,
                      found.output[i].sha256);
    /* the report cannot list its own hash */
    int64_t size = 0;
    uint64_t bytes = 0;
    char sha256[STORE_HASH_SIZE];
    int fd = result_open_file(directory, RESULT_REPORT_NAME, &size, &e);
    if (fd >= 0 && store_file_hash(fd, sha256, &bytes, &e)) {
        append_result(list, request->parameter[0], RESULT_REPORT_NAME, (int64_t)bytes, sha256);
        reply_set_json(r, 200, document);
    } else {
        json_free(document);
        reply_set_error(r, &e, NULL);
    }
    if (fd >= 0) close(fd);
    result_clear(&found);
    free(directory);
}

void jobs_send_result(const jobs_context *c, const jobs_request *request, reply *r)
{
    char *directory = NULL;
    result found = {0};
    error e = {0};
    const char *name = request->parameter[1];
    if (!find_result(c, request, &directory, &found, r)) return;
    bool listed = strcmp(name, RESULT_REPORT_NAME) == 0;
    for (size_t i = 0; i < found.output_count && !listed; i++)
        listed = strcmp(name, found.output[i].name) == 0;
    if (!listed) {
        reply_set_problem(r, "not_found", NULL, "the job %s has no result named %.200s",
                          request->parameter[0], name);
    } else {
        int64_t bytes = 0;
        int fd = result_open_file(directory, name, &bytes, &e);
        if (fd >= 0)
            reply_set_file(r, content_type_of(name), fd, bytes);
        else
            reply_set_error(r, &e, NULL);
    }
    result_clear(&found);
    free(directory);
}

void jobs_health(const jobs_context *c, const jobs_request *request, reply *r)
{
    (void)request;
    json *document = json_new_object();
    json_put_string(document, "status", executor_is_draining(c->x) ? "draining" : "ok");
    reply_set_json(r, 200, document);
}

void jobs_version(const jobs_context *c, const jobs_request *request, reply *r)
{
    (void)c;
    (void)request;
    json *document = json_new_object();
    json_put_string(document, "name", PACKAGE_NAME);
    json_put_string(document, "version", PACKAGE_VERSION);
    json_put_string(document, "api", "v1");
    reply_set_json(r, 200, document);
}
