// SPDX-License-Identifier: Apache-2.0
#include "service/api/uploads.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "service/api/job_json.h"
#include "service/http/parameter.h"

typedef struct upload {
    http_sink sink;     /* first member: the server passes its address */
    store_upload *file; /* NULL: the received bytes are ignored */
    bool known;         /* the file exists and the caller may use it; received bytes replace a damaged one */
    store_upload_outcome outcome;
    error why;
} upload;

/* Refuses a file over the limit. `bytes`: its length; -1: the client did not send it. */
static void refuse_size(int64_t bytes, int64_t limit_bytes, reply *r)
{
    char length[40] = "more";
    if (bytes >= 0) snprintf(length, sizeof length, "%lld", (long long)bytes);
    reply_set_problem(r, "body_too_large", NULL,
                      "the file has %s bytes%s %lld (setting upload_limit_bytes): reduce it, or put it "
                      "below an input root",
                      length, bytes >= 0 ? ", and the limit is" : " than the limit of",
                      (long long)limit_bytes);
}

static void refuse(const http_context *c, const http_request *request, store_upload_outcome outcome,
                   const error *why, reply *r)
{
    const char *user = request->caller->user;
    store_inputs_space uploads;
    executor_space disk;
    switch (outcome) {
    case STORE_UPLOAD_GOOD:
        break;
    case STORE_UPLOAD_TOO_LARGE:
        refuse_size(request->announced, store_inputs_get_space(c->inputs).file_limit_bytes, r);
        break;
    case STORE_UPLOAD_ALL_FULL:
        uploads = store_inputs_get_space(c->inputs);
        reply_set_problem(r, "storage_full", NULL,
                          "the file does not fit: all uploads have %lld of %lld bytes (setting "
                          "upload_total_bytes). Delete uploads that are not needed; unused ones expire after "
                          "inputs_keep_s.",
                          (long long)uploads.used_bytes, (long long)uploads.limit_bytes);
        break;
    case STORE_UPLOAD_DISK_FULL:
        executor_note_failed_write(c->x);
        disk = executor_get_space(c->x);
        reply_set_problem(
            r, "storage_full", NULL,
            "the file does not fit: %lld MiB are free on the disk of %s. Delete uploads and jobs that "
            "are not needed, or free space on this disk.",
            (long long)disk.free_bytes >> 20, disk.directory);
        break;
    case STORE_UPLOAD_USER_FULL:
        reply_set_refusal(r, ledger_explain(c->counts, LEDGER_UPLOAD_BYTES, LEDGER_HOLDER_FULL, user));
        break;
    case STORE_UPLOAD_TOO_MANY:
        reply_set_refusal(r, ledger_explain(c->counts, LEDGER_UPLOADS, LEDGER_HOLDER_FULL, user));
        break;
    case STORE_UPLOAD_MISMATCH:
        reply_set_problem(
            r, "digest_mismatch", NULL,
            "the SHA-256 of the received bytes differs from the one in the path: send the file again");
        break;
    case STORE_UPLOAD_GONE:
        reply_set_problem(r, "conflict", NULL, "the file was deleted during the request: send it again");
        break;
    case STORE_UPLOAD_FAILED:
        executor_note_failed_write(c->x);
        reply_set_error(r, why, NULL);
        break;
    }
}

/* Returns the hash in the path. If it is malformed, sets a problem and returns NULL. */
static const char *read_hash(const http_request *request, reply *r)
{
    const char *hex = request->parameter[0];
    if (sent_file_is_hash(hex)) return hex;
    reply_set_problem(r, "request_invalid", NULL,
                      "%.100s is not a SHA-256: use 64 hexadecimal digits in lower case", hex);
    return NULL;
}

static void put_input(const http_context *c, const access_caller *caller, const char *hex, int64_t bytes,
                      json *o)
{
    char *path = mem_printf(STORE_INPUT_PREFIX "%s", hex), *name;
    const int64_t sent_ms = store_inputs_find_sent(c->inputs, hex, caller->user, &name);
    json_put_string(o, "sha256", hex);
    json_put_integer(o, "bytes", bytes);
    json_put_string(o, "path", path);
    json_put_string(o, "name", name);
    job_json_put_time(o, "sent", sent_ms >= 0 ? sent_ms : 0);
    free(path);
    free(name);
}

static void show(const http_context *c, const access_caller *caller, const char *hex, int64_t bytes,
                 int status, reply *r)
{
    json *document = json_new_object();
    put_input(c, caller, hex, bytes, document);
    reply_set_json(r, status, document);
}

static void open_upload(http_sink *sink)
{
    upload *u = (upload *)(void *)sink;
    if (u->file) u->outcome = store_upload_open(u->file, &u->why);
}

static void take(http_sink *sink, const char *bytes, size_t count)
{
    upload *u = (upload *)(void *)sink;
    if (u->file) u->outcome = store_upload_write(u->file, bytes, count, &u->why);
}

/* Removes an unfinished upload, and counts it no longer. */
static void end(upload *u)
{
    store_upload_end(u->file);
    u->file = NULL;
}

