// SPDX-License-Identifier: Apache-2.0
/* curve_samples: positions of particles along the feature curves of a surface with patches, and at its
 * corners.
 *
 * A curve between corners is divided into equal steps. Their number brings the step nearest to the requested
 * spacing. A curve shorter than half the spacing has no samples of its own, and one of its corners represents
 * both. A sample is one point of the surface. It has one copy for each incident patch, with that patch's
 * normal. If the patches require it, samples of near curves are merged, otherwise samples at the same place
 * (near_curves). World space.
 */
#ifndef HEXAD_SAMPLING_SOLVER_CURVES_CURVE_SAMPLES_H
#define HEXAD_SAMPLING_SOLVER_CURVES_CURVE_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "base/core/error.h"
#include "surface/field/patches.h"
#include "sampling/solver/curves/boundary.h"

typedef struct curve_samples {
    size_t count;    /* samples; corners first, then curve after curve */
    vec3 *position;  /* per sample, on the curve */
    uint32_t *curve; /* per sample; for a corner: one of the curves that end there */
    size_t corners;  /* samples at corners */
    size_t copies;   /* of all samples */
    uint32_t *place; /* per copy: its sample; ascending */
    uint32_t *patch; /* per copy */
    vec3 *normal;    /* per copy: unit normal of its patch */
    /* Per patch: the number of ideal Voronoi cells that the copies on its border cover. A patch with an area
     * of n cells gets n less this number of free particles. The number follows from the angle sum of a
     * polygon (Gauss-Bonnet). */
    double *border;
    bool omitted; /* the curves have no samples, because too many would remain */
} curve_samples;

/* Samples the curves of `f`, which has patches. If there would be more than request->most samples, the
 * spacing is increased. If the patches require that near samples are merged, the limit applies to the samples
 * that remain. If these exceed it even at 1.5 times the requested spacing, the samples are omitted.
 * Deterministic. Free *out also after failure. Error: limit_memory. */
bool curve_samples_make(const field *f, const boundary_request *request, curve_samples *out, error *e);
static inline void curve_samples_free(curve_samples *samples)
{
    free(samples->position);
    free(samples->curve);
    free(samples->place);
    free(samples->patch);
    free(samples->normal);
    free(samples->border);
    *samples = (curve_samples){0};
}

#endif
