// SPDX-License-Identifier: Apache-2.0
#include "base/core/background.h"

#include <string.h>
#include <time.h>

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
