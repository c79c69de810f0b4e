/* estimator: what jobs would take, found out by workers that are waited for (`hexad-worker estimate`).
 *
 * Such a worker is held as those that run jobs are, to the same roots, sandbox and limits; a number of them at a
 * time, apart from the attempts, and each for a time. Any thread may call.
 */
#ifndef HEXAD_EXECUTOR_ESTIMATOR_H
#define HEXAD_EXECUTOR_ESTIMATOR_H

#include "base/error.h"
#include "executor/executor.h"

typedef struct estimator estimator;

/* Borrows what the settings point to. Makes and empties the directory estimates/ of the state directory. */
estimator *estimator_open(const executor_settings *settings, int at_once, double timeout_s, error *e);
/* Ends what is under way, and from then on makes none. */
void estimator_dismiss(estimator *m);
void estimator_close(estimator *m); /* when nobody asks any more; accepts NULL */

typedef enum estimator_verdict {
    ESTIMATOR_MADE,
    ESTIMATOR_FAULT, /* the job would fail: the error says of what */
    ESTIMATOR_NONE   /* there is none: the error's message says why */
} estimator_verdict;

/* `threads` and `memory_mb` as of an attempt, `frame` QUEUE_NO_FRAME: none. On MADE *document is one JSON object
 * (run/run.h), to be freed. */
estimator_verdict estimator_ask(estimator *m, const char *spec, int frame, int threads, int64_t memory_mb,
                                char **document, error *e);

#endif
