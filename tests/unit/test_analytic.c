/* Formulas: derivatives against finite differences, signs, cells. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"

static analytic *make(int k)
{
    error e = {0};
    analytic *a = analytic_new(&shapes[k], NULL, &e);
    if (!a) fail_msg("%s: %s", shape_names[k], e.message);
    return a;
}

static void sample(const analytic *a, vec3 x, field_sample *s)
{
    assert_true(field_sample_at(&a->base, x, FIELD_HESSIAN, s));
}

/* Points near the surface, but for the box' edges between its parts, where derivatives jump. */
static bool near_surface(const analytic *a, vec3 x, field_sample *s)
{
    if (!field_sample_at(&a->base, x, FIELD_HESSIAN, s)) return false;
    return fabs(s->value) < 0.2 * vec3_norm(s->gradient) * a->base.extent;
}

static void gradient_matches_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < SHAPE_COUNT; k++) {
        analytic *a = make(k);
        double step = 1e-6 * a->base.extent;
        for (int tries = 0, done = 0; done < 200 && tries < 100000; tries++) {
            vec3 x = random_between(&r, a->base.domain.min, a->base.domain.max);
            field_sample s, up, down;
            if (!near_surface(a, x, &s)) continue;
            done++;
            for (int axis = 0; axis < 3; axis++) {
                vec3 e = {axis == 0, axis == 1, axis == 2};
                sample(a, vec3_axpy(step, e, x), &up);
                sample(a, vec3_axpy(-step, e, x), &down);
                double difference = (up.value - down.value) / (2 * step);
                assert_close(vec3_get(s.gradient, axis), difference, 1e-5 * (vec3_norm(s.gradient) + 1e-3));
            }
        }
        analytic_free(a);
    }
}

static void hessian_matches_differences(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (int k = 0; k < SHAPE_COUNT; k++) {
        analytic *a = make(k);
        double step = 1e-6 * a->base.extent;
        int outliers = 0, done = 0;
        for (int tries = 0; done < 200 && tries < 100000; tries++) {
            vec3 x = random_between(&r, a->base.domain.min, a->base.domain.max), worst = {0, 0, 0};
            field_sample s, up, down;
            if (!near_surface(a, x, &s)) continue;
            done++;
            for (int axis = 0; axis < 3; axis++) {
                vec3 e = {axis == 0, axis == 1, axis == 2};
                sample(a, vec3_axpy(step, e, x), &up);
                sample(a, vec3_axpy(-step, e, x), &down);
                vec3 difference = vec3_scale(vec3_sub(up.gradient, down.gradient), 1 / (2 * step));
                vec3 off = vec3_sub(difference, sym3_apply(s.hessian, e));
                vec3_set(&worst, axis, vec3_norm(off));
            }
            double scale = vec3_norm(s.gradient) / a->base.extent + vec3_norm(s.gradient) * 10;
            if (vec3_norm(worst) > 1e-4 * scale) outliers++;
        }
        /* the box' parts meet in planes that a difference may straddle */
        assert_true(outliers <= (shapes[k].shape == ANALYTIC_BOX ? 2 : 0));
        assert_int_equal(done, 200);
        analytic_free(a);
    }
}

static void inside_is_negative(void **state)
{
    (void)state;
    const vec3 inside[SHAPE_COUNT] = {{1, 2, 5},   {0, 0, 0},       {0.1, 0.2, 0.45},
                                      {0.9, 0, 0}, {0.6, 0.5, 0.5}, {0.5, 0.5, 0.5}};
    for (int k = 0; k < SHAPE_COUNT; k++) {
        analytic *a = make(k);
        vec3 x = inside[k];
        if (shapes[k].shape == ANALYTIC_TORUS) {
            vec3 u, v;
            vec3_frame(vec3_unit(shapes[k].axis), &u, &v);
            x = vec3_axpy(1.1, u, shapes[k].center);
        }
        if (shapes[k].shape == ANALYTIC_GYROID) x = (vec3){0.5, 0.5, 0.25}; /* sin Z = -1 */
        field_sample s;
        sample(a, x, &s);
        assert_true(s.value < 0);
        analytic_free(a);
    }
}

static void cells_have_corners_of_both_signs(void **state)
{
    (void)state;
    for (int k = 0; k < SHAPE_COUNT; k++) {
        analytic *a = make(k);
        size_t count = a->base.ops->cell_count(&a->base);
        assert_true(count > 1000);
        for (size_t c = 0; c < count; c++) {
            field_cell cell;
            int inside = 0;
            a->base.ops->cell(&a->base, c, &cell);
            for (int v = 0; v < 8; v++) inside += cell.value[v] < 0;
            assert_in_range(inside, 1, 7);
        }
        analytic_free(a);
    }
}

/* Sixteen side by side are the same as one by one, to the last bit; a lane that is not wanted stays out. */
static void lanes_are_samples(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    for (int k = 0; k < SHAPE_COUNT; k++) {
        analytic *a = make(k);
        vec3_lanes x, gradient;
        bool defined[VEC3_LANES];
        double value[VEC3_LANES];
        for (int l = 0; l < VEC3_LANES; l++) {
            vec3 p = l ? random_between(&r, a->base.domain.min, a->base.domain.max) : shapes[k].center;
            x.x[l] = p.x;
            x.y[l] = p.y;
            x.z[l] = p.z;
            defined[l] = l != 3;
        }
        field_sample_lanes(&a->base, &x, defined, value, &gradient);
        for (int l = 0; l < VEC3_LANES; l++) {
            field_sample s;
            bool there = field_sample_at(&a->base, (vec3){x.x[l], x.y[l], x.z[l]}, FIELD_GRADIENT, &s);
            assert_int_equal(defined[l], there && l != 3);
            if (!defined[l]) continue;
            assert_true(value[l] == s.value);
            assert_true(gradient.x[l] == s.gradient.x && gradient.y[l] == s.gradient.y &&
                        gradient.z[l] == s.gradient.z);
        }
        analytic_free(a);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradient_matches_differences),
        cmocka_unit_test(hessian_matches_differences),
        cmocka_unit_test(inside_is_negative),
        cmocka_unit_test(lanes_are_samples),
        cmocka_unit_test(cells_have_corners_of_both_signs),
    };
    return cmocka_run_group_tests_name("analytic", tests, NULL, NULL);
}
