// SPDX-License-Identifier: Apache-2.0
/* Orientation of meshes: normals agree along edges and point out of closed parts; cavities stay cavities. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "base/core/rng.h"
#include "surface/triangles/mesh_orientation.h"
#include "mesh_fixture.h"

/* Oriented patches of a mesh; edges with an angle of more than 0.7 are features. */
static mesh_patches oriented(mesh m)
{
    const mesh_patches_params params = {.weld = 1e-6, .feature_angle = 0.7, .pool = mesh_fixture_pool()};
    mesh_notes notes = {0};
    mesh_patches p = {0};
    error e = {0};
    if (!mesh_patches_make(&m, &params, &notes, &p, &e) || !mesh_orientation_fix(&p, &e))
        fail_msg("%s", e.message);
    return p;
}

/* The signed volume that the triangles enclose. */
static double volume_of(const mesh *m)
{
    double sum = 0;
    for (size_t n = 0; n < m->triangle_count; n++) {
        const uint32_t *t = m->triangle[n];
        sum += vec3_dot(m->vertex[t[0]], vec3_cross(m->vertex[t[1]], m->vertex[t[2]])) / 6;
    }
    return sum;
}

static void turn_all(mesh *m)
{
    for (size_t n = 0; n < m->triangle_count; n++) mesh_fixture_turn(m, n);
}

static void a_box_that_is_inside_out_gets_outward_normals(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box(vec3_make(3, -2, 5), vec3_make(1, 2, 0.5), 0.3);
    turn_all(&m);
    mesh_patches p = oriented(m);
    assert_int_equal(p.count, 6);
    assert_true(fabs(volume_of(&p.m) - 8) < 1e-9);
    assert_int_equal(p.turned, 12);
    mesh_patches_free(&p);
}

static void a_box_with_outward_normals_is_unchanged(void **state)
{
    (void)state;
    mesh_patches p = oriented(mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 1), 0.3));
    assert_true(fabs(volume_of(&p.m) - 8) < 1e-9);
    assert_int_equal(p.turned, 0);
    mesh_patches_free(&p);
}

/* A ball and a box with a third of the triangles reversed at random. */
static void mixed_faces_of_closed_parts_get_outward_normals(void **state)
{
    (void)state;
    const uint64_t seed = 20261127;
    print_message("seed %llu\n", (unsigned long long)seed);
    rng r = rng_seed(seed, 0);
    for (int round = 0; round < 10; round++) {
        mesh m = mesh_fixture_ball(vec3_make(0, 0, 0), 1, 2);
        mesh_fixture_append(&m, mesh_fixture_box(vec3_make(4, 0, 0), vec3_make(1, 1, 1), 0.3));
        const double wanted = volume_of(&m);
        size_t count = 0;
        for (size_t n = 0; n < m.triangle_count; n++)
            if (rng_uniform(&r) < 1.0 / 3) {
                mesh_fixture_turn(&m, n);
                count++;
            }
        mesh_patches p = oriented(m);
        assert_true(fabs(volume_of(&p.m) - wanted) < 1e-9);
        assert_int_equal(p.turned, count);
        mesh_patches_free(&p);
    }
}

/* A shell in another one: with inward normals it is a cavity, with outward normals another solid. Both are
 * kept if the whole file is inside out. */
static void an_inner_shell_keeps_its_relative_orientation(void **state)
{
    (void)state;
    for (int k = 0; k < 4; k++) {
        const bool cavity = k & 1, inside_out = k & 2;
        mesh outer = mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(2, 2, 2), 0.3),
             inner = mesh_fixture_box(vec3_make(0.1, 0, 0), vec3_make(1, 1, 1), 0.3);
        if (cavity) turn_all(&inner);
        mesh_fixture_append(&outer, inner);
        if (inside_out) turn_all(&outer);
        mesh_patches p = oriented(outer);
        assert_true(fabs(volume_of(&p.m) - (cavity ? 64 - 8 : 64 + 8)) < 1e-9);
        assert_int_equal(p.turned, inside_out ? 24 : 0);
        mesh_patches_free(&p);
    }
}

/* Four sides of a box with three sharp edges: the side that disagrees with the majority is reversed. */
static void an_open_part_agrees_along_its_edges(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 1), 0.3);
    mesh_fixture_remove(&m, 11);
    mesh_fixture_remove(&m, 10);
    mesh_fixture_turn(&m, 0);
    mesh_fixture_turn(&m, 1);
    mesh_patches p = oriented(m);
    assert_int_equal(p.turned, 2);
    for (size_t n = 0; n < p.m.triangle_count; n++) { /* all point outwards, as for the box */
        const uint32_t *t = p.m.triangle[n];
        const vec3 a = p.m.vertex[t[0]], b = p.m.vertex[t[1]], c = p.m.vertex[t[2]];
        assert_true(vec3_dot(a, vec3_cross(vec3_sub(b, a), vec3_sub(c, a))) > 0);
    }
    mesh_patches_free(&p);
}

static void a_moebius_strip_stays_one_sided(void **state)
{
    (void)state;
    mesh_patches p = oriented(mesh_fixture_sheet(40, 4, mesh_fixture_moebius));
    assert_int_equal(p.count, 1);
    assert_true(p.one_sided[0]);
    assert_int_equal(p.turned, 0);
    mesh_patches_free(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_box_that_is_inside_out_gets_outward_normals),
        cmocka_unit_test(a_box_with_outward_normals_is_unchanged),
        cmocka_unit_test(mixed_faces_of_closed_parts_get_outward_normals),
        cmocka_unit_test(an_inner_shell_keeps_its_relative_orientation),
        cmocka_unit_test(an_open_part_agrees_along_its_edges),
        cmocka_unit_test(a_moebius_strip_stays_one_sided),
    };
    return cmocka_run_group_tests_name("mesh orientation", tests, NULL, NULL);
}
