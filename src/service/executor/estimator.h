// SPDX-License-Identifier: Apache-2.0
/* estimator: runs a worker for an estimate of a job (`hexad-worker estimate`) or the description of a file
 * (`hexad-worker inspect`), and waits for it.
 *
 * These workers run on this machine, whatever the engine of the attempts, with the same input roots, sandbox
 * and limits as workers that run jobs. Their number and their time are limited separately. Any thread.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_ESTIMATOR_H
#define HEXAD_SERVICE_EXECUTOR_ESTIMATOR_H

#include "base/core/error.h"
#include "service/executor/executor.h"

typedef struct estimator estimator;

/* Objects to which the settings point must outlive the estimator. Creates or empties the directory estimates/
 * in the state directory. */
estimator *estimator_open(const executor_settings *settings, int at_once, double timeout_s, error *e);
/* Ends the running estimates; later ones fail. */
void estimator_dismiss(estimator *m);
void estimator_close(estimator *m); /* after the last estimator_run has returned; accepts NULL */

typedef enum estimator_outcome {
    ESTIMATOR_MADE,
    ESTIMATOR_FAULT, /* the job would fail; the error has the reason */
    ESTIMATOR_BUSY,  /* the maximum number is running */
    ESTIMATOR_NONE   /* no estimate could be made; the error has the reason */
} estimator_outcome;

/* Runs a worker. `command` is WORKER_COMMAND_ESTIMATE, or WORKER_COMMAND_INSPECT with a `spec` that contains
 * a path (base/core/worker_contract.h). The worker is stopped after `within_s` seconds, or after the time of
 * the setting if that is shorter or `within_s` is 0. `threads` and `memory_mb` are limits as of an attempt.
 * `frame` may be QUEUE_NO_FRAME. With ESTIMATOR_MADE, *document is one JSON object (job/phases/run.h,
 * job/inspect/inspection.h), which the caller frees. */
estimator_outcome estimator_run(estimator *m, const char *command, const char *spec,
                                const char *const *inputs, size_t input_count, int frame, int threads,
                                int64_t memory_mb, double within_s, char **document, error *e);

#endif
