// SPDX-License-Identifier: Apache-2.0
#include "service/queue/job_save.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/chunks.h"
#include "service/queue/frame_needs.h"
#include "service/queue/job_row.h"
#include "service/queue/owner.h"
#include "service/queue/pieces.h"

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
        " target = ?25, target_from = ?26, examine_from = ?27,"
        " delivered_ms = iif(?18 IS NOT NULL AND delivered >= ?11, coalesce(delivered_ms, ?18), NULL)"
        " WHERE seq = ?1",
        integer(j->seq), integer(j->revision), text(queue_state_name(j->state)),
        text(queue_outcome_name(outcome)), integer(j->paused), integer(j->cancelled), integer(j->pending),
        integer(j->ready), integer(j->delayed), integer(j->running), integer(j->succeeded),
        integer(j->failed), integer(j->cancelled_tasks), integer(j->timed_out), integer(j->not_converged),
        integer(j->attempts), integer_if(j->started_ms, j->started_ms > 0), integer_if(j->finished_ms, final),
        integer_if(expires, final && j->retention_s > 0), integer(j->retention_s), integer(j->unresolved),
        integer(j->held), integer(j->first_held), integer(chunks_busy),
        text(j->target == JOB_STATE_NO_TARGET ? NULL : queue_state_name((queue_state)j->target)),
        integer(j->target_from), integer_if(j->examine_from, j->examine_from >= 0));
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

static int count_unfinished(const job_state *j)
{
    return j->ready + j->delayed + j->running;
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
    return ok &&
           owner_update(d, j->seq, (int)was_final - (int)is_final,
                        count_unfinished(j) - count_unfinished(before), j->running - before->running, e);
}

/* Updates one dependent job after the end of another; the dependent may end because of it. Needs are counted
 * again, since a retried job ends more than once. */
static bool update_dependent(database *d, job_state *j, int64_t now, error *e)
{
    job_state before = *j;
    int64_t lost = 0;
    if (!job_state_count_needs(d, j, &j->pending, &lost, e)) return false;
    const bool may_fail = j->target == JOB_STATE_NO_TARGET || j->target == QUEUE_QUEUED;
    if (lost && may_fail && !pieces_fail_dependent(d, j, lost, now, e)) return false;
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

/* A job that has ended, or has ended frames. */
typedef struct ended_job {
    int64_t seq, after; /* jobs with a seq above `after` that wait for it must still be updated */
    bool whole;         /* the job has ended */
    int frame;          /* job_state.ended */
} ended_job;

/* It is a list, to avoid recursion. */
typedef struct ended_jobs {
    ended_job *item;
    size_t count, capacity;
    int rows; /* that this change may still change */
} ended_jobs;

static void add_ended(ended_jobs *list, const ended_job *ended)
{
    if (!ended->whole && ended->frame == JOB_STATE_NONE_ENDED) return;
    if (list->count == list->capacity)
        list->item = mem_resize(list->item, (list->capacity = list->capacity * 2 + 4) * sizeof *list->item);
    list->item[list->count++] = *ended;
}

static void add_changed(ended_jobs *list, const job_state *before, const job_state *j)
{
    bool whole = queue_state_is_final(j->state) && !queue_state_is_final(before->state);
    add_ended(list, &(ended_job){.seq = j->seq, .whole = whole, .frame = j->ended});
    list->rows -= j->tasks <= DATABASE_FEW_ROWS ? j->tasks : 1;
}

static bool update_jobs(database *d, ended_jobs *list, ended_job *ended, int64_t now, error *e)
{
    bool ok = true;
    while (ok && ended->whole && list->rows > 0) {
        job_state j;
        ok = next_dependent(d, ended->seq, ended->after, &j, &ended->whole, e);
        if (!ok || !ended->whole) break;
        ended->after = j.seq;
        job_state before = j;
        ok = update_dependent(d, &j, now, e);
        add_changed(list, &before, &j);
    }
    if (ok && !ended->whole) ended->after = 0; /* now the jobs that wait for frames */
    return ok;
}

static bool update_frames(database *d, ended_jobs *list, ended_job *ended, int64_t now, error *e)
{
    bool found = true, ok = true;
    while (ok && found && list->rows > 0) {
        job_state j;
        ok = next_frame_dependent(d, ended->seq, ended->after, &j, &found, e);
        if (!ok || !found) break;
        ended->after = j.seq;
        job_state before = j;
        ok = ended->frame == JOB_STATE_ALL_ENDED ? pieces_examine(d, &j, now, e)
                                                 : frame_needs_update(d, &j, ended->frame, now, e);
        if (ok && (j.held != before.held || j.ended != before.ended || j.examine_from != before.examine_from))
            ok = save_one(d, &before, &j, now, e);
        add_changed(list, &before, &j);
    }
    if (ok && !found) ended->frame = JOB_STATE_NONE_ENDED;
    return ok;
}

/* Stores that jobs which wait for this one must still be updated. */
static bool store_ended(database *d, const ended_job *ended, error *e)
{
    return RUN(d, e,
               "INSERT INTO ended (job, is_whole, frame, after) SELECT ?1, ?2, ?3, ?4"
               " WHERE EXISTS (SELECT 1 FROM dependency WHERE needs = ?1)",
               integer(ended->seq), integer(ended->whole), integer(ended->frame), integer(ended->after));
}

/* Updates the jobs that wait for the jobs in the list, and in turn the jobs that wait for jobs that end
 * thereby. What exceeds the rows of this change is stored. Frees the list. */
static bool update_dependents(database *d, ended_jobs *list, int64_t now, error *e)
{
    bool ok = true;
    list->rows = DATABASE_FEW_ROWS;
    for (size_t i = 0; ok && i < list->count; i++) {
        ended_job ended = list->item[i];
        if (ended.whole) ok = update_jobs(d, list, &ended, now, e);
        if (ok && !ended.whole && ended.frame != JOB_STATE_NONE_ENDED)
            ok = update_frames(d, list, &ended, now, e);
        if (ok && (ended.whole || ended.frame != JOB_STATE_NONE_ENDED)) ok = store_ended(d, &ended, e);
    }
    free(list->item);
    return ok;
}

bool job_save(database *d, const job_state *before, job_state *j, int64_t now, error *e)
{
    ended_jobs list = {0};
    if (!save_one(d, before, j, now, e)) return false;
    add_changed(&list, before, j);
    return update_dependents(d, &list, now, e);
}

bool job_save_dependents(database *d, int64_t job, int64_t now, error *e)
{
    ended_jobs list = {0};
    int64_t number = 0;
    bool ok = false;
#define NEXT_ENDED(condition) \
    "SELECT number, job, is_whole, frame, after FROM ended " condition " ORDER BY number LIMIT 1"
    sqlite3_stmt *s = job ? ASK(d, e, NEXT_ENDED("WHERE job = ?1"), integer(job))
                          : database_ask(d, NEXT_ENDED(""), NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        number = sqlite3_column_int64(s, 0);
        add_ended(&list, &(ended_job){.seq = sqlite3_column_int64(s, 1),
                                      .whole = sqlite3_column_int(s, 2),
                                      .frame = sqlite3_column_int(s, 3),
                                      .after = sqlite3_column_int64(s, 4)});
    }
    ok = ok && RUN(d, e, "DELETE FROM ended WHERE number = ?1", integer(number));
    if (ok) return update_dependents(d, &list, now, e);
    free(list.item);
    return false;
}
