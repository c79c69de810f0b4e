// SPDX-License-Identifier: Apache-2.0
/* Triangles without area that have three distinct corners: meshes damaged with them are repaired to closed
 * meshes of the same shape.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_weld.h"
#include "base/core/rng.h"
#include "geometry/space/triangle.h"
#include "mesh_fixture.h"
#include "geometry/mesh/flat_triangles.h"
#include "geometry/mesh/mesh_edges.h"

enum { SEED = 20261127 };

/* ---- damage: each function adds flat triangles to a mesh of sufficient capacity, and returns their
 * number */

static mesh with_room(mesh m, size_t more)
{
    mesh out = {m.vertex_count, m.triangle_count, mem_alloc((m.vertex_count + more) * sizeof *m.vertex),
                mem_alloc((m.triangle_count + more) * sizeof *m.triangle), false};
    memcpy(out.vertex, m.vertex, m.vertex_count * sizeof *m.vertex);
    memcpy(out.triangle, m.triangle, m.triangle_count * sizeof *m.triangle);
    mesh_free(&m);
    return out;
}

static uint32_t add_vertex(mesh *m, vec3 v)
{
    m->vertex[m->vertex_count] = v;
    return (uint32_t)m->vertex_count++;
}

static void add_triangle(mesh *m, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t *t = m->triangle[m->triangle_count++];
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

static vec3 between(const mesh *m, uint32_t a, uint32_t b, double s)
{
    return vec3_axpy(s, vec3_sub(m->vertex[b], m->vertex[a]), m->vertex[a]);
}

/* Splits triangle n into a fan at points on its side from a to b. Flat triangles connect these points to
 * the side. */
static size_t sliver_at_side(mesh *m, size_t n, size_t places, bool zigzag)
{
    const uint32_t a = m->triangle[n][0], b = m->triangle[n][1], c = m->triangle[n][2];
    uint32_t last = a;
    size_t flat = 0;
    m->triangle[n][1] = (uint32_t)m->vertex_count;
    for (size_t k = 1; k <= places; k++) {
        const uint32_t v = add_vertex(m, between(m, a, b, (double)k / (double)(places + 1)));
        if (k > 1) add_triangle(m, last, v, c);
        last = v;
    }
    add_triangle(m, last, b, c);
    const uint32_t first = (uint32_t)(m->vertex_count - places);
    if (!zigzag) /* all share one end of the side */
        for (uint32_t k = 0; k < places; k++, flat++)
            add_triangle(m, a, k + 1 < places ? first + k + 1 : b, first + k);
    uint32_t low = 0, high = (uint32_t)places; /* remaining points: from low, before high */
    for (; zigzag && low < high; flat++) {     /* alternating between both ends */
        const uint32_t begin = low > 0 ? first + low - 1 : a, end = high < places ? first + high : b;
        add_triangle(m, begin, end, first + (flat % 2 ? --high : low++));
    }
    return flat;
}

/* Adds a point inside triangle n, and a flat triangle with two other corners on a line through it. */
static size_t sliver_in_face(mesh *m, size_t n)
{
    const uint32_t a = m->triangle[n][0], b = m->triangle[n][1], c = m->triangle[n][2];
    const uint32_t inner = add_vertex(
                       m, vec3_scale(vec3_add(m->vertex[a], vec3_add(m->vertex[b], m->vertex[c])), 1.0 / 3)),
                   on = add_vertex(m, between(m, a, inner, 0.5));
    m->triangle[n][2] = inner; /* a b inner is unchanged; c gets a detour through `on` without area */
    add_triangle(m, b, c, inner);
    add_triangle(m, c, a, on);
    add_triangle(m, c, on, inner);
    add_triangle(m, a, inner, on);
    return 1;
}

static size_t flap_at_side(mesh *m, size_t n)
{
    const uint32_t a = m->triangle[n][0], b = m->triangle[n][1];
    add_triangle(m, a, add_vertex(m, between(m, a, b, 0.4)), b);
    return 1;
}

/* Splits a corner into two that differ by rounding, with a needle at each side of the corner's triangle. */
static size_t needles_at_corner(mesh *m, size_t n, double step)
{
    const uint32_t a = m->triangle[n][0], b = m->triangle[n][1], c = m->triangle[n][2];
    vec3 moved = m->vertex[a];
    moved.x += step;
    const uint32_t twin = add_vertex(m, moved);
    m->triangle[n][0] = twin;
    add_triangle(m, a, b, twin);
    add_triangle(m, a, twin, c);
    return 2;
}

static size_t damage(mesh *m, size_t n, int kind, double step)
{
    return kind == 0   ? sliver_at_side(m, n, 1, false)
           : kind == 1 ? sliver_at_side(m, n, 7, false)
           : kind == 2 ? sliver_at_side(m, n, 9, true)
           : kind == 3 ? sliver_in_face(m, n)
           : kind == 4 ? flap_at_side(m, n)
                       : needles_at_corner(m, n, step);
}

/* ---- checks */

static void assert_closed(const mesh *m)
{
    mesh_edges edges = {0};
    error e = {0};
    assert_true(mesh_edges_list(m, NULL, &edges, &e));
    assert_int_equal(edges.open, 0);
    assert_int_equal(edges.odd, 0);
    assert_int_equal(edges.against, 0);
    mesh_edges_free(&edges);
}

static double least_height(const mesh *m)
{
    double least = INFINITY;
    for (size_t n = 0; n < m->triangle_count; n++) {
        const uint32_t *t = m->triangle[n];
        double longest2 = 0;
        for (int k = 0; k < 3; k++)
            longest2 = fmax(longest2, vec3_norm2(vec3_sub(m->vertex[t[(k + 1) % 3]], m->vertex[t[k]])));
        const vec3 across = vec3_cross(vec3_sub(m->vertex[t[1]], m->vertex[t[0]]),
                                       vec3_sub(m->vertex[t[2]], m->vertex[t[0]]));
        least = fmin(least, vec3_norm(across) / sqrt(longest2));
    }
    return least;
}

/* Through memory: gcc 12 drops the two conversions when it vectorises coordinates. */
static double to_float(double value)
{
    const volatile float rounded = (float)value;
    return rounded;
}

static void to_floats(mesh *m)
{
    for (size_t k = 0; k < m->vertex_count; k++) {
        const vec3 v = m->vertex[k];
        m->vertex[k] = vec3_make(to_float(v.x), to_float(v.y), to_float(v.z));
    }
}

static mesh make_solid(int which, double scale, vec3 center)
{
    return which ? mesh_fixture_box(center, (vec3){scale, 0.5 * scale, 0.3 * scale}, 0.7)
                 : mesh_fixture_ball(center, scale, 2);
}

/* For solids of any size, near the origin and far from it, in doubles and in floats. */
static void damaged_solids_come_back_closed(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 0);
    for (int k = 0; k < 240; k++) {
        const double scale = pow(10, 12 * rng_uniform(&r) - 6), off = k % 3 ? 0 : 30 * scale;
        const bool floats = k % 2;
        const vec3 center = {off, -off, off};
        mesh_notes notes = {0};
        error e = {0};
        mesh m = make_solid(k / 6 % 2, scale, center);
        assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
        m = with_room(m, 2000);
        if (floats) to_floats(&m);
        const double wanted = mesh_area(&m), unit = floats ? 0x1p-24 : 0x1p-53, far = off + scale;
        const size_t triangles = m.triangle_count, ways = 1 + (size_t)(rng_uniform(&r) * 8);
        size_t flat = 0;
        for (size_t n = 0; n < ways; n++)
            flat += damage(&m, (n * 37) % triangles, (k / 4 + (int)n) % 6, 2 * unit * far);
        if (floats) to_floats(&m);
        assert_true(flat_triangles_remove(&m, k % 5 ? mesh_fixture_pool() : NULL, &notes, &e));
        assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
        if (notes.count != 1) fail_msg("%zu notes: %s", notes.count, notes.text[1]);
        if (strtoul(notes.text[0], NULL, 10) != flat)
            fail_msg("case %d: %s, not %zu", k, notes.text[0], flat);
        assert_closed(&m);
        assert_true(least_height(&m) > 1e-3 * scale);
        if (!(fabs(mesh_area(&m) / wanted - 1) < 100 * unit * far / scale))
            fail_msg("area %g", mesh_area(&m) / wanted);
        mesh_free(&m);
    }
}

