// SPDX-License-Identifier: Apache-2.0
/* cell_roots: the points where the surface crosses the edges of cells and of their Kuhn tetrahedra. Private
 * to surface.c and cell_parts.c.
 *
 * A root of F is found by alternating regula falsi (Illinois variant) and Newton steps, always between an end
 * inside the solid and an end outside. Consecutive cells share edges: a group of cells computes each root
 * once, sixteen at a time.
 */
#ifndef HEXAD_SURFACE_SCAN_CELL_ROOTS_H
#define HEXAD_SURFACE_SCAN_CELL_ROOTS_H

#include "surface/field/field.h"

/* Maximum Newton step, in cells, after which a root is accepted: the remaining error is half its square over
 * the radius of curvature. */
#define CELL_LAST_STEP 1.5e-3
/* Maximum number of steps to a root; usually a few suffice. */
#define CELL_ROOT_STEPS 24

/* A corner of a triangle. */
typedef struct corner {
    vec3 position, normal;
    bool smooth; /* it lies on the surface and has a normal */
} corner;

enum { CELL_EDGES = 19, ROOT_GROUP_CELLS = 32 };

/* An edge between two corners of a cell: the corner inside the solid and the one outside. */
typedef struct crossed_edge {
    uint8_t inside, outside;
} crossed_edge;

/* The triangles in which the surface cuts the tetrahedra of a cell (surface/field/kuhn.h), by the edges on
 * which their corners lie. `inside`: bit k is set if corner k is inside the solid. Returns their number. */
int cell_cut(unsigned inside, crossed_edge out[FIELD_CELL_TRIANGLES][3]);

/* Lists the edges with F of different sign at their ends; returns their number. */
int cell_crossed_edges(const field_cell *cell, crossed_edge out[CELL_EDGES]);

/* Finds the root on one edge of a cell. `is_straight`: F is assumed to be linear along the edge, and is not
 * evaluated. */
void cell_find_root(const field *f, const field_cell *cell, int inside, int outside, bool is_straight,
                    corner *out);

/* The crossed edges of up to ROOT_GROUP_CELLS cells. */
typedef struct root_group root_group;

root_group *root_group_new(void);
void root_group_free(root_group *g);
void root_group_clear(root_group *g);

/* Adds an edge and returns the place of its root, which root_group_find computes. For an edge that cells
 * share, the ends and the values of F at the ends are equal to the last bit. */
const corner *root_group_add(root_group *g, const field_cell *cell, crossed_edge edge);

/* Computes the roots of all edges of the group. */
void root_group_find(root_group *g, const field *f);

#endif
