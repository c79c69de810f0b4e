// SPDX-License-Identifier: Apache-2.0
#include "service/results/redelivery.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/result.h"

/* Tasks of the runner; each copies results of another user. */
enum { TASKS = 4 };

struct redelivery {
    queue *q;
    ledger *counts;
    output_place *outputs;
    char *work_dir;
    runner_task *task[TASKS];
    pthread_mutex_t mutex;
};

static bool is_stopping(const redelivery *r)
{
    return runner_is_stopping(r->task[0]);
}

/* Copies the result of one task and stores success or failure in the queue. False: a database error. */
static bool copy_task(redelivery *r, const queue_uncopied *job, const queue_task *task, error *e)
{
    char unique[ULID_SIZE];
    error fault = {0};
    /* unused before: output_cleanup may be removing files of earlier copies */
    ulid_make(clock_wall_ms(), unique);
    char *from = result_directory(r->work_dir, job->id, task->frame), *name = output_place_temporary(unique),
         *to = output_place_directory(job->directory, task->frame);
    bool copied = output_place_copy(r->outputs, job->owner, from, job->directory, task->frame, name, &fault);
    bool ok = queue_note_copied(r->q, job->id, task, copied ? NULL : &fault, name, e);
    log_write(copied ? LOG_LEVEL_INFO : LOG_LEVEL_WARNING, "result %s job=%s directory=%s%s%s",
              copied ? "delivered" : "not delivered", job->id, to, copied ? "" : ": ", fault.message);
    free(from);
    free(name);
    free(to);
    return ok;
}

/* Takes the first marked job of a user whose results no other task copies. *taken: there is such a job, and
 * its user holds a delivery. False: a database error. */
static bool take(redelivery *r, queue_uncopied *job, bool *taken)
{
    bool ok = true, found = true;
    *taken = false;
    pthread_mutex_lock(&r->mutex);
    for (int64_t after = 0; ok && found && !*taken && !is_stopping(r);) {
        ok = queue_next_uncopied(r->q, after, job, &found, NULL);
        if (!ok || !found) break;
        after = job->seq;
        *taken = ledger_take(r->counts, LEDGER_DELIVERIES, job->owner, 1) == LEDGER_FITS;
        if (!*taken) queue_uncopied_clear(job);
    }
    pthread_mutex_unlock(&r->mutex);
    return ok;
}

static bool copy_job(redelivery *r, const queue_uncopied *job)
{
    bool ok = true;
    size_t done = 0;
    for (; ok && done < job->count && !is_stopping(r); done++)
        ok = copy_task(r, job, &job->tasks[done], NULL);
    return ok && (done < job->count || queue_end_copying(r->q, job->id, NULL));
}

/* Takes one job and copies its results. */
static int64_t work(void *context)
{
    redelivery *r = context;
    queue_uncopied job = {0};
    bool taken;
    bool ok = take(r, &job, &taken);
    if (!ok) return runner_retry_time();
    if (!taken) return RUNNER_WHEN_WOKEN;
    ok = copy_job(r, &job);
    ledger_give_back(r->counts, LEDGER_DELIVERIES, job.owner, 1);
    queue_uncopied_clear(&job);
    return ok ? 0 : runner_retry_time();
}

void redelivery_wake(redelivery *r)
{
    for (size_t i = 0; i < TASKS; i++) runner_wake(r->task[i]);
}

void redelivery_free(redelivery *r)
{
    if (!r) return;
    pthread_mutex_destroy(&r->mutex);
    free(r->work_dir);
    free(r);
}

redelivery *redelivery_add(runner *to, queue *q, ledger *counts, output_place *outputs, const char *work_dir)
{
    redelivery *r = mem_alloc(sizeof *r);
    r->q = q;
    r->counts = counts;
    ledger_limit(counts, LEDGER_DELIVERIES, (ledger_limits){.holder = 1});
    r->outputs = outputs;
    r->work_dir = mem_strdup(work_dir);
    pthread_mutex_init(&r->mutex, NULL);
    for (size_t i = 0; i < TASKS; i++) r->task[i] = runner_add(to, "redelivery", work, r);
    return r;
}
