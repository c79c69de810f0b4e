// SPDX-License-Identifier: Apache-2.0
/* Triangles between points on a mesh. They have its topology where opposite surfaces are closer than the
 * points, and where these meet in an edge as sharp as that of a blade.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core/rng.h"
#include "geometry/mesh/mesh_weld.h"
#include "mesh_fixture.h"
#include "sampling/voronoi/triangulation.h"
#include "surface/remesh/left_out.h"
#include "surface/remesh/surface_mesh.h"
#include "shapes.h"

static const double spacing_wanted = 0.1;

typedef mesh_fixture_points scattered;

static scattered *scatter(const mesh *m)
{
    return mesh_fixture_scatter(m, spacing_wanted, 7, 60000);
}

/* Checks the triangles between these points, some of which are connected by steps of curves. */
static void assert_whole(mesh m, scattered *s, const uint32_t (*side)[2], size_t side_count, int64_t euler)
{
    const surface_mesh_input in = {.m = &m,
                                   .count = s->count,
                                   .position = s->position,
                                   .spacing = s->spacing,
                                   .name = s->name,
                                   .names = s->count,
                                   .side = side,
                                   .side_count = side_count};
    const triangulation_input points = {
        .count = s->count, .position = s->position, .normal = s->normal, .spacing = s->spacing};
    triangulation made = {0};
    error e = {0};
    if (!surface_mesh_make(&in, &made.corner, &made.facts.triangles, &e) ||
        !triangulation_survey(&points, mesh_fixture_pool(), &made, NULL, &e))
        fail_msg("%s", e.message);
    assert_true(triangulation_is_closed(&made.facts));
    assert_int_equal(made.facts.euler, euler);
    triangulation_free(&made);
    mesh_free(&m);
    free(s);
}

static void assert_closed(mesh m, int64_t euler)
{
    assert_whole(m, scatter(&m), NULL, 0, euler);
}

static void balls_are_closed(void **state)
{
    (void)state;
    assert_closed(mesh_fixture_ball(vec3_make(0, 0, 0), 0.7, 4), 2);
}

static void plates_thinner_than_the_spacing_are_closed(void **state)
{
    (void)state;
    assert_closed(mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 0.002), 0.3), 2);
}

/* A surface whose coinciding vertices are welded. */
static mesh welded(int across, int along, vec3 (*place)(double u, double v))
{
    mesh m = mesh_fixture_sheet(across, along, place);
    mesh_notes unused = {0};
    error e = {0};
    assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &unused, &e));
    return m;
}

static vec3 blade(double u, double v)
{
    const double w = 2 * fmin(v, 1 - v); /* there and back */
    const double thick = (v < 0.5 ? 1 : -1) * 0.03 * sin(M_PI * u) * w * (1 - w);
    return mesh_fixture_rounded(vec3_make(2 * u, thick, w));
}

/* Both edges have angles of nearly 180 degrees, and the ends are lines. */
static void blades_are_closed(void **state)
{
    (void)state;
    assert_closed(welded(40, 20, blade), 2);
}

static void add_point(scattered *s, vec3 x)
{
    s->position[s->count] = x;
    s->normal[s->count] = (vec3){0, 0, 1};
    s->spacing[s->count] = spacing_wanted;
    s->name[s->count] = (uint32_t)s->count;
    s->count++;
}

/* Removes a point; the last one gets its index. */
static void drop_point(scattered *s, size_t k)
{
    s->count--;
    s->position[k] = s->position[s->count];
    s->normal[k] = s->normal[s->count];
}

/* A fin as wide as the spacing: cells reach around it, so that front and back would have the same edges. The
 * edges of its sides are kept. */
