// SPDX-License-Identifier: Apache-2.0
#include "service/api/job_json.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "service/api/paths.h"
#include "base/core/clock.h"
#include "base/core/hash.h"
#include "base/core/memory.h"
#include "files/sent_file.h"
#include "service/http/reply.h"
#include "service/results/result.h"
#include "spec/file_names.h"

void job_json_put_time(json *object, const char *key, int64_t wall_ms)
{
    char text[CLOCK_TEXT_SIZE];
    if (wall_ms)
        json_put_string(object, key, clock_format_utc(wall_ms, text));
    else
        json_put_null(object, key);
}

void job_json_put_stored(json *object, const char *key, const char *text)
{
    if (text)
        json_put_text(object, key, text);
    else
        json_put_null(object, key);
}

/* The value of a JSON text, to be freed; NULL if the text is NULL or not valid. */
static json *parse_stored(const char *text)
{
    return text ? json_parse(text, strlen(text), NULL) : NULL;
}

job_json_viewer job_json_viewer_of(const access_caller *caller, const char *owner)
{
    return caller->scopes & SCOPE_ADMIN     ? JOB_JSON_ADMINISTRATOR
           : access_is_owner(caller, owner) ? JOB_JSON_OWNER
                                            : JOB_JSON_READER;
}

const char *job_json_cached_from(const queue_job *job, job_json_viewer viewer)
{
    bool shown = viewer == JOB_JSON_ADMINISTRATOR || (viewer == JOB_JSON_OWNER && job->cached_shown);
    return shown ? job->cached_from : NULL;
}

static void put_error(json *o, job_json_viewer viewer, const char *code, const char *message)
{
    if (!code) {
        json_put_null(o, "error");
        return;
    }
    json *fault = json_put_object(o, "error");
    json_put_string(fault, "code", code);
    json_put_string(fault, "message", viewer == JOB_JSON_READER ? reply_title(code) : message);
}

void job_json_put_spec(json *object, job_json_viewer viewer, const char *stored_spec,
                       const char *stored_paths)
{
    bool own = viewer != JOB_JSON_READER;
    json *document = parse_stored(own ? stored_spec : NULL), *paths = parse_stored(own ? stored_paths : NULL);
    if (document) {
        paths_restore(paths, document);
        json_put(object, "spec", document);
    } else {
        json_put_null(object, "spec");
    }
    json_put(object, "paths", paths ? paths : json_new_array());
}

void job_json_live_clear(job_json_live *live)
{
    free(live->progress);
    free(live->input);
    free(live->error_message);
}

bool job_json_is_fixed(const job_json_live *live)
{
    return !live->progress && !live->input_is_label && !live->error_message && live->ahead < 0;
}

void job_json_print_tag(const queue_job *job, const job_json_live *live, char tag[JOB_JSON_TAG_SIZE])
{
    uint64_t hash = hash_add_text(HASH_NONE, live->progress);
    hash = hash_add_text(hash_add(hash, 0), live->input); /* 0 separates texts */
    hash = hash_add_text(hash_add(hash, (uint32_t)live->ahead), live->error_message);
    if (job_json_is_fixed(live))
        snprintf(tag, JOB_JSON_TAG_SIZE, "\"%lld\"", (long long)job->revision);
    else
        snprintf(tag, JOB_JSON_TAG_SIZE, "\"%lld.%08x\"", (long long)job->revision, (unsigned)hash);
}

void job_json_put_notes(json *object, const char *work_dir, const char *id, int frame, bool succeeded)
{
    result r = {0};
    char *directory = result_directory(work_dir, id, frame);
    if (succeeded) result_peek(directory, &r); /* a damaged or missing result gives no notes */
    job_json_put_stored(object, "notes", r.notes);
    result_clear(&r);
    free(directory);
}

/* Adds the numbers of tasks by state. Every document has them and the links: one printf is cheaper than
 * twelve values. */
static void put_counts(json *object, const queue_counts *n)
{
    char text[256];
    snprintf(text, sizeof text,
             "{\"all\":%d,\"waiting\":%d,\"running\":%d,\"succeeded\":%d,\"failed\":%d,\"cancelled\":%d,"
             "\"timed_out\":%d}",
             n->all, n->waiting, n->running, n->succeeded, n->failed, n->cancelled, n->timed_out);
    json_put_text(object, "tasks", text);
}

static void put_links(json *object, const queue_job *job)
{
    static const char *const parts[] = {"tasks", "attempts", "events", "log", "results"};
    bool results = job->state == QUEUE_SUCCEEDED || job->tasks.succeeded > 0;
    size_t count = sizeof parts / sizeof *parts - !results;
    char text[512];
    int used = snprintf(text, sizeof text, "{\"self\":\"/v1/jobs/%s\"", job->id);
    for (size_t i = 0; i < count; i++)
        used += snprintf(text + used, sizeof text - (size_t)used, ",\"%s\":\"/v1/jobs/%s/%s\"", parts[i],
                         job->id, parts[i]);
    snprintf(text + used, sizeof text - (size_t)used, "}");
    json_put_text(object, "links", text);
}

