// SPDX-License-Identifier: Apache-2.0
/* background: starts threads that wait for work, and helps them to wait; makes one call in a thread of its
 * own.
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

/* A call in a thread of its own, for a loop that polls descriptors and must not wait for a disk. */
typedef struct background_call background_call;

/* Calls run(argument). At its end, 1 is written to the eventfd `end_fd`. If no thread can be started, the
 * call is made before this function returns. Never NULL; the caller calls background_call_end. */
background_call *background_call_start(void (*run)(void *argument), void *argument, int end_fd);
/* Whether the call has ended. Does not wait. */
bool background_call_has_ended(const background_call *c);
/* Waits for the end of the call and frees. */
void background_call_end(background_call *c);

#endif
