// SPDX-License-Identifier: Apache-2.0
/* even_subset: distances between the chosen points, and from all points to them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "base/core/memory.h"
#include "geometry/space/even_subset.h"

enum { ROWS = 60, COLUMNS = 100, COUNT = ROWS * COLUMNS };

/* A hexagonal lattice of unit spacing, in random order, with normals along z. */
static void make_lattice(vec3 *x, vec3 *n)
{
    for (int i = 0; i < COUNT; i++) {
        const int row = i / COLUMNS, column = i % COLUMNS;
        x[i] = (vec3){column + 0.5 * (row % 2), row * sqrt(0.75), 0};
        n[i] = (vec3){0, 0, 1};
    }
    unsigned seed = 83;
    printf("seed %u\n", seed);
    srand(seed);
    for (int i = COUNT - 1; i > 0; i--) {
        const int k = rand() % (i + 1);
        const vec3 kept = x[i];
        x[i] = x[k];
        x[k] = kept;
    }
}

static double size_at(const even_subset_points *p, size_t i)
{
    return p->size ? p->size[i] : 1;
}

/* Chosen points are not nearer to earlier ones than their own reach, and every point has a chosen one within its reach. */
static void expect_even(const even_subset_points *p, const even_subset *s)
{
    for (size_t k = 0; k < s->count; k++)
        for (size_t l = 0; l < k; l++) {
            assert_true(s->chosen[l] < s->chosen[k]);
            const double reach = s->reach * size_at(p, s->chosen[k]);
            assert_true(vec3_norm(vec3_sub(p->position[s->chosen[k]], p->position[s->chosen[l]])) >
                        0.999 * reach);
        }
    for (size_t i = 0; i < p->count; i++) {
        double nearest = INFINITY;
        for (size_t k = 0; k < s->count; k++)
            nearest = fmin(nearest, vec3_norm(vec3_sub(p->position[s->chosen[k]], p->position[i])));
        assert_true(nearest < 1.001 * s->reach * size_at(p, i));
    }
}

static void test_points_of_one_size(void **state)
{
    (void)state;
    static vec3 x[COUNT], n[COUNT];
    make_lattice(x, n);
    const even_subset_points p = {COUNT, x, n, 1, NULL};
    for (size_t wanted = COUNT / 4; wanted <= COUNT / 2; wanted += COUNT / 12) {
        even_subset s;
        assert_true(even_subset_choose(&p, wanted, &s, NULL));
        assert_in_range(s.count, wanted / 3, 3 * wanted / 2);
        expect_even(&p, &s);
        free(s.chosen);
    }
}

/* exp(z) maps a lattice to one whose spacing is the distance from the origin, here 1 to 9. */
static void test_points_of_graded_size(void **state)
{
    (void)state;
    static vec3 x[COUNT], n[COUNT];
    static double size[COUNT];
    make_lattice(x, n);
    const double spacing = log(9) / COLUMNS;
    for (int i = 0; i < COUNT; i++) {
        size[i] = exp(spacing * x[i].x);
        x[i] = (vec3){size[i] * cos(spacing * x[i].y), size[i] * sin(spacing * x[i].y), 0};
    }
    const even_subset_points p = {COUNT, x, n, spacing, size};
    even_subset s;
    assert_true(even_subset_choose(&p, COUNT / 4, &s, NULL));
    assert_in_range(s.count, COUNT / 10, COUNT / 3);
    expect_even(&p, &s);
    free(s.chosen);
}

/* The sides of a plate thinner than the reach have points of their own. Coincident points count once. */
static void test_both_sides_of_a_wall_have_points(void **state)
{
    (void)state;
    static vec3 x[3 * COUNT], n[3 * COUNT];
    make_lattice(x, n);
    for (int i = 0; i < COUNT; i++) {
        x[COUNT + i] = vec3_add(x[i], (vec3){0, 0, 0.1});
        n[COUNT + i] = (vec3){0, 0, -1};
        x[2 * COUNT + i] = x[i];
        n[2 * COUNT + i] = n[i];
    }
    const even_subset_points p = {3 * COUNT, x, n, 1, NULL};
    even_subset s;
    assert_true(even_subset_choose(&p, COUNT, &s, NULL));
    size_t of_side[3] = {0};
    for (size_t k = 0; k < s.count; k++) of_side[s.chosen[k] / COUNT]++;
    assert_in_range(of_side[0], s.count / 3, 2 * s.count / 3);
    assert_in_range(of_side[1], s.count / 3, 2 * s.count / 3);
    assert_int_equal(of_side[2], 0);
    free(s.chosen);
}

/* Time follows from the wanted number: most of the points are not read. */
static void test_of_many_points_a_part_is_considered(void **state)
{
    (void)state;
    static vec3 x[COUNT], n[COUNT];
    make_lattice(x, n);
    const even_subset_points p = {COUNT, x, n, 1, NULL};
    even_subset s;
    assert_true(even_subset_choose(&p, COUNT / 40, &s, NULL));
    assert_in_range(s.count, COUNT / 80, COUNT / 20);
    for (size_t k = 0; k < s.count; k++) assert_int_equal(s.chosen[k] % 10, 0);
    free(s.chosen);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_points_of_one_size),
        cmocka_unit_test(test_points_of_graded_size),
        cmocka_unit_test(test_both_sides_of_a_wall_have_points),
        cmocka_unit_test(test_of_many_points_a_part_is_considered),
    };
    return cmocka_run_group_tests_name("even_subset", tests, NULL, NULL);
}
