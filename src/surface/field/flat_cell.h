// SPDX-License-Identifier: Apache-2.0
/* flat_cell: the area of the surface in a cell in which F is nearly linear, from the values at the corners.
 *
 * F is linear in each tetrahedron of Kuhn's decomposition. The area of its zero set is the length of the
 * gradient times the derivative of the volume below the level with respect to the level. This derivative is a
 * quadratic B-spline of the four values. Source: Curry and Schoenberg 1966. For a ball with a radius of R
 * cells, the area is too small by the fraction 0.26 / R^2. Pure functions.
 */
#ifndef HEXAD_SURFACE_FIELD_FLAT_CELL_H
#define HEXAD_SURFACE_FIELD_FLAT_CELL_H

#include "surface/field/field.h"

/* The areas of `count` cells, world units squared. */
void flat_cell_areas(const field_cell *cells, size_t count, double *area);

/* Extends *box to the intersections of the surface with the edges of the cell. */
void flat_cell_widen(const field_cell *cell, bbox *box);

/* The fraction by which flat_cell_areas underestimates the area of the cell: a mean over all positions of the
 * surface in the cell, to second order in the cell size over the radii of curvature. It is valid for sums
 * over all cells of a surface. It is not valid for single cells, or where adjacent cells have exact areas.
 * `middle`: F at the centre of the cell, with its Hessian; the gradient is not 0. */
double flat_cell_shortage(const field_cell *cell, const field_sample *middle);

#endif
