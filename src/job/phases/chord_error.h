// SPDX-License-Identifier: Apache-2.0
/* chord_error: how far triangles between points deviate from the surface of the points. */
#ifndef HEXAD_JOB_PHASES_CHORD_ERROR_H
#define HEXAD_JOB_PHASES_CHORD_ERROR_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/threads.h"
#include "surface/field/field.h"

/* Returns the largest distance of a place of the triangles from the surface of `f`, in the units and the space
 * of `f` and `vertex`. Four places of each triangle are measured: the middles of its sides, and the place where
 * the deviation is largest if it is quadratic. INFINITY: a place cannot be projected onto the surface. `h`: the
 * spacing. Deterministic for any number of threads. */
double chord_error_largest(const field *f, const vec3 *vertex, const uint32_t (*triangle)[3], size_t count,
                           double h, threads *pool);

#endif
