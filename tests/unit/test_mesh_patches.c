// SPDX-License-Identifier: Apache-2.0
/* Meshes as patches, curves and corners: shapes whose numbers of each are known. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/triangles/mesh_patches.h"
#include "mesh_fixture.h"

static vec3 flat(double u, double v)
{
    return vec3_make(u, v, 0);
}

static vec3 wall(double u, double v)
{
    return vec3_make(u, 0.5, v);
}

static vec3 klein(double u, double v)
{
    const double a = 2 * M_PI * u, b = 2 * M_PI * v, s = sin(b), t = sin(2 * b);
    const double r = 3 + cos(a / 2) * s - sin(a / 2) * t;
    return mesh_fixture_rounded(vec3_make(r * cos(a), r * sin(a), sin(a / 2) * s + cos(a / 2) * t));
}

static mesh_patches make(mesh m, double angle)
{
    mesh_patches out = {0};
    mesh_notes notes = {0};
    error e = {0};
    const mesh_patches_params params = {.weld = 1e-6, .feature_angle = angle};
    assert_true(mesh_patches_make(&m, &params, &notes, &out, &e));
    assert_null(m.vertex);
    /* no curve is empty, and curves that meet share their ends */
    for (size_t k = 0; k < out.curve_count; k++) {
        assert_true(out.curve[k].count >= (out.curve[k].closed ? 3 : 2));
        assert_true(out.curve[k].patch_count >= 1);
        for (size_t i = 0; i < out.curve[k].patch_count; i++)
            assert_true(out.curve_patch[out.curve[k].patch_first + i] < out.count);
    }
    assert_int_equal(out.first[out.count], out.m.triangle_count);
    return out;
}

static void assert_counts(const mesh_patches *p, size_t patches, size_t curves, size_t patches_at_each)
{
    assert_int_equal(p->count, patches);
    assert_int_equal(p->curve_count, curves);
    for (size_t k = 0; patches_at_each && k < curves; k++)
        assert_int_equal(p->curve[k].patch_count, patches_at_each);
}

/* Checks that triangles of a patch agree along their shared edges. Vertices are not shared across curves. */
static void assert_oriented(const mesh_patches *p)
{
    for (size_t a = 0; a < p->m.triangle_count; a++)
        for (size_t b = 0; b < p->m.triangle_count; b++)
            for (int i = 0; a != b && i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    const uint32_t *s = p->m.triangle[a], *t = p->m.triangle[b];
                    assert_false(s[i] == t[j] && s[(i + 1) % 3] == t[(j + 1) % 3]);
                }
}

static void test_square_sheet(void **state)
{
    (void)state;
    mesh_patches p = make(mesh_fixture_sheet(5, 5, flat), MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 4, 1);
    assert_int_equal(p.open_edges, 20);
    for (int k = 0; k < 4; k++) assert_int_equal(p.curve[k].count, 6);
    assert_false(p.one_sided[0] || p.curve[0].closed);
    mesh_patches_free(&p);
    p = make(mesh_fixture_sheet(5, 5, flat), 0); /* without features, its boundary is one loop */
    assert_counts(&p, 1, 1, 1);
    assert_true(p.curve[0].closed);
    assert_int_equal(p.curve[0].count, 20);
    mesh_patches_free(&p);
}

static void test_box(void **state)
{
    (void)state;
    mesh_patches p =
        make(mesh_fixture_box(vec3_make(1, 2, 3), vec3_make(1, 2, 3), 0.3), MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 6, 12, 2);
    assert_true(p.feature_angle == MESH_PATCHES_ANGLE);
    assert_int_equal(p.m.vertex_count, 24); /* each face has its own vertices */
    for (int k = 0; k < 12; k++) assert_int_equal(p.curve[k].count, 2);
    mesh_patches_free(&p);
    p = make(mesh_fixture_box(vec3_make(1, 2, 3), vec3_make(1, 2, 3), 0.3), 0);
    assert_counts(&p, 1, 0, 0);
    mesh_patches_free(&p);
}

