// SPDX-License-Identifier: Apache-2.0
/* attach: places the points of an earlier result on another frame of its meshes (sampling.attach), instead of
 * sampling.
 *
 * points.ply of the result has the place of each point (job/attributes/attachment.h). Positions and normals
 * are evaluated on the meshes of the spec's surface, and attributes from files are read again. All other
 * values are those of the result.
 */
#ifndef HEXAD_JOB_PHASES_ATTACH_H
#define HEXAD_JOB_PHASES_ATTACH_H

#include "base/core/error.h"
#include "base/json/json.h"
#include "job/phases/run_options.h"
#include "job/report/outcome.h"
#include "spec/spec.h"

/* As run_job. Errors: attribute_missing (points.ply lacks a property), input_unsupported (the topology of
 * a mesh differs), those of run_job. */
bool attach_run(const spec *s, const run_options *options, outcome_kind *outcome, json **report, error *e);

/* As run_estimate; area and box are those of the result, and seconds are null. */
json *attach_estimate(const spec *s, const run_options *options, error *e);

#endif
