// SPDX-License-Identifier: Apache-2.0
#include "service/api/events.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "service/api/job_json.h"
#include "service/api/job_lookup.h"
#include "service/api/notifier.h"
#include "base/core/clock.h"
#include "base/core/memory.h"
#include "service/executor/progress_ring.h"
#include "service/http/header_list.h"
#include "service/http/parameter.h"

/* Events of a page without the parameter `limit`; parameters.c documents the same number. */
#define PAGE_DEFAULT 50
/* Events, and progress lines, that a stream reads with one query. */
#define BATCH 64
/* Time without data, in milliseconds, after which a stream sends a comment, so that proxies do not close
 * it. */
#define SILENCE_MS 14000

_Static_assert(QUEUE_OWNER_SIZE >= ACCESS_USER_SIZE, "the owner of an event is not truncated");

/* Instead of the number of a progress line: only lines that are written later. */
#define ROWS_FROM_NOW INT64_MAX

/* The events that a request selects. */
typedef struct selection {
    const char *id, *owner, *label; /* NULL: any */
    const char *viewer;             /* the caller; "": an administrator */
    bool whole_job;                 /* the events of job `id` until its end */
    bool progress;                  /* progress lines, too; `label` does not filter them */
    int64_t after; /* number of the last event that the client has, or QUEUE_EVENTS_FROM_NOW */
    int64_t row;   /* number of the last progress line that the client has, or ROWS_FROM_NOW */
} selection;

/* One stream. */
typedef struct follower {
    reply_source source; /* first member: the server passes its address */
    const http_context *c;
    char *id, *owner, *label;      /* NULL: any */
    char viewer[ACCESS_USER_SIZE]; /* "": an administrator */
    bool whole_job, progress;
    bool begun;           /* the first page was read */
    bool behind;          /* more events exist than the last page had */
    int64_t seq, row;     /* the last event and the last progress line that were read */
    int64_t sent_seq;     /* the last id that was written to the stream */
    int64_t sent_removed; /* `removed_up_to` of the last position event */
    char *text;           /* the piece for the client */
    size_t length;        /* of `text` */
    bool taken;           /* the server has taken `text` */
    bool at_end;          /* the last event is the end of its job */
    bool ended;           /* the stream is of one job and complete */
    int64_t sent_ms;      /* when data was last produced, monotonic */
} follower;

/* The event with the members that the viewer may see; "": an administrator. */
static json *describe(const char *viewer, const queue_event *event)
{
    bool own = !*viewer || strcmp(viewer, event->owner) == 0;
    return job_json_new_event(event, own ? JOB_JSON_OWNER : JOB_JSON_READER);
}

static void write_event(follower *f, FILE *out, const queue_event *event)
{
    json *o = describe(f->viewer, event);
    char *data = json_print(o);
    fprintf(out, "id: %lld\nevent: %s\ndata: %s\n\n", (long long)event->seq,
            queue_event_type_name(event->type), data);
    f->sent_seq = event->seq;
    free(data);
    json_free(o);
}

/* Adds `removed_up_to` if events after `after` were removed, and `reset` if `after` is beyond the newest
 * event. */
static void put_missing(json *object, const queue_event_page *page, int64_t after)
{
    if (page->removed_up_to > after && after >= 0)
        json_put_integer(object, "removed_up_to", page->removed_up_to);
    if (after > page->newest) json_put_bool(object, "reset", true);
}

/* Writes an event `position`: the stream continues after `seq`. `page` (may be NULL) is the page that
 * follows; `after` is the number that the client named. */
static void write_position(follower *f, FILE *out, const queue_event_page *page, int64_t after, int64_t seq)
{
    json *o = json_new_object();
    json_put_integer(o, "seq", seq);
    if (page) put_missing(o, page, after);
    char *data = json_print(o);
    fprintf(out, "id: %lld\nevent: position\ndata: %s\n\n", (long long)seq, data);
    f->sent_seq = seq;
    if (page) f->sent_removed = page->removed_up_to;
    free(data);
    json_free(o);
}

/* Writes a progress line of a worker, with the id of its job. The id of this event is the id of the last
 * stored event, a dot and the number of the line. */
