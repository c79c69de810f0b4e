// SPDX-License-Identifier: Apache-2.0
/* User commands on jobs: cancel, pause, resume, retry, edit, delete. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "service/queue/frame_needs.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"
#include "service/queue/pieces.h"
#include "service/database/schema.h"

typedef struct command_change {
    change change;
    const char *id, *owner; /* owner NULL: any */
    queue_command command;
    bool hopeless; /* a retry could not start any task */
    bool found, changed;
    queue_state now;
} command_change;

static bool cancel(database *d, job_state *j, int64_t now, bool *changed, error *e)
{
    if (queue_state_is_final(j->state) || j->cancelled) return true;
    *changed = true;
    j->cancelled = true;
    return pieces_begin(d, j, QUEUE_CANCELLED, NULL, now, e);
}

static bool set_paused(job_state *j, bool paused, bool *changed)
{
    if (queue_state_is_final(j->state) || j->cancelled || j->paused == paused) return true;
    *changed = true;
    j->paused = paused;
    return true;
}

static bool retry(database *d, job_state *j, int64_t now, bool *changed, error *e)
{
    int64_t lost = 0;
    int pending = 0;
    if (!queue_state_is_final(j->state) || j->state == QUEUE_SUCCEEDED) return true;
    if (!job_state_count_needs(d, j, &pending, &lost, e)) return false;
    if (lost) return true;
    *changed = true;
    j->pending = pending;
    j->cancelled = j->paused = false;
    return pieces_begin(d, j, QUEUE_QUEUED, NULL, now, e);
}

/* Marks the results to copy again: those that could not be copied (`failed`), otherwise all. */
static bool deliver(database *d, const job_state *j, bool *changed, error *e)
{
    if (!queue_state_is_final(j->state) || !j->succeeded) return true;
    if (!RUN(
            d, e,
            "UPDATE job SET copy_state = 'pending', copy_from = iif(copy_state = 'delivered', 0, NULL),"
            " copy_code = NULL, copy_message = NULL WHERE seq = ?1 AND copy_state IN ('delivered', 'failed')",
            integer(j->seq)))
        return false;
    *changed = database_changes(d) > 0;
    return true;
}

static bool apply_command(database *d, change *asked)
{
    command_change *t = (command_change *)asked;
    error *e = &asked->fault;
    int64_t now = clock_wall_ms();
    job_state j;
    bool ok = true;
    if (!job_state_load(d, t->id, &j, &t->found, e)) return false;
    if (!t->found) return true;
    job_state before = j;
    switch (t->command) {
    case QUEUE_CANCEL:
        ok = cancel(d, &j, now, &t->changed, e);
        break;
    case QUEUE_PAUSE:
    case QUEUE_RESUME:
        ok = set_paused(&j, t->command == QUEUE_PAUSE, &t->changed);
        break;
    case QUEUE_RETRY:
        ok = t->hopeless || retry(d, &j, now, &t->changed, e);
        break;
    case QUEUE_DELIVER:
        ok = deliver(d, &j, &t->changed, e);
        break;
    }
    if (ok && t->changed) ok = job_save(d, &before, &j, now, e);
    if (ok && t->changed && j.state == before.state)
        ok = job_state_add_event(d, j.seq, QUEUE_EVENT_EDITED, j.state, QUEUE_NO_OUTCOME, QUEUE_NO_FRAME, 0,
                                 now, e);
    t->now = j.state;
    return ok;
}

/* Whether the job waits for frames, none of which lets a task start. It is read before the change, since it may
 * read all tasks. */
static bool is_hopeless(queue *q, const char *id, bool *hopeless, error *e)
{
    bool found = false;
    job_state j;
    database *d = database_begin_read(q->database);
    bool ok =
        job_state_load(d, id, &j, &found, e) && (!found || frame_needs_are_hopeless(d, &j, hopeless, e));
    database_end_read(d);
    return ok;
}

