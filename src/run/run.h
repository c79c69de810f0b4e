/* run: one job from start to end, without a daemon.
 *
 * run_job loads the surface, samples it, measures the points, writes the results into a directory and
 * verifies them by reading them back; report.json comes last, by rename, so that a directory without
 * it is no result. What a caller may do meanwhile: set *cancel, from a signal handler.
 */
#ifndef HEXAD_RUN_RUN_H
#define HEXAD_RUN_RUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "json/json.h"
#include "run/run_options.h"
#include "spec/spec.h"

typedef struct run_summary {
    bool converged;
    size_t count;
    double hex_fraction, max_residual, total_s;
} run_summary;

/* Errors: every code of the job contract. On failure no report.json is in the directory. */
bool run_job(const spec *s, const run_options *options, run_summary *out, error *e);

/* What the job would take, found out without doing it: an object to be freed with json_free. The surface is
 * loaded and measured, however long that takes, and a few runs of few points tell what more of them take: they
 * are given up when they have taken two seconds of processor time, by all threads; what is at work then, a step or
 * the placing or measuring of one run's points, comes to its end.
 *     count         points; null when a time is the target
 *     area, bounding_box {min, max}   of the surface
 *     memory_bytes  at the peak
 *     seconds       that `threads` processors would take, without what writing the results takes; null when
 *                   it cannot be told
 *     seconds_missing   why not; null when it can
 *     threads
 * Errors: those that run_job would end with before the first point is placed. Writes no file. */
json *run_estimate(const spec *s, const run_options *options, error *e);

#endif
