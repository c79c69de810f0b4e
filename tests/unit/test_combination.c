// SPDX-License-Identifier: Apache-2.0
/* Combined surfaces: derivatives against differences, signs, and positions of cells. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>

#include "base/core/rng.h"
#include "surface/field/analytic.h"
#include "surface/field/combination.h"
#include "surface/field/placement.h"
#include "surface/scan/surface.h"
#include "cells.h"

#define SEED 20261120u
/* maximum number of times that cells are halved in walls */
enum { LEVELS = 12, MEMORY = 1 << 30 };

static const double sheared[16] = {-2, 0.3, 0, 1, 0, 1, 0.2, -2, 0.1, 0, 0.5, 3, 0, 0, 0, 1};

static analytic *torus(void)
{
    const analytic_params params = {
        .shape = ANALYTIC_TORUS, .axis = {0.2, 0.1, 1}, .major_radius = 1, .minor_radius = 0.4};
    analytic *a = analytic_new(&params, NULL, NULL);
    assert_non_null(a);
    return a;
}

static analytic *sphere(double radius, vec3 center)
{
    const analytic_params params = {.shape = ANALYTIC_SPHERE, .radius = radius, .center = center};
    analytic *a = analytic_new(&params, NULL, NULL);
    assert_non_null(a);
    return a;
}

static vec3 point_near(const field *f, rng *r)
{
    field_cell cell;
    f->ops->cell(f, (size_t)(rng_uniform(r) * (double)f->ops->cell_count(f)), &cell);
    vec3 p = cell.corner[0];
    for (int axis = 0; axis < 3; axis++)
        p = vec3_axpy(rng_uniform(r), vec3_sub(cell.corner[1 << axis], cell.corner[0]), p);
    return p;
}

/* Central differences of step d have errors of d^2 times third derivatives, up to 300 in these fields, and of
 * rounding / d. A crease between the two samples causes a jump of the gradient; such samples are skipped. */
static void check_derivatives(const field *f, const char *name)
{
    const double d = 1e-4, crease = 0.01, tolerance = 5e-6;
    rng r = rng_seed(SEED, 0);
    double worst_gradient = 0, worst_hessian = 0;
    int compared = 0;
    for (int i = 0; i < 2000; i++) {
        vec3 x = point_near(f, &r);
        field_sample s, low[3], high[3];
        if (!field_sample_at(f, x, FIELD_HESSIAN, &s)) continue;
        const double h[3][3] = {{s.hessian.xx, s.hessian.xy, s.hessian.xz},
                                {s.hessian.xy, s.hessian.yy, s.hessian.yz},
                                {s.hessian.xz, s.hessian.yz, s.hessian.zz}};
        bool smooth = true;
        for (int axis = 0; axis < 3; axis++) {
            vec3 a = x, b = x;
            vec3_set(&a, axis, vec3_get(x, axis) - d);
            vec3_set(&b, axis, vec3_get(x, axis) + d);
            smooth =
                smooth && field_sample_at(f, a, FIELD_GRADIENT, &low[axis]) &&
                field_sample_at(f, b, FIELD_GRADIENT, &high[axis]) &&
                vec3_norm(vec3_sub(high[axis].gradient, low[axis].gradient)) < crease * vec3_norm(s.gradient);
        }
        if (!smooth) continue;
        compared++;
        for (int axis = 0; axis < 3; axis++) {
            double slope = (high[axis].value - low[axis].value) / (2 * d);
            worst_gradient = fmax(worst_gradient, fabs(slope - vec3_get(s.gradient, axis)));
            for (int k = 0; k < 3; k++) {
                double bend = (vec3_get(high[axis].gradient, k) - vec3_get(low[axis].gradient, k)) / (2 * d);
                worst_hessian = fmax(worst_hessian, fabs(bend - h[axis][k]));
            }
        }
    }
    print_message("# %s: gradient %.1e, hessian %.1e, at %d points\n", name, worst_gradient, worst_hessian,
                  compared);
    assert_true(compared > 1000);
    assert_true(worst_gradient > 0 && worst_gradient < tolerance);
    assert_true(worst_hessian > 0 && worst_hessian < tolerance);
}

