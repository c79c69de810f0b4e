// SPDX-License-Identifier: Apache-2.0
/* job_save: stores a changed job state, and updates everything that depends on it: the state, times and
 * events of the job, the counts of its owner, and the jobs that depend on this one.
 *
 * Private to src/service/queue. Call it inside a change (service/database/database).
 */
#ifndef HEXAD_SERVICE_QUEUE_JOB_SAVE_H
#define HEXAD_SERVICE_QUEUE_JOB_SAVE_H

#include "service/queue/job_state.h"

/* Stores the job state with the next revision. `before`: the job state as it was loaded. If many jobs wait for
 * this one, the table `ended` records which of them must still be updated. */
bool job_save(database *d, const job_state *before, job_state *j, int64_t now, error *e);

/* Updates some of the jobs that the first row of the table `ended` concerns. `job`: the first row of the job with
 * this seq; 0: of all. */
bool job_save_dependents(database *d, int64_t job, int64_t now, error *e);

#endif
