// SPDX-License-Identifier: Apache-2.0
/* Claims of tasks, the hold that stops them, and the end of attempts: the task ends or is queued again. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "service/database/schema.h"
#include "service/queue/chunks.h"
#include "service/queue/copy.h"
#include "service/queue/job_row.h"
#include "service/queue/job_save.h"
#include "service/queue/members.h"
#include "service/queue/owner.h"
#include "service/queue/pieces.h"
#include "service/queue/relation.h"
#include "service/queue/usage.h"

typedef struct hold_change {
    change change;
    bool on;
} hold_change;

static bool read_hold(database *d, bool *held, error *e)
{
    static const char sql[] = "SELECT is_held FROM service";
    int64_t read = 0;
    bool ok = database_read_integer(d, database_ask(d, sql, NULL, 0, e), &read, e);
    *held = read != 0;
    return ok;
}

static bool hold(database *d, change *asked)
{
    return RUN(d, &asked->fault, "UPDATE service SET is_held = ?1", integer(((hold_change *)asked)->on));
}

bool queue_hold(queue *q, bool on, error *e)
{
    hold_change h = {.change.apply = hold, .on = on};
    return database_change(q->database, &h.change, e);
}

bool queue_is_held(queue *q, bool *held, error *e)
{
    database *d = database_begin_read(q->database);
    bool ok = read_hold(d, held, e);
    database_end_read(d);
    return ok;
}

typedef struct claim_change {
    change change;
    queue *q;
    const queue_resources *resources; /* NULL: claims a task of the job `id`, whatever the free resources */
    const char *id;
    int after; /* with `resources` and `id`: claims the next task in the chunk of this one */
    queue_claimed claimed;
    bool found;
} claim_change;

/* Queues delayed tasks that are due. The next claim continues. */
static bool promote(database *d, int64_t now, error *e)
{
    for (int i = 0; i < DATABASE_FEW_ROWS; i++) {
        bool ok = false, any = false, found = false;
        int64_t job = 0;
        int number = 0;
        char id[ULID_SIZE] = "";
        sqlite3_stmt *s =
            ASK(d, e,
                "SELECT job, number, id FROM task JOIN job ON seq = job"
                " WHERE task.state = 'delayed' AND not_before_ms <= ?1 ORDER BY not_before_ms LIMIT 1",
                integer(now));
        while (database_next(d, s, &ok, e)) {
            any = true;
            job = sqlite3_column_int64(s, 0);
            number = sqlite3_column_int(s, 1);
            snprintf(id, sizeof id, "%s", (const char *)sqlite3_column_text(s, 2));
        }
        if (!ok || !any) return ok;
        job_state j;
        if (!RUN(d, e,
                 "UPDATE task SET state = 'queued', not_before_ms = NULL WHERE job = ?1 AND number = ?2",
                 integer(job), integer(number)) ||
            !job_state_load(d, id, &j, &found, e))
            return false;
        job_state before = j;
        j.delayed--;
        j.ready++;
        if (!job_save(d, &before, &j, now, e)) return false;
    }
    return true;
}

#define CLAIMED_COLUMNS JOB_COLUMNS ", " TASK_COLUMNS ", spec, timeout_ms, stall_ms, directory, cache_key"

static void read_row(sqlite3_stmt *s, queue_claimed *claimed)
{
    int column = JOB_COLUMN_COUNT + TASK_COLUMN_COUNT;
    job_row_read(s, &claimed->job);
    job_row_read_task(s, JOB_COLUMN_COUNT, &claimed->task);
    claimed->job.spec = database_text(s, column);
    claimed->timeout_ms = sqlite3_column_int64(s, column + 1);
    claimed->stall_ms = sqlite3_column_int64(s, column + 2);
    claimed->directory = database_text(s, column + 3);
    claimed->cache_key = database_text(s, column + 4);
}

static bool read_inputs(database *d, int64_t seq, queue_claimed *claimed, error *e)
{
    bool ok = false;
    sqlite3_stmt *s =
        ASK(d, e, "SELECT name FROM input WHERE job = ?1 AND of_task = 0 ORDER BY name", integer(seq));
    while (database_next(d, s, &ok, e))
        mem_add_text(&claimed->inputs, &claimed->input_count, database_text(s, 0));
    return ok;
}