/* Adds `delivery`, the state of the copy to output.directory; null for a state of NULL. */
static void put_delivery(json *object, const char *state, const char *code, const char *message)
{
    if (!state) {
        json_put_null(object, "delivery");
        return;
    }
    json *o = json_put_object(object, "delivery");
    json_put_string(o, "state", state);
    json_put_string(o, "code", code);
    json_put_string(o, "message", message);
}

/* The words of the spec are the outcomes of the queue in the same order. */
unsigned job_json_outcomes(unsigned accept)
{
    return accept << QUEUE_CONVERGED;
}

/* The first path of a file in a part of a spec; NULL: none. */
static const char *first_path(const json_at *at)
{
    const char *found = NULL;
    for (json_at member = json_first(at); member.node && !found; member = json_next(&member)) {
        const bool is_path = member.key && strcmp(member.key, "path") == 0;
        found = is_path ? json_string(member, NULL) : first_path(&member);
    }
    return found;
}

char *job_json_name_files(const char *text, const store_inputs *inputs, const char *user)
{
    enum { PREFIX = sizeof STORE_INPUT_PREFIX - 1 };
    char *named = NULL, hex[STORE_INPUT_HEX + 1];
    const char *from = text;
    for (const char *at = text; at && (at = strstr(at, STORE_INPUT_PREFIX));) {
        const char *end = at + PREFIX;
        snprintf(hex, sizeof hex, "%s", end);
        char *name = NULL;
        if (sent_file_is_hash(hex)) store_inputs_find_sent(inputs, hex, user, &name);
        if (!name) {
            at = end;
            continue;
        }
        end += STORE_INPUT_HEX;
        while (*end == '.' && isalnum((unsigned char)end[1]))
            for (end++; isalnum((unsigned char)*end);) end++;
        char *longer = mem_printf("%s%.*s%s (" STORE_INPUT_PREFIX "%.*s...)", named ? named : "",
                                  (int)(at - from), from, name, STORE_INPUT_SHOWN, hex);
        free(named);
        free(name);
        named = longer;
        from = at = end;
    }
    char *whole = named ? mem_printf("%s%s", named, from) : NULL;
    free(named);
    return whole;
}

void job_json_name_files_of_error(error *e, const store_inputs *inputs, const char *user)
{
    char *named = job_json_name_files(e->message, inputs, user);
    if (named) error_set(e, e->code, "%s", named);
    free(named);
}

void job_json_find_names(job_json_live *live, const queue_job *job, job_json_viewer viewer,
                         const store_inputs *inputs, const char *user)
{
    if (viewer != JOB_JSON_READER && job->error_message)
        live->error_message = job_json_name_files(job->error_message, inputs, user);

    char sent[STORE_INPUT_NAME_SIZE];
    const bool wanted = viewer != JOB_JSON_READER && job->spec && (!job->name || !*job->name);
    json *document = wanted ? json_parse(job->spec, strlen(job->spec), NULL) : NULL;
    json_at root = json_root(document), surface = json_member(&root, "surface");
    const char *path = first_path(&surface), *slash = path ? strrchr(path, '/') : NULL;
    live->input_is_label = path && sent_file_match(path, sent);
    if (path && file_names_has_place(path)) { /* a data set */
        path = json_string(json_root(json_find(document, "/queue/files")), NULL);
        slash = path ? strrchr(path, '/') : NULL;
    }
    if (live->input_is_label)
        store_inputs_find_sent(inputs, sent + strlen(STORE_INPUT_PREFIX), user, &live->input);
    else
        live->input = path ? mem_strdup(slash ? slash + 1 : path) : NULL;
    json_free(document);
}

json *job_json_new(const queue_job *job, job_json_viewer viewer, const job_json_live *live)
{
    bool own = viewer != JOB_JSON_READER;
    json *o = json_new_object();
    json_put_string(o, "id", job->id);
    json_put_string(o, "name", job->name);
    json_put_string(o, "input", live->input);
    json_put_string(o, "owner", job->owner ? job->owner : "");
    json_put_integer(o, "revision", job->revision);
    json_put_string(o, "state", queue_state_name(job->state));
    json_put_bool(o, "paused", job->paused);
    json_put_string(o, "outcome", queue_outcome_name(job->outcome));
    if (own && job->state == QUEUE_SUCCEEDED)
        json_put_bool(o, "accepted", job->accepted);
    else
        json_put_null(o, "accepted");
    json_put_integer(o, "priority", job->priority);
    job_json_put_stored(o, "labels", job->labels);
    job_json_put_time(o, "created", job->created_ms);
    job_json_put_time(o, "started", job->started_ms);
    job_json_put_time(o, "finished", job->finished_ms);
    json_put_bool(o, "array", job->array);
    put_counts(o, &job->tasks);
    json_put_integer(o, "attempt", job->attempts);
    json_put_integer(o, "max_attempts", own ? job->max_attempts : 0);
    json_put_integer(o, "threads", job->threads);
    json_put_integer(o, "memory_mb", job->memory_mb);
    json_put_integer(o, "retention_s", own ? job->retention_s : 0);
    json_put_string(o, "traceparent", own ? job->trace : NULL);
    json_put_string(o, "cached_from", job_json_cached_from(job, viewer));
    job_json_put_stored(o, "progress", own ? live->progress : NULL);
    if (live->ahead >= 0)
        json_put_integer(o, "ahead", live->ahead);
    else
        json_put_null(o, "ahead");
    put_error(o, viewer, job->error_code, live->error_message ? live->error_message : job->error_message);
    put_delivery(o, own ? job->copy_state : NULL, job->copy_code, job->copy_message);
    put_links(o, job);
    return o;
}

