/* line_tree: a bounding-box tree over the triangles of a mesh, for intersections with straight lines. Lengths are those of the mesh. Immutable
 * after construction, any thread.
 */
#ifndef HEXAD_MESH_LINE_TREE_H
#define HEXAD_MESH_LINE_TREE_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "triangles/mesh.h"

typedef struct line_tree line_tree;

/* `m` is not owned, outlives the tree and is not changed. NULL: limit_memory. */
line_tree *line_tree_new(const mesh *m, error *e);
void line_tree_free(line_tree *t);          /* accepts NULL */
size_t line_tree_bytes(const line_tree *t); /* NULL: 0 */

/* Intersections of a line, seen from one of its points. */
typedef struct line_crossings {
    /* distances of the nearest crossings in both directions; INFINITY: there is none */
    double ahead, behind;
    /* sum over the crossings ahead: +1 where the line leaves through a triangle, -1 where it enters */
    int winding;
} line_crossings;

#define LINE_TREE_NO_TRIANGLE UINT32_MAX
/* Intersects the line through p in the direction of the unit vector d with all triangles except `skip` (or LINE_TREE_NO_TRIANGLE). */
line_crossings line_tree_cross(const line_tree *t, vec3 p, vec3 d, uint32_t skip);

#endif
