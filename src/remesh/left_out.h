/* left_out: places of a mesh that triangles between points on it do not come near: a bump, a dent or the end of a thorn that is
 * about as large as the spacing and has points beside it, but none on it. World space.
 */
#ifndef HEXAD_REMESH_LEFT_OUT_H
#define HEXAD_REMESH_LEFT_OUT_H

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"

typedef struct left_out_input {
    const mesh *on;
    size_t count;
    const vec3 *position; /* on the mesh */
    const double *spacing;
    const uint32_t (*triangle)[3]; /* of these, at least one */
    size_t triangles;
} left_out_input;

/* Places of the mesh that are farther than `share` of the spacing from all triangles, and those nearest to places of triangles
 * that are as far from the mesh: the farthest first, and none nearer to an earlier one than the spacing there; at most `most`.
 * *place is to be freed. Deterministic. Error: limit_memory. */
bool left_out_find(const left_out_input *in, double share, size_t most, threads *pool, vec3 **place,
                   size_t *count, error *e);

#endif