static void fins_are_closed(void **state)
{
    (void)state;
    enum { POINTS = 40 };
    scattered *s = calloc(1, sizeof *s);
    uint32_t side[POINTS][2];
    size_t sides = 0;
    for (uint32_t k = 0; k < POINTS; k++) {
        add_point(s, vec3_make(0.025 + 0.05 * k, k % 2 ? 0.08 : 0, 0.001));
        if (k < 2) continue;
        side[sides][0] = k - 2;
        side[sides++][1] = k;
    }
    assert_whole(mesh_fixture_box(vec3_make(1, 0.04, 0), vec3_make(1, 0.04, 0.001), 0), s,
                 (const uint32_t(*)[2])side, sides, 2);
}

static vec3 thorn(double u, double v)
{
    const double r = v < 0.5 ? sin(M_PI * 1.99 * v) : 0.031 * (2 - 2 * v),
                 z = v < 0.5 ? -cos(M_PI * 1.99 * v) : 0.6 + 0.8 * v;
    return mesh_fixture_rounded(vec3_make(r * cos(2 * M_PI * u), r * sin(2 * M_PI * u), z));
}

/* Points on a thorn except its tip. */
static scattered *scatter_below_tip(const mesh *m)
{
    scattered *s = scatter(m);
    for (size_t k = 0; k < s->count;)
        if (s->position[k].z > 1.02)
            drop_point(s, k);
        else
            k++;
    return s;
}

/* The cell of the point below the tip of a thorn reaches around it. */
static void tips_are_corners(void **state)
{
    (void)state;
    mesh m = welded(40, 80, thorn);
    scattered *s = scatter_below_tip(&m);
    add_point(s, vec3_make(0.0155, 0, 1.2));
    add_point(s, vec3_make(0, 0, 1.4));
    assert_whole(m, s, NULL, 0, 2);
}

/* The cells of several points, one above the other, reach around it, too. */
static void thorns_of_rings_are_closed(void **state)
{
    (void)state;
    mesh m = welded(40, 80, thorn);
    scattered *s = scatter_below_tip(&m);
    for (int k = 1; k < 4; k++) add_point(s, vec3_make(0.031 * (1 - 0.25 * k), 0, 1 + 0.1 * k));
    add_point(s, vec3_make(0, 0, 1.4));
    assert_whole(m, s, NULL, 0, 2);
}

/* A ring around two points that share the tip: they have the ring and each other as neighbours, and no
 * fourth. */
static void tips_of_two_points_are_closed(void **state)
{
    (void)state;
    mesh m = welded(40, 80, thorn);
    scattered *s = scatter_below_tip(&m);
    add_point(s, vec3_make(0, 0.0155, 1.2));
    add_point(s, vec3_make(0.0039, 0, 1.35));
    add_point(s, vec3_make(-0.0039, 0, 1.35));
    assert_whole(m, s, NULL, 0, 2);
}

/* A few points at random on a thorn: rings, halves of rings, and the points inside them. */
static void assert_whole_with_thorn(uint64_t seed, uint64_t stream)
{
    mesh m = welded(40, 80, thorn);
    scattered *s = scatter_below_tip(&m);
    rng r = rng_seed(seed, stream);
    for (int left = 2 + (int)(5 * rng_uniform(&r)); left > 0; left--) {
        const double z = 1.03 + 0.36 * rng_uniform(&r), turn = 2 * M_PI * rng_uniform(&r),
                     away = 0.031 * (2 - 2 * (z - 0.6) / 0.8);
        add_point(s, vec3_make(away * cos(turn), away * sin(turn), z));
    }
    assert_whole(m, s, NULL, 0, 2);
}

static void thorns_of_any_points_are_closed(void **state)
{
    (void)state;
    assert_whole_with_thorn(11, 174); /* a ring between two pairs of points, which it surrounds */
    const uint64_t seed = test_seed();
    for (uint64_t stream = 0; stream < 3; stream++) assert_whole_with_thorn(seed, stream);
}

