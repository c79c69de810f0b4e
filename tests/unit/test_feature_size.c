// SPDX-License-Identifier: Apache-2.0
/* Feature sizes of shapes of known medial axis, and an alternative measure: half the distance to the nearest
 * place of an opposite surface.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/combination.h"
#include "shapes.h"
#include "sampling/sizing/feature_size.h"

typedef struct measured {
    threads *pool;
    surface *scan;
    cell_samples sample;
    double *size;
} measured;

static measured measure(const field *f, int workers)
{
    error e = {0};
    measured m = {.pool = threads_new(workers, NULL, &e)};
    m.scan = surface_scan(f, m.pool, &e);
    if (!m.scan) fail_msg("%s", e.message);
    m.size = malloc(m.scan->cells * sizeof *m.size);
    assert_true(cell_samples_take(m.scan, m.pool, &m.sample, &e));
    assert_true(feature_size_measure(m.scan, &m.sample, m.pool, m.size, &e));
    return m;
}

static void release(measured *m)
{
    cell_samples_free(&m->sample);
    free(m->size);
    surface_free(m->scan);
    threads_free(m->pool);
}

/* The true size at a place with a normal; NAN: not tested there. */
typedef double truth(vec3 x, vec3 normal);

/* Half the distance to the nearest sample of an opposite surface. */
static double half_distance(const measured *m, size_t k)
{
    double nearest2 = INFINITY;
    for (size_t j = 0; j < m->scan->cells; j++)
        if (m->sample.found[j] && vec3_dot(m->sample.normal[j], m->sample.normal[k]) < -0.4)
            nearest2 = fmin(nearest2, vec3_norm2(vec3_sub(m->sample.position[j], m->sample.position[k])));
    return 0.5 * sqrt(nearest2);
}

/* The mean relative error of both measures, and of the chosen measure also the 999th of 1000 largest
 * errors. */
static void compare(const char *name, const field *f, truth *of, double mean_bound, double most_bound)
{
    measured m = measure(f, 2);
    double sum = 0, other = 0;
    size_t n = 0, tried = 0, far = 0;
    for (size_t k = 0; k < m.scan->cells; k++) {
        double want = m.sample.found[k] ? of(m.sample.position[k], m.sample.normal[k]) : NAN;
        if (isnan(want)) continue;
        n++;
        double wrong = fabs(m.size[k] / want - 1);
        sum += wrong;
        far += !(wrong <= most_bound);
        if (n % 997 != 0) continue;
        other += fabs(half_distance(&m, k) / want - 1);
        tried++;
    }
    print_message(
        "# %s: %zu places, wrong by %.4f on average, %.5f of them by more than %g; half the distance by %.4f\n",
        name, n, sum / (double)n, (double)far / (double)n, most_bound, other / (double)tried);
    assert_true(n > 500);
    assert_true(sum / (double)n < mean_bound);
    assert_true((double)far < 1e-3 * (double)n);
    release(&m);
}

static double ball_truth(vec3 x, vec3 normal)
{
    (void)x;
    (void)normal;
    return 3;
}

static double tube_truth(vec3 x, vec3 normal)
{
    (void)x;
    (void)normal;
    return 0.2;
}

/* R = 1, r = 0.7: the hole is narrower than the tube. */
static double hole_truth(vec3 x, vec3 normal)
{
    double rho = hypot(x.x, x.y), inward = -(normal.x * x.x + normal.y * x.y) / rho;
    double across = inward > 0 ? rho / inward : INFINITY; /* to the axis */
    double facing = 1 - 2 * inward * inward;
    if (facing > -0.6 && facing < -0.2) return NAN; /* near the threshold */
    return fmin(0.7, facing < -0.4 && inward > 0 ? across : INFINITY);
}

static double slab_truth(vec3 x, vec3 normal)
{
    (void)x;
    return fabs(normal.z) > 0.999 ? 0.2 : NAN;
}

/* A bar: half the distance to the opposite face everywhere, also close to edges. */
static double bar_truth(vec3 x, vec3 normal)
{
    (void)x;
    if (fabs(normal.x) > 0.999) return 1;
    return fmax(fabs(normal.y), fabs(normal.z)) > 0.999 ? 0.3 : NAN;
}

