// SPDX-License-Identifier: Apache-2.0
/* Places of points on meshes: the wall is that of the exact position; on edges and at corners one rule decides. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "surface/triangles/mesh_place.h"
#include "mesh_fixture.h"
#include "shapes.h"

enum { CASES = 1000, PARTS = 5 };

static vec3 corner(const mesh *m, size_t n, int k)
{
    return m->vertex[m->triangle[n][k]];
}

static vec3 normal_of(const mesh *m, size_t n)
{
    return vec3_unit(
        vec3_cross(vec3_sub(corner(m, n, 1), corner(m, n, 0)), vec3_sub(corner(m, n, 2), corner(m, n, 0))));
}

static size_t random_triangle(const mesh *m, rng *r)
{
    return (size_t)(rng_uniform(r) * (double)m->triangle_count) % m->triangle_count;
}

static vec3 random_on(const mesh *m, size_t n, rng *r)
{
    double u = rng_uniform(r), v = rng_uniform(r);
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    return vec3_axpy(u, vec3_sub(corner(m, n, 1), corner(m, n, 0)),
                     vec3_axpy(v, vec3_sub(corner(m, n, 2), corner(m, n, 0)), corner(m, n, 0)));
}

/* A place on the side of triangle n from corner k to the next one, or at the corner. */
static vec3 random_on_side(const mesh *m, size_t n, int k, bool at_corner, rng *r)
{
    const double at = at_corner ? 0 : rng_uniform(r);
    return vec3_axpy(at, vec3_sub(corner(m, n, (k + 1) % 3), corner(m, n, k)), corner(m, n, k));
}

static vec3 in_single_precision(vec3 x)
{
    return (vec3){(float)x.x, (float)x.y, (float)x.z};
}

static triangle_tree *tree_of(const mesh *m)
{
    error e = {0};
    triangle_tree *tree = triangle_tree_new(m, NULL, &e);
    assert_non_null(tree);
    return tree;
}

static void the_wall_of_a_thin_plate_is_that_of_the_position(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < CASES; k++) {
        const double half = pow(10, -5 + 3 * rng_uniform(&r));
        mesh m = mesh_fixture_box((vec3){rng_uniform(&r), 2, 3}, (vec3){1, 0.5, half}, 6 * rng_uniform(&r));
        triangle_tree *tree = tree_of(&m);
        const size_t n = random_triangle(&m, &r);
        const vec3 x = random_on(&m, n, &r);
        mesh_place p;
        assert_true(mesh_place_find(tree, k % 2 ? in_single_precision(x) : x, NULL, INFINITY, &p));
        const double same = vec3_dot(mesh_place_normal(&m, &p), normal_of(&m, n));
        assert_true(same > 0.999 || p.distance < 1e-6); /* a point on an edge may be on the adjacent face */
        assert_true(same > -0.999);
        const triangle t = triangle_of_corners(m.vertex, m.triangle[p.triangle]);
        const vec3 place =
            vec3_axpy(p.weight[2], t.c, vec3_axpy(p.weight[1], t.b, vec3_scale(t.a, p.weight[0])));
        assert_true(vec3_norm(vec3_sub(place, x)) < 1e-6);
        assert_true(fabs(p.weight[0] + p.weight[1] + p.weight[2] - 1) < 1e-12);
        triangle_tree_free(tree);
        mesh_free(&m);
    }
}

static void on_an_edge_the_face_of_the_normal_has_the_point(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (int k = 0; k < CASES; k++) {
        mesh m = mesh_fixture_box((vec3){1, 2, 3}, (vec3){1, 0.5, 0.3}, 6 * rng_uniform(&r));
        triangle_tree *tree = tree_of(&m);
        const size_t n = random_triangle(&m, &r);
        const vec3 x = random_on_side(&m, n, k % 3, k % 4 == 0, &r),
                   normal = vec3_scale(normal_of(&m, n), k % 2 ? 1 : -1);
        mesh_place p;
        assert_true(mesh_place_find(tree, k % 5 ? x : in_single_precision(x), &normal, 1e-5, &p));
        assert_true(vec3_dot(mesh_place_normal(&m, &p), normal_of(&m, n)) > 0.999);
        triangle_tree_free(tree);
        mesh_free(&m);
    }
}

/* The first of all triangles that are as near as the nearest one. */
static size_t first_of_nearest(const mesh *m, vec3 x)
{
    const double rounding = MESH_PLACE_ROUNDING * bbox_longest(mesh_box(m, NULL));
    double least = INFINITY;
    for (int round = 0; round < 2; round++)
        for (size_t n = 0; n < m->triangle_count; n++) {
            const triangle t = {corner(m, n, 0), corner(m, n, 1), corner(m, n, 2)};
            const double distance = sqrt(triangle_distance2(&t, x));
            if (round == 0) least = fmin(least, distance);
            if (round == 1 && distance <= least + rounding) return n;
        }
    return SIZE_MAX;
}

