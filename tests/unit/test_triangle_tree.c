// SPDX-License-Identifier: Apache-2.0
/* Searches of trees of triangles return the same as a comparison with all triangles. */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "surface/triangles/triangle_tree.h"
#include "mesh_fixture.h"
#include "shapes.h"

enum { PLACES = 400, PARTS = 9 };
static const double ROUNDING = 1e-12;

static triangle triangle_of(const mesh *m, size_t n)
{
    const uint32_t *t = m->triangle[n];
    return (triangle){m->vertex[t[0]], m->vertex[t[1]], m->vertex[t[2]]};
}

/* The squared distance of the closest triangle. */
static double least_distance2(const mesh *m, vec3 p)
{
    double least = INFINITY;
    for (size_t n = 0; n < m->triangle_count; n++) {
        const triangle t = triangle_of(m, n);
        least = fmin(least, triangle_distance2(&t, p));
    }
    return least;
}

/* A mesh, its tree, and a forest of its parts. */
typedef struct fixture {
    mesh m, part[PARTS];
    triangle_tree *tree, *of_part[PARTS];
    triangle_forest *forest;
} fixture;

static void setup(fixture *f, mesh m)
{
    error e = {0};
    f->m = m;
    f->tree = triangle_tree_new(&f->m, NULL, &e);
    assert_non_null(f->tree);
    for (size_t k = 0; k < PARTS; k++) {
        const size_t first = k * m.triangle_count / PARTS, end = (k + 1) * m.triangle_count / PARTS;
        f->part[k] = m;
        f->part[k].triangle = m.triangle + first;
        f->part[k].triangle_count = end - first;
        f->of_part[k] =
            k % 2 ? triangle_tree_new(&f->part[k], NULL, &e) : triangle_tree_new_lazy(&f->part[k]);
    }
    f->forest = triangle_forest_new((const triangle_tree *const *)f->of_part, PARTS, &e);
    assert_non_null(f->forest);
}

static void teardown(fixture *f)
{
    triangle_forest_free(f->forest);
    for (size_t k = 0; k < PARTS; k++) triangle_tree_free(f->of_part[k]);
    triangle_tree_free(f->tree);
    mesh_free(&f->m);
}

static vec3 random_place(rng *r)
{
    return random_between(r, (vec3){-2, -2, -2}, (vec3){2, 2, 2});
}

/* A cylinder along the diagonal of the coordinates. */
static vec3 place_on_diagonal(double u, double v)
{
    const vec3 axis = vec3_unit((vec3){1, 1, 1}), across = vec3_unit((vec3){1, -1, 0});
    const double angle = 6.283185307179586 * v;
    return vec3_axpy(2 * u - 1, axis,
                     vec3_axpy(cos(angle), across, vec3_scale(vec3_cross(axis, across), sin(angle))));
}

/* 4 000 slivers of aspect 600. The box of each is nearly that of the cylinder. */
static mesh slivers(void)
{
    return mesh_fixture_sheet(1, 2000, place_on_diagonal);
}

static void assert_closest_is_found(mesh m, uint64_t stream)
{
    rng r = rng_seed(test_seed(), stream);
    fixture f;
    setup(&f, m);
    for (int p = 0; p < PLACES; p++) {
        const vec3 x = random_place(&r);
        const double least = least_distance2(&f.m, x);
        double weight[3], bound = 2 * least + 1e-6;
        const size_t start = (size_t)(rng_uniform(&r) * (double)f.m.triangle_count);
        size_t found = triangle_tree_find(f.tree, x, weight), in_part = 0;
        triangle t = triangle_of(&f.m, found);
        assert_true(fabs(triangle_distance2(&t, x) - least) <= ROUNDING * least);
        assert_true(fabs(weight[0] + weight[1] + weight[2] - 1) < 1e-12);
        assert_int_equal(triangle_tree_find_from(f.tree, x, start, weight), found);
        assert_true(triangle_tree_find_nearer(f.tree, x, &bound, &found) &&
                    fabs(bound - least) <= ROUNDING * least);
        /* no triangle is closer than the closest one */
        assert_false(triangle_tree_find_nearer(f.tree, x, &bound, &found));
        size_t tree = triangle_forest_find(f.forest, x, &in_part);
        t = triangle_of(&f.part[tree], in_part);
        assert_true(fabs(triangle_distance2(&t, x) - least) <= ROUNDING * least);
        size_t other = (tree + 4) % PARTS, in_other = 0;
        triangle_forest_improve(f.forest, x, &other, &in_other);
        assert_int_equal(other, tree);
        assert_int_equal(in_other, in_part);
    }
    teardown(&f);
}