/* A surface folded along v = 1/2; the far ends of its halves are a tenth of their length apart. */
static vec3 folded(double u, double v)
{
    return vec3_make(u, fabs(v - 0.5), 0.1 * (v - 0.5));
}

static void test_curves_have_the_cosine_of_their_sharpest_angle(void **state)
{
    (void)state;
    mesh_patches p = make(mesh_fixture_sheet(4, 4, folded), 2);
    double least = 1;
    assert_int_equal(p.count, 2);
    for (size_t k = 0; k < p.curve_count; k++) {
        if (p.curve[k].patch_count == 1) assert_true(p.curve[k].cosine == 0);
        least = fmin(least, p.curve[k].cosine);
    }
    assert_true(fabs(least + (1 - 0.01) / (1 + 0.01)) < 1e-9);
    mesh_patches_free(&p);
}

static void test_smooth_ball_has_no_curves(void **state)
{
    (void)state;
    mesh_patches p = make(mesh_fixture_ball(vec3_make(0, 0, 0), 1, 3), MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 0, 0);
    mesh_patches_free(&p);
}

/* Rough like a scan: angles of all sizes, and few sharp ones. */
static void test_scan_has_no_features(void **state)
{
    (void)state;
    mesh m = mesh_fixture_ball(vec3_make(0, 0, 0), 1, 4);
    for (size_t v = 0; v < m.vertex_count; v++) { /* equal for coinciding vertices */
        const vec3 x = m.vertex[v];
        m.vertex[v] = vec3_scale(x, 1 + 0.02 * sin(1e3 * (x.x + 2 * x.y + 3 * x.z)));
    }
    mesh_patches p = make(m, MESH_PATCHES_AUTOMATIC);
    assert_true(p.feature_angle == 0);
    assert_counts(&p, 1, 0, 0);
    mesh_patches_free(&p);
}

static void test_one_sided_surfaces(void **state)
{
    (void)state;
    mesh_patches p = make(mesh_fixture_sheet(60, 6, mesh_fixture_moebius), MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 1, 1);
    assert_true(p.one_sided[0] && p.curve[0].closed);
    assert_int_equal(p.curve[0].count, 120);
    mesh_patches_free(&p);
    p = make(mesh_fixture_sheet(90, 61, klein), MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 0, 0);
    assert_true(p.one_sided[0]);
    mesh_patches_free(&p);
}

static void test_three_surfaces_meet_in_an_edge(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(4, 4, flat);
    mesh_fixture_append(&m, mesh_fixture_sheet(4, 4, wall));
    /* the flat part is two patches, on either side of the wall */
    mesh_patches p = make(m, MESH_PATCHES_AUTOMATIC);
    size_t three = 0;
    assert_int_equal(p.count, 3);
    for (size_t k = 0; k < p.curve_count; k++) three += p.curve[k].patch_count == 3;
    assert_int_equal(three, 1);
    assert_int_equal(p.nonmanifold_edges, 4);
    mesh_patches_free(&p);
}

static void test_orientation_follows_the_majority(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(6, 6, flat);
    for (size_t n = 0; n < m.triangle_count; n += 2) /* less than half, so that there is a majority */
        if (n > 0) mesh_fixture_turn(&m, n);
    mesh_patches p = make(m, MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 4, 1);
    assert_oriented(&p);
    const uint32_t *t = p.m.triangle[0];
    assert_true(
        vec3_cross(vec3_sub(p.m.vertex[t[1]], p.m.vertex[t[0]]), vec3_sub(p.m.vertex[t[2]], p.m.vertex[t[0]]))
            .z > 0);
    mesh_patches_free(&p);
}

static void test_duplicate_faces_count_once(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(3, 3, flat), back = mesh_fixture_sheet(3, 3, flat);
    for (size_t n = 0; n < 9; n++) mesh_fixture_turn(&back, n);
    mesh_fixture_append(&m, back);
    mesh_fixture_append(&m, mesh_fixture_sheet(3, 3, flat));
    mesh_patches p = make(m, MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 4, 1);
    assert_int_equal(p.m.triangle_count, 18);
    mesh_patches_free(&p);
}