static bool read_claimed(database *d, int64_t seq, int number, queue_claimed *claimed, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT " CLAIMED_COLUMNS " FROM job JOIN task ON task.job = job.seq"
                          " JOIN spec ON spec.job = job.seq WHERE job.seq = ?1 AND number = ?2",
                          integer(seq), integer(number));
    while (database_next(d, s, &ok, e)) read_row(s, claimed);
    return ok && read_inputs(d, seq, claimed, e);
}

/* Finds the frame from whose result a task of an ordered job starts. */
static bool find_previous(database *d, int64_t seq, int number, int *frame, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT frame FROM task WHERE job = ?1 AND number < ?2 AND state = 'succeeded'"
                          " ORDER BY number DESC LIMIT 1",
                          integer(seq), integer(number));
    while (database_next(d, s, &ok, e)) *frame = sqlite3_column_int(s, 0);
    return ok;
}

/* Sets the number of the claimed task's chunk, and whether more tasks of the chunk may be claimed. */
static bool note_chunk(database *d, const job_state *j, claim_change *c, error *e)
{
    int next = -1;
    bool may = false;
    c->claimed.chunk = -1;
    if (j->chunk == 1) return true;
    c->claimed.chunk = c->claimed.task.number / j->chunk;
    if (!c->resources) return true;
    if (!chunks_find_next(d, j, c->claimed.task.number, &next, e)) return false;
    if (next >= 0 && !owner_may_continue(c->q, j->seq, c->resources, &may, e)) return false;
    c->claimed.more = may;
    return true;
}

/* Starts a task of the job. */
static bool start_task(database *d, int64_t seq, claim_change *c, int64_t now, error *e)
{
    bool ok = false;
    int number = -1, attempt = 0, frame = QUEUE_NO_FRAME;
    job_state j;
    if (!job_state_load_seq(d, seq, &j, e)) return false;
    ok = c->resources && c->id ? chunks_find_next(d, &j, c->after, &number, e)
                               : chunks_find_task(d, &j, &number, e);
    if (!ok || number < 0) return ok;
    sqlite3_stmt *s = ASK(d, e,
                          "UPDATE task SET state = 'running', attempt = attempt + 1, spent = spent + 1,"
                          " started_ms = coalesce(started_ms, ?3) WHERE job = ?1 AND number = ?2"
                          " RETURNING attempt, frame",
                          integer(seq), integer(number), integer(now));
    while (database_next(d, s, &ok, e)) {
        attempt = sqlite3_column_int(s, 0);
        if (sqlite3_column_type(s, 1) != SQLITE_NULL) frame = sqlite3_column_int(s, 1);
    }
    ok = ok && RUN(d, e, "INSERT INTO attempt (job, task, number, started_ms) VALUES (?1, ?2, ?3, ?4)",
                   integer(seq), integer(number), integer(attempt), integer(now));
    if (!ok) return false;
    job_state before = j;
    j.ready--;
    j.running++;
    j.attempts++;
    ok = (!c->resources || owner_take_turn(d, seq, c->resources->weights, e)) &&
         job_save(d, &before, &j, now, e) &&
         job_state_add_event(d, seq, QUEUE_EVENT_STARTED, QUEUE_RUNNING, QUEUE_NO_OUTCOME, frame, attempt,
                             now, e) &&
         read_claimed(d, seq, number, &c->claimed, e);
    c->claimed.previous = QUEUE_NO_FRAME;
    if (j.ordered) ok = ok && find_previous(d, seq, number, &c->claimed.previous, e);
    ok = ok && note_chunk(d, &j, c, e);
    c->found = ok;
    return ok;
}

/* Finds the job of which another task is claimed; *seq 0: none may be claimed. */
static bool find_continued(database *d, const claim_change *c, int64_t *seq, error *e)
{
    bool may = false;
    if (!database_read_integer(d, ASK(d, e, "SELECT seq FROM job WHERE id = ?1", text(c->id)), seq, e))
        return false;
    if (*seq && !owner_may_continue(c->q, *seq, c->resources, &may, e)) return false;
    if (!may) *seq = 0;
    return true;
}