/* If the height of thin triangles exceeds the rounding of the coordinates, the mesh is unchanged bit by
 * bit. */
static void thin_triangles_with_area_are_kept(void **state)
{
    (void)state;
    for (int floats = 0; floats < 2; floats++) {
        mesh m = with_room(mesh_fixture_box((vec3){1, 2, 3}, (vec3){1, 1, 1}, 0), 8);
        const vec3 at = {1, 2, 3 + 1 + (floats ? 8e-6 : 1e-13)};
        const uint32_t v = add_vertex(&m, at), a = m.triangle[2][0], b = m.triangle[2][1];
        add_triangle(&m, a, b, v);
        if (floats) to_floats(&m);
        m.vertex[v] = vec3_axpy(floats ? 4e-6 : 1e-13, (vec3){0, 0, 1}, between(&m, a, b, 0.5));
        if (floats) to_floats(&m);
        mesh_notes notes = {0};
        error e = {0};
        mesh before;
        assert_true(mesh_copy(&m, NULL, &before, &e));
        assert_true(flat_triangles_remove(&m, NULL, &notes, &e));
        assert_int_equal(notes.count, 0);
        assert_memory_equal(m.triangle, before.triangle, m.triangle_count * sizeof *m.triangle);
        assert_memory_equal(m.vertex, before.vertex, m.vertex_count * sizeof *m.vertex);
        mesh_free(&m);
        mesh_free(&before);
    }
}

/* Thousands of points on one side, from one end: the time is proportional to the number of triangles. */
static void long_fans_are_removed(void **state)
{
    (void)state;
    enum { PLACES = 20000 };
    mesh_notes notes = {0};
    error e = {0};
    mesh m = with_room(mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 1}, 0.3), 3 * PLACES);
    sliver_at_side(&m, 3, PLACES, false);
    assert_true(flat_triangles_remove(&m, NULL, &notes, &e));
    assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
    assert_closed(&m);
    assert_true(fabs(mesh_area(&m) - 24) < 1e-9);
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(damaged_solids_come_back_closed),
        cmocka_unit_test(thin_triangles_with_area_are_kept),
        cmocka_unit_test(long_fans_are_removed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
