// SPDX-License-Identifier: Apache-2.0
/* Regions: cutting faces, kept parts, areas against closed forms, and points. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/region.h"
#include "shapes.h"
#include "surface/scan/surface.h"

static const analytic_params ball = {.shape = ANALYTIC_SPHERE, .radius = 1};
static const analytic_params ring = {
    .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.4};
static const analytic_params maze = {
    .shape = ANALYTIC_GYROID, .center = {0.5, 0.5, 0.5}, .size = {1, 1, 1}, .period = 1};

typedef struct part {
    analytic *whole;
    region *region;
    const field *field;
    threads *pool;
    surface *scan;
} part;

static void cut(const analytic_params *params, bbox box, part *out)
{
    error e = {0};
    out->whole = analytic_new(params, NULL, &e);
    out->region = region_new(&out->whole->base, box, &e);
    if (!out->region) fail_msg("%s", e.message);
    out->field = region_field(out->region);
    out->pool = threads_new(2, NULL, &e);
    out->scan = surface_scan(out->field, out->pool, &e);
    if (!out->scan) fail_msg("%s", e.message);
}

static void release(part *p)
{
    surface_free(p->scan);
    threads_free(p->pool);
    region_free(p->region);
    analytic_free(p->whole);
}

static double area_of(const analytic_params *params, bbox box)
{
    part p;
    cut(params, box, &p);
    double area = p.scan->area;
    release(&p);
    return area;
}

/* A zone of a sphere between parallel planes has the area 2 pi R times their distance. */
static void areas_of_zones(void **state)
{
    (void)state;
    const struct {
        double low, high, within;
    } cases[] = {
        {0.5, 2, 1e-4},      /* a cap */
        {-2, 0.5, 1e-4},     /* the rest without the cap */
        {-0.1, 0.1, 1e-4},   /* a belt */
        {0.95, 2, 5e-4},     /* a cap with a diameter of seven cells */
        {0.9999, 2, 5e-3},   /* a cap of half a cell */
        {0.3, 0.3001, 1e-3}, /* a belt of a five-hundredth of a cell */
        {1 / 3.0, 2 / 3.0, 1e-4},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++)
        for (int axis = 0; axis < 3; axis++) {
            bbox box = {{-2, -2, -2}, {2, 2, 2}};
            vec3_set(&box.min, axis, cases[k].low);
            vec3_set(&box.max, axis, cases[k].high);
            double area = 2 * M_PI * (fmin(cases[k].high, 1) - fmax(cases[k].low, -1));
            assert_close(area_of(&ball, box) / area, 1, cases[k].within);
        }
}

static void areas_of_corners(void **state)
{
    (void)state;
    assert_close(area_of(&ball, (bbox){{0, 0, 0}, {2, 2, 2}}), M_PI / 2, 1e-5);
    assert_close(area_of(&ball, (bbox){{-2, 0, -2}, {0, 2, 2}}), M_PI, 1e-5);
    assert_close(area_of(&ring, (bbox){{-2, 0, -2}, {2, 2, 2}}), 2 * M_PI * M_PI * 0.4, 1e-4);
    assert_close(area_of(&ring, (bbox){{-2, -2, 0}, {0, 0, 2}}), M_PI * M_PI * 0.4 / 2, 1e-4);
}

/* A shift by half a period along all three axes maps the gyroid to itself. */
static void areas_of_half_a_gyroid(void **state)
{
    (void)state;
    double whole = area_of(&maze, (bbox){{-1, -1, -1}, {2, 2, 2}});
    for (double low = 0; low < 0.5; low += 0.13)
        assert_close(area_of(&maze, (bbox){{low, 0, 0}, {low + 0.5, 1, 1}}) / whole, 0.5, 2e-5);
}

static void a_region_that_cuts_nothing_is_the_whole_surface(void **state)
{
    (void)state;
    const struct {
        const analytic_params *params;
        bbox box;
    } cases[] = {
        {&ball, {{-9, -9, -9}, {9, 9, 9}}},
        {&ball, {{-1.06, -1.06, -1.06}, {1.06, 1.06, 1.06}}},
        {&maze, {{0, 0, 0}, {1, 1, 1}}},
        {&maze, {{-1, -1, -1}, {2, 2, 2}}},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        part p;
        cut(cases[k].params, cases[k].box, &p);
        assert_ptr_equal(p.field, &p.whole->base);
        release(&p);
    }
}

/* All cells have a part in the box, and the surface may cross its faces. */
static void a_box_that_cuts_the_outer_cells_is_a_region(void **state)
{
    (void)state;
    error e = {0};
    analytic *whole = analytic_new(&ball, NULL, &e);
    const field *f = &whole->base;
    bbox box = bbox_empty();
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        field_cell cell;
        f->ops->cell(f, k, &cell);
        for (int c = 0; c < 8; c++) box = bbox_include(box, cell.corner[c]);
    }
    region *r = region_new(f, bbox_grow(box, -0.25 * f->cell_size), &e);
    assert_non_null(r);
    assert_ptr_not_equal(region_field(r), f);
    region_free(r);
    analytic_free(whole);
}

