// SPDX-License-Identifier: Apache-2.0
/* B-splines against the sum of their basis functions, derivatives against finite differences and across
 * knots, the convention of knots, open faces, areas.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "cells.h"
#include "close.h"
#include "surface/field/bspline.h"
#include "shapes.h"
#include "surface/scan/surface.h"

enum { NX = 7, NY = 5, NZ = 9, COUNT = NX * NY * NZ };

typedef struct fixture {
    double coefficients[COUNT];
    bspline *b;
} fixture;

static const bbox oblong = {{-1, 2, 0.5}, {3, 3, 4}};

/* The position of coefficient i of an axis by the convention of knots in the header. */
static double place(int axis, int i)
{
    const int dims[3] = {NX, NY, NZ};
    double min = vec3_get(oblong.min, axis), max = vec3_get(oblong.max, axis);
    return min + (i - 1) * (max - min) / (dims[axis] - 3);
}

static void fill(fixture *x, double (*value)(vec3))
{
    for (int k = 0, n = 0; k < NZ; k++)
        for (int j = 0; j < NY; j++)
            for (int i = 0; i < NX; i++, n++)
                x->coefficients[n] = value((vec3){place(0, i), place(1, j), place(2, k)});
}

static bspline *make(fixture *x, double (*value)(vec3))
{
    error e = {0};
    fill(x, value);
    const bspline_params params = {{NX, NY, NZ}, oblong, x->coefficients, ISA_PORTABLE};
    x->b = bspline_new(&params, NULL, &e);
    if (!x->b) fail_msg("%s", e.message);
    return x->b;
}

static double wavy(vec3 p)
{
    return sin(3 * p.x + p.y) + cos(2 * p.y - p.z) + 0.3 * sin(5 * p.z * p.x);
}

static double slope(vec3 p)
{
    return 2 * p.x - 3 * p.y + p.z + 2;
}

static double along_x(vec3 p)
{
    return p.x - 0.7;
}

static double ball(vec3 p)
{
    return vec3_norm2((vec3){(p.x - 1) / 2, p.y - 2.5, (p.z - 2.2) / 1.5}) - 0.4; /* shrinks as a spline */
}

static double positive(vec3 p)
{
    return 1 + p.x * p.x;
}

/* The cubic B-spline on [-2, 2] from its definition by truncated powers. */
static double basis(double u)
{
    const double weight[5] = {1, -4, 6, -4, 1};
    double sum = 0;
    for (int k = 0; k < 5; k++) sum += weight[k] * pow(fmax(u + 2 - k, 0), 3) / 6;
    return sum;
}

static double brute_force(const fixture *x, vec3 p)
{
    double sum = 0;
    const vec3 w = {place(0, 1) - place(0, 0), place(1, 1) - place(1, 0), place(2, 1) - place(2, 0)};
    for (int k = 0, n = 0; k < NZ; k++)
        for (int j = 0; j < NY; j++)
            for (int i = 0; i < NX; i++, n++)
                sum += x->coefficients[n] * basis((p.x - place(0, i)) / w.x) *
                       basis((p.y - place(1, j)) / w.y) * basis((p.z - place(2, k)) / w.z);
    return sum;
}

static void sample(const bspline *b, vec3 x, field_sample *s)
{
    assert_true(field_sample_at(&b->base, x, FIELD_HESSIAN, s));
}

static void values_are_those_of_the_sum(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, wavy);
    rng r = rng_seed(test_seed(), 0);
    for (int n = 0; n < 500; n++) {
        vec3 p = random_between(&r, oblong.min, oblong.max);
        field_sample s;
        sample(b, p, &s);
        assert_close(s.value, brute_force(&x, p), 1e-13);
    }
    for (int k = 0; k < 8; k++) { /* the domain's corners belong to it */
        vec3 p = {k & 1 ? oblong.max.x : oblong.min.x, k & 2 ? oblong.max.y : oblong.min.y,
                  k & 4 ? oblong.max.z : oblong.min.z};
        field_sample s;
        sample(b, p, &s);
        assert_close(s.value, brute_force(&x, p), 1e-13);
    }
    bspline_free(b);
}

static void linear_coefficients_give_a_linear_field(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, slope);
    rng r = rng_seed(test_seed(), 1);
    for (int n = 0; n < 100; n++) {
        vec3 p = random_between(&r, oblong.min, oblong.max);
        field_sample s;
        sample(b, p, &s);
        assert_close(s.value, slope(p), 1e-12);
        assert_close(s.gradient.x, 2, 1e-12);
        assert_close(s.gradient.y, -3, 1e-12);
        assert_close(s.gradient.z, 1, 1e-12);
    }
    bspline_free(b);
}

static void derivatives_match_differences(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, wavy);
    rng r = rng_seed(test_seed(), 2);
    const double step = 1e-5;
    for (int n = 0; n < 300; n++) {
        vec3 p = random_between(&r, vec3_add(oblong.min, (vec3){0.01, 0.01, 0.01}),
                                vec3_sub(oblong.max, (vec3){0.01, 0.01, 0.01}));
        field_sample s, up, down;
        sample(b, p, &s);
        for (int axis = 0; axis < 3; axis++) {
            vec3 e = {axis == 0, axis == 1, axis == 2};
            sample(b, vec3_axpy(step, e, p), &up);
            sample(b, vec3_axpy(-step, e, p), &down);
            assert_close(vec3_get(s.gradient, axis), (up.value - down.value) / (2 * step), 1e-6);
            vec3 difference = vec3_scale(vec3_sub(up.gradient, down.gradient), 1 / (2 * step));
            vec3 off = vec3_sub(difference, sym3_apply(s.hessian, e));
            assert_close(vec3_norm(off), 0, 2e-3); /* third derivatives jump at knots, by some 100 here */
        }
    }
    bspline_free(b);
}

