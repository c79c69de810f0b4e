// SPDX-License-Identifier: Apache-2.0
/* Events of jobs, for clients that follow them. */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/members.h"
#include "service/queue/job_row.h"

/* Maximum number of events read for one page: a few milliseconds. */
#define EXAMINED_MOST 4096

static const char *const names[QUEUE_EVENT_TYPE_COUNT] = {
    [QUEUE_EVENT_STATE] = "state", [QUEUE_EVENT_TASK] = "task",     [QUEUE_EVENT_STARTED] = "started",
    [QUEUE_EVENT_ENDED] = "ended", [QUEUE_EVENT_EDITED] = "edited",
};

const char *queue_event_type_name(queue_event_type type)
{
    return names[type];
}

static queue_event_type type_from_name(const char *name)
{
    int type = 0;
    while (type + 1 < QUEUE_EVENT_TYPE_COUNT && strcmp(names[type], name) != 0) type++;
    return (queue_event_type)type;
}

/* CROSS JOIN keeps the order by event number. The last column is true if the event passes the filter. Events
 * that do not pass are read, too, since they determine the position of the page. */
#define EVENTS                                                                                       \
    "SELECT event.seq, at_ms, id, owner, type, event.state, event.outcome, frame, attempt,"          \
    " " SCHEMA_WHOLE " AND (?2 IS NULL OR owner = ?2) AND"                                           \
    " (?3 IS NULL OR EXISTS (SELECT 1 FROM label WHERE label.label = ?3 AND label.job = event.job))" \
    " FROM event CROSS JOIN job ON job.seq = event.job WHERE event.seq > ?1"
#define OLDEST " ORDER BY event.seq"
enum { PASSES = 9 };

static const char of_all[] = EVENTS OLDEST;
static const char of_job[] = EVENTS " AND event.job = (SELECT seq FROM job WHERE id = ?4)" OLDEST;

static void read_event(sqlite3_stmt *s, queue_event *event)
{
    *event = (queue_event){
        .seq = sqlite3_column_int64(s, 0),
        .at_ms = sqlite3_column_int64(s, 1),
        .type = type_from_name((const char *)sqlite3_column_text(s, 4)),
        .outcome = job_row_outcome(s, 6),
        .frame = sqlite3_column_type(s, 7) == SQLITE_NULL ? QUEUE_NO_FRAME : sqlite3_column_int(s, 7),
        .attempt = sqlite3_column_int(s, 8),
    };
    snprintf(event->id, sizeof event->id, "%s", (const char *)sqlite3_column_text(s, 2));
    snprintf(event->owner, sizeof event->owner, "%s", (const char *)sqlite3_column_text(s, 3));
    queue_state_from_name((const char *)sqlite3_column_text(s, 5), &event->state);
}

/* The newest event may have been deleted: its number comes from SQLite's own table. */
static bool read_bounds(database *d, queue_event_page *page, error *e)
{
    static const char sql[] =
        "SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'event'), 0), up_to FROM removed_events";
    bool ok = false;
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        page->newest = sqlite3_column_int64(s, 0);
        page->removed_up_to = sqlite3_column_int64(s, 1);
    }
    return ok;
}

static bool read_page(database *d, const queue_event_filter *filter, queue_event_page *page, error *e)
{
    bool ok = true;
    size_t capacity = 0, limit = (size_t)filter->limit;
    int examined = 0, most = filter->id ? INT_MAX : EXAMINED_MOST;
    sqlite3_stmt *s = ASK(d, e, filter->id ? of_job : of_all, integer(page->position), text(filter->owner),
                          text(filter->label), text(filter->id));
    while (!page->more && database_next(d, s, &ok, e)) {
        page->position = sqlite3_column_int64(s, 0);
        if (sqlite3_column_int(s, PASSES)) {
            if (page->count == capacity)
                page->events =
                    mem_resize(page->events, (capacity = capacity * 2 + 16) * sizeof *page->events);
            read_event(s, &page->events[page->count++]);
        }
        page->more = page->count == limit || ++examined == most;
        if (page->more) database_end(s);
    }
    return page->more || ok;
}

bool queue_list_events(queue *q, const queue_event_filter *filter, queue_event_page *page, error *e)
{
    queue_event_page read = {0};
    database *d = database_begin_read(q->database);
    bool ok = read_bounds(d, &read, e);
    bool from_now = filter->after_seq < 0 || filter->after_seq > read.newest;
    read.position = from_now ? read.newest : filter->after_seq;
    ok = ok && (from_now || read_page(d, filter, &read, e));
    database_end_read(d);
    if (!ok) {
        free(read.events);
        return false;
    }
    if (filter->id) read.removed_up_to = 0;
    *page = read;
    return true;
}