static void boundaries_are_where_the_surface_is_cut(void **state)
{
    (void)state;
    part p;
    cut(&ball, (bbox){{-9, -9, 0.5}, {9, 0.25, 9}}, &p);
    assert_true(p.field->open);
    assert_true(p.field->boundary_box.min.x == -INFINITY && p.field->boundary_box.max.x == INFINITY);
    assert_true(p.field->boundary_box.min.y == -INFINITY && p.field->boundary_box.max.y == 0.25);
    assert_true(p.field->boundary_box.min.z == 0.5 && p.field->boundary_box.max.z == INFINITY);
    assert_true(p.field->domain.max.y == 0.25 && p.field->domain.min.z == 0.5);
    assert_true(p.field->domain.max.z == p.whole->base.domain.max.z);
    assert_true(p.field->extent == p.whole->base.extent);
    assert_close(p.scan->box.min.z, 0.5, 1e-12);
    assert_close(p.scan->box.max.y, 0.25, 1e-12);
    assert_close(p.scan->box.max.x, sqrt(0.75), 1e-3);
    assert_close(p.scan->box.max.z, 1, 1e-3);
    release(&p);
    /* a boundary at the domain of the whole surface stays a boundary where the region reaches it */
    cut(&maze, (bbox){{0.25, -1, -1}, {0.5, 0.75, 9}}, &p);
    const bbox *boundary = &p.field->boundary_box;
    assert_true(boundary->min.x == 0.25 && boundary->max.x == 0.5 && boundary->min.y == 0 &&
                boundary->max.y == 0.75);
    assert_true(boundary->min.z == 0 && boundary->max.z == 1);
    release(&p);
}

static void points_lie_in_the_region_and_follow_area(void **state)
{
    (void)state;
    enum { POINTS = 20000, SLABS = 10 };
    rng r = rng_seed(test_seed(), 0);
    part p;
    int slab[SLABS] = {0};
    cut(&ball, (bbox){{-2, -2, 0.3}, {2, 2, 0.47}}, &p);              /* few cells, most of which are cut */
    double sagitta = 3 * p.field->cell_size * p.field->cell_size / 8; /* of a chord of one cell */
    for (int k = 0; k < POINTS; k++) {
        vec3 x = surface_point(p.scan, p.scan->area_before, rng_uniform(&r) * p.scan->area, &r, NULL);
        assert_close(vec3_norm(x), 1, sagitta);
        int z = (int)floor(SLABS * (x.z - 0.3) / 0.17);
        assert_in_range(z, 0, SLABS - 1);
        slab[z]++;
    }
    double chi2 = 0, expected = (double)POINTS / SLABS;
    for (int k = 0; k < SLABS; k++) chi2 += pow(slab[k] - expected, 2) / expected;
    assert_true(chi2 < 33.7); /* 9 degrees of freedom: exceeded once in 10 000 seeds */
    release(&p);
}

static void an_empty_region_is_named(void **state)
{
    (void)state;
    const bbox boxes[] = {
        {{3, 3, 3}, {4, 4, 4}},                /* outside of the data */
        {{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.25}} /* inside the ball */
    };
    for (size_t k = 0; k < sizeof boxes / sizeof boxes[0]; k++) {
        error e = {0};
        analytic *whole = analytic_new(&ball, NULL, &e);
        assert_null(region_new(&whole->base, boxes[k], &e));
        assert_int_equal(e.code, ERROR_NO_SURFACE);
        assert_non_null(
            strstr(e.message, k ? "(-0.5, -0.5, -0.5) to (0.5, 0.5, 0.25)" : "(3, 3, 3) to (4, 4, 4)"));
        analytic_free(whole);
    }
    /* in a corner of a cell that the surface crosses elsewhere */
    error e = {0};
    analytic *whole = analytic_new(&ball, NULL, &e);
    threads *pool = threads_new(1, NULL, &e);
    field_cell cell;
    whole->base.ops->cell(&whole->base, 0, &cell);
    int farthest = 0;
    for (int c = 0; c < 8; c++)
        if (fabs(cell.value[c]) > fabs(cell.value[farthest])) farthest = c;
    bbox corner =
        bbox_grow((bbox){cell.corner[farthest], cell.corner[farthest]}, 0.01 * fabs(cell.value[farthest]));
    region *speck = region_new(&whole->base, corner, &e);
    assert_non_null(speck);
    assert_null(surface_scan(region_field(speck), pool, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
    assert_non_null(strstr(e.message, "no part of the surface lies between ("));
    region_free(speck);
    threads_free(pool);
    analytic_free(whole);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(areas_of_zones),
        cmocka_unit_test(areas_of_corners),
        cmocka_unit_test(areas_of_half_a_gyroid),
        cmocka_unit_test(a_region_that_cuts_nothing_is_the_whole_surface),
        cmocka_unit_test(a_box_that_cuts_the_outer_cells_is_a_region),
        cmocka_unit_test(boundaries_are_where_the_surface_is_cut),
        cmocka_unit_test(points_lie_in_the_region_and_follow_area),
        cmocka_unit_test(an_empty_region_is_named),
    };
    return cmocka_run_group_tests_name("region", tests, NULL, NULL);
}
