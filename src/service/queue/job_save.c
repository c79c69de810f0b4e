// SPDX-License-Identifier: Apache-2.0
#include "service/queue/job_save.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/chunks.h"
#include "service/queue/frame_needs.h"
#include "service/queue/job_row.h"
#include "service/queue/owner.h"

/* The job gets the error of its first failed task. For an array the message also has the number of failed
 * tasks. */
static bool store_error(database *d, const job_state *j, error *e)
{
    bool ok = false, read = false;
    char *code = NULL, *message = NULL;
    int ended = j->state == QUEUE_FAILED      ? j->failed
                : j->state == QUEUE_TIMED_OUT ? j->timed_out
                                              : j->cancelled_tasks;
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT error_code, error_message, frame, file FROM task WHERE job = ?1 AND state = ?2"
            " ORDER BY number LIMIT 1",
            integer(j->seq), text(queue_state_name(j->state)));
    while (database_next(d, s, &ok, e)) {
        read = true;
        code = database_text(s, 0);
        message = database_text(s, 1);
        if (j->array && message) {
            const char *file = (const char *)sqlite3_column_text(s, 3);
            char *whole = mem_printf("%d of %d frames %s; frame %d%s%s%s: %s", ended, j->tasks,
                                     queue_state_name(j->state), sqlite3_column_int(s, 2), file ? " (" : "",
                                     file ? file : "", file ? ")" : "", message);
            free(message);
            message = whole;
        }
    }
    if (ok && read)
        ok = RUN(d, e, "UPDATE job SET error_code = ?2, error_message = ?3 WHERE seq = ?1", integer(j->seq),
                 text(code), text(message));
    free(code);
    free(message);
    return ok;
}

static bool store(database *d, const job_state *j, queue_outcome outcome, bool chunks_busy, error *e)
{
    bool final = queue_state_is_final(j->state);
    int64_t expires = j->finished_ms + j->retention_s * 1000;
    return RUN(
        d, e,
        "UPDATE job SET revision = ?2, state = ?3, outcome = ?4, is_paused = ?5, is_cancelled = ?6,"
        " pending = ?7, ready = ?8, delayed = ?9, running = ?10, succeeded = ?11, failed = ?12,"
        " cancelled = ?13, timed_out = ?14, not_converged = ?15, attempts = ?16, started_ms = ?17,"
        " finished_ms = ?18, expires_ms = ?19, retention_s = ?20, unresolved = ?21, held = ?22, first_held = ?23, chunks_busy = ?24, error_code = NULL, error_message = NULL,"
        " delivered_ms = iif(?18 IS NOT NULL AND delivered >= ?11, coalesce(delivered_ms, ?18), NULL)"
        " WHERE seq = ?1",
        integer(j->seq), integer(j->revision), text(queue_state_name(j->state)),
        text(queue_outcome_name(outcome)), integer(j->paused), integer(j->cancelled), integer(j->pending),
        integer(j->ready), integer(j->delayed), integer(j->running), integer(j->succeeded),
        integer(j->failed), integer(j->cancelled_tasks), integer(j->timed_out), integer(j->not_converged),
        integer(j->attempts), integer_if(j->started_ms, j->started_ms > 0), integer_if(j->finished_ms, final),
        integer_if(expires, final && j->retention_s > 0), integer(j->retention_s), integer(j->unresolved),
        integer(j->held), integer(j->first_held), integer(chunks_busy));
}

/* Adds the notification of the job's end to the outbox, if the job has a webhook. */
static bool put_into_outbox(database *d, int64_t seq, int64_t now, error *e)
{
    char event[ULID_SIZE];
    ulid_make(now, event);
    return RUN(d, e,
               "INSERT INTO outbox (job, webhook, state, outcome, due_ms, event, ended_ms)"
               " SELECT seq, webhook, state, outcome, ?2, ?3, ?2 FROM job"
               " WHERE seq = ?1 AND webhook IS NOT NULL",
               integer(seq), integer(now), text(event));
}

/* Stores one job; its dependents are not updated. */
static bool save_one(database *d, const job_state *before, job_state *j, int64_t now, error *e)
{
    bool chunks_busy = false;
    j->first_held = false;
    if (!chunks_are_busy(d, j, &chunks_busy, e)) return false;
    if (j->ordered && j->held && !frame_needs_hold_first(d, j, &j->first_held, e)) return false;
    j->state = job_state_derive(j);
    j->revision = before->revision + 1;
    bool was_final = queue_state_is_final(before->state), is_final = queue_state_is_final(j->state);
    queue_outcome outcome = j->state != QUEUE_SUCCEEDED ? QUEUE_NO_OUTCOME
                            : j->not_converged          ? QUEUE_NOT_CONVERGED
                            : j->unresolved             ? QUEUE_UNRESOLVED
                                                        : QUEUE_CONVERGED;
    if (is_final && !was_final) j->finished_ms = now;
    if (j->running && !j->started_ms) j->started_ms = now;
    bool ok = store(d, j, outcome, chunks_busy, e);
    if (is_final && j->state != QUEUE_SUCCEEDED) ok = ok && store_error(d, j, e);
    if (is_final && !was_final) ok = ok && put_into_outbox(d, j->seq, now, e);
    if (j->state != before->state)
        ok = ok &&
             job_state_add_event(d, j->seq, QUEUE_EVENT_STATE, j->state, outcome, QUEUE_NO_FRAME, 0, now, e);
    return ok && owner_update(d, j->seq, (int)was_final - (int)is_final, j->running - before->running, e);
}

