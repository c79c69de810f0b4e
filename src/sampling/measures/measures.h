// SPDX-License-Identifier: Apache-2.0
/* measures: the quality of a result, over all of its points and all of its surface (doc/report.md defines
 * each measure).
 *
 * No point is left out. The degree and the cell of a point are those in the Voronoi diagram restricted to the
 * surface (restricted_voronoi.h). Distances are divided by the requested spacing; for a pair, by the mean of
 * both. If no spacing is requested (`achieved`), the spacing of a point is the mean local spacing of the
 * point and its neighbours.
 */
#ifndef HEXAD_SAMPLING_MEASURES_MEASURES_H
#define HEXAD_SAMPLING_MEASURES_MEASURES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/measures/facets.h"

typedef struct measures_input {
    facets_input surface;
    /* places of the surface that the triangles or cells leave out; they count in coverage */
    const vec3 *lost_place;
    size_t lost_places;
    size_t count; /* points, at least 1 */
    const vec3 *position;
    const double *spacing; /* requested at each, > 0 */
    double h;              /* spacing of the ideal even packing */
    /* requested at a place of the surface; NULL: h everywhere */
    double (*spacing_at)(const void *context, vec3 x);
    const void *spacing_context;
    bool sized;       /* energies use the support for the spacing of each pair, not that for h */
    bool achieved;    /* no spacing is requested: amplitudes grade the points */
    const bool *kept; /* per point: given; distances between two such points are not measured. NULL: none */
    /* A copy of each point for each patch on which it lies; the first `count` are the points in their order
     * (solver_patch_points). */
    size_t copy_count;
    const vec3 *copy_normal;           /* NULL: the normals are those of the nearest triangles */
    const uint32_t *copy_point;        /* NULL: copy i is point i */
    const uint32_t *copy_patch;        /* NULL: one patch */
    const uint8_t *copy_flags;         /* of point_flags.h; NULL: none */
    const uint32_t (*patch_labels)[2]; /* see sites.h; NULL: no labels */
    const double *piece_euler; /* Euler characteristic of each piece, NAN: unknown; NULL: all are unknown */
    /* Every cell is computed from the surface's triangles; otherwise only those that do not follow from the
     * points alone with certainty (planar_cells.h). */
    bool exact;
    /* Receive for each point, or NULL: its piece of the surface, and the spacing by which its distances
     * are divided. */
    uint32_t *out_piece;
    double *out_spacing;
    /* With `exact`, or NULL: receives for each point the area of its cell, multiplied by a factor for each piece:
     * the sum of a piece's values is its area. */
    double *out_weight;
} measures_input;

/* All are NAN if no point or pair has a value. */
typedef struct measures {
    double certain_share; /* of the points: their cells follow from the points alone */
    double hex_fraction, edge_cv, area_cv;
    double edge_skipped_share; /* of the pairs of neighbours: across a fold, without part in edge_cv */
    double energy_excess, disorder;
    double min_spacing_ratio, close_share;
    size_t coincident;
    double coverage, missing_share;
    size_t parts_without_points;
    double empty_area_share;    /* fraction of the area in pieces without points */
    double area_without_points; /* area of all pieces without points, also of those too small for one */
    double cell_area;           /* of all cells, world units squared */
    double unmeasured_share, defect_share;
    size_t thin_count; /* points with a point on an opposite wall nearer than 1.2 spacings */
    /* at most MEASURES_THIN_SHARE of the points would be on such walls if the spacing were multiplied by
     * this; at most 1 */
    double thin_factor;
    double euler; /* sum of (6 - degree) / 6 over inner points and of (4 - degree) / 6 over points on
                   * borders */
    double grading_cv, grading_exponent;
} measures;

/* Maximum distance of close points, and of coincident points, as a fraction of the mean of their spacings. */
#define MEASURES_CLOSE 0.25
#define MEASURES_COINCIDENT 1e-3
/* Minimum share of points on walls thinner than the spacing for a note in the report. */
#define MEASURES_THIN_SHARE 0.02

/* `local` (count values) receives the local spacing sqrt(2 a / sqrt 3), with a the area of the point's cell
 * over the share of a full turn that the surface has at the point; of a point without a cell the requested
 * spacing. `degree` (count values, or NULL): the number of neighbours. `farthest` (one value for each patch):
 * the coverage of each patch. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool measures_take(const measures_input *in, threads *pool, double *local, double *degree, double *farthest,
                   measures *out, error *e);

#endif
