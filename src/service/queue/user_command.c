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

typedef struct telling {
    change change;
    const char *id;
    queue_command command;
    bool found, changed;
    queue_state now;
} telling;

static bool cancel(database *d, job_state *j, int64_t now, bool *changed, error *e)
{
    if (queue_state_is_final(j->state) || j->cancelled) return true;
    *changed = true;
    j->cancelled = true;
    return job_state_end_waiting(d, j, QUEUE_CANCELLED, NULL, NULL, now, e);
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
    bool lost = false, hopeless = false;
    int pending = 0;
    if (!queue_state_is_final(j->state) || j->state == QUEUE_SUCCEEDED) return true;
    if (!job_state_count_needs(d, j, &pending, &lost, e)) return false;
    if (lost) return true;
    if (!frame_needs_are_hopeless(d, j, &hopeless, e)) return false;
    if (hopeless) return true;
    *changed = true;
    if (!RUN(
            d, e,
            "UPDATE task SET state = 'queued', spent = 0, interrupted = 0, ran_ms = 0, storage_faults = 0, error_code = NULL,"
            " error_message = NULL, finished_ms = NULL WHERE job = ?1 AND state != 'succeeded'",
            integer(j->seq)))
        return false;
    j->ready = j->failed + j->cancelled_tasks + j->timed_out;
    j->failed = j->cancelled_tasks = j->timed_out = 0;
    j->pending = pending;
    j->cancelled = j->paused = false;
    return frame_needs_begin(d, j, now, e);
}

/* Marks the results to copy again: those that could not be copied, otherwise all. */
static bool deliver(database *d, const job_state *j, bool *changed, error *e)
{
    if (!queue_state_is_final(j->state) || !j->succeeded) return true;
    if (!RUN(d, e,
             "UPDATE job SET copy_state = 'pending', copy_code = NULL, copy_message = NULL WHERE seq = ?1"
             " AND copy_state IN ('delivered', 'failed')",
             integer(j->seq)))
        return false;
    *changed = database_changes(d) > 0;
    return !*changed || RUN(d, e,
                            "UPDATE task SET copy_code = 'pending' WHERE job = ?1 AND state = 'succeeded' AND"
                            " NOT EXISTS (SELECT 1 FROM task WHERE job = ?1 AND copy_code IS NOT NULL)",
                            integer(j->seq));
}

