// SPDX-License-Identifier: Apache-2.0
#include "base/core/background.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/core/memory.h"

#include "base/core/numeric_state.h"

bool background_start(pthread_t *thread, void *(*run)(void *argument), void *argument, const char *purpose,
                      error *e)
{
    pthread_t started;
    int fault = numeric_state_start_thread(&started, NULL, run, argument);
    if (fault)
        return error_set(e, ERROR_INTERNAL, "cannot start a thread for %s: %s", purpose, strerror(fault));
    *thread = started;
    return true;
}

void background_init_condition(pthread_cond_t *condition)
{
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(condition, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

bool background_wait_until(pthread_cond_t *condition, pthread_mutex_t *mutex, int64_t monotonic_ms)
{
    struct timespec until = {.tv_sec = (time_t)(monotonic_ms / 1000),
                             .tv_nsec = (long)(monotonic_ms % 1000) * 1000000};
    return pthread_cond_timedwait(condition, mutex, &until) == 0;
}

struct background_call {
    pthread_t thread;
    bool started;
    void (*run)(void *argument);
    void *argument;
    int end_fd;
    atomic_bool ended;
};

static void *make_call(void *context)
{
    background_call *c = context;
    c->run(c->argument);
    atomic_store(&c->ended, true);
    ssize_t written = write(c->end_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* fails only if the counter is full, and then the eventfd is readable anyway */
    return NULL;
}

background_call *background_call_start(void (*run)(void *argument), void *argument, int end_fd)
{
    background_call *c = mem_alloc(sizeof *c);
    c->run = run;
    c->argument = argument;
    c->end_fd = end_fd;
    c->started = background_start(&c->thread, make_call, c, "a call", NULL);
    if (!c->started) make_call(c); /* without a thread, the caller waits */
    return c;
}

bool background_call_has_ended(const background_call *c)
{
    return atomic_load(&c->ended);
}

void background_call_end(background_call *c)
{
    if (c->started) pthread_join(c->thread, NULL);
    free(c);
}
