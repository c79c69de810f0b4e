// SPDX-License-Identifier: Apache-2.0
/* planar_cells: the Voronoi cells that follow from the points alone, without the surface's triangles.
 *
 * Where a surface is smooth and its points are near each other, the restricted Voronoi cell of a point is the
 * polygon that the bisectors bound in its tangent plane (voronoi_star_planar). A cell is certain if
 * - the point and all points around it are plain: in the interior of one patch, with one oriented normal, and
 *   of one piece;
 * - the normals around it differ by less than 26 degrees, and no wall of another direction is near;
 * - each of its sides is longer than, and every other point is farther than, the bounds of voronoi.c;
 * - all its corners are nearer than PLANAR_CELLS_FARTHEST, so that no hole is near.
 * Lengths and areas are those on the surface to second order in the bend of the normals (Euler's method for
 * the triangles of neighbours: the slope of the surface over a triangle is linear between its corners).
 * World units. Pure functions, any thread.
 */
#ifndef HEXAD_SAMPLING_MEASURES_PLANAR_CELLS_H
#define HEXAD_SAMPLING_MEASURES_PLANAR_CELLS_H

#include "base/core/error.h"
#include "sampling/measures/restricted_voronoi.h"
#include "sampling/voronoi/partitions.h"

/* Maximum distance of a corner from its point, in spacings. It is 0.58 in an ideal packing, and 1 at a
 * vacancy. */
#define PLANAR_CELLS_FARTHEST 0.9

typedef struct planar_cells {
    size_t count;
    bool *certain;   /* of each point: its cell is certain */
    float *area;     /* of the cell of each point */
    float *farthest; /* largest distance of a corner of the cell from the point */
    voronoi_side *side; /* of certain cells, each from the point of the lower index, in a fixed order */
    size_t side_count, side_room;
} planar_cells;

/* Allocates the arrays for `count` points. Free *out also after failure. Error: limit_memory. */
bool planar_cells_new(size_t count, planar_cells *out, error *e);
void planar_cells_free(planar_cells *c); /* accepts a zeroed object */

/* Maximum number of sides of a certain cell. */
enum { PLANAR_CELLS_SIDES = 12 };

/* Computes the cell of the partition's own point `at`, and sets the values of that point; writes its sides to
 * points of a higher index to `side`, and returns their number. `piece`: of each point of the set; NULL: they
 * are of one piece. The flags of the partition are 0 for plain points; NULL: all are plain. */
int planar_cells_set(planar_cells *c, const partition *part, const uint32_t *piece, uint32_t at,
                     voronoi_side side[PLANAR_CELLS_SIDES]);

/* Makes room for `count` more sides. Error: limit_memory. */
bool planar_cells_reserve(planar_cells *c, size_t count, error *e);

/* Keeps the sides between two certain cells. */
void planar_cells_keep_certain(planar_cells *c);

#endif
