// SPDX-License-Identifier: Apache-2.0
/* label_mesh: the interfaces between the materials of a segmentation, as a triangle mesh. Each interface
 * occurs once.
 *
 * The cells between eight voxels are cut into six tetrahedra, and each tetrahedron is divided among the
 * materials of its corners: two materials meet in a triangle or a quadrilateral, three also in a segment,
 * four also in a point. Adjacent tetrahedra agree on their common face, so that there are no gaps and no
 * overlaps, and every voxel keeps its centre in its material. Vertices start midway between the voxels that
 * they separate. They are then moved by at most half a voxel, which smooths the steps of the voxels: vertices
 * of triple lines and of boundaries along these lines, other vertices with the surface. See
 * label_smoothing.h.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_MESH_H
#define HEXAD_SURFACE_LABELS_LABEL_MESH_H

#include "base/core/threads.h"
#include "surface/labels/label_volume.h"
#include "geometry/mesh/mesh.h"

typedef struct label_mesh {
    mesh m; /* in world space */
    /* of each triangle: its two materials, label_mesh_kind; the normal points from the first to the second */
    uint32_t *kind;
} label_mesh;

static inline uint32_t label_mesh_kind(uint16_t first, uint16_t second)
{
    return (uint32_t)first << 16 | second;
}

/* Whether the interface of two materials is requested. */
typedef bool label_mesh_wanted(const void *context, uint16_t first, uint16_t second);

/* `smooth`: see label_smoothing.h. `wanted`: NULL: all interfaces are requested. `most`: the maximum number
 * of triangles. Errors: no_surface, limit_memory (the interfaces of all materials have more than `most`
 * triangles, or memory is exhausted). */
bool label_mesh_make(const label_volume *v, double smooth, label_mesh_wanted *wanted, const void *context,
                     size_t most, threads *pool, label_mesh *out, error *e);
void label_mesh_free(label_mesh *m); /* accepts a zeroed object */

#endif
