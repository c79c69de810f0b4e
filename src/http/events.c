#include "http/events.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/memory.h"
#include "executor/rows.h"
#include "http/jobs.h"
#include "http/parameter.h"

#define PAGE_DEFAULT 50 /* as the table of parameters says */
/* Read at once for a stream. */
#define BATCH 64
/* Nothing for so long: a comment shows that the stream is there. */
#define SILENCE_MS 14000

/* The position of one stream. */
typedef struct follower {
    reply_source source; /* first: the server's view of it */
    const http_context *c;
    char id[ULID_SIZE];           /* "": all jobs */
    char owner[ACCESS_USER_SIZE]; /* "": of anyone */
    int64_t seq, row;
    char *text; /* what was read and not sent yet */
    size_t length, sent;
    bool ended; /* the job has: that was all */
    int64_t told_ms;
} follower;

static json *describe(const queue_event *event)
{
    char at[CLOCK_TEXT_SIZE];
    json *o = json_new_object();
    json_put_integer(o, "seq", event->seq);
    json_put_string(o, "at", clock_format_utc(event->at_ms, at));
    json_put_string(o, "job", event->id);
    json_put_string(o, "type", queue_event_type_name(event->type));
    json_put_string(o, "state", queue_state_name(event->state));
    json_put_string(o, "outcome", queue_outcome_name(event->outcome));
    if (event->frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", event->frame);
    if (event->attempt) json_put_integer(o, "attempt", event->attempt);
    return o;
}

static void write_event(FILE *out, const queue_event *event)
{
    json *o = describe(event);
    char *data = json_print(o);
    fprintf(out, "id: %lld\nevent: %s\ndata: %s\n\n", (long long)event->seq,
            queue_event_type_name(event->type), data);
    free(data);
    json_free(o);
}

/* The worker's line, with the job that it is of. */
static void write_row(FILE *out, const rows_line *line)
{
    json *o = json_new_object(), *progress = json_parse(line->text, strlen(line->text), NULL);
    json_put_string(o, "job", line->id);
    if (line->frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", line->frame);
    json_put_integer(o, "attempt", line->attempt);
    if (progress) json_put(o, "progress", progress);
    char *data = json_print(o);
    fprintf(out, "event: progress\ndata: %s\n\n", data);
    free(data);
    json_free(o);
}

static bool ends_job(const queue_event *event)
{
    return event->type == QUEUE_EVENT_STATE && queue_state_is_final(event->state);
}

/* Progress lines have no place among the events but one: behind a job's end there are none. */
static bool read_news(follower *f, FILE *out)
{
    error e = {0};
    const char *id = *f->id ? f->id : NULL;
    queue_event *events = NULL;
    rows_line *lines = NULL;
    size_t count = 0, told = 0;
    queue_event_filter filter = {
        .id = id, .owner = *f->owner ? f->owner : NULL, .after_seq = f->seq, .limit = BATCH};
    if (!queue_list_events(f->c->q, &filter, &events, &count, &e)) return false;
    size_t line_count = id ? rows_list(executor_rows(f->c->x), id, f->row, BATCH, &lines, &f->row) : 0;
    while (told < count && !(id && ends_job(&events[told]))) write_event(out, &events[told++]);
    for (size_t i = 0; i < line_count; i++) write_row(out, &lines[i]);
    for (; told < count; told++) write_event(out, &events[told]);
    if (count) {
        f->seq = events[count - 1].seq;
        f->ended =
            id && count < BATCH && ends_job(&events[count - 1]); /* after a whole batch there may be more */
    }
    free(events);
    rows_lines_free(lines, line_count);
    return true;
}

static ssize_t read_follower(reply_source *source, char *buffer, size_t size)
{
    follower *f = (follower *)(void *)source;
    int64_t now = clock_monotonic_ms();
    if (f->sent == f->length && !f->ended) {
        free(f->text);
        FILE *out = open_memstream(&f->text, &f->length);
        bool ok = read_news(f, out);
        f->sent = 0;
        if (ok && ftell(out) == 0 && now - f->told_ms >= SILENCE_MS) fputs(": nothing new\n\n", out);
        fclose(out);
        if (!ok) return -1; /* the client comes again, with the id of what it had last */
    }
    size_t count = f->length - f->sent < size ? f->length - f->sent : size;
    memcpy(buffer, f->text + f->sent, count);
    f->sent += count;
    if (count) f->told_ms = now;
    return count ? (ssize_t)count : f->ended ? -1 : 0;
}

static void free_follower(reply_source *source)
{
    follower *f = (follower *)(void *)source;
    free(f->text);
    free(f);
}

/* Where to go on: the header of a stream that was broken off, or the query. False when the header is no number. */
static bool read_position(const http_request *request, int64_t *after)
{
    const char *last = request->header[HTTP_LAST_EVENT_ID];
    *after = parameter_integer(request, "after", 0);
    if (!last) return true;
    size_t length = strlen(last);
    if (length == 0 || length > 18 || strspn(last, "0123456789") != length) return false;
    *after = strtoll(last, NULL, 10);
    return true;
}

static void follow(const http_context *c, const char *id, const char *owner, int64_t after, reply *r)
{
    follower *f = mem_alloc(sizeof *f);
    *f = (follower){
        .source = {read_follower, free_follower}, .c = c, .seq = after, .told_ms = clock_monotonic_ms()};
    strcpy(f->id, id);
    strcpy(f->owner, owner);
    reply_set_source(r, "text/event-stream", id, &f->source);
}

static void list(const http_context *c, const http_request *request, const char *id, const char *owner,
                 int64_t after, reply *r)
{
    error e = {0};
    queue_event *events = NULL;
    size_t count = 0, limit = (size_t)parameter_integer(request, "limit", PAGE_DEFAULT);
    queue_event_filter filter = {
        .id = *id ? id : NULL, .owner = *owner ? owner : NULL, .after_seq = after, .limit = (int)limit + 1};
    if (!queue_list_events(c->q, &filter, &events, &count, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    json *document = json_new_object(), *page = json_put_array(document, "events");
    for (size_t i = 0; i < count && i < limit; i++) json_append(page, describe(&events[i]));
    if (count > limit)
        json_put_integer(document, "next", events[limit - 1].seq);
    else
        json_put_null(document, "next");
    free(events);
    reply_set_json(r, 200, document);
}

static void answer(const http_context *c, const http_request *request, const char *id, const char *owner,
                   bool over, reply *r)
{
    int64_t after = 0;
    const char *accept = request->header[HTTP_ACCEPT];
    bool stream = accept && strstr(accept, "text/event-stream");
    if (!read_position(request, &after)) {
        reply_set_problem(r, "request_invalid", NULL, "Last-Event-ID is no number");
    } else if (!stream) {
        list(c, request, id, owner, after, r);
    } else if (over) {
        /* all was told: to a browser this says not to come again */
        reply_set_empty(r, 204);
    } else {
        follow(c, id, owner, after, r);
    }
}

/* Whether the job's last event is not behind `after`: there is no more to tell. */
static bool is_over(const http_context *c, const http_request *request, const queue_job *job)
{
    int64_t after = 0;
    queue_event *events = NULL;
    size_t count = 1;
    if (!queue_state_is_final(job->state) || !read_position(request, &after)) return false;
    queue_event_filter filter = {.id = job->id, .after_seq = after, .limit = 1};
    if (!queue_list_events(c->q, &filter, &events, &count, NULL)) return false;
    free(events);
    return count == 0;
}

void events_of_job(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    if (!jobs_find_own(c, request, &job, r)) return;
    answer(c, request, job.id, "", is_over(c, request, &job), r);
    queue_job_clear(&job);
}

void events_of_all(const http_context *c, const http_request *request, reply *r)
{
    bool admin = request->caller->scopes & SCOPE_ADMIN;
    answer(c, request, "", admin ? "" : request->caller->user, false, r);
}
