// SPDX-License-Identifier: Apache-2.0
/* Formulas: derivatives against finite differences, signs, cells. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "cells.h"
#include "close.h"
#include "shapes.h"

/* Formulas in addition to those of shapes.h. */
enum { CUT_CONE = SHAPE_COUNT, CAPSULE, HALFSPACE, FORMULAS };
static const analytic_params more[FORMULAS - SHAPE_COUNT] = {
    {.shape = ANALYTIC_FRUSTUM,
     .center = {0.3, 0.2, 0.1},
     .axis = {1, 2, 2},
     .core = {-0.4, 0.6, 0.5, 0.2},
     .rounding = 0.1},
    {.shape = ANALYTIC_FRUSTUM,
     .center = {0, 0, 0},
     .axis = {0, 1, -1},
     .core = {-0.5, 0.5, 0, 0},
     .rounding = 0.3},
    {.shape = ANALYTIC_HALFSPACE,
     .center = {0.1, 0.1, 0.1},
     .axis = {1, 2, 3},
     .bounds = {{-1, -1, -1}, {1.1, 1.2, 1.3}}},
};

static const analytic_params *formula(int k)
{
    return k < SHAPE_COUNT ? &shapes[k] : &more[k - SHAPE_COUNT];
}

static analytic *make(int k)
{
    error e = {0};
    analytic *a = analytic_new(formula(k), NULL, &e);
    if (!a) fail_msg("formula %d: %s", k, e.message);
    return a;
}

static void sample(const analytic *a, vec3 x, field_sample *s)
{
    assert_true(field_sample_at(&a->base, x, FIELD_HESSIAN, s));
}

/* Points near the surface, except near the edges of the box between its parts, where derivatives jump. */
static bool near_surface(const analytic *a, vec3 x, field_sample *s)
{
    if (!field_sample_at(&a->base, x, FIELD_HESSIAN, s)) return false;
    return fabs(s->value) < 0.2 * vec3_norm(s->gradient) * a->base.extent;
}

static void gradient_matches_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < FORMULAS; k++) {
        analytic *a = make(k);
        double step = 1e-6 * a->base.extent;
        for (int tries = 0, done = 0; done < 200 && tries < 100000; tries++) {
            vec3 x = random_between(&r, a->base.domain.min, a->base.domain.max);
            field_sample s, up, down;
            if (!near_surface(a, x, &s)) continue;
            done++;
            for (int axis = 0; axis < 3; axis++) {
                vec3 e = {axis == 0, axis == 1, axis == 2};
                sample(a, vec3_axpy(step, e, x), &up);
                sample(a, vec3_axpy(-step, e, x), &down);
                double difference = (up.value - down.value) / (2 * step);
                assert_close(vec3_get(s.gradient, axis), difference, 1e-5 * (vec3_norm(s.gradient) + 1e-3));
            }
        }
        analytic_free(a);
    }
}

static void hessian_matches_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (int k = 0; k < FORMULAS; k++) {
        analytic *a = make(k);
        double step = 1e-6 * a->base.extent;
        int outliers = 0, done = 0;
        for (int tries = 0; done < 200 && tries < 100000; tries++) {
            vec3 x = random_between(&r, a->base.domain.min, a->base.domain.max), worst = {0, 0, 0};
            field_sample s, up, down;
            if (!near_surface(a, x, &s)) continue;
            done++;
            for (int axis = 0; axis < 3; axis++) {
                vec3 e = {axis == 0, axis == 1, axis == 2};
                sample(a, vec3_axpy(step, e, x), &up);
                sample(a, vec3_axpy(-step, e, x), &down);
                vec3 difference = vec3_scale(vec3_sub(up.gradient, down.gradient), 1 / (2 * step));
                vec3 off = vec3_sub(difference, sym3_apply(s.hessian, e));
                vec3_set(&worst, axis, vec3_norm(off));
            }
            double scale = vec3_norm(s.gradient) / a->base.extent + vec3_norm(s.gradient) * 10;
            if (vec3_norm(worst) > 1e-4 * scale) outliers++;
        }
        /* the parts of a box and of a cone meet in planes, which a difference may cross */
        assert_true(outliers <= (formula(k)->shape == ANALYTIC_BOX || k == CUT_CONE ? 2 : 0));
        assert_int_equal(done, 200);
        analytic_free(a);
    }
}

