// SPDX-License-Identifier: Apache-2.0
/* cell_parts: the area of the surface in a cell within which it bends, computed from parts of the cell.
 * Private to surface.c.
 *
 * F is sampled at the corners of 4^3 parts. Each part is cut into tetrahedra, and the surface cuts these into
 * triangles, as for a whole cell. Roots and triangles are computed side by side.
 */
#ifndef HEXAD_SURFACE_SCAN_CELL_PARTS_H
#define HEXAD_SURFACE_SCAN_CELL_PARTS_H

#include "surface/scan/cell_roots.h"

typedef struct triangulation {
    int count;
    corner at[FIELD_CELL_TRIANGLES][3];
    /* area of the part of each triangle inside the domain; points are drawn in proportion to it */
    double area[FIELD_CELL_TRIANGLES];
} triangulation;

enum { CELL_PARTS = 4 }; /* number of parts along each axis */

/* Maximum relative correction of the area of a triangle. */
#define CELL_EXCESS_LIMIT 0.2

/* Computes for each triangle the area of the surface above it, estimated from the normals of the corners, and
 * the excess over the area of the flat triangle, relative to the latter; 0 if the normals are unusable. */
void cell_measure_triangles(const triangulation *t, double area[], double excess[]);

/* Returns the area of the surface above the triangles of all parts; 0 if F is undefined. `lacking`: NULL,
 * or for a cell without triangles of its own: receives the first FIELD_CELL_TRIANGLES of the parts'
 * triangles. */
double cell_parts_area(const field *f, const field_cell *cell, triangulation *lacking);

/* cell_parts_area with half as many parts along each axis: a quarter of the computation, for a slightly
 * smaller area. */
double cell_half_parts_area(const field *f, const field_cell *cell);

#endif
