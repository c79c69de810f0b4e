// SPDX-License-Identifier: Apache-2.0
/* voronoi_cells: the Voronoi cells of all points on a surface: those that follow from the points alone with
 * certainty (planar_cells.h), and all others from the triangles of the surface (restricted_voronoi.h).
 *
 * A certain cell is withdrawn, and computed from triangles, if a place of the surface beyond its corners belongs to
 * it, or if it has a side with a point of another normal: a narrow fold has no points of its own. This is repeated
 * until no more are found.
 * The cells of a piece must add up to its area. Otherwise a part of it has no points, or bends between them, and all
 * its cells are computed from triangles. Private to measures.c.
 */
#ifndef HEXAD_SAMPLING_MEASURES_VORONOI_CELLS_H
#define HEXAD_SAMPLING_MEASURES_VORONOI_CELLS_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/measures/facets.h"
#include "sampling/measures/pair_measures.h"
#include "sampling/measures/planar_cells.h"
#include "sampling/measures/restricted_voronoi.h"

typedef struct voronoi_cells {
    size_t count, certain_count;
    planar_cell *planar; /* of each point; certain for certain_count of them */
    const double *area;  /* of each point's cell */
    cell_list *near;     /* of the points */
    /* of the other cells: the sides between them and all cells, and over all cells the distances of each
     * patch */
    restricted_voronoi exact;
} voronoi_cells;

typedef struct voronoi_cells_input {
    facets *surface;                  /* its hierarchy is built as far as it is needed */
    bool whole;                       /* the hierarchy contains all items already */
    bool exact;                       /* all cells are computed from triangles */
    double *area;                     /* of each point: receives the area of its cell */
    const pair_measures_input *pairs; /* its sites' `near` is not used */
} voronoi_cells_input;

/* `energy` and `pairs`: see pair_measures_take, with which the neighbour lists are shared. Free *out also after
 * failure. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool voronoi_cells_build(const voronoi_cells_input *in, threads *pool, pair_energies *energy, measures *pairs,
                         voronoi_cells *out, error *e);
void voronoi_cells_free(voronoi_cells *c); /* accepts a zeroed object */

#endif
