// SPDX-License-Identifier: Apache-2.0
/* watchdog: a thread that writes a job's progress lines on time, and ends the process soon after a request to
 * stop.
 *
 * The thread runs every few milliseconds. Loops of the job check `cancel` themselves and end normally. Work
 * that cannot check it, such as a library that reads a file, is interrupted: PATIENCE_MS after the request
 * the thread calls `leave`, which ends the process.
 */
#ifndef HEXAD_JOB_PHASES_WATCHDOG_H
#define HEXAD_JOB_PHASES_WATCHDOG_H

#include <signal.h>

#include "base/core/error.h"
#include "job/phases/progress.h"

typedef struct watchdog watchdog;

typedef struct watchdog_params {
    progress *progress;                  /* not owned; may be NULL */
    const volatile sig_atomic_t *cancel; /* not 0: stop; may be NULL */
    void (*leave)(void *context);        /* called on the thread; must not return. NULL: waits for the job */
    void *context;
} watchdog_params;

/* Error: internal (no thread can be started). */
watchdog *watchdog_start(const watchdog_params *params, error *e);

/* After it returns, `leave` is not called. Accepts NULL. */
void watchdog_end(watchdog *w);

#endif
