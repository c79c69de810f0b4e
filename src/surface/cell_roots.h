/* cell_roots: where the surface cuts the edges of cells, those of Kuhn's tetrahedra. Private to surface.c and cell_parts.c.
 *
 * A root is found by F itself: regula falsi (the Illinois way) and Newton's steps in turn, between an end inside and one outside,
 * never elsewhere. Cells that follow each other share edges: a group of them finds each root once, sixteen side by side.
 */
#ifndef HEXAD_SURFACE_CELL_ROOTS_H
#define HEXAD_SURFACE_CELL_ROOTS_H

#include "field/field.h"

/* Maximum Newton step, in cells, after which a root is accepted: the remaining error is half its square over the radius
 * of curvature. */
#define CELL_LAST_STEP 1.5e-3
/* Steps to a root: a few do. */
#define CELL_ROOT_STEPS 24

/* A corner of a triangle. */
typedef struct corner {
    vec3 position, normal;
    bool smooth; /* on the surface, with a normal */
} corner;

enum { CELL_EDGES = 19, ROOT_GROUP_CELLS = 32 };

/* An edge between two of a cell's corners, the one inside the solid first. */
typedef struct crossed_edge {
    uint8_t inside, outside;
} crossed_edge;

/* The edges at whose ends F has different signs; returns their number. */
int cell_crossed_edges(const field_cell *cell, crossed_edge out[CELL_EDGES]);

/* With `is_straight` F is taken for linear along the edge, and nothing is looked up. */
void cell_find_root(const field *f, const field_cell *cell, int inside, int outside, bool is_straight,
                    corner *out);

/* The crossed edges of up to ROOT_GROUP_CELLS cells. */
typedef struct root_group root_group;

root_group *root_group_new(void);
void root_group_free(root_group *g);
void root_group_clear(root_group *g);

/* Where the root of an edge is going to be. The ends of an edge that cells share agree to the last bit, and F there. */
const corner *root_group_add(root_group *g, const field_cell *cell, crossed_edge edge);

/* Finds the roots of all edges. */
void root_group_find(root_group *g, const field *f);

#endif
