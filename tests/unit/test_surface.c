/* The scan: areas of shapes that have a formula for it, and points in proportion to area. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"
#include "surface/cell_parts.h"
#include "surface/surface.h"

static double scan_area(int k, int workers)
{
    error e = {0};
    analytic *a = analytic_new(&shapes[k], NULL, &e);
    threads *pool = threads_new(workers, NULL, &e);
    surface *s = surface_scan(&a->base, pool, &e);
    assert_non_null(s);
    double area = s->area;
    surface_free(s);
    threads_free(pool);
    analytic_free(a);
    return area;
}

static void areas_are_right(void **state)
{
    (void)state;
    double a = 0.3, b = 0.2, c = 0.1, r = 0.1; /* the box' core and rounding */
    double box = 8 * (a * b + b * c + c * a) + 4 * M_PI * r * (a + b + c) + 4 * M_PI * r * r;
    assert_close(scan_area(0, 1) / (36 * M_PI), 1, 1e-6);
    assert_close(scan_area(1, 1) / (4 * M_PI * M_PI * 0.4), 1, 1e-5);
    assert_close(scan_area(2, 1) / box, 1, 1e-4);
    assert_close(scan_area(4, 1) / 4.563927350656813, 1, 2e-5); /* Gauss-Legendre over the sphere */
}

/* Needles, discs, wires and sharp edges, against closed forms. */
static void areas_of_awkward_shapes(void **state)
{
    (void)state;
    double e = sqrt(1 - 1e-4), prolate = 2 * M_PI * (1 + 100 / e * asin(e));
    double oblate = 2 * M_PI * 1e4 + M_PI / e * log((1 + e) / (1 - e));
    const struct {
        analytic_params params;
        double area, within;
    } cases[] = {
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {100, 1, 1}}, prolate, 1e-3},
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {10, 10, 0.1}}, oblate / 100, 1e-2},
        {{.shape = ANALYTIC_TORUS, .axis = {1, 2, 3}, .major_radius = 1, .minor_radius = 0.01},
         4 * M_PI * M_PI * 0.01,
         1e-3},
        {{.shape = ANALYTIC_BOX, .half_size = {1, 1, 1}}, 24, 8e-4}, /* 1.1e-3 without parts */
        {{.shape = ANALYTIC_BOX, .half_size = {1, 1, 0.05}}, 8 * 1.1, 1e-3},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        error fault = {0};
        threads *pool = threads_new(2, NULL, &fault);
        analytic *a = analytic_new(&cases[k].params, pool, &fault);
        surface *s = a ? surface_scan(&a->base, pool, &fault) : NULL;
        if (!s) fail_msg("case %zu: %s", k, fault.message);
        assert_close(s->area / cases[k].area, 1, cases[k].within);
        surface_free(s);
        analytic_free(a);
        threads_free(pool);
    }
}

/* A sphere in cells nearly as large as its radius: what a scan takes for little less than the area of a cell's parts is that. */
static void half_as_many_parts_tell_nearly_as_much(void **state)
{
    (void)state;
    enum { SIDE = 5 };
    const double edge = 1.4;
    error e = {0};
    analytic *a = analytic_new(&shapes[0], NULL, &e);
    double whole = 0, half = 0;
    for (int k = 0; k < SIDE * SIDE * SIDE; k++) {
        field_cell cell = {.grazed = false};
        for (int c = 0; c < 8; c++) {
            const int at[3] = {k % SIDE + (c & 1), k / SIDE % SIDE + (c >> 1 & 1),
                               k / SIDE / SIDE + (c >> 2)};
            field_sample s;
            for (int axis = 0; axis < 3; axis++)
                vec3_set(&cell.corner[c], axis,
                         vec3_get(shapes[0].center, axis) + edge * (at[axis] - 0.5 * SIDE));
            assert_true(field_sample_at(&a->base, cell.corner[c], FIELD_GRADIENT, &s));
            cell.value[c] = s.value;
        }
        whole += cell_parts_area(&a->base, &cell, NULL);
        half += cell_half_parts_area(&a->base, &cell);
    }
    assert_close(whole / (36 * M_PI), 1, 2e-3);
    assert_close(half / (36 * M_PI), 1, 1e-2);
    assert_true(half != whole);
    analytic_free(a);
}

static void area_does_not_depend_on_threads(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPE_COUNT; k++) assert_true(scan_area(k, 1) == scan_area(k, 3));
}

/* The same share of points as of area above a plane of the sphere (Archimedes: uniform in z). */
static void points_follow_area(void **state)
{
    (void)state;
    enum { POINTS = 20000, SLABS = 10 };
    error e = {0};
    rng r = rng_seed(test_seed(), 0);
    analytic *a = analytic_new(&shapes[0], NULL, &e);
    threads *pool = threads_new(1, NULL, &e);
    surface *s = surface_scan(&a->base, pool, &e);
    int slab[SLABS] = {0};
    surface_last_cell last = {.known = false};
    for (int k = 0; k < POINTS; k++) {
        double where = (k + rng_uniform(&r)) / POINTS * s->area;
        rng again = r;
        vec3 x = surface_point(s, s->area_before, where, &r, NULL), p = vec3_sub(x, shapes[0].center);
        vec3 y = surface_point(s, s->area_before, where, &again, &last);
        assert_memory_equal(&x, &y, sizeof x);
        assert_close(vec3_norm(p), 3, 0.01);
        int z = (int)(SLABS * (p.z + 3) / 6);
        slab[z < 0 ? 0 : z >= SLABS ? SLABS - 1 : z]++;
    }
    double chi2 = 0, expected = (double)POINTS / SLABS;
    for (int k = 0; k < SLABS; k++) chi2 += pow(slab[k] - expected, 2) / expected;
    assert_true(chi2 < 33.7); /* 9 degrees of freedom: exceeded once in 10 000 seeds */
    surface_free(s);
    threads_free(pool);
    analytic_free(a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(areas_are_right),
        cmocka_unit_test(areas_of_awkward_shapes),
        cmocka_unit_test(half_as_many_parts_tell_nearly_as_much),
        cmocka_unit_test(area_does_not_depend_on_threads),
        cmocka_unit_test(points_follow_area),
    };
    return cmocka_run_group_tests_name("surface", tests, NULL, NULL);
}
