/* time_target: a job whose target is a time gets as many points as it can relax, measure and write in it. */
#ifndef HEXAD_RUN_TIME_TARGET_H
#define HEXAD_RUN_TIME_TARGET_H

#include "run/job.h"

/* Repeats the run with more points as long as another run fits into the time; cost_model predicts that from the runs
 * before. j->solution is the last complete run. Errors: limit_time (not even the first run fits), and those of the
 * phases. */
bool time_target_fill(job *j, error *e);

#endif
