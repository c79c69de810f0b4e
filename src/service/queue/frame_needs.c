// SPDX-License-Identifier: Apache-2.0
#include "service/queue/frame_needs.h"

#include "service/database/schema.h"
#include "service/queue/relation.h"

/* The tasks for which a row of `task` waits. */
#define NEEDS                                                                          \
    "dependency AS link CROSS JOIN job AS need ON need.seq = link.needs"               \
    " CROSS JOIN task AS other ON other.job = link.needs AND other.frame = task.frame" \
    " WHERE link.job = task.job AND link.by_frame = 1"

/* Whether such a task has succeeded with an accepted outcome (SCHEMA_ACCEPTED); whether it has ended
 * otherwise. */
#define DONE                                                                                  \
    "(other.state = 'succeeded' AND need.accept & CASE other.outcome WHEN 'converged' THEN 2" \
    " WHEN 'unresolved' THEN 4 ELSE 8 END)"
#define LOST "(other.state IN (" SCHEMA_FINAL_STATES ") AND NOT " DONE ")"

#define COUNT "(SELECT count(*) FROM " NEEDS " AND NOT " DONE ")"
#define HELD "state = 'queued' AND waits > 0"
#define CANNOT_START "EXISTS (SELECT 1 FROM " NEEDS " AND " LOST ")"

#define FAILURE RELATION_FAILURE("(SELECT owner FROM job WHERE seq = ?1)", "need", "other")
#define FAIL                                                                                             \
    "UPDATE task SET state = 'failed', waits = 0, finished_ms = ?3, error_code = ?4, error_message ="    \
    " (SELECT 'this frame starts after the same frame of the job ' || need.id || ', which ' || " FAILURE \
    "  FROM " NEEDS " AND " LOST " LIMIT 1)"                                                             \
    " WHERE job = ?1 AND " HELD " AND " CANNOT_START

/* Runs a statement that returns one integer for each task that it changes. Counts the tasks, and those
 * with a 0. */
static bool count_rows(database *d, sqlite3_stmt *s, int *rows, int *zeros, error *e)
{
    bool ok = false;
    while (database_next(d, s, &ok, e)) {
        ++*rows;
        *zeros += sqlite3_column_int(s, 0) == 0;
    }
    return ok;
}

static bool has_needs(database *d, const job_state *j, bool *has, error *e)
{
    int64_t found = 0;
    bool ok = database_read_integer(
        d, ASK(d, e, "SELECT 1 FROM dependency WHERE job = ?1 AND by_frame = 1 LIMIT 1", integer(j->seq)),
        &found, e);
    *has = found != 0;
    return ok;
}

/* Fails the held tasks that cannot start any more: the task of one frame, or all. */
static bool fail_held(database *d, job_state *j, int frame, int64_t now, error *e)
{
    int failed = 0, unused = 0;
    const char *code = error_code_name(ERROR_DEPENDENCY_FAILED);
    const bool all = frame == JOB_STATE_ALL_ENDED;
    sqlite3_stmt *s =
        all ? ASK(d, e, FAIL " RETURNING number", integer(j->seq), integer(0), integer(now), text(code))
            : ASK(d, e, FAIL " AND frame = ?2 RETURNING number", integer(j->seq), integer(frame),
                  integer(now), text(code));
    if (!count_rows(d, s, &failed, &unused, e)) return false;
    j->held -= failed;
    j->ready -= failed;
    j->failed += failed;
    if (failed) job_state_note_ended(j, frame);
    return all || !failed ||
           job_state_add_event(d, j->seq, QUEUE_EVENT_TASK, QUEUE_FAILED, QUEUE_NO_OUTCOME, frame, 0, now, e);
}

bool frame_needs_begin(database *d, job_state *j, int64_t now, error *e)
{
    bool has = false;
    int rows = 0, free_rows = 0;
    j->held = 0;
    if (!has_needs(d, j, &has, e) || !has) return !has;
    sqlite3_stmt *s =
        ASK(d, e, "UPDATE task SET waits = " COUNT " WHERE job = ?1 AND state = 'queued' RETURNING waits",
            integer(j->seq));
    if (!count_rows(d, s, &rows, &free_rows, e)) return false;
    j->held = rows - free_rows;
    return fail_held(d, j, JOB_STATE_ALL_ENDED, now, e);
}

bool frame_needs_update(database *d, job_state *j, int frame, int64_t now, error *e)
{
    int rows = 0, released = 0;
    if (!fail_held(d, j, frame, now, e)) return false; /* first, so that failed tasks are not counted */
    sqlite3_stmt *s =
        frame == JOB_STATE_ALL_ENDED
            ? ASK(d, e, "UPDATE task SET waits = " COUNT " WHERE job = ?1 AND " HELD " RETURNING waits",
                  integer(j->seq))
            : ASK(d, e,
                  "UPDATE task SET waits = " COUNT " WHERE job = ?1 AND frame = ?2 AND " HELD
                  " RETURNING waits",
                  integer(j->seq), integer(frame));
    if (!count_rows(d, s, &rows, &released, e)) return false;
    j->held -= released;
    return true;
}

bool frame_needs_are_hopeless(database *d, const job_state *j, bool *hopeless, error *e)
{
    bool has = false;
    int64_t runnable = 0;
    *hopeless = false;
    if (!has_needs(d, j, &has, e)) return false;
    if (!has) return true;
    bool ok = database_read_integer(
        d,
        ASK(d, e,
            "SELECT 1 FROM task WHERE job = ?1 AND state != 'succeeded' AND NOT " CANNOT_START " LIMIT 1",
            integer(j->seq)),
        &runnable, e);
    *hopeless = !runnable;
    return ok;
}

#define FIRST(condition) "(SELECT number FROM task WHERE job = ?1 AND " condition " ORDER BY number LIMIT 1)"

bool frame_needs_hold_first(database *d, const job_state *j, bool *held, error *e)
{
    int64_t found = 0;
    bool ok = database_read_integer(
        d,
        ASK(d, e,
            "SELECT " FIRST(HELD) " < coalesce(" FIRST("state = 'queued' AND waits = 0") ", 1000000000)",
            integer(j->seq)),
        &found, e);
    *held = found != 0;
    return ok;
}
