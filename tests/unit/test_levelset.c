// SPDX-License-Identifier: Apache-2.0
/* Meshes as arrays: distances, signs, repair, and the level set against exact formulas. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_weld.h"
#include "mesh_fixture.h"
#include "surface/levelset/levelset.h"
#include "surface/levelset/mesh_repair.h"
#include "surface/volume/voxel_size.h"
#include "geometry/space/triangle.h"
#include "surface/levelset/winding_number.h"
#include "volume_fixture.h"

enum { SEED = 20260720 };

static vec3 random_point(uint64_t *seed, double scale)
{
    double x = fixture_random(seed), y = fixture_random(seed), z = fixture_random(seed);
    return (vec3){scale * (x - 0.5), scale * (y - 0.5), scale * (z - 0.5)};
}

/* The smallest distance from a grid of points of the triangle. It exceeds the true distance by at most
 * half a step. */
static double sampled_distance(const triangle *t, vec3 p, int steps)
{
    double least = INFINITY;
    for (int i = 0; i <= steps; i++)
        for (int j = 0; i + j <= steps; j++) {
            vec3 q = vec3_axpy((double)i / steps, vec3_sub(t->b, t->a),
                               vec3_axpy((double)j / steps, vec3_sub(t->c, t->a), t->a));
            least = fmin(least, vec3_norm(vec3_sub(p, q)));
        }
    return least;
}

static void distance_from_triangles(void **state)
{
    (void)state;
    uint64_t seed = SEED;
    enum { CASES = 2000, STEPS = 60 };
    for (int k = 0; k < CASES; k++) {
        triangle t = {random_point(&seed, 2), random_point(&seed, 2), random_point(&seed, 2)};
        /* slivers: the third corner lies on the line of the others, exactly or nearly, between or beyond
         * them */
        if (k % 4 == 1) t.c = vec3_axpy(3 * fixture_random(&seed) - 1, vec3_sub(t.b, t.a), t.a);
        if (k % 4 == 2)
            t.c = vec3_add(vec3_axpy(3 * fixture_random(&seed) - 1, vec3_sub(t.b, t.a), t.a),
                           random_point(&seed, 1e-9));
        if (k % 4 == 3) t.c = t.b;
        vec3 p = random_point(&seed, 4);
        double longest = fmax(vec3_norm(vec3_sub(t.b, t.a)),
                              fmax(vec3_norm(vec3_sub(t.c, t.a)), vec3_norm(vec3_sub(t.c, t.b))));
        double d = sqrt(triangle_distance2(&t, p)), sampled = sampled_distance(&t, p, STEPS);
        if (!(d <= sampled + 1e-7) || !(sampled - d <= longest / STEPS))
            fail_msg("case %d (seed %d): %.9g, sampled %.9g", k, SEED, d, sampled);
    }
}

static void winding_through_corners(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box((vec3){8, 9, 10.25}, (vec3){5, 7, 6}, 0);
    const uint32_t first[2] = {0, 12};
    winding_columns c;
    error e = {0};
    assert_true(winding_make(&m, first, 1, mesh_fixture_pool(), 1 << 24, &c, &e));
    int inside = 0;
    for (int x = -2; x < 20; x++)
        for (int y = -2; y < 20; y++)
            for (int z = -8; z < 32; z += 8) {
                unsigned bits = winding_inside(&c, 0, false, x, y, z);
                assert_int_equal(bits, winding_inside(&c, 0, true, x, y, z));
                for (int k = 0; k < 8; k++) {
                    const int32_t at[3] = {x, y, z + k};
                    bool one_sided = false;
                    assert_int_equal(bits >> k & 1, winding_covers(&c, &one_sided, NULL, 0, at));
                }
                inside += __builtin_popcount(bits);
            }
    assert_int_equal(inside, 10 * 14 * 12); /* [3, 13) x [2, 16) x 5..16 */
    winding_free(&c);
    mesh_free(&m);
}

static void winding_of_a_ball(void **state)
{
    (void)state;
    const vec3 center = {20, 20, 20};
    mesh m = mesh_fixture_ball(center, 15, 3);
    const uint32_t first[2] = {0, (uint32_t)m.triangle_count};
    winding_columns c;
    error e = {0};
    assert_true(winding_make(&m, first, 1, mesh_fixture_pool(), 1 << 24, &c, &e));
    for (int x = 0; x < 40; x++)
        for (int y = 0; y < 40; y++)
            for (int z = 0; z < 40; z++) {
                double r = vec3_norm(vec3_sub((vec3){x, y, z}, center));
                bool inside = winding_inside(&c, 0, false, x, y, z) & 1;
                if (r < 14.8 && !inside) fail_msg("(%d, %d, %d) is not inside", x, y, z);
                if (r > 15 && inside) fail_msg("(%d, %d, %d) is inside", x, y, z);
            }
    winding_free(&c);
    error few = {0};
    assert_false(winding_make(&m, first, 1, NULL, 1000, &c, &few));
    assert_int_equal(few.code, ERROR_LIMIT_MEMORY);
    mesh_free(&m);
}

/* ---- mesh repair */

typedef struct judgement {
    bool ok;
    error e;
    mesh_notes notes;
    size_t triangles, solids;
} judgement;

