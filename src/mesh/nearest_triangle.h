/* nearest_triangle: which triangle of a mesh is nearest to a place. A tree of boxes over the triangles. What it tells does not
 * change; safe in any thread. */
#ifndef HEXAD_MESH_NEAREST_TRIANGLE_H
#define HEXAD_MESH_NEAREST_TRIANGLE_H

#include "base/error.h"
#include "triangles/mesh.h"
#include "geometry/triangle.h"

typedef struct nearest_triangle nearest_triangle;

/* `m` outlives it, and has a triangle. Error: limit_memory. */
nearest_triangle *nearest_triangle_new(const mesh *m, error *e);
/* The same of a few triangles, made when somebody first looks for one. */
nearest_triangle *nearest_triangle_later(const mesh *m);
void nearest_triangle_free(nearest_triangle *n); /* NULL will do */

/* The triangle, and the weights of its corners at the place on it that is nearest to p. */
size_t nearest_triangle_find(const nearest_triangle *n, vec3 p, double weight[3]);

/* The same, found sooner if triangle `start` is near p. */
size_t nearest_triangle_find_from(const nearest_triangle *n, vec3 p, size_t start, double weight[3]);

/* The nearest triangle if the square of its distance is less than *distance2, where that goes then; else false. */
bool nearest_triangle_find_nearer(const nearest_triangle *n, vec3 p, double *distance2, size_t *nearest);

/* Whether a triangle counts. */
typedef bool nearest_triangle_accept(const void *context, size_t n, const triangle *t);

/* The place that is nearest to p of the triangles that count, nearer than `within`; false where there is none. */
bool nearest_triangle_find_among(const nearest_triangle *n, vec3 p, double within,
                                 nearest_triangle_accept *accept, const void *context, vec3 *place);

/* Whether a triangle counts of those whose boxes meet `box`. */
bool nearest_triangle_any(const nearest_triangle *n, bbox box, nearest_triangle_accept *accept,
                          const void *context);

size_t nearest_triangle_bytes(const nearest_triangle *n);

/* Several such trees, and a tree of boxes over them: a place asks few of many. */
typedef struct nearest_of_several nearest_of_several;

/* The trees, `count` > 0, stay the caller's and outlive it. Error: limit_memory. */
nearest_of_several *nearest_of_several_new(const nearest_triangle *const *tree, size_t count, error *e);
void nearest_of_several_free(nearest_of_several *n); /* NULL will do */

/* The tree that has the triangle nearest to p, the first of those that are as near, and that triangle. */
size_t nearest_of_several_find(const nearest_of_several *n, vec3 p, size_t *nearest);

/* As nearest_triangle_find_among, of all trees. */
bool nearest_of_several_find_among(const nearest_of_several *n, vec3 p, double within,
                                   nearest_triangle_accept *accept, const void *context, vec3 *place);

/* The same as nearest_of_several_find, once it is known which triangle of one tree is nearest: both become those of another where that has a nearer one, or
 * one as near and comes first. */
void nearest_of_several_improve(const nearest_of_several *n, vec3 p, size_t *tree, size_t *nearest);

size_t nearest_of_several_bytes(const nearest_of_several *n);

#endif