static void derivatives_of_a_placed_field(void **state)
{
    (void)state;
    analytic *t = torus();
    placement *p = placement_new(&t->base, sheared, NULL);
    assert_non_null(p);
    check_derivatives(placement_field(p), "placed torus");
    placement_free(p);
    analytic_free(t);
}

static void derivatives_and_sides_of_combinations(void **state)
{
    (void)state;
    static const char *const names[] = {"union", "intersection", "difference"};
    analytic *t = torus(), *s = sphere(0.8, vec3_make(0.9, 0.1, 0.2));
    const field *parts[2] = {&t->base, &s->base};
    for (int kind = 0; kind < 3; kind++) {
        error e = {0};
        combination *c = combination_new((combination_kind)kind, parts, 2, LEVELS, 0, 0, MEMORY, NULL, &e);
        if (!c) fail_msg("%s", e.message);
        const field *f = combination_field(c);
        check_derivatives(f, names[kind]);
        rng r = rng_seed(SEED, 0);
        for (int i = 0; i < 2000; i++) { /* F has the sign that follows from its parts */
            vec3 x = point_near(f, &r);
            field_sample whole, one, two;
            if (!field_sample_at(f, x, FIELD_GRADIENT, &whole) ||
                !field_sample_at(parts[0], x, FIELD_GRADIENT, &one) ||
                !field_sample_at(parts[1], x, FIELD_GRADIENT, &two))
                continue;
            bool a = one.value < 0, b = two.value < 0,
                 inside = kind == 0   ? a || b
                          : kind == 1 ? a && b
                                      : a && !b;
            assert_int_equal(whole.value < 0, inside);
        }
        assert_false(f->open);
        combination_free(c);
    }
    analytic_free(t);
    analytic_free(s);
}

static void an_empty_combination_is_an_error(void **state)
{
    (void)state;
    analytic *a = sphere(1, vec3_make(0, 0, 0)), *b = sphere(1, vec3_make(5, 0, 0)),
             *inner = sphere(0.5, vec3_make(0, 0, 0));
    const struct {
        combination_kind kind;
        const field *parts[2];
    } cases[] = {{COMBINATION_INTERSECTION, {&a->base, &b->base}},
                 {COMBINATION_DIFFERENCE, {&inner->base, &a->base}}};
    for (size_t k = 0; k < 2; k++) {
        error e = {0};
        assert_null(combination_new(cases[k].kind, cases[k].parts, 2, LEVELS, 0, 0, MEMORY, NULL, &e));
        assert_int_equal(e.code, ERROR_NO_SURFACE);
    }
    analytic_free(a);
    analytic_free(b);
    analytic_free(inner);
}

/* A ball of a fiftieth of the radius on a large one, and one beside it: each part has cells of the size it
 * needs, and no part is lost or merged. Uniform cells of the smallest size would be a hundred times as
 * many. */
static void cells_are_as_large_as_their_part_needs(void **state)
{
    (void)state;
    const double fine = 0.02, on = 1.002, beside = 1.05;
    analytic *large = sphere(1, vec3_make(0, 0, 0)), *bump = sphere(fine, vec3_make(0, on, 0)),
             *ball = sphere(fine, vec3_make(beside, 0, 0));
    const field *parts[3] = {&large->base, &bump->base, &ball->base};
    error e = {0};
    combination *c = combination_new(COMBINATION_UNION, parts, 3, LEVELS, 0, 0, MEMORY, NULL, &e);
    if (!c) fail_msg("%s", e.message);
    const field *f = combination_field(c);
    surface *s = surface_scan(f, NULL, &e);
    if (!s) fail_msg("%s", e.message);
    /* areas of spheres, and of the caps that each cuts off the other */
    const double along = (on * on + 1 - fine * fine) / (2 * on), within = fine - (on - along);
    const double area = 4 * M_PI * (1 + 2 * fine * fine) - 2 * M_PI * (1 - along) - 2 * M_PI * fine * within;
    print_message("# %zu cells, area %.7g of %.7g, %zu parts\n", s->cells, s->area, area, s->parts.count);
    assert_true(s->cells < 400000);
    assert_true(fabs(s->area - area) < 2e-5 * area);
    assert_int_equal(s->parts.count, 2);
    assert_true(f->uneven);
    for (size_t k = 0; k < s->cells; k += 97) {
        field_cell cell;
        f->ops->cell(f, k, &cell);
        check_middle(f, k, &cell);
    }
    surface_free(s);
    combination_free(c);
    analytic_free(large);
    analytic_free(bump);
    analytic_free(ball);
}

