// SPDX-License-Identifier: Apache-2.0
/* packing: the formulas of the ideal hexagonal packing, in which six neighbours at one distance h, the
 * spacing, surround each point. Pure functions. Lengths, areas and counts are the caller's units. */
#ifndef HEXAD_GEOMETRY_SPACE_PACKING_H
#define HEXAD_GEOMETRY_SPACE_PACKING_H

#include <math.h>

/* The spacing of `count` points on an area. With count = 1, `area` is the area of one Voronoi cell. With
 * area = 1, `count` is a density. */
static inline double packing_spacing(double area, double count)
{
    return sqrt(2 * area / (sqrt(3) * count));
}

/* The number of points with this spacing on an area; not rounded. */
static inline double packing_count(double area, double spacing)
{
    return 2 * area / (sqrt(3) * spacing * spacing);
}

/* The area of the Voronoi cell of a point: a hexagon whose opposite sides have the distance of one
 * spacing. */
static inline double packing_cell_area(double spacing)
{
    return sqrt(3) / 2 * spacing * spacing;
}

/* The support of the potential at which the packing has the ideal energy. It contains the six nearest
 * neighbours; the next six are at its boundary. */
static inline double packing_support(double spacing)
{
    return sqrt(3) * spacing;
}

/* Distance halfway between the first shell of six neighbours, at one spacing, and the second shell, at the
 * support. */
static inline double packing_first_shell(double spacing)
{
    return 0.5 * (spacing + packing_support(spacing));
}

/* The number of points on an area whose packing has this support; not rounded. */
static inline double packing_count_of_support(double area, double support)
{
    return 6 * area / (sqrt(3) * support * support);
}

/* Number of neighbours of a point of the hexagonal packing. */
enum { PACKING_IDEAL_DEGREE = 6 };

#endif
