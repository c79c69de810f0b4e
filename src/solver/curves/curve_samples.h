/* curve_samples: positions of particles along the feature curves of a surface with patches, and at its corners.
 *
 * A curve between corners is divided into equal steps, as many as bring the step nearest to the requested spacing. A curve shorter than
 * half of the spacing gets no sample, and one of its two corners is the point of both. A sample is one point of the surface and has a
 * copy for each patch that ends there, with that patch's normal. If the patches require it, samples of near curves are merged
 * (near_curves). World space.
 */
#ifndef HEXAD_SOLVER_CURVE_SAMPLES_H
#define HEXAD_SOLVER_CURVE_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "base/error.h"
#include "field/patches.h"
#include "solver/curves/boundary.h"

typedef struct curve_samples {
    size_t count;            /* samples; those at corners come first */
    vec3 *position;          /* of each sample, on the curve */
    uint32_t *curve;         /* of each sample; of a corner one of the curves that end there */
    size_t corners;          /* samples at corners */
    size_t copies;           /* for patches, in all */
    uint32_t *place, *patch; /* of each copy its sample, ascending, and its patch */
    vec3 *normal;            /* of each copy: unit, of the patch there */
    /* Of each patch: the part of its area, in ideal Voronoi cells, that the copies on its borders cover. A patch whose area is n cells
     * gets n less this many other particles (by the sum of a polygon's angles, or Gauss and Bonnet). */
    double *border;
} curve_samples;

/* Samples of the curves of `f`, which has patches; at most request->most, with longer steps if there would be more. Deterministic. Free
 * *out also after failure. Error: limit_memory. */
bool curve_samples_make(const field *f, const boundary_request *request, curve_samples *out, error *e);
static inline void curve_samples_free(curve_samples *r)
{
    free(r->position);
    free(r->curve);
    free(r->place);
    free(r->patch);
    free(r->normal);
    free(r->border);
    *r = (curve_samples){0};
}

#endif
