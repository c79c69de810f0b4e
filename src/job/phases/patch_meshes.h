// SPDX-License-Identifier: Apache-2.0
/* patch_meshes: triangulates the points of a surface of patches, patch by patch. Where the triangulation of
 * the points of a patch is faulty, as at walls closer than the spacing, it is built along the triangles of
 * the patch instead.
 */
#ifndef HEXAD_JOB_PHASES_PATCH_MESHES_H
#define HEXAD_JOB_PHASES_PATCH_MESHES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/triangles/mesh_patches.h"
#include "sampling/voronoi/triangulation.h"

/* `made`: the result of triangulation_make for `in`, whose labels are the patches of `on`. Replaces the
 * triangles of patches that have fewer faults if built along the patch. *made is unchanged after failure.
 * Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool patch_meshes_repair(const triangulation_input *in, const mesh_patches *on, threads *pool,
                         triangulation *made, error *e);

#endif
