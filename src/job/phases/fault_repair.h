// SPDX-License-Identifier: Apache-2.0
/* fault_repair: repairs the faults of a triangulation of points on a mesh: around each fault, its triangles are
 * replaced by triangles along the mesh (surface/remesh/surface_mesh.h).
 *
 * Time and memory grow with the points and triangles around the faults, beside one pass over all. Only if faults
 * remain, they grow with all points.
 */
#ifndef HEXAD_JOB_PHASES_FAULT_REPAIR_H
#define HEXAD_JOB_PHASES_FAULT_REPAIR_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "sampling/voronoi/triangulation.h"

/* `made`: the result of triangulation_make for `in`, whose points are on the mesh `on`. Replaces triangles
 * near faults if the result has fewer faults. If faults remain, triangulates all points along the mesh, and keeps
 * the result with fewer faults. Neither is done for more than 200 000 points. A replaced triangulation has no
 * labels. *made is valid after failure, too. Errors: limit_memory, cancelled. Deterministic for any number of
 * threads. */
bool fault_repair_along(const triangulation_input *in, const mesh *on, threads *pool, triangulation *made,
                        error *e);

#endif
