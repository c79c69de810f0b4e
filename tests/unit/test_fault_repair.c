// SPDX-License-Identifier: Apache-2.0
/* Faults of a triangulation of points on a mesh: where they are, and their repair along the mesh. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "geometry/mesh/mesh_weld.h"
#include "job/phases/mesh_faults.h"
#include "job/phases/fault_repair.h"
#include "mesh_fixture.h"

static const double spacing_wanted = 0.1;
static uint32_t no_label[MESH_FIXTURE_POINTS];

static triangulation_input input_of(const mesh_fixture_points *s)
{
    return (triangulation_input){.count = s->count,
                                 .position = s->position,
                                 .normal = s->normal,
                                 .spacing = s->spacing,
                                 .label = no_label,
                                 .point = s->name,
                                 .points = s->count};
}

static triangulation triangulate(const triangulation_input *in)
{
    triangulation made;
    error e = {0};
    if (!triangulation_make(in, mesh_fixture_pool(), &made, &e)) fail_msg("%s", e.message);
    return made;
}

static void repair(const triangulation_input *in, const mesh *on, triangulation *made)
{
    error e = {0};
    if (!fault_repair_along(in, on, mesh_fixture_pool(), made, &e)) fail_msg("%s", e.message);
}

static bool has_triangle(const triangulation *t, const uint32_t corner[3])
{
    for (size_t k = 0; k < t->facts.triangles; k++)
        if (memcmp(t->corner[k], corner, sizeof t->corner[k]) == 0) return true;
    return false;
}

static vec3 thorn(double u, double v)
{
    const double r = v < 0.5 ? sin(M_PI * 1.99 * v) : 0.031 * (2 - 2 * v),
                 z = v < 0.5 ? -cos(M_PI * 1.99 * v) : 0.6 + 0.8 * v;
    return mesh_fixture_rounded(vec3_make(r * cos(2 * M_PI * u), r * sin(2 * M_PI * u), z));
}

/* A ball with a thorn thinner than the spacing. */
static mesh thorny(void)
{
    mesh m = mesh_fixture_sheet(40, 80, thorn);
    mesh_notes unused = {0};
    error e = {0};
    assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &unused, &e));
    return m;
}

static void faults_are_replaced_and_other_triangles_are_kept(void **state)
{
    (void)state;
    mesh m = thorny();
    for (uint64_t seed = 1; seed <= 8; seed++) {
        mesh_fixture_points *s = mesh_fixture_scatter(&m, spacing_wanted, seed, 60000);
        const triangulation_input in = input_of(s);
        triangulation before = triangulate(&in), after = triangulate(&in);
        assert_false(triangulation_is_closed(&before.facts));
        repair(&in, &m, &after);
        assert_true(triangulation_is_closed(&after.facts));
        assert_int_equal(after.facts.euler, 2);
        size_t far = 0;
        for (size_t k = 0; k < before.facts.triangles; k++) {
            const uint32_t *t = before.corner[k];
            if (fmax(s->position[t[0]].z, fmax(s->position[t[1]].z, s->position[t[2]].z)) > 0.4) continue;
            assert_true(has_triangle(&after, t));
            far++;
        }
        assert_true(far > 800);
        triangulation_free(&before);
        triangulation_free(&after);
        free(s);
    }
    mesh_free(&m);
}

/* Faults are everywhere: the whole mesh is used. */
static void plates_thinner_than_the_spacing_are_closed(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 0.002), 0.3);
    mesh_fixture_points *s = mesh_fixture_scatter(&m, spacing_wanted, 7, 60000);
    const triangulation_input in = input_of(s);
    triangulation made = triangulate(&in);
    assert_false(triangulation_is_closed(&made.facts));
    repair(&in, &m, &made);
    assert_true(triangulation_is_closed(&made.facts));
    assert_int_equal(made.facts.euler, 2);
    triangulation_free(&made);
    free(s);
    mesh_free(&m);
}

/* A closed triangulation without one triangle: its corners are faulty. Then they are the ends of steps along a
 * curve that bounds the surface. */
static void faulty_vertices_are_marked(void **state)
{
    (void)state;
    mesh m = mesh_fixture_ball(vec3_make(0, 0, 0), 0.7, 4);
    mesh_fixture_points *s = mesh_fixture_scatter(&m, spacing_wanted, 7, 60000);
    triangulation_input in = input_of(s);
    triangulation made = triangulate(&in);
    bool faulty[MESH_FIXTURE_POINTS];
    size_t count;
    error e = {0};
    assert_true(triangulation_is_closed(&made.facts));
    assert_true(mesh_faults_mark(&in, &made, faulty, &count, &e));
    assert_int_equal(count, 0);
    const uint32_t *gone = made.corner[--made.facts.triangles];
    const uint32_t side[3][2] = {{gone[0], gone[1]}, {gone[1], gone[2]}, {gone[2], gone[0]}};
    assert_true(mesh_faults_mark(&in, &made, faulty, &count, &e));
    assert_int_equal(count, 3);
    for (int k = 0; k < 3; k++) assert_true(faulty[gone[k]]);
    in.side = side;
    in.side_count = 3;
    assert_true(mesh_faults_mark(&in, &made, faulty, &count, &e));
    assert_int_equal(count, 0);
    triangulation_free(&made);
    free(s);
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faults_are_replaced_and_other_triangles_are_kept),
        cmocka_unit_test(plates_thinner_than_the_spacing_are_closed),
        cmocka_unit_test(faulty_vertices_are_marked),
    };
    return cmocka_run_group_tests_name("fault_repair", tests, NULL, NULL);
}
