// SPDX-License-Identifier: Apache-2.0
/* weights: the quadrature weights of the points of a job, with which sums approximate integrals over the surface.
 *
 * On smooth closed surfaces without curves they are of high order (sampling/weights/quadrature.h), otherwise the areas
 * of the Voronoi cells, multiplied by a factor for each piece of the surface. One thread at a time; work is done on the
 * job's pool.
 */
#ifndef HEXAD_JOB_PHASES_WEIGHTS_H
#define HEXAD_JOB_PHASES_WEIGHTS_H

#include "base/core/error.h"
#include "base/json/json.h"
#include "job/source/source.h"
#include "sampling/measures/measures.h"
#include "sampling/solver/solver.h"

typedef struct weights {
    double *value;      /* per point, in the order of the solver; NULL: none are known */
    const char *reason; /* word of the report for why they are areas of cells; NULL: they are of high order */
    double area, least; /* their sum, and the smallest */
    double lower_area;  /* the sum for polynomials of the next lower degree; NAN for areas of cells */
    double area_without_points;
    vec3 normal_sum;   /* the integral of the normal */
    double *patch_sum; /* per patch; a point on a curve counts for its patch of solver_points.patch */
    size_t patches;
} weights;

typedef struct weights_input {
    const spec *spec;
    const source *source;
    const solver_points *points;
    const measures *measures;    /* of the points */
    double area;                 /* of the surface */
    const measures_input *cells; /* input of the measures */
} weights_input;

/* Computes the weights of points that are measured, in place of earlier ones. Errors: limit_memory, cancelled. */
bool weights_find(const weights_input *in, threads *pool, weights *out, error *e);

/* Adds the member `weights` to the report, if there are any, and a warning if more points permit weights of high
 * order. The report has its member `surface`. */
void weights_describe(const weights *w, json *report);
void weights_free(weights *w); /* accepts a zeroed object */

#endif
