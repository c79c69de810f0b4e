/* run: one job from start to end, without a daemon.
 *
 * run_job loads the surface, samples it, measures the points, and writes and verifies the results. report.json comes
 * last, by rename: a directory without it is no result. Meanwhile a signal handler may set *cancel.
 */
#ifndef HEXAD_RUN_RUN_H
#define HEXAD_RUN_RUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "json/json.h"
#include "run/run_options.h"
#include "run/verdict.h"
#include "spec/spec.h"

/* Errors: any code in base/error.h. On failure the directory has no report.json. *report is what was written there,
 * to be freed with json_free. */
bool run_job(const spec *s, const run_options *options, verdict_outcome *outcome, json **report, error *e);

/* Estimates what the job would take; free the object with json_free. It loads and scans the surface, and runs the job
 * with few points. These trial runs end after two seconds of processor time of all threads, at the end of the step
 * that is under way.
 *     count         points; null when a time is the target
 *     area, bounding_box {min, max}   of the surface
 *     memory_bytes  at the peak
 *     seconds       on `threads` processors, without writing the results; null when there is no estimate
 *     seconds_missing   why there is none, or null
 *     threads
 *     warnings, advice  as the report would have them, as far as that can be told now
 * Errors: those of run_job before the first point is placed. Writes no file. */
json *run_estimate(const spec *s, const run_options *options, error *e);

#endif
