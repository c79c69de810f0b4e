// SPDX-License-Identifier: Apache-2.0
/* Transfer of points from one torus to another: kept, removed and new points. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "close.h"
#include "geometry/space/packing.h"
#include "sampling/solver/level_plan.h"
#include "sampling/solver/solver.h"
#include "sampling/solver/frame_transfer.h"
#include "measure_result.h"
#include "shapes.h"

enum { POINTS = 2000 };

static const analytic_params before = {.shape = ANALYTIC_TORUS,
                                       .center = {0.5, 0, -1},
                                       .axis = {1, 2, 2},
                                       .major_radius = 1,
                                       .minor_radius = 0.4};

typedef struct stage {
    analytic *field;
    surface *scan;
    threads *pool;
} stage;

static stage set_stage(const analytic_params *shape, int workers)
{
    error e = {0};
    stage s = {.field = analytic_new(shape, NULL, &e), .pool = threads_new(workers, NULL, &e)};
    if (s.field && s.pool) s.scan = surface_scan(&s.field->base, s.pool, &e);
    if (!s.scan) fail_msg("%s", e.message);
    return s;
}

static void strike(stage *s)
{
    surface_free(s->scan);
    threads_free(s->pool);
    analytic_free(s->field);
}

/* A converged packing, from a given start or without one. */
static solver *pack(const stage *s, size_t count, const frame_transfer *start)
{
    error e = {0};
    const solver_params params = {.count = count,
                                  .start = start ? SOLVER_START_GIVEN : SOLVER_START_SURFACE,
                                  .given = start ? start->position : NULL,
                                  .given_normal = start ? start->normal : NULL,
                                  .given_place = start ? start->place : NULL,
                                  .coarse_to_fine = true,
                                  .isa = ISA_PORTABLE,
                                  .list_limit = SIZE_MAX,
                                  .max_sweeps = 5000,
                                  .step_tolerance = 0.003,
                                  .energy_tolerance = 0.05};
    solver *made = solver_new(&s->field->base, s->scan, &params, s->pool, &e);
    while (made && !solver_ended(made))
        if (!solver_step(made, &e)) break;
    if (!made || !solver_ended(made) || !solver_finalize(made, &e)) fail_msg("%s", e.message);
    return made;
}

/* The points of a torus, computed once. */
static solver *first;

static int make_first(void **state)
{
    (void)state;
    stage s = set_stage(&before, 1);
    first = pack(&s, POINTS, NULL); /* its points outlive the surface */
    strike(&s);
    return 0;
}

static int free_first(void **state)
{
    (void)state;
    solver_free(first);
    return 0;
}

/* The points of the first torus, for a count. */
static frame_transfer_params params_for(size_t count, bool eased)
{
    const solver_points *p = solver_result_points(first);
    return (frame_transfer_params){.previous_count = p->count,
                                   .position = p->position,
                                   .normal = p->normal,
                                   .count = count,
                                   .eased = eased,
                                   .isa = ISA_PORTABLE,
                                   .seed = 1};
}

static frame_transfer carry_by(const stage *s, size_t count, bool eased)
{
    const solver_points *p = solver_result_points(first);
    const frame_transfer_params params = params_for(count, eased);
    frame_transfer c;
    error e = {0};
    if (!frame_transfer_points(&s->field->base, s->scan, &params, s->pool, &c, &e)) fail_msg("%s", e.message);
    assert_int_equal(c.count, count);
    assert_int_equal(c.count - c.born, p->count - c.died);
    return c;
}

static frame_transfer carry(const stage *s, size_t count)
{
    return carry_by(s, count, true);
}

/* The distance of point i to the nearest other point, in spacings. */
static double clearance(const frame_transfer *c, double spacing, size_t i)
{
    double least = INFINITY;
    for (size_t k = 0; k < c->count; k++)
        if (k != i) least = fmin(least, vec3_norm(vec3_sub(c->position[k], c->position[i])));
    return least / spacing;
}

