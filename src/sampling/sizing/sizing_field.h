// SPDX-License-Identifier: Apache-2.0
/* sizing_field: the spacing that a graded job requests at each place of a surface, scaled to a given number
 * of points.
 *
 * The request gives a spacing from curvature or from a painted map. Curvature is averaged over a distance
 * proportional to the spacing itself; a few iterations find both. The field is clamped to bounds, and grows
 * by at most `gradation` per unit of distance along the surface, so that adjacent cells differ little. A
 * spacing from curvature also has a bounded second derivative, which a packing can follow: where it varies
 * within a spacing, as from the noise of a scan, it is averaged. The request is multiplied by the constant
 * with which the ideal cells (packing_cell_area) fill the surface with exactly the count.
 *
 * Thin parts and narrow gaps bound the spacing from above by a multiple of their size (feature_size),
 * independent of the scale. Curves may have a fraction of the spacing around them; the spacing grows from
 * there with the distance.
 *
 * The field is stored as nodes, one per cube that the surface crosses, with the spacing and its gradient. It
 * is interpolated between nodes, so that variations within a cell of the surface are averaged. World space
 * and world units. Immutable after construction, any thread.
 */
#ifndef HEXAD_SAMPLING_SIZING_SIZING_FIELD_H
#define HEXAD_SAMPLING_SIZING_SIZING_FIELD_H

#include "base/core/error.h"
#include "base/core/rng.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "sampling/sizing/sizing_field_params.h"
#include "sampling/sizing/spacing_request.h"
#include "surface/scan/surface.h"

typedef struct sizing_field sizing_field;

/* Makes the field for `count` points on the scanned surface. 0: for as many as the request and the features
 * need, with a scale of 1; if neither requests a spacing, it is max_spacing. The caller frees the result.
 * Errors: spec_invalid (the count is not possible within the bounds), input_unsupported (a value of the map
 * is not a spacing), limit_memory, cancelled. Deterministic for any number of threads. */
sizing_field *sizing_field_new(const field *f, const surface *scan, const sizing_field_params *params,
                               size_t count, threads *pool, error *e);
void sizing_field_free(sizing_field *g);

/* A copy for another count: all spacings are multiplied by one factor, within their bounds. Error:
 * limit_memory. */
sizing_field *sizing_field_rescale(const sizing_field *g, size_t cells, size_t count, error *e);

/* The requested spacing at x, which is on the surface, and its gradient (or NULL), interpolated between
 * nodes. */
double sizing_field_spacing(const sizing_field *g, vec3 x, vec3 *gradient);

/* A spacing that is reduced by at most this fraction follows the map. */
#define SIZING_FIELD_CUT 0.05

/* Properties of the field: the factor of the request that meets the count, and the range of spacings. */
typedef struct sizing_field_facts {
    double scale, least, largest;
    double points; /* number of points for the field, not rounded */
    double
        permitted_ratio; /* with a ratio: the ratio of spacings that the curvatures have before growth and smoothing */
    spacing_request_features features; /* with feature_ratio */
    /* With a map: fraction of the points whose spacing is more than SIZING_FIELD_CUT below the map's, times `scale` and
     * within the bounds; and the largest such fraction of a spacing. */
    double cut_share, largest_cut;
} sizing_field_facts;
sizing_field_facts sizing_field_describe(const sizing_field *g);

/* The point density, cumulated over the cells like area_before. `g` NULL: cumulated area. */
const double *sizing_field_weight(const sizing_field *g, const surface *scan);

/* Draws a point near the surface by the density of points; `where` in [0, 1) in the order of the cells. `g`
 * NULL: by area. See surface_point. */
vec3 sizing_field_draw(const sizing_field *g, const surface *scan, double where, rng *r,
                       surface_last_cell *last);

#endif
