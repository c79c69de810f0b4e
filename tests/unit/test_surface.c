// SPDX-License-Identifier: Apache-2.0
/* The scan: areas of shapes with closed forms, and points proportional to area. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"
#include "surface/field/region.h"
#include "surface/scan/cell_parts.h"
#include "surface/scan/surface.h"

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
    double a = 0.3, b = 0.2, c = 0.1, r = 0.1; /* core and rounding of the box */
    double box = 8 * (a * b + b * c + c * a) + 4 * M_PI * r * (a + b + c) + 4 * M_PI * r * r;
    assert_close(scan_area(0, 1) / (36 * M_PI), 1, 1e-6);
    assert_close(scan_area(1, 1) / (4 * M_PI * M_PI * 0.4), 1, 1e-5);
    assert_close(scan_area(2, 1) / box, 1, 1e-4);
    assert_close(scan_area(4, 1) / 4.563927350656813, 1, 2e-5); /* Gauss-Legendre over the sphere */
}

/* The Euler characteristic of the part of a shape in a box. */
static double euler_in(const analytic_params *shape, bbox box)
{
    error e = {0};
    analytic *a = analytic_new(shape, NULL, &e);
    threads *pool = threads_new(2, NULL, &e);
    region *r = region_new(&a->base, box, &e);
    surface *s = surface_scan(region_field(r), pool, &e);
    assert_non_null(s);
    double sum = 0;
    for (size_t p = 0; p < s->parts.count; p++) sum += s->euler[p];
    surface_free(s);
    region_free(r);
    threads_free(pool);
    analytic_free(a);
    return sum;
}

static void euler_characteristic_follows_from_cells(void **state)
{
    (void)state;
    const bbox all = {{-99, -99, -99}, {99, 99, 99}};
    const double closed[] = {2, 0, 2, 2};
    for (int k = 0; k < 4; k++) assert_true(euler_in(&shapes[k], all) == closed[k]);
    const bbox half = {{-99, -99, 2.01}, {99, 99, 99}}, band = {{-99, -99, 2.01}, {99, 99, 4.02}},
               tube = {{-0.031, -99, -99}, {1.033, 99, 99}}, edge = {{1.01, 2.02, -99}, {99, 99, 99}};
    const analytic_params ring = {.shape = ANALYTIC_TORUS,
                                  .center = {0.5, 0, 0},
                                  .axis = {0, 0, 1},
                                  .major_radius = 1,
                                  .minor_radius = 0.3};
    assert_true(euler_in(&shapes[0], half) == 1);
    assert_true(euler_in(&shapes[0], band) == 0); /* a sphere without both caps */
    assert_true(euler_in(&shapes[0], edge) == 1); /* with an edge of the box through it */
    assert_true(euler_in(&ring, tube) == 0);      /* two tubes */
}

/* Needles, discs, wires and sharp edges against closed forms. */
static void areas_of_awkward_shapes(void **state)
{
    (void)state;
    double e = sqrt(1 - 1e-4), prolate = 2 * M_PI * (1 + 100 / e * asin(e));
    double flat = sqrt(1 - 4e-4), oblate = 2 * M_PI * 25 + M_PI * 0.01 / flat * log((1 + flat) / (1 - flat));
    const struct {
        analytic_params params;
        double area, within;
    } cases[] = {
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {100, 1, 1}}, prolate, 1e-3},
        {{.shape = ANALYTIC_ELLIPSOID, .radii = {5, 5, 0.1}}, oblate, 1e-2},
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

/* A sphere in cells nearly as large as its radius: the faster estimate of a scan is close to the area of the
 * cell's parts. */