/* Fixed points keep their positions bit by bit, before and after the solve; other points move aside. */
static void test_fixed_points_never_move(void **state)
{
    (void)state;
    enum { FIXED = 150, EVERY = POINTS / FIXED };
    stage s = set_stage(&before, 2);
    const solver_points *p = solver_result_points(first);
    const double h = packing_spacing(s.scan->area, POINTS);
    const projection_limits limits = projection_draft(h);
    vec3 fixed[FIXED], normal[FIXED];
    size_t found[FIXED] = {0};
    for (size_t k = 0; k < FIXED; k++) { /* between the points */
        fixed[k] = vec3_axpy(0.5, vec3_sub(p->position[EVERY * k + 1], p->position[EVERY * k]),
                             p->position[EVERY * k]);
        assert_true(projection_find(&s.field->base, &limits, &fixed[k], &normal[k]));
    }
    frame_transfer_params params = params_for(POINTS, true);
    params.is_still = true;
    params.fixed_count = FIXED;
    params.fixed = fixed;
    params.fixed_normal = normal;
    frame_transfer c;
    error e = {0};
    if (!frame_transfer_points(&s.field->base, s.scan, &params, s.pool, &c, &e)) fail_msg("%s", e.message);
    assert_int_equal(c.count, POINTS);
    solver *made = pack(&s, POINTS, &c);
    const solver_points *q = solver_result_points(made);
    assert_int_equal(q->count, POINTS);
    for (size_t i = 0; i < POINTS; i++) {
        const bool is_fixed = c.fixed[i] != FRAME_TRANSFER_NONE;
        assert_true((c.place[i] == PARTICLES_PINNED) == is_fixed);
        if (!is_fixed) continue;
        found[c.fixed[i]]++;
        assert_memory_equal(&c.position[i], &fixed[c.fixed[i]], sizeof(vec3));
        assert_memory_equal(&q->position[i], &fixed[c.fixed[i]], sizeof(vec3));
    }
    for (size_t k = 0; k < FIXED; k++) assert_int_equal(found[k], 1);
    for (size_t k = 0; k < FIXED; k++)
        for (size_t i = 0; i < POINTS; i++)
            if (c.fixed[i] == FRAME_TRANSFER_NONE)
                assert_true(vec3_norm(vec3_sub(q->position[i], fixed[k])) > 0.5 * h);
    solver_free(made);
    frame_transfer_free(&c);
    strike(&s);
}

static void test_points_follow_a_torus_that_moves_rotates_and_grows(void **state)
{
    (void)state;
    analytic_params after = before;
    const registration true_motion = {before.center, {0.1, 0.05, -0.1}, {0.05, -0.1, 0.05}, log(1.05)};
    after.center = registration_apply(&true_motion, before.center);
    after.axis = registration_turn(&true_motion, vec3_unit(before.axis));
    after.major_radius *= 1.05;
    after.minor_radius *= 1.05;
    stage s = set_stage(&after, 1);
    const solver_points *p = solver_result_points(first);
    double h = packing_spacing(s.scan->area, POINTS);
    frame_transfer c = carry(&s, POINTS);
    assert_int_equal(c.born, 0);
    bool seen[POINTS] = {false};
    for (size_t i = 0; i < c.count; i++) {
        assert_true(c.parent[i] < POINTS && !seen[c.parent[i]]);
        seen[c.parent[i]] = true;
        assert_memory_equal(&c.origin[i], &p->position[c.parent[i]], sizeof(vec3));
        /* a rotation about the axis of the torus cannot be detected; the rest of the motion is known */
        vec3 there = registration_apply(&true_motion, c.origin[i]), axis = after.axis;
        double height = vec3_dot(vec3_sub(c.position[i], after.center), axis);
        assert_close(height, vec3_dot(vec3_sub(there, after.center), axis), 0.01 * h);
    }
    solver *rest = pack(&s, POINTS, &c);
    const solver_points *q = solver_result_points(rest);
    assert_int_equal(solver_result(rest), SOLVER_CONVERGED);
    for (size_t i = 0; i < q->count; i++) /* the order is kept, and the points had converged */
        assert_true(vec3_norm(vec3_sub(q->position[i], c.position[i])) < 0.05 * h);
    solver_free(rest);
    frame_transfer_free(&c);
    strike(&s);
}

