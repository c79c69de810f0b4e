// SPDX-License-Identifier: Apache-2.0
/* levelset: converts a closed mesh to a narrow-band level set, in the arrays from which volumes are built.
 *
 * Distances are exact, to the closest point of the triangles of a solid. The sign is that of the winding
 * number, so that cavities, overlaps and any orientation of the file are correct. The union of the solids
 * takes the minimum of their distances. OpenVDB's meshToVolume was measured and is not used: see
 * doc/meshes.md.
 */
#ifndef HEXAD_SURFACE_LEVELSET_LEVELSET_H
#define HEXAD_SURFACE_LEVELSET_LEVELSET_H

#include <stddef.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/mesh_edges.h"
#include "io/vdb/vdb.h"

typedef struct levelset_params {
    /* 8 to 8191 voxels must fit along the longest side of the mesh's bounding box (upper bound:
     * WINDING_MOST_VOXELS) */
    double voxel_size; /* world units; 0: the longest side divided by `resolution` */
    int resolution;    /* voxels along the longest side, if voxel_size is 0 */
    int band_vox;      /* half-width of the band, voxels */
    /* a vertex within weld * (longest side of the bounding box) of an open edge is welded to it */
    double weld;
    size_t memory_limit; /* bytes, mesh included */
    /* the edges of *m, if mesh_weld was called already (m->welded); NULL: not computed yet */
    const mesh_edges *edges;
    threads *pool; /* may be stopped: cancelled */
} levelset_params;

/* Makes the grid: distances in world units, negative inside; leaves where the band is, and tiles for the
 * inside beyond it. *m comes in world units and is left welded, oriented and in index space (units:
 * voxels). *solids (or NULL) receives the number of solids. Deterministic for any number of threads.
 *
 * NULL on error: those of mesh_repair_solids; no_surface (no extent, or welding leaves no triangle);
 * spec_invalid (not 8 to 8191 voxels along the longest side); limit_memory; cancelled. Then *m may be in
 * either space: the caller can only free it.
 */
vdb_grid *levelset_make(mesh *m, const levelset_params *params, mesh_notes *notes, size_t *solids, error *e);

#endif