static const double TOLERANCE = 1e-5;

/* `known`: the edges are known. */
static judgement judge_with(mesh m, bool known, threads *pool)
{
    judgement j = {0};
    mesh_solids t = {0};
    mesh_edges edges = {0};
    const double unit[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    const mesh_repair_input in = {TOLERANCE, unit, known ? &edges : NULL, pool};
    assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &j.notes, &j.e));
    assert_true(!known || mesh_edges_list(&m, pool, &edges, &j.e));
    j.ok = mesh_repair_solids(&m, &in, &t, &j.notes, &j.e);
    j.triangles = m.triangle_count;
    j.solids = t.solid_count;
    if (j.ok) assert_int_equal(t.first[t.solid_count], m.triangle_count);
    mesh_solids_free(&t);
    mesh_edges_free(&edges);
    mesh_free(&m);
    return j;
}

/* Known edges and threads do not change the result. */
static judgement judge(mesh m)
{
    mesh copy = {0};
    error e = {0};
    assert_true(mesh_copy(&m, NULL, &copy, &e));
    const judgement j = judge_with(m, false, NULL), again = judge_with(copy, true, mesh_fixture_pool());
    assert_int_equal(j.ok, again.ok);
    assert_string_equal(j.e.message, again.e.message);
    assert_int_equal(j.triangles, again.triangles);
    assert_int_equal(j.solids, again.solids);
    assert_int_equal(j.notes.count, again.notes.count);
    for (size_t k = 0; k < j.notes.count; k++) assert_string_equal(j.notes.text[k], again.notes.text[k]);
    return j;
}

static void assert_note(const judgement *j, const char *text)
{
    for (size_t k = 0; k < j->notes.count; k++)
        if (strstr(j->notes.text[k], text)) return;
    fail_msg("no note '%s'; the first is '%s'", text, j->notes.count ? j->notes.text[0] : "");
}

static void assert_refused(const judgement *j, const char *text)
{
    assert_false(j->ok);
    assert_int_equal(j->e.code, ERROR_INPUT_UNSUPPORTED);
    if (!strstr(j->e.message, text)) fail_msg("no '%s' in '%s'", text, j->e.message);
}

static mesh ball_at(double x)
{
    return mesh_fixture_ball((vec3){x, 20, 20}, 5, 2);
}

static void good_meshes_have_no_notes(void **state)
{
    (void)state;
    mesh m = ball_at(10);
    mesh_fixture_append(&m, ball_at(30));
    judgement j = judge(m);
    assert_true(j.ok);
    assert_int_equal(j.notes.count, 0);
    assert_int_equal(j.solids, 2);
    assert_int_equal(j.triangles, 640);
}

/* The number of solids equals the number of balls; there are enough triangles for all threads. */
static void many_connected_triangles_are_one_part(void **state)
{
    (void)state;
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 5);
    for (int k = 1; k < 4; k++) mesh_fixture_append(&m, mesh_fixture_ball((vec3){3 * k, 0, 0}, 1, 5));
    const judgement j = judge(m);
    assert_true(j.ok);
    assert_int_equal(j.solids, 4);
    assert_int_equal(j.notes.count, 0);
}

static void holes_are_counted(void **state)
{
    (void)state;
    mesh m = ball_at(10);
    mesh_fixture_append(&m, ball_at(30));
    mesh_fixture_remove(&m, 600);
    mesh_fixture_remove(&m, 5);
    judgement j = judge(m);
    assert_refused(&j, "6 boundary edges around 2 holes");
    m = ball_at(10);
    mesh_fixture_remove(&m, 5);
    j = judge(m);
    assert_refused(&j, "3 boundary edges around 1 hole:");
    /* a fin of one triangle on a closed ball: two boundary edges, and an edge of three triangles */
    m = ball_at(10);
    mesh_fixture_append(&m, (mesh){1, 0, mem_array(1, sizeof(vec3), "test", NULL), NULL, false});
    mesh_fixture_add(&m, m.triangle[0][0], m.triangle[0][1], (uint32_t)m.vertex_count - 1);
    j = judge(m);
    assert_refused(&j, "2 boundary edges around 1 hole and 1 edges at which an odd number");
}

static void holes_are_placed(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box((vec3){10, 10, 10}, (vec3){4, 3, 2}, 0);
    mesh_fixture_remove(&m, 11);
    mesh_fixture_remove(&m, 10);
    judgement j = judge(m);
    assert_refused(&j, "4 edges within [");
    assert_refused(&j, "4 boundary edges around 1 hole:");
}

/* Corners that rounding has moved apart: each triangle has its own corners. */
static void near_vertices_are_joined(void **state)
{
    (void)state;
    uint64_t seed = SEED;
    for (int far = 0; far < 2; far++) {
        mesh ball = ball_at(10), m = {3 * ball.triangle_count, 0, NULL, NULL, false};
        m.vertex = mem_array(m.vertex_count, sizeof *m.vertex, "test", NULL);
        for (uint32_t n = 0; n < ball.triangle_count; n++)
            for (uint32_t k = 0; k < 3; k++)
                m.vertex[3 * n + k] = vec3_add(ball.vertex[ball.triangle[n][k]],
                                               random_point(&seed, (far ? 20 : 0.5) * TOLERANCE));
        for (uint32_t n = 0; n < ball.triangle_count; n++) mesh_fixture_add(&m, 3 * n, 3 * n + 1, 3 * n + 2);
        judgement j = judge(m);
        if (far) {
            assert_refused(&j, "the mesh is open");
        } else {
            assert_true(j.ok);
            assert_int_equal(j.triangles, ball.triangle_count);
            assert_note(&j, "vertices of open edges coincide with others within rounding: they are joined");
        }
        mesh_free(&ball);
    }
}

