// SPDX-License-Identifier: Apache-2.0
#include "service/queue/pieces.h"

#include <stdlib.h>

#include "service/queue/frame_needs.h"
#include "service/queue/relation.h"

/* Tasks of a range by state. */
typedef struct tally {
    int queued, held, delayed, failed, cancelled, timed_out;
} tally;

static bool count_range(database *d, const job_state *j, int first, int end, tally *t, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(
        d, e,
        "SELECT count(*) FILTER (WHERE state = 'queued'), count(*) FILTER (WHERE state = 'queued' AND waits > 0),"
        " count(*) FILTER (WHERE state = 'delayed'), count(*) FILTER (WHERE state = 'failed'),"
        " count(*) FILTER (WHERE state = 'cancelled'), count(*) FILTER (WHERE state = 'timed_out')"
        " FROM task WHERE job = ?1 AND number >= ?2 AND number < ?3",
        integer(j->seq), integer(first), integer(end));
    while (database_next(d, s, &ok, e))
        *t = (tally){sqlite3_column_int(s, 0), sqlite3_column_int(s, 1), sqlite3_column_int(s, 2),
                     sqlite3_column_int(s, 3), sqlite3_column_int(s, 4), sqlite3_column_int(s, 5)};
    return ok;
}

/* Queues the tasks of a range that did not succeed. Each is held for `needs` frames until it is examined. */
static bool queue_range(database *d, job_state *j, int first, int end, int needs, int64_t now, error *e)
{
    tally t = {0};
    if (!count_range(d, j, first, end, &t, e)) return false;
    int queued = t.failed + t.cancelled + t.timed_out;
    j->failed -= t.failed;
    j->cancelled_tasks -= t.cancelled;
    j->timed_out -= t.timed_out;
    j->ready += queued;
    j->held += needs ? queued : 0;
    return RUN(d, e,
               "UPDATE task SET state = 'queued', spent = 0, interrupted = 0, ran_ms = 0, storage_faults = 0,"
               " error_code = NULL, error_message = NULL, finished_ms = NULL, waits = ?4"
               " WHERE job = ?1 AND number >= ?2 AND number < ?3 AND state IN ('failed', 'cancelled', 'timed_out')",
               integer(j->seq), integer(first), integer(end), integer(needs)) &&
           (!needs || frame_needs_examine(d, j, first, end, now, e));
}

/* Ends the waiting tasks of a range. */
static bool end_range(database *d, job_state *j, int first, int end, int64_t now, error *e)
{
    tally t = {0};
    const bool fails = j->target == QUEUE_FAILED;
    if (!count_range(d, j, first, end, &t, e)) return false;
    j->ready -= t.queued;
    j->delayed -= t.delayed;
    j->held -= t.held;
    *job_state_counter(j, (queue_state)j->target) += t.queued + t.delayed;
    return RUN(d, e,
               "UPDATE task SET state = ?4, error_code = ?5, error_message ="
               " iif(?5 IS NULL, NULL, (SELECT target_message FROM job WHERE seq = ?1)), finished_ms = ?6,"
               " not_before_ms = NULL, waits = 0"
               " WHERE job = ?1 AND number >= ?2 AND number < ?3 AND state IN ('queued', 'delayed')",
               integer(j->seq), integer(first), integer(end), text(queue_state_name((queue_state)j->target)),
               text(fails ? error_code_name(ERROR_DEPENDENCY_FAILED) : NULL), integer(now));
}

/* Records that a pass over all tasks is complete. A task that was put back meanwhile needs another pass. */
static void end_pass(job_state *j, int *from, int passed)
{
    const bool again = from == &j->target_from && j->target != QUEUE_QUEUED && j->ready + j->delayed;
    *from = again ? 0 : passed;
    if (again) return;
    if (from == &j->target_from) j->target = JOB_STATE_NO_TARGET;
    if (j->array && j->failed + j->cancelled_tasks) job_state_note_ended(j, JOB_STATE_ALL_ENDED);
}

bool pieces_next(database *d, job_state *j, int64_t now, error *e)
{
    int needs = 0;
    const bool moves = j->target != JOB_STATE_NO_TARGET;
    int *from = moves ? &j->target_from : &j->examine_from;
    if (!frame_needs_count(d, j, &needs, e)) return false;
    const int first = *from, end = first + DATABASE_PIECE_ROWS / (1 + needs);
    if (!(!moves                      ? frame_needs_examine(d, j, first, end, now, e)
          : j->target == QUEUE_QUEUED ? queue_range(d, j, first, end, needs, now, e)
                                      : end_range(d, j, first, end, now, e)))
        return false;
    *from = end;
    if (end >= j->tasks) end_pass(j, from, moves ? 0 : -1);
    return true;
}

/* Does all pieces if the job has few tasks. */
static bool do_few(database *d, job_state *j, int64_t now, error *e)
{
    bool ok = true;
    while (ok && j->tasks <= DATABASE_FEW_ROWS && (j->target != JOB_STATE_NO_TARGET || j->examine_from >= 0))
        ok = pieces_next(d, j, now, e);
    return ok;
}

bool pieces_begin(database *d, job_state *j, queue_state target, const char *message, int64_t now, error *e)
{
    j->target = (int)target;
    j->target_from = 0;
    return (!message ||
            RUN(d, e, "UPDATE job SET target_message = ?2 WHERE seq = ?1", integer(j->seq), text(message))) &&
           do_few(d, j, now, e);
}

bool pieces_fail_dependent(database *d, job_state *j, int64_t need, int64_t now, error *e)
{
    char *message = NULL;
    bool ok = relation_describe_failure(d, j->seq, need, &message, e) &&
              pieces_begin(d, j, QUEUE_FAILED, message, now, e);
    free(message);
    return ok;
}

bool pieces_examine(database *d, job_state *j, int64_t now, error *e)
{
    j->examine_from = 0;
    return do_few(d, j, now, e);
}
