// SPDX-License-Identifier: Apache-2.0
/* Euler characteristics of meshes of known topology. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "mesh_fixture.h"
#include "geometry/mesh/mesh_euler.h"
#include "geometry/mesh/mesh_weld.h"

static double euler_of(const mesh *m, bool borders)
{
    error e = {0};
    double euler = 0;
    assert_true(mesh_euler_add(m, borders, mesh_fixture_pool(), &euler, &e));
    return euler;
}

static vec3 flat(double u, double v)
{
    return vec3_make(u, v, 0);
}

static void assert_euler(mesh m, double whole, double inner)
{
    error e = {0};
    assert_true(mesh_weld_vertices(&m, mesh_fixture_pool(), &e));
    assert_true(euler_of(&m, true) == whole);
    assert_true(euler_of(&m, false) == inner);
    mesh_free(&m);
}

static void characteristic_is_that_of_the_shape(void **state)
{
    (void)state;
    assert_euler(mesh_fixture_ball(vec3_make(0, 0, 0), 1, 2), 2, 2);
    assert_euler(mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 1), 0.3), 2, 2);
    assert_euler(mesh_fixture_sheet(4, 3, flat), 1, 1);
    assert_euler(mesh_fixture_sheet(40, 4, mesh_fixture_moebius), 0, 0);
}

/* Three sheets that share an edge: without its borders, the edge counts once. */
static void edge_of_three_triangles_counts_once(void **state)
{
    (void)state;
    vec3 vertex[] = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
    uint32_t triangle[][3] = {{0, 1, 2}, {0, 1, 3}, {0, 1, 4}};
    const mesh m = {.vertex_count = 5, .triangle_count = 3, .vertex = vertex, .triangle = triangle};
    assert_true(euler_of(&m, true) == 1);
    assert_true(euler_of(&m, false) == 2); /* three triangles minus one edge */
}

/* A triangle with two equal corners connects its neighbours as if it were not there. */
static void triangle_with_equal_corners_changes_nothing(void **state)
{
    (void)state;
    vec3 vertex[] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
    uint32_t triangle[][3] = {{0, 1, 2}, {1, 1, 2}, {1, 3, 2}};
    const mesh m = {.vertex_count = 4, .triangle_count = 3, .vertex = vertex, .triangle = triangle};
    assert_true(euler_of(&m, true) == 1);
    assert_true(euler_of(&m, false) == 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(characteristic_is_that_of_the_shape),
        cmocka_unit_test(edge_of_three_triangles_counts_once),
        cmocka_unit_test(triangle_with_equal_corners_changes_nothing),
    };
    return cmocka_run_group_tests_name("mesh_euler", tests, NULL, NULL);
}
