// SPDX-License-Identifier: Apache-2.0
/* boundary: the curves in which faces of the domain cut an open surface, and initial positions of particles
 * on them.
 *
 * A face cuts the triangles of the surface's cells in segments. Joined, they are closed curves or curves that
 * end at another face. Particles that start on the boundary stay there, since no force pushes them inwards.
 * Particles that start near it may converge beside it and leave a gap. World space.
 */
#ifndef HEXAD_SAMPLING_SOLVER_CURVES_BOUNDARY_H
#define HEXAD_SAMPLING_SOLVER_CURVES_BOUNDARY_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "sampling/sizing/sizing_field.h"
#include "surface/scan/surface.h"

typedef struct boundary {
    size_t count;
    vec3 *position; /* exactly in a face of the domain, and on the surface */
    vec3 *normal;   /* unit normal of the surface */
} boundary;

/* Requested distance of samples along a curve: h(x) = spacing * s(x) / even, where s(x) is the spacing of
 * the sizing field at x. */
typedef struct boundary_request {
    double spacing;
    const sizing_field *sizing; /* NULL: uniform */
    double even; /* spacing of a uniform packing of the requested count; > 0 if there is a sizing field */
    size_t most; /* maximum number of samples; the spacing is increased to keep it */
} boundary_request;

/* Requested spacing at x. World space. */
double boundary_spacing(const boundary_request *request, vec3 x);

/* Samples the boundary curves. A closed surface has none. Deterministic. Free *out also after failure.
 * Error: limit_memory. */
bool boundary_find(const surface *s, const boundary_request *request, boundary *out, error *e);
void boundary_free(boundary *samples);

#endif
