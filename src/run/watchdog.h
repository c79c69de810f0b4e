/* watchdog: a thread beside the job that writes its progress lines in time, and ends the process soon after it was
 * told to stop, whatever the job is busy with.
 *
 * The thread wakes every few milliseconds. Loops of the job look at `cancel` themselves and end in good order. Some
 * work cannot look, such as a library that reads a file: after PATIENCE_MS the thread calls `leave`, which ends the
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
    void (*leave)(void *context); /* called on the thread; must not return. NULL: the job is waited for */
    void *context;
} watchdog_params;

/* Errors: internal, when no thread is to be had. */
watchdog *watchdog_start(const watchdog_params *params, error *e);

/* From its return on `leave` is not called any more. Accepts NULL. */
void watchdog_end(watchdog *w);

#endif
