// SPDX-License-Identifier: Apache-2.0
/* run: one job from start to end, without a daemon.
 *
 * run_job loads the surface, samples it, measures the points, and writes and verifies the results.
 * report.json is renamed to its final name last: a directory without it is not a result. A signal handler may
 * set *cancel at any time.
 */
#ifndef HEXAD_JOB_PHASES_RUN_H
#define HEXAD_JOB_PHASES_RUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/json/json.h"
#include "job/phases/run_options.h"
#include "job/report/outcome.h"
#include "spec/spec.h"

/* Errors: any code in base/core/error.h. On failure the directory has no report.json. *report is the report;
 * the caller frees it with json_free. */
bool run_job(const spec *s, const run_options *options, outcome_kind *outcome, json **report, error *e);

/* Estimates the resources of a job; the caller frees the object with json_free. Loads and scans the surface,
 * and runs the job with few points. Trial runs end after two seconds of CPU time of all threads, at the end
 * of the current step.
 *     count             points; null if the target is a time
 *     area, bounding_box {min, max}   of the surface, world units
 *     memory_bytes      peak
 *     seconds           on `threads` processors, without writing the results; null if there is no estimate
 *     seconds_missing   reason, or null
 *     weights_seconds   the part of `seconds` for the quadrature weights; only if it is known and the job has them
 *     threads
 *     warnings, advice  as in the report, as far as known before the run
 * Errors: those of run_job before the first point is placed. Writes no file. */
json *run_estimate(const spec *s, const run_options *options, error *e);

#endif
