// SPDX-License-Identifier: Apache-2.0
/* cell_euler: what the surface in a cell adds to the Euler characteristic of the surface, by the signs of F at the
 * corners. Private to surface.c.
 *
 * Kuhn's tetrahedra divide cells of one size in a consistent way. The sections of the surface with them are the faces of
 * a polyhedron, sections with their triangles its sides, and sections with their edges its corners. A corner or side that
 * several cells share counts for each by its share. */
#ifndef HEXAD_SURFACE_SCAN_CELL_EULER_H
#define HEXAD_SURFACE_SCAN_CELL_EULER_H

#include <stdint.h>

#include "surface/field/field.h"

/* The sum over all cells of a surface is this multiple of its Euler characteristic. */
#define CELL_EULER_UNIT 4

/* Sets the value of a cell for each set of corners inside the solid, as bits. */
void cell_euler_fill(int8_t table[256]);

/* The value of a cell on a surface that ends at the faces of `within`. That box must be smaller than the domain by a
 * little, so that shared sides within it are not those of the last cells. */
int cell_euler_cut(const field_cell *cell, bbox within);

#endif
