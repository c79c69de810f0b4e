/* watchdog: a thread that writes a job's progress lines on time, and ends the process soon after a request to stop,
 * whatever the job is doing.
 *
 * The thread wakes every few milliseconds. Loops of the job check `cancel` themselves and end in order. Some work
 * cannot check it, such as a library that reads a file: after PATIENCE_MS the thread calls `leave`, which ends the
 * process.
 */
#ifndef HEXAD_RUN_WATCHDOG_H
#define HEXAD_RUN_WATCHDOG_H

#include <signal.h>

#include "base/error.h"
#include "run/progress.h"

typedef struct watchdog watchdog;

typedef struct watchdog_params {
    progress *progress;                  /* not owned; may be NULL */
    const volatile sig_atomic_t *cancel; /* not 0: stop; may be NULL */
    void (*leave)(void *context);        /* called on the thread; must not return. NULL: waits for the job */
    void *context;
} watchdog_params;

/* Errors: internal, when no thread can be started. */
watchdog *watchdog_start(const watchdog_params *params, error *e);

/* After its return `leave` is not called any more. Accepts NULL. */
void watchdog_end(watchdog *w);

#endif