static void write_row(const follower *f, FILE *out, const progress_ring_line *line)
{
    json *o = json_new_object(), *progress = json_parse(line->text, strlen(line->text), NULL);
    json_put_string(o, "job", line->id);
    if (line->frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", line->frame);
    json_put_integer(o, "attempt", line->attempt);
    if (progress) json_put(o, "progress", progress);
    char *data = json_print(o);
    fprintf(out, "id: %lld.%lld\nevent: progress\ndata: %s\n\n", (long long)f->sent_seq,
            (long long)line->number, data);
    free(data);
    json_free(o);
}

static bool ends_job(const queue_event *event)
{
    return event->type == QUEUE_EVENT_STATE && queue_state_is_final(event->state);
}

/* Writes a position before the events of a page if the stream begins, if events are missing or after a
 * reset. */
static void introduce(follower *f, FILE *out, const queue_event_page *page)
{
    bool from_now = f->seq < 0 || f->seq > page->newest, reset = f->seq > page->newest;
    bool missing = page->removed_up_to > f->seq && page->removed_up_to > f->sent_removed;
    if (reset || (!f->whole_job && (!f->begun || missing)))
        write_position(f, out, page, f->seq, from_now ? page->newest : f->seq);
    f->begun = true;
}

/* Reads new progress lines of jobs whose progress the viewer may see. */
static size_t list_progress(follower *f, progress_ring_line **lines)
{
    const char *owner = f->owner ? f->owner : *f->viewer ? f->viewer : NULL;
    if (!f->progress || (owner && *f->viewer && strcmp(owner, f->viewer) != 0)) return 0;
    return progress_ring_list(executor_progress_ring(f->c->x), f->id, owner, f->row, BATCH, lines, &f->row);
}

/* Reads a page of new events and new progress lines. Progress lines may be anywhere between events, but not
 * after the end of the job. */
static bool read_news(follower *f, FILE *out, error *e)
{
    queue_event_page page;
    progress_ring_line *lines = NULL;
    size_t written = 0, line_count = 0;
    queue_event_filter filter = {
        .id = f->id, .owner = f->owner, .label = f->label, .after_seq = f->seq, .limit = BATCH};
    if (!queue_list_events(f->c->q, &filter, &page, e)) return false;
    introduce(f, out, &page);
    line_count = list_progress(f, &lines);
    while (written < page.count && !(f->whole_job && ends_job(&page.events[written])))
        write_event(f, out, &page.events[written++]);
    for (size_t i = 0; i < line_count; i++) write_row(f, out, &lines[i]);
    for (; written < page.count; written++) write_event(f, out, &page.events[written]);
    f->seq = page.position;
    if (page.count) f->at_end = ends_job(&page.events[page.count - 1]);
    f->ended = f->whole_job && f->at_end && !page.more;
    /* the filter skipped a long run of events: send a position, so that the server can serve other
     * connections */
    if ((page.more || f->behind) && f->sent_seq < f->seq) write_position(f, out, NULL, f->seq, f->seq);
    f->behind = page.more;
    free(page.events);
    progress_ring_lines_free(lines, line_count);
    return true;
}

/* Writes a position if the filter has skipped events, otherwise a comment. */
static void break_silence(follower *f, FILE *out)
{
    if (!f->whole_job && f->sent_seq < f->seq)
        write_position(f, out, NULL, f->seq, f->seq);
    else
        fputs(": nothing new\n\n", out);
}

/* Fills `text` with new events. If there are none for SILENCE_MS, break_silence. */
static bool refill(follower *f, error *e)
{
    free(f->text);
    f->text = NULL;
    FILE *out = open_memstream(&f->text, &f->length);
    bool ok = read_news(f, out, e);
    if (ok && ftell(out) == 0 && clock_monotonic_ms() - f->sent_ms >= SILENCE_MS) break_silence(f, out);
    fclose(out);
    return ok;
}

static ssize_t produce(reply_source *source, const char **piece)
{
    follower *f = (follower *)(void *)source;
    error e = {0};
    /* on an error the stream ends, and the client reconnects with the id of the last event that it
     * received */
    if (f->taken && (f->ended || !refill(f, &e))) return -1;
    f->taken = true;
    *piece = f->text;
    if (f->length) f->sent_ms = clock_monotonic_ms();
    return f->length ? (ssize_t)f->length : f->ended ? -1 : 0;
}

static void free_follower(reply_source *source)
{
    follower *f = (follower *)(void *)source;
    free(f->id);
    free(f->owner);
    free(f->label);
    free(f->text);
    free(f);
}

/* Reads a number of 1 to 18 digits and advances the text behind it. */
static bool read_number(const char **text, int64_t *number)
{
    size_t length = strspn(*text, "0123456789");
    if (length == 0 || length > 18) return false;
    *number = strtoll(*text, NULL, 10);
    *text += length;
    return true;
}

/* Reads where to continue: after Last-Event-ID of an interrupted stream, or after the query parameter. With
 * the id of a stored event, only progress lines that are written later follow. False if the header is not
 * an id of an event. */
static bool read_position(const http_request *request, int64_t otherwise, selection *s)
{
    const char *last = request->header[HTTP_LAST_EVENT_ID];
    s->after = parameter_integer(request, "after", otherwise);
    if (!last) return true;
    s->row = ROWS_FROM_NOW;
    if (!read_number(&last, &s->after)) return false;
    return !*last || (*last++ == '.' && read_number(&last, &s->row) && !*last);
}

static char *copy(const char *text)
{
    return text ? mem_strdup(text) : NULL;
}

static void refuse_position(reply *r)
{
    reply_set_problem(r, "request_invalid", NULL, "Last-Event-ID must be the id of an event");
}

/* Answers with a stream. The first page is read here, before the head of the answer is sent, so that the
 * stream has all events after the client received the head. */
static void follow(const http_context *c, const selection *s, reply *r)
{
    error e = {0};
    char topic[REPLY_TOPIC_SIZE] = "";
    follower *f = mem_alloc(sizeof *f);
    *f = (follower){.source = {produce, free_follower},
                    .c = c,
                    .id = copy(s->id),
                    .owner = copy(s->owner),
                    .label = copy(s->label),
                    .whole_job = s->whole_job,
                    .progress = s->progress,
                    .seq = s->after,
                    .sent_seq = s->after,
                    .row = s->row,
                    .sent_ms = clock_monotonic_ms()};
    strcpy(f->viewer, s->viewer);
    if (s->id)
        strcpy(topic, s->id);
    else if (s->owner)
        notifier_name_topic(s->owner, topic);
    if (refill(f, &e)) {
        if (!f->length) { /* the server sends the head only with the first bytes of the body */
            free(f->text);
            f->text = mem_strdup(": the stream begins\n\n");
            f->length = strlen(f->text);
        }
        reply_set_source(r, "text/event-stream", topic, &f->source);
        reply_add_header(r, "X-Accel-Buffering", "no"); /* nginx then does not buffer the events */
    } else {
        reply_set_error(r, &e, NULL);
        free_follower(&f->source);
    }
}

static void list(const http_context *c, const http_request *request, const selection *s, reply *r)
{
    error e = {0};
    queue_event_page page;
    size_t limit = (size_t)parameter_integer(request, "limit", PAGE_DEFAULT);
    queue_event_filter filter = {.id = s->id,
                                 .owner = s->owner,
                                 .label = s->label,
                                 .after_seq = s->after,
                                 .limit =
                                     (int)limit + 1}; /* a further event means that there is a next page */
    if (!queue_list_events(c->q, &filter, &page, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    int64_t position = page.count > limit ? page.events[limit - 1].seq : page.position;
    json *document = json_new_object(), *events = json_put_array(document, "events");
    for (size_t i = 0; i < page.count && i < limit; i++)
        json_append(events, describe(s->viewer, &page.events[i]));
    if (page.more)
        json_put_integer(document, "next", position);
    else
        json_put_null(document, "next");
    json_put_integer(document, "position", position);
    put_missing(document, &page, s->after);
    free(page.events);
    reply_set_json(r, 200, document);
}

static bool wants_stream(const http_request *request)
{
    return header_list_find(request->header[HTTP_ACCEPT], "text/event-stream") != NULL;
}

static void answer(const http_context *c, const http_request *request, const selection *s, reply *r)
{
    if (wants_stream(request))
        follow(c, s, r);
    else
        list(c, request, s, r);
}

/* Whether the job has ended and has no event after `after`, so that a stream would be empty. */
static bool is_over(const http_context *c, const queue_job *job, int64_t after)
{
    queue_event_page page;
    queue_event_filter filter = {.id = job->id, .after_seq = after, .limit = 1};
    if (!queue_state_is_final(job->state) || !queue_list_events(c->q, &filter, &page, NULL)) return false;
    free(page.events);
    return page.count == 0;
}

static const char *viewer_of(const http_request *request)
{
    return request->caller->scopes & SCOPE_ADMIN ? "" : request->caller->user;
}

void events_of_job(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    selection s = {.whole_job = true, .progress = true, .viewer = viewer_of(request)};
    if (!job_lookup_find_own(c, request, &job, r)) return;
    s.id = job.id;
    if (!read_position(request, 0, &s))
        refuse_position(r);
    else if (wants_stream(request) && is_over(c, &job, s.after))
        reply_set_empty(r, 204); /* the stream is complete; after 204 a browser does not reconnect */
    else
        answer(c, request, &s, r);
    queue_job_clear(&job);
}

/* Refuses a missing job and, without `all`, jobs of other users. An empty stream would not show the
 * reason. */
static bool may_select(const http_context *c, const http_request *request, const selection *s, bool all,
                       reply *r)
{
    queue_job job = {0};
    if (!all && s->owner && !access_is_owner(request->caller, s->owner)) {
        reply_set_problem(
            r, "forbidden", NULL,
            "only %s and administrators may read the events of these jobs: omit owner, or add all=1",
            s->owner);
        return false;
    }
    if (!s->id) return true;
    http_request named = *request;
    named.parameter[0] = s->id;
    bool found = (all ? job_lookup_find : job_lookup_find_own)(c, &named, &job, r);
    queue_job_clear(&job);
    return found;
}

void events_of_all(const http_context *c, const http_request *request, reply *r)
{
    selection s = {.id = parameter_text(request, "job", NULL),
                   .owner = parameter_text(request, "owner", NULL),
                   .label = parameter_text(request, "label", NULL),
                   .viewer = viewer_of(request),
                   .progress = parameter_integer(request, "progress", 0) != 0,
                   .row = ROWS_FROM_NOW};
    bool all = parameter_integer(request, "all", 0) != 0;
    if (!read_position(request, QUEUE_EVENTS_FROM_NOW, &s)) {
        refuse_position(r);
    } else if (may_select(c, request, &s, all, r)) {
        if (!all && !(request->caller->scopes & SCOPE_ADMIN)) s.owner = request->caller->user;
        answer(c, request, &s, r);
    }
}
