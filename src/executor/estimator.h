/* estimator: has a worker look at a job (`hexad-worker estimate`) or a file (`hexad-worker inspect`), and waits for it.
 *
 * They run on this machine, whatever engine runs the attempts. These workers have the same input roots, sandbox and
 * limits as those that run jobs. Their number and their time are limited, apart from the attempts. Any thread may call
 * these functions.
 */
#ifndef HEXAD_EXECUTOR_ESTIMATOR_H
#define HEXAD_EXECUTOR_ESTIMATOR_H

#include "base/error.h"
#include "executor/executor.h"

typedef struct estimator estimator;

/* What the settings point to must outlive the estimator. Creates or empties the directory estimates/ in the state
 * directory. */
estimator *estimator_open(const executor_settings *settings, int at_once, double timeout_s, error *e);
/* Ends the running estimates; later ones fail. */
void estimator_dismiss(estimator *m);
void estimator_close(estimator *m); /* after the last estimator_ask has returned; accepts NULL */

typedef enum estimator_verdict {
    ESTIMATOR_MADE,
    ESTIMATOR_FAULT, /* the job would fail: the error tells why */
    ESTIMATOR_BUSY,  /* none now: others are running */
    ESTIMATOR_NONE   /* no estimate could be made: the error tells why */
} estimator_verdict;

/* `command` is WORKER_COMMAND_ESTIMATE, or WORKER_COMMAND_INSPECT, whose `spec` names a path (base/worker_contract.h). The answer
 * is given up after `within_s` seconds, or after those of the setting if these are fewer or `within_s` is 0. `threads` and
 * `memory_mb` are those of an attempt. `frame` may be QUEUE_NO_FRAME. With ESTIMATOR_MADE, *document is one JSON object (run/run.h,
 * inspect/inspection.h), to be freed. */
estimator_verdict estimator_ask(estimator *m, const char *command, const char *spec,
                                const char *const *inputs, size_t input_count, int frame, int threads,
                                int64_t memory_mb, double within_s, char **document, error *e);

#endif
