// SPDX-License-Identifier: Apache-2.0
#include "base/core/runner.h"

#include <assert.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/memory.h"

/* Maximum length of the name of a thread (pthread_setname_np). */
#define NAME_MOST 15

struct runner_task {
    const char *name;
    runner_step *step;
    void *context;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    bool started, woken;
    atomic_bool stopping; /* changes under the mutex */
    TAILQ_ENTRY(runner_task) link;
};

struct runner {
    TAILQ_HEAD(tasks, runner_task) tasks; /* in the order of start */
};

int64_t runner_retry_time(void)
{
    return clock_monotonic_ms() + RUNNER_RETRY_MS;
}

runner *runner_new(void)
{
    runner *r = mem_alloc(sizeof *r);
    TAILQ_INIT(&r->tasks);
    return r;
}

void runner_free(runner *r)
{
    if (!r) return;
    for (runner_task *t; (t = TAILQ_FIRST(&r->tasks));) {
        TAILQ_REMOVE(&r->tasks, t, link);
        pthread_cond_destroy(&t->changed);
        pthread_mutex_destroy(&t->mutex);
        free(t);
    }
    free(r);
}

runner_task *runner_add(runner *r, const char *name, runner_step *step, void *context)
{
    assert(strlen(name) <= NAME_MOST);
    runner_task *t = mem_alloc(sizeof *t);
    t->name = name;
    t->step = step;
    t->context = context;
    pthread_mutex_init(&t->mutex, NULL);
    background_init_condition(&t->changed);
    TAILQ_INSERT_TAIL(&r->tasks, t, link);
    return t;
}

static void wait_until(runner_task *t, int64_t at_ms)
{
    bool waiting = true;
    pthread_mutex_lock(&t->mutex);
    while (!t->woken && waiting) waiting = background_wait_until(&t->changed, &t->mutex, at_ms);
    t->woken = false;
    pthread_mutex_unlock(&t->mutex);
}

static void *run(void *argument)
{
    runner_task *t = argument;
    pthread_setname_np(pthread_self(), t->name); /* helps to debug a process that hangs */
    do wait_until(t, t->step(t->context));
    while (!t->stopping);
    return NULL;
}

bool runner_start(runner *r, error *e)
{
    runner_task *t;
    TAILQ_FOREACH (t, &r->tasks, link) {
        t->started = background_start(&t->thread, run, t, t->name, e);
        if (!t->started) return false;
    }
    return true;
}

static void notify(runner_task *t, bool stop)
{
    pthread_mutex_lock(&t->mutex);
    t->woken = true;
    if (stop) t->stopping = true;
    pthread_cond_signal(&t->changed);
    pthread_mutex_unlock(&t->mutex);
}

void runner_stop(runner *r)
{
    runner_task *t;
    TAILQ_FOREACH (t, &r->tasks, link) notify(t, true);
    TAILQ_FOREACH_REVERSE(t, &r->tasks, tasks, link)
    {
        if (t->started) pthread_join(t->thread, NULL);
        t->started = false;
    }
}

void runner_wake(runner_task *t)
{
    notify(t, false);
}

bool runner_is_stopping(const runner_task *t)
{
    return t->stopping;
}