static bool tell(database *d, change *asked)
{
    telling *t = (telling *)asked;
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
        ok = retry(d, &j, now, &t->changed, e);
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

bool queue_apply_command(queue *q, const char *id, queue_command command, bool *found, bool *changed,
                         queue_state *now, error *e)
{
    telling t = {.change.apply = tell, .id = id, .command = command};
    if (!database_change(q->database, &t.change, e)) return false;
    *found = t.found;
    *changed = t.changed;
    if (t.found) *now = t.now;
    return true;
}

/* ---- dependents of a job that is retried */

typedef struct retrying {
    change change;
    const char *id, *owner;
    queue_retried retried;
} retrying;

/* Jobs that ended as dependency_failed and depend, directly or indirectly, on the job. In order of arrival, a
 * job follows those that it depends on. */
static bool list_dependents(database *d, const char *id, int64_t **seqs, size_t *count, error *e)
{
    bool ok = false;
    size_t capacity = 0;
    sqlite3_stmt *s = ASK(d, e,
                          "WITH RECURSIVE behind (seq) AS (SELECT seq FROM job WHERE id = ?1 UNION"
                          " SELECT job.seq FROM behind JOIN dependency ON needs = behind.seq JOIN job ON"
                          " job.seq = dependency.job WHERE error_code = ?2)"
                          " SELECT behind.seq FROM behind JOIN job ON job.seq = behind.seq WHERE id != ?1"
                          " ORDER BY behind.seq",
                          text(id), text(error_code_name(ERROR_DEPENDENCY_FAILED)));
    while (database_next(d, s, &ok, e)) {
        if (*count == capacity) *seqs = mem_resize(*seqs, (capacity = capacity * 2 + 16) * sizeof **seqs);
        (*seqs)[(*count)++] = sqlite3_column_int64(s, 0);
    }
    return ok;
}

static bool read_owner(database *d, int64_t seq, char id[ULID_SIZE], const char *owner, bool *is_own,
                       error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e, "SELECT id, owner FROM job WHERE seq = ?1", integer(seq));
    while (database_next(d, s, &ok, e)) {
        snprintf(id, ULID_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
        *is_own = !owner || strcmp(owner, (const char *)sqlite3_column_text(s, 1)) == 0;
    }
    return ok;
}

static bool retry_dependent(database *d, retrying *x, int64_t seq, int64_t now, error *e)
{
    char id[ULID_SIZE];
    bool own = false, changed = false;
    job_state j;
    if (!read_owner(d, seq, id, x->owner, &own, e)) return false;
    if (!own) return true; /* that it depends on the job is a part of its spec */
    if (!job_state_load_seq(d, seq, &j, e)) return false;
    job_state before = j;
    if (!retry(d, &j, now, &changed, e)) return false;
    if (changed) {
        x->retried.count++;
        return job_save(d, &before, &j, now, e);
    }
    queue_retried *r = &x->retried;
    r->others = mem_resize(r->others, (r->other_count + 1) * sizeof *r->others);
    memcpy(r->others[r->other_count++], id, ULID_SIZE);
    return true;
}

static bool retry_dependents(database *d, change *asked)
{
    retrying *x = (retrying *)asked;
    error *e = &asked->fault;
    int64_t now = clock_wall_ms(), *seqs = NULL;
    size_t count = 0;
    bool ok = list_dependents(d, x->id, &seqs, &count, e);
    for (size_t i = 0; ok && i < count; i++) ok = retry_dependent(d, x, seqs[i], now, e);
    free(seqs);
    return ok;
}

bool queue_retry_dependents(queue *q, const char *id, const char *owner, queue_retried *retried, error *e)
{
    retrying x = {.change.apply = retry_dependents, .id = id, .owner = owner};
    bool ok = database_change(q->database, &x.change, e);
    if (ok)
        *retried = x.retried;
    else
        free(x.retried.others);
    return ok;
}

typedef struct editing {
    change change;
    const char *id;
    int64_t revision;
    const queue_edit *edit;
    queue_edited edited;
} editing;

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
    editing *x = (editing *)asked;
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
    editing x = {.change.apply = change_job, .id = id, .revision = revision, .edit = edit};
    if (!database_change(q->database, &x.change, e)) return false;
    *edited = x.edited;
    return true;
}

typedef struct deleting {
    change change;
    const char *id;
    bool found, deleted;
} deleting;

/* The events of a job are deleted with it. Clients that follow events receive the number up to which events
 * are missing. */
static bool note_removed_events(database *d, const job_state *j, error *e)
{
    return RUN(d, e,
               "UPDATE removed_events SET up_to = max(up_to,"
               " coalesce((SELECT max(seq) FROM event WHERE job = ?1), 0)) WHERE one = 1",
               integer(j->seq));
}

static bool delete_job(database *d, change *asked)
{
    deleting *x = (deleting *)asked;
    error *e = &asked->fault;
    job_state j;
    if (!job_state_load(d, x->id, &j, &x->found, e)) return false;
    if (!x->found || !queue_state_is_final(j.state)) return true;
    x->deleted = true;
    return note_removed_events(d, &j, e) && job_state_note_removals(d, &j, e) &&
           RUN(d, e, "DELETE FROM job WHERE seq = ?1", integer(j.seq));
}

bool queue_delete(queue *q, const char *id, bool *found, bool *deleted, error *e)
{
    deleting x = {.change.apply = delete_job, .id = id};
    if (!database_change(q->database, &x.change, e)) return false;
    *found = x.found;
    *deleted = x.deleted;
    return true;
}