static bool claim(database *d, change *asked)
{
    claim_change *c = (claim_change *)asked;
    error *e = &asked->fault;
    int64_t now = clock_wall_ms(), seq = 0;
    bool ok, held = false, full = false;
    if (c->resources)
        ok = promote(d, now, e) && read_hold(d, &held, e) && usage_is_met(c->q, d, &full, e) &&
             (held || full ||
              (c->id ? find_continued(d, c, &seq, e) : owner_choose(c->q, c->resources, &seq, e)));
    else
        ok = database_read_integer(
            d, ASK(d, e, "SELECT seq FROM job WHERE id = ?1 AND " SCHEMA_CLAIMABLE, text(c->id)), &seq, e);
    return ok && (!seq || start_task(d, seq, c, now, e));
}

static bool run_claim(queue *q, claim_change *c, queue_claimed *claimed, bool *found, error *e)
{
    c->change.apply = claim;
    if (!database_change(q->database, &c->change, e)) {
        queue_claimed_clear(&c->claimed);
        return false;
    }
    *found = c->found;
    if (c->found) *claimed = c->claimed;
    return true;
}

bool queue_claim(queue *q, const queue_resources *resources, queue_claimed *claimed, bool *found, error *e)
{
    claim_change c = {.q = q, .resources = resources};
    return run_claim(q, &c, claimed, found, e);
}

bool queue_claim_in_chunk(queue *q, const queue_resources *resources, const char *id, int task,
                          queue_claimed *claimed, bool *found, error *e)
{
    claim_change c = {.q = q, .resources = resources, .id = id, .after = task};
    return run_claim(q, &c, claimed, found, e);
}

bool queue_claim_job(queue *q, const char *id, queue_claimed *claimed, bool *found, error *e)
{
    claim_change c = {.q = q, .id = id};
    return run_claim(q, &c, claimed, found, e);
}

bool queue_list_unsettled(queue *q, queue_claimed **claimed, size_t *count, error *e)
{
    queue_claimed *read = NULL;
    size_t used = 0, capacity = 0;
    bool ok = false;
    static const char sql[] = "SELECT " CLAIMED_COLUMNS " FROM task INDEXED BY task_running"
                              " JOIN job ON job.seq = task.job JOIN spec ON spec.job = job.seq"
                              " WHERE task.state = 'running' ORDER BY task.job, number";
    database *d = database_begin_read(q->database);
    sqlite3_stmt *s = database_ask(d, sql, NULL, 0, e);
    while (database_next(d, s, &ok, e)) {
        if (used == capacity) read = mem_resize(read, (capacity = capacity * 2 + 16) * sizeof *read);
        read[used] = (queue_claimed){.previous = QUEUE_NO_FRAME, .chunk = -1}; /* it will not be started */
        read_row(s, &read[used++]);
    }
    database_end_read(d);
    if (!ok) {
        queue_claimed_free(read, used);
        return false;
    }
    *claimed = read;
    *count = used;
    return true;
}

/* ---- the end of an attempt */

typedef struct settle_change {
    change change;
    const queue_fence *fence;
    const queue_ending *ending;
    bool back, counts; /* the task is queued again */
    int64_t not_before_ms;
    bool accepted;
} settle_change;

static bool end_attempt(database *d, const settle_change *s, const job_state *j, int frame, int64_t now,
                        error *e)
{
    const queue_ending *x = s->ending;
    return RUN(d, e,
               "UPDATE attempt SET finished_ms = ?4, exit_status = ?5, signal = ?6, peak_memory_bytes = ?7,"
               " host = ?8, reason = ?9, waited_ms = ?10, processor_ms = ?11"
               " WHERE job = ?1 AND task = ?2 AND number = ?3",
               integer(j->seq), integer(s->fence->task), integer(s->fence->attempt), integer(now),
               integer_if(x->exit_status, x->exit_status >= 0), integer_if(x->signal, x->signal >= 0),
               integer_if(x->peak_memory_bytes, x->peak_memory_bytes > 0), text(x->host), text(x->reason),
               integer_if(x->waited_ms, x->waited_ms > 0),
               integer_if(x->processor_ms, x->processor_ms > 0)) &&
           job_state_add_event(d, j->seq, QUEUE_EVENT_ENDED, s->back ? QUEUE_QUEUED : x->state,
                               s->back ? QUEUE_NO_OUTCOME : x->outcome, frame, s->fence->attempt, now, e);
}

