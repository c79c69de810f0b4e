/* levelset: converts a closed mesh to a narrow-band level set, in the arrays from which volumes are built.
 *
 * Distances are exact, to the closest point of the triangles of a solid. The sign is that of the winding number, so that cavities, overlaps and
 * any orientation of the file are correct. The union of the solids takes the minimum of their distances. OpenVDB's meshToVolume was measured and
 * is not used: see doc/volumes.md.
 */
#ifndef HEXAD_MESH_LEVELSET_H
#define HEXAD_MESH_LEVELSET_H

#include <stddef.h>

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"
#include "triangles/mesh_edges.h"
#include "vdb/vdb.h"

typedef struct levelset_params {
    double voxel_size; /* world units; 0: from the resolution */
    int resolution;    /* voxels along the longest side of the mesh's bounding box */
    int band_vox;      /* half-width of the band, voxels */
    /* vertices nearer to an open edge are welded to it, over the longest side of the bounding box */
    double weld;
    size_t memory_limit;     /* bytes, mesh included */
    const mesh_edges *edges; /* of the welded mesh; NULL: unknown */
    threads *pool;           /* may be stopped: cancelled */
} levelset_params;

/* Makes the grid: distances in world units, negative inside; leaves where the band is, and tiles for the inside beyond it. *solids (or NULL)
 * receives the number of solids. *m is left welded, oriented and in index space. NULL on error: those of mesh_repair_solids; no_surface (no
 * extent, or welding leaves no triangle); spec_invalid (voxels too large or too small for the mesh); limit_memory; cancelled. Deterministic for any
 * number of threads. */
vdb_grid *levelset_make(mesh *m, const levelset_params *params, mesh_notes *notes, size_t *solids, error *e);

#endif
