// SPDX-License-Identifier: Apache-2.0
#include "service/queue/frame_needs.h"

#include "service/database/schema.h"
#include "service/queue/relation.h"

/* The tasks for which a row of `task` waits. */
#define NEEDS                                                                          \
    "dependency AS link CROSS JOIN job AS need ON need.seq = link.needs"               \
    " CROSS JOIN task AS other ON other.job = link.needs AND other.frame = task.frame" \
    " WHERE link.job = task.job AND link.by_frame = 1 AND need.tasks > 0"

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

bool frame_needs_count(database *d, const job_state *j, int *count, error *e)
{
    int64_t found = 0;
    bool ok = database_read_integer(
        d, ASK(d, e, "SELECT count(*) FROM dependency WHERE job = ?1 AND by_frame = 1", integer(j->seq)),
        &found, e);
    *count = (int)found;
    return ok;
}

/* Runs a statement that fails held tasks. */
static bool fail_held(database *d, job_state *j, sqlite3_stmt *s, int *failed, error *e)
{
    int unused = 0;
    if (!count_rows(d, s, failed, &unused, e)) return false;
    j->held -= *failed;
    j->ready -= *failed;
    j->failed += *failed;
    return true;
}

/* Runs a statement that counts anew what held tasks wait for. */
static bool count_again(database *d, job_state *j, sqlite3_stmt *s, error *e)
{
    int rows = 0, released = 0;
    if (!count_rows(d, s, &rows, &released, e)) return false;
    j->held -= released;
    return true;
}

#define OF_FRAME " AND frame = ?2"
#define OF_RANGE " AND number >= ?2 AND number < ?5"
#define COUNT_AGAIN "UPDATE task SET waits = " COUNT " WHERE job = ?1 AND " HELD

bool frame_needs_update(database *d, job_state *j, int frame, int64_t now, error *e)
{
    int failed = 0;
    const char *code = error_code_name(ERROR_DEPENDENCY_FAILED);
    /* first, so that failed tasks are not counted */
    if (!fail_held(d, j,
                   ASK(d, e, FAIL OF_FRAME " RETURNING number", integer(j->seq), integer(frame), integer(now),
                       text(code)),
                   &failed, e))
        return false;
    if (failed) {
        job_state_note_ended(j, frame);
        return job_state_add_event(d, j->seq, QUEUE_EVENT_TASK, QUEUE_FAILED, QUEUE_NO_OUTCOME, frame, 0, now,
                                   e);
    }
    return count_again(
        d, j, ASK(d, e, COUNT_AGAIN OF_FRAME " RETURNING waits", integer(j->seq), integer(frame)), e);
}

bool frame_needs_examine(database *d, job_state *j, int first, int end, int64_t now, error *e)
{
    int failed = 0;
    const char *code = error_code_name(ERROR_DEPENDENCY_FAILED);
    return fail_held(d, j,
                     ASK(d, e, FAIL OF_RANGE " RETURNING number", integer(j->seq), integer(first),
                         integer(now), text(code), integer(end)),
                     &failed, e) &&
           count_again(d, j,
                       ASK(d, e, COUNT_AGAIN " AND number >= ?2 AND number < ?3 RETURNING waits",
                           integer(j->seq), integer(first), integer(end)),
                       e);
}

bool frame_needs_are_hopeless(database *d, const job_state *j, bool *hopeless, error *e)
{
    int needs = 0;
    int64_t runnable = 0;
    *hopeless = false;
    if (!frame_needs_count(d, j, &needs, e)) return false;
    if (!needs) return true;
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