/* Whether the attempt is the current one of its task and runs. Reads the frame. */
static bool check_fence(database *d, const settle_change *s, const job_state *j, bool *current, int *frame,
                        error *e)
{
    bool ok = false;
    *current = false;
    sqlite3_stmt *row = ASK(d, e,
                            "SELECT frame FROM task WHERE job = ?1 AND number = ?2 AND attempt = ?3"
                            " AND state = 'running'",
                            integer(j->seq), integer(s->fence->task), integer(s->fence->attempt));
    while (database_next(d, row, &ok, e)) {
        *current = true;
        *frame = sqlite3_column_type(row, 0) == SQLITE_NULL ? QUEUE_NO_FRAME : sqlite3_column_int(row, 0);
    }
    return ok;
}

static bool put_back(database *d, const settle_change *s, job_state *j, int64_t now, error *e)
{
    bool delayed = s->not_before_ms > now;
    if (!RUN(d, e,
             "UPDATE task SET state = ?3, spent = spent - ?4, not_before_ms = ?5, ran_ms = ran_ms + ?6,"
             " storage_faults = storage_faults + ?7, interrupted = interrupted + ?8, wait_ms = ?9"
             " WHERE job = ?1 AND number = ?2",
             integer(j->seq), integer(s->fence->task), text(delayed ? "delayed" : "queued"),
             integer(s->counts ? 0 : 1), integer_if(s->not_before_ms, delayed),
             integer(s->counts ? s->ending->ran_ms : 0), integer(s->ending->storage_fault),
             integer(s->ending->interrupted), integer(delayed ? s->not_before_ms - now : 0)))
        return false;
    if (delayed)
        j->delayed++;
    else
        j->ready++;
    return true;
}

#define MAKER_IS_SHOWN RELATION_IS_SHOWN("job.owner", "maker.owner")

static bool end_task(database *d, const settle_change *s, job_state *j, int frame, int64_t now, error *e)
{
    const queue_ending *x = s->ending;
    if (!RUN(d, e,
             "UPDATE task SET state = ?3, outcome = ?4, error_code = ?5, error_message = ?6, finished_ms = ?7"
             " WHERE job = ?1 AND number = ?2",
             integer(j->seq), integer(s->fence->task), text(queue_state_name(x->state)),
             text(queue_outcome_name(x->outcome)), text(x->error_code), text(x->error_message), integer(now)))
        return false;
    ++*job_state_counter(j, x->state);
    job_state_count_outcome(j, x->outcome);
    job_state_note_ended(j, frame);
    if (x->cached_from &&
        !RUN(d, e,
             "UPDATE job SET cached_from = ?2, cached_shown = coalesce((SELECT " MAKER_IS_SHOWN
             " FROM job AS maker WHERE maker.id = ?2), 0) WHERE seq = ?1",
             integer(j->seq), text(x->cached_from)))
        return false;
    if (x->cache_key && !RUN(d, e, "INSERT OR REPLACE INTO cache (key, job, inputs) VALUES (?1, ?2, ?3)",
                             text(x->cache_key), integer(j->seq), text(x->cache_inputs)))
        return false;
    return frame == QUEUE_NO_FRAME || job_state_add_event(d, j->seq, QUEUE_EVENT_TASK, x->state, x->outcome,
                                                          frame, s->fence->attempt, now, e);
}

/* In an ordered job, ends the tasks after one that did not succeed: they have no result to start from. Those of a
 * cancelled job are cancelled, perhaps in pieces. */
