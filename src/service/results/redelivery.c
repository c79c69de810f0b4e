#include "service/results/redelivery.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/result.h"

/* Wait after a database error, in milliseconds. */
#define RETRY_MS 1000
/* Threads; each copies results of another user. */
enum { THREADS = 4 };

struct redelivery {
    queue *q;
    ledger *counts;
    output_place *outputs;
    char *work_dir;
    pthread_t thread[THREADS];
    size_t count; /* number of started threads */
    pthread_mutex_t mutex;
    pthread_cond_t woken;
    uint64_t wakes; /* number of wake-ups */
    bool stop;
};

static bool is_stopping(redelivery *r)
{
    pthread_mutex_lock(&r->mutex);
    bool stop = r->stop;
    pthread_mutex_unlock(&r->mutex);
    return stop;
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

/* Takes the first marked job of a user whose results no other thread copies. *taken: there is such a job, and its
 * user holds a delivery. False: a database error. */
static bool take(redelivery *r, queue_uncopied *job, bool *taken)
{
    bool ok = true, found = true;
    *taken = false;
    pthread_mutex_lock(&r->mutex);
    for (int64_t after = 0; ok && found && !*taken && !r->stop;) {
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

/* Takes one job and copies its results. *any is false if there is no job. False: a database error. */
static bool work(redelivery *r, bool *any)
{
    queue_uncopied job = {0};
    bool ok = take(r, &job, any);
    if (!*any) return ok;
    ok = copy_job(r, &job);
    ledger_give_back(r->counts, LEDGER_DELIVERIES, job.owner, 1);
    queue_uncopied_clear(&job);
    return ok;
}

/* Waits for a wake-up after number *seen, after a failure for at most RETRY_MS. Sets *seen. False: the thread must
 * end. */
static bool wait(redelivery *r, bool failed, uint64_t *seen)
{
    int64_t until_ms = clock_monotonic_ms() + RETRY_MS;
    pthread_mutex_lock(&r->mutex);
    while (*seen == r->wakes && !r->stop && !(failed && clock_monotonic_ms() >= until_ms))
        if (failed)
            background_wait_until(&r->woken, &r->mutex, until_ms);
        else
            pthread_cond_wait(&r->woken, &r->mutex);
    *seen = r->wakes;
    bool go_on = !r->stop;
    pthread_mutex_unlock(&r->mutex);
    return go_on;
}

static void *run(void *argument)
{
    redelivery *r = argument;
    uint64_t seen = 0;
    bool ok, any;
    do {
        ok = work(r, &any);
    } while ((ok && any && !is_stopping(r)) || wait(r, !ok, &seen));
    return NULL;
}

static void release(redelivery *r)
{
    pthread_cond_destroy(&r->woken);
    pthread_mutex_destroy(&r->mutex);
    free(r->work_dir);
    free(r);
}

static void wake_threads(redelivery *r, bool stop)
{
    pthread_mutex_lock(&r->mutex);
    r->wakes++;
    r->stop |= stop;
    pthread_cond_broadcast(&r->woken);
    pthread_mutex_unlock(&r->mutex);
}

void redelivery_wake(redelivery *r)
{
    wake_threads(r, false);
}

void redelivery_stop(redelivery *r)
{
    if (!r) return;
    wake_threads(r, true);
    for (size_t i = 0; i < r->count; i++) pthread_join(r->thread[i], NULL);
    release(r);
}

redelivery *redelivery_start(queue *q, ledger *counts, output_place *outputs, const char *work_dir, error *e)
{
    redelivery *r = mem_alloc(sizeof *r);
    r->q = q;
    r->counts = counts;
    ledger_limit(counts, LEDGER_DELIVERIES, (ledger_limits){.holder = 1});
    r->outputs = outputs;
    r->work_dir = mem_strdup(work_dir);
    pthread_mutex_init(&r->mutex, NULL);
    background_init_condition(&r->woken);
    while (r->count < THREADS &&
           background_start(&r->thread[r->count], run, r, "the second delivery of results", e))
        r->count++;
    if (r->count == THREADS) return r;
    redelivery_stop(r);
    return NULL;
}