static void the_closest_triangle_is_found(void **state)
{
    (void)state;
    assert_closest_is_found(mesh_fixture_ball((vec3){0, 0, 0}, 1, 3), 0);
}

static void construction_ends_when_the_pool_is_stopped(void **state)
{
    (void)state;
    error e = {0};
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 3);
    volatile sig_atomic_t stop = 0;
    threads *pool = threads_new(1, &stop, &e);
    triangle_tree *whole = triangle_tree_new(&m, pool, &e);
    assert_non_null(whole);
    stop = 1;
    assert_null(triangle_tree_new(&m, pool, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    triangle_tree_free(whole);
    threads_free(pool);
    mesh_free(&m);
}

static void the_closest_sliver_is_found(void **state)
{
    (void)state;
    assert_closest_is_found(slivers(), 3);
}

/* Marks a triangle. */
static void mark(void *context, size_t tree, size_t n, const triangle *t)
{
    (void)t;
    assert_int_equal(tree, 0);
    ((bool *)context)[n] = true;
}

static void all_near_slivers_are_visited(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 4);
    fixture f;
    setup(&f, slivers());
    bool *marked = calloc(f.m.triangle_count, sizeof *marked);
    for (int p = 0; p < PLACES; p++) {
        const vec3 x = random_place(&r);
        const double within2 = rng_uniform(&r);
        memset(marked, 0, f.m.triangle_count * sizeof *marked);
        triangle_tree_visit_near(f.tree, x, within2, mark, marked);
        for (size_t n = 0; n < f.m.triangle_count; n++) {
            const triangle t = triangle_of(&f.m, n);
            assert_int_equal(marked[n], triangle_distance2(&t, x) <= within2);
        }
    }
    free(marked);
    teardown(&f);
}

static void a_line_crosses_each_sliver_once(void **state)
{
    (void)state;
    const vec3 axis = vec3_unit((vec3){1, 1, 1});
    rng r = rng_seed(test_seed(), 5);
    fixture f;
    setup(&f, slivers());
    for (int p = 0; p < PLACES; p++) { /* from a point of the axis outwards */
        const vec3 x = vec3_scale(axis, 0.5 * rng_uniform(&r)), away = random_place(&r);
        const vec3 d = vec3_unit(vec3_axpy(-vec3_dot(away, axis), axis, away));
        const line_crossings found = triangle_tree_cross(f.tree, x, d, TRIANGLE_TREE_NONE);
        assert_int_equal(abs(found.winding), 1);
        assert_true(fabs(found.ahead - 1) < 1e-5 && fabs(found.behind - 1) < 1e-5);
    }
    teardown(&f);
}

static bool is_upper(const void *context, size_t n, const triangle *t)
{
    (void)context, (void)n;
    return t->a.z + t->b.z + t->c.z > 0;
}

static void the_closest_accepted_place_is_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    fixture f;
    setup(&f, mesh_fixture_ball((vec3){0, 0, 0}, 1, 3));
    for (int p = 0; p < PLACES; p++) {
        const vec3 x = random_place(&r);
        const double within = 3 * rng_uniform(&r);
        double least = INFINITY;
        for (size_t n = 0; n < f.m.triangle_count; n++) {
            const triangle t = triangle_of(&f.m, n);
            if (is_upper(NULL, n, &t)) least = fmin(least, triangle_distance2(&t, x));
        }
        vec3 place;
        const bool is_found = triangle_forest_find_accepted(f.forest, x, within, is_upper, NULL, &place);
        assert_int_equal(is_found, least < within * within);
        if (is_found) assert_true(fabs(vec3_norm(vec3_sub(place, x)) - sqrt(least)) < 1e-12);
    }
    teardown(&f);
}

/* The crossing of a line with a triangle, by the volumes of the line with its sides. False: there is none. */
static bool crosses(const triangle *t, vec3 p, vec3 d, double *at, int *sign)
{
    const vec3 a = vec3_sub(t->a, p), b = vec3_sub(t->b, p), c = vec3_sub(t->c, p),
               normal = vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
    const double u = vec3_dot(d, vec3_cross(a, b)), v = vec3_dot(d, vec3_cross(b, c)),
                 w = vec3_dot(d, vec3_cross(c, a));
    *sign = vec3_dot(d, normal) > 0 ? 1 : -1;
    *at = vec3_dot(a, normal) / vec3_dot(d, normal);
    return (u > 0 && v > 0 && w > 0) || (u < 0 && v < 0 && w < 0);
}