/* A box with one face that was triangulated independently of its neighbours: three vertices on each edge. */
static void seams_are_closed(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box((vec3){10, 10, 10}, (vec3){4, 3, 2}, 0);
    const uint32_t t[2][3] = {{m.triangle[0][0], m.triangle[0][1], m.triangle[0][2]},
                              {m.triangle[1][0], m.triangle[1][1], m.triangle[1][2]}};
    mesh_fixture_remove(&m, 1);
    mesh_fixture_remove(&m, 0);
    for (uint32_t n = 0; n < 2; n++) { /* fans around the centre: edges in two parts, and in three */
        const uint32_t parts = 2 + n, around = 3 * parts;
        mesh face = {around + 1, 0, mem_array(around + 1, sizeof(vec3), "test", NULL), NULL, false};
        for (uint32_t k = 0; k < around; k++) {
            const vec3 a = m.vertex[t[n][k / parts]], b = m.vertex[t[n][(k / parts + 1) % 3]];
            face.vertex[k] = vec3_axpy((double)(k % parts) / parts, vec3_sub(b, a), a);
            face.vertex[around] = vec3_axpy(1.0 / around, face.vertex[k], face.vertex[around]);
        }
        for (uint32_t k = 0; k < around; k++) mesh_fixture_add(&face, k, (k + 1) % around, around);
        mesh_fixture_append(&m, face);
    }
    judgement j = judge(m);
    if (!j.ok) fail_msg("%s", j.e.message);
    assert_int_equal(j.solids, 1);
    assert_note(&j, "vertices of other triangles on their open edges: they are split there");
}

static void inner_walls_are_refused(void **state)
{
    (void)state;
    /* two boxes with a common wall: where they touch, twelve triangles are one wall of two */
    mesh m = mesh_fixture_box((vec3){10, 10, 10}, (vec3){4, 4, 4}, 0);
    mesh b = mesh_fixture_box((vec3){18, 10, 10}, (vec3){4, 4, 4}, 0);
    mesh_fixture_append(&m, b);
    mesh_fixture_remove(&m, 12 + 9); /* the wall of the second box: triangles 8 and 9 */
    mesh_fixture_remove(&m, 12 + 8);
    judgement j = judge(m);
    assert_refused(&j, "odd number of triangles");
    /* with both walls they cancel, and one box remains */
    m = mesh_fixture_box((vec3){10, 10, 10}, (vec3){4, 4, 4}, 0);
    mesh_fixture_append(&m, mesh_fixture_box((vec3){18, 10, 10}, (vec3){4, 4, 4}, 0));
    j = judge(m);
    assert_true(j.ok);
    assert_int_equal(j.solids, 1);
}

static void edges_of_four_triangles_are_reported(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box((vec3){10, 10, 10}, (vec3){4, 4, 4}, 0);
    mesh_fixture_append(&m, mesh_fixture_box((vec3){18, 18, 10}, (vec3){4, 4, 4}, 0));
    judgement j = judge(m);
    assert_true(j.ok);
    assert_note(&j, "1 edges at which four or more triangles meet");
    assert_int_equal(j.solids, 2);
}

static void orientation_is_repaired(void **state)
{
    (void)state;
    mesh m = ball_at(10);
    for (size_t k = 0; k < 40; k++) mesh_fixture_turn(&m, 7 * k);
    judgement j = judge(m);
    assert_true(j.ok);
    assert_note(&j, "40 of 320 triangles are oriented against their neighbours: turned");
    m = ball_at(10);
    for (size_t k = 0; k < m.triangle_count; k++) mesh_fixture_turn(&m, k);
    j = judge(m);
    assert_note(&j, "1 of 1 shells are inside out: turned");
}

static void degenerate_and_duplicate_triangles_are_reported(void **state)
{
    (void)state;
    mesh m = ball_at(10);
    mesh_fixture_add(&m, 3, 3, 7);
    judgement j = judge(m);
    assert_true(j.ok);
    assert_note(&j, "1 of 321 triangles have two equal corners");
    m = ball_at(10); /* every triangle twice, as in data/meshes/cup.obj */
    mesh_fixture_append(&m, ball_at(10));
    j = judge(m);
    assert_true(j.ok);
    assert_int_equal(j.triangles, 320);
    assert_note(&j, "320 of 640 triangles are duplicates");
    m = ball_at(10); /* every face from both sides */
    mesh b = ball_at(10);
    for (size_t k = 0; k < b.triangle_count; k++) mesh_fixture_turn(&b, k);
    mesh_fixture_append(&m, b);
    j = judge(m);
    assert_true(j.ok);
    assert_int_equal(j.triangles, 320);
}

