// SPDX-License-Identifier: Apache-2.0
/* points_mesh: repairs the faults of a triangulation of points on triangles. Around each fault, its triangles
 * are replaced by triangles along the surface (surface/remesh/surface_mesh.h).
 *
 * Time and memory grow with the points and triangles around the faults, beside one pass over all. If faults
 * remain, they grow with the points of each patch that has any.
 */
#ifndef HEXAD_JOB_PHASES_POINTS_MESH_H
#define HEXAD_JOB_PHASES_POINTS_MESH_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/voronoi/triangulation.h"
#include "surface/triangles/mesh_patches.h"

/* `made`: the result of triangulation_make for `in`. Its points are on the mesh `on`, or on `patches`: its
 * labels are these patches, and each patch is repaired by itself. The other one of the two is NULL.
 *
 * Replaces triangles near faults if the result has fewer faults. If faults remain, triangulates the whole mesh,
 * or the patches with faults, along the surface, and keeps the result with fewer faults. At most 200 000 points
 * are triangulated along the surface at a time; faults beyond remain. A replaced triangulation has labels only on
 * patches. *made is valid after failure, too. Errors: limit_memory, cancelled. Deterministic for any number of
 * threads. */
bool points_mesh_repair(const triangulation_input *in, const mesh *on, const mesh_patches *patches,
                        threads *pool, triangulation *made, error *e);

#endif
