// SPDX-License-Identifier: Apache-2.0
/* restricted_voronoi: the Voronoi diagram of points, restricted to the surface on which they lie.
 *
 * The cell of a point consists of the places of its piece whose nearest point, among the points of that piece
 * that are not of an opposite wall, is this one. Triangles are clipped by the bisectors of the points near
 * them (Yan, Levy, Liu, Sun and Wang 2009, "Isotropic remeshing with fast and exact computation of restricted
 * Voronoi diagram"). Those points are found by descending the hierarchy of facets: a node keeps the points
 * that can be nearest to a place in its sphere.
 */
#ifndef HEXAD_SAMPLING_MEASURES_RESTRICTED_VORONOI_H
#define HEXAD_SAMPLING_MEASURES_RESTRICTED_VORONOI_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/measures/facets.h"
#include "sampling/measures/planar_cells.h"
#include "sampling/measures/sites.h"

/* Neighbours are across a fold if the middle of the straight line between them is farther from the surface than this
 * fraction of the mean of their spacings. That of a line no longer than VORONOI_FOLD_LINE spacings is not. */
#define VORONOI_FOLD 0.5
#define VORONOI_FOLD_LINE (2 * VORONOI_FOLD)

/* Two cells that share a side. */
typedef struct voronoi_side {
    uint32_t a, b; /* a < b */
    double length; /* of all sides that they share */
    /* Distance of the side from the middle of the straight line between the points, in spacings; 0 if the line is no
     * longer than VORONOI_FOLD_LINE spacings */
    float middle;
} voronoi_side;

typedef struct restricted_voronoi {
    voronoi_side *side; /* each pair of cells once, in a fixed order */
    size_t side_count;
    /* per patch: the largest distance of a place from its nearest point, over the spacing of that point */
    double *farthest;
    double missing; /* area of the places farther than COVERAGE_MISSING spacings from all points that are not
                     * on an opposite wall */
    /* certain cells, also more than once, that contain places farther from their points than their corners, or have
     * sides with points of other normals */
    uint32_t *exceeded;
    size_t exceeded_count, exceeded_room;
} restricted_voronoi;

/* Which cells are computed. */
typedef struct voronoi_wanted {
    /* of each point: no cell is computed if this one is certain or measured; NULL: all are */
    const planar_cell *known;
    cell_list *list; /* of the points whose cells are computed; NULL: of all or none */
    bool again;      /* some cells are measured: places without candidates are counted already */
    double beyond;   /* a place can belong to a cell whose point is farther than the nearest one by this */
} voronoi_wanted;

/* Whether a cell that is wanted may have a place in a sphere. `nearest`: distance of its centre from the nearest of
 * all points. It is valid unless voronoi_is_apart. */
bool voronoi_reaches(const voronoi_wanted *w, vec3 centre, double radius, double nearest);

/* Whether point i is of another piece than an item, or on a wall opposite to it, as far as its normal is known. The
 * places of the item can then belong to far points. */
bool voronoi_is_apart(const sites *s, uint32_t i, const facets_item *item);

/* `area` (a value for each point) receives the areas of the cells that are computed. Areas of known cells, sides
 * between two of them, sides of measured cells and their distances are not computed. The hierarchy of `f` must contain the items that the
 * other cells may reach. Deterministic for any number of threads. Release *out also after failure. Errors:
 * limit_memory, cancelled. */
bool restricted_voronoi_build(const facets *f, const sites *s, const voronoi_wanted *wanted, threads *pool,
                              double *area, restricted_voronoi *out, error *e);
void restricted_voronoi_free(restricted_voronoi *v); /* accepts a zeroed object */

#endif