static void test_no_rotation_about_the_axis_of_symmetry_is_added(void **state)
{
    (void)state;
    stage s = set_stage(&before, 1);
    frame_transfer c = carry(&s, POINTS);
    assert_int_equal(c.born, 0);
    double h = packing_spacing(s.scan->area, POINTS);
    for (size_t i = 0; i < c.count; i++)
        assert_true(vec3_norm(vec3_sub(c.position[i], c.origin[i])) < 1e-3 * h);
    frame_transfer_free(&c);
    strike(&s);
}

static void test_new_points_are_far_from_all_points(void **state)
{
    (void)state;
    stage s = set_stage(&before, 1);
    frame_transfer c = carry_by(&s, POINTS + 60, false);
    double h = packing_spacing(s.scan->area, POINTS + 60);
    assert_int_equal(c.born, 60);
    for (size_t i = 0; i < c.count; i++)
        if (c.parent[i] == FRAME_TRANSFER_NONE) assert_true(clearance(&c, h, i) > 0.45);
    for (size_t i = 0; i < c.count; i++)
        for (size_t k = 0; k < i && c.parent[i] == FRAME_TRANSFER_NONE; k++)
            if (c.parent[k] == FRAME_TRANSFER_NONE)
                assert_true(vec3_norm(vec3_sub(c.position[i], c.position[k])) > 1.3 * h);
    frame_transfer_free(&c);
    strike(&s);
}

static void test_removed_points_are_spread(void **state)
{
    (void)state;
    stage s = set_stage(&before, 1);
    frame_transfer c = carry_by(&s, POINTS - 60, false);
    const solver_points *p = solver_result_points(first);
    double h = packing_spacing(s.scan->area, POINTS);
    bool stays[POINTS] = {false};
    assert_int_equal(c.born, 0);
    assert_int_equal(c.died, 60);
    for (size_t i = 0; i < c.count; i++) stays[c.parent[i]] = true;
    for (size_t i = 0; i < POINTS; i++)
        for (size_t k = 0; k < i && !stays[i]; k++)
            if (!stays[k]) assert_true(vec3_norm(vec3_sub(p->position[i], p->position[k])) > 1.2 * h);
    frame_transfer_free(&c);
    strike(&s);
}

/* The fraction of points with six neighbours in the converged packing. */
static double order_of(const stage *s, size_t count, const frame_transfer *start)
{
    solver *rest = pack(s, count, start);
    const measures q = measure_result(s->scan, rest, false, s->pool);
    solver_free(rest);
    return q.hex_fraction;
}

static void test_gradual_changes_keep_more_of_the_packing(void **state)
{
    (void)state;
    stage s = set_stage(&before, 1);
    const size_t counts[] = {POINTS + 60, POINTS - 60};
    double gained = 0; /* sum of both; a single packing varies by .02 */
    for (int k = 0; k < 2; k++) {
        frame_transfer at_once = carry_by(&s, counts[k], false), eased = carry_by(&s, counts[k], true);
        assert_int_equal(eased.born, k == 0 ? 60 : 0);
        assert_int_equal(eased.died, k == 0 ? 0 : 60);
        double order = order_of(&s, counts[k], &eased), direct = order_of(&s, counts[k], &at_once);
        print_message("# hex_fraction with %zu of %d: %.3f in portions, %.3f at once\n", counts[k], POINTS,
                      order, direct);
        gained += order - direct;
        frame_transfer_free(&at_once);
        frame_transfer_free(&eased);
    }
    assert_true(gained > 2 * 0.02);
    strike(&s);
}

