// SPDX-License-Identifier: Apache-2.0
/* A job on a thread of this process. The calling thread waits: it calls the progress function and observes the time
 * limit. */
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <time.h>

#include "base/core/numeric_state.h"
#include "job/phases/run.h"
#include "library/call.h"

/* Stack of the thread of the job: the usual size of a main thread. */
static const size_t STACK_BYTES = 8 << 20;

typedef struct hosted {
    const spec *spec;
    run_options options;
    error error;
    bool ok;
    pthread_mutex_t lock; /* of the members below */
    pthread_cond_t ended;
    bool has_ended;
    progress_phase phase;
    double fraction;
} hosted;

static void hear(void *context, progress_phase phase, double fraction, const progress_numbers *numbers)
{
    hosted *h = context;
    (void)numbers;
    pthread_mutex_lock(&h->lock);
    h->phase = phase;
    h->fraction = fraction;
    pthread_mutex_unlock(&h->lock);
}

static void *work(void *context)
{
    hosted *h = context;
    outcome_kind outcome;
    json *report = NULL;
    h->ok = run_job(h->spec, &h->options, &outcome, &report, &h->error);
    json_free(report);
    pthread_mutex_lock(&h->lock);
    h->has_ended = true;
    pthread_cond_signal(&h->ended);
    pthread_mutex_unlock(&h->lock);
    return NULL;
}

/* Starts the thread of the job, which handles no signals of the process. */
static bool start(hosted *h, pthread_t *thread, error *e)
{
    sigset_t all, before;
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, STACK_BYTES);
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before); /* inherited by all threads of the job */
    const int fault = numeric_state_start_thread(thread, &attributes, work, h);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    pthread_attr_destroy(&attributes);
    return fault == 0 ||
           error_set(e, ERROR_INTERNAL, "cannot start the thread of the job: %s", strerror(fault));
}

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static struct timespec time_of(double seconds)
{
    const double whole = floor(seconds);
    return (struct timespec){(time_t)whole, (long)(1e9 * (seconds - whole))};
}

/* Waits until the job has ended. Calls the progress function without the lock. */
static void wait_for_end(hexad_job *job, hosted *h)
{
    double deadline = h->spec->timeout_s > 0 ? seconds_now() + h->spec->timeout_s : INFINITY;
    pthread_mutex_lock(&h->lock);
    while (!h->has_ended) {
        const double now = seconds_now(), tick = job->progress ? now + 1e-3 * CALL_TICK_MS : INFINITY;
        const double until = fmin(tick, deadline);
        if (isinf(until)) {
            pthread_cond_wait(&h->ended, &h->lock);
            continue;
        }
        const struct timespec t = time_of(until);
        pthread_cond_timedwait(&h->ended, &h->lock, &t);
        if (h->has_ended) break;
        if (seconds_now() >= deadline) {
            __atomic_store_n(&job->stop, SIGALRM, __ATOMIC_RELAXED);
            deadline = INFINITY;
        }
        const progress_phase phase = h->phase;
        const double fraction = h->fraction;
        pthread_mutex_unlock(&h->lock);
        if (!call_report_progress(job, progress_phase_names[phase], fraction) &&
            __atomic_load_n(&job->stop, __ATOMIC_RELAXED) == 0)
            __atomic_store_n(&job->stop, SIGTERM, __ATOMIC_RELAXED);
        pthread_mutex_lock(&h->lock);
    }
    pthread_mutex_unlock(&h->lock);
}

bool call_in_process(hexad_job *job, const spec *s, error *e)
{
    hosted h = {.spec = s, .phase = PROGRESS_LOAD};
    pthread_condattr_t clock;
    pthread_t thread;
    h.options = (run_options){.delivery = results_in_memory(&job->results),
                              .arrays = &job->arrays,
                              .is_hosted = true,
                              .memory_mb = CALL_MEMORY_MB,
                              .frame = -1,
                              .progress_fd = -1,
                              .cancel = &job->stop};
    if (job->progress) h.options.listener = (progress_listener){hear, &h};
    pthread_mutex_init(&h.lock, NULL);
    pthread_condattr_init(&clock);
    pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
    pthread_cond_init(&h.ended, &clock);
    pthread_condattr_destroy(&clock);
    const bool started = start(&h, &thread, e);
    if (started) {
        wait_for_end(job, &h);
        pthread_join(thread, NULL);
        if (!h.ok && e) *e = h.error;
    }
    pthread_cond_destroy(&h.ended);
    pthread_mutex_destroy(&h.lock);
    return started && h.ok;
}