static void second_derivatives_are_continuous(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, wavy);
    rng r = rng_seed(test_seed(), 3);
    for (int axis = 0; axis < 3; axis++)
        for (int n = 0; n < 60; n++) {
            vec3 p = random_between(&r, oblong.min, oblong.max), below = p, above = p;
            double knot = place(axis, 2 + n % ((axis == 0 ? NX : axis == 1 ? NY : NZ) - 4));
            vec3_set(&below, axis, knot - 1e-9);
            vec3_set(&above, axis, knot + 1e-9);
            field_sample s, t;
            sample(b, below, &s);
            sample(b, above, &t);
            assert_close(s.value, t.value, 1e-6);
            assert_close(vec3_norm(vec3_sub(s.gradient, t.gradient)), 0, 1e-6);
            assert_close(s.hessian.xx, t.hessian.xx, 1e-5);
            assert_close(s.hessian.yy, t.hessian.yy, 1e-5);
            assert_close(s.hessian.zz, t.hessian.zz, 1e-5);
            assert_close(s.hessian.xy, t.hessian.xy, 1e-5);
            assert_close(s.hessian.xz, t.hessian.xz, 1e-5);
            assert_close(s.hessian.yz, t.hessian.yz, 1e-5);
        }
    bspline_free(b);
}

static void field_is_undefined_outside_its_domain(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, wavy);
    const vec3 outside[] = {{-1.0000001, 2.5, 1}, {0, 3.0000001, 1}, {0, 2.5, 4.1}, {NAN, 2.5, 1}};
    for (size_t k = 0; k < sizeof outside / sizeof outside[0]; k++) {
        field_sample s = {.value = 7};
        assert_false(field_sample_at(&b->base, outside[k], FIELD_HESSIAN, &s));
        assert_true(s.value == 7);
    }
    bspline_free(b);
}

static void cells_have_corners_of_both_signs(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, wavy);
    size_t count = b->base.ops->cell_count(&b->base), brute = 0;
    for (size_t c = 0; c < count; c++) {
        field_cell cell;
        int inside = 0;
        b->base.ops->cell(&b->base, c, &cell);
        check_middle(&b->base, c, &cell);
        for (int v = 0; v < 8; v++) {
            assert_true(bbox_contains(oblong, cell.corner[v]));
            assert_close(cell.value[v], brute_force(&x, cell.corner[v]), 1e-12);
            inside += cell.value[v] < 0;
        }
        assert_in_range(inside, 1, 7);
    }
    /* no cell is missing: the bound by coefficients drops no block with a crossing */
    for (int64_t n = 0; n < b->grid.cells[0] * b->grid.cells[1] * b->grid.cells[2]; n++) {
        int64_t at[3] = {n % b->grid.cells[0], n / b->grid.cells[0] % b->grid.cells[1],
                         n / b->grid.cells[0] / b->grid.cells[1]};
        int inside = 0;
        for (int v = 0; v < 8; v++) {
            vec3 p;
            for (int axis = 0; axis < 3; axis++)
                vec3_set(&p, axis,
                         vec3_get(oblong.min, axis) + vec3_get(bbox_size(oblong), axis) *
                                                          (double)(at[axis] + (v >> axis & 1)) /
                                                          (double)b->grid.cells[axis]);
            field_sample s;
            if (!bbox_contains(oblong, p)) p = vec3_scale(p, 1 - 1e-15);
            sample(b, p, &s);
            inside += s.value < 0;
        }
        brute += inside > 0 && inside < 8;
    }
    assert_int_equal(count, brute);
    bspline_free(b);
}

static void open_where_the_surface_meets_a_face(void **state)
{
    (void)state;
    fixture x;
    bspline *b = make(&x, ball);
    assert_false(b->base.open);
    bspline_free(b);
    b = make(&x, along_x);
    assert_true(b->base.open);
    assert_true(b->base.boundary_box.min.x == -INFINITY && b->base.boundary_box.max.x == INFINITY);
    assert_true(b->base.boundary_box.min.y == oblong.min.y && b->base.boundary_box.max.y == oblong.max.y);
    assert_true(b->base.boundary_box.min.z == oblong.min.z && b->base.boundary_box.max.z == oblong.max.z);
    assert_true(b->base.extent == 4);
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    surface *s = surface_scan(&b->base, pool, &e);
    assert_close(s->area, 1 * 3.5, 1e-9);
    assert_close(s->box.min.x, 0.7, 1e-9);
    surface_free(s);
    threads_free(pool);
    bspline_free(b);
}

static void field_without_a_zero_has_no_surface(void **state)
{
    (void)state;
    fixture x;
    error e = {0};
    fill(&x, positive);
    const bspline_params params = {{NX, NY, NZ}, oblong, x.coefficients, isa_best()};
    assert_null(bspline_new(&params, NULL, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
    assert_non_null(strstr(e.message, "range from 1 to "));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_are_those_of_the_sum),
        cmocka_unit_test(linear_coefficients_give_a_linear_field),
        cmocka_unit_test(derivatives_match_differences),
        cmocka_unit_test(second_derivatives_are_continuous),
        cmocka_unit_test(field_is_undefined_outside_its_domain),
        cmocka_unit_test(cells_have_corners_of_both_signs),
        cmocka_unit_test(open_where_the_surface_meets_a_face),
        cmocka_unit_test(field_without_a_zero_has_no_surface),
    };
    return cmocka_run_group_tests_name("bspline", tests, NULL, NULL);
}
