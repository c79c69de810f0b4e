// SPDX-License-Identifier: Apache-2.0
/* Projection: onto the surface to rounding, along boundaries, and failures. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/projection.h"
#include "shapes.h"

static const projection_limits exact = {30, 1e-12, 1e-8, 1e-9};

static void ends_on_the_surface(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < SHAPE_COUNT; k++) {
        analytic *a = analytic_new(&shapes[k], NULL, NULL);
        for (int done = 0, tries = 0; done < 100 && tries < 100000; tries++) {
            vec3 x = random_between(&r, a->base.domain.min, a->base.domain.max), n;
            field_sample s;
            if (!field_sample_at(&a->base, x, FIELD_GRADIENT, &s) ||
                fabs(s.value) > 0.02 * a->base.extent * vec3_norm(s.gradient) ||
                /* the centre of the quartic is a zero without a gradient: it is not on a surface, and
                 * Newton's method converges slowly */
                (shapes[k].shape == ANALYTIC_QUARTIC && vec3_norm(vec3_sub(x, shapes[k].center)) < 0.2))
                continue;
            done++;
            assert_true(projection_find(&a->base, &exact, &x, &n));
            assert_true(field_sample_at(&a->base, x, FIELD_GRADIENT, &s));
            assert_true(fabs(s.value) <= 1e-9 * vec3_norm(s.gradient));
            assert_close(vec3_norm(n), 1, 1e-12);
            assert_true(!a->base.open || bbox_contains(a->base.domain, x));
        }
        analytic_free(a);
    }
}

/* On an open surface, a point beyond a face is projected to the boundary: onto the face and the surface. */
static void slides_along_the_rim(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    analytic *a = analytic_new(&shapes[5], NULL, NULL);
    int on_boundary = 0;
    for (int k = 0; k < 200; k++) {
        vec3 x = random_between(&r, (vec3){1.001, 0.1, 0.1}, (vec3){1.02, 0.9, 0.9}), n;
        if (!projection_find(&a->base, &exact, &x, &n)) continue;
        field_sample s;
        assert_true(bbox_contains(a->base.domain, x));
        assert_true(field_sample_at(&a->base, x, FIELD_GRADIENT, &s));
        assert_true(fabs(s.value) <= 1e-9 * vec3_norm(s.gradient));
        on_boundary += x.x == 1;
    }
    assert_true(on_boundary > 20);
    analytic_free(a);
}

static void refuses_what_it_cannot_reach(void **state)
{
    (void)state;
    analytic *sphere = analytic_new(&shapes[0], NULL, NULL), *quartic = analytic_new(&shapes[4], NULL, NULL);
    vec3 centre = shapes[0].center, n = {7, 7, 7};
    assert_false(projection_find(&sphere->base, &exact, &centre, &n)); /* no gradient */
    assert_true(n.x == 7 && centre.x == 1);
    vec3 near_centre = {0.501, 0.5, 0.5};
    const projection_limits short_walk = {2, 1e-9, 0, 1e-6};
    assert_false(projection_find(&quartic->base, &short_walk, &near_centre, &n));
    assert_true(near_centre.x == 0.501);
    analytic_free(sphere);
    analytic_free(quartic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ends_on_the_surface),
        cmocka_unit_test(slides_along_the_rim),
        cmocka_unit_test(refuses_what_it_cannot_reach),
    };
    return cmocka_run_group_tests_name("project", tests, NULL, NULL);
}
