// SPDX-License-Identifier: Apache-2.0
/* time_target: gives a job whose target is a time as many points as can be relaxed, measured and written
 * in it. */
#ifndef HEXAD_JOB_PHASES_TIME_TARGET_H
#define HEXAD_JOB_PHASES_TIME_TARGET_H

#include "job/phases/job.h"

/* Repeats the run with more points as long as another run fits into the time; cost_model predicts that from
 * earlier runs. j->solution is the last complete run. Errors: limit_time (not even the first run fits), and
 * those of the phases. */
bool time_target_fill(job *j, error *e);

#endif