static void shapes_have_the_radius_of_their_medial_ball(void **state)
{
    (void)state;
    analytic *ball = analytic_new(&shapes[0], NULL, NULL);
    compare("sphere", &ball->base, ball_truth, 0.05, 0.08);
    analytic_free(ball);
    const analytic_params thin = {
        .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.2};
    analytic *tube = analytic_new(&thin, NULL, NULL);
    compare("tube", &tube->base, tube_truth, 0.03, 0.08);
    analytic_free(tube);
    const analytic_params fat = {
        .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.7};
    analytic *hole = analytic_new(&fat, NULL, NULL);
    compare("hole", &hole->base, hole_truth, 0.05, 0.2);
    analytic_free(hole);
}

static void edges_do_not_count_as_features(void **state)
{
    (void)state;
    const analytic_params plate = {.shape = ANALYTIC_BOX, .half_size = {1, 1, 0.2}};
    analytic *slab = analytic_new(&plate, NULL, NULL);
    compare("slab", &slab->base, slab_truth, 0.01, 0.03);
    analytic_free(slab);
    const analytic_params block = {.shape = ANALYTIC_BOX, .half_size = {1, 0.3, 0.3}};
    analytic *bar = analytic_new(&block, NULL, NULL);
    compare("bar", &bar->base, bar_truth, 0.01, 0.05);
    analytic_free(bar);
}

static double shell_truth(vec3 x, vec3 normal)
{
    (void)x;
    (void)normal;
    return 0.05;
}

/* A shell between two capsules. */
static void a_shell_is_half_as_wide_as_thick(void **state)
{
    (void)state;
    error e = {0};
    const analytic_params
        outside = {.shape = ANALYTIC_FRUSTUM, .axis = {0, 0, 1}, .core = {-1, 1, 0, 0}, .rounding = 0.3},
        inside = {.shape = ANALYTIC_FRUSTUM, .axis = {0, 0, 1}, .core = {-1, 1, 0, 0}, .rounding = 0.2};
    analytic *a = analytic_new(&outside, NULL, NULL), *b = analytic_new(&inside, NULL, NULL);
    const field *parts[] = {&a->base, &b->base};
    combination *c = combination_new(COMBINATION_DIFFERENCE, parts, 2, 12, 0, 0, SIZE_MAX, NULL, &e);
    if (!c) fail_msg("%s", e.message);
    compare("shell", combination_field(c), shell_truth, 0.01, 0.03);
    combination_free(c);
    analytic_free(a);
    analytic_free(b);
}

/* Two unit balls, 0.1 apart along x. The ball between them that touches one under the angle a from the axis
 * has its centre in the plane between: (1.05 - cos a) / cos a. */
static double pair_truth(vec3 x, vec3 normal)
{
    double cosine = x.x < 0 ? normal.x : -normal.x;
    if (cosine > 0.6 && cosine < 0.85)
        return NAN; /* near the angle of 33 degrees, up to which they face each other */
    return cosine > 0.6 ? (1.05 - cosine) / cosine : 1;
}

static void a_gap_between_balls_counts_from_either_side(void **state)
{
    (void)state;
    error e = {0};
    const analytic_params left = {.shape = ANALYTIC_SPHERE, .center = {-1.05, 0, 0}, .radius = 1},
                          right = {.shape = ANALYTIC_SPHERE, .center = {1.05, 0, 0}, .radius = 1};
    analytic *a = analytic_new(&left, NULL, NULL), *b = analytic_new(&right, NULL, NULL);
    const field *parts[] = {&a->base, &b->base};
    combination *c = combination_new(COMBINATION_UNION, parts, 2, 12, 0, 0, SIZE_MAX, NULL, &e);
    if (!c) fail_msg("%s", e.message);
    compare("two balls", combination_field(c), pair_truth, 0.07, 0.2);
    combination_free(c);
    analytic_free(a);
    analytic_free(b);
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    analytic *a = analytic_new(&shapes[1], NULL, NULL);
    measured one = measure(&a->base, 1), three = measure(&a->base, 3);
    assert_memory_equal(one.size, three.size, one.scan->cells * sizeof *one.size);
    release(&one);
    release(&three);
    analytic_free(a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shapes_have_the_radius_of_their_medial_ball),
        cmocka_unit_test(edges_do_not_count_as_features),
        cmocka_unit_test(a_shell_is_half_as_wide_as_thick),
        cmocka_unit_test(a_gap_between_balls_counts_from_either_side),
        cmocka_unit_test(result_does_not_depend_on_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
