// SPDX-License-Identifier: Apache-2.0
/* Weights of high order: integrals over tori and spheres that are known, and point sets that have no weights. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/weights/quadrature.h"

static const double MAJOR = 1, MINOR = 0.4;

typedef struct scene {
    size_t count, triangles;
    vec3 *position, *normal;
    uint32_t (*triangle)[3];
    double *weight, lower_area;
    quadrature_end end;
} scene;

static scene allocate(size_t count, size_t triangles)
{
    scene s = {.count = count, .triangles = triangles};
    s.position = calloc(count, sizeof *s.position);
    s.normal = calloc(count, sizeof *s.normal);
    s.triangle = calloc(triangles, sizeof *s.triangle);
    s.weight = calloc(count, sizeof *s.weight);
    return s;
}

static void release(scene *s)
{
    free(s->position);
    free(s->normal);
    free(s->triangle);
    free(s->weight);
}

/* A torus about z: rows of `around` points, every second one shifted by half a step. */
static scene make_torus(int around, int rows)
{
    scene s = allocate((size_t)(around * rows), (size_t)(2 * around * rows));
    for (int j = 0; j < rows; j++)
        for (int i = 0; i < around; i++) {
            const double u = 2 * M_PI * (i + 0.5 * (j % 2)) / around, v = 2 * M_PI * j / rows,
                         radius = MAJOR + MINOR * cos(v);
            const int k = j * around + i, up = (j + 1) % rows * around, right = (i + 1) % around,
                      here = j * around + right, left_up = up + (j % 2 ? right : i),
                      right_up = up + (j % 2 ? (right + 1) % around : right);
            s.position[k] = vec3_make(radius * cos(u), radius * sin(u), MINOR * sin(v));
            s.normal[k] = vec3_make(cos(v) * cos(u), cos(v) * sin(u), sin(v));
            const uint32_t first[3] = {(uint32_t)k, (uint32_t)here, (uint32_t)left_up},
                           second[3] = {(uint32_t)here, (uint32_t)right_up, (uint32_t)left_up};
            memcpy(s.triangle[2 * k], first, sizeof first);
            memcpy(s.triangle[2 * k + 1], second, sizeof second);
        }
    return s;
}

static uint32_t middle_of(scene *s, uint32_t a, uint32_t b)
{
    const vec3 p = vec3_unit(vec3_add(s->position[a], s->position[b]));
    for (uint32_t k = 0; k < s->count; k++)
        if (vec3_norm2(vec3_sub(s->position[k], p)) < 1e-16) return k;
    s->position[s->count] = p;
    return (uint32_t)s->count++;
}