bool job_json_read_tag(const char *tag, int64_t *revision)
{
    char *end = NULL;
    if (strncmp(tag, "W/", 2) == 0) tag += 2;
    if (*tag != '"' || !isdigit((unsigned char)tag[1])) return false;
    *revision = strtoll(tag + 1, &end, 10);
    if (*end == '.') end += 1 + strspn(end + 1, "0123456789abcdef");
    return end[0] == '"' && !end[1];
}

void job_json_append_attempt(json *list, const queue_job *job, const queue_attempt *a)
{
    json *o = json_append_object(list);
    if (a->frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", a->frame);
    json_put_integer(o, "number", a->number);
    job_json_put_time(o, "started", a->started_ms);
    job_json_put_time(o, "finished", a->finished_ms);
    if (a->exit_status >= 0) json_put_integer(o, "exit_status", a->exit_status);
    if (a->signal >= 0) json_put_integer(o, "signal", a->signal);
    if (a->peak_memory_bytes > 0) json_put_integer(o, "peak_memory_bytes", a->peak_memory_bytes);
    if (job->memory_mb > 0) json_put_integer(o, "memory_limit_bytes", job->memory_mb << 20);
    if (a->waited_ms > 0) json_put_integer(o, "waited_ms", a->waited_ms);
    if (a->processor_ms > 0) json_put_integer(o, "processor_ms", a->processor_ms);
    if (a->host) json_put_string(o, "host", a->host);
    if (a->reason) json_put_string(o, "reason", a->reason);
}

json *job_json_append_task(json *list, const queue_task *t, const store_inputs *inputs, const char *user)
{
    char *named = t->error_message ? job_json_name_files(t->error_message, inputs, user) : NULL;
    json *o = json_append_object(list);
    json_put_integer(o, "number", t->number);
    if (t->frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", t->frame);
    if (t->file) json_put_string(o, "file", t->file);
    json_put_string(o, "state", queue_state_name(t->state));
    json_put_string(o, "outcome", queue_outcome_name(t->outcome));
    json_put_integer(o, "attempt", t->attempt);
    json_put_integer(o, "spent", t->spent);
    json_put_integer(o, "interrupted", t->interrupted);
    json_put_integer(o, "waits", t->waits);
    job_json_put_time(o, "not_before", t->not_before_ms);
    job_json_put_time(o, "started", t->started_ms);
    job_json_put_time(o, "finished", t->finished_ms);
    put_error(o, JOB_JSON_OWNER, t->error_code, named ? named : t->error_message);
    free(named);
    return o;
}

/* Adds `frame` for the owner; the numbers of frames are part of the spec. */
static void put_frame(json *o, job_json_viewer viewer, int frame)
{
    if (viewer != JOB_JSON_READER && frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", frame);
}

json *job_json_new_event(const queue_event *event, job_json_viewer viewer)
{
    char at[CLOCK_TEXT_SIZE];
    json *o = json_new_object();
    json_put_integer(o, "seq", event->seq);
    json_put_string(o, "at", clock_format_utc(event->at_ms, at));
    json_put_string(o, "job", event->id);
    json_put_string(o, "type", queue_event_type_name(event->type));
    json_put_string(o, "state", queue_state_name(event->state));
    json_put_string(o, "outcome", queue_outcome_name(event->outcome));
    put_frame(o, viewer, event->frame);
    if (event->attempt) json_put_integer(o, "attempt", event->attempt);
    return o;
}

void job_json_append_worker(json *list, const queue_claimed *running, job_json_viewer viewer,
                            const char *host)
{
    const queue_job *job = &running->job;
    json *o = json_append_object(list);
    json_put_string(o, "job", job->id);
    json_put_string(o, "name", job->name);
    json_put_string(o, "owner", job->owner);
    put_frame(o, viewer, running->task.frame);
    if (viewer != JOB_JSON_READER && running->task.file) json_put_string(o, "file", running->task.file);
    json_put_integer(o, "attempt", running->task.attempt);
    job_json_put_time(o, "started", running->task.started_ms);
    json_put_integer(o, "threads", job->threads);
    json_put_integer(o, "memory_mb", job->memory_mb);
    json_put_string(o, "host", viewer == JOB_JSON_READER ? NULL : host);
}
