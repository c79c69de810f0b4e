// SPDX-License-Identifier: Apache-2.0
/* Directories to remove, and lookups of directories found in the state directory. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "service/queue/job_state.h"
#include "service/queue/members.h"

static int frame_at(sqlite3_stmt *s, int column)
{
    return sqlite3_column_type(s, column) == SQLITE_NULL ? QUEUE_NO_FRAME : sqlite3_column_int(s, column);
}

bool queue_list_removals(queue *q, const char *id, int64_t after, int limit, queue_removal **removals,
                         size_t *count, error *e)
{
    static const char all[] =
        "SELECT number, id, frame, attempts FROM removal WHERE number > ?1 ORDER BY number LIMIT ?2";
    static const char of_job[] =
        "SELECT number, id, frame, attempts FROM removal WHERE number > ?1 AND id = ?3"
        " ORDER BY number LIMIT ?2";
    queue_removal *read = NULL;
    size_t used = 0, capacity = 0;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = id ? ASK(d, e, of_job, integer(after), integer(limit), text(id))
                         : ASK(d, e, all, integer(after), integer(limit));
    while (database_next(d, s, &ok, e)) {
        if (used == capacity) read = mem_resize(read, (capacity = capacity * 2 + 16) * sizeof *read);
        queue_removal *r = &read[used++];
        *r = (queue_removal){.number = sqlite3_column_int64(s, 0),
                             .frame = frame_at(s, 2),
                             .attempts = sqlite3_column_int(s, 3)};
        snprintf(r->id, sizeof r->id, "%s", (const char *)sqlite3_column_text(s, 1));
    }
    database_end_read(d);
    if (!ok) {
        free(read);
        return false;
    }
    *removals = read;
    *count = used;
    return true;
}

typedef struct ending_removals {
    change change;
    const queue_removal *removals;
    size_t count;
} ending_removals;

static bool end_removals(database *d, change *asked)
{
    const ending_removals *x = (ending_removals *)asked;
    bool ok = true;
    for (size_t i = 0; ok && i < x->count; i++)
        ok = RUN(d, &asked->fault, "DELETE FROM removal WHERE number = ?1", integer(x->removals[i].number));
    return ok;
}

bool queue_end_removals(queue *q, const queue_removal *removals, size_t count, error *e)
{
    ending_removals x = {.change = {.apply = end_removals, .user = ""}, .removals = removals, .count = count};
    return database_change(q->database, &x.change, e);
}

/* ---- lookups of directories */

static bool find_task(database *d, queue_directory *x, error *e)
{
    bool ok = false;
    sqlite3_stmt *s =
        x->frame == QUEUE_NO_FRAME
            ? ASK(d, e,
                  "SELECT task.state, attempt FROM job JOIN task ON task.job = job.seq"
                  " WHERE id = ?1 AND number = 0 AND frame IS NULL",
                  text(x->id))
            : ASK(d, e,
                  "SELECT task.state, attempt FROM job JOIN task ON task.job = job.seq WHERE id = ?1 AND frame = ?2",
                  text(x->id), integer(x->frame));
    while (database_next(d, s, &ok, e)) {
        const char *state = (const char *)sqlite3_column_text(s, 0);
        x->known = true;
        x->state = QUEUE_QUEUED; /* also if delayed */
        queue_state_from_name(state, &x->state);
        x->last_attempt = sqlite3_column_int(s, 1);
    }
    return ok;
}

static bool find_removal(database *d, queue_directory *x, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e, "SELECT 1 FROM removal WHERE id = ?1 AND frame IS ?2 AND attempts >= ?3",
                          text(x->id), integer_if(x->frame, x->frame != QUEUE_NO_FRAME), integer(x->attempt));
    while (database_next(d, s, &ok, e)) x->to_be_removed = true;
    return ok;
}

bool queue_find_directories(queue *q, queue_directory *directories, size_t count, error *e)
{
    bool ok = true;
    database *d = database_begin_read(q->database);
    for (size_t i = 0; ok && i < count; i++) {
        queue_directory *x = &directories[i];
        x->known = x->to_be_removed = false;
        ok = find_task(d, x, e) && (x->known || find_removal(d, x, e));
    }
    database_end_read(d);
    return ok;
}

bool queue_list_results(queue *q, queue_directory **results, size_t *count, error *e)
{
    static const char sql[] =
        "SELECT id, frame FROM job JOIN task ON task.job = job.seq WHERE task.state = 'succeeded'";
    size_t capacity = 0;
    bool ok = false;
    *results = NULL;
    *count = 0;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        if (*count == capacity)
            *results = mem_resize(*results, (capacity = capacity * 2 + 16) * sizeof **results);
        queue_directory *x = &(*results)[(*count)++];
        *x = (queue_directory){.frame = frame_at(s, 1)};
        snprintf(x->id, sizeof x->id, "%s", (const char *)sqlite3_column_text(s, 0));
    }
    database_end_read(d);
    return ok;
}