/* A unit sphere: an icosahedron whose triangles are divided into four, `levels` times. */
static scene make_sphere(int levels)
{
    static const uint32_t face[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                         {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                         {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                         {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    const double g = 0.5 * (1 + sqrt(5));
    const vec3 corner[12] = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                             {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    const size_t faces = (size_t)20 << 2 * levels;
    scene s = allocate(faces / 2 + 2, faces);
    s.count = 12;
    s.triangles = 20;
    for (int k = 0; k < 12; k++) s.position[k] = vec3_unit(corner[k]);
    memcpy(s.triangle, face, sizeof face);
    for (int level = 0; level < levels; level++) {
        const size_t old = s.triangles;
        for (size_t k = 0; k < old; k++) {
            uint32_t c[3], m[3];
            memcpy(c, s.triangle[k], sizeof c);
            for (int i = 0; i < 3; i++) m[i] = middle_of(&s, c[i], c[(i + 1) % 3]);
            memcpy(s.triangle[k], m, sizeof m);
            for (int i = 0; i < 3; i++) {
                const uint32_t part[3] = {c[i], m[i], m[(i + 2) % 3]};
                memcpy(s.triangle[s.triangles++], part, sizeof part);
            }
        }
    }
    memcpy(s.normal, s.position, s.count * sizeof *s.normal);
    return s;
}

static void weigh(scene *s, int workers)
{
    error e = {0};
    threads *pool = threads_new(workers, NULL, &e);
    const quadrature_input in = {s->count, s->position, s->normal, s->triangles,
                                 (const uint32_t(*)[3])s->triangle};
    if (!quadrature_make(&in, pool, s->weight, &s->lower_area, &s->end, &e)) fail_msg("%s", e.message);
    threads_free(pool);
}

static double one(vec3 x)
{
    return 1 + 0 * x.x;
}

static double exp_x(vec3 x)
{
    return exp(x.x);
}

static double z_squared(vec3 x)
{
    return x.z * x.z;
}

static double integrate(const scene *s, size_t begin, size_t end, double (*f)(vec3))
{
    double sum = 0;
    for (size_t k = begin; k < end; k++) sum += s->weight[k] * f(s->position[k]);
    return sum;
}

/* The integral over the torus by the trapezoidal rule, which converges exponentially for periodic functions. */
static double reference(double (*f)(vec3))
{
    enum { PARTS = 128 };
    double sum = 0;
    for (int i = 0; i < PARTS; i++)
        for (int j = 0; j < PARTS; j++) {
            const double u = 2 * M_PI * i / PARTS, v = 2 * M_PI * j / PARTS, radius = MAJOR + MINOR * cos(v);
            sum += radius * f(vec3_make(radius * cos(u), radius * sin(u), MINOR * sin(v)));
        }
    return sum * MINOR * 4 * M_PI * M_PI / (PARTS * PARTS);
}

/* Twice as many points in both directions reduce errors by at least 2^4. */
static void integrals_over_a_torus_converge_with_high_order(void **state)
{
    (void)state;
    double (*const of[])(vec3) = {one, exp_x, z_squared};
    double coarse[3];
    for (int fine = 0; fine < 2; fine++) {
        scene s = make_torus(fine ? 96 : 48, fine ? 36 : 18);
        weigh(&s, 2);
        assert_int_equal(s.end, QUADRATURE_COMPLETE);
        for (size_t k = 0; k < s.count; k++) assert_true(s.weight[k] > 0);
        for (int k = 0; k < 3; k++) {
            const double expected = reference(of[k]),
                         miss = fabs(integrate(&s, 0, s.count, of[k]) / expected - 1);
            print_message("# %zu points, function %d: %.2g\n", s.count, k, miss);
            assert_true(miss < (fine ? coarse[k] / 16 : 1e-3));
            coarse[k] = miss;
        }
        release(&s);
    }
}

/* The area by polynomials of degree 6 differs from that of degree 7 by about its error. */
static void the_lower_degree_estimates_the_error_of_the_area(void **state)
{
    (void)state;
    scene s = make_torus(80, 30);
    weigh(&s, 2);
    const double area = integrate(&s, 0, s.count, one), expected = reference(one);
    const double estimate = fabs(s.lower_area / area - 1), miss = fabs(area / expected - 1);
    print_message("# estimate %.2g, error %.2g\n", estimate, miss);
    assert_true(estimate > 0.1 * miss && estimate < 1e-4);
    release(&s);
}

/* Two spheres, one inside the other, closer than the spacing, with opposite normals: nodes of a triangle are found along
 * the surface. */
static void opposite_walls_do_not_share_nodes(void **state)
{
    (void)state;
    scene one_sphere = make_sphere(3), s = allocate(2 * one_sphere.count, 2 * one_sphere.triangles);
    const size_t n = one_sphere.count, t = one_sphere.triangles;
    const double inner = 0.98;
    for (size_t k = 0; k < n; k++) {
        s.position[k] = s.normal[k] = one_sphere.position[k];
        s.position[n + k] = vec3_scale(one_sphere.position[k], inner);
        s.normal[n + k] = vec3_scale(one_sphere.position[k], -1);
    }
    for (size_t k = 0; k < t; k++)
        for (int c = 0; c < 3; c++) {
            s.triangle[k][c] = one_sphere.triangle[k][c];
            s.triangle[t + k][c] = (uint32_t)n + one_sphere.triangle[k][2 - c];
        }
    weigh(&s, 2);
    assert_int_equal(s.end, QUADRATURE_COMPLETE);
    assert_close(integrate(&s, 0, n, one), 4 * M_PI, 1e-4);
    assert_close(integrate(&s, n, 2 * n, one), 4 * M_PI * inner * inner, 1e-4);
    assert_close(integrate(&s, 0, n, exp_x), 4 * M_PI * sinh(1), 1e-4);
    assert_close(integrate(&s, n, 2 * n, exp_x), 4 * M_PI * inner * sinh(inner), 1e-4);
    release(&one_sphere);
    release(&s);
}

/* A surface that is 1024 times as large has weights that are exactly 1024^2 times as large, with any number of
 * threads. */
static void weights_scale_exactly_and_do_not_depend_on_threads(void **state)
{
    (void)state;
    scene s = make_torus(48, 20), larger = make_torus(48, 20);
    for (size_t k = 0; k < larger.count; k++) larger.position[k] = vec3_scale(larger.position[k], 1024);
    weigh(&s, 1);
    weigh(&larger, 3);
    for (size_t k = 0; k < s.count; k++) assert_true(larger.weight[k] == 1048576 * s.weight[k]);
    assert_true(larger.lower_area == 1048576 * s.lower_area);
    release(&s);
    release(&larger);
}

static void surfaces_with_few_points_are_refused(void **state)
{
    (void)state;
    scene s = make_sphere(1);
    weigh(&s, 1);
    assert_int_equal(s.end, QUADRATURE_FEW_NODES);
    release(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(integrals_over_a_torus_converge_with_high_order),
        cmocka_unit_test(the_lower_degree_estimates_the_error_of_the_area),
        cmocka_unit_test(opposite_walls_do_not_share_nodes),
        cmocka_unit_test(weights_scale_exactly_and_do_not_depend_on_threads),
        cmocka_unit_test(surfaces_with_few_points_are_refused),
    };
    return cmocka_run_group_tests_name("quadrature", tests, NULL, NULL);
}
