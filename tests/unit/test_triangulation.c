// SPDX-License-Identifier: Apache-2.0
/* triangulation: closed where the points resolve the surface, open at boundaries and holes, with correct
 * facts. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/voronoi/triangulation.h"
#include "point_set.h"

static triangulation triangulate(const point_set *s, const bbox *domain, int workers)
{
    error e = {0};
    threads *pool = threads_new(workers, NULL, &e);
    const triangulation_input in = {.count = s->points.count,
                                    .position = s->position,
                                    .normal = s->normal,
                                    .spacing = s->points.spacing,
                                    .open = domain != NULL,
                                    .domain = domain ? *domain : bbox_empty()};
    triangulation made;
    if (!pool || !triangulation_make(&in, pool, &made, &e)) fail_msg("%s", e.message);
    threads_free(pool);
    return made;
}

/* Removes the points for which `keep` is false. */
static void keep_points(point_set *s, bool (*keep)(vec3 x))
{
    size_t kept = 0;
    for (size_t i = 0; i < s->points.count; i++) {
        if (!keep(s->position[i])) continue;
        s->position[kept] = s->position[i];
        s->normal[kept++] = s->normal[i];
    }
    s->points.count = kept;
}

static double volume_of(const point_set *s, const triangulation *t)
{
    double volume = 0;
    for (size_t k = 0; k < t->facts.triangles; k++) {
        const uint32_t *c = t->corner[k];
        volume += vec3_dot(s->position[c[0]], vec3_cross(s->position[c[1]], s->position[c[2]])) / 6;
    }
    return volume;
}

/* In one partition and in two, with any number of threads. */
static void spheres_are_closed(void **state)
{
    (void)state;
    static const size_t counts[] = {50, 3000, 120000};
    for (int k = 0; k < 3; k++) {
        point_set s = point_set_sphere(counts[k], vec3_make(0, 0, 0), 1);
        triangulation one = triangulate(&s, NULL, 1), three = triangulate(&s, NULL, 3);
        const triangulation_facts *f = &one.facts;
        assert_true(triangulation_is_closed(f) && triangulation_is_manifold(f));
        assert_int_equal(f->triangles, 2 * counts[k] - 4);
        assert_int_equal(f->edges, 3 * counts[k] - 6);
        assert_int_equal(f->euler, 2);
        assert_close(volume_of(&s, &one), 4 * M_PI / 3, 30.0 / (double)counts[k]); /* and outward normals */
        assert_true(f->radius_ratio > 0.8 && f->radius_ratio < 1);
        assert_int_equal(three.facts.triangles, f->triangles);
        assert_memory_equal(three.corner, one.corner, f->triangles * sizeof *one.corner);
        for (size_t t = 0; t < f->triangles; t++)
            assert_true(one.corner[t][0] < one.corner[t][1] && one.corner[t][0] < one.corner[t][2]);
        triangulation_free(&one);
        triangulation_free(&three);
        point_set_free(&s);
    }
}

enum { SIDE = 20 };

/* A plane of equilateral triangles with an edge of 1, for points with the spacing `spacing`, without those
 * closer than `hole` to its centre. */
static point_set make_sheet(double spacing, double hole)
{
    point_set s = point_set_new(SIDE * SIDE);
    vec3 middle = {SIDE / 2 + 0.25 * SIDE, sqrt(0.75) * SIDE / 2, 0};
    size_t kept = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        int row = i / SIDE;
        vec3 x = {i % SIDE + 0.5 * row, row * sqrt(0.75), 0};
        if (vec3_norm(vec3_sub(x, middle)) < hole) continue;
        s.position[kept] = x;
        s.normal[kept] = vec3_make(0, 0, 1);
        point_set_scalars(&s, kept++, 0, 0, 1, spacing);
    }
    s.points.count = kept;
    return s;
}

/* Equilateral triangles have the ratio 1. */
static void the_ratio_is_that_of_the_radii(void **state)
{
    (void)state;
    point_set s = make_sheet(1, 0);
    triangulation t = triangulate(&s, NULL, 1);
    assert_int_equal(t.facts.triangles, 2 * (SIDE - 1) * (SIDE - 1));
    assert_int_equal(t.facts.euler, 1);
    assert_int_equal(t.facts.boundary_edges, 4 * (SIDE - 1));
    assert_close(t.facts.radius_ratio, 1, 1e-12);
    triangulation_free(&t);
    point_set_free(&s);
}