typedef struct thin_case {
    const char *what;
    combination_kind kind;
    double radius, other;   /* radius of the first sphere, centred at the origin, and of the second */
    vec3 center;            /* of the second sphere */
    double area, tolerance; /* relative */
} thin_case;

/* The area of the combination of two spheres, and its number of cells. */
static double thin_area(const thin_case *t, int levels, size_t *cells, double *missing)
{
    analytic *a = sphere(t->radius, vec3_make(0, 0, 0)), *b = sphere(t->other, t->center);
    const field *parts[2] = {&a->base, &b->base};
    error e = {0};
    combination *c = combination_new(t->kind, parts, 2, levels, 0, 0, MEMORY, NULL, &e);
    if (!c) fail_msg("%s: %s", t->what, e.message);
    surface *s = surface_scan(combination_field(c), NULL, &e);
    if (!s) fail_msg("%s: %s", t->what, e.message);
    const double area = s->area;
    *cells = s->cells;
    *missing = combination_missing(c, NULL);
    surface_free(s);
    combination_free(c);
    analytic_free(a);
    analytic_free(b);
    return area;
}

static double lens(double depth)
{
    return 2 * M_PI * depth; /* two caps of a sphere of radius 1, each half as deep */
}

/* Walls and slits thinner than the parts' own cells are complete. Without cells of their own, the areas of
 * the shell and of the lenses would differ from their closed forms by more than the tolerance. A wall thinner
 * than the smallest cell is counted as missing. */
static void walls_thinner_than_cells_are_whole(void **state)
{
    (void)state;
    const double ball = 4 * M_PI;
    const thin_case cases[] = {
        {"shell of 1/100 to 19/100", COMBINATION_DIFFERENCE, 1, 0.9, {0, 0, 0.09}, ball * 1.81, 5e-5},
        {"lens of 1/30", COMBINATION_INTERSECTION, 1, 1, {0, 0, 2 - 0.033}, lens(0.033), 5e-3},
        {"lens of 1/25, oblique", COMBINATION_INTERSECTION, 1, 1, {0, 1.176, 1.568}, lens(0.04), 5e-3},
        {"slit of 1/100", COMBINATION_UNION, 1, 0.5, {0, 0, 1.51}, ball * 1.25, 5e-5},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        const thin_case *t = &cases[k];
        size_t cells;
        double missing;
        const double area = thin_area(t, LEVELS, &cells, &missing);
        print_message("# %s: area off by %.2g of %.4g, %zu cells, missing %.2g\n", t->what,
                      area / t->area - 1, t->area, cells, missing);
        assert_true(fabs(area / t->area - 1) < t->tolerance);
        assert_true(missing < 0.01);
    }
    const thin_case too_thin = {
        "shell of 1/30000", COMBINATION_DIFFERENCE, 1, 1 - 3e-5, {0, 0, 0}, 2 * ball, 1};
    size_t cells;
    double missing;
    const double area = thin_area(&too_thin, LEVELS, &cells, &missing);
    print_message("# %s: area %.3g of %.3g, missing %.3g\n", too_thin.what, area, too_thin.area, missing);
    assert_true(missing > 0.5);
}

static size_t cells_of(combination_kind kind, const field *a, const field *b, int levels, size_t memory)
{
    const field *parts[2] = {a, b};
    error e = {0};
    combination *c = combination_new(kind, parts, 2, levels, 0, 0, memory, NULL, &e);
    if (!c) fail_msg("%s", e.message);
    const size_t cells = combination_field(c)->ops->cell_count(combination_field(c));
    combination_free(c);
    return cells;
}

