// SPDX-License-Identifier: Apache-2.0
/* spacing_request: the spacing that a job requests at each cell of the surface, before it is scaled to a
 * count.
 *
 * For a painted map it is the value of the map. From curvature, it follows from the field's curvature at a
 * point of the cell, or from that over a distance (scaled_curvature), which is computed at octaves of the
 * mean spacing and interpolated. World space and world units. One thread.
 */
#ifndef HEXAD_SAMPLING_SIZING_SPACING_REQUEST_H
#define HEXAD_SAMPLING_SIZING_SPACING_REQUEST_H

#include <math.h>
#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/sizing/cell_samples.h"
#include "sampling/sizing/sizing_field_params.h"
#include "surface/scan/surface.h"

/* Number of distances over which curvature is computed, an octave apart. */
#define SPACING_REQUEST_OCTAVES 6
/* Maximum bytes per cell: sample, value, curvatures, cap. */
#define SPACING_REQUEST_CELL_BYTES \
    (sizeof(vec3[2]) + sizeof(bool) + sizeof(double[1 + SPACING_REQUEST_OCTAVES + 1]))

typedef struct spacing_request {
    const sizing_field_params *params; /* not owned, as the surface */
    const surface *scan;
    double even; /* spacing of the uniform packing */
    cell_samples samples;
    double *value;       /* curvature at the point, or value of the map; NaN: unknown */
    double *curvature;   /* SPACING_REQUEST_OCTAVES per cell; NULL: the curvature at the point is used */
    double *feature;     /* feature size of each cell; NULL: unused */
    double fine_share;   /* fraction of the area with more curvature than the fine end of the ratio */
    double widest_ratio; /* largest ratio that the last curvatures permit */
} spacing_request;

bool spacing_request_is_map(const sizing_field_params *params);

/* Whether a map requests points at cell k. */
static inline bool spacing_request_is_painted(const spacing_request *r, size_t k)
{
    return r->params->kind == SIZING_FIELD_DENSITY ? r->value[k] > 0 : isfinite(r->value[k]);
}

/* Whether the request at a place depends on that place only, not on its neighbourhood. */
bool spacing_request_is_at_points(const sizing_field_params *params);

/* Whether the request depends on the spacing, so that both have to be found together. */
bool spacing_request_is_implicit(const sizing_field_params *params);

/* Samples all cells. Free *r also after failure. Errors: limit_memory, cancelled. */
bool spacing_request_begin(spacing_request *r, const surface *scan, const sizing_field_params *params,
                           double even, threads *pool, error *e);

/* The spacing of each cell up to a common factor; NaN: unknown. `over`: the present spacing of each cell,
 * used if the request is implicit. Errors: input_unsupported (a value of the map is not a spacing),
 * limit_memory. */
bool spacing_request_find(spacing_request *r, const double *over, double *spacing, error *e);

/* For curvature over a distance: halves fine_share. False: the curvatures do not have such a ratio, or the
 * fraction would be too small. */
bool spacing_request_refine(spacing_request *r);

/* The maximum spacing at a feature of this size: the ratio times the size, but not below the floor. */
static inline double spacing_request_cap(const sizing_field_params *params, double feature_size)
{
    return fmax(params->feature_ratio * feature_size, params->feature_floor);
}

/* The spacing that features request, over the surface's area. */
typedef struct spacing_request_features {
    double least, median; /* feature sizes, world units */
    double floor;         /* minimum spacing that features can request */
    double floored_share; /* fraction of the area at which features would request less than the floor */
    double points;        /* number of points for the features alone, before growth is limited */
} spacing_request_features;

/* Describes a request with features. Error: limit_memory. */
bool spacing_request_describe_features(const spacing_request *r, spacing_request_features *out, error *e);

void spacing_request_free(spacing_request *r);

#endif
