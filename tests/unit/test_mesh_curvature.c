// SPDX-License-Identifier: Apache-2.0
/* Curvature of the surfaces that meshes approximate, against exact values: torus, ellipsoid, cylinders, flat faces;
 * and the features of a mesh, for surfaces at an offset. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "surface/field/field.h"
#include "surface/triangles/jet.h"
#include "surface/triangles/mesh_curvature.h"
#include "base/core/memory.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh_weld.h"
#include "mesh_fixture.h"
#include "shapes.h"

enum { PLACES = 2000 };
static const double SHARP = 0.7; /* radians */

/* A place on a mesh. */
typedef struct place {
    uint32_t triangle;
    double weight[3];
} place;

static place random_place(const mesh *m, rng *r)
{
    place p = {(uint32_t)(rng_uniform(r) * (double)m->triangle_count), {0, 0, 0}};
    const double root = sqrt(rng_uniform(r)), share = rng_uniform(r);
    p.weight[0] = 1 - root;
    p.weight[1] = root * (1 - share);
    p.weight[2] = root * share;
    return p;
}

static vec3 position_of(const mesh *m, const place *p)
{
    vec3 x = {0, 0, 0};
    for (int k = 0; k < 3; k++) x = vec3_axpy(p->weight[k], m->vertex[m->triangle[p->triangle][k]], x);
    return x;
}

/* Rows of `around` vertices; a grid of quads, each of two triangles, between rows, closed around, and closed along
 * if `loops`. place(a, b): the vertex at a of 0 .. 1 around and b of 0 .. 1 along. */
static mesh grid_of(int around, int along, bool loops, vec3 (*vertex_at)(double a, double b))
{
    const int rows = loops ? along : along + 1;
    mesh m = {.vertex_count = (size_t)(around * rows), .triangle_count = (size_t)(2 * around * along)};
    m.vertex = mem_array(m.vertex_count, sizeof *m.vertex, "", NULL);
    m.triangle = mem_array(m.triangle_count, sizeof *m.triangle, "", NULL);
    for (int i = 0; i < around; i++)
        for (int j = 0; j < rows; j++)
            m.vertex[i * rows + j] = vertex_at((double)i / around, (double)j / along);
    for (int i = 0; i < around; i++)
        for (int j = 0; j < along; j++) {
            const uint32_t a = (uint32_t)(i * rows + j), b = (uint32_t)((i + 1) % around * rows + j),
                           c = (uint32_t)((i + 1) % around * rows + (j + 1) % rows),
                           d = (uint32_t)(i * rows + (j + 1) % rows);
            const size_t n = 2 * (size_t)(i * along + j);
            memcpy(m.triangle[n], (uint32_t[]){a, b, c}, sizeof *m.triangle);
            memcpy(m.triangle[n + 1], (uint32_t[]){a, c, d}, sizeof *m.triangle);
        }
    return m;
}

static const double MAJOR = 1, MINOR = 0.4, RADIUS = 0.5, HEIGHT = 2;

static vec3 on_torus(double a, double b)
{
    const double u = 2 * M_PI * a, v = 2 * M_PI * b, from_axis = MAJOR + MINOR * cos(v);
    return vec3_make(from_axis * cos(u), from_axis * sin(u), MINOR * sin(v));
}

static vec3 on_cylinder(double a, double b)
{
    return vec3_make(RADIUS * cos(2 * M_PI * a), RADIUS * sin(2 * M_PI * a), HEIGHT * b);
}

/* The smaller curvature; the larger one is 1 / MINOR. */
static double torus_kappa2(vec3 x)
{
    const double along = atan2(x.z, hypot(x.x, x.y) - MAJOR);
    return cos(along) / (MAJOR + MINOR * cos(along));
}

static mesh_curvature *curvature_of(const mesh *m, double crease, const place *p, size_t count, threads *pool)
{
    error e = {0};
    mesh_curvature *c = mesh_curvature_new(m, NULL, crease, pool, &e);
    assert_non_null(c);
    uint32_t *list = mem_array(count, sizeof *list, "", NULL);
    for (size_t i = 0; i < count; i++) list[i] = p[i].triangle;
    assert_true(mesh_curvature_prepare(c, list, count, pool, &e));
    free(list);
    return c;
}

