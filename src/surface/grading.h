/* grading: the spacing that is requested at each place of a surface, scaled so that a given count of points
 * meets it.
 *
 * A request gives a spacing by curvature or by a painted map. It is held between bounds, to a growth of at
 * most `gradation` per unit of distance along the surface, so that neighbours differ little, and (of
 * curvatures) to a bend that a packing can follow: where it varies within the spacing itself, as at the noise
 * of a scan, it is averaged. Of all fields of that shape (the request times a constant, then the rest) the
 * one is taken whose ideal cells, sqrt(3) / 2 spacing^2 each, fill the surface with exactly the count.
 *
 * The field is kept as nodes, one for each cube of space that the surface passes, with the spacing there and
 * its gradient, and blended between them: what differs within a cell of the surface is averaged. World space
 * and world units. Immutable once made, safe in any
 * thread. */
#ifndef HEXAD_SURFACE_GRADING_H
#define HEXAD_SURFACE_GRADING_H

#include "base/error.h"
#include "base/rng.h"
#include "base/threads.h"
#include "field/field.h"
#include "surface/surface.h"

typedef enum grading_kind {
    GRADING_CHORD,   /* sqrt(8 chord_error / max(|kappa1|, |kappa2|)) */
    GRADING_RATIO,   /* kappa^-exponent, within ratio : 1 */
    GRADING_SPACING, /* the value of a map */
    GRADING_DENSITY  /* points per unit area, the value of a map */
} grading_kind;

typedef struct grading_params {
    grading_kind kind;
    double chord_error;
    double ratio, exponent;
    /* the map's value at x; NaN where it has none, and asks for no points then */
    double (*map)(const void *context, vec3 x);
    const void *map_context;
    double min_spacing, max_spacing; /* 0: no bound */
    double gradation;                /* > 0; INFINITY: no bound */
    size_t memory_limit;             /* bytes that making it may take; 0: no bound */
} grading_params;

typedef struct grading grading;

/* For `count` points on the scanned surface. Errors: spec_invalid (the count cannot be had within the
 * bounds), input_unsupported (a map's value is no spacing), limit_memory, cancelled. Deterministic for any
 * number of threads. */
grading *grading_new(const field *f, const surface *scan, const grading_params *params, size_t count,
                     threads *pool, error *e);
void grading_free(grading *g);

/* The requested spacing at x, which is on the surface, and (unless NULL) its slope, as the nodes around have
 * it. */
double grading_spacing(const grading *g, vec3 x, vec3 *gradient);

/* The same of many places. */
void grading_spacings(const grading *g, size_t count, const vec3 *x, double *out);

/* What the request was multiplied by to meet the count, and the ends of the result. */
typedef struct grading_facts {
    double scale, least, largest;
} grading_facts;
grading_facts grading_describe(const grading *g);

/* The density of points summed over the cells, as area_before; NULL: the area. */
const double *grading_weight(const grading *g, const surface *scan);

/* A point near the surface, drawn by the density of points, `where` in [0, 1) in the order of the cells;
 * NULL: by area. See surface_point. */
vec3 grading_draw(const grading *g, const surface *scan, double where, rng *r);

#endif
