/* suggestion: a spec that is ready to be submitted, and what its surface is like: area, and the points that resolve it. */
#ifndef HEXAD_INSPECT_SUGGESTION_H
#define HEXAD_INSPECT_SUGGESTION_H

#include "json/json.h"
#include "run/run_options.h"

/* Opens and scans the surface, a spec's object `surface`, which is taken over; `voxels` are read for each surface of the
 * list. How much is done depends on their number and on cells, never on time. Appends to `list`
 *     cells                that it passes; null: it was not opened, since too many voxels had been read
 *     measured             false: too many cells for a scan; then `area` is an estimate or null, and what follows null
 *     area, bounding_box   of the surface
 *     count, spacing       that resolve it; the count is null where no number that a job may have does
 *     slope                the mean length of the gradient: 1 where values are distances in world units
 *     warnings             of the report of such a job
 *     spec                 with that count, or the most that suggestions have
 * or, where the job would fail, `error` {code, message} and the surface. False with an error only when the work must stop
 * (cancelled, limit_time). */
bool suggestion_append(json *list, json *shape, double voxels, const run_options *options, error *e);

#endif
