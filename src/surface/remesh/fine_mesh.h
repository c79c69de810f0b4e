// SPDX-License-Identifier: Apache-2.0
/* fine_mesh: a triangle mesh refined by halving sides until they are short compared with the spacing of the
 * points on it.
 *
 * Vertices with equal coordinates are joined, so that the pieces of a closed mesh are closed. World space.
 * Single-threaded.
 */
#ifndef HEXAD_SURFACE_REMESH_FINE_MESH_H
#define HEXAD_SURFACE_REMESH_FINE_MESH_H

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"
#include "geometry/space/point_tree.h"

typedef struct fine_mesh {
    mesh m;
    /* vertex_count + 1 entries: vertex v has the triangles around[first[v]] .. around[first[v + 1] - 1] */
    size_t *first;
    uint32_t *around;
} fine_mesh;

/* A part of a mesh: the pieces within a radius of some centers. */
typedef struct fine_mesh_part {
    const point_tree *centers;
    const double *radius; /* per center */
} fine_mesh_part;

/* Each side is at most `share` times the spacing of the point nearest to its midpoint. `part`: pieces whose
 * bounding sphere is beyond the radius of its nearest center are left out; NULL: the whole mesh. Free *out
 * also after failure. Error: limit_memory. */
bool fine_mesh_make(const mesh *whole, const fine_mesh_part *part, size_t count, const vec3 *position,
                    const double *spacing, double share, fine_mesh *out, error *e);
void fine_mesh_free(fine_mesh *f);

#endif
