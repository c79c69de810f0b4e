// SPDX-License-Identifier: Apache-2.0
/* point_order: the order of the points in all outputs (output.order).
 */
#ifndef HEXAD_JOB_PHASES_POINT_ORDER_H
#define HEXAD_JOB_PHASES_POINT_ORDER_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "io/points/points.h"
#include "surface/labels/label_surface.h"
#include "job/phases/attributes.h"
#include "job/phases/avoided_points.h"
#include "job/phases/given_points.h"
#include "sampling/solver/solver.h"
#include "spec/spec.h"

/* Values of each point that measures_take computes for the progressive order; otherwise NULL. */
typedef struct point_order_known {
    uint32_t *piece; /* of the surface */
    double *spacing; /* by which distances are divided */
} point_order_known;

/* Allocates the arrays that an order needs, for measures_take to fill in. Error: limit_memory. */
bool point_order_prepare(const spec *s, size_t count, point_order_known *out, error *e);
void point_order_free_known(point_order_known *known);

typedef struct point_order {
    size_t count;    /* points in order; others are left out */
    uint32_t *order; /* order[k]: the point that becomes the k-th; NULL: points stay where they are */
    uint32_t *place; /* place[i]: where point i goes; UINT32_MAX: it is left out */
    void *storage;   /* of the arrays of a set */
} point_order;

/* `solved` are the points of `set` in the space of the solver, `labels` the interfaces on which they lie or
 * NULL. Given points that are kept come first, unless the spec has an order. Points that avoided_points has
 * not taken are left out. Free also after failure. Errors: limit_memory, cancelled. */
bool point_order_find(const spec *s, const points *set, const solver_points *solved,
                      const point_order_known *known, const label_surface *labels, const given_points *given,
                      const avoided_points *avoided, const threads *pool, point_order *out, error *e);

/* Puts a set and its attributes in order. The count and the arrays of the set are then those of the order.
 * Error: limit_memory. */
bool point_order_apply(point_order *order, points *set, attributes *a, error *e);
void point_order_free(point_order *order);

#endif