static void inside_is_negative(void **state)
{
    (void)state;
    const vec3 inside[FORMULAS] = {{1, 2, 5},       {0, 0, 0},       {0.1, 0.2, 0.45},
                                   {0.9, 0, 0},     {0.6, 0.5, 0.5}, {0.5, 0.5, 0.5},
                                   {0.3, 0.2, 0.1}, {0, 0, 0},       {0, 0, 0}};
    for (int k = 0; k < FORMULAS; k++) {
        analytic *a = make(k);
        vec3 x = inside[k];
        if (formula(k)->shape == ANALYTIC_TORUS) {
            vec3 u, v;
            vec3_frame(vec3_unit(formula(k)->axis), &u, &v);
            x = vec3_axpy(1.1, u, formula(k)->center);
        }
        if (formula(k)->shape == ANALYTIC_GYROID) x = (vec3){0.5, 0.5, 0.25}; /* sin Z = -1 */
        field_sample s;
        sample(a, x, &s);
        assert_true(s.value < 0);
        analytic_free(a);
    }
}

static void cells_have_corners_of_both_signs(void **state)
{
    (void)state;
    for (int k = 0; k < FORMULAS; k++) {
        analytic *a = make(k);
        size_t count = a->base.ops->cell_count(&a->base);
        assert_true(count > 1000);
        for (size_t c = 0; c < count; c++) {
            field_cell cell;
            int inside = 0;
            a->base.ops->cell(&a->base, c, &cell);
            check_middle(&a->base, c, &cell);
            for (int v = 0; v < 8; v++) inside += cell.value[v] < 0;
            assert_in_range(inside, 1, 7);
        }
        analytic_free(a);
    }
}

/* Sixteen samples in lanes equal single samples bit by bit. A masked lane is unchanged. */
static void lanes_equal_single_samples(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    for (int k = 0; k < FORMULAS; k++) {
        analytic *a = make(k);
        vec3_lanes x, gradient;
        bool defined[VEC3_LANES];
        double value[VEC3_LANES];
        for (int l = 0; l < VEC3_LANES; l++) {
            vec3 p = l ? random_between(&r, a->base.domain.min, a->base.domain.max) : formula(k)->center;
            x.x[l] = p.x;
            x.y[l] = p.y;
            x.z[l] = p.z;
            defined[l] = l != 3;
        }
        field_sample_lanes(&a->base, &x, defined, value, &gradient);
        for (int l = 0; l < VEC3_LANES; l++) {
            field_sample s;
            bool there = field_sample_at(&a->base, (vec3){x.x[l], x.y[l], x.z[l]}, FIELD_GRADIENT, &s);
            assert_int_equal(defined[l], there && l != 3);
            if (!defined[l]) continue;
            assert_true(value[l] == s.value);
            assert_true(gradient.x[l] == s.gradient.x && gradient.y[l] == s.gradient.y &&
                        gradient.z[l] == s.gradient.z);
        }
        analytic_free(a);
    }
}

/* Distances from enlarged cones against their outlines, point by point. */
static void frustums_are_distances(void **state)
{
    (void)state;
    enum { STEPS = 4000 };
    rng r = rng_seed(test_seed(), 3);
    for (int k = CUT_CONE; k <= CAPSULE; k++) {
        analytic *a = make(k);
        const analytic_params *p = formula(k);
        const analytic_frustum c = p->core;
        const double corner[4][2] = {
            {0, c.bottom}, {c.bottom_radius, c.bottom}, {c.top_radius, c.top}, {0, c.top}};
        for (int tries = 0; tries < 200; tries++) {
            vec3 x = random_between(&r, a->base.domain.min, a->base.domain.max);
            vec3 d = vec3_sub(x, p->center), axis = vec3_unit(p->axis);
            double z = vec3_dot(d, axis), rho = vec3_norm(vec3_axpy(-z, axis, d)), nearest = INFINITY;
            for (int side = 0; side < 3; side++)
                for (int n = 0; n <= STEPS; n++) {
                    double t = (double)n / STEPS;
                    nearest = fmin(nearest, hypot(rho - (1 - t) * corner[side][0] - t * corner[side + 1][0],
                                                  z - (1 - t) * corner[side][1] - t * corner[side + 1][1]));
                }
            double share = (z - c.bottom) / (c.top - c.bottom);
            bool inside =
                share > 0 && share < 1 && rho < c.bottom_radius + share * (c.top_radius - c.bottom_radius);
            field_sample s;
            sample(a, x, &s);
            assert_close(s.value, (inside ? -nearest : nearest) - p->rounding, 1e-3);
        }
        analytic_free(a);
    }
}