/* An edge of 34 degrees is not a wall and has no additional cells. An edge of 16 degrees has at most 3 times
 * as many. A lens of 1/30 is a wall; memory limits its cells. A lens that is the whole surface has cells, or
 * is an error. */
static void cells_in_walls_are_bounded(void **state)
{
    (void)state;
    analytic *one = sphere(1, vec3_make(0, 0, 0)), *blunt = sphere(1, vec3_make(0, 0, 2 * 0.9563)),
             *knife = sphere(1, vec3_make(0.278, 0, 0)), *lens = sphere(1, vec3_make(0, 0, 2 - 0.033)),
             *here = sphere(1, vec3_make(3, 0, 0)), *other = sphere(1, vec3_make(3, 0, 1.99));
    const combination_kind cut = COMBINATION_DIFFERENCE, both = COMBINATION_INTERSECTION;
    assert_int_equal(cells_of(both, &one->base, &blunt->base, LEVELS, MEMORY),
                     cells_of(both, &one->base, &blunt->base, 0, MEMORY));
    assert_true(cells_of(cut, &one->base, &knife->base, LEVELS, MEMORY) <
                3 * cells_of(cut, &one->base, &knife->base, 0, MEMORY));
    const size_t plain = cells_of(both, &one->base, &lens->base, 0, MEMORY);
    assert_true(cells_of(both, &one->base, &lens->base, LEVELS, MEMORY) > 4 * plain);
    assert_int_equal(cells_of(both, &one->base, &lens->base, LEVELS, MEMORY / 4096), plain);
    assert_true(cells_of(both, &here->base, &other->base, 1, MEMORY) > 100);
    error e = {0};
    assert_null(combination_new(both, (const field *[]){&here->base, &other->base}, 2, 1, 0, 0, 0, NULL, &e));
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    analytic_free(one);
    analytic_free(blunt);
    analytic_free(knife);
    analytic_free(lens);
    analytic_free(here);
    analytic_free(other);
}

/* Coplanar faces of two parts enclose nothing. */
static void faces_in_one_plane_are_not_thin(void **state)
{
    (void)state;
    const analytic_params outer = {.shape = ANALYTIC_BOX, .half_size = {1, 0.3, 0.3}},
                          pocket = {
                              .shape = ANALYTIC_BOX, .half_size = {0.15, 0.15, 0.15}, .center = {0, 0, 0.15}};
    analytic *a = analytic_new(&outer, NULL, NULL), *b = analytic_new(&pocket, NULL, NULL);
    const field *parts[2] = {&a->base, &b->base};
    error e = {0};
    combination *c = combination_new(COMBINATION_DIFFERENCE, parts, 2, LEVELS, 0, 0, MEMORY, NULL, &e);
    if (!c) fail_msg("%s", e.message);
    assert_int_equal(combination_field(c)->ops->cell_count(combination_field(c)),
                     cells_of(COMBINATION_DIFFERENCE, parts[0], parts[1], 0, MEMORY));
    assert_true(combination_missing(c, NULL) == 0);
    combination_free(c);
    analytic_free(a);
    analytic_free(b);
}

/* The number of cells of a ball minus a ball, and its area. */
static size_t cells_for(double spacing, double points, double *area)
{
    analytic *a = sphere(1, vec3_make(0, 0, 0)), *b = sphere(0.7, vec3_make(0.8, 0.1, 0.05));
    error e = {0};
    combination *c = combination_new(COMBINATION_DIFFERENCE, (const field *[]){&a->base, &b->base}, 2, LEVELS,
                                     spacing, points, MEMORY, NULL, &e);
    if (!c) fail_msg("%s", e.message);
    surface *s = surface_scan(combination_field(c), NULL, &e);
    if (!s) fail_msg("%s", e.message);
    const size_t cells = combination_field(c)->ops->cell_count(combination_field(c));
    *area = s->area;
    surface_free(s);
    combination_free(c);
    analytic_free(a);
    analytic_free(b);
    return cells;
}