bool queue_begin_command(queue *q, const char *id, queue_command command, bool *found, bool *changed,
                         queue_state *now, error *e)
{
    command_change t = {.change.apply = apply_command, .id = id, .command = command};
    if (command == QUEUE_RETRY && !is_hopeless(q, id, &t.hopeless, e)) return false;
    if (!database_change(q->database, &t.change, e)) return false;
    *found = t.found;
    *changed = t.changed;
    if (t.found) *now = t.now;
    return true;
}

bool queue_apply_command(queue *q, const char *id, queue_command command, bool *found, bool *changed,
                         queue_state *now, error *e)
{
    return queue_begin_command(q, id, command, found, changed, now, e) &&
           (!*changed || queue_complete(q, id, now, e));
}

/* ---- dependents of a job that is retried */

typedef struct dependent {
    char id[ULID_SIZE];
    bool own;
} dependent;

/* Jobs that ended as dependency_failed and depend, directly or indirectly, on the job. In order of arrival, a
 * job follows those that it depends on. `owner` NULL: all are own. */
static bool list_dependents(queue *q, const char *id, const char *owner, dependent **list, size_t *count,
                            error *e)
{
    bool ok = false;
    size_t capacity = 0;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(
        d, e,
        "WITH RECURSIVE behind (seq) AS (SELECT seq FROM job WHERE id = ?1 UNION"
        " SELECT job.seq FROM behind JOIN dependency ON needs = behind.seq JOIN job ON"
        " job.seq = dependency.job WHERE error_code = ?2)"
        " SELECT job.id, ?3 IS NULL OR job.owner = ?3 FROM behind JOIN job ON job.seq = behind.seq WHERE id != ?1"
        " ORDER BY behind.seq",
        text(id), text(error_code_name(ERROR_DEPENDENCY_FAILED)), text(owner));
    while (database_next(d, s, &ok, e)) {
        if (*count == capacity) *list = mem_resize(*list, (capacity = capacity * 2 + 16) * sizeof **list);
        dependent *next = &(*list)[(*count)++];
        snprintf(next->id, ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
        next->own = sqlite3_column_int(s, 1);
    }
    database_end_read(d);
    return ok;
}

bool queue_retry_dependents(queue *q, const char *id, const char *owner, queue_retried *retried, error *e)
{
    queue_retried r = {0};
    dependent *list = NULL;
    size_t count = 0;
    bool ok = list_dependents(q, id, owner, &list, &count, e);
    for (size_t i = 0; ok && i < count; i++) {
        bool found = false, changed = false;
        queue_state now;
        if (!list[i].own) continue; /* that it depends on the job is a part of its spec */
        ok = queue_apply_command(q, list[i].id, QUEUE_RETRY, &found, &changed, &now, e);
        r.count += changed;
        if (!ok || changed || !found) continue;
        r.others = mem_resize(r.others, (r.other_count + 1) * sizeof *r.others);
        memcpy(r.others[r.other_count++], list[i].id, ULID_SIZE);
    }
    free(list);
    if (ok)
        *retried = r;
    else
        free(r.others);
    return ok;
}

typedef struct edit_change {
    change change;
    const char *id;
    int64_t revision;
    const queue_edit *edit;
    queue_edited edited;
} edit_change;

static bool store_edit(database *d, const queue_edit *edit, const job_state *j, error *e)
{
    bool ok = true;
    if (edit->priority)
        ok = RUN(d, e, "UPDATE job SET priority = ?2 WHERE seq = ?1", integer(j->seq),
                 integer(*edit->priority));
    if (edit->accept)
        ok = ok &&
             RUN(d, e, "UPDATE job SET accept = ?2 WHERE seq = ?1", integer(j->seq), integer(*edit->accept));
    if (edit->max_running)
        ok = ok && RUN(d, e, "UPDATE job SET max_running = ?2 WHERE seq = ?1", integer(j->seq),
                       integer(*edit->max_running));
    if (edit->labels)
        ok = ok &&
             RUN(d, e, "UPDATE job SET labels = ?2 WHERE seq = ?1", integer(j->seq), text(edit->labels)) &&
             RUN(d, e, "DELETE FROM label WHERE job = ?1", integer(j->seq)) &&
             RUN(d, e, "INSERT INTO label (label, job) SELECT DISTINCT value, ?1 FROM json_each(?2)",
                 integer(j->seq), text(edit->labels));
    return ok;
}

static bool change_job(database *d, change *asked)
{
    edit_change *x = (edit_change *)asked;
    error *e = &asked->fault;
    int64_t now = clock_wall_ms();
    bool found = false;
    job_state j;
    if (!job_state_load(d, x->id, &j, &found, e)) return false;
    x->edited = !found                                          ? QUEUE_NOT_THERE
                : x->revision >= 0 && x->revision != j.revision ? QUEUE_STALE
                                                                : QUEUE_EDITED;
    if (x->edited != QUEUE_EDITED) return true;
    job_state before = j;
    if (x->edit->retention_s) j.retention_s = *x->edit->retention_s;
    return store_edit(d, x->edit, &j, e) && job_save(d, &before, &j, now, e) &&
           job_state_add_event(d, j.seq, QUEUE_EVENT_EDITED, j.state, QUEUE_NO_OUTCOME, QUEUE_NO_FRAME, 0,
                               now, e);
}

bool queue_change(queue *q, const char *id, int64_t revision, const queue_edit *edit, queue_edited *edited,
                  error *e)
{
    edit_change x = {.change.apply = change_job, .id = id, .revision = revision, .edit = edit};
    if (!database_change(q->database, &x.change, e)) return false;
    *edited = x.edited;
    return true;
}

/* ---- deletion */

typedef struct delete_change {
    change change;
    const char *id;
    int64_t seq; /* 0: not known yet */
    bool found, deleted;
    bool waits;                  /* for jobs that wait for this one, which are not updated yet */
    char with_pieces[ULID_SIZE]; /* if so: the job to complete first; "": none */
    bool whole;                  /* all rows are deleted */
} delete_change;

/* The events of a job are deleted with it. Clients that follow events receive the number up to which events
 * are missing. */
static bool note_removed_events(database *d, const job_state *j, error *e)
{
    return RUN(d, e,
               "UPDATE removed_events SET up_to = max(up_to,"
               " coalesce((SELECT max(seq) FROM event WHERE job = ?1), 0)) WHERE one = 1",
               integer(j->seq));
}

/* No caller sees the job any more, and no bound counts it. */
static bool hide(database *d, int64_t seq, error *e)
{
    return RUN(
        d, e,
        "UPDATE job SET state = 'cancelled', tasks = 0, ready = 0, delayed = 0, running = 0, succeeded = 0,"
        " failed = 0, cancelled = 0, timed_out = 0, held = 0, result_bytes = 0, finished_ms = NULL,"
        " expires_ms = NULL, delivered_ms = NULL, copy_state = NULL, key = NULL, target = NULL,"
        " examine_from = NULL WHERE seq = ?1",
        integer(seq));
}

static const char *const parts[] = {
    "DELETE FROM outbox WHERE number IN (SELECT number FROM outbox WHERE job = ?1 LIMIT ?2)",
    "DELETE FROM event WHERE seq IN (SELECT seq FROM event WHERE job = ?1 LIMIT ?2)",
    "DELETE FROM input WHERE job = ?1 AND name IN (SELECT name FROM input WHERE job = ?1 LIMIT ?2)",
    "DELETE FROM dependency WHERE job = ?1 AND needs IN (SELECT needs FROM dependency WHERE job = ?1 LIMIT ?2)",
    "DELETE FROM dependency WHERE needs = ?1 AND job IN (SELECT job FROM dependency WHERE needs = ?1 LIMIT ?2)",
    "DELETE FROM attempt WHERE job = ?1 AND task <= (SELECT max(task) FROM"
    " (SELECT task FROM attempt WHERE job = ?1 ORDER BY task LIMIT ?2))",
    /* these two have the same rows */
    "INSERT INTO removal (id, frame, attempts) SELECT id, frame, attempt FROM task"
    " JOIN job ON job.seq = task.job WHERE task.job = ?1 ORDER BY number LIMIT ?2",
    "DELETE FROM task WHERE job = ?1 AND number <= (SELECT max(number) FROM"
    " (SELECT number FROM task WHERE job = ?1 ORDER BY number LIMIT ?2))",
};
enum { PARTS = sizeof parts / sizeof *parts, REMOVALS = PARTS - 2 };

/* Deletes at most `rows` rows of a hidden job, then the job. *whole: nothing of it is left. */
static bool delete_rows(database *d, int64_t seq, int rows, bool *whole, error *e)
{
    for (size_t i = 0; i < PARTS; i++) {
        const value values[] = {integer(seq), integer(rows)};
        if (!database_run(d, parts[i], values, 2, e)) return false;
        if (i != REMOVALS) rows -= database_changes(d);
        if (rows <= 0) return true;
    }
    *whole = true;
    return RUN(d, e, "DELETE FROM job WHERE seq = ?1", integer(seq));
}

/* Finds a job with pieces that depend on the tasks of the job: itself, or one whose frames wait for its frames. */
static bool find_pieces(database *d, int64_t seq, char id[ULID_SIZE], error *e)
{
    bool ok = false;
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT id FROM job INDEXED BY job_pieces WHERE " SCHEMA_HAS_PIECES " AND " SCHEMA_WHOLE
            " AND (seq = ?1 OR EXISTS (SELECT 1 FROM dependency WHERE dependency.job = seq"
            " AND needs = ?1 AND by_frame = 1)) LIMIT 1",
            integer(seq));
    while (database_next(d, s, &ok, e))
        snprintf(id, ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
    return ok;
}

static bool delete_job(database *d, change *asked)
{
    delete_change *x = (delete_change *)asked;
    error *e = &asked->fault;
    int64_t ended = 0;
    job_state j;
    if (x->seq) return delete_rows(d, x->seq, DATABASE_PIECE_ROWS, &x->whole, e);
    if (!job_state_load(d, x->id, &j, &x->found, e)) return false;
    if (!x->found || !queue_state_is_final(j.state)) return true;
    if (!database_read_integer(
            d, ASK(d, e, "SELECT EXISTS (SELECT 1 FROM ended WHERE job = ?1)", integer(j.seq)), &ended, e))
        return false;
    x->waits = ended;
    if (ended) return job_save_dependents(d, j.seq, clock_wall_ms(), e);
    if (!find_pieces(d, j.seq, x->with_pieces, e)) return false;
    x->waits = *x->with_pieces;
    if (x->waits) return true;
    x->deleted = true;
    x->seq = j.seq;
    return note_removed_events(d, &j, e) && hide(d, j.seq, e) &&
           delete_rows(d, j.seq, DATABASE_FEW_ROWS, &x->whole, e);
}

/* Deletes all rows of a hidden job. */
static bool delete_hidden(queue *q, delete_change *x, error *e)
{
    char *owner = NULL;
    bool ok = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = ASK(d, e, "SELECT owner FROM job WHERE seq = ?1", integer(x->seq));
    while (database_next(d, s, &ok, e)) owner = database_text(s, 0);
    database_end_read(d);
    x->change.user = owner;
    while (ok && !x->whole) ok = database_change(q->database, &x->change, e);
    free(owner);
    return ok;
}

bool queue_delete(queue *q, const char *id, bool *found, bool *deleted, error *e)
{
    delete_change x = {.change.apply = delete_job, .id = id};
    queue_state unused;
    do {
        x.waits = false;
        *x.with_pieces = 0;
        if (!database_change(q->database, &x.change, e) ||
            (*x.with_pieces && !queue_complete(q, x.with_pieces, &unused, e)))
            return false;
    } while (x.waits);
    *found = x.found;
    *deleted = x.deleted;
    return !x.deleted || x.whole || delete_hidden(q, &x, e);
}

bool queue_delete_hidden(queue *q, bool *more, error *e)
{
    static const char sql[] =
        "SELECT seq FROM job INDEXED BY job_hidden WHERE tasks = 0 AND state = 'cancelled' ORDER BY seq LIMIT 1";
    delete_change x = {.change.apply = delete_job};
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(d, database_ask(d, sql, NULL, 0, e), &x.seq, e);
    database_end_read(d);
    *more = x.seq != 0;
    return ok && (!x.seq || delete_hidden(q, &x, e));
}
