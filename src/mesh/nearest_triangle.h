/* nearest_triangle: which triangle of a mesh is nearest to a place. A tree of boxes over the triangles. Immutable once made, safe in
 * any thread. */
#ifndef HEXAD_MESH_NEAREST_TRIANGLE_H
#define HEXAD_MESH_NEAREST_TRIANGLE_H

#include "base/error.h"
#include "mesh/mesh.h"

typedef struct nearest_triangle nearest_triangle;

/* `m` outlives it, and has a triangle. Error: limit_memory. */
nearest_triangle *nearest_triangle_new(const mesh *m, error *e);
void nearest_triangle_free(nearest_triangle *n); /* NULL will do */

/* The triangle, and the weights of its corners at the place on it that is nearest to p. */
size_t nearest_triangle_find(const nearest_triangle *n, vec3 p, double weight[3]);

#endif
