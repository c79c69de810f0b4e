// SPDX-License-Identifier: Apache-2.0
/* quadrature: weights of high order for integrals over a smooth closed surface, from points on it.
 *
 * The sum of weight times f approximates the integral of f. Source: Reeger, Fornberg and Watts 2016, "Numerical
 * quadrature over smooth, closed surfaces", Proc. R. Soc. A 472. For each triangle between the points, the nearest
 * nodes are projected to its plane from the point in which the cutting planes of its sides meet. A cutting plane
 * contains the side and the mean of the normals of both triangles, so that the parts of the surface that belong to
 * the triangles neither overlap nor leave gaps. The weights in the plane are exact for the 7th power of the
 * distance from each node, and for polynomials of degree 7. The normals of the surface convert areas in the plane
 * to areas on the surface.
 */
#ifndef HEXAD_SAMPLING_WEIGHTS_QUADRATURE_H
#define HEXAD_SAMPLING_WEIGHTS_QUADRATURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/vec3.h"

/* Degree of the polynomials, and number of nodes of a triangle. The paper uses these values. */
enum { QUADRATURE_DEGREE = 7, QUADRATURE_NODES = 80 };

typedef struct quadrature_input {
    size_t count;
    const vec3 *position, *normal; /* normals: unit, of the surface */
    size_t triangle_count;
    /* a closed manifold, counterclockwise seen from outside */
    const uint32_t (*triangle)[3];
} quadrature_input;

typedef enum quadrature_end {
    QUADRATURE_COMPLETE,
    QUADRATURE_FEW_NODES, /* a triangle has fewer than QUADRATURE_NODES nodes that can be projected to its plane */
    QUADRATURE_SINGULAR /* the system of a triangle is singular, or a weight is not finite */
} quadrature_end;

/* Computes a weight for each point. *lower_area: the sum of the weights for polynomials of degree 6, an estimate of
 * the error of the area. Unless *end is QUADRATURE_COMPLETE, both are invalid. Deterministic for any number of threads
 * and any processor. Errors: limit_memory, cancelled. */
bool quadrature_make(const quadrature_input *in, threads *pool, double *weight, double *lower_area,
                     quadrature_end *end, error *e);

#endif
