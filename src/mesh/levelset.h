/* levelset: a closed mesh as a narrow-band level set, in the arrays that volumes are built of.
 *
 * Distances are exact, to the nearest point of the triangles of a solid, and the sign is the winding
 * number's, so that cavities, overlaps and the orientation of the file come out right. The union of the
 * solids is the least of their distances. OpenVDB's meshToVolume was measured and left aside: see
 * doc/volumes.md.
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
    double voxel_size;       /* world units; 0: from the resolution */
    int resolution;          /* voxels along the longest side of the mesh's box */
    int band_vox;            /* half-width of the band */
    double weld;             /* what lies nearer to an open edge, of the longest side of the box, is on it */
    size_t memory_limit;     /* bytes, the mesh included */
    const mesh_edges *edges; /* of the mesh, which is welded then, or NULL: not known */
    threads *pool;           /* works on the distances, and may be told to stop */
} levelset_params;

/* *solids, which may be NULL, is how many there are. The grid has distances in world units, negative inside, and its leaves wherever the band is; what is
 * inside beyond it has tiles. The mesh is left welded, turned, and in index space. Errors: those of
 * mesh_repair_solids; no_surface for a mesh without extent, or of which welding leaves nothing; spec_invalid for voxels too large or too small for
 * it; limit_memory; cancelled. The same for any number of threads. */
vdb_grid *levelset_make(mesh *m, const levelset_params *params, mesh_notes *notes, size_t *solids, error *e);

#endif
