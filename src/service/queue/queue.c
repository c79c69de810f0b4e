// SPDX-License-Identifier: Apache-2.0
/* Opening and closing; words of enumerations; freeing of results. */
#include "service/queue/queue.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "service/queue/members.h"

/* SQLite calls this for each changed row, also of a change that is rolled back later. */
static void note_row(void *context, int operation, const char *schema, const char *table, sqlite3_int64 row)
{
    (void)operation, (void)schema;
    queue *q = context;
    if (strcmp(table, "job") == 0) q->changed[(uint64_t)row % MEMBERS_STAMPS] = true;
}

/* Increments `commits` first: then queue_get returns no stamp for a job that changed during the read. */
static void raise_stamps(void *context)
{
    queue *q = context;
    atomic_fetch_add(&q->commits, 1);
    for (size_t i = 0; i < MEMBERS_STAMPS; i++)
        if (q->changed[i]) atomic_fetch_add(&q->stamp[i], 1);
    memset(q->changed, 0, sizeof q->changed);
}

static queue *open_with(database *d, error *e)
{
    if (!d) return NULL;
    running_period past[RUNNING_PERIODS_MOST];
    size_t count = 0;
    queue *q = mem_alloc(sizeof *q);
    q->database = d;
    q->bounds = (queue_bounds){.all = {INT64_MAX, INT64_MAX}, .user = {INT64_MAX, INT64_MAX}};
    pthread_mutex_init(&q->storing, NULL);
    pthread_cond_init(&q->stored, NULL);
    LIST_INIT(&q->entries);
    sqlite3_update_hook(database_connection(d), note_row, q);
    database_on_commit(d, raise_stamps, q);
    if (running_read(q, past, &count, e)) {
        q->running = running_time_new(past, count);
        return q;
    }
    queue_close(q);
    return NULL;
}

/* Jobs that the last process has not stored completely are deleted (queue_delete_hidden). */
static bool abandon_jobs(database *d, change *c)
{
    static const char sql[] =
        "UPDATE job INDEXED BY job_hidden SET state = 'cancelled' WHERE tasks = 0 AND state = 'paused'";
    return database_run(d, sql, NULL, 0, &c->fault);
}

queue *queue_open(const char *state_dir, error *e)
{
    queue *q = open_with(database_open(state_dir, e), e);
    change c = {.apply = abandon_jobs};
    if (q) database_change(q->database, &c, NULL); /* otherwise the next start deletes them */
    return q;
}

queue *queue_open_copy(const char *path, error *e)
{
    return open_with(database_open_copy(path, e), e);
}

void queue_close(queue *q)
{
    if (!q) return;
    database_close(q->database);
    running_time_free(q->running);
    pthread_cond_destroy(&q->stored);
    pthread_mutex_destroy(&q->storing);
    free(q);
}

running_time *queue_running(queue *q)
{
    return q->running;
}

struct database *queue_database(queue *q)
{
    return q->database;
}

void queue_reserve(queue *q, int64_t bytes)
{
    database_reserve(q->database, bytes);
}

void queue_get_health(queue *q, health_report *known)
{
    health_get(database_health(q->database), known);
}

bool queue_allows_changes(queue *q, error *e)
{
    return health_allows_changes(database_health(q->database), e);
}

bool queue_has_place(queue *q, error *e)
{
    return database_has_place(q->database, e);
}

uint64_t queue_stamp(queue *q, int64_t seq)
{
    return atomic_load(&q->stamp[(uint64_t)seq % MEMBERS_STAMPS]);
}

void queue_signal(queue *q)
{
    database_signal(q->database);
}

void queue_wake_on_change(queue *q, runner_task *t)
{
    database_wake_on_change(q->database, t);
}

void queue_wake_no_more(queue *q, const runner_task *t)
{
    database_wake_no_more(q->database, t);
}

static const char *const state_names[QUEUE_STATE_COUNT] = {
    [QUEUE_QUEUED] = "queued",   [QUEUE_BLOCKED] = "blocked",       [QUEUE_PAUSED] = "paused",
    [QUEUE_RUNNING] = "running", [QUEUE_CANCELLING] = "cancelling", [QUEUE_SUCCEEDED] = "succeeded",
    [QUEUE_FAILED] = "failed",   [QUEUE_CANCELLED] = "cancelled",   [QUEUE_TIMED_OUT] = "timed_out",
};

const char *queue_state_name(queue_state state)
{
    return state_names[state];
}

bool queue_state_from_name(const char *name, queue_state *state)
{
    for (int i = 0; i < QUEUE_STATE_COUNT; i++) {
        if (strcmp(state_names[i], name) == 0) {
            *state = (queue_state)i;
            return true;
        }
    }
    return false;
}

bool queue_state_is_final(queue_state state)
{
    return state >= QUEUE_SUCCEEDED;
}

static const char *const outcome_names[] = {NULL, "converged", "unresolved", "not_converged"};

const char *queue_outcome_name(queue_outcome outcome)
{
    return outcome_names[outcome];
}

queue_outcome queue_outcome_from_name(const char *name)
{
    for (size_t k = 1; name && k < sizeof outcome_names / sizeof *outcome_names; k++)
        if (strcmp(name, outcome_names[k]) == 0) return (queue_outcome)k;
    return QUEUE_NO_OUTCOME;
}

void queue_job_clear(queue_job *job)
{
    free(job->name);
    free(job->owner);
    free(job->labels);
    free(job->trace);
    free(job->spec);
    free(job->paths);
    free(job->error_code);
    free(job->error_message);
    free(job->cached_from);
    free(job->copy_state);
    free(job->copy_code);
    free(job->copy_message);
    *job = (queue_job){0};
}

void queue_jobs_free(queue_job *jobs, size_t count)
{
    for (size_t i = 0; i < count; i++) queue_job_clear(&jobs[i]);
    free(jobs);
}

void queue_task_clear(queue_task *task)
{
    free(task->file);
    free(task->error_code);
    free(task->error_message);
    *task = (queue_task){0};
}

void queue_tasks_free(queue_task *tasks, size_t count)
{
    for (size_t i = 0; i < count; i++) queue_task_clear(&tasks[i]);
    free(tasks);
}

void queue_attempts_free(queue_attempt *attempts, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        free(attempts[i].host);
        free(attempts[i].reason);
    }
    free(attempts);
}

void queue_claimed_clear(queue_claimed *claimed)
{
    queue_job_clear(&claimed->job);
    queue_task_clear(&claimed->task);
    free(claimed->directory);
    free(claimed->cache_key);
    mem_free_texts(claimed->inputs, claimed->input_count);
}

void queue_claimed_free(queue_claimed *claimed, size_t count)
{
    for (size_t i = 0; i < count; i++) queue_claimed_clear(&claimed[i]);
    free(claimed);
}