static void without_a_normal_the_first_triangle_has_the_point(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 3), part[PARTS];
    triangle_tree *tree = tree_of(&m), *of_part[PARTS];
    error e = {0};
    for (size_t k = 0; k < PARTS; k++) {
        const size_t first = k * m.triangle_count / PARTS, end = (k + 1) * m.triangle_count / PARTS;
        part[k] = m;
        part[k].triangle = m.triangle + first;
        part[k].triangle_count = end - first;
        of_part[k] = tree_of(&part[k]);
    }
    triangle_forest *forest = triangle_forest_new((const triangle_tree *const *)of_part, PARTS, &e);
    assert_non_null(forest);
    for (int k = 0; k < CASES; k++) {
        const size_t n = random_triangle(&m, &r), on = k % 3 == 0 ? 3 : (size_t)k % 2;
        const vec3 x = on == 3 ? random_between(&r, (vec3){-2, -2, -2}, (vec3){2, 2, 2})
                               : random_on_side(&m, n, k % 3, on == 0, &r);
        mesh_place p, q;
        mesh_place_in each[2];
        size_t of = 0;
        assert_true(mesh_place_find(tree, x, NULL, INFINITY, &p));
        assert_int_equal(p.triangle, first_of_nearest(&m, x));
        assert_true(mesh_place_find_among(forest, x, NULL, INFINITY, &of, &q));
        assert_int_equal(of * m.triangle_count / PARTS + q.triangle, p.triangle);
        assert_true(q.distance == p.distance);
        const size_t count = mesh_place_find_each(forest, x, INFINITY, 2, each);
        assert_true(count > 0 && each[0].tree == of && each[0].place.triangle == q.triangle);
        assert_true(count < 2 || (each[1].tree > of && each[1].place.distance < p.distance + 1e-6));
        const double nearer = 0.99 * p.distance;
        if (p.distance <= 0.01) continue;
        assert_false(mesh_place_find(tree, x, NULL, nearer, &q));
        assert_false(mesh_place_find_among(forest, x, NULL, nearer, &of, &q));
        assert_int_equal(mesh_place_find_each(forest, x, nearer, 2, each), 0);
    }
    triangle_forest_free(forest);
    for (size_t k = 0; k < PARTS; k++) triangle_tree_free(of_part[k]);
    triangle_tree_free(tree);
    mesh_free(&m);
}

static vec3 flat(double u, double v)
{
    return (vec3){u, v, 0};
}

/* The triangles of both sheets are at equal distances in any case, so the result does not depend on rounding. */
static void coincident_faces_are_one_sheet(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 3);
    mesh m = mesh_fixture_sheet(4, 4, flat);
    const size_t first = m.triangle_count;
    mesh_fixture_append(&m, mesh_fixture_sheet(4, 4, flat));
    for (size_t n = first; n < 2 * first; n++) mesh_fixture_turn(&m, n);
    triangle_tree *tree = tree_of(&m);
    for (int k = 0; k < CASES; k++) {
        const vec3 x = random_between(&r, (vec3){0, 0, -0.1}, (vec3){1, 1, 0.1}),
                   normal = {0, 0, k % 2 ? 1 : -1};
        mesh_place p;
        assert_true(mesh_place_find(tree, x, k % 3 ? &normal : NULL, INFINITY, &p));
        assert_true(p.triangle < first);
    }
    triangle_tree_free(tree);
    mesh_free(&m);
}

static void a_triangle_without_area_has_no_point_of_others(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 4);
    mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 1}, 1), narrow = {0};
    mesh_fixture_append(&narrow, mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 1}, 1));
    narrow.triangle_count = 1; /* from one corner to another and back */
    narrow.triangle[0][2] = narrow.triangle[0][1];
    const vec3 from = corner(&narrow, 0, 0), to = corner(&narrow, 0, 1);
    mesh_fixture_append(&narrow, m);
    triangle_tree *tree = tree_of(&narrow);
    for (int k = 0; k < CASES; k++) {
        mesh_place p;
        assert_true(mesh_place_find(tree, vec3_axpy(rng_uniform(&r), vec3_sub(to, from), from), NULL, 1, &p));
        assert_true(p.triangle > 0);
    }
    triangle_tree_free(tree);
    mesh_free(&narrow);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_wall_of_a_thin_plate_is_that_of_the_position),
        cmocka_unit_test(on_an_edge_the_face_of_the_normal_has_the_point),
        cmocka_unit_test(without_a_normal_the_first_triangle_has_the_point),
        cmocka_unit_test(coincident_faces_are_one_sheet),
        cmocka_unit_test(a_triangle_without_area_has_no_point_of_others),
    };
    return cmocka_run_group_tests_name("mesh_place", tests, NULL, NULL);
}
