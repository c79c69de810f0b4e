// SPDX-License-Identifier: Apache-2.0
/* solve_fixture: complete solves of small surfaces, and checks of their points by brute force. Include
 * after cmocka. */
#ifndef HEXAD_TESTS_SOLVE_FIXTURE_H
#define HEXAD_TESTS_SOLVE_FIXTURE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "surface/field/patches.h"
#include "sampling/solver/solver.h"

static const solver_params solve_defaults = {.count = 600,
                                             .seed = 1,
                                             .coarse_to_fine = true,
                                             .max_sweeps = 5000,
                                             .list_limit = SIZE_MAX,
                                             .step_tolerance = 3e-3,
                                             .energy_tolerance = 0.05};

typedef struct solve {
    const field *field;
    threads *pool;
    surface *scan;
    solver *solver;
    const solver_points *points; /* valid after the end of the solve */
} solve;

static inline void solve_begin(const field *f, const solver_params *params, int workers,
                               const volatile sig_atomic_t *stop, solve *out)
{
    error e = {0};
    *out = (solve){.field = f, .pool = threads_new(workers, stop, &e)};
    out->scan = surface_scan(f, out->pool, &e);
    if (!out->scan) fail_msg("%s", e.message);
    out->solver = solver_new(f, out->scan, params, out->pool, &e);
    if (!out->solver) fail_msg("%s", e.message);
}

static inline void solve_step(solve *x)
{
    error e = {0};
    if (!solver_step(x->solver, &e)) fail_msg("%s", e.message);
}

static inline void solve_finalize(solve *x)
{
    error e = {0};
    if (!solver_finalize(x->solver, &e)) fail_msg("%s", e.message);
    x->points = solver_result_points(x->solver);
}

static inline void solve_finish(solve *x)
{
    while (!solver_ended(x->solver)) solve_step(x);
    solve_finalize(x);
}

static inline void solve_all(const field *f, const solver_params *params, int workers, solve *out)
{
    solve_begin(f, params, workers, NULL, out);
    solve_finish(out);
}

static inline void solve_free(solve *x)
{
    solver_free(x->solver);
    surface_free(x->scan);
    threads_free(x->pool);
}

/* The distance from x to the nearest point except `skip`, in the requested spacings of that point. */
static inline double solve_nearest(const solver_points *p, vec3 x, size_t skip)
{
    double least = INFINITY;
    for (size_t i = 0; i < p->count; i++)
        if (i != skip) least = fmin(least, vec3_norm(vec3_sub(p->position[i], x)) / p->spacing[i]);
    return least;
}

/* The least distance between two points, in requested spacings. */
static inline double solve_least_distance(const solver_points *p)
{
    double least = INFINITY;
    for (size_t i = 0; i < p->count; i++) least = fmin(least, solve_nearest(p, p->position[i], i));
    return least;
}

/* The largest distance from the surface to the nearest point, in requested spacings. It is sampled at the
 * centres of the triangles of every `stride`-th cell. */
static inline double solve_largest_gap(const solve *x, size_t stride)
{
    double largest = 0;
    for (size_t k = 0; k < x->scan->cells; k += stride) {
        vec3 t[FIELD_CELL_TRIANGLES][3];
        const int count = surface_cell_triangles(x->scan, k, t);
        for (int i = 0; i < count; i++)
            largest = fmax(largest, solve_nearest(x->points, field_triangle_middle(t[i]), SIZE_MAX));
    }
    return largest;
}

/* F| / |grad F| at a point, of the field of its patch. */
static inline double solve_residual(const solve *x, size_t i)
{
    field_sample at;
    const field *f = field_of_patch(x->field, x->points->patch ? x->points->patch[i] : 0);
    assert_true(field_sample_at(f, x->points->position[i], FIELD_GRADIENT, &at));
    return fabs(at.value) / vec3_norm(at.gradient);
}

#endif