/* Drift is measured from the transferred position, before new points displace it. */
static void test_the_projected_position_is_stored(void **state)
{
    (void)state;
    stage s = set_stage(&before, 1);
    const solver_points *p = solver_result_points(first);
    double h = packing_spacing(s.scan->area, POINTS), moved = 0;
    frame_transfer c = carry(&s, POINTS + 60);
    for (size_t i = 0; i < c.count; i++) {
        if (c.parent[i] == FRAME_TRANSFER_NONE) continue;
        assert_true(vec3_norm(vec3_sub(c.landed[i], p->position[c.parent[i]])) < 1e-3 * h);
        moved = fmax(moved, vec3_norm(vec3_sub(c.landed[i], c.position[i])));
    }
    assert_true(moved > 0.1 * h);
    frame_transfer_free(&c);
    strike(&s);
}

static void test_new_surface_gets_new_points(void **state)
{
    (void)state;
    analytic_params after = before;
    after.minor_radius = 0.5;
    stage s = set_stage(&after, 1);
    size_t count = (size_t)lround(POINTS * 0.5 / 0.4); /* as dense as before */
    frame_transfer c = carry(&s, count);
    double h = packing_spacing(s.scan->area, count);
    for (size_t i = 0; i < c.count; i++) assert_true(clearance(&c, h, i) > 0.3);
    solver *rest = pack(&s, count, &c);
    const solver_points *q = solver_result_points(rest);
    assert_int_equal(q->lost, 0);
    assert_true(q->max_residual < 1e-6);
    solver_free(rest);
    frame_transfer_free(&c);
    strike(&s);
}

static void test_points_are_not_carried_onto_another_surface(void **state)
{
    (void)state;
    analytic_params after = before;
    after.center = (vec3){9, 9, 9}; /* a distance field leads there from anywhere */
    after.minor_radius = 0.05;      /* no motion maps the points onto it */
    stage s = set_stage(&after, 1);
    const frame_transfer_params params = params_for(POINTS, true);
    frame_transfer c;
    assert_true(frame_transfer_points(&s.field->base, s.scan, &params, s.pool, &c, NULL));
    assert_int_equal(c.count, 0);
    assert_int_equal(c.died, POINTS);
    assert_null(c.position);
    strike(&s);
}

static void test_a_stop_is_reported(void **state)
{
    (void)state;
    volatile sig_atomic_t stop = 0;
    stage s = set_stage(&before, 1);
    error e = {0};
    threads *pool = threads_new(2, &stop, &e);
    const frame_transfer_params params = params_for(POINTS, true);
    frame_transfer c;
    stop = 1;
    assert_false(frame_transfer_points(&s.field->base, s.scan, &params, pool, &c, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    frame_transfer_free(&c);
    threads_free(pool);
    strike(&s);
}

static void test_result_does_not_depend_on_threads(void **state)
{
    (void)state;
    analytic_params after = before;
    after.minor_radius = 0.44;
    after.center.x += 0.1;
    stage one = set_stage(&after, 1), many = set_stage(&after, 3);
    frame_transfer a = carry(&one, POINTS + 100), b = carry(&many, POINTS + 100);
    assert_memory_equal(a.position, b.position, a.count * sizeof *a.position);
    assert_memory_equal(a.origin, b.origin, a.count * sizeof *a.origin);
    assert_memory_equal(a.parent, b.parent, a.count * sizeof *a.parent);
    frame_transfer_free(&a);
    frame_transfer_free(&b);
    strike(&one);
    strike(&many);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fixed_points_never_move),
        cmocka_unit_test(test_points_follow_a_torus_that_moves_rotates_and_grows),
        cmocka_unit_test(test_no_rotation_about_the_axis_of_symmetry_is_added),
        cmocka_unit_test(test_new_points_are_far_from_all_points),
        cmocka_unit_test(test_removed_points_are_spread),
        cmocka_unit_test(test_gradual_changes_keep_more_of_the_packing),
        cmocka_unit_test(test_the_projected_position_is_stored),
        cmocka_unit_test(test_new_surface_gets_new_points),
        cmocka_unit_test(test_points_are_not_carried_onto_another_surface),
        cmocka_unit_test(test_a_stop_is_reported),
        cmocka_unit_test(test_result_does_not_depend_on_threads),
    };
    return cmocka_run_group_tests(tests, make_first, free_first);
}