static void few_points_have_larger_cells(void **state)
{
    (void)state;
    double area;
    const size_t usual = cells_for(0, 0, &area);
    /* `at`: distance of the plane of the common circle from the centre of the first ball */
    const double apart = vec3_norm(vec3_make(0.8, 0.1, 0.05)), at = (apart * apart + 1 - 0.49) / (2 * apart),
                 truth = 2 * M_PI * (1 + at) + 2 * M_PI * 0.7 * (0.7 - apart + at);
    const double spacings[] = {0.4, 0, 0.05, 0.005, 0, 0}, counts[] = {0, 60, 60, 1e6, 2000, 1e6};
    for (int k = 0; k < 6; k++) {
        const size_t cells = cells_for(spacings[k], counts[k], &area);
        print_message("# spacing %g, %g points: %zu of %zu cells, area %.2g off\n", spacings[k], counts[k],
                      cells, usual, area / truth - 1);
        if (k < 2)
            assert_in_range(cells, usual / 5, usual / 3);
        else
            assert_int_equal(cells, usual);
        assert_true(fabs(area / truth - 1) < 1e-3);
    }
}

/* A lens remains beside a small ball, in a union of two balls and in another one. If it is narrower than
 * cells, it has some cells of its own, or is reported. */
static void a_lens_narrower_than_cells_is_not_lost(void **state)
{
    (void)state;
    rng r = rng_seed(SEED, 7);
    for (int k = 0; k < 2; k++) {
        const double depth = k == 1 ? 5e-3 : 1e-4, radius = k == 1 ? 0.2 : 0.05;
        const vec3 shift = vec3_make(rng_uniform(&r), rng_uniform(&r), rng_uniform(&r)),
                   way = vec3_make(rng_uniform(&r) - 0.5, rng_uniform(&r) - 0.5, rng_uniform(&r) - 0.5),
                   by = vec3_axpy(1 / vec3_norm(way), way, shift),
                   to = vec3_axpy(2 - depth, vec3_sub(shift, by), by);
        analytic *one = sphere(1, by), *two = sphere(1, to),
                 *small = sphere(radius, vec3_make(shift.x, shift.y + 3.5, shift.z));
        error e = {0};
        combination *left = combination_new(COMBINATION_UNION, (const field *[]){&one->base, &small->base}, 2,
                                            LEVELS, 0, 0, MEMORY, NULL, &e);
        combination *right = combination_new(COMBINATION_UNION, (const field *[]){&two->base, &small->base},
                                             2, LEVELS, 0, 0, MEMORY, NULL, &e);
        combination *both = combination_new(
            COMBINATION_INTERSECTION, (const field *[]){combination_field(left), combination_field(right)}, 2,
            LEVELS, 0, 0, MEMORY, NULL, &e);
        if (!both) fail_msg("%s", e.message);
        surface *s = surface_scan(combination_field(both), NULL, &e);
        if (!s) fail_msg("%s", e.message);
        const double ball = 4 * M_PI * radius * radius, missing = combination_missing(both, NULL);
        print_message("# lens of %.2g: area off by %.2g, missing %.2g\n", depth,
                      s->area / (ball + lens(depth)) - 1, missing);
        assert_true(fabs(s->area / (ball + lens(depth)) - 1) < 0.018 ||
                    missing > 0.3 * lens(depth) / (ball + lens(depth)));
        surface_free(s);
        combination_free(both);
        combination_free(left);
        combination_free(right);
        analytic_free(one);
        analytic_free(two);
        analytic_free(small);
    }
}

int main(void)
{
    print_message("# seed %u\n", SEED);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(derivatives_of_a_placed_field),
        cmocka_unit_test(derivatives_and_sides_of_combinations),
        cmocka_unit_test(an_empty_combination_is_an_error),
        cmocka_unit_test(cells_are_as_large_as_their_part_needs),
        cmocka_unit_test(walls_thinner_than_cells_are_whole),
        cmocka_unit_test(cells_in_walls_are_bounded),
        cmocka_unit_test(faces_in_one_plane_are_not_thin),
        cmocka_unit_test(few_points_have_larger_cells),
        cmocka_unit_test(a_lens_narrower_than_cells_is_not_lost),
    };
    return cmocka_run_group_tests_name("combination", tests, NULL, NULL);
}