static void shells_in_shells(void **state)
{
    (void)state;
    const vec3 center = {20, 20, 20};
    for (int inverted = 0; inverted < 2; inverted++)
        for (int cavity = 0; cavity < 2; cavity++) {
            mesh m = mesh_fixture_ball(center, 15, 2), inner = mesh_fixture_ball(center, 7, 2);
            if (cavity)
                for (size_t k = 0; k < inner.triangle_count; k++) mesh_fixture_turn(&inner, k);
            mesh_fixture_append(&m, inner);
            if (inverted)
                for (size_t k = 0; k < m.triangle_count; k++) mesh_fixture_turn(&m, k);
            judgement j = judge(m);
            assert_true(j.ok);
            assert_int_equal(j.solids, cavity ? 1 : 2);
            if (!cavity) assert_note(&j, "1 of 2 shells lie within others of the same orientation");
            if (inverted) assert_note(&j, "2 of 2 shells are inside out");
            assert_int_equal(j.notes.count, !cavity + inverted);
        }
}

/* Shuffles the triangles, so that all threads find connections from all sides. */
static void shuffle(mesh *m, uint64_t *seed)
{
    uint32_t *place = mem_array(m->vertex_count, sizeof *place, "places", NULL);
    vec3 *moved = mem_array(m->vertex_count, sizeof *moved, "places", NULL);
    for (size_t k = 0; k < m->vertex_count; k++) {
        const size_t other = (size_t)(fixture_random(seed) * (double)(k + 1));
        place[k] = place[other];
        place[other] = (uint32_t)k;
    }
    for (size_t k = 0; k < m->vertex_count; k++) moved[place[k]] = m->vertex[k];
    memcpy(m->vertex, moved, m->vertex_count * sizeof *moved);
    for (size_t k = 0; k < 3 * m->triangle_count; k++)
        m->triangle[k / 3][k % 3] = place[m->triangle[k / 3][k % 3]];
    free(place);
    free(moved);
    for (size_t k = m->triangle_count - 1; k > 0; k--) {
        uint32_t swap[3];
        const size_t other = (size_t)(fixture_random(seed) * (double)(k + 1));
        memcpy(swap, m->triangle[k], sizeof swap);
        memcpy(m->triangle[k], m->triangle[other], sizeof swap);
        memcpy(m->triangle[other], swap, sizeof swap);
    }
}

static void many_shells_in_any_order(void **state)
{
    (void)state;
    enum { ALONG = 3, RUNS = 2 };
    uint64_t seed = SEED;
    for (int run = 0; run < RUNS; run++) {
        mesh m = {0};
        for (int k = 0; k < ALONG * ALONG * ALONG; k++) {
            const vec3 center = {40 * (k % ALONG), 40 * (k / ALONG % ALONG), 40 * (k / ALONG / ALONG)};
            mesh outer = mesh_fixture_ball(center, 15, 4), inner = mesh_fixture_ball(center, 7, 3);
            for (size_t n = 0; n < inner.triangle_count; n++) mesh_fixture_turn(&inner, n);
            mesh_fixture_append(&outer, inner);
            if (k == 0)
                m = outer;
            else
                mesh_fixture_append(&m, outer);
        }
        shuffle(&m, &seed);
        const judgement j = judge(m);
        assert_true(j.ok);
        assert_int_equal(j.solids, ALONG * ALONG * ALONG);
        assert_int_equal(j.notes.count, 0);
    }
}

/* ---- the level set */

static vdb_grid *make(mesh *m, int voxels, mesh_notes *notes)
{
    const levelset_params params = {.resolution = voxels,
                                    .band_vox = 4,
                                    .weld = 1e-6,
                                    .memory_limit = (size_t)1 << 30,
                                    .pool = mesh_fixture_pool()};
    error e = {0};
    vdb_grid *g = levelset_make(m, &params, notes, NULL, &e);
    if (!g) fail_msg("%s", e.message);
    return g;
}

typedef double (*exact)(vec3 p, const void *shape);

/* Compares every active voxel with the formula, and checks that all are present; world units. */
static void assert_distances(const vdb_grid *g, exact f, const void *shape, double tolerance)
{
    const double *m = g->index_to_world, band = (double)g->background;
    size_t active = 0;
    for (size_t leaf = 0; leaf < g->leaf_count; leaf++)
        for (int v = 0; v < VDB_LEAF_VOXELS; v++) {
            const int32_t *o = g->leaf_origin[leaf];
            const vec3 p = {m[0] * (o[0] + (v >> 6)) + m[3], m[5] * (o[1] + (v >> 3 & 7)) + m[7],
                            m[10] * (o[2] + (v & 7)) + m[11]};
            double d = f(p, shape), value = (double)g->leaf_values[leaf * VDB_LEAF_VOXELS + (size_t)v];
            bool is_active = g->leaf_active[8 * leaf + (size_t)(v >> 6)] >> (v & 63) & 1;
            active += is_active;
            double expected = fmax(-band, fmin(band, d));
            if (fabs(value - expected) > tolerance)
                fail_msg("at (%g, %g, %g): %.9g instead of %.9g", p.x, p.y, p.z, value, expected);
            if (is_active != (fabs(value) < band) && fabs(fabs(value) - band) > tolerance)
                fail_msg("wrongly active");
        }
    assert_int_equal(active, g->active_voxels);
    assert_true(active > 1000);
}

