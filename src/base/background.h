/* background: starts threads that wait for work, and helps them to wait.
 *
 * A module that has such a thread keeps its mutex and its condition itself. A condition of this module uses
 * the monotonic clock, so that setting the clock of the wall neither prolongs a wait nor cuts it short.
 */
#ifndef HEXAD_BASE_BACKGROUND_H
#define HEXAD_BASE_BACKGROUND_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"

/* Starts a thread that calls run(argument); the caller joins it. `purpose` completes the message of the error
 * (internal): "cannot start a thread for PURPOSE: ...". *thread is untouched on failure. */
bool background_start(pthread_t *thread, void *(*run)(void *argument), void *argument, const char *purpose,
                      error *e);

/* Initialises a condition for background_wait_until; pthread_cond_destroy ends its use. */
void background_init_condition(pthread_cond_t *condition);

/* As pthread_cond_timedwait, with a deadline of clock_monotonic_ms. Returns false once the deadline has
 * passed. The caller holds the mutex and checks its condition again, since a wait may also end for no reason.
 */
bool background_wait_until(pthread_cond_t *condition, pthread_mutex_t *mutex, int64_t monotonic_ms);

#endif