static vec3 beside(double u, double v)
{
    return vec3_make(1 + u, v, 0);
}

/* Surfaces whose vertices lie on each other's edges are joined. */
static void test_t_junctions(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(2, 2, flat);
    mesh_fixture_append(&m, mesh_fixture_sheet(3, 3, beside));
    mesh_patches p = make(m, MESH_PATCHES_AUTOMATIC);
    assert_counts(&p, 1, 4, 1);
    mesh_patches_free(&p);
}

static void test_disconnected_triangles_are_patches(void **state)
{
    (void)state;
    mesh m = {0};
    m.vertex = mem_alloc(30 * sizeof *m.vertex);
    for (double n = 0; n < 30; n++)
        m.vertex[m.vertex_count++] = vec3_make(cos(2.1 * n), sin(3.7 * n), cos(5.3 * n));
    for (uint32_t n = 0; n < 30; n += 3) mesh_fixture_add(&m, n, n + 1, n + 2);
    mesh_patches p = make(m, MESH_PATCHES_AUTOMATIC);
    assert_int_equal(p.count, 10);
    assert_int_equal(p.open_edges, 30);
    mesh_patches_free(&p);
}

static void test_a_mesh_without_area_has_no_surface(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(1, 1, flat);
    for (size_t n = 0; n < m.triangle_count; n++) m.triangle[n][1] = m.triangle[n][0];
    mesh_patches out = {0};
    mesh_notes notes = {0};
    error e = {0};
    const mesh_patches_params params = {.weld = 1e-6};
    assert_false(mesh_patches_make(&m, &params, &notes, &out, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
}

/* Checks the Euler characteristic of the inside of each patch. */
static void assert_euler(mesh m, double angle, size_t patches, const int64_t *euler)
{
    mesh_patches p = make(m, angle);
    assert_int_equal(p.count, patches);
    for (size_t k = 0; k < patches; k++) assert_int_equal(p.euler[k], euler[k]);
    mesh_patches_free(&p);
}

static void euler_is_that_of_the_insides(void **state)
{
    (void)state;
    static const int64_t faces[] = {1, 1, 1, 1, 1, 1}, ball = 2, moebius = 0, fin[] = {0, 1};
    assert_euler(mesh_fixture_ball(vec3_make(0, 0, 0), 1, 2), MESH_PATCHES_AUTOMATIC, 1, &ball);
    assert_euler(mesh_fixture_box(vec3_make(0, 0, 0), vec3_make(1, 1, 1), 0.3), MESH_PATCHES_AUTOMATIC, 6,
                 faces);
    assert_euler(mesh_fixture_sheet(40, 4, mesh_fixture_moebius), 0, 1, &moebius);
    /* A sheet with a triangle on one inner edge, which is a slit in it: the sheet's inside is a ring. */
    mesh sheet = mesh_fixture_sheet(4, 4, flat);
    mesh_fixture_append(&sheet, mesh_fixture_sheet(1, 1, wall));
    for (int k = 0; k < 2; k++) mesh_fixture_remove(&sheet, sheet.triangle_count - 1);
    mesh_fixture_add(&sheet, 6, 7, 27);
    assert_euler(sheet, 0, 2, fin);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_square_sheet),
        cmocka_unit_test(test_box),
        cmocka_unit_test(test_curves_have_the_cosine_of_their_sharpest_angle),
        cmocka_unit_test(test_smooth_ball_has_no_curves),
        cmocka_unit_test(test_scan_has_no_features),
        cmocka_unit_test(test_one_sided_surfaces),
        cmocka_unit_test(test_three_surfaces_meet_in_an_edge),
        cmocka_unit_test(test_orientation_follows_the_majority),
        cmocka_unit_test(test_duplicate_faces_count_once),
        cmocka_unit_test(test_t_junctions),
        cmocka_unit_test(test_disconnected_triangles_are_patches),
        cmocka_unit_test(test_a_mesh_without_area_has_no_surface),
        cmocka_unit_test(euler_is_that_of_the_insides),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