static void half_as_many_parts_give_nearly_the_same_area(void **state)
{
    (void)state;
    enum { SIDE = 5 };
    const double edge = 1.4;
    error e = {0};
    analytic *a = analytic_new(&shapes[0], NULL, &e);
    double whole = 0, half = 0;
    for (int k = 0; k < SIDE * SIDE * SIDE; k++) {
        field_cell cell = {.hidden_crossing = false};
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

/* Balls smaller than a cell on one side, a gyroid of three cells on the other, and nothing between: all cells
 * are bent. */
typedef struct two_kinds {
    field base;
    size_t count;
    uint32_t *cell; /* their numbers in a cube of SIDE_OF_KINDS cells; cells of balls come first */
} two_kinds;
enum { SIDE_OF_KINDS = 56, BETWEEN_KINDS = SIDE_OF_KINDS / 2 };

static bool is_of_balls(vec3 x)
{
    return x.x < BETWEEN_KINDS;
}

static bool sample_kinds(const field *f, vec3 x, field_order order, field_sample *out)
{
    (void)f;
    (void)order;
    *out = (field_sample){.value = 0};
    if (is_of_balls(x)) {
        const vec3 q = {x.x - 2 * round(x.x / 2) - 0.2, x.y - 2 * round(x.y / 2) - 0.2,
                        x.z - 2 * round(x.z / 2) - 0.2};
        out->value = vec3_norm2(q) - 0.36;
        out->gradient = vec3_scale(q, 2);
        return true;
    }
    const double w = 2 * M_PI / 3.3;
    out->value = sin(w * x.x) * cos(w * x.y) + sin(w * x.y) * cos(w * x.z) + sin(w * x.z) * cos(w * x.x);
    out->gradient = vec3_scale((vec3){cos(w * x.x) * cos(w * x.y) - sin(w * x.z) * sin(w * x.x),
                                      cos(w * x.y) * cos(w * x.z) - sin(w * x.x) * sin(w * x.y),
                                      cos(w * x.z) * cos(w * x.x) - sin(w * x.y) * sin(w * x.z)},
                               w);
    return true;
}

static void fill_cell(uint32_t n, field_cell *out)
{
    *out = (field_cell){.hidden_crossing = false};
    for (uint32_t c = 0; c < 8; c++) {
        field_sample s;
        out->corner[c] =
            (vec3){n / (SIDE_OF_KINDS * SIDE_OF_KINDS) + (c & 1),
                   n / SIDE_OF_KINDS % SIDE_OF_KINDS + (c >> 1 & 1), n % SIDE_OF_KINDS + (c >> 2)};
        sample_kinds(NULL, out->corner[c], FIELD_GRADIENT, &s);
        out->value[c] = s.value;
    }
}

static size_t count_kinds(const field *f)
{
    return ((const two_kinds *)f)->count;
}

static void cell_of_kinds(const field *f, size_t k, field_cell *out)
{
    fill_cell(((const two_kinds *)f)->cell[k], out);
}

/* Only some of many bent cells are measured by their parts. The estimate for the others depends on the kind
 * of the surface there. */
static void mixed_bent_cells_have_their_areas(void **state)
{
    (void)state;
    enum { EVERY = 16 };
    static const field_ops ops = {.sample = sample_kinds, .cell_count = count_kinds, .cell = cell_of_kinds};
    static uint32_t numbers[SIDE_OF_KINDS * SIDE_OF_KINDS * SIDE_OF_KINDS];
    two_kinds f = {
        .base = {.ops = &ops,
                 .domain = {{-1, -1, -1}, {SIDE_OF_KINDS + 1, SIDE_OF_KINDS + 1, SIDE_OF_KINDS + 1}},
                 .extent = SIDE_OF_KINDS,
                 .cell_size = 1},
        .cell = numbers};
    for (uint32_t n = 0; n < SIDE_OF_KINDS * SIDE_OF_KINDS * SIDE_OF_KINDS; n++) {
        field_cell cell;
        int inside = 0;
        fill_cell(n, &cell);
        for (int c = 0; c < 8; c++) inside += cell.value[c] < 0;
        if (inside > 0 && inside < 8 && is_of_balls(cell.corner[0]) == is_of_balls(cell.corner[7]))
            numbers[f.count++] = n;
    }
    error e = {0};
    rng r = rng_seed(test_seed(), 0);
    threads *pool = threads_new(2, NULL, &e);
    surface *s = surface_scan(&f.base, pool, &e);
    double known[2] = {0, 0}, scanned[2] = {0, 0};
    assert_non_null(s);
    for (size_t k = 0; k < f.count; k++) {
        field_cell cell;
        if (rng_uniform(&r) * EVERY > 1) continue; /* random: both are lattices */
        surface_cell(s, k, &cell);
        const bool balls = is_of_balls(cell.corner[0]);
        known[balls] += cell_parts_area(&f.base, &cell, NULL);
        scanned[balls] += s->area_before[k + 1] - s->area_before[k];
    }
    for (int balls = 0; balls < 2; balls++) assert_close(scanned[balls] / known[balls], 1, 0.03);
    surface_free(s);
    threads_free(pool);
}

static void area_does_not_depend_on_threads(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPE_COUNT; k++) assert_true(scan_area(k, 1) == scan_area(k, 3));
}

/* Above a plane the fraction of the points equals the fraction of the sphere's area (Archimedes: uniform
 * in z). */
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
        cmocka_unit_test(euler_characteristic_follows_from_cells),
        cmocka_unit_test(areas_of_awkward_shapes),
        cmocka_unit_test(half_as_many_parts_give_nearly_the_same_area),
        cmocka_unit_test(mixed_bent_cells_have_their_areas),
        cmocka_unit_test(area_does_not_depend_on_threads),
        cmocka_unit_test(points_follow_area),
    };
    return cmocka_run_group_tests_name("surface", tests, NULL, NULL);
}
