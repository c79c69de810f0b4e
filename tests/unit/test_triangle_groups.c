// SPDX-License-Identifier: Apache-2.0
/* Distances from groups of triangles equal the distances from each triangle. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include <math.h>

#include "base/core/rng.h"
#include "geometry/space/triangle.h"
#include "surface/levelset/triangle_groups.h"
#include "mesh_fixture.h"
#include "shapes.h"

enum { SIDE = TRIANGLE_GROUPS_SIDE, VOXELS = TRIANGLE_GROUPS_VOXELS };

static triangle triangle_of(const mesh *m, size_t n)
{
    const uint32_t *t = m->triangle[n];
    return (triangle){m->vertex[t[0]], m->vertex[t[1]], m->vertex[t[2]]};
}

/* All groups, in their order. */
static uint32_t *list_all(const triangle_groups *g)
{
    uint32_t *near = malloc(g->count * sizeof *near);
    for (uint32_t k = 0; k < g->count; k++) near[k] = k;
    return near;
}

static void assert_block(const triangle_groups *g, const int32_t origin[3], double band)
{
    double nearest[VOXELS];
    uint32_t *near = list_all(g);
    triangle_groups_lower_distances(g, near, g->count, origin, band, nearest);
    free(near);
    for (int v = 0; v < VOXELS; v++) {
        const vec3 p = {origin[0] + (v >> 6), origin[1] + (v >> 3 & 7), origin[2] + (v & 7)};
        double least2 = band * band;
        for (size_t n = 0; n < g->m->triangle_count; n++) {
            const triangle t = triangle_of(g->m, n);
            const double d2 = triangle_distance2(&t, p);
            least2 = d2 < least2 ? d2 : least2;
        }
        if (!(fabs(nearest[v] - sqrt(least2)) < 1e-12))
            fail_msg("voxel %d of the block at %d %d %d: %.17g, %.17g from triangles", v, origin[0],
                     origin[1], origin[2], nearest[v], sqrt(least2));
    }
}

/* Few and many triangles, small and large compared with the voxels, on planes of voxels and off them, in
 * narrow and wide bands. */
static void voxels_are_as_far_as_the_nearest_triangle(void **state)
{
    (void)state;
    for (int kind = 0; kind < 7; kind++) {
        error e = {0};
        const vec3 middle = {14.5, 13.2, 15};
        mesh m = kind == 5   ? mesh_fixture_box(middle, (vec3){9.5, 8.2, 9}, 0)
                 : kind == 6 ? mesh_fixture_box(middle, (vec3){3, 6, 0.01}, 0.7)
                             : mesh_fixture_ball(middle, kind == 4 ? 0.02 : 9, kind == 4 ? 3 : kind + 1);
        const uint32_t first[2] = {0, (uint32_t)m.triangle_count};
        triangle_groups g;
        assert_true(triangle_groups_make(&m, first, mesh_fixture_pool(), &g, &e));
        for (int32_t x = -8; x < 32; x += 8)
            for (int32_t y = 0; y < 24; y += 8)
                for (int32_t z = 8; z < 24; z += 8) {
                    if (kind >= 2 && kind <= 4 && (x + y + z) % 16 != 0) continue; /* many triangles */
                    assert_block(&g, (const int32_t[]){x, y, z}, 3);
                    if (x == 16 && kind < 6) assert_block(&g, (const int32_t[]){x, y, z}, 20);
                }
        triangle_groups_free(&g);
        mesh_free(&m);
    }
}

/* Triangles of all sizes and shapes, including slivers and points. */
static void distances_from_disconnected_triangles_are_exact(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int run = 0; run < 12; run++) {
        error e = {0};
        mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 3);
        for (size_t n = 0; n < m.vertex_count; n++) {
            const double reach = run < 6 ? 16 : 4;
            m.vertex[n] =
                (vec3){reach * rng_uniform(&r), reach * rng_uniform(&r), 6 + 4 * rng_uniform(&r) * (run % 2)};
        }
        for (size_t n = 0; n < m.triangle_count; n += 7) m.triangle[n][1] = m.triangle[n][0];
        const uint32_t first[2] = {0, (uint32_t)m.triangle_count};
        triangle_groups g;
        assert_true(triangle_groups_make(&m, first, NULL, &g, &e));
        for (int32_t x = 0; x < 16; x += 8) assert_block(&g, (const int32_t[]){x, 0, 0}, 4);
        triangle_groups_free(&g);
        mesh_free(&m);
    }
}

/* Every triangle is in one group of its own solid, and the properties of the group hold for it. */
static void groups_contain_their_triangles(void **state)
{
    (void)state;
    error e = {0};
    mesh m = mesh_fixture_ball((vec3){6, 6, 6}, 5, 4);
    const uint32_t half = (uint32_t)m.triangle_count;
    mesh_fixture_append(&m, mesh_fixture_ball((vec3){6, 6, 6}, 5, 4));
    const uint32_t first[3] = {0, half, 2 * half};
    triangle_groups g;
    assert_true(triangle_groups_make(&m, first, mesh_fixture_pool(), &g, &e));
    size_t found = 0;
    for (size_t k = 0; k < g.count; k++) {
        const triangle_disc *d = &g.disc[k];
        const bool solid = g.triangle[g.first[k]] >= half;
        assert_true(k == 0 || solid >= (g.triangle[g.first[k - 1]] >= half));
        for (size_t n = g.first[k]; n < g.first[k + 1]; n++, found++) {
            const triangle t = triangle_of(&m, g.triangle[n]);
            const vec3 corner[3] = {t.a, t.b, t.c};
            assert_true((g.triangle[n] >= half) == solid);
            for (int c = 0; c < 3; c++) {
                const vec3 way = vec3_sub(corner[c], d->middle);
                const double height = vec3_dot(way, d->normal);
                assert_true(bbox_contains(g.box[k], corner[c]));
                assert_true(fabs(height) <= d->depth &&
                            vec3_norm2(way) - height * height <= d->radius * d->radius);
            }
        }
        assert_true(triangle_groups_is_within(&g, (uint32_t)k, g.place[k], 1e-20));
        assert_false(triangle_groups_is_within(&g, (uint32_t)k, (vec3){40, 6, 6}, 28 * 28));
    }
    assert_int_equal(found, 2 * half);
    triangle_groups_free(&g);
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(voxels_are_as_far_as_the_nearest_triangle),
                                       cmocka_unit_test(distances_from_disconnected_triangles_are_exact),
                                       cmocka_unit_test(groups_contain_their_triangles)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