static vec3 bead(double u, double v)
{
    const double r = v < 0.4   ? fmax(sin(M_PI * 2.49 * v), v < 0.2 ? 0 : 0.02)
                     : v < 0.6 ? 0.02
                               : fmax(sin(M_PI * 2.49 * (1 - v)), v > 0.8 ? 0 : 0.02),
                 z = v < 0.4   ? -cos(M_PI * 2.49 * v)
                     : v < 0.6 ? 1 + (v - 0.4)
                               : 2.2 + cos(M_PI * 2.49 * (1 - v));
    return mesh_fixture_rounded(vec3_make(r * cos(2 * M_PI * u), r * sin(2 * M_PI * u), z));
}

/* Two balls joined by a bar with one point: its cell reaches around the bar. */
static void necks_are_tubes(void **state)
{
    (void)state;
    mesh m = welded(40, 80, bead);
    scattered *s = scatter(&m);
    for (size_t k = 0; k < s->count;)
        if (fabs(s->position[k].z - 1.1) < 0.12)
            drop_point(s, k);
        else
            k++;
    add_point(s, vec3_make(0.02, 0, 1.1));
    assert_whole(m, s, NULL, 0, 2);
}

/* The same bar with points at its ends: their cells meet there and have no third neighbour, or have a
 * neighbour that meets both. */
static void bars_of_few_points_are_tubes(void **state)
{
    (void)state;
    for (int middle = 0; middle < 2; middle++) {
        mesh m = welded(40, 80, bead);
        scattered *s = scatter(&m);
        for (size_t k = 0; k < s->count;)
            if (fabs(s->position[k].z - 1.1) < 0.15)
                drop_point(s, k);
            else
                k++;
        add_point(s, vec3_make(0.02, 0, 1.01));
        add_point(s, vec3_make(0.02, 0, 1.19));
        if (middle) add_point(s, vec3_make(0.02, 0, 1.1));
        assert_whole(m, s, NULL, 0, 2);
    }
}

/* A torus whose tube is a thin bar in one part. */
static const double bar_turns = 0.03, bar_radius = 0.012;

static vec3 handle(double u, double v)
{
    const double r = fabs(v - 0.5) < bar_turns ? bar_radius : 0.4, a = 2 * M_PI * v, b = 2 * M_PI * u;
    return mesh_fixture_rounded(
        vec3_make((0.42 + r * cos(b)) * cos(a), (0.42 + r * cos(b)) * sin(a), r * sin(b)));
}

