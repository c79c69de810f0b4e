// SPDX-License-Identifier: Apache-2.0
#include "service/api/result_files.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <nettle/base64.h>

#include "service/api/job_lookup.h"
#include "base/core/clock.h"
#include "base/core/file_format.h"
#include "base/core/hex.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "io/pictures/picture_png.h"
#include "io/pictures/thumbnail.h"
#include "service/http/parameter.h"
#include "service/http/preconditions.h"
#include "service/results/result.h"

/* A file of a result never changes. Each user must be authorised, so shared caches must not store it. */
#define CACHE_CONTROL "private, max-age=31536000, immutable"

static const char *content_type_of(const char *name)
{
    const char *type = file_formats[file_format_of_name(name)].content_type;
    return type ? type : "application/octet-stream";
}

/* Tasks that one query reads. */
enum { TASKS_PAGE = 1000 };

/* Finds the first frame of an array that has succeeded. If there is none, sets a problem and returns
 * false. */
static bool choose_first_frame(const http_context *c, const queue_job *job, int *frame, queue_state *state,
                               reply *r)
{
    error e = {0};
    size_t count = TASKS_PAGE;
    *state = QUEUE_QUEUED;
    for (int after = -1; count == TASKS_PAGE && *state != QUEUE_SUCCEEDED;) {
        queue_task *tasks = NULL;
        if (!queue_list_tasks(c->q, job->id, after, TASKS_PAGE, &tasks, &count, &e)) {
            reply_set_error(r, &e, NULL);
            return false;
        }
        size_t i = 0;
        while (i < count && tasks[i].state != QUEUE_SUCCEEDED) i++;
        if (i < count) {
            *state = QUEUE_SUCCEEDED;
            *frame = tasks[i].frame;
        }
        after = count ? tasks[count - 1].number : after;
        queue_tasks_free(tasks, count);
    }
    if (*state == QUEUE_SUCCEEDED) return true;
    reply_set_problem(r, "not_found", NULL, "no frame of the job %s has succeeded: see its tasks", job->id);
    return false;
}

/* Reads the query parameter `frame` of an array, and the state of that frame. If it is missing, `any` selects
 * the first frame that has succeeded. A job that is not an array has no frames: *frame and *state stay as
 * they are. On failure sets a problem and returns false. */
static bool choose_frame(const http_context *c, const http_request *request, const queue_job *job, bool any,
                         int *frame, queue_state *state, reply *r)
{
    error e = {0};
    bool found = false;
    queue_task task = {0};
    const char *given = parameter_text(request, "frame", NULL);
    if (!job->array && !given) return true;
    if (any && !given) return choose_first_frame(c, job, frame, state, r);
    if (!job->array || !given) {
        reply_set_problem(r, "request_invalid", NULL,
                          job->array
                              ? "the job %s has frames: choose one (query parameter frame, option --frame)"
                              : "the job %s has no frames",
                          job->id);
        return false;
    }
    *frame = (int)parameter_integer(request, "frame", QUEUE_NO_FRAME);
    if (!queue_get_frame(c->q, job->id, *frame, &task, &found, &e)) {
        reply_set_error(r, &e, NULL);
        return false;
    }
    *state = task.state;
    queue_task_clear(&task);
    if (!found)
        reply_set_problem(r, "not_found", NULL, "the job %s has no frame %s: choose one of its queue.frames",
                          job->id, given);
    return found;
}

/* A result of a job. */
typedef struct place {
    char *directory;
    int frame;      /* or QUEUE_NO_FRAME */
    bool any_frame; /* set by the caller: for an array, the query parameter `frame` is optional */
    bool own;       /* the caller is the job's owner, or the job has none */
    result found;   /* from result_list: with report.json */
} place;

static void place_clear(place *p)
{
    free(p->directory);
    result_clear(&p->found);
}

/* Finds the result of the job in the path. If there is none, sets a problem and returns false. */
static bool find_result(const http_context *c, const http_request *request, place *p, reply *r)
{
    error e = {0};
    queue_job job = {0};
    if (!job_lookup_find_own(c, request, &job, r)) return false;
    bool ok = false;
    int frame = QUEUE_NO_FRAME;
    queue_state state = job.state;
    if (!choose_frame(c, request, &job, p->any_frame, &frame, &state, r)) {
        queue_job_clear(&job);
        return false;
    }
    char *path = result_directory(c->work_dir, job.id, frame);
    if (!queue_state_is_final(state))
        reply_set_problem(r, "conflict", NULL, "the job %s has not ended (its state is %s): wait for its end",
                          job.id, queue_state_name(state));
    else if (state != QUEUE_SUCCEEDED)
        reply_set_problem(
            r, "not_found", NULL,
            state == QUEUE_CANCELLED
                ? "the job %s has no results, because its state is %s: hexadctl retry %s runs it again"
                : "the job %s has no results, because its state is %s: hexadctl show %s prints its error",
            job.id, queue_state_name(state), job.id);
    else if (!result_list(path, &p->found, &e))
        reply_set_error(r, &e, NULL);
    else
        ok = true;
    p->own = !*job.owner || strcmp(job.owner, request->caller->user) == 0;
    p->frame = frame;
    p->directory = path;
    queue_job_clear(&job);
    return ok;
}

