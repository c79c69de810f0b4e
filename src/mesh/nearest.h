/* nearest: which triangle of a mesh is nearest to a place. A tree of boxes over the triangles in Morton's order. Immutable
 * once made, safe in any thread. */
#ifndef HEXAD_MESH_NEAREST_H
#define HEXAD_MESH_NEAREST_H

#include "base/error.h"
#include "mesh/mesh.h"

typedef struct nearest nearest;

/* `m` outlives it, and has a triangle. Error: limit_memory. */
nearest *nearest_new(const mesh *m, error *e);
void nearest_free(nearest *n); /* NULL will do */

/* The triangle, and the weights of its corners at the place on it that is nearest to p. */
size_t nearest_find(const nearest *n, vec3 p, double weight[3]);

#endif