typedef struct box_shape {
    vec3 center, half;
    double angle;
} box_shape;

static double box_distance(vec3 p, const void *shape)
{
    const box_shape *b = shape;
    vec3 q = mesh_fixture_unturn(vec3_sub(p, b->center), b->angle);
    vec3 d = {fabs(q.x) - b->half.x, fabs(q.y) - b->half.y, fabs(q.z) - b->half.z};
    vec3 out = {fmax(d.x, 0), fmax(d.y, 0), fmax(d.z, 0)};
    return vec3_norm(out) + fmin(fmax(d.x, fmax(d.y, d.z)), 0);
}

static void boxes_are_exact(void **state)
{
    (void)state;
    const box_shape shapes[] = {
        {{1, 2, 3}, {0.5, 0.4, 0.3}, 0}, {{-7, 0, 3}, {5, 2, 3}, 0.7}, {{0, 0, 0}, {1e-4, 1e-4, 1e-4}, 2}};
    for (size_t k = 0; k < 3; k++)
        for (int turned = 0; turned < 2; turned++) {
            const box_shape *b = &shapes[k];
            mesh_notes notes = {0};
            mesh m = mesh_fixture_box(b->center, b->half, b->angle);
            for (size_t t = 0; turned && t < 12; t++) mesh_fixture_turn(&m, t);
            vdb_grid *g = make(&m, 40, &notes);
            assert_distances(g, box_distance, b, 1e-6 * vec3_norm(b->half));
            vdb_grid_free(g);
            mesh_free(&m);
        }
}

/* Splits each triangle into parts^2 equal ones without common vertices. */
static mesh split(const mesh *m, uint32_t parts)
{
    const size_t count = m->triangle_count * parts * parts;
    mesh out = {.vertex = mem_array(3 * count, sizeof *out.vertex, "test", NULL),
                .triangle = mem_array(count, sizeof *out.triangle, "test", NULL)};
    for (size_t n = 0; n < m->triangle_count; n++) {
        const uint32_t *t = m->triangle[n];
        const vec3 a = m->vertex[t[0]], u = vec3_scale(vec3_sub(m->vertex[t[1]], a), 1.0 / parts),
                   v = vec3_scale(vec3_sub(m->vertex[t[2]], a), 1.0 / parts);
        for (uint32_t i = 0; i < parts; i++)
            for (uint32_t j = 0; j < 2 * (parts - i) - 1;
                 j++) { /* alternately in the orientation of the triangle and against it */
                const vec3 low = vec3_axpy(i, u, vec3_axpy(j / 2, v, a));
                const vec3 corner[3] = {j & 1 ? vec3_add(low, vec3_add(u, v)) : low,
                                        vec3_add(low, j & 1 ? v : u), vec3_add(low, j & 1 ? u : v)};
                for (uint32_t k = 0; k < 3; k++) {
                    out.triangle[out.triangle_count][k] = (uint32_t)out.vertex_count;
                    out.vertex[out.vertex_count++] = corner[k];
                }
                out.triangle_count++;
            }
    }
    return out;
}

/* A block with thousands of triangles uses other bounds than a block with a few. */
static void many_triangles_are_as_exact_as_few(void **state)
{
    (void)state;
    const box_shape shapes[] = {{{1, 2, 3}, {0.5, 0.4, 0.3}, 0.3}, {{-7, 0, 3}, {5, 0.2, 3}, 0.7}};
    for (size_t k = 0; k < 2; k++) {
        mesh_notes notes = {0};
        mesh box = mesh_fixture_box(shapes[k].center, shapes[k].half, shapes[k].angle), m = split(&box, 48);
        vdb_grid *g = make(&m, 40, &notes);
        assert_distances(g, box_distance, &shapes[k], 1e-6 * vec3_norm(shapes[k].half));
        vdb_grid_free(g);
        mesh_free(&box);
        mesh_free(&m);
    }
}

/* Inside a convex body the distance is the smallest distance from the planes of its faces. */
typedef struct convex {
    size_t count;
    vec3 *normal;
    double *offset;
} convex;

static double plane_distance(vec3 p, const void *shape)
{
    const convex *c = shape;
    double most = -INFINITY;
    for (size_t k = 0; k < c->count; k++) most = fmax(most, vec3_dot(p, c->normal[k]) - c->offset[k]);
    return most;
}

