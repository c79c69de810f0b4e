/* nearest_triangle: a bounding-box tree over the triangles of a mesh, for searches of the closest triangle. Immutable after construction, any
 * thread. Lengths are those of the mesh. */
#ifndef HEXAD_MESH_NEAREST_TRIANGLE_H
#define HEXAD_MESH_NEAREST_TRIANGLE_H

#include "base/error.h"
#include "triangles/mesh.h"
#include "geometry/triangle.h"

typedef struct nearest_triangle nearest_triangle;

/* Builds the tree. `m` has at least one triangle; it is not owned and outlives the tree. NULL: limit_memory. */
nearest_triangle *nearest_triangle_new(const mesh *m, error *e);
/* A tree that is built at the first search, for small meshes. If memory is out then, the process is aborted. */
nearest_triangle *nearest_triangle_new_lazy(const mesh *m);
void nearest_triangle_free(nearest_triangle *n); /* accepts NULL */

/* Returns the closest triangle. `weight`: barycentric weights of the closest point of it. */
size_t nearest_triangle_find(const nearest_triangle *n, vec3 p, double weight[3]);

/* nearest_triangle_find, faster if triangle `start` is near p. */
size_t nearest_triangle_find_from(const nearest_triangle *n, vec3 p, size_t start, double weight[3]);

/* Finds the closest triangle if its squared distance is less than *distance2, and sets *distance2 to it. False: there is none. */
bool nearest_triangle_find_nearer(const nearest_triangle *n, vec3 p, double *distance2, size_t *nearest);

/* Whether triangle n, with the corners *t, is accepted by a search. */
typedef bool nearest_triangle_accept(const void *context, size_t n, const triangle *t);

/* Finds the closest point of the accepted triangles that is nearer than `within`. False: there is none. */
bool nearest_triangle_find_accepted(const nearest_triangle *n, vec3 p, double within,
                                    nearest_triangle_accept *accept, const void *context, vec3 *place);

/* Whether any triangle whose bounding box meets `box` is accepted. */
bool nearest_triangle_any_in_box(const nearest_triangle *n, bbox box, nearest_triangle_accept *accept,
                                 const void *context);

size_t nearest_triangle_bytes(const nearest_triangle *n);

/* A bounding-box tree over several trees. */
typedef struct triangle_forest triangle_forest;

/* `count` > 0 trees, which are owned by the caller and outlive the forest. NULL: limit_memory. */
triangle_forest *triangle_forest_new(const nearest_triangle *const *tree, size_t count, error *e);
void triangle_forest_free(triangle_forest *n); /* accepts NULL */

/* Returns the tree with the closest triangle, the first one at equal distances, and sets *nearest to that triangle. */
size_t triangle_forest_find(const triangle_forest *n, vec3 p, size_t *nearest);

/* nearest_triangle_find_accepted over all trees. */
bool triangle_forest_find_accepted(const triangle_forest *n, vec3 p, double within,
                                   nearest_triangle_accept *accept, const void *context, vec3 *place);

/* triangle_forest_find if the closest triangle of one tree is known: replaces *tree and *nearest if another tree has a closer triangle, or is
 * earlier at the same distance. */
void triangle_forest_improve(const triangle_forest *n, vec3 p, size_t *tree, size_t *nearest);

size_t triangle_forest_bytes(const triangle_forest *n);

#endif
