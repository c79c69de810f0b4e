#include "service/results/redelivery.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/frames.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/result.h"

/* Tasks of the runner; each copies results of another user. */
enum { TASKS = 4 };

struct redelivery {
    queue *q;
    output_place *outputs;
    char *work_dir;
    runner_task *task[TASKS];
    pthread_mutex_t mutex;
    char *user[TASKS]; /* the users whose results are copied now; NULL: an unused place */
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
    char *from = result_directory(r->work_dir, job->id, task->frame),
         *name = mem_printf(".%s.hexad-tmp", unique);
    char *to =
        task->frame == QUEUE_NO_FRAME ? mem_strdup(job->directory) : frames_path(job->directory, task->frame);
    char *above = task->frame == QUEUE_NO_FRAME ? NULL : frames_above(job->directory);
    bool copied = output_place_copy(r->outputs, job->owner, from, to, above, name, &fault) ||
                  error_prefix(&fault, "output.directory");
    bool ok = queue_note_copied(r->q, job->id, task, copied ? NULL : &fault, name, e);
    log_write(copied ? LOG_LEVEL_INFO : LOG_LEVEL_WARNING, "result %s job=%s directory=%s%s%s",
              copied ? "delivered" : "not delivered", job->id, to, copied ? "" : ": ", fault.message);
    free(from);
    free(name);
    free(to);
    free(above);
    return ok;
}

/* Requires the mutex. An unused element of `user`; NULL: a task copies results of this user already. */
static char **find_place(redelivery *r, const char *user)
{
    char **place = NULL;
    for (size_t i = 0; i < TASKS; i++) {
        if (r->user[i] && strcmp(r->user[i], user) == 0) return NULL;
        if (!r->user[i]) place = &r->user[i];
    }
    return place;
}

/* Takes the first marked job of a user whose results no other task copies. *place is the element of `user` that
 * now holds the user's name; NULL: there is no such job. False: a database error. */
static bool take(redelivery *r, queue_uncopied *job, char ***place)
{
    bool ok = true, found = true;
    *place = NULL;
    pthread_mutex_lock(&r->mutex);
    for (int64_t after = 0; ok && found && !*place && !is_stopping(r);) {
        ok = queue_next_uncopied(r->q, after, job, &found, NULL);
        if (!ok || !found) break;
        after = job->seq;
        if ((*place = find_place(r, job->owner)))
            **place = mem_strdup(job->owner);
        else
            queue_uncopied_clear(job);
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
    char **place;
    bool ok = take(r, &job, &place);
    if (!ok) return runner_retry_time();
    if (!place) return RUNNER_WHEN_WOKEN;
    ok = copy_job(r, &job);
    queue_uncopied_clear(&job);
    pthread_mutex_lock(&r->mutex);
    free(*place);
    *place = NULL;
    pthread_mutex_unlock(&r->mutex);
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

redelivery *redelivery_add(runner *to, queue *q, output_place *outputs, const char *work_dir)
{
    redelivery *r = mem_alloc(sizeof *r);
    r->q = q;
    r->outputs = outputs;
    r->work_dir = mem_strdup(work_dir);
    pthread_mutex_init(&r->mutex, NULL);
    for (size_t i = 0; i < TASKS; i++) r->task[i] = runner_add(to, "redelivery", work, r);
    return r;
}