static void the_inside_of_a_ball_is_exact(void **state)
{
    (void)state;
    mesh_notes notes = {0};
    mesh m = mesh_fixture_ball((vec3){3, 1, -2}, 2, 2);
    convex c = {m.triangle_count, mem_alloc(m.triangle_count * sizeof(vec3)),
                mem_alloc(m.triangle_count * sizeof(double))};
    for (size_t k = 0; k < c.count; k++) {
        vec3 a = m.vertex[m.triangle[k][0]], b = m.vertex[m.triangle[k][1]], d = m.vertex[m.triangle[k][2]];
        c.normal[k] = vec3_unit(vec3_cross(vec3_sub(b, a), vec3_sub(d, a)));
        c.offset[k] = vec3_dot(c.normal[k], a);
    }
    vdb_grid *g = make(&m, 60, &notes);
    const double *w = g->index_to_world, band = (double)g->background;
    int inside = 0, outside = 0;
    for (size_t leaf = 0; leaf < g->leaf_count; leaf++)
        for (int v = 0; v < VDB_LEAF_VOXELS; v++) {
            const int32_t *o = g->leaf_origin[leaf];
            const vec3 p = {w[0] * (o[0] + (v >> 6)) + w[3], w[5] * (o[1] + (v >> 3 & 7)) + w[7],
                            w[10] * (o[2] + (v & 7)) + w[11]};
            double value = (double)g->leaf_values[leaf * VDB_LEAF_VOXELS + (size_t)v],
                   plane = plane_distance(p, &c);
            inside += plane < 0;
            outside += plane >= 0;
            if (plane < 0 && fabs(value - fmax(plane, -band)) > 1e-6)
                fail_msg("%.9g inside instead of %.9g", value, plane);
            if (plane > 0 && value < fmin(plane, band) - 1e-6)
                fail_msg("%.9g outside, less than a plane's %.9g", value, plane);
        }
    assert_true(inside > 10000 && outside > 10000);
    vdb_grid_free(g);
    free(c.normal);
    free(c.offset);
    mesh_free(&m);
}

/* Two overlapping boxes: the union, without the walls inside it. */
static double boxes_distance(vec3 p, const void *shape)
{
    const box_shape *b = shape;
    return fmin(box_distance(p, &b[0]), box_distance(p, &b[1]));
}

static void overlapping_shells_are_united(void **state)
{
    (void)state;
    const box_shape b[2] = {{{0, 0, 0}, {2, 1, 1}, 0.3}, {{1.5, 0.5, 0.2}, {1, 2, 1.2}, 0.8}};
    mesh_notes notes = {0};
    mesh m = mesh_fixture_box(b[0].center, b[0].half, b[0].angle);
    mesh_fixture_append(&m, mesh_fixture_box(b[1].center, b[1].half, b[1].angle));
    vdb_grid *g = make(&m, 64, &notes);
    assert_distances(g, boxes_distance, b, 1e-5);
    vdb_grid_free(g);
    mesh_free(&m);
}

static double shell_distance(vec3 p, const void *shape)
{
    const box_shape *b = shape;
    return fmax(box_distance(p, &b[0]), -box_distance(p, &b[1]));
}

/* The wall between the two is thicker than the band, so the maximum of the two is the distance in it. */
static void cavities_are_empty(void **state)
{
    (void)state;
    const box_shape b[2] = {{{0, 0, 0}, {2, 2, 2}, 0}, {{0, 0, 0}, {1, 1, 1}, 0}};
    mesh_notes notes = {0};
    mesh m = mesh_fixture_box(b[0].center, b[0].half, 0), inner = mesh_fixture_box(b[1].center, b[1].half, 0);
    for (size_t k = 0; k < 12; k++) mesh_fixture_turn(&inner, k);
    mesh_fixture_append(&m, inner);
    vdb_grid *g = make(&m, 48, &notes);
    const double *w = g->index_to_world;
    int in_cavity = 0;
    for (size_t leaf = 0; leaf < g->leaf_count; leaf++)
        for (int v = 0; v < VDB_LEAF_VOXELS; v++) {
            const int32_t *o = g->leaf_origin[leaf];
            const vec3 p = {w[0] * (o[0] + (v >> 6)) + w[3], w[5] * (o[1] + (v >> 3 & 7)) + w[7],
                            w[10] * (o[2] + (v & 7)) + w[11]};
            double value = (double)g->leaf_values[leaf * VDB_LEAF_VOXELS + (size_t)v],
                   d = shell_distance(p, b);
            in_cavity += box_distance(p, &b[1]) < 0;
            if (fabs(d) > 1e-6 && (value < 0) != (d < 0))
                fail_msg("(%g, %g, %g): %g instead of %g", p.x, p.y, p.z, value, d);
        }
    assert_true(in_cavity > 1000);
    vdb_grid_free(g);
    mesh_free(&m);
}

/* The interior beyond the band has large and small tiles: every voxel has the correct sign. */
static void the_interior_beyond_the_band_is_filled(void **state)
{
    (void)state;
    enum { SIDE = 300 };
    const box_shape b = {{0, 0, 0}, {1, 1, 1}, 0};
    mesh_notes notes = {0};
    mesh m = mesh_fixture_box(b.center, b.half, 0);
    vdb_grid *g = make(&m, SIDE, &notes);
    uint64_t filled = 0, large = 0;
    for (size_t k = 0; k < g->tile_count; k++) {
        const vdb_tile *t = &g->tiles[k];
        assert_true(t->value == -g->background && !t->active);
        filled += (uint64_t)t->side * (uint64_t)t->side * (uint64_t)t->side;
        large += t->side == 128;
    }
    for (size_t v = 0; v < g->leaf_count * VDB_LEAF_VOXELS; v++) filled += g->leaf_values[v] < 0;
    assert_int_equal(filled, (uint64_t)SIDE * SIDE * SIDE); /* voxels at 1 .. SIDE of 0.5 .. SIDE + 0.5 */
    assert_true(large > 0);
    vdb_grid_free(g);
    mesh_free(&m);
}

