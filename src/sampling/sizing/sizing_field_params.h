// SPDX-License-Identifier: Apache-2.0
/* sizing_field_params: the spacing that a job requests. */
#ifndef HEXAD_SAMPLING_SIZING_SIZING_FIELD_PARAMS_H
#define HEXAD_SAMPLING_SIZING_SIZING_FIELD_PARAMS_H

#include <stddef.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/sizing/curve_distance.h"

typedef enum sizing_field_kind {
    SIZING_FIELD_CHORD,   /* sqrt(8 chord_error / max(|kappa1|, |kappa2|)) */
    SIZING_FIELD_RATIO,   /* kappa^-exponent, within the ratio */
    SIZING_FIELD_SPACING, /* value of a map */
    SIZING_FIELD_DENSITY, /* points per unit area, value of a map */
    SIZING_FIELD_EVEN     /* uniform, except for features */
} sizing_field_kind;

typedef struct sizing_field_params {
    sizing_field_kind kind;
    double chord_error;
    /* Distance over which curvature is averaged (scaled_curvature): in local spacings, or in world units.
     * Both 0: the curvature at points. */
    double scale_spacings, scale_world;
    /* Computes the curvatures at points of the surface, in two arrays, where the scale is 0. NaN: it is that of the
     * field. NULL: it is that of the field everywhere. */
    bool (*curvature)(const void *context, size_t count, const vec3 *position, const vec3 *normal,
                      const uint32_t *patch, threads *pool, double *kappa1, double *kappa2, error *e);
    const void *curvature_context;
    double ratio, exponent;
    /* value of the map at x; NaN: it has none, and no points are requested there */
    double (*map)(const void *context, vec3 x);
    const void *map_context;
    double feature_ratio; /* maximum spacing over the feature size (feature_size); 0: no bound */
    double feature_floor; /* minimum spacing that features can request, > 0 */
    /* On curves the spacing is curve_share, 0 < curve_share <= 1, times that around them, and grows from
     * there by `gradation`, which must be finite then. NULL: curves have no spacing of their own. Joined; not
     * owned, outlives the sizing field. */
    const curve_distance *curves;
    double curve_share;
    double min_spacing, max_spacing; /* 0: no bound */
    double gradation;                /* > 0; INFINITY: no bound */
    size_t memory_limit;             /* for the construction, bytes; 0: no bound */
} sizing_field_params;

#endif
