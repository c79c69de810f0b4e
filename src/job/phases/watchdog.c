// SPDX-License-Identifier: Apache-2.0
#include "job/phases/watchdog.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/numeric_state.h"

/* GLANCE_MS: interval of the checks. PATIENCE_MS: time after a request to stop before `leave` is called. A
 * job must end within 100 ms, of which the kernel needs a large part to free the memory. */
static const int64_t GLANCE_MS = 10, PATIENCE_MS = 20;
static const size_t STACK_BYTES = 256 * 1024; /* a default stack may not fit under a limit of address space */

struct watchdog {
    watchdog_params params;
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t ended;
    bool end;
};

static struct timespec from_now(int64_t ms)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    t.tv_nsec += (long)(ms % 1000) * 1000000;
    t.tv_sec += ms / 1000 + t.tv_nsec / 1000000000;
    t.tv_nsec %= 1000000000;
    return t;
}

static void *look(void *argument)
{
    watchdog *w = argument;
    const watchdog_params *p = &w->params;
    int64_t told_ms = -1, due_ms = GLANCE_MS;
    pthread_mutex_lock(&w->lock);
    while (!w->end) {
        struct timespec until = from_now(due_ms < GLANCE_MS ? due_ms : GLANCE_MS);
        pthread_cond_timedwait(&w->ended, &w->lock, &until);
        if (w->end) break;
        if (p->progress) due_ms = progress_tick(p->progress);
        if (!p->cancel || !__atomic_load_n(p->cancel, __ATOMIC_RELAXED) || !p->leave) continue;
        if (told_ms < 0) told_ms = clock_monotonic_ms();
        /* under the lock, so that `leave` is never called after watchdog_end */
        if (clock_monotonic_ms() - told_ms >= PATIENCE_MS) p->leave(p->context);
    }
    pthread_mutex_unlock(&w->lock);
    return NULL;
}

watchdog *watchdog_start(const watchdog_params *params, error *e)
{
    watchdog *w = mem_alloc(sizeof *w);
    w->params = *params;
    pthread_condattr_t clock;
    pthread_condattr_init(&clock);
    pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
    pthread_cond_init(&w->ended, &clock);
    pthread_condattr_destroy(&clock);
    pthread_mutex_init(&w->lock, NULL);
    pthread_attr_t attributes;
    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, STACK_BYTES);
    int fault = numeric_state_start_thread(&w->thread, &attributes, look, w);
    pthread_attr_destroy(&attributes);
    if (!fault) return w;
    error_set(e, ERROR_INTERNAL, "cannot start the watchdog thread: %s", strerror(fault));
    pthread_cond_destroy(&w->ended);
    pthread_mutex_destroy(&w->lock);
    free(w);
    return NULL;
}

void watchdog_end(watchdog *w)
{
    if (!w) return;
    pthread_mutex_lock(&w->lock);
    w->end = true;
    pthread_cond_signal(&w->ended);
    pthread_mutex_unlock(&w->lock);
    pthread_join(w->thread, NULL);
    pthread_cond_destroy(&w->ended);
    pthread_mutex_destroy(&w->lock);
    free(w);
}