static mesh_curvature_value kappas_at(const mesh_curvature *c, const place *p, double *kappa1, double *kappa2)
{
    const mesh_curvature_value v = mesh_curvature_at(c, p->triangle, p->weight);
    const field_sample s = {0, v.normal, v.shape};
    field_curvature(&s, kappa1, kappa2);
    return v;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Checks the errors of both curvatures of a torus over the larger one. */
static void check_torus(const mesh *m, double median, double largest)
{
    rng r = rng_seed(test_seed(), 0);
    place p[PLACES];
    double off[PLACES];
    for (int i = 0; i < PLACES; i++) p[i] = random_place(m, &r);
    mesh_curvature *c = curvature_of(m, SHARP, p, PLACES, NULL);
    for (int i = 0; i < PLACES; i++) {
        double kappa1, kappa2;
        const vec3 x = position_of(m, &p[i]);
        const mesh_curvature_value v = kappas_at(c, &p[i], &kappa1, &kappa2);
        const vec3 out = vec3_sub(x, vec3_scale(vec3_unit(vec3_make(x.x, x.y, 0)), MAJOR));
        assert_true(v.defined && vec3_dot(v.normal, vec3_unit(out)) > 0.98);
        off[i] = fmax(fabs(kappa1 - 1 / MINOR), fabs(kappa2 - torus_kappa2(x))) * MINOR;
    }
    qsort(off, PLACES, sizeof *off, ascending);
    assert_true(off[PLACES / 2] < median && off[PLACES - 1] < largest);
    mesh_curvature_free(c);
}

static void quads_of_a_torus_have_its_curvature(void **state)
{
    (void)state;
    static const struct {
        int around, along;
        double median, largest;
    } grids[] = {{40, 20, 0.05, 0.07}, {100, 25, 0.018, 0.02}, {200, 100, 0.0003, 0.001}};
    for (size_t k = 0; k < sizeof grids / sizeof *grids; k++) {
        mesh m = grid_of(grids[k].around, grids[k].along, true, on_torus);
        check_torus(&m, grids[k].median, grids[k].largest);
        mesh_free(&m);
    }
}

/* Divides each triangle into four, linearly. */
static mesh divide(const mesh *m)
{
    mesh out = {.vertex_count = 6 * m->triangle_count, .triangle_count = 4 * m->triangle_count};
    error e = {0};
    out.vertex = mem_array(out.vertex_count, sizeof *out.vertex, "", NULL);
    out.triangle = mem_array(out.triangle_count, sizeof *out.triangle, "", NULL);
    for (size_t n = 0; n < m->triangle_count; n++) {
        static const uint32_t parts[4][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}, {3, 4, 5}};
        const uint32_t *t = m->triangle[n];
        for (int k = 0; k < 3; k++) {
            const vec3 a = m->vertex[t[k]], b = m->vertex[t[(k + 1) % 3]];
            out.vertex[6 * n + (size_t)k] = a;
            out.vertex[6 * n + 3 + (size_t)k] = vec3_scale(vec3_add(a, b), 0.5);
        }
        for (size_t i = 0; i < 4; i++)
            for (int k = 0; k < 3; k++) out.triangle[4 * n + i][k] = (uint32_t)(6 * n) + parts[i][k];
    }
    assert_true(mesh_weld_vertices(&out, NULL, &e));
    return out;
}

static void divided_facets_have_the_curvature_of_the_surface_and_no_stripes(void **state)
{
    (void)state;
    mesh m = grid_of(40, 20, true, on_torus);
    for (int k = 0; k < 3; k++) {
        mesh divided = divide(&m);
        mesh_free(&m);
        m = divided;
    }
    check_torus(&m, 0.07, 0.09);
    mesh_free(&m);
}

