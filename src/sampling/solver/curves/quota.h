// SPDX-License-Identifier: Apache-2.0
/* quota: the number of particles of each patch on one level. Samples along the curves are held fixed. The
 * other (free) particles of a patch never move to another patch. World space. */
#ifndef HEXAD_SAMPLING_SOLVER_CURVES_QUOTA_H
#define HEXAD_SAMPLING_SOLVER_CURVES_QUOTA_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "sampling/solver/curves/curve_samples.h"
#include "sampling/solver/particles/particles.h"
#include "sampling/sizing/sizing_field.h"
#include "surface/scan/surface.h"

typedef struct quota_input {
    const field *field; /* with patches */
    const surface *scan;
    const sizing_field *sizing; /* NULL: uniform */
    double even;          /* spacing of a uniform packing of the requested count, see boundary_request */
    bool without_samples; /* curves have no samples, and patches get particles in proportion to their area */
    const threads *pool; /* if it is stopped, the functions below fail with the error cancelled; NULL: none */
} quota_input;

typedef struct quota {
    double spacing; /* h: of the curve samples and of the packing */
    curve_samples samples;
    uint32_t *free;    /* per patch: number of free particles */
    size_t free_count; /* sum of `free` */
} quota;

/* Quota for `count` points. A point on a curve counts once. Free *out also after failure. Error:
 * limit_memory. */
bool quota_for_count(const quota_input *in, size_t count, quota *out, error *e);

/* Quota for a spacing. `most`: maximum number of curve samples. Free *out also after failure. Error:
 * limit_memory. */
bool quota_for_spacing(const quota_input *in, double spacing, size_t most, quota *out, error *e);
void quota_free(quota *q);

/* Number of points: a curve sample counts once. */
static inline size_t quota_points(const quota *q)
{
    return q->samples.count + q->free_count;
}
/* Number of particles: a curve sample counts once for each incident patch. */
static inline size_t quota_particles(const quota *q)
{
    return q->samples.copies + q->free_count;
}

/* Appends the particles of the curve samples; `p` has the capacity. */
void quota_add_samples(const quota *q, particles *p);

/* Removes all fixed particles and appends those of the curve samples; `p` has the capacity. Error:
 * limit_memory. */
bool quota_replace_samples(const quota *q, particles *p, error *e);

#endif