static void assert_same_crossings(line_crossings a, line_crossings b)
{
    assert_int_equal(a.winding, b.winding);
    assert_true(a.ahead == b.ahead || fabs(a.ahead - b.ahead) < 1e-9);
    assert_true(a.behind == b.behind || fabs(a.behind - b.behind) < 1e-9);
}

/* Two overlapping balls. */
static void crossings_of_lines_are_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    fixture f;
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 3);
    mesh_fixture_append(&m, mesh_fixture_ball((vec3){0.8, 0.1, 0.2}, 0.7, 2));
    setup(&f, m);
    for (int p = 0; p < PLACES; p++) {
        const vec3 x = random_place(&r), d = vec3_unit(random_place(&r));
        const uint32_t skip =
            p % 2 ? TRIANGLE_TREE_NONE : (uint32_t)(rng_uniform(&r) * (double)f.m.triangle_count);
        line_crossings all = {INFINITY, INFINITY, 0}, others = all;
        for (size_t n = 0; n < f.m.triangle_count; n++) {
            const triangle t = triangle_of(&f.m, n);
            double at;
            int sign;
            if (!crosses(&t, x, d, &at, &sign)) continue;
            for (int k = 0; k < (n == skip ? 1 : 2); k++) {
                line_crossings *c = k ? &others : &all;
                if (at < 0) c->behind = fmin(c->behind, -at);
                if (at >= 0) c->ahead = fmin(c->ahead, at);
                c->winding += at >= 0 ? sign : 0;
            }
        }
        const double in_first = vec3_norm(x), in_second = vec3_norm(vec3_sub(x, (vec3){0.8, 0.1, 0.2}));
        if (fabs(in_first - 1) > 0.05 && fabs(in_second - 0.7) > 0.05)
            assert_int_equal(all.winding, (in_first < 1) + (in_second < 0.7));
        assert_same_crossings(triangle_tree_cross(f.tree, x, d, skip), others);
        assert_same_crossings(triangle_forest_cross(f.forest, x, d), all);
    }
    teardown(&f);
}

/* Rays from a place on a triangle of two overlapping balls to the first other triangle, of limited length. */
static void the_first_crossing_of_a_ray_is_found(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 6);
    fixture f;
    size_t found_some = 0;
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 3);
    mesh_fixture_append(&m, mesh_fixture_ball((vec3){0.8, 0.1, 0.2}, 0.7, 2));
    setup(&f, m);
    for (int p = 0; p < PLACES; p++) {
        const size_t skip = (size_t)(rng_uniform(&r) * (double)f.m.triangle_count);
        const triangle from = triangle_of(&f.m, skip);
        const vec3 x = vec3_scale(vec3_add(from.a, vec3_add(from.b, from.c)), 1.0 / 3),
                   d = p % 8 ? vec3_unit(random_place(&r)) : (vec3){0, 0, p % 16 ? 1 : -1};
        const double within = p % 3 ? 2 * rng_uniform(&r) : INFINITY;
        ray_crossing nearest = {INFINITY, 0, 0}, own = {0};
        for (size_t part = 0; part < PARTS; part++)
            for (size_t n = 0; n < f.part[part].triangle_count; n++) {
                const triangle t = triangle_of(&f.part[part], n);
                double at;
                int sign;
                if (&f.part[part].triangle[n] == &f.m.triangle[skip])
                    own = (ray_crossing){0, part, n};
                else if (crosses(&t, x, d, &at, &sign) && at >= 0 && at < within && at < nearest.distance)
                    nearest = (ray_crossing){at, part, n};
            }
        const ray_crossing found = triangle_forest_first_crossing(f.forest, x, d, within, &own);
        assert_int_equal(found.distance < INFINITY, nearest.distance < INFINITY);
        if (!(nearest.distance < INFINITY)) continue;
        found_some++;
        assert_true(fabs(found.distance - nearest.distance) < 1e-9);
        assert_int_equal(found.tree, nearest.tree);
        assert_int_equal(found.triangle, nearest.triangle);
    }
    assert_in_range(found_some, PLACES / 8, PLACES - PLACES / 8);
    teardown(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_closest_triangle_is_found),
        cmocka_unit_test(construction_ends_when_the_pool_is_stopped),
        cmocka_unit_test(the_closest_sliver_is_found),
        cmocka_unit_test(all_near_slivers_are_visited),
        cmocka_unit_test(a_line_crosses_each_sliver_once),
        cmocka_unit_test(the_closest_accepted_place_is_found),
        cmocka_unit_test(crossings_of_lines_are_found),
        cmocka_unit_test(the_first_crossing_of_a_ray_is_found),
    };
    return cmocka_run_group_tests_name("triangle_tree", tests, NULL, NULL);
}
