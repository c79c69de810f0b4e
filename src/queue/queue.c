/* The words of the queue's enumerations, and the release of what it hands out. */
#include "queue/queue.h"

#include <stdlib.h>
#include <string.h>

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

const char *queue_outcome_name(queue_outcome outcome)
{
    return outcome == QUEUE_CONVERGED ? "converged" : outcome == QUEUE_NOT_CONVERGED ? "not_converged" : NULL;
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
    *job = (queue_job){0};
}

void queue_jobs_free(queue_job *jobs, size_t count)
{
    for (size_t i = 0; i < count; i++) queue_job_clear(&jobs[i]);
    free(jobs);
}

void queue_task_clear(queue_task *task)
{
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
    for (size_t i = 0; i < claimed->input_count; i++) free(claimed->inputs[i]);
    free(claimed->inputs);
}

void queue_claimed_free(queue_claimed *claimed, size_t count)
{
    for (size_t i = 0; i < count; i++) queue_claimed_clear(&claimed[i]);
    free(claimed);
}