/* Updates one dependent job after the end of `need`; the dependent may end because of it. Needs are counted
 * again, since a retried job ends more than once. */
static bool update_dependent(database *d, int64_t need, job_state *j, int64_t now, error *e)
{
    job_state before = *j;
    bool lost = false;
    if (!job_state_count_needs(d, j, &j->pending, &lost, e)) return false;
    if (lost && !job_state_fail_dependent(d, j, need, now, e)) return false;
    return save_one(d, &before, j, now, e);
}

/* The next job with a seq above ?2 that depends on ?1 and meets the condition. */
#define NEXT_DEPENDENT(condition)                                                                         \
    "SELECT " JOB_STATE_COLUMNS " FROM job WHERE seq = (SELECT job FROM dependency JOIN job ON seq = job" \
    " WHERE needs = ?1 AND job > ?2 AND " condition " ORDER BY job LIMIT 1)"

/* Loads the next job with a seq above `after` that depends on the ended one. */
static bool next_dependent(database *d, int64_t need, int64_t after, job_state *j, bool *found, error *e)
{
    return job_state_load_row(
        d, ASK(d, e, NEXT_DEPENDENT("by_frame = 0 AND state = 'blocked'"), integer(need), integer(after)), j,
        found, e);
}

/* Loads the next unfinished job with a seq above `after` whose frames wait for frames of this one. */
static bool next_frame_dependent(database *d, int64_t need, int64_t after, job_state *j, bool *found,
                                 error *e)
{
    return job_state_load_row(
        d, ASK(d, e, NEXT_DEPENDENT("by_frame = 1 AND held > 0"), integer(need), integer(after)), j, found,
        e);
}

/* Jobs that have ended or have ended frames. The jobs that wait for them must still be updated. It is a list,
 * to avoid recursion. */
typedef struct ended_jobs {
    struct ended_job {
        int64_t seq;
        bool whole; /* the job has ended */
        int frame;  /* job_state.ended */
    } * item;
    size_t count, capacity;
} ended_jobs;

static void add_ended(ended_jobs *list, const job_state *before, const job_state *j)
{
    bool whole = queue_state_is_final(j->state) && !queue_state_is_final(before->state);
    if (!whole && j->ended == JOB_STATE_NONE_ENDED) return;
    if (list->count == list->capacity)
        list->item = mem_resize(list->item, (list->capacity = list->capacity * 2 + 4) * sizeof *list->item);
    list->item[list->count++] = (struct ended_job){j->seq, whole, j->ended};
}

static bool update_jobs(database *d, ended_jobs *list, int64_t seq, int64_t now, error *e)
{
    bool found = true, ok = true;
    for (int64_t after = 0; ok && found;) {
        job_state j;
        ok = next_dependent(d, seq, after, &j, &found, e);
        if (!ok || !found) break;
        after = j.seq;
        job_state before = j;
        ok = update_dependent(d, seq, &j, now, e);
        add_ended(list, &before, &j);
    }
    return ok;
}

static bool update_frames(database *d, ended_jobs *list, int64_t seq, int frame, int64_t now, error *e)
{
    bool found = true, ok = true;
    for (int64_t after = 0; ok && found;) {
        job_state j;
        ok = next_frame_dependent(d, seq, after, &j, &found, e);
        if (!ok || !found) break;
        after = j.seq;
        job_state before = j;
        ok = frame_needs_update(d, &j, frame, now, e);
        if (ok && (j.held != before.held || j.ended != before.ended)) ok = save_one(d, &before, &j, now, e);
        add_ended(list, &before, &j);
    }
    return ok;
}

/* Updates the jobs that wait for the jobs in the list, and in turn the jobs that wait for jobs that end
 * thereby. */
static bool update_dependents(database *d, ended_jobs *list, int64_t now, error *e)
{
    bool ok = true;
    for (size_t i = 0; ok && i < list->count; i++) {
        struct ended_job ended = list->item[i];
        if (ended.whole) ok = update_jobs(d, list, ended.seq, now, e);
        if (ok && ended.frame != JOB_STATE_NONE_ENDED)
            ok = update_frames(d, list, ended.seq, ended.frame, now, e);
    }
    return ok;
}

bool job_save(database *d, const job_state *before, job_state *j, int64_t now, error *e)
{
    ended_jobs list = {0};
    bool ok = save_one(d, before, j, now, e);
    if (ok) add_ended(&list, before, j);
    ok = ok && update_dependents(d, &list, now, e);
    free(list.item);
    return ok;
}
