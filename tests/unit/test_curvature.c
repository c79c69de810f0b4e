// SPDX-License-Identifier: Apache-2.0
/* Principal curvatures against shapes whose curvature is known, with their signs. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"

static void sphere_has_one_over_r(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    analytic *a = analytic_new(&shapes[0], NULL, NULL);
    for (int k = 0; k < 100; k++) {
        vec3 n = vec3_unit(random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}));
        field_sample s;
        double k1, k2;
        assert_true(field_sample_at(&a->base, vec3_axpy(3, n, shapes[0].center), FIELD_HESSIAN, &s));
        double kappa = field_curvature(&s, &k1, &k2);
        assert_close(k1, 1.0 / 3, 1e-12);
        assert_close(k2, 1.0 / 3, 1e-12);
        assert_close(kappa, sqrt(2) / 3, 1e-12);
    }
    analytic_free(a);
}

/* Outer equator: 1/m and 1/(R+m), both convex; inner: 1/m and -1/(R-m), a saddle. */
static void torus_has_a_convex_and_a_saddle_equator(void **state)
{
    (void)state;
    analytic *a = analytic_new(&shapes[1], NULL, NULL);
    vec3 u, v;
    vec3_frame(vec3_unit(shapes[1].axis), &u, &v);
    field_sample s;
    double k1, k2;
    assert_true(field_sample_at(&a->base, vec3_axpy(1.4, u, shapes[1].center), FIELD_HESSIAN, &s));
    field_curvature(&s, &k1, &k2);
    assert_close(k1, 1 / 0.4, 1e-9);
    assert_close(k2, 1 / 1.4, 1e-9);
    assert_true(field_sample_at(&a->base, vec3_axpy(0.6, v, shapes[1].center), FIELD_HESSIAN, &s));
    field_curvature(&s, &k1, &k2);
    assert_close(k1, 1 / 0.4, 1e-9);
    assert_close(k2, -1 / 0.6, 1e-9);
    analytic_free(a);
}

/* Curvature is a property of the surface: it does not change if F is scaled or composed. */
static void scale_of_f_does_not_matter(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (int k = 0; k < 100; k++) {
        field_sample s = {.gradient = random_between(&r, (vec3){-1, -1, -1}, (vec3){1, 1, 1}),
                          .hessian = {rng_uniform(&r), rng_uniform(&r), rng_uniform(&r), rng_uniform(&r),
                                      rng_uniform(&r), rng_uniform(&r)}};
        double k1, k2, s1, s2;
        field_curvature(&s, &k1, &k2);
        /* G = 3 F + F^2 at F = 0: grad 3 g, Hessian 3 H + 2 g g' */
        vec3 g = s.gradient;
        sym3 h = s.hessian;
        field_sample t = {.gradient = vec3_scale(g, 3),
                          .hessian = {3 * h.xx + 2 * g.x * g.x, 3 * h.yy + 2 * g.y * g.y,
                                      3 * h.zz + 2 * g.z * g.z, 3 * h.xy + 2 * g.x * g.y,
                                      3 * h.xz + 2 * g.x * g.z, 3 * h.yz + 2 * g.y * g.z}};
        field_curvature(&t, &s1, &s2);
        assert_true(k1 >= k2);
        assert_close(s1, k1, 1e-10 * (1 + fabs(k1)));
        assert_close(s2, k2, 1e-10 * (1 + fabs(k2)));
    }
}

static void zero_gradient_has_no_curvature(void **state)
{
    (void)state;
    field_sample s = {.hessian = {1, 2, 3, 4, 5, 6}};
    double k1 = 9, k2 = 9;
    assert_true(field_curvature(&s, &k1, &k2) == 0 && k1 == 0 && k2 == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sphere_has_one_over_r),
        cmocka_unit_test(torus_has_a_convex_and_a_saddle_equator),
        cmocka_unit_test(scale_of_f_does_not_matter),
        cmocka_unit_test(zero_gradient_has_no_curvature),
    };
    return cmocka_run_group_tests_name("curvature", tests, NULL, NULL);
}
