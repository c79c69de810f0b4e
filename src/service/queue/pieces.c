// SPDX-License-Identifier: Apache-2.0
#include "service/queue/pieces.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/frame_needs.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"
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

/* Does one piece. */
static bool do_piece(database *d, job_state *j, int64_t now, error *e)
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
        ok = do_piece(d, j, now, e);
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

/* ---- transactions */

typedef struct working {
    change change;
    int64_t seq; /* of the job; 0: the next row of the table ended */
    bool any;    /* there are pieces */
} working;

static bool work(database *d, change *asked)
{
    working *w = (working *)asked;
    error *e = &asked->fault;
    const int64_t now = clock_wall_ms();
    job_state j = {0};
    if (!w->seq) return job_save_dependents(d, 0, now, e);
    if (!job_state_load_seq(d, w->seq, &j, e)) return false;
    if (j.seq != w->seq || (j.target == JOB_STATE_NO_TARGET && j.examine_from < 0)) return true;
    const job_state before = j;
    return do_piece(d, &j, now, e) && job_save(d, &before, &j, now, e);
}

/* Reads the owner of the job, whether it has pieces, and its state. */
static bool look(queue *q, const char *id, working *w, char owner[QUEUE_OWNER_SIZE], queue_state *now,
                 error *e)
{
    bool ok = false;
    w->any = false;
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s =
        ASK(d, e, "SELECT seq, owner, " SCHEMA_HAS_PIECES ", state FROM job WHERE id = ?1 AND " SCHEMA_WHOLE,
            text(id));
    while (database_next(d, s, &ok, e)) {
        w->seq = sqlite3_column_int64(s, 0);
        snprintf(owner, QUEUE_OWNER_SIZE, "%s", (const char *)sqlite3_column_text(s, 1));
        w->any = sqlite3_column_int(s, 2);
        queue_state_from_name((const char *)sqlite3_column_text(s, 3), now);
    }
    database_end_read(d);
    return ok;
}

bool queue_complete(queue *q, const char *id, queue_state *now, error *e)
{
    char owner[QUEUE_OWNER_SIZE] = "";
    working w = {.change = {.apply = work, .user = owner}};
    bool ok = look(q, id, &w, owner, now, e);
    while (ok && w.any) ok = database_change(q->database, &w.change, e) && look(q, id, &w, owner, now, e);
    return ok;
}

/* Finds a job with pieces, of the next owner in alphabetical order, and whether the table ended has rows. */
static bool find_next(queue *q, int64_t *seq, bool *ended, error *e)
{
    int64_t rows = 0;
    database *d = database_begin_read(q->database);
    bool ok = database_read_integer(d, database_ask(d, "SELECT EXISTS (SELECT 1 FROM ended)", NULL, 0, e),
                                    &rows, e);
    *ended = rows != 0;
    for (int round = 0; ok && !*seq && round < 2; round++) {
        sqlite3_stmt *s = ASK(d, e,
                              "SELECT seq, owner FROM job INDEXED BY job_pieces WHERE " SCHEMA_HAS_PIECES
                              " AND (?2 OR owner > ?1) ORDER BY owner, seq LIMIT 1",
                              text(q->owner_of_piece), integer(round));
        while (database_next(d, s, &ok, e)) {
            *seq = sqlite3_column_int64(s, 0);
            snprintf(q->owner_of_piece, QUEUE_OWNER_SIZE, "%s", (const char *)sqlite3_column_text(s, 1));
        }
    }
    database_end_read(d);
    return ok;
}

bool queue_do_piece(queue *q, bool *more, error *e)
{
    working ended = {.change = {.apply = work, .user = ""}},
            piece = {.change = {.apply = work, .user = q->owner_of_piece}};
    if (!find_next(q, &piece.seq, &ended.any, e) ||
        (ended.any && !database_change(q->database, &ended.change, e)) ||
        (piece.seq && !database_change(q->database, &piece.change, e)))
        return false;
    *more = ended.any || piece.seq;
    return true;
}