/* Tubes of quads: their facets extend from one end to the other, however many rows they have. */
static void the_side_of_a_cylinder_is_bent_in_one_direction(void **state)
{
    (void)state;
    static const struct {
        int around;
        double tolerance;
    } tubes[] = {{16, 0.13}, {24, 0.03}, {64, 0.001}};
    rng r = rng_seed(test_seed(), 1);
    for (size_t k = 0; k < sizeof tubes / sizeof *tubes; k++)
        for (int rows = 1; rows < 10; rows += 4) {
            mesh m = grid_of(tubes[k].around, rows, false, on_cylinder);
            place p[100];
            for (int i = 0; i < 100; i++) p[i] = random_place(&m, &r);
            mesh_curvature *c = curvature_of(&m, SHARP, p, 100, NULL);
            for (int i = 0; i < 100; i++) {
                double kappa1, kappa2;
                const mesh_curvature_value v = kappas_at(c, &p[i], &kappa1, &kappa2);
                const field_sample s = {0, v.normal, v.shape};
                assert_true(v.defined && fabs(kappa1 * RADIUS - 1) < tubes[k].tolerance);
                assert_true(fabs(kappa2) < 1e-3 && fabs(field_principal_direction(&s, true).z) < 0.02);
            }
            mesh_curvature_free(c);
            mesh_free(&m);
        }
}

static void faces_between_creases_are_flat(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    mesh box = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 2, 0.5}, 0.3), divided = divide(&box);
    mesh tube = grid_of(8, 3, false, on_cylinder); /* 45 degrees between its faces */
    const mesh *all[] = {&box, &divided, &tube};
    for (size_t k = 0; k < 3; k++) {
        place p[50];
        for (int i = 0; i < 50; i++) p[i] = random_place(all[k], &r);
        mesh_curvature *c = curvature_of(all[k], SHARP, p, 50, NULL);
        for (int i = 0; i < 50; i++) {
            double kappa1, kappa2;
            assert_true(kappas_at(c, &p[i], &kappa1, &kappa2).defined);
            assert_true(kappa1 == 0 && kappa2 == 0);
        }
        assert_int_equal(mesh_curvature_jets(c), 0);
        mesh_curvature_free(c);
    }
    mesh_free(&box);
    mesh_free(&divided);
    mesh_free(&tube);
}

/* Two triangles that meet at a blunt angle do not determine a curvature. */
static void the_curvature_of_two_triangles_is_undefined(void **state)
{
    (void)state;
    vec3 vertex[] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0.2}};
    uint32_t corners[][3] = {{0, 1, 2}, {2, 1, 3}};
    const mesh m = {4, 2, vertex, corners, false};
    const place p = {0, {0.2, 0.3, 0.5}};
    double kappa1, kappa2;
    mesh_curvature *c = curvature_of(&m, SHARP, &p, 1, NULL);
    assert_false(kappas_at(c, &p, &kappa1, &kappa2).defined);
    assert_true(kappa1 == 0 && kappa2 == 0);
    mesh_curvature_free(c);
}

static void jets_do_not_depend_on_threads_or_on_other_places(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 3);
    mesh m = grid_of(60, 24, true, on_torus);
    place p[PLACES];
    error e = {0};
    for (int i = 0; i < PLACES; i++) p[i] = random_place(&m, &r);
    threads *pool = threads_new(2, NULL, &e);
    mesh_curvature *all = curvature_of(&m, SHARP, p, PLACES, pool);
    for (int i = 0; i < 20; i++) {
        mesh_curvature *one = curvature_of(&m, SHARP, &p[i], 1, NULL);
        const mesh_curvature_value a = mesh_curvature_at(all, p[i].triangle, p[i].weight),
                                   b = mesh_curvature_at(one, p[i].triangle, p[i].weight);
        assert_memory_equal(&a.normal, &b.normal, sizeof a.normal);
        assert_memory_equal(&a.shape, &b.shape, sizeof a.shape);
        mesh_curvature_free(one);
    }
    mesh_curvature_free(all);
    threads_free(pool);
    mesh_free(&m);
}

static void creases_and_corners_of_a_box_are_found(void **state)
{
    (void)state;
    mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 1}, 0);
    const place middle = {0, {0.2, 0.3, 0.5}};
    mesh_curvature *c = curvature_of(&m, SHARP, &middle, 1, NULL);
    vec3 along;
    int creases = 0, diagonals = 0;
    assert_int_equal(mesh_curvature_feature_at(c, 0, middle.weight, &along), MESH_CURVATURE_SMOOTH);
    for (uint32_t n = 0; n < m.triangle_count; n++)
        for (int k = 0; k < 3; k++) {
            double weight[3] = {0.5, 0.5, 0.5}, corner[3] = {0, 0, 0};
            weight[k] = 0;
            corner[k] = 1;
            if (mesh_curvature_feature_at(c, n, weight, &along) == MESH_CURVATURE_CREASE)
                creases++;
            else
                diagonals++;
            assert_int_equal(mesh_curvature_feature_at(c, n, corner, &along), MESH_CURVATURE_CORNER);
        }
    assert_int_equal(creases, 24); /* each of twelve edges from both sides */
    assert_int_equal(diagonals, 12);
    mesh_curvature_free(c);
    mesh_free(&m);
}

