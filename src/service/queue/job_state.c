// SPDX-License-Identifier: Apache-2.0
#include "service/queue/job_state.h"

#include "service/database/schema.h"
#include "service/queue/job_row.h"
#include "service/queue/owner.h"

static void read_state(sqlite3_stmt *s, job_state *j)
{
    *j = (job_state){
        .seq = sqlite3_column_int64(s, 0),
        .revision = sqlite3_column_int64(s, 1),
        .array = sqlite3_column_int(s, 3),
        .paused = sqlite3_column_int(s, 4),
        .cancelled = sqlite3_column_int(s, 5),
        .pending = sqlite3_column_int(s, 6),
        .tasks = sqlite3_column_int(s, 7),
        .ready = sqlite3_column_int(s, 8),
        .delayed = sqlite3_column_int(s, 9),
        .running = sqlite3_column_int(s, 10),
        .succeeded = sqlite3_column_int(s, 11),
        .failed = sqlite3_column_int(s, 12),
        .cancelled_tasks = sqlite3_column_int(s, 13),
        .timed_out = sqlite3_column_int(s, 14),
        .not_converged = sqlite3_column_int(s, 15),
        .attempts = sqlite3_column_int(s, 16),
        .started_ms = sqlite3_column_int64(s, 17),
        .finished_ms = sqlite3_column_int64(s, 18),
        .retention_s = sqlite3_column_int64(s, 19),
        .ordered = sqlite3_column_int(s, 20),
        .unresolved = sqlite3_column_int(s, 21),
        .held = sqlite3_column_int(s, 22),
        .chunk = sqlite3_column_int(s, 23),
        .ended = JOB_STATE_NONE_ENDED,
        .target = JOB_STATE_NO_TARGET,
        .target_from = sqlite3_column_int(s, 25),
        .examine_from = sqlite3_column_type(s, 26) == SQLITE_NULL ? -1 : sqlite3_column_int(s, 26),
    };
    queue_state_from_name((const char *)sqlite3_column_text(s, 2), &j->state);
    queue_state target = QUEUE_QUEUED;
    const char *name = (const char *)sqlite3_column_text(s, 24);
    if (name && queue_state_from_name(name, &target)) j->target = (int)target;
}

bool job_state_load_row(database *d, sqlite3_stmt *s, job_state *j, bool *found, error *e)
{
    bool ok = false;
    *found = database_next(d, s, &ok, e);
    if (!*found) return ok;
    read_state(s, j);
    database_end(s);
    return true;
}

bool job_state_load(database *d, const char *id, job_state *j, bool *found, error *e)
{
    return job_state_load_row(
        d, ASK(d, e, "SELECT " JOB_STATE_COLUMNS " FROM job WHERE id = ?1 AND " SCHEMA_WHOLE, text(id)), j,
        found, e);
}

bool job_state_load_seq(database *d, int64_t seq, job_state *j, error *e)
{
    bool found = false;
    return job_state_load_row(
        d, ASK(d, e, "SELECT " JOB_STATE_COLUMNS " FROM job WHERE seq = ?1", integer(seq)), j, &found, e);
}

int *job_state_counter(job_state *j, queue_state final)
{
    return final == QUEUE_SUCCEEDED   ? &j->succeeded
           : final == QUEUE_FAILED    ? &j->failed
           : final == QUEUE_TIMED_OUT ? &j->timed_out
                                      : &j->cancelled_tasks;
}

bool job_state_add_event(database *d, int64_t seq, queue_event_type type, queue_state state,
                         queue_outcome outcome, int frame, int attempt, int64_t now, error *e)
{
    return RUN(d, e,
               "INSERT INTO event (at_ms, job, type, state, outcome, frame, attempt)"
               " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
               integer(now), integer(seq), text(queue_event_type_name(type)), text(queue_state_name(state)),
               text(queue_outcome_name(outcome)), integer_if(frame, frame != QUEUE_NO_FRAME),
               integer_if(attempt, attempt > 0));
}

queue_state job_state_derive(const job_state *j)
{
    int waiting = j->ready + j->delayed;
    /* a retry has not reached these yet */
    if (j->target == QUEUE_QUEUED) waiting += j->failed + j->timed_out + j->cancelled_tasks;
    if (!waiting && !j->running) {
        if (j->cancelled && j->cancelled_tasks) return QUEUE_CANCELLED;
        return j->failed            ? QUEUE_FAILED
               : j->timed_out       ? QUEUE_TIMED_OUT
               : j->cancelled_tasks ? QUEUE_CANCELLED
                                    : QUEUE_SUCCEEDED;
    }
    if (j->cancelled) return QUEUE_CANCELLING;
    if (j->running) return QUEUE_RUNNING;
    if (j->pending || (waiting == j->tasks && (j->held == waiting || j->first_held))) return QUEUE_BLOCKED;
    if (j->paused) return QUEUE_PAUSED;
    return waiting < j->tasks ? QUEUE_RUNNING : QUEUE_QUEUED;
}

void job_state_note_ended(job_state *j, int frame)
{
    if (frame == QUEUE_NO_FRAME) return;
    j->ended = j->ended == JOB_STATE_NONE_ENDED || j->ended == frame ? frame : JOB_STATE_ALL_ENDED;
}

void job_state_count_outcome(job_state *j, queue_outcome outcome)
{
    j->unresolved += outcome == QUEUE_UNRESOLVED;
    j->not_converged += outcome == QUEUE_NOT_CONVERGED;
}

bool job_state_begin(database *d, const job_state *j, int64_t now, error *e)
{
    return job_state_add_event(d, j->seq, QUEUE_EVENT_STATE, j->state, QUEUE_NO_OUTCOME, QUEUE_NO_FRAME, 0,
                               now, e) &&
           owner_update(d, j->seq, 1, j->tasks, 0, e);
}

bool job_state_count_needs(database *d, const job_state *j, int *pending, int64_t *lost, error *e)
{
    bool ok = false;
    *pending = 0;
    *lost = 0;
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT state, any_end, needs FROM dependency JOIN job ON seq = needs"
            " WHERE dependency.job = ?1 AND by_frame = 0 AND " SCHEMA_WHOLE " AND NOT " SCHEMA_ACCEPTED,
            integer(j->seq));
    while (database_next(d, s, &ok, e)) {
        queue_state state = QUEUE_QUEUED;
        bool any_end = sqlite3_column_int(s, 1);
        queue_state_from_name((const char *)sqlite3_column_text(s, 0), &state);
        *pending += !(any_end && queue_state_is_final(state));
        if (!any_end && queue_state_is_final(state)) *lost = sqlite3_column_int64(s, 2);
    }
    return ok;
}