static void drop(http_sink *sink)
{
    upload *u = (upload *)(void *)sink;
    end(u);
    free(u);
}

bool uploads_may_use(const http_context *c, const access_caller *caller, const char *hex)
{
    return c->share_inputs || caller->scopes & SCOPE_ADMIN ||
           store_inputs_holds(c->inputs, hex, caller->user, NULL);
}

bool uploads_check(const http_context *c, const access_caller *caller, const char *path, error *e)
{
    char name[STORE_INPUT_NAME_SIZE];
    bool sent = sent_file_match(path, name);
    const char *hex = name + strlen(STORE_INPUT_PREFIX);
    /* first count a use, so that the file is not removed before it is opened */
    if (sent && (!uploads_may_use(c, caller, hex) || store_inputs_use(c->inputs, hex) < 0))
        return error_set(e, ERROR_INPUT_MISSING,
                         "%s: the file was not uploaded by this user, or has expired: send it with hexadctl "
                         "upload",
                         path);
    bool is_directory; /* of an image of many files; whatever else is named by it is refused by the worker */
    int fd = store_open_place(c->roots, path, &is_directory, e);
    if (fd >= 0) close(fd);
    return fd >= 0;
}

http_sink *uploads_begin(const http_context *c, const http_request *request, reply *r)
{
    store_upload *file = NULL;
    const char *hex = read_hash(request, r);
    if (!hex) return NULL;
    error e = {0};
    if (!queue_has_place(c->q, &e)) {
        reply_set_error(r, &e, NULL);
        return NULL;
    }
    int64_t there = uploads_may_use(c, request->caller, hex) ? store_inputs_use(c->inputs, hex) : -1;
    /* the client has not sent the body yet: answer without it; records are stored by a thread of the pool */
    if (there >= 0 && request->waits &&
        store_inputs_holds(c->inputs, hex, request->caller->user, parameter_text(request, "name", NULL))) {
        show(c, request->caller, hex, there, 200, r);
        return NULL;
    }
    if (there < 0 || request->announced != 0) {
        store_upload_outcome outcome =
            store_upload_begin(c->inputs, hex, request->caller->user, request->announced, &file);
        if (outcome != STORE_UPLOAD_GOOD && there < 0) {
            refuse(c, request, outcome, NULL, r);
            return NULL;
        }
    }
    upload *u = mem_alloc(sizeof *u);
    *u = (upload){.sink = {open_upload, take, drop}, .file = file, .known = there >= 0};
    return &u->sink;
}

void uploads_put(const http_context *c, const http_request *request, reply *r)
{
    upload *u = (upload *)(void *)request->sink;
    const char *hex = request->parameter[0], *name = parameter_text(request, "name", NULL);
    if (u->known && u->outcome != STORE_UPLOAD_GOOD) { /* such as no space for what is there already */
        end(u);
        u->outcome = STORE_UPLOAD_GOOD;
    }
    bool sent = u->file != NULL;
    if (u->outcome == STORE_UPLOAD_GOOD)
        u->outcome = !queue_has_place(c->q, &u->why) ? STORE_UPLOAD_FAILED
                     : sent                          ? store_upload_commit(u->file, name, &u->why)
                            : store_inputs_hold(c->inputs, hex, request->caller->user, name, &u->why);
    end(u); /* before the answer, after which the client may begin the next upload */
    if (u->outcome != STORE_UPLOAD_GOOD) {
        refuse(c, request, u->outcome, &u->why, r);
        return;
    }
    show(c, request->caller, hex, store_inputs_find(c->inputs, hex, NULL), u->known ? 200 : 201, r);
    if (u->known) return;
    log_write(LOG_LEVEL_INFO, "input stored sha256=%s user=%s", hex, request->caller->user);
    char *location = mem_printf("/v1/inputs/%s", hex);
    reply_add_header(r, "Location", location);
    free(location);
}

void uploads_show(const http_context *c, const http_request *request, reply *r)
{
    const char *hex = read_hash(request, r);
    if (!hex) return;
    int64_t bytes = uploads_may_use(c, request->caller, hex) ? store_inputs_find(c->inputs, hex, NULL) : -1;
    if (bytes >= 0)
        show(c, request->caller, hex, bytes, 200, r);
    else
        reply_set_problem(r, "not_found", NULL,
                          "the input %s was not uploaded by this user, or has expired: send it with hexadctl "
                          "upload",
                          hex);
}

/* A cursor is the time, in milliseconds, and the hash of the last file of the previous page. */
static bool read_cursor(const char *text, queue_upload *last)
{
    char *end = NULL;
    last->sent_ms = strtoll(text, &end, 10);
    if (end == text || *end != '-' || !sent_file_is_hash(end + 1)) return false;
    strcpy(last->hash, end + 1);
    return true;
}

