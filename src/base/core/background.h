// SPDX-License-Identifier: Apache-2.0
/* background: starts threads that wait for work, and helps them to wait.
 *
 * The caller keeps the mutex and the condition. A condition of this module uses the monotonic clock, so that
 * changes of the wall clock do not affect waits.
 */
#ifndef HEXAD_BASE_CORE_BACKGROUND_H
#define HEXAD_BASE_CORE_BACKGROUND_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

/* Starts a thread that calls run(argument); the caller joins it. Error: internal, "cannot start a thread for
 * PURPOSE: ..."; *thread is then unchanged. */
bool background_start(pthread_t *thread, void *(*run)(void *argument), void *argument, const char *purpose,
                      error *e);

/* Initialises a condition for background_wait_until; destroy it with pthread_cond_destroy. */
void background_init_condition(pthread_cond_t *condition);

/* As pthread_cond_timedwait, with a deadline of clock_monotonic_ms. False: the deadline has passed. The
 * caller holds the mutex and tests its condition again, since wakeups may be spurious. */
bool background_wait_until(pthread_cond_t *condition, pthread_mutex_t *mutex, int64_t monotonic_ms);

#endif