/* Faces move along their normals and a tip moves down. Nothing remains beyond the radius of the inscribed
 * ball. */
static void frustums_shrink(void **state)
{
    (void)state;
    const double inner = 2 / (1 + sqrt(5)); /* of the triangle of height 2 over a base of half width 1 */
    analytic_frustum cone = {-1, 1, 1, 0}, left = cone;
    assert_true(analytic_shrink(&left, 0.5 * inner));
    assert_close(left.bottom, -1 + 0.5 * inner, 1e-15);
    assert_close(left.bottom_radius, 0.5, 1e-15);
    assert_close(left.top, 1 - 0.5 * inner * sqrt(5), 1e-15);
    assert_true(left.top_radius == 0);
    left = cone;
    assert_false(analytic_shrink(&left, 1.01 * inner));
    assert_true(left.bottom == -1 && left.top_radius == 0);
}

/* A plane outside of its bounds has one cell, and F is defined everywhere. */
static void half_space_outside_its_bounds_has_one_cell(void **state)
{
    (void)state;
    analytic_params p = *formula(HALFSPACE);
    p.center = (vec3){5, 5, 5};
    analytic *a = analytic_new(&p, NULL, NULL);
    field_sample s;
    assert_int_equal(a->base.ops->cell_count(&a->base), 1);
    sample(a, (vec3){0, 0, 0}, &s);
    assert_close(s.value, -30 / sqrt(14), 1e-14);
    analytic_free(a);
}

/* Formulas within the ranges of a spec whose cells are below the precision or too many. */
static void too_fine_cells_are_refused(void **state)
{
    (void)state;
    static const struct {
        analytic_params params;
        error_code code;
        const char *words;
    } cases[] = {
        {{.shape = ANALYTIC_SPHERE, .center = {0.5, 0.5, 0.5}, .radius = 1e-300},
         ERROR_NOT_SUPPORTED,
         "below the precision"},
        {{.shape = ANALYTIC_SPHERE, .center = {1e12, 0, 0}, .radius = 1e-9},
         ERROR_NOT_SUPPORTED,
         "of coordinates of 1e+12"},
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {1e12, 1, 1e-30}},
         ERROR_NOT_SUPPORTED,
         "below the precision"},
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {1e12, 1e12, 1e2}},
         ERROR_LIMIT_MEMORY,
         "enlarge its thinnest part"},
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {1e12, 1e12, 3e6}},
         ERROR_LIMIT_MEMORY,
         "enlarge its thinnest part"},
        {{.shape = ANALYTIC_BOX, .half_size = {1, 1, 0.001}},
         ERROR_LIMIT_MEMORY,
         "or sample the same shape as a mesh"},
        {{.shape = ANALYTIC_GYROID, .period = 1e-9, .size = {1, 1, 1}},
         ERROR_LIMIT_MEMORY,
         "enlarge its thinnest part"},
        {{.shape = ANALYTIC_GYROID, .period = 1e-30, .size = {1, 1, 1}},
         ERROR_NOT_SUPPORTED,
         "below the precision"},
        {{.shape = ANALYTIC_TORUS, .major_radius = 1e6, .minor_radius = 1e-3},
         ERROR_LIMIT_MEMORY,
         "enlarge its thinnest part"},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        error e = {0};
        analytic_params p = cases[k].params;
        p.axis = (vec3){0, 0, 1};
        assert_null(analytic_new(&p, NULL, &e));
        assert_int_equal(e.code, cases[k].code);
        assert_non_null(strstr(e.message, cases[k].words));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradient_matches_differences),
        cmocka_unit_test(hessian_matches_differences),
        cmocka_unit_test(inside_is_negative),
        cmocka_unit_test(frustums_are_distances),
        cmocka_unit_test(frustums_shrink),
        cmocka_unit_test(half_space_outside_its_bounds_has_one_cell),
        cmocka_unit_test(too_fine_cells_are_refused),
        cmocka_unit_test(lanes_equal_single_samples),
        cmocka_unit_test(cells_have_corners_of_both_signs),
    };
    return cmocka_run_group_tests_name("analytic", tests, NULL, NULL);
}
