/* cell_parts: the area of the surface in a cell within which it bends, computed from parts of the cell. Private to
 * surface.c.
 *
 * F is sampled at the corners of 4^3 parts. Each part is cut into tetrahedra, and the surface cuts these into
 * triangles, as for a whole cell. Roots and triangles are computed side by side.
 */
#ifndef HEXAD_SURFACE_CELL_PARTS_H
#define HEXAD_SURFACE_CELL_PARTS_H

#include "surface/cell_roots.h"

typedef struct triangulation {
    int count;
    corner at[FIELD_CELL_TRIANGLES][3];
    /* of the part of each triangle in the domain; points are drawn in proportion to it */
    double area[FIELD_CELL_TRIANGLES];
} triangulation;

enum { CELL_PARTS = 4 }; /* along each axis */

/* Maximum relative correction of the area of a triangle. */
#define CELL_EXCESS_LIMIT 0.2

/* Kuhn's decomposition: a tetrahedron for each order of the axes, along a path from corner 0 to 7. */
static const uint8_t cell_tetrahedra[6][4] = {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7},
                                              {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}};
/* The edges of a tetrahedron, as positions of their ends on the path. */
static const uint8_t cell_edges[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
/* For each set of corners inside the solid (bits): the number of edges that the surface crosses, and these edges in
 * order around the section. */
static const uint8_t cell_rings[16][5] = {{0},
                                          {3, 0, 1, 2},
                                          {3, 0, 3, 4},
                                          {4, 1, 2, 4, 3},
                                          {3, 1, 3, 5},
                                          {4, 0, 2, 5, 3},
                                          {4, 0, 4, 5, 1},
                                          {3, 2, 4, 5},
                                          {3, 2, 4, 5},
                                          {4, 0, 1, 5, 4},
                                          {4, 0, 3, 5, 2},
                                          {3, 1, 3, 5},
                                          {4, 1, 3, 4, 2},
                                          {3, 0, 3, 4},
                                          {3, 0, 1, 2},
                                          {0}};

/* Returns the corners of a tetrahedron that are inside, as bits, from the corners of its cell that are inside. */
static inline unsigned cell_inside(unsigned corners, int tetrahedron)
{
    unsigned inside = 0;
    for (int v = 0; v < 4; v++) inside |= (corners >> cell_tetrahedra[tetrahedron][v] & 1) << v;
    return inside;
}

/* Computes for each triangle the area of the surface above it, estimated from the normals of the corners, and the
 * excess over the area of the flat triangle, relative to the latter; 0 if the normals are unusable. */
void cell_measure_triangles(const triangulation *t, double area[], double excess[]);

/* Returns the area of the surface above the triangles of all parts; 0 if F is undefined. `lacking`: NULL, or
 * receives the first FIELD_CELL_TRIANGLES of these triangles, for a cell without triangles of its own. */
double cell_parts_area(const field *f, const field_cell *cell, triangulation *lacking);

/* cell_parts_area with half as many parts along each axis: a quarter of the computation, for a slightly smaller
 * area. */
double cell_half_parts_area(const field *f, const field_cell *cell);

#endif
