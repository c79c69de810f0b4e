// SPDX-License-Identifier: Apache-2.0
/* Overlapping coplanar faces: the remaining area is correct, and closed meshes stay closed, in any
 * position. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_weld.h"
#include "base/core/rng.h"
#include "mesh_fixture.h"
#include "geometry/mesh/coplanar.h"
#include "geometry/mesh/flat_triangles.h"

enum { SEED = 20261127 };

/* A rotation about an axis, and a translation. */
typedef struct pose {
    double angle;
    vec3 shift;
} pose;

static mesh box(vec3 low, vec3 high)
{
    return mesh_fixture_box(vec3_scale(vec3_add(low, high), 0.5), vec3_scale(vec3_sub(high, low), 0.5), 0);
}

/* A rectangle of n by n squares. */
static mesh rectangle(int n, double x, double y, double width, double height, double turn)
{
    mesh m = mesh_fixture_sheet(n, n, mesh_fixture_moebius);
    for (int j = 0; j <= n; j++)
        for (int i = 0; i <= n; i++) {
            const double u = width * i / n, v = height * j / n;
            m.vertex[j * (n + 1) + i] =
                vec3_make(x + u * cos(turn) - v * sin(turn), y + u * sin(turn) + v * cos(turn), 0);
        }
    return m;
}

static void put(mesh *m, const pose *p)
{
    for (size_t k = 0; k < m->vertex_count; k++)
        m->vertex[k] = vec3_add(mesh_fixture_unturn(m->vertex[k], p->angle), p->shift);
}

static coplanar_overlap cut(mesh *m)
{
    mesh_notes notes = {0};
    mesh_edges edges = {0};
    error e = {0};
    coplanar_overlap out;
    assert_true(mesh_weld(m, MESH_DROP_IF_CLOSED, &notes, &e));
    assert_true(mesh_edges_list(m, NULL, &edges, &e));
    const rounding r = rounding_of(m, NULL);
    const bool closed = edges.open == 0 && edges.odd == 0;
    assert_true(coplanar_cut(m, &edges, &r, NULL, &out, &e));
    const rounding thin = {COPLANAR_THIN * r.absolute, COPLANAR_THIN * r.relative};
    assert_true(flat_triangles_remove_thin(m, &thin, &e));
    assert_true(mesh_weld(m, MESH_DROP_IF_CLOSED, &notes, &e));
    assert_true(mesh_edges_list(m, NULL, &edges, &e));
    if (closed && (edges.open > 0 || edges.odd > 0))
        fail_msg("%zu open, %zu odd edges of %zu triangles; opposite %g same %g", edges.open, edges.odd,
                 m->triangle_count, out.opposite, out.same);
    mesh_edges_free(&edges);
    return out;
}

static void assert_near(double got, double wanted)
{
    if (!(fabs(got - wanted) <= 1e-10 * fmax(1, fabs(wanted)))) fail_msg("%.17g, not %.17g", got, wanted);
}

static double shared(double a, double b, double c, double d)
{
    return fmax(0, fmin(b, d) - fmax(a, c));
}

/* Boxes on a table, beside and across its boundary, and on each other: where two touch, neither face
 * remains. */
static void faces_in_contact_of_solids_are_removed(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 0);
    for (int n = 0; n < 200; n++) {
        const pose p = {n % 3 ? 6 * rng_uniform(&r) : 0, {n % 3 ? rng_uniform(&r) : 0, 0, 0}};
        mesh m = box((vec3){0, 0, -1}, (vec3){4, 3, 0});
        double wanted = mesh_area(&m), contact = 0, x = -0.5;
        for (int k = 0; k < 3;
             k++) { /* side by side, with gaps; on a lattice they share sides and corners with the table */
            const double step = n % 2 ? 0.5 : 0.01, wide = step * ceil(rng_uniform(&r) * 1.5 / step),
                         y = step * floor((rng_uniform(&r) * 4 - 1) / step),
                         deep = step * ceil(rng_uniform(&r) * 3 / step);
            mesh b = box((vec3){x, y, 0}, (vec3){x + wide, y + deep, 0.5 + k});
            wanted += mesh_area(&b);
            contact += shared(x, x + wide, 0, 4) * shared(y, y + deep, 0, 3);
            mesh_fixture_append(&m, b);
            x += wide + 0.25;
        }
        put(&m, &p);
        const coplanar_overlap out = cut(&m);
        assert_false(out.unfinished);
        assert_near(out.contact, contact);
        assert_near(out.opposite, 0);
        assert_near(out.same, 0);
        assert_near(mesh_area(&m), wanted - 2 * contact);
        mesh_free(&m);
    }
}

/* Rectangles of many triangles, rotated in their plane: the overlap is kept once, whatever the
 * orientations. */
