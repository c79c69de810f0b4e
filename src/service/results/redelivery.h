// SPDX-License-Identifier: Apache-2.0
/* redelivery: copies results of ended jobs to output.directory again.
 *
 * Several tasks process the jobs that are marked in the queue (QUEUE_DELIVER), also after a restart. The jobs
 * of one user are delivered one after another, so a file system that does not respond delays only jobs of
 * users who write to it.
 */
#ifndef HEXAD_SERVICE_RESULTS_REDELIVERY_H
#define HEXAD_SERVICE_RESULTS_REDELIVERY_H

#include "base/core/runner.h"
#include "service/ledger/ledger.h"
#include "service/results/output_place.h"

typedef struct redelivery redelivery;

/* Adds the tasks to the runner. The queue, the ledger and the place must outlive it; the path is copied. */
redelivery *redelivery_add(runner *to, queue *q, ledger *counts, output_place *outputs, const char *work_dir);
/* After runner_stop, which waits for the copies in progress. Accepts NULL. */
void redelivery_free(redelivery *r);

/* Call it after a job was marked in the queue. Any thread. */
void redelivery_wake(redelivery *r);

#endif
