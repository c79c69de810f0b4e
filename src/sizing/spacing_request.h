/* spacing_request: the spacing that a job asks for at each cell of the surface, before it is scaled to a count.
 *
 * Of a painted map it is the map's value. By curvature it follows from the field's curvature at a point of the cell, or
 * from that over a distance (scaled_curvature), which is known at octaves of the even spacing and interpolated between
 * them. World space and world units. One thread. */
#ifndef HEXAD_SIZING_SPACING_REQUEST_H
#define HEXAD_SIZING_SPACING_REQUEST_H

#include <math.h>
#include <stdbool.h>

#include "base/error.h"
#include "base/threads.h"
#include "sizing/cell_samples.h"
#include "sizing/sizing_field_params.h"
#include "surface/surface.h"

/* Curvatures over so many distances, an octave apart. */
#define SPACING_REQUEST_OCTAVES 6
/* The most that a cell takes: sample, value, curvatures, cap. */
#define SPACING_REQUEST_CELL_BYTES (24 + 24 + 1 + 8 + 8 * SPACING_REQUEST_OCTAVES + 8)

typedef struct spacing_request {
    const sizing_field_params *params; /* not owned, nor is the surface */
    const surface *scan;
    double even; /* spacing of the even packing */
    cell_samples samples;
    double *value;       /* curvature at the point, or the map's value; NaN: unknown */
    double *curvature;   /* SPACING_REQUEST_OCTAVES a cell; NULL: the curvature at the point is used */
    double *feature;     /* the feature size of each cell; NULL: it does not matter */
    double fine_share;   /* of the area bends more than what stands for the fine end of a ratio */
    double widest_ratio; /* that the curvatures which were found last allow to ask for */
} spacing_request;

bool spacing_request_is_map(const sizing_field_params *params);

/* Whether the request at a place follows from that place alone, and not from what is around it. */
bool spacing_request_is_at_points(const sizing_field_params *params);

/* Whether the request depends on the spacing itself, so that both have to be found together. */
bool spacing_request_is_implicit(const sizing_field_params *params);

/* Looks at every cell. Free *r after failure, too. Errors: limit_memory, cancelled. */
bool spacing_request_begin(spacing_request *r, const surface *scan, const sizing_field_params *params,
                           double even, threads *pool, error *e);

/* The spacing of each cell, NaN where it is unknown, up to a common factor. `over`: the spacing at each cell; it
 * matters where the request is implicit. Errors: input_unsupported (a map's value is no spacing), limit_memory. */
bool spacing_request_find(spacing_request *r, const double *over, double *spacing, error *e);

/* Of curvature over a distance: half as much of the area may bend more than the fine end of the ratio. False: the curvatures that
 * were found have no such ratio, or that is too little of the area. */
bool spacing_request_refine(spacing_request *r);

/* The most that a feature of this size allows: the ratio, but not below the floor. */
static inline double spacing_request_cap(const sizing_field_params *params, double feature_size)
{
    return fmax(params->feature_ratio * feature_size, params->feature_floor);
}

/* What features ask for, taken over the surface's area. */
typedef struct spacing_request_features {
    double least, median; /* feature sizes */
    double floor;         /* features never ask for less */
    double floored_share; /* of the area: what the features there ask for is below the floor */
    double points;        /* that the features alone ask for, before growth is limited */
} spacing_request_features;

/* Of a request with features. Error: limit_memory. */
bool spacing_request_describe_features(const spacing_request *r, spacing_request_features *out, error *e);

void spacing_request_free(spacing_request *r);

#endif