void result_files_list(const http_context *c, const http_request *request, reply *r)
{
    place p = {0};
    if (!find_result(c, request, &p, r)) {
        place_clear(&p);
        return;
    }
    json *document = json_new_object();
    json *list = json_put_array(document, "results");
    for (size_t i = 0; i < p.found.output_count; i++) {
        const result_output *output = &p.found.output[i];
        json *o = json_append_object(list);
        const char *frame = parameter_text(request, "frame", NULL);
        char *href = mem_printf("/v1/jobs/%s/results/%s%s%s", request->parameter[0], output->name,
                                frame ? "?frame=" : "", frame ? frame : "");
        json_put_string(o, "name", output->name);
        json_put_integer(o, "bytes", output->bytes);
        json_put_string(o, "sha256", output->sha256);
        json_put_string(o, "content_type", content_type_of(output->name));
        json_put_string(o, "href", href);
        free(href);
    }
    reply_set_json(r, 200, document);
    place_clear(&p);
}

/* Adds the header with the hash, "sha-256=:BASE64:" (RFC 9530), from its hexadecimal form. */
static void add_digest(reply *r, const char *hex)
{
    uint8_t bytes[32];
    char base64[BASE64_ENCODE_RAW_LENGTH(sizeof bytes) + 1], value[80];
    hex_read(hex, bytes, sizeof bytes);
    base64_encode_raw(base64, sizeof bytes, bytes);
    base64[sizeof base64 - 1] = '\0';
    snprintf(value, sizeof value, "sha-256=:%s:", base64);
    reply_add_header(r, "Repr-Digest", value);
}

static void add_range(reply *r, int64_t first, int64_t count, int64_t bytes)
{
    char value[80];
    if (count)
        snprintf(value, sizeof value, "bytes %lld-%lld/%lld", (long long)first,
                 (long long)(first + count - 1), (long long)bytes);
    else
        snprintf(value, sizeof value, "bytes */%lld", (long long)bytes);
    reply_add_header(r, "Content-Range", value);
}

/* Sets a reply with the file, the requested range of it, or 304. Takes ownership of the descriptor. */
static void send_file(const http_request *request, const result_output *output, int fd, int64_t bytes,
                      reply *r)
{
    char tag[sizeof output->sha256 + 2];
    int64_t first = 0, count = 0;
    snprintf(tag, sizeof tag, "\"%s\"", output->sha256);
    const char *known = request->header[HTTP_IF_NONE_MATCH], *same = request->header[HTTP_IF_RANGE];
    const char *wanted = same && strcmp(same, tag) != 0 ? NULL : request->header[HTTP_RANGE];
    preconditions_range range = preconditions_read_range(wanted, bytes, &first, &count);
    if (known && preconditions_match(known, tag)) {
        reply_set_empty(r, 304);
        close(fd);
    } else if (range == PRECONDITIONS_UNSATISFIABLE) {
        reply_set_problem(r, "range_not_satisfiable", NULL,
                          "the result %s has %lld bytes: request a range within them", output->name,
                          (long long)bytes);
        add_range(r, 0, 0, bytes);
        close(fd);
        return;
    } else {
        reply_set_file(r, content_type_of(output->name), fd, bytes);
        if (range == PRECONDITIONS_PART) {
            r->status = 206;
            r->fd_offset = first;
            r->fd_bytes = count;
            add_range(r, first, count, bytes);
        }
        reply_add_header(r, "Accept-Ranges", "bytes");
        add_digest(r, output->sha256);
    }
    reply_add_header(r, "ETag", tag);
    r->cache_control = CACHE_CONTROL;
}

/* Reports to the executor that a file of a result was sent to its owner. */
typedef struct files_receipt {
    reply_receipt receipt;
    executor *x;
    fetches_result of;
    size_t index, count;
} files_receipt;

static void end_sending(reply_receipt *receipt, bool sent)
{
    files_receipt *s = (files_receipt *)receipt;
    if (sent) executor_note_sent(s->x, &s->of, s->index, s->count);
    free(s);
}

/* Adds the receipt that reports the end of the reply, if the owner then has the whole file: after 200, and
 * after 304, which means that the client has it already. */
static void add_receipt(const http_context *c, const http_request *request, const place *p, size_t index,
                        reply *r)
{
    if (!p->own || (r->status != 200 && r->status != 304)) return;
    files_receipt *s = mem_alloc(sizeof *s);
    *s = (files_receipt){.receipt.end = end_sending,
                         .x = c->x,
                         .of.frame = p->frame,
                         .index = index,
                         .count = p->found.output_count};
    snprintf(s->of.id, sizeof s->of.id, "%s", request->parameter[0]);
    r->receipt = &s->receipt;
}

