/* line_tree: where straight lines cross the triangles of a mesh, found in a tree of boxes.
 *
 * Units: the mesh's. Ownership: line_tree_free; the mesh outlives the tree and keeps its arrays. Threads: crossing is
 * safe in any number.
 */
#ifndef HEXAD_MESH_LINE_TREE_H
#define HEXAD_MESH_LINE_TREE_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "triangles/mesh.h"

typedef struct line_tree line_tree;

/* Errors: limit_memory. */
line_tree *line_tree_new(const mesh *m, error *e);
void line_tree_free(line_tree *t);          /* NULL will do */
size_t line_tree_bytes(const line_tree *t); /* likewise */

/* What a line meets, seen from one of its points. */
typedef struct line_crossings {
    double ahead, behind; /* distance of the next crossing, INFINITY where there is none */
    int winding;          /* crossings ahead, +1 for leaving through a triangle and -1 for entering */
} line_crossings;

#define LINE_TREE_NO_TRIANGLE UINT32_MAX
/* The line through p along the unit vector d; the triangle `skip` does not count. */
line_crossings line_tree_cross(const line_tree *t, vec3 p, vec3 d, uint32_t skip);

#endif
