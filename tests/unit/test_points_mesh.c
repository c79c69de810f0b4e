// SPDX-License-Identifier: Apache-2.0
/* Faults of a triangulation of points on a mesh, or on patches, are repaired along the triangles. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_weld.h"
#include "job/phases/points_mesh.h"
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
    if (!points_mesh_repair(in, on, NULL, mesh_fixture_pool(), made, &e)) fail_msg("%s", e.message);
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

/* Half of a plate thinner than the spacing, open at x = 0, where the other half begins. */
static mesh half_plate(double end)
{
    static const int face[5][2][4] = {
        {{0, 4, 6, 2}, {1, 3, 7, 5}}, /* at `end`: x is the least, the largest */
        {{0, 1, 5, 4}},
        {{2, 6, 7, 3}},
        {{0, 2, 3, 1}},
        {{4, 5, 7, 6}}};
    mesh m = {.vertex = mem_array(8, sizeof *m.vertex, "a plate", NULL),
              .triangle = mem_array(10, sizeof *m.triangle, "a plate", NULL),
              .vertex_count = 8,
              .triangle_count = 10};
    const double low = fmin(end, 0), high = fmax(end, 0);
    for (int v = 0; v < 8; v++)
        m.vertex[v] = vec3_make(v & 1 ? high : low, v & 2 ? 0.5 : -0.5, v & 4 ? 0.001 : -0.001);
    for (int k = 0; k < 5; k++) {
        const int *v = face[k][k == 0 && end > 0];
        for (int c = 0; c < 3; c++) {
            m.triangle[2 * k][c] = (uint32_t)v[c];
            m.triangle[2 * k + 1][c] = (uint32_t)v[c > 0 ? c + 1 : 0];
        }
    }
    return m;
}

/* The curve between the halves has RIM points on each side of the plate. */
enum { RIM = 11 };

typedef struct two_patches {
    mesh_fixture_points points;
    uint32_t label[MESH_FIXTURE_POINTS], side[4 * RIM][2];
} two_patches;

static void put_point(two_patches *s, vec3 x, vec3 normal, uint32_t label, uint32_t vertex)
{
    mesh_fixture_points *p = &s->points;
    p->position[p->count] = x;
    p->normal[p->count] = normal;
    p->spacing[p->count] = spacing_wanted;
    p->name[p->count] = vertex;
    s->label[p->count++] = label;
}

static void put_rim(two_patches *s, uint32_t label)
{
    const uint32_t first = (uint32_t)s->points.count;
    for (uint32_t k = 0; k < 2 * RIM; k++) {
        const double y = -0.5 + (double)(k < RIM ? k : 2 * RIM - 1 - k) / (RIM - 1), z = k < RIM ? -1 : 1;
        put_point(s, vec3_make(0, y, 0.001 * z), vec3_make(0, 0, z), label, k);
        s->side[2 * RIM * label + k][0] = first + k;
        s->side[2 * RIM * label + k][1] = first + (k + 1) % (2 * RIM);
    }
}

static void put_half(two_patches *s, const mesh *half, uint32_t label)
{
    mesh_fixture_points *p = mesh_fixture_scatter(half, spacing_wanted, 7 + label, 60000);
    for (size_t i = 0; i < p->count; i++)
        if (fabs(p->position[i].x) > 0.5 * spacing_wanted)
            put_point(s, p->position[i], p->normal[i], label, (uint32_t)s->points.count);
    free(p);
}

static bool is_within(const void *context, uint32_t label, vec3 x)
{
    (void)context;
    return label == 0 ? x.x <= 0 : x.x >= 0;
}

/* Each patch is triangulated along its own triangles, and both end at the curve between them. */
static void patches_are_repaired_up_to_their_curves(void **state)
{
    (void)state;
    mesh m = half_plate(-1);
    two_patches *s = mem_alloc(sizeof *s);
    put_rim(s, 0);
    put_half(s, &m, 0);
    mesh other = half_plate(1);
    put_half(s, &other, 1);
    const size_t vertices = s->points.count;
    put_rim(s, 1);
    mesh_fixture_append(&m, other);
    size_t first[] = {0, 10, 20};
    const mesh_patches patches = {.m = m, .count = 2, .first = first};
    triangulation_input in = input_of(&s->points);
    in.label = s->label;
    in.points = vertices;
    in.side = (const uint32_t(*)[2])s->side;
    in.side_count = 4 * RIM;
    in.is_within = is_within;
    triangulation made = triangulate(&in);
    error e = {0};
    assert_false(triangulation_is_closed(&made.facts));
    if (!points_mesh_repair(&in, NULL, &patches, mesh_fixture_pool(), &made, &e)) fail_msg("%s", e.message);
    assert_true(triangulation_is_closed(&made.facts));
    assert_int_equal(made.facts.euler, 2);
    for (size_t k = 0; k < made.facts.triangles; k++)
        for (int c = 0; c < 3; c++)
            assert_true(made.corner[k][c] < 2 * RIM || s->label[made.corner[k][c]] == made.label[k]);
    triangulation_free(&made);
    mesh_free(&m);
    free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faults_are_replaced_and_other_triangles_are_kept),
        cmocka_unit_test(plates_thinner_than_the_spacing_are_closed),
        cmocka_unit_test(patches_are_repaired_up_to_their_curves),
    };
    return cmocka_run_group_tests_name("points_mesh", tests, NULL, NULL);
}
