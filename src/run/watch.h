/* watch: what a job owes the world whatever it is busy with: a line of progress now and then, and an end soon
 * after it was told to stop.
 *
 * A thread of its own beside the job, which sleeps but for a glance every few milliseconds. Loops of the job
 * look at `cancel` themselves and end in good order; what cannot look, as the reading of a file by a library,
 * is left behind: after PATIENCE the thread calls `leave`, which ends the process.
 */
#ifndef HEXAD_RUN_WATCH_H
#define HEXAD_RUN_WATCH_H

#include <signal.h>

#include "base/error.h"
#include "run/progress.h"

typedef struct watch watch;

typedef struct watch_params {
    progress *progress;                  /* not owned; may be NULL */
    const volatile sig_atomic_t *cancel; /* not 0: stop; may be NULL */
    void (*leave)(void *context); /* called on the thread; must not return. NULL: the job is waited for */
    void *context;
} watch_params;

/* Errors: internal, when no thread is to be had. */
watch *watch_start(const watch_params *params, error *e);

/* From its return on `leave` is not called any more. Accepts NULL. */
void watch_end(watch *w);

#endif
