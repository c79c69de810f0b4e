/* flat_cell: the area of the surface in a cell in which F is all but linear, from the corners' values alone.
 *
 * In each tetrahedron of Kuhn's decomposition F is linear: the area of its zero set is the length of the gradient times the
 * change of the volume below it with F, which is a quadratic B-spline of the four values. Source: Curry and Schoenberg 1966.
 * Of a ball of R cells .26 / R^2 of the area is missing.
 */
#ifndef HEXAD_FIELD_FLAT_CELL_H
#define HEXAD_FIELD_FLAT_CELL_H

#include "field/field.h"

/* Those of so many cells, world units squared. */
void flat_cell_areas(const field_cell *cells, size_t count, double *area);

/* Widens *box by where the surface passes the cell's edges. */
void flat_cell_widen(const field_cell *cell, bbox *box);

/* By what share such an area is too small, in the mean over all places of the surface in the cell: to the second order in the cell's size
 * over the radii of curvature. It says nothing of one cell: sums over all cells of a surface are right, and not where others, whose areas
 * are exact, lie beside these. `middle`: F in the cell's middle, with its Hessian; its gradient is not 0. */
double flat_cell_shortage(const field_cell *cell, const field_sample *middle);

#endif