/* The ends of a cell that reaches around the bar may touch the same cell. */
static void necks_at_handles_have_no_empty_triangle(void **state)
{
    (void)state;
    mesh m = welded(24, 100, handle);
    error e = {0};
    for (uint64_t seed = 1; seed <= 30; seed++) {
        scattered *s = mesh_fixture_scatter(&m, 0.3, seed, 3000);
        for (size_t i = 0; i < s->count;)
            if (M_PI - fabs(atan2(s->position[i].y, s->position[i].x)) < 2 * M_PI * bar_turns)
                drop_point(s, i);
            else
                i++;
        add_point(s, vec3_make(-0.42, 0, bar_radius));
        s->spacing[s->count - 1] = 0.3;
        const surface_mesh_input in = {.m = &m,
                                       .count = s->count,
                                       .position = s->position,
                                       .spacing = s->spacing,
                                       .name = s->name,
                                       .names = s->count};
        uint32_t(*triangle)[3] = NULL;
        size_t count = 0;
        assert_true(surface_mesh_make(&in, &triangle, &count, &e));
        for (size_t k = 0; k < count; k++) {
            const uint32_t *t = triangle[k];
            assert_true(t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
        }
        free(triangle);
        free(s);
    }
    mesh_free(&m);
}

/* A flat wedge. The cell of the point in its corner touches only one other cell and the boundary. */
static vec3 wedge(double u, double v)
{
    return mesh_fixture_rounded(vec3_make(u, u * (2 * v - 1) * tan(M_PI / 18), 0));
}

static void corners_of_open_sheets_do_not_fold(void **state)
{
    (void)state;
    mesh m = welded(40, 20, wedge);
    error e = {0};
    for (int k = 0; k < 5; k++) {
        scattered *s = calloc(1, sizeof *s);
        uint32_t side[200][2];
        size_t sides = 0;
        add_point(s, vec3_make(0, 0, 0));
        for (int which = 0; which < 2; which++) {
            const double step = which ? 0.1 * (1 + 0.1 * k) : 0.1, turn = (which ? 1 : -1) * M_PI / 18;
            uint32_t last = 0;
            for (double t = step; t <= 1 / cos(turn) + 1e-9; t += step) {
                add_point(s, vec3_make(t * cos(turn), t * sin(turn), 0));
                side[sides][0] = last;
                side[sides++][1] = last = (uint32_t)s->count - 1;
            }
        }
        for (double x = 0.4; x < 1; x += 0.1) add_point(s, vec3_make(x, 0, 0));
        for (size_t i = 0; i < s->count; i++) s->spacing[i] = 0.1;
        const surface_mesh_input in = {.m = &m,
                                       .count = s->count,
                                       .position = s->position,
                                       .spacing = s->spacing,
                                       .name = s->name,
                                       .names = s->count,
                                       .side = (const uint32_t(*)[2])side,
                                       .side_count = sides};
        uint32_t(*triangle)[3] = NULL;
        size_t count = 0;
        assert_true(surface_mesh_make(&in, &triangle, &count, &e));
        assert_true(count > 20);
        for (size_t n = 0; n < count; n++) {
            const vec3 a = s->position[triangle[n][0]];
            const vec3 across = vec3_cross(vec3_sub(s->position[triangle[n][1]], a),
                                           vec3_sub(s->position[triangle[n][2]], a));
            assert_true(across.z > -1e-12);
        }
        free(triangle);
        free(s);
    }
    mesh_free(&m);
}

/* Triangles that cut a corner off a box miss the corner; the triangles of the whole box miss nothing. */
static void undersampled_parts_are_found(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box(vec3_make(0.1, 0.2, 0.3), vec3_make(0.5, 0.5, 0.5), 0.7);
    error e = {0};
    vec3 position[8], *place = NULL;
    double spacing[8];
    size_t count = 0;
    assert_int_equal(m.vertex_count, 8);
    for (size_t k = 0; k < 8; k++) {
        position[k] = m.vertex[k];
        spacing[k] = 1;
    }
    const left_out_input in = {&m, 8, position, spacing, (const uint32_t(*)[3])m.triangle, m.triangle_count};
    assert_true(left_out_find(&in, 0.1, 10, mesh_fixture_pool(), &place, &count, &e));
    assert_int_equal(count, 0);
    free(place);
    const uint32_t cut = 5;
    position[cut] = vec3_axpy(0.4, vec3_sub(vec3_make(0.1, 0.2, 0.3), position[cut]), position[cut]);
    assert_true(left_out_find(&in, 0.1, 10, mesh_fixture_pool(), &place, &count, &e));
    assert_true(count >= 1);
    assert_true(vec3_norm(vec3_sub(place[0], m.vertex[cut])) < 1e-12);
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j < i; j++) assert_true(vec3_norm(vec3_sub(place[i], place[j])) > 1);
    free(place);
    assert_true(left_out_find(&in, 0.9, 10, mesh_fixture_pool(), &place, &count, &e));
    assert_int_equal(count, 0);
    free(place);
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(balls_are_closed),
        cmocka_unit_test(plates_thinner_than_the_spacing_are_closed),
        cmocka_unit_test(blades_are_closed),
        cmocka_unit_test(fins_are_closed),
        cmocka_unit_test(tips_are_corners),
        cmocka_unit_test(necks_are_tubes),
        cmocka_unit_test(bars_of_few_points_are_tubes),
        cmocka_unit_test(thorns_of_rings_are_closed),
        cmocka_unit_test(tips_of_two_points_are_closed),
        cmocka_unit_test(thorns_of_any_points_are_closed),
        cmocka_unit_test(necks_at_handles_have_no_empty_triangle),
        cmocka_unit_test(corners_of_open_sheets_do_not_fold),
        cmocka_unit_test(undersampled_parts_are_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
