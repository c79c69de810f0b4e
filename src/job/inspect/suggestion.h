// SPDX-License-Identifier: Apache-2.0
/* suggestion: a spec that can be submitted as it is, with the area of its surface and the number of points
 * that resolves it.
 */
#ifndef HEXAD_JOB_INSPECT_SUGGESTION_H
#define HEXAD_JOB_INSPECT_SUGGESTION_H

#include "base/json/json.h"
#include "job/phases/run_options.h"

/* Opens and scans a surface. `shape`: the object `surface` of a spec; suggestion_append frees it. `voxels`:
 * the number that is read for each surface of the list. The amount of work is limited by numbers of voxels
 * and cells, never by time. Appends to `list`
 *      cells                number of cells that the surface crosses; null: it was not opened, since too many
 *                           voxels had been read
 *      measured             false: too many cells for a scan; then `area` is an estimate or null, and the
 *                           next members are null
 *      area, bounding_box   of the surface
 *      count, spacing       that resolve the surface; count null: no permitted count does
 *      slope                mean length of the gradient: 1 if values are distances in world units
 *      warnings             as in the report of such a job
 *      spec                 with this count, or with the maximum for suggestions
 * or, if the job would fail, `error` {code, message} and the surface. False with an error only if the
 * inspection must stop (cancelled, limit_time). */
bool suggestion_append(json *list, json *shape, double voxels, const run_options *options, error *e);

#endif
