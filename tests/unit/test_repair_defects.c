// SPDX-License-Identifier: Apache-2.0
/* Defects that remain after descent, on a ball with bumps that the spacing does not resolve. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "measure_result.h"
#include "sampling/solver/solver.h"

/* x| - 1 - HEIGHT sin(WAVE x) sin(WAVE y) sin(WAVE z), in cubes with edges of CELL. */
#define HEIGHT 0.008
#define WAVE 50.0
#define CELL 0.035
enum { SIDE = 64, POINTS = 5000 };

typedef struct ball {
    field base;
    size_t count;
    uint32_t *crossing;
} ball;

static vec3 waves(vec3 x, double (*of)(double))
{
    return vec3_make(of(WAVE * x.x), of(WAVE * x.y), of(WAVE * x.z));
}

static double value_at(vec3 x)
{
    vec3 s = waves(x, sin);
    return vec3_norm(x) - 1 - HEIGHT * s.x * s.y * s.z;
}

static bool sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    (void)f;
    const vec3 s = waves(x, sin), c = waves(x, cos), n = vec3_unit(x);
    const double r = vec3_norm(x), slope = HEIGHT * WAVE, bend = slope * WAVE, all = bend * s.x * s.y * s.z;
    if (!(r > 0)) return false;
    out->value = value_at(x);
    out->gradient = vec3_make(n.x - slope * c.x * s.y * s.z, n.y - slope * s.x * c.y * s.z,
                              n.z - slope * s.x * s.y * c.z);
    if (order == FIELD_HESSIAN)
        out->hessian = (sym3){.xx = (1 - n.x * n.x) / r + all,
                              .yy = (1 - n.y * n.y) / r + all,
                              .zz = (1 - n.z * n.z) / r + all,
                              .xy = -n.x * n.y / r - bend * c.x * c.y * s.z,
                              .xz = -n.x * n.z / r - bend * c.x * s.y * c.z,
                              .yz = -n.y * n.z / r - bend * s.x * c.y * c.z};
    return true;
}

static size_t cell_count(const field *f)
{
    return ((const ball *)f)->count;
}

static void fill_cell(const ball *b, uint32_t linear, field_cell *out)
{
    const uint32_t at[3] = {linear % SIDE, linear / SIDE % SIDE, linear / SIDE / SIDE};
    for (uint32_t c = 0; c < 8; c++) {
        out->corner[c] = vec3_make(b->base.domain.min.x + CELL * (at[0] + (c & 1)),
                                   b->base.domain.min.y + CELL * (at[1] + (c >> 1 & 1)),
                                   b->base.domain.min.z + CELL * (at[2] + (c >> 2)));
        out->value[c] = value_at(out->corner[c]);
    }
    out->hidden_crossing = false;
    out->bend = FIELD_BENT;
}

static void cell(const field *f, size_t k, field_cell *out)
{
    const ball *b = (const ball *)f;
    fill_cell(b, b->crossing[k], out);
}

static const field_ops ball_ops = {.sample = sample, .cell_count = cell_count, .cell = cell};

static void make_ball(ball *b)
{
    const double half = 0.5 * SIDE * CELL;
    *b = (ball){.base = {.ops = &ball_ops,
                         .domain = {{-half, -half, -half}, {half, half, half}},
                         .extent = 2,
                         .cell_size = CELL}};
    b->crossing = calloc((size_t)SIDE * SIDE * SIDE, sizeof *b->crossing);
    assert_non_null(b->crossing);
    for (uint32_t k = 0; k < SIDE * SIDE * SIDE; k++) {
        field_cell c;
        fill_cell(b, k, &c);
        int inside = 0;
        for (int i = 0; i < 8; i++) inside += c.value[i] < 0;
        if (inside % 8) b->crossing[b->count++] = k;
    }
    field_set_boundary(&b->base, 0);
}

/* The spacing at one pole is twice that at the other. */
static double wider_above(const void *context, vec3 x)
{
    (void)context;
    return 0.75 + 0.25 * x.z;
}

typedef struct solved {
    solver_outcome outcome;
    measures q;
    size_t count;
    uint64_t sum; /* checksum of the bits of all positions */
} solved;

static solved solve(const ball *b, bool mend, int workers)
{
    static const sizing_field_params request = {
        .kind = SIZING_FIELD_SPACING, .map = wider_above, .gradation = 0.2};
    error e = {0};
    solved out = {0};
    threads *pool = threads_new(workers, NULL, &e);
    surface *scan = surface_scan(&b->base, pool, &e);
    sizing_field *sizing = sizing_field_new(&b->base, scan, &request, POINTS, pool, &e);
    assert_non_null(sizing);
    const solver_params params = {.count = POINTS,
                                  .seed = 1,
                                  .sizing = sizing,
                                  .coarse_to_fine = true,
                                  .repair_defects = mend,
                                  .max_sweeps = 5000,
                                  .list_limit = SIZE_MAX,
                                  .step_tolerance = 3e-3,
                                  .energy_tolerance = 0.1};
    solver *s = solver_new(&b->base, scan, &params, pool, &e);
    if (!s) fail_msg("%s", e.message);
    while (!solver_ended(s)) assert_true(solver_step(s, &e));
    assert_true(solver_finalize(s, &e));
    const solver_points *points = solver_result_points(s);
    out.q = measure_result(scan, s, true, pool);
    out.outcome = solver_result(s);
    out.count = points->count;
    for (size_t i = 0; i < points->count; i++)
        for (int axis = 0; axis < 3; axis++) {
            double x = vec3_get(points->position[i], axis);
            uint64_t bits;
            memcpy(&bits, &x, sizeof bits);
            out.sum = out.sum * 1099511628211u + bits;
        }
    solver_free(s);
    sizing_field_free(sizing);
    surface_free(scan);
    threads_free(pool);
    return out;
}

/* The number of points is unchanged, they have converged, and they are nearer to the requested spacing. The
 * result does not depend on the number of threads. */
static void defects_are_repaired(void **state)
{
    (void)state;
    ball b;
    make_ball(&b);
    const solved left = solve(&b, false, 1), mended = solve(&b, true, 1), again = solve(&b, true, 3);
    free(b.crossing);
    printf("# hex_fraction %.4f and %.4f, grading.cv %.4f and %.4f\n", left.q.hex_fraction,
           mended.q.hex_fraction, left.q.grading_cv, mended.q.grading_cv);
    assert_int_equal(left.outcome, SOLVER_CONVERGED);
    assert_int_equal(mended.outcome, SOLVER_CONVERGED);
    assert_int_equal(mended.count, POINTS);
    assert_true(1 - mended.q.hex_fraction < 0.7 * (1 - left.q.hex_fraction));
    assert_true(mended.q.grading_cv < 0.85 * left.q.grading_cv);
    assert_true(mended.sum == again.sum);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(defects_are_repaired),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
