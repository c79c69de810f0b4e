#include "results/redelivery.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/background.h"
#include "base/clock.h"
#include "base/frames.h"
#include "base/log.h"
#include "base/memory.h"
#include "results/result.h"

/* After a database error. */
#define RETRY_MS 1000

struct redelivery {
    queue *q;
    output_place *outputs;
    char *work_dir;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t woken;
    bool wake, stop;
};

static bool is_stopping(redelivery *r)
{
    pthread_mutex_lock(&r->mutex);
    bool stop = r->stop;
    pthread_mutex_unlock(&r->mutex);
    return stop;
}

/* Copies the result of one task and notes what became of that. */
static bool copy_task(redelivery *r, const queue_uncopied *job, const queue_task *task, error *e)
{
    char unique[ULID_SIZE];
    error fault = {0};
    ulid_make(clock_wall_ms(), unique); /* a file of this name that a crash left may be removed meanwhile */
    char *from = result_directory(r->work_dir, job->id, task->frame),
         *name = mem_printf(".%s.hexad-tmp", unique);
    char *to =
        task->frame == QUEUE_NO_FRAME ? mem_strdup(job->directory) : frames_path(job->directory, task->frame);
    bool copied = output_place_copy(r->outputs, job->owner, from, to, name, &fault) ||
                  error_prefix(&fault, "output.directory");
    bool ok = queue_note_copied(r->q, job->id, task, copied ? NULL : &fault, name, e);
    log_write(copied ? LOG_LEVEL_INFO : LOG_LEVEL_WARNING, "result %s job=%s directory=%s%s%s",
              copied ? "delivered" : "not delivered", job->id, to, copied ? "" : ": ", fault.message);
    free(from);
    free(name);
    free(to);
    return ok;
}

/* Works off the marked jobs. False: a database error. */
static bool work_off(redelivery *r)
{
    bool ok = true, found = true;
    while (ok && found && !is_stopping(r)) {
        queue_uncopied job = {0};
        size_t done = 0;
        ok = queue_next_uncopied(r->q, &job, &found, NULL);
        if (!ok || !found) break;
        for (; ok && done < job.count && !is_stopping(r); done++)
            ok = copy_task(r, &job, &job.tasks[done], NULL);
        if (ok && done == job.count) ok = queue_end_copying(r->q, job.id, NULL);
        queue_uncopied_clear(&job);
    }
    return ok;
}

static void *run(void *argument)
{
    redelivery *r = argument;
    for (bool stop = false; !stop;) {
        int64_t until_ms = work_off(r) ? INT64_MAX : clock_monotonic_ms() + RETRY_MS;
        pthread_mutex_lock(&r->mutex);
        while (!r->wake && !r->stop && clock_monotonic_ms() < until_ms)
            if (until_ms == INT64_MAX)
                pthread_cond_wait(&r->woken, &r->mutex);
            else
                background_wait_until(&r->woken, &r->mutex, until_ms);
        r->wake = false;
        stop = r->stop;
        pthread_mutex_unlock(&r->mutex);
    }
    return NULL;
}

static void release(redelivery *r)
{
    pthread_cond_destroy(&r->woken);
    pthread_mutex_destroy(&r->mutex);
    free(r->work_dir);
    free(r);
}

redelivery *redelivery_start(queue *q, output_place *outputs, const char *work_dir, error *e)
{
    redelivery *r = mem_alloc(sizeof *r);
    r->q = q;
    r->outputs = outputs;
    r->work_dir = mem_strdup(work_dir);
    pthread_mutex_init(&r->mutex, NULL);
    background_init_condition(&r->woken);
    if (background_start(&r->thread, run, r, "results that are delivered again", e)) return r;
    release(r);
    return NULL;
}

static void tell(redelivery *r, bool stop)
{
    pthread_mutex_lock(&r->mutex);
    r->wake = true;
    r->stop |= stop;
    pthread_cond_signal(&r->woken);
    pthread_mutex_unlock(&r->mutex);
}

void redelivery_wake(redelivery *r)
{
    tell(r, false);
}

void redelivery_stop(redelivery *r)
{
    if (!r) return;
    tell(r, true);
    pthread_join(r->thread, NULL);
    release(r);
}
