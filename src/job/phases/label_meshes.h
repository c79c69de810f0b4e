// SPDX-License-Identifier: Apache-2.0
/* label_meshes: extracts the boundary of one label from a mesh between labels. */
#ifndef HEXAD_JOB_PHASES_LABEL_MESHES_H
#define HEXAD_JOB_PHASES_LABEL_MESHES_H

#include "base/core/error.h"
#include "io/points/points.h"

enum { LABEL_MESHES_MOST = 128 };

/* A mesh with only the vertices that it needs. Vertices have positions and the attribute `point`, their index
 * in the whole. Triangles are oriented so that normals point out of the label. Must not be copied: `set`
 * points into it. */
typedef struct label_mesh_part {
    points set;
    point_attribute point;
    /* Edges whose triangles do not cancel in direction: at the end of the data, or at holes. */
    size_t open_edges;
    size_t nonmanifold_edges; /* edges of more than two triangles */
    double volume;            /* enclosed volume, world units cubed; NaN if there are open edges */
    vec3 *position;
    double *index;
    uint32_t (*triangle)[3];
} label_mesh_part;

/* `whole` has triangles with labels. Release *out also after failure. Error: limit_memory. */
bool label_mesh_part_make(const points *whole, int64_t label, label_mesh_part *out, error *e);
void label_mesh_part_free(label_mesh_part *p);

#endif