/* Appends a file that the caller holds, with the caller's jobs that read it, unless the file is missing. */
static bool append_upload(const http_context *c, const access_caller *caller, const char *hex, json *list,
                          error *e)
{
    queue_input_jobs jobs;
    int64_t used_ms, bytes = store_inputs_find(c->inputs, hex, &used_ms);
    char name[STORE_INPUT_NAME_SIZE];
    if (bytes < 0) return true;
    snprintf(name, sizeof name, STORE_INPUT_PREFIX "%s", hex);
    if (!queue_list_input_jobs(c->q, name, caller->user, &jobs, e)) return false;
    json *o = json_append_object(list);
    put_input(c, caller, hex, bytes, o);
    job_json_put_time(o, "used", used_ms);
    json *ids = json_put_array(o, "jobs");
    for (size_t i = 0; i < jobs.id_count; i++) json_append_string(ids, jobs.id[i]);
    json_put_integer(o, "job_count", jobs.all);
    json_put_integer(o, "unfinished_count", jobs.unfinished);
    return true;
}

void uploads_list(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_upload *list = NULL, last = {.sent_ms = INT64_MAX};
    size_t count = 0, limit = (size_t)parameter_integer(request, "limit", 50);
    const char *cursor = parameter_text(request, "cursor", NULL);
    if (cursor && !read_cursor(cursor, &last)) {
        reply_set_problem(r, "request_invalid", NULL, "cursor must be `next` of a page of this list");
        return;
    }
    bool ok = store_inputs_list(c->inputs, request->caller->user, &last, (int)limit + 1, &list, &count, &e);
    json *document = json_new_object(), *files = json_put_array(document, "inputs");
    for (size_t i = 0; ok && i < count && i < limit; i++)
        ok = append_upload(c, request->caller, list[i].hash, files, &e);
    char *next = ok && count > limit
                     ? mem_printf("%lld-%s", (long long)list[limit - 1].sent_ms, list[limit - 1].hash)
                     : NULL;
    json_put_string(document, "next", next);
    if (ok) {
        reply_set_json(r, 200, document);
    } else {
        reply_set_error(r, &e, NULL);
        json_free(document);
    }
    free(next);
    free(list);
}

void uploads_delete(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    bool found = false, all = parameter_integer(request, "all", 0) != 0,
         admin = request->caller->scopes & SCOPE_ADMIN;
    const char *hex = read_hash(request, r);
    if (!hex) return;
    if (all && !admin) {
        reply_set_problem(r, "forbidden", NULL,
                          "only administrators may delete a file that other users hold: omit all=1");
        return;
    }
    if (!queue_has_place(c->q, &e) ||
        !(all ? store_inputs_remove(c->inputs, hex, &found, &e)
              : store_inputs_release(c->inputs, hex, request->caller->user, &found, &e)))
        reply_set_error(r, &e, NULL);
    else if (!found)
        reply_set_problem(r, "not_found", NULL, "the input %s %s%s", hex,
                          all ? "does not exist" : "was not uploaded by this user, or has expired",
                          admin && !all
                              ? ": to delete a file of other users, add all=1 (hexadctl delete-upload --all)"
                              : "");
    else
        reply_set_empty(r, 204);
}

/* Runs a worker that inspects a file, and answers with its result. uploads_check must have accepted the
 * path. */
static void inspect(const http_context *c, const char *path, const char *user, reply *r)
{
    error e = {0};
    int threads = 0;
    int64_t memory_mb = 0;
    char name[STORE_INPUT_NAME_SIZE], *found = NULL;
    const char *sent = name;
    size_t sent_count = sent_file_match(path, name);
    if (!executor_size(c->x, &threads, &memory_mb, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    json *asked = json_new_object();
    json_put_string(asked, "path", path);
    char *text = json_print(asked);
    estimator_outcome outcome = estimator_run(c->estimator, WORKER_COMMAND_INSPECT, text, &sent, sent_count,
                                              QUEUE_NO_FRAME, threads, memory_mb, 0, &found, &e);
    if (outcome == ESTIMATOR_MADE)
        reply_set_text(r, "application/json", found);
    else if (outcome == ESTIMATOR_FAULT) {
        job_json_name_files_of_error(&e, c->inputs, user);
        reply_set_error(r, &e, NULL);
    } else
        reply_set_problem(r, "unavailable", NULL, "%s", e.message);
    if (outcome == ESTIMATOR_BUSY) reply_ask_again(r);
    free(text);
    json_free(asked);
}

void uploads_inspect(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    json *document = json_parse(request->body, request->length, &e);
    json_at root = json_root(document);
    const char *asked = json_string(json_member(&root, "path"), NULL);
    if (!document) {
        reply_set_problem(r, "json_invalid", NULL, "%s", e.message);
    } else if (!asked || !*asked || json_size(root) != 1) {
        reply_set_problem(r, "request_invalid", NULL,
                          "the body must be an object with one member, path, the path of a file");
    } else if (!c->estimator) {
        reply_set_problem(r, "unavailable", NULL,
                          "this service does not inspect files: the setting estimates is 0");
    } else {
        char *mapped = path_map_apply(c->mappings, asked);
        const char *path = mapped ? mapped : asked;
        if (uploads_check(c, request->caller, path, &e))
            inspect(c, path, request->caller->user, r);
        else
            reply_set_error(r, &e, NULL);
        free(mapped);
    }
    json_free(document);
}