static void overlapping_open_faces_are_kept_once(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 1);
    size_t unfinished = 0; /* reported by a warning */
    for (int n = 0; n < 100; n++) {
        const pose p = {n % 3 ? 6 * rng_uniform(&r) : 0, {rng_uniform(&r), 0, 0}};
        const double turn = n % 4 ? rng_uniform(&r) : 0;
        mesh m = rectangle(1 + n % 5, 0, 0, 3, 3, 0), small = rectangle(1 + n % 7, 1.2, 0.3, 1, 1, turn);
        if (n % 2)
            for (size_t t = 0; t < small.triangle_count; t++) mesh_fixture_turn(&small, t);
        mesh_fixture_append(&m, small);
        put(&m, &p);
        const coplanar_overlap out = cut(&m);
        unfinished += out.unfinished;
        if (!out.unfinished) {
            assert_near(n % 2 ? out.opposite : out.same, 1);
            assert_near(n % 2 ? out.same : out.opposite, 0);
            assert_near(out.contact, 0);
            assert_near(mesh_area(&m), 9);
        }
        mesh_free(&m);
    }
    print_message("# unfinished: %zu\n", unfinished);
    assert_true(unfinished <= 5);
}

/* A small triangle lies in a flat one and shares a corner. Its second corner is on a side, near that corner.
 * The cut there leaves a triangle whose blunt corner is the second one; the shared corner is within rounding
 * of the side beyond. A cut there would give the flat triangle back. The third triangle only sets the size
 * of coordinates. */
static void cuts_beside_a_blunt_corner_end(void **state)
{
    (void)state;
    const vec3 corner[9] = {{0, 0, 0},  {1170, 0, 0}, {-73000, 2038, 0}, {0, 0, 0}, {8.8, 0, 0},
                            {4, 30, 0}, {0, 0, 1},    {1, 0, 1},         {0, 1, 1}};
    mesh m = {9, 3, mem_alloc(9 * sizeof *m.vertex), mem_alloc(3 * sizeof *m.triangle), false};
    memcpy(m.vertex, corner, sizeof corner);
    for (uint32_t k = 0; k < 9; k++) m.triangle[k / 3][k % 3] = k;
    for (int k = 0; k < 6; k++) m.vertex[k] = (vec3){0, 0, 0};
    const rounding r = rounding_of(&m, NULL);
    const double reach = rounding_reach(&r, m.vertex), flat = 0.5 * 1170 * 2038 * reach * reach,
                 thin = 0.5 * COPLANAR_THIN * reach * 73000 * reach; /* as thin parts are removed */
    for (int k = 0; k < 6; k++) m.vertex[k] = vec3_scale(corner[k], reach);
    const coplanar_overlap out = cut(&m);
    assert_false(out.unfinished);
    double left = 0;
    for (size_t t = 0; t < m.triangle_count; t++) {
        const mesh one = {m.vertex_count, 1, m.vertex, m.triangle + t, false};
        if (m.vertex[m.triangle[t][0]].z == 0) left += mesh_area(&one);
    }
    if (!(fabs(left - flat) <= thin)) fail_msg("an area of %g is left, not %g", left, flat);
    mesh_free(&m);
}

/* Splits each triangle in three at its centroid. */
static void split_triangles(mesh *m)
{
    const size_t count = m->triangle_count;
    mesh out = {0};
    for (size_t t = 0; t < count; t++) {
        mesh three = {4, 3, mem_alloc(4 * sizeof *three.vertex), mem_alloc(3 * sizeof *three.triangle),
                      false};
        three.vertex[3] = (vec3){0, 0, 0};
        for (uint32_t k = 0; k < 3; k++) {
            three.vertex[k] = m->vertex[m->triangle[t][k]];
            three.vertex[3] = vec3_axpy(1.0 / 3, three.vertex[k], three.vertex[3]);
            memcpy(three.triangle[k], (uint32_t[3]){k, (k + 1) % 3, 3}, sizeof three.triangle[k]);
        }
        mesh_fixture_append(&out, three);
    }
    mesh_free(m);
    *m = out;
}

/* A duplicated box with other triangles, some of whose faces are reversed: these are no contact. */
static void reversed_faces_of_a_duplicated_box_leave_no_hole(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 2);
    for (int n = 0; n < 60; n++) {
        const pose p = {n % 3 ? 6 * rng_uniform(&r) : 0, {rng_uniform(&r), 0, 0}};
        mesh m = box((vec3){0, 0, 0}, (vec3){1, 2, 3}), again = box((vec3){0, 0, 0}, (vec3){1, 2, 3});
        double turned = 0;
        const double area = mesh_area(&m);
        for (size_t t = 0; t < 12; t++) {
            if (rng_uniform(&r) < 0.8) continue;
            mesh one = {m.vertex_count, 1, m.vertex, m.triangle + t, false};
            turned += mesh_area(&one);
            mesh_fixture_turn(&m, t);
        }
        split_triangles(&again);
        mesh_fixture_append(&m, again);
        put(&m, &p);
        const coplanar_overlap out = cut(&m);
        assert_false(out.unfinished);
        assert_near(mesh_area(&m), area);
        assert_near(out.opposite, turned);
        assert_near(out.same, area - turned);
        assert_near(out.contact, 0);
        mesh_free(&m);
    }
}

