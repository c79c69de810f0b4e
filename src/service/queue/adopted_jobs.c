// SPDX-License-Identifier: Apache-2.0
/* Adopts results in the state directory that are missing in the queue. */
#include <stdio.h>
#include <string.h>

#include "base/core/clock.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"

/* ---- results of waiting tasks */

typedef struct outcome_change {
    change change;
    const char *id;
    int frame;
    queue_outcome outcome;
    bool accepted;
} outcome_change;

/* Finds the task if it waits: its number, and whether it is delayed or held. */
static bool find_waiting(database *d, const outcome_change *f, const job_state *j, int *number, bool *delayed,
                         bool *held, bool *found, error *e)
{
    bool ok = false;
    sqlite3_stmt *s =
        f->frame == QUEUE_NO_FRAME
            ? ASK(d, e,
                  "SELECT number, state, waits FROM task WHERE job = ?1 AND number = 0 AND frame IS NULL"
                  " AND state IN ('queued', 'delayed')",
                  integer(j->seq))
            : ASK(d, e,
                  "SELECT number, state, waits FROM task WHERE job = ?1 AND frame = ?2"
                  " AND state IN ('queued', 'delayed')",
                  integer(j->seq), integer(f->frame));
    while (database_next(d, s, &ok, e)) {
        *found = true;
        *number = sqlite3_column_int(s, 0);
        *delayed = strcmp((const char *)sqlite3_column_text(s, 1), "delayed") == 0;
        *held = sqlite3_column_int(s, 2) > 0;
    }
    return ok;
}

static bool end_found(database *d, change *asked)
{
    outcome_change *f = (outcome_change *)asked;
    error *e = &asked->fault;
    int64_t now = clock_wall_ms();
    int number = 0;
    bool found = false, delayed = false, held = false;
    job_state j;
    if (!job_state_load(d, f->id, &j, &found, e) || !found) return asked->fault.code == ERROR_NONE;
    found = false;
    if (!find_waiting(d, f, &j, &number, &delayed, &held, &found, e)) return false;
    if (!found) return true;
    job_state before = j;
    --*(delayed ? &j.delayed : &j.ready);
    j.held -= held;
    j.succeeded++;
    job_state_count_outcome(&j, f->outcome);
    job_state_note_ended(&j, f->frame);
    f->accepted = true;
    return RUN(d, e,
               "UPDATE task SET state = 'succeeded', outcome = ?3, not_before_ms = NULL, waits = 0,"
               " finished_ms = ?4, error_code = NULL, error_message = NULL WHERE job = ?1 AND number = ?2",
               integer(j.seq), integer(number), text(queue_outcome_name(f->outcome)), integer(now)) &&
           RUN(d, e, "UPDATE job SET result_bytes = NULL WHERE seq = ?1", integer(j.seq)) &&
           (f->frame == QUEUE_NO_FRAME || job_state_add_event(d, j.seq, QUEUE_EVENT_TASK, QUEUE_SUCCEEDED,
                                                              f->outcome, f->frame, 0, now, e)) &&
           job_save(d, &before, &j, now, e);
}

bool queue_end_found(queue *q, const char *id, int frame, queue_outcome outcome, bool *accepted, error *e)
{
    outcome_change f = {.change.apply = end_found, .id = id, .frame = frame, .outcome = outcome};
    if (!database_change(q->database, &f.change, e)) return false;
    *accepted = f.accepted;
    return true;
}

/* ---- results of jobs that are not in the queue */

typedef struct adoption_change {
    change change;
    const queue_adoption *jobs;
    size_t count;
} adoption_change;

static bool insert_tasks(database *d, const queue_adoption *a, int64_t seq, error *e)
{
    bool ok = true;
    for (size_t i = 0; ok && i < a->task_count; i++)
        ok = RUN(d, e,
                 "INSERT INTO task (job, number, frame, state, outcome, finished_ms, file)"
                 " VALUES (?1, ?2, ?3, 'succeeded', ?4, ?5, ?6)",
                 integer(seq), integer((int64_t)i),
                 integer_if(a->tasks[i].frame, a->tasks[i].frame != QUEUE_NO_FRAME),
                 text(queue_outcome_name(a->tasks[i].outcome)), integer(a->tasks[i].finished_ms),
                 text(a->tasks[i].file));
    return ok;
}

static bool adopt_one(database *d, const queue_adoption *a, int64_t now, error *e)
{
    int64_t finished = 0;
    job_state counts = {0};
    queue_outcome outcome = QUEUE_CONVERGED;
    bool array = a->tasks[0].frame != QUEUE_NO_FRAME;
    for (size_t i = 0; i < a->task_count; i++) {
        if (a->tasks[i].finished_ms > finished) finished = a->tasks[i].finished_ms;
        job_state_count_outcome(&counts, a->tasks[i].outcome);
        if (a->tasks[i].outcome > outcome) outcome = a->tasks[i].outcome;
    }
    if (!RUN(
            d, e,
            "INSERT INTO job (id, owner, state, outcome, priority, threads, memory_mb, max_attempts, is_array,"
            " tasks, ready, succeeded, not_converged, unresolved, created_ms, finished_ms, name, labels, result_bytes)"
            " VALUES (?1, '', 'succeeded', ?2, ?3, ?4, ?5, ?6, ?7, ?8, 0, ?8, ?9, ?10, ?11, ?12, ?13, ?14, NULL)",
            text(a->id), text(queue_outcome_name(outcome)), integer(a->priority), integer(a->threads),
            integer(a->memory_mb), integer(a->max_attempts), integer(array), integer((int64_t)a->task_count),
            integer(counts.not_converged), integer(counts.unresolved), integer(ulid_time_ms(a->id)),
            integer(finished), text(a->name), text(a->labels)))
        return false;
    int64_t seq = database_last_row(d);
    return RUN(d, e, "INSERT INTO spec (job, spec) VALUES (?1, ?2)", integer(seq), text(a->spec)) &&
           RUN(d, e, "INSERT INTO label (label, job) SELECT DISTINCT value, ?1 FROM json_each(?2)",
               integer(seq), text(a->labels)) &&
           insert_tasks(d, a, seq, e) &&
           job_state_add_event(d, seq, QUEUE_EVENT_STATE, QUEUE_SUCCEEDED, outcome, QUEUE_NO_FRAME, 0, now,
                               e);
}

static bool adopt(database *d, change *asked)
{
    const adoption_change *x = (adoption_change *)asked;
    int64_t now = clock_wall_ms();
    bool ok = true;
    for (size_t i = 0; ok && i < x->count; i++) ok = adopt_one(d, &x->jobs[i], now, &asked->fault);
    return ok;
}

bool queue_adopt(queue *q, const queue_adoption *jobs, size_t count, error *e)
{
    adoption_change x = {.change.apply = adopt, .jobs = jobs, .count = count};
    return database_change(q->database, &x.change, e);
}
