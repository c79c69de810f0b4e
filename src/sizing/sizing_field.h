/* sizing_field: the spacing that a job with a grading requests at each place of a surface, scaled so that a given count
 * of points meets it.
 *
 * The request gives a spacing by curvature or by a painted map. Curvature is taken over a distance that goes with the
 * spacing itself; a few passes find both. The field keeps it between bounds, and lets it grow by
 * at most `gradation` per unit of distance along the surface, so that neighbours differ little. A spacing by curvature
 * may also bend only as much as a packing can follow: where it varies within the spacing itself, as at the noise of a
 * scan, it is averaged. The request is multiplied by the one constant with which the ideal cells (packing_cell_area)
 * fill the surface with exactly the count.
 *
 * Thin parts and narrow gaps bound the spacing from above (feature_size): by the ratio of their size, whatever the
 * scale. Curves may have a share of what their surroundings have; the spacing grows from there with the distance.
 *
 * The field is stored as nodes, one for each cube of space that the surface passes, with the spacing there and its
 * gradient. It is blended between nodes, so that differences within a cell of the surface are averaged. World space
 * and world units. Immutable once made, safe in any thread. */
#ifndef HEXAD_SIZING_SIZING_FIELD_H
#define HEXAD_SIZING_SIZING_FIELD_H

#include "base/error.h"
#include "base/rng.h"
#include "base/threads.h"
#include "field/field.h"
#include "sizing/sizing_field_params.h"
#include "sizing/spacing_request.h"
#include "surface/surface.h"

typedef struct sizing_field sizing_field;

/* For `count` points on the scanned surface. 0: as many as the request and the features take, with a scale of 1; where neither
 * asks for anything the spacing is max_spacing. Errors: spec_invalid (the count cannot be had within the bounds),
 * input_unsupported (a map's value is no spacing), limit_memory, cancelled. Deterministic for any number of threads. */
sizing_field *sizing_field_new(const field *f, const surface *scan, const sizing_field_params *params,
                               size_t count, threads *pool, error *e);
void sizing_field_free(sizing_field *g);

/* A copy for another count: all spacings are multiplied by one factor. Error: limit_memory. */
sizing_field *sizing_field_rescale(const sizing_field *g, size_t cells, size_t count, error *e);

/* The requested spacing at x, which is on the surface, and (unless NULL) its slope, as the nodes around have
 * it. */
double sizing_field_spacing(const sizing_field *g, vec3 x, vec3 *gradient);

/* The same of many places. */
void sizing_field_spacings(const sizing_field *g, size_t count, const vec3 *x, double *out);

/* What the request was multiplied by to meet the count, and the ends of the result. */
typedef struct sizing_field_facts {
    double scale, least, largest;
    double points;                     /* that the field asks for, not rounded */
    spacing_request_features features; /* with feature_ratio */
} sizing_field_facts;
sizing_field_facts sizing_field_describe(const sizing_field *g);

/* The density of points summed over the cells, as area_before; NULL: the area. */
const double *sizing_field_weight(const sizing_field *g, const surface *scan);

/* A point near the surface, drawn by the density of points, `where` in [0, 1) in the order of the cells;
 * NULL: by area. See surface_point. */
vec3 sizing_field_draw(const sizing_field *g, const surface *scan, double where, rng *r,
                       surface_last_cell *last);

#endif
