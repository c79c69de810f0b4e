/* sizing_field_params: which spacing a job asks for by place. */
#ifndef HEXAD_SIZING_SIZING_FIELD_PARAMS_H
#define HEXAD_SIZING_SIZING_FIELD_PARAMS_H

#include <stddef.h>

#include "sizing/curve_distance.h"

typedef enum sizing_field_kind {
    SIZING_FIELD_CHORD,   /* sqrt(8 chord_error / max(|kappa1|, |kappa2|)) */
    SIZING_FIELD_RATIO,   /* kappa^-exponent, within ratio : 1 */
    SIZING_FIELD_SPACING, /* the value of a map */
    SIZING_FIELD_DENSITY, /* points per unit area, the value of a map */
    SIZING_FIELD_EVEN     /* the same everywhere, but for features */
} sizing_field_kind;

typedef struct sizing_field_params {
    sizing_field_kind kind;
    double chord_error;
    /* The distance over which curvature is taken (scaled_curvature): in spacings of the place itself, or in world units.
     * Both 0: the field's own, at points. */
    double scale_spacings, scale_world;
    double ratio, exponent;
    /* the map's value at x; NaN where it has none, and asks for no points then */
    double (*map)(const void *context, vec3 x);
    const void *map_context;
    double feature_ratio; /* the spacing is at most this times the feature size (feature_size); 0: no bound */
    double feature_floor; /* but features never ask for less than this, > 0 */
    /* On curves the spacing is this share of that around, 0 < x <= 1, and grows from there by `gradation`, which is no
     * INFINITY then. NULL: curves are like the rest. Joined, not owned, and needed as long as the sizing field. */
    const curve_distance *curves;
    double curve_share;
    double min_spacing, max_spacing; /* 0: no bound */
    double gradation;                /* > 0; INFINITY: no bound */
    size_t memory_limit;             /* bytes that making it may take; 0: no bound */
} sizing_field_params;

#endif
