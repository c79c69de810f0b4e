/* fine_mesh: a triangle mesh whose sides are halved until they are short beside the points on it.
 *
 * Vertices at one place are one, so that the pieces of a closed mesh are closed. World space. Threads: none.
 */
#ifndef HEXAD_REMESH_FINE_MESH_H
#define HEXAD_REMESH_FINE_MESH_H

#include "base/error.h"
#include "triangles/mesh.h"

typedef struct fine_mesh {
    mesh m;
    size_t *first; /* vertex_count + 1: of each vertex its triangles in `around` */
    uint32_t *around;
} fine_mesh;

/* Sides are at most `share` of the spacing of the point that is nearest to their middle. Release also after failure. Error:
 * limit_memory. */
bool fine_mesh_make(const mesh *whole, size_t count, const vec3 *position, const double *spacing,
                    double share, fine_mesh *out, error *e);
void fine_mesh_free(fine_mesh *f);

#endif