/* The index of a file of the result; output_count if there is no file of this name. */
static size_t find_output(const place *p, const char *name)
{
    size_t i = 0;
    while (i < p->found.output_count && strcmp(name, p->found.output[i].name) != 0) i++;
    return i;
}

void result_files_send(const http_context *c, const http_request *request, reply *r)
{
    place p = {0};
    error e = {0};
    const char *name = request->parameter[1];
    if (!find_result(c, request, &p, r)) {
        place_clear(&p);
        return;
    }
    size_t i = find_output(&p, name);
    if (i == p.found.output_count) {
        reply_set_problem(r, "not_found", NULL,
                          "the job %s has no result named %.200s: list its results for their names",
                          request->parameter[0], name);
    } else {
        int64_t bytes = 0;
        int fd = result_open_file(p.directory, name, &bytes, &e);
        if (fd >= 0) {
            send_file(request, &p.found.output[i], fd, bytes, r);
            add_receipt(c, request, &p, i, r);
        } else {
            reply_set_error(r, &e, NULL);
        }
    }
    place_clear(&p);
}

static bool is_stopping(void *waiting)
{
    return wait_list_is_dismissed(waiting);
}

/* Another process decodes the preview. Error limit_time: after thumbnail_timeout_s, or when the service
 * stops. */
static bool read_thumbnail(const http_context *c, const char *directory, thumbnail *out, error *e)
{
    const thumbnail_patience patience = {.until_ms =
                                             clock_monotonic_ms() + (int64_t)(c->thumbnail_timeout_s * 1000),
                                         .is_over = is_stopping,
                                         .context = c->waiting};
    int64_t bytes;
    int fd = result_open_file(directory, WORKER_PREVIEW_NAME, &bytes, e);
    bool ok = fd >= 0 && thumbnail_read(c->worker, fd, &patience, out, e);
    if (fd >= 0) close(fd);
    return ok;
}

/* Encodes the picture as PNG in memory and sets a reply of status 200. Error: internal; the reply is then
 * unchanged. */
static bool set_png(reply *r, const canvas *picture, error *e)
{
    struct stat info;
    int fd = memfd_create("picture", MFD_CLOEXEC), own = fd >= 0 ? dup(fd) : -1;
    FILE *file = own >= 0 ? fdopen(own, "wb") : NULL;
    bool ok = file || error_set(e, ERROR_INTERNAL, "a file in memory cannot be made: %s", strerror(errno));
    ok = ok && picture_png_write(file, picture, e);
    if (ok && fstat(fd, &info) != 0)
        ok = error_set(e, ERROR_INTERNAL, "the file in memory cannot be examined: %s", strerror(errno));
    if (file)
        fclose(file);
    else if (own >= 0)
        close(own);
    if (ok)
        reply_set_file(r, "image/png", fd, info.st_size);
    else if (fd >= 0)
        close(fd);
    return ok;
}

static void send_thumbnail(const http_context *c, const place *p, reply *r)
{
    error e = {0};
    thumbnail *made = mem_alloc(sizeof *made);
    bool ok = read_thumbnail(c, p->directory, made, &e);
    const canvas picture = {.rgb = made->rgb, .width = made->width, .height = made->height, .scale = 1};
    if (e.code == ERROR_LIMIT_TIME)
        reply_set_unavailable(
            r, wait_list_is_dismissed(c->waiting)
                   ? "the service is stopping"
                   : "the preview could not be read in time (setting thumbnail_timeout_s); try "
                     "again when the service is less busy");
    else if (!ok || !set_png(r, &picture, &e))
        reply_set_error(r, &e, NULL);
    free(made);
}

void result_files_send_thumbnail(const http_context *c, const http_request *request, reply *r)
{
    place p = {.any_frame = true};
    if (find_result(c, request, &p, r)) {
        /* without a named frame, the first succeeded frame may be another one later */
        bool changes = p.frame != QUEUE_NO_FRAME && !parameter_text(request, "frame", NULL);
        const char *lasting = changes ? "private, no-cache" : CACHE_CONTROL;
        const size_t i = find_output(&p, WORKER_PREVIEW_NAME);
        if (i == p.found.output_count) {
            reply_set_problem(r, "not_found", NULL, "the job %s has no " WORKER_PREVIEW_NAME,
                              request->parameter[0]);
            r->cache_control = lasting;
        } else {
            char tag[sizeof p.found.output[i].sha256 + 16];
            snprintf(tag, sizeof tag, "\"%s.%d\"", p.found.output[i].sha256, THUMBNAIL_SIDE);
            const char *known = request->header[HTTP_IF_NONE_MATCH];
            if (known && preconditions_match(known, tag))
                reply_set_empty(r, 304);
            else
                send_thumbnail(c, &p, r);
            if (r->status < 400) {
                reply_add_header(r, "ETag", tag);
                r->cache_control = lasting;
            }
        }
    }
    place_clear(&p);
}

void result_files_refuse_contact_sheet(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    reply_set_problem(
        r, "gone", NULL,
        "there are no contact sheets: GET /v1/jobs/%s/thumbnail.png?frame=N has the preview of a frame",
        request->parameter[0]);
}