static bool end_followers(database *d, const settle_change *s, job_state *j, int frame, int64_t now, error *e)
{
    const queue_ending *x = s->ending;
    char message[128];
    if (!j->ordered || j->cancelled || s->back || x->state == QUEUE_SUCCEEDED) return true;
    if (x->error_code && strcmp(x->error_code, error_code_name(ERROR_NO_SURFACE)) == 0) return true;
    snprintf(message, sizeof message,
             "this frame starts with the points of frame %d, which is %s: retry the job", frame,
             queue_state_name(x->state));
    return pieces_begin(d, j, QUEUE_FAILED, message, now, e);
}

/* Records that the result of the task has to be copied to output.directory, or could not be copied. */
static bool note_uncopied(database *d, const settle_change *s, const job_state *j, error *e)
{
    const queue_ending *x = s->ending;
    bool failed = x->copy_code && !x->copy_pending;
    if (s->back || x->state != QUEUE_SUCCEEDED || (!failed && !x->copy_pending)) return true;
    return RUN(d, e, "UPDATE task SET copy_code = ?3, copy_message = ?4 WHERE job = ?1 AND number = ?2",
               integer(j->seq), integer(s->fence->task), text(failed ? x->copy_code : "pending"),
               text(failed ? x->copy_message : NULL)) &&
           RUN(d, e,
               "UPDATE job SET copy_state = iif(copy_state = 'pending', copy_state, ?2), copy_code = coalesce(copy_code, ?3),"
               " copy_message = coalesce(copy_message, ?4) WHERE seq = ?1",
               integer(j->seq), text(failed ? "failed" : "pending"), text(failed ? x->copy_code : NULL),
               text(failed ? x->copy_message : NULL));
}

/* Adds the disk space of the attempt. */
static bool note_left(database *d, const settle_change *s, const job_state *j, error *e)
{
    const queue_ending *x = s->ending;
    bool delivered = x->delivered && !s->back && x->state == QUEUE_SUCCEEDED;
    if (!x->bytes && !delivered) return true;
    return RUN(d, e,
               "UPDATE job SET result_bytes = result_bytes + ?2, delivered = delivered + ?3,"
               " copy_state = coalesce(copy_state, iif(?3, 'delivered', NULL)) WHERE seq = ?1",
               integer(j->seq), integer(x->bytes), integer(delivered)) &&
           (!delivered || RUN(d, e, "UPDATE task SET is_delivered = 1 WHERE job = ?1 AND number = ?2",
                              integer(j->seq), integer(s->fence->task)));
}

static bool settle(database *d, change *asked)
{
    settle_change *s = (settle_change *)asked;
    error *e = &asked->fault;
    int64_t now = clock_wall_ms();
    bool found = false, current = false;
    int frame = QUEUE_NO_FRAME;
    job_state j;
    if (!job_state_load(d, s->fence->id, &j, &found, e)) return false;
    if (!found || (s->back && j.cancelled)) return true; /* a new attempt would undo the cancellation */
    if (!check_fence(d, s, &j, &current, &frame, e)) return false;
    if (!current) return true;
    job_state before = j;
    j.running--;
    s->accepted = true;
    return end_attempt(d, s, &j, frame, now, e) &&
           (s->back ? put_back(d, s, &j, now, e) : end_task(d, s, &j, frame, now, e)) &&
           (!s->ending->copied || copy_forget(d, s->ending->copied, e)) &&
           end_followers(d, s, &j, frame, now, e) && note_uncopied(d, s, &j, e) && note_left(d, s, &j, e) &&
           job_save(d, &before, &j, now, e);
}

static bool run_settling(queue *q, settle_change *s, bool *accepted, error *e)
{
    s->change.apply = settle;
    if (!database_change(q->database, &s->change, e)) return false;
    *accepted = s->accepted;
    return true;
}

bool queue_finish(queue *q, const queue_fence *fence, const queue_ending *ending, bool *accepted, error *e)
{
    settle_change s = {.fence = fence, .ending = ending};
    return run_settling(q, &s, accepted, e);
}

bool queue_requeue(queue *q, const queue_fence *fence, bool counts, int64_t not_before_ms,
                   const queue_ending *ending, bool *accepted, error *e)
{
    settle_change s = {
        .fence = fence, .ending = ending, .back = true, .counts = counts, .not_before_ms = not_before_ms};
    return run_settling(q, &s, accepted, e);
}