/* A polynomial of degree 4 is found exactly, by each lane. */
static void a_polynomial_has_its_own_derivatives(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 4);
    jet_lanes *j = mem_array(1, sizeof *j, "", NULL);
    jet expected[JET_LANES];
    j->rows = 40;
    for (int l = 0; l < JET_LANES; l++) {
        double a[JET_COLUMNS];
        for (int k = 0; k < JET_COLUMNS; k++) a[k] = 2 * rng_uniform(&r) - 1;
        expected[l] = (jet){a[0], a[1], a[2], 2 * a[3], a[4], 2 * a[5]};
        for (int row = 0; row < j->rows; row++) {
            const double u = 2 * rng_uniform(&r) - 1, v = 2 * rng_uniform(&r) - 1,
                         weight = 0.1 + rng_uniform(&r);
            double sum = 0;
            for (int degree = 0, k = 0; degree <= JET_DEGREE; degree++)
                for (int of_v = 0; of_v <= degree; of_v++, k++)
                    sum += a[k] * pow(u, degree - of_v) * pow(v, of_v);
            j->u[row][l] = u;
            j->v[row][l] = v;
            j->weight[row][l] = weight;
            j->w[row][l] = weight * sum;
        }
    }
    jet all[JET_LANES];
    jet_factor(j);
    jet_solve(j, JET_DEGREE, all);
    for (int l = 0; l < JET_LANES; l++) {
        const jet found = all[l], *e = &expected[l];
        assert_true(jet_condition(j, l, JET_DEGREE) > 0.01);
        assert_true(fabs(found.w - e->w) + fabs(found.wu - e->wu) + fabs(found.wv - e->wv) < 1e-10);
        assert_true(fabs(found.wuu - e->wuu) + fabs(found.wuv - e->wuv) + fabs(found.wvv - e->wvv) < 1e-10);
    }
    free(j);
}

/* Places on two lines at any angle: the surface is bent along them only. */
static void a_strip_is_straight_across_its_lines(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 5);
    jet_lanes *j = mem_array(1, sizeof *j, "", NULL);
    for (int k = 0; k < 100; k++) {
        const double turn = 2 * M_PI * rng_uniform(&r), bend = 1 + rng_uniform(&r), slope = rng_uniform(&r);
        j->rows = 14;
        memset(j->weight, 0, sizeof j->weight);
        for (int row = 0; row < j->rows; row++) {
            const double along = 0.3 * (row / 2 - 3), across = 1.3 * (row % 2);
            j->u[row][0] = along * cos(turn) - across * sin(turn);
            j->v[row][0] = along * sin(turn) + across * cos(turn);
            j->weight[row][0] = 1;
            j->w[row][0] = 0.5 * bend * along * along + slope * across;
        }
        jet found;
        jet_factor(j);
        assert_true(jet_condition(j, 0, 2) < 1e-6);
        assert_true(jet_solve_strip(j, 0, JET_DEGREE, 0.02, &found));
        assert_true(fabs(found.wuu - bend * cos(turn) * cos(turn)) < 1e-8);
        assert_true(fabs(found.wuv - bend * cos(turn) * sin(turn)) < 1e-8);
        assert_true(fabs(found.wvv - bend * sin(turn) * sin(turn)) < 1e-8);
    }
    free(j);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(quads_of_a_torus_have_its_curvature),
        cmocka_unit_test(divided_facets_have_the_curvature_of_the_surface_and_no_stripes),
        cmocka_unit_test(the_side_of_a_cylinder_is_bent_in_one_direction),
        cmocka_unit_test(faces_between_creases_are_flat),
        cmocka_unit_test(the_curvature_of_two_triangles_is_undefined),
        cmocka_unit_test(jets_do_not_depend_on_threads_or_on_other_places),
        cmocka_unit_test(creases_and_corners_of_a_box_are_found),
        cmocka_unit_test(a_polynomial_has_its_own_derivatives),
        cmocka_unit_test(a_strip_is_straight_across_its_lines),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