/* A distance changes at most by the displacement; a wrong sign would be a jump. */
static void assert_steady(const vdb_grid *g, const char *what)
{
    const float most = (float)g->index_to_world[0] * 1.001f;
    for (size_t leaf = 0; leaf < g->leaf_count; leaf++) {
        const float *f = g->leaf_values + leaf * VDB_LEAF_VOXELS;
        for (int v = 0; v < VDB_LEAF_VOXELS; v++)
            for (int axis = 0; axis < 3; axis++) {
                int step = axis == 0 ? 64 : axis == 1 ? 8 : 1;
                if ((v / step & 7) < 7 && fabsf(f[v + step] - f[v]) > most)
                    fail_msg("%s: from %g to %g", what, f[v], f[v + step]);
            }
    }
}

static mesh mesh_of(const vec3 *corners, size_t corner_count, const uint32_t (*faces)[3], size_t face_count)
{
    mesh m = {corner_count, face_count, mem_array(corner_count, sizeof(vec3), "test", NULL),
              mem_array(face_count, sizeof *m.triangle, "test", NULL), false};
    memcpy(m.vertex, corners, corner_count * sizeof(vec3));
    memcpy(m.triangle, faces, face_count * sizeof *m.triangle);
    return m;
}

/* The one-sided projective plane of six vertices. The middle of one face is a separate triangle, which comes
 * first and is joined last, after the contradiction was found. */
static void one_sided_shells_are_reported(void **state)
{
    (void)state;
    static const uint32_t faces[16][3] = {{6, 7, 8}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 1, 5}, {1, 2, 4},
                                          {2, 3, 5}, {1, 3, 4}, {2, 4, 5}, {1, 3, 5}, {0, 1, 6}, {1, 7, 6},
                                          {1, 2, 7}, {2, 8, 7}, {2, 0, 8}, {0, 6, 8}};
    uint64_t seed = SEED;
    for (int k = 0; k < 20; k++) {
        vec3 corners[9];
        mesh_notes notes = {0};
        for (int i = 0; i < 9; i++) corners[i] = random_point(&seed, 1);
        mesh m = mesh_of(corners, 9, faces, 16);
        vdb_grid *g = make(&m, 32, &notes);
        judgement j = {.notes = notes};
        assert_note(&j, "1 of 1 shells have triangles that cannot all be turned");
        assert_steady(g, "projective plane");
        vdb_grid_free(g);
        mesh_free(&m);
    }
}

/* The faces that an odd number of random tetrahedra of seven points share: always a closed surface. */
static size_t random_cycle(uint64_t *seed, uint32_t faces[35][3])
{
    enum { POINTS = 7 };
    bool odd[POINTS][POINTS][POINTS] = {{{false}}};
    size_t count = 0;
    for (uint32_t a = 0; a < POINTS; a++)
        for (uint32_t b = a + 1; b < POINTS; b++)
            for (uint32_t c = b + 1; c < POINTS; c++)
                for (uint32_t d = c + 1; d < POINTS; d++) {
                    if (fixture_random(seed) > 0.3) continue;
                    odd[a][b][c] ^= true;
                    odd[a][b][d] ^= true;
                    odd[a][c][d] ^= true;
                    odd[b][c][d] ^= true;
                }
    for (uint32_t a = 0; a < POINTS; a++)
        for (uint32_t b = a + 1; b < POINTS; b++)
            for (uint32_t c = b + 1; c < POINTS; c++) {
                if (!odd[a][b][c]) continue;
                bool turned = fixture_random(seed) < 0.5;
                faces[count][0] = a;
                faces[count][1] = turned ? c : b;
                faces[count++][2] = turned ? b : c;
            }
    return count;
}

static void tangled_closed_surfaces_have_consistent_signs(void **state)
{
    (void)state;
    uint64_t seed = SEED;
    for (int k = 0; k < 100; k++) {
        uint32_t faces[35][3];
        vec3 corners[7];
        mesh_notes notes = {0};
        char what[64];
        size_t count = random_cycle(&seed, faces);
        for (int i = 0; i < 7; i++) corners[i] = random_point(&seed, 1);
        if (count == 0) continue;
        mesh m = mesh_of(corners, 7, faces, count);
        vdb_grid *g = make(&m, 24, &notes);
        snprintf(what, sizeof what, "cycle %d of seed %d", k, SEED);
        assert_steady(g, what);
        vdb_grid_free(g);
        mesh_free(&m);
    }
}

static void zeros_of_either_sign_are_equal(void **state)
{
    (void)state;
    const vec3 corners[7] = {{0, 0, 0},    {9, 0.0, 0},     {0, 9, 0},      {0, 0, 9},
                             {9, -0.0, 0}, {-0.0, 9, -0.0}, {-0.0, -0.0, 9}};
    static const uint32_t faces[4][3] = {{0, 2, 1}, {0, 4, 3}, {1, 5, 6}, {5, 0, 6}};
    judgement j = judge(mesh_of(corners, 7, faces, 4));
    if (!j.ok) fail_msg("%s", j.e.message);
    assert_int_equal(j.notes.count, 0);
}

