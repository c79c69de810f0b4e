/* label_mesh: the interfaces between the materials of a segmentation, as a triangle mesh: each interface once.
 *
 * Cells between eight voxels are cut into six tetrahedra; a tetrahedron is cut among the materials of its corners: with two
 * of them along a triangle or a quadrilateral, with three along a segment, too, with four in a point. Neighbours agree, so
 * no gap and no overlap is left, and no voxel is lost: each keeps its centre. Vertices begin in the middle of the voxels
 * they part. They are then moved by at most half a voxel so that stairs are smoothed: vertices along triple lines and ends
 * follow these, others the surface. See label_smoothing.h.
 */
#ifndef HEXAD_LABELS_LABEL_MESH_H
#define HEXAD_LABELS_LABEL_MESH_H

#include "base/threads.h"
#include "labels/label_volume.h"
#include "triangles/mesh.h"

typedef struct label_mesh {
    mesh m; /* in world space */
    uint32_t *
        kind; /* of each triangle: its two materials, label_mesh_kind; the normal points from the first to the second */
} label_mesh;

static inline uint32_t label_mesh_kind(uint16_t first, uint16_t second)
{
    return (uint32_t)first << 16 | second;
}

/* Whether the interface of two materials is requested. */
typedef bool label_mesh_wanted(const void *context, uint16_t first, uint16_t second);

/* `smooth`: see label_smoothing.h; `wanted`: NULL: all are; `most`: triangles. Errors: no_surface, limit_memory (more triangles
 * than that among all materials, or too little memory). */
bool label_mesh_make(const label_volume *v, double smooth, label_mesh_wanted *wanted, const void *context,
                     size_t most, threads *pool, label_mesh *out, error *e);
void label_mesh_free(label_mesh *m); /* a zeroed one will do */

#endif
