/* time_target: a job whose target is a time: as many points as it can relax, measure and write before its end. */
#ifndef HEXAD_RUN_TIME_TARGET_H
#define HEXAD_RUN_TIME_TARGET_H

#include "run/job.h"

/* Runs ever more points, each run planned from what those before it took (cost_model), as long as one more fits into
 * the time. The last whole run is j->solution. Errors: limit_time (not even the first run fits), and those of the
 * steps. */
bool time_target_fill(job *j, error *e);

#endif