static void sizes_and_limits(void **state)
{
    (void)state;
    static const struct {
        double voxel_size;
        int resolution;
        size_t memory;
        error_code code;
    } cases[] = {{0.1, 0, 1 << 30, ERROR_NONE},          {1, 0, 1 << 30, ERROR_SPEC_INVALID},
                 {1e-5, 0, 1 << 30, ERROR_SPEC_INVALID}, {0, 256, 1 << 20, ERROR_LIMIT_MEMORY},
                 {0, 8191, 1 << 26, ERROR_LIMIT_MEMORY}, {0, 256, 100, ERROR_LIMIT_MEMORY}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        const levelset_params params = {.voxel_size = cases[k].voxel_size,
                                        .resolution = cases[k].resolution,
                                        .band_vox = 4,
                                        .weld = 1e-6,
                                        .memory_limit = cases[k].memory,
                                        .pool = mesh_fixture_pool()};
        error e = {0};
        mesh_notes notes = {0};
        mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 2);
        vdb_grid *g = levelset_make(&m, &params, &notes, NULL, &e);
        if (e.code != cases[k].code) fail_msg("case %zu: %s", k, e.message);
        assert_true((g != NULL) == (e.code == ERROR_NONE));
        if (g && cases[k].voxel_size > 0) assert_true(g->index_to_world[0] == cases[k].voxel_size);
        vdb_grid_free(g);
        mesh_free(&m);
    }
    error e = {0};
    mesh_notes notes = {0};
    const levelset_params params = {
        .resolution = 100, .band_vox = 4, .weld = 1e-6, .memory_limit = 1 << 30, .pool = mesh_fixture_pool()};
    mesh point = mesh_fixture_ball((vec3){1, 1, 1}, 0, 0);
    assert_null(levelset_make(&point, &params, &notes, NULL, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
    mesh_free(&point);
}

/* ---- resolution on demand */

static void voxels_follow_the_points(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 1}, 0);
    voxel_size_request q = {.max_resolution = 4096, .memory_limit = (size_t)1 << 32, .point_bytes = 300};
    assert_true(fabs(voxel_size_begin(&m, &q).voxel_size - 2.0 / 256) < 1e-12);
    q.count = 1e6; /* 24 / 1e6 for each: spacings of 0.00526 */
    resolution r = voxel_size_begin(&m, &q);
    assert_true(fabs(r.voxel_size - 0.005264) < 1e-5);
    assert_string_equal(r.chosen_by, "spacing");
    assert_null(r.limited_by);
    q.max_resolution = 300;
    r = voxel_size_begin(&m, &q);
    assert_true(fabs(r.voxel_size - 2.0 / 300) < 1e-12);
    assert_string_equal(r.limited_by, "max_resolution");
    q.max_resolution = 4096;
    q.memory_limit = (size_t)800 << 20; /* the points take a third of the limit */
    r = voxel_size_begin(&m, &q);
    assert_true(r.voxel_size > 0.006 && r.voxel_size < 2.0 / 256);
    assert_string_equal(r.limited_by, "memory");
    q.resolution = 100;
    r = voxel_size_begin(&m, &q);
    assert_true(fabs(r.voxel_size - 0.02) < 1e-12);
    assert_string_equal(r.chosen_by, "spec");
    assert_false(voxel_size_refine(&r, &q, 0.001, 0.001));
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distance_from_triangles),
        cmocka_unit_test(winding_through_corners),
        cmocka_unit_test(winding_of_a_ball),
        cmocka_unit_test(good_meshes_have_no_notes),
        cmocka_unit_test(many_connected_triangles_are_one_part),
        cmocka_unit_test(holes_are_counted),
        cmocka_unit_test(holes_are_placed),
        cmocka_unit_test(near_vertices_are_joined),
        cmocka_unit_test(seams_are_closed),
        cmocka_unit_test(inner_walls_are_refused),
        cmocka_unit_test(edges_of_four_triangles_are_reported),
        cmocka_unit_test(orientation_is_repaired),
        cmocka_unit_test(degenerate_and_duplicate_triangles_are_reported),
        cmocka_unit_test(shells_in_shells),
        cmocka_unit_test(many_shells_in_any_order),
        cmocka_unit_test(boxes_are_exact),
        cmocka_unit_test(many_triangles_are_as_exact_as_few),
        cmocka_unit_test(the_inside_of_a_ball_is_exact),
        cmocka_unit_test(overlapping_shells_are_united),
        cmocka_unit_test(cavities_are_empty),
        cmocka_unit_test(the_interior_beyond_the_band_is_filled),
        cmocka_unit_test(one_sided_shells_are_reported),
        cmocka_unit_test(tangled_closed_surfaces_have_consistent_signs),
        cmocka_unit_test(zeros_of_either_sign_are_equal),
        cmocka_unit_test(sizes_and_limits),
        cmocka_unit_test(voxels_follow_the_points),
    };
    return cmocka_run_group_tests_name("levelset", tests, NULL, NULL);
}