/* A hole wider than the spacing, which no one-ring spans, is closed if it has few edges. */
static void small_holes_are_closed(void **state)
{
    (void)state;
    point_set s = make_sheet(0.6, 0.5);
    assert_int_equal(s.points.count, SIDE * SIDE - 1);
    triangulation t = triangulate(&s, NULL, 1);
    assert_int_equal(t.facts.hole_triangles, 4);
    assert_int_equal(t.facts.boundary_edges, 4 * (SIDE - 1));
    assert_int_equal(t.facts.nonmanifold_edges + t.facts.nonmanifold_vertices, 0);
    assert_int_equal(t.facts.euler, 1);
    for (size_t k = 0; k < t.facts.triangles; k++) {
        const uint32_t *c = t.corner[k];
        vec3 u = vec3_sub(s.position[c[1]], s.position[c[0]]),
             v = vec3_sub(s.position[c[2]], s.position[c[0]]);
        assert_true(vec3_cross(u, v).z > 0 && c[0] < c[1] && c[0] < c[2]);
    }
    triangulation_free(&t);
    point_set_free(&s);
    s = make_sheet(0.6, 1.1);
    assert_int_equal(s.points.count, SIDE * SIDE - 7);
    t = triangulate(&s, NULL, 1);
    assert_int_equal(t.facts.hole_triangles, 0);
    assert_int_equal(t.facts.boundary_edges, 4 * (SIDE - 1) + 12);
    assert_int_equal(t.facts.euler, 0);
    triangulation_free(&t);
    point_set_free(&s);
}

static bool is_above(vec3 x)
{
    return x.z > 0.1;
}

static bool is_beside_hole(vec3 x)
{
    return x.x < 0.97;
}

static void rims_and_holes_are_distinguished(void **state)
{
    (void)state;
    const bbox above = {{-INFINITY, -INFINITY, 0.1}, {INFINITY, INFINITY, INFINITY}};
    point_set s = point_set_sphere(5000, vec3_make(0, 0, 0), 1);
    keep_points(&s, is_above);
    triangulation t = triangulate(&s, &above, 1);
    assert_true(triangulation_is_manifold(&t.facts) && !triangulation_is_closed(&t.facts));
    assert_int_equal(t.facts.euler, 1);
    assert_int_equal(t.facts.rim_edges, t.facts.boundary_edges);
    triangulation_free(&t);
    keep_points(&s, is_beside_hole);
    t = triangulate(&s, &above, 1);
    assert_false(triangulation_is_manifold(&t.facts));
    assert_true(t.facts.boundary_edges > t.facts.rim_edges && t.facts.rim_edges > 0);
    triangulation_free(&t);
    point_set_free(&s);
}

/* Halves of a sphere that are shifted across each other, and a single point. */
static void non_manifold_results_are_reported(void **state)
{
    (void)state;
    point_set s = point_set_sphere(2000, vec3_make(0, 0, 0), 1), alone = point_set_new(1);
    for (size_t i = 0; i < 1000; i++) {
        s.position[i].x += 0.4;
        s.position[i].z -= 0.35;
    }
    triangulation t = triangulate(&s, NULL, 1);
    assert_false(triangulation_is_manifold(&t.facts));
    triangulation_free(&t);
    alone.position[0] = vec3_make(0, 0, 0);
    alone.normal[0] = vec3_make(0, 0, 1);
    point_set_scalars(&alone, 0, 0, 0, 1, 1);
    t = triangulate(&alone, NULL, 1);
    assert_int_equal(t.facts.nonmanifold_vertices, 1);
    assert_int_equal(t.facts.triangles, 0);
    assert_false(triangulation_is_manifold(&t.facts));
    triangulation_free(&t);
    point_set_free(&s);
    point_set_free(&alone);
}

/* A closed triangulation without one triangle: its corners are faulty. Then they are the ends of steps along a
 * curve that bounds the surface. */
static void faulty_vertices_are_marked(void **state)
{
    (void)state;
    enum { POINTS = 500 };
    point_set s = point_set_sphere(POINTS, vec3_make(0, 0, 0), 1);
    triangulation t = triangulate(&s, NULL, 1);
    bool faulty[POINTS];
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    triangulation_input in = {
        .count = POINTS, .position = s.position, .normal = s.normal, .spacing = s.points.spacing};
    const uint32_t *gone = t.corner[--t.facts.triangles];
    const uint32_t side[3][2] = {{gone[0], gone[1]}, {gone[1], gone[2]}, {gone[2], gone[0]}};
    assert_non_null(pool);
    assert_true(triangulation_survey(&in, pool, &t, faulty, &e));
    assert_int_equal(triangulation_faults(&t.facts), 3);
    for (uint32_t v = 0; v < POINTS; v++)
        assert_int_equal(faulty[v], v == gone[0] || v == gone[1] || v == gone[2]);
    in.side = side;
    in.side_count = 3;
    assert_true(triangulation_survey(&in, pool, &t, faulty, &e));
    assert_int_equal(triangulation_faults(&t.facts), 0);
    for (uint32_t v = 0; v < POINTS; v++) assert_false(faulty[v]);
    threads_free(pool);
    triangulation_free(&t);
    point_set_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres_are_closed),
        cmocka_unit_test(the_ratio_is_that_of_the_radii),
        cmocka_unit_test(small_holes_are_closed),
        cmocka_unit_test(rims_and_holes_are_distinguished),
        cmocka_unit_test(non_manifold_results_are_reported),
        cmocka_unit_test(faulty_vertices_are_marked),
    };
    return cmocka_run_group_tests_name("triangulation", tests, NULL, NULL);
}
