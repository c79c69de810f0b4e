// SPDX-License-Identifier: Apache-2.0
/* Curvature at a scale: shapes of known curvature, with and without noise, and edges. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/bspline.h"
#include "surface/field/projection.h"
#include "shapes.h"
#include "sampling/sizing/scaled_curvature.h"

typedef struct probe {
    const field *f;
    surface *scan;
    scaled_curvature *c;
    threads *pool;
} probe;

static probe probe_begin(const field *f, double scale)
{
    error e = {0};
    probe p = {.f = f, .pool = threads_new(2, NULL, &e)};
    p.scan = surface_scan(f, p.pool, &e);
    cell_samples samples;
    assert_true(cell_samples_take(p.scan, p.pool, &samples, &e));
    p.c = scaled_curvature_new(p.scan, &samples, scale, p.pool, &e);
    cell_samples_free(&samples);
    if (!p.c) fail_msg("%s", e.message);
    return p;
}

static void probe_end(probe *p)
{
    scaled_curvature_free(p->c);
    surface_free(p->scan);
    threads_free(p->pool);
}

/* The curvature at the place of the surface that is nearest along the normal. */
static double look(const probe *p, vec3 x, double *kappa1, double *kappa2)
{
    vec3 normal = {0, 0, 1};
    const projection_limits limits = {20, 1e-9, 1e-9, 1e-6};
    assert_true(projection_find(p->f, &limits, &x, &normal));
    return scaled_curvature_at(p->c, x, normal, SCALED_CURVATURE_ALL, kappa1, kappa2);
}

static void sphere_has_one_over_r_at_any_scale(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    analytic *a = analytic_new(&shapes[0], NULL, NULL);
    for (double scale = 0.3; scale < 2; scale *= 2) {
        probe p = probe_begin(&a->base, scale);
        for (int k = 0; k < 50; k++) {
            vec3 n = vec3_unit(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}));
            double k1, k2, kappa = look(&p, vec3_axpy(3, n, shapes[0].center), &k1, &k2);
            assert_close(k1, 1.0 / 3, 0.01);
            assert_close(k2, 1.0 / 3, 0.01);
            assert_close(kappa, sqrt(2) / 3, 0.01);
        }
        probe_end(&p);
    }
    analytic_free(a);
}

static void torus_has_its_curvatures_with_their_signs(void **state)
{
    (void)state;
    analytic *a = analytic_new(&shapes[1], NULL, NULL);
    probe p = probe_begin(&a->base, 0.1);
    vec3 u, v;
    double k1, k2;
    vec3_frame(vec3_unit(shapes[1].axis), &u, &v);
    look(&p, vec3_axpy(1.4, u, shapes[1].center), &k1, &k2);
    assert_close(k1, 1 / 0.4, 0.1);
    assert_close(k2, 1 / 1.4, 0.05);
    look(&p, vec3_axpy(0.6, v, shapes[1].center), &k1, &k2);
    assert_close(k1, 1 / 0.4, 0.1);
    assert_close(k2, -1 / 0.6, 0.1);
    probe_end(&p);
    analytic_free(a);
}

/* An edge of any sharpness turns by a right angle. At a scale of 0.1 its curvature with a radius of 0.002 is
 * about that with a radius of 0.01. A distant face is flat. */
static void edges_bend_over_the_scale(void **state)
{
    (void)state;
    double at_edge[2];
    for (int k = 0; k < 2; k++) {
        const analytic_params box = {
            .shape = ANALYTIC_BOX, .half_size = {1, 1, 1}, .rounding = k == 0 ? 0.01 : 0.002};
        analytic *a = analytic_new(&box, NULL, NULL);
        probe p = probe_begin(&a->base, 0.1);
        double k1, k2, middle = look(&p, (vec3){1, 0.1, 0.2}, &k1, &k2);
        assert_true(middle < 1e-6);
        at_edge[k] = look(&p, (vec3){0.999, 0.999, 0.2}, &k1, &k2);
        assert_true(at_edge[k] > 3 && at_edge[k] < 20);
        probe_end(&p);
        analytic_free(a);
    }
    assert_close(at_edge[1] / at_edge[0], 1, 0.1);
}

/* A sphere of radius 0.35 in samples with errors of up to a tenth of their distance: the curvature of the
 * field itself is noise. */
static void noise_averages_out(void **state)
{
    (void)state;
    enum { N = 67 };
    error e = {0};
    rng r = rng_seed(test_seed(), 1);
    double *c = malloc(sizeof *c * N * N * N), step = 1.0 / (N - 3), radius = 0.35;
    for (int k = 0; k < N; k++)
        for (int j = 0; j < N; j++)
            for (int i = 0; i < N; i++) {
                vec3 x = {(i - 1) * step - 0.5, (j - 1) * step - 0.5, (k - 1) * step - 0.5};
                c[i + N * (j + N * k)] = vec3_norm(x) - radius + 0.1 * step * (2 * rng_uniform(&r) - 1);
            }
    const bspline_params params = {{N, N, N}, {{-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}}, c, ISA_PORTABLE};
    bspline *b = bspline_new(&params, NULL, &e);
    if (!b) fail_msg("%s", e.message);
    probe p = probe_begin(&b->base, 8 * step);
    double own = 0, scaled = 0;
    enum { LOOKS = 200 };
    for (int k = 0; k < LOOKS; k++) {
        vec3 n = vec3_unit(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1})),
             x = vec3_scale(n, radius);
        field_sample s;
        double k1, k2, f1, f2;
        double error_scaled = look(&p, x, &k1, &k2) * radius / sqrt(2) - 1;
        assert_true(field_sample_at(&b->base, x, FIELD_HESSIAN, &s));
        double error_own = field_curvature(&s, &f1, &f2) * radius / sqrt(2) - 1;
        own += error_own * error_own / LOOKS;
        scaled += error_scaled * error_scaled / LOOKS;
    }
    printf("# rms error of the curvature: %.3f at points, %.3f over eight cells\n", sqrt(own), sqrt(scaled));
    assert_true(sqrt(own) > 0.4 && sqrt(scaled) < 0.08);
    probe_end(&p);
    bspline_free(b);
    free(c);
}

/* Two opposite surfaces, a hundredth of the scale apart. */
static void the_other_side_of_a_plate_does_not_count(void **state)
{
    (void)state;
    const analytic_params plate = {.shape = ANALYTIC_BOX, .half_size = {1, 1, 0.02}, .rounding = 0.01};
    analytic *a = analytic_new(&plate, NULL, NULL);
    probe p = probe_begin(&a->base, 0.2);
    double k1, k2;
    assert_true(look(&p, (vec3){0.1, 0.2, 0.02}, &k1, &k2) < 1e-6);
    probe_end(&p);
    analytic_free(a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sphere_has_one_over_r_at_any_scale),
        cmocka_unit_test(torus_has_its_curvatures_with_their_signs),
        cmocka_unit_test(edges_bend_over_the_scale),
        cmocka_unit_test(noise_averages_out),
        cmocka_unit_test(the_other_side_of_a_plate_does_not_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