/* Faces that touch at their sides, faces in near planes, and faces of curved meshes are unchanged. */
static void other_faces_are_unchanged(void **state)
{
    (void)state;
    for (int n = 0; n < 4; n++) {
        mesh m = n == 0   ? rectangle(3, 0, 0, 3, 3, 0)
                 : n == 1 ? rectangle(3, 0, 0, 3, 3, 0)
                          : mesh_fixture_ball((vec3){0, 0, 0}, 1, 3);
        mesh other = n == 0   ? rectangle(2, 3, 0, 1, 2, 0)
                     : n == 1 ? rectangle(2, 1, 1, 1, 1, 0.2)
                              : mesh_fixture_ball((vec3){0.1, 0.07, 0.03}, 0.9, 3);
        for (size_t k = 0; n == 1 && k < other.vertex_count; k++) other.vertex[k].z = 1e-12;
        if (n == 3) mesh_free(&other);
        if (n < 3) mesh_fixture_append(&m, other);
        mesh_notes notes = {0};
        error e = {0};
        assert_true(mesh_weld(&m, MESH_DROP_CANCELLED, &notes, &e));
        const size_t before = m.triangle_count;
        const coplanar_overlap out = cut(&m);
        assert_true(out.same == 0 && out.opposite == 0 && out.contact == 0);
        assert_int_equal(m.triangle_count, before);
        mesh_free(&m);
    }
}

/* The sides of a prism, each with a smaller rectangle on it: many planes with one slope along the axis of the prism. */
static void overlaps_on_the_sides_of_a_prism_are_found(void **state)
{
    (void)state;
    enum { SIDES = 200 };
    const vec3 axes[] = {{0.5377, 0.3183, 0.7809}, {-0.5094, 0.8605, 0}, {1, 1, 1}, {0, 0, 1}};
    const double wide = tan(M_PI / SIDES);
    for (size_t n = 0; n < sizeof axes / sizeof *axes; n++) {
        mesh m = {0};
        vec3 u, v;
        const vec3 axis = vec3_unit(axes[n]);
        vec3_frame(axis, &u, &v);
        for (int k = 0; k < 2 * SIDES; k++) {
            const double at = 2 * M_PI * (k / 2) / SIDES;
            const vec3 out = vec3_axpy(cos(at), u, vec3_scale(v, sin(at))),
                       along = vec3_axpy(-sin(at), u, vec3_scale(v, cos(at)));
            mesh side = k % 2 ? rectangle(1, -0.5 * wide, 0.2, wide, 0.5, 0)
                              : rectangle(1, -0.9 * wide, 0, 1.8 * wide, 1, 0);
            for (size_t c = 0; c < side.vertex_count; c++)
                side.vertex[c] =
                    vec3_add(out, vec3_axpy(side.vertex[c].x, along, vec3_scale(axis, side.vertex[c].y)));
            if (k == 0)
                m = side;
            else
                mesh_fixture_append(&m, side);
        }
        const coplanar_overlap out = cut(&m);
        assert_false(out.unfinished);
        assert_near(out.same, SIDES * 0.5 * wide);
        assert_near(out.opposite, 0);
        assert_near(mesh_area(&m), SIDES * 1.8 * wide);
        mesh_free(&m);
    }
}

/* Each triangle of a ball is a plane of its own; one has a small parallelogram on it. */
static void an_overlap_among_very_many_planes_is_found(void **state)
{
    (void)state;
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 6), small = rectangle(1, 0, 0, 1, 1, 0);
    assert_true(m.triangle_count > 1 << 16);
    const uint32_t *corner = m.triangle[m.triangle_count / 3];
    const vec3 a = m.vertex[corner[0]], u = vec3_scale(vec3_sub(m.vertex[corner[1]], a), 0.1),
               v = vec3_scale(vec3_sub(m.vertex[corner[2]], a), 0.1);
    for (size_t k = 0; k < 4; k++)
        small.vertex[k] = vec3_add(vec3_axpy((double)(k % 2 + 2), u, a), vec3_scale(v, (double)(k / 2 + 2)));
    mesh_fixture_append(&m, small);
    const coplanar_overlap out = cut(&m);
    assert_near(1e5 * out.same, 1e5 * vec3_norm(vec3_cross(u, v)));
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faces_in_contact_of_solids_are_removed),
        cmocka_unit_test(overlapping_open_faces_are_kept_once),
        cmocka_unit_test(cuts_beside_a_blunt_corner_end),
        cmocka_unit_test(reversed_faces_of_a_duplicated_box_leave_no_hole),
        cmocka_unit_test(other_faces_are_unchanged),
        cmocka_unit_test(overlaps_on_the_sides_of_a_prism_are_found),
        cmocka_unit_test(an_overlap_among_very_many_planes_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
