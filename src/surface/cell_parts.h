/* cell_parts: the area of the surface in a cell within which it bends, by the cell's parts. Private to surface.c.
 *
 * F is sampled at the corners of 4^3 parts, each is cut into tetrahedra and these into triangles, as a cell is; roots and
 * triangles are worked off side by side.
 */
#ifndef HEXAD_SURFACE_CELL_PARTS_H
#define HEXAD_SURFACE_CELL_PARTS_H

#include "surface/cell_roots.h"

typedef struct triangulation {
    int count;
    corner at[FIELD_CELL_TRIANGLES][3];
    double area[FIELD_CELL_TRIANGLES]; /* of what lies in the domain; points are drawn by it */
} triangulation;

enum { CELL_PARTS = 4 }; /* along each axis */

/* A triangle is corrected by this at most. */
#define CELL_EXCESS_LIMIT 0.2

/* Kuhn's decomposition: a tetrahedron for each order of the axes, along a path from corner 0 to 7. */
static const uint8_t cell_tetrahedra[6][4] = {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7},
                                              {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}};
/* The edges of a tetrahedron, by their ends' places on the path. */
static const uint8_t cell_edges[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
/* How many edges the surface passes and which, in the order of a ring round the section, by which corners are inside (bits). */
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

/* Which corners of a tetrahedron are inside, by those of its cell. */
static inline unsigned cell_inside(unsigned corners, int tetrahedron)
{
    unsigned inside = 0;
    for (int v = 0; v < 4; v++) inside |= (corners >> cell_tetrahedra[tetrahedron][v] & 1) << v;
    return inside;
}

/* The area of the surface above each triangle, estimated from the normals of its corners, and its excess over the flat
 * area, relative to that; 0 where the normals are not usable. */
void cell_measure_triangles(const triangulation *t, double area[], double excess[]);

/* The area above all parts' triangles; 0 where F is not defined. With `lacking` that receives the first of them. */
double cell_parts_area(const field *f, const field_cell *cell, triangulation *lacking);

/* The same by half as many parts along each axis: a fourth of the work, and little less of the area. */
double cell_half_parts_area(const field *f, const field_cell *cell);

#endif
