// SPDX-License-Identifier: Apache-2.0
/* planar_cells: the Voronoi cells that follow from the points alone, without the triangles of the surface.
 *
 * Where a surface is smooth between its points, the restricted Voronoi cell of a point is the polygon that the
 * bisectors bound in its tangent plane (voronoi_star_planar).
 *
 *          n2       n1
 *            .-----.
 *           /       \
 *     n3   |    p    |   n6     each side is on the bisector of p and a neighbour;
 *           \       /           `farthest` is the distance of a corner from p
 *            '-----'
 *          n4       n5
 *
 * A cell is certain if
 * - the point, and all points within twice the radius of the cell, are plain: in the interior of one patch of
 *   one piece, with one oriented normal;
 * - none of these is on an opposite wall (VORONOI_OPPOSITE_COSINE);
 * - the normals of the points that can bound the cell differ from its own by less than 37 degrees;
 * - each of its sides is longer than a bound, and every other point misses the cell by as much, so that both points
 *   of a side, and both cells, agree. The bound is 1 minus the smallest cosine of these normals, in spacings, and at
 *   least 0.0005. With half of it, cells and triangles differ in a few sides of meshes with 50 000 points;
 * - all its corners are nearer than PLANAR_CELLS_FARTHEST: no hole is near.
 * Areas, sides and distances are those on the surface: the neighbours' normals give its bend to second order.
 * World units. Any thread, for different points.
 */
#ifndef HEXAD_SAMPLING_MEASURES_PLANAR_CELLS_H
#define HEXAD_SAMPLING_MEASURES_PLANAR_CELLS_H

#include <stdbool.h>
#include <stdint.h>

#include "sampling/measures/sites.h"
#include "sampling/voronoi/partitions.h"
#include "sampling/voronoi/voronoi.h"

/* Maximum distance of a corner of a certain cell from its point, in spacings. In an ideal packing it is 0.58,
 * at a vacancy 1. */
#define PLANAR_CELLS_FARTHEST 0.9

/* Minimum cosine between the normals of the points of two certain cells with a common side: 37 degrees. */
#define PLANAR_CELLS_COSINE 0.8

/* The unit of planar_cell.bend is the area of the cell over this. */
#define PLANAR_BEND 65535.0

/* planar_cell.straight of a perfect packing: sqrt(3) / 2. */
#define PLANAR_STRAIGHT 0.86602540378443865

/* A cell, and sums over its sides. Distances of pairs are divided by the mean of their spacings. Values near
 * those of a perfect packing are stored as differences from these, for the precision of floats. */
typedef struct planar_cell {
    float farthest;    /* the largest distance of a corner from the point */
    float edge, edge2; /* sums of the distances of the neighbours minus 1, and of the squares of these */
    /* sum of distance times length of side over 4, divided by the spacing squared, minus PLANAR_STRAIGHT */
    float straight;
    float growth2; /* sum of the squares of the change of spacing per distance */
    uint16_t bend; /* what the bend of the surface adds to the area, over PLANAR_BEND */
    uint8_t degree;
    bool certain : 1;  /* if not, all other members but `measured` are 0 */
    bool measured : 1; /* computed from the triangles of the surface */
} planar_cell;

/* voronoi_gather_listed for the partition's point `at`. */
void planar_cells_gather(const partition *part, uint32_t at, uint32_t first, voronoi_listed *out);

typedef struct planar_points {
    const partition *part; /* its flags are 0 for plain points; NULL: all points are plain */
    const uint32_t *piece; /* of each point of the set; NULL: all are of one piece */
    /* of the energy; 0: packing_support of the mean spacing of a pair, and its energy is multiplied by the square of the
     * mean over the spacing of the point */
    double support;
    bool
        borders; /* the surface may end near plain points: the angle between two neighbours is at most 90 degrees */
} planar_points;

/* Sums over the pairs of a point with its list. */
typedef struct planar_pairs {
    bool
        alike; /* the point and those of its list are plain, of one piece and not on opposite walls; if not, the sums
                 * are invalid */
    double nearest; /* smallest distance over the mean spacing of a pair */
    double energy;
} planar_pairs;

/* For `count` of the partition's own points, at most PLANAR_CELLS_ONCE: the sums of their pairs, and unless `cell` is NULL
 * their cells, and of certain ones the areas. In single precision, relative to each point. */
#define PLANAR_CELLS_ONCE 8
void planar_cells_at(const planar_points *of, const uint32_t *at, size_t count, planar_cell *cell,
                     double *area, planar_pairs *pairs);

/* The mean of `value` (of each point of the set) over the partition's own point `at`, whose cell is certain, and
 * its neighbours. */
double planar_cell_mean(const partition *part, bool borders, uint32_t at, const double *value);

#endif
