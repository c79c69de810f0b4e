// SPDX-License-Identifier: Apache-2.0
/* Requested spacings against closed forms: distribution, sum, bounds and growth. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/patches.h"
#include "shapes.h"
#include "sampling/sizing/sizing_field.h"

static const analytic_params torus = {
    .shape = ANALYTIC_TORUS, .axis = {0, 0, 1}, .major_radius = 1, .minor_radius = 0.4};

typedef struct scanned {
    analytic *a;
    threads *pool;
    surface *scan;
} scanned;

static scanned scan_shape(const analytic_params *shape, int workers)
{
    error e = {0};
    scanned s = {analytic_new(shape, NULL, &e), threads_new(workers, NULL, &e), NULL};
    s.scan = surface_scan(&s.a->base, s.pool, &e);
    assert_non_null(s.scan);
    return s;
}

static void release(scanned *s)
{
    surface_free(s->scan);
    threads_free(s->pool);
    analytic_free(s->a);
}

static sizing_field *grade(const scanned *s, sizing_field_params params, size_t count)
{
    error e = {0};
    if (!(params.gradation > 0)) params.gradation = INFINITY;
    sizing_field *g = sizing_field_new(&s->a->base, s->scan, &params, count, s->pool, &e);
    if (!g) fail_msg("%s", e.message);
    return g;
}

static vec3 torus_point(double u, double v)
{
    double rho = torus.major_radius + torus.minor_radius * cos(v);
    return (vec3){rho * cos(u), rho * sin(u), torus.minor_radius * sin(v)};
}

static double torus_kappa(double v)
{
    double k1 = 1 / torus.minor_radius, k2 = cos(v) / (torus.major_radius + torus.minor_radius * cos(v));
    return sqrt(k1 * k1 + k2 * k2);
}

/* The number of points of the field, by quadrature over the parameters of the torus. */
static double torus_points(const sizing_field *g)
{
    const int steps = 400;
    double sum = 0;
    for (int i = 0; i < steps; i++)
        for (int j = 0; j < steps; j++) {
            double u = 2 * M_PI * (i + 0.5) / steps, v = 2 * M_PI * (j + 0.5) / steps;
            double h = sizing_field_spacing(g, torus_point(u, v), NULL);
            sum += torus.minor_radius * (torus.major_radius + torus.minor_radius * cos(v)) /
                   (sqrt(3) / 2 * h * h);
        }
    return sum * 4 * M_PI * M_PI / ((double)steps * steps);
}

/* The spacing is proportional to kappa^-p within the ratio. The fine end is a quantile of the curvature. */
static void ratio_follows_the_curvature(void **state)
{
    (void)state;
    scanned s = scan_shape(&torus, 2);
    for (double exponent = 1; exponent < 20; exponent += 11.6) {
        sizing_field *g = grade(
            &s, (sizing_field_params){.kind = SIZING_FIELD_RATIO, .ratio = 10, .exponent = exponent}, 10000);
        assert_close(torus_points(g) / 10000, 1, 4e-3);
        double least = 1e300, most = 0;
        for (int j = 0; j < 64; j++) {
            double v = 2 * M_PI * j / 64, kappa = torus_kappa(v);
            double constant = sizing_field_spacing(g, torus_point(1 + j, v), NULL) * pow(kappa, exponent);
            if (kappa > 0.99 * torus_kappa(M_PI)) continue; /* near the quantile */
            least = fmin(least, constant);
            most = fmax(most, constant);
        }
        print_message("# exponent %.1f: constant within a factor of %.4f\n", exponent, most / least);
        /* where the curvature varies within the spacing, the request is averaged: */
        assert_true(most / least < (exponent > 1 ? 1.7 : 1.01));
        sizing_field_facts facts = sizing_field_describe(g);
        double whole = pow(torus_kappa(M_PI) / torus_kappa(M_PI / 2), exponent);
        assert_close(facts.largest / facts.least, fmin(whole, 10),
                     (exponent > 1 ? 0.2 : 0.06) * fmin(whole, 10));
        sizing_field_free(g);
    }
    release(&s);
}

/* The equator and the pole of an ellipsoid, by their principal curvatures. */
static void chord_error_gives_the_spacing_of_the_larger_curvature(void **state)
{
    (void)state;
    const analytic_params shape = {.shape = ANALYTIC_ELLIPSOID, .radii = {1, 0.7, 0.4}};
    scanned s = scan_shape(&shape, 1);
    sizing_field *g = grade(&s, (sizing_field_params){.kind = SIZING_FIELD_CHORD, .chord_error = 1e-3}, 5000);
    double at_x = sizing_field_spacing(g, (vec3){1, 0, 0}, NULL),
           at_z = sizing_field_spacing(g, (vec3){0, 0, 0.4}, NULL);
    /* at the end of axis a the curvatures are a / b^2 and a / c^2 */
    assert_close(at_z / at_x, sqrt((1 / 0.16) / (0.4 / 0.49)), 0.03 * at_z / at_x);
    double scale = sizing_field_describe(g).scale;
    assert_close(at_x, scale * sqrt(8 * 1e-3 * 0.16), 0.03 * at_x);
    sizing_field_free(g);
    release(&s);
}

/* grad h| <= gradation; blending adds up to half of it where the request jumps within a cell. */
static double jump(const void *context, vec3 x)
{
    (void)context;
    return x.x > 0 ? 0.01 : 1;
}

static void growth_is_limited(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    scanned s = scan_shape(&torus, 2);
    for (double gradation = 0.1; gradation < 1; gradation *= 2) {
        sizing_field *g = grade(
            &s, (sizing_field_params){.kind = SIZING_FIELD_SPACING, .map = jump, .gradation = gradation},
            4000);
        assert_close(torus_points(g) / 4000, 1, 1e-2);
        double steepest = 0, slope = 0;
        for (int k = 0; k < 20000; k++) {
            double u = 2 * M_PI * rng_uniform(&r), v = 2 * M_PI * rng_uniform(&r);
            vec3 gradient, x = torus_point(u, v), y = torus_point(u + 0.03 * rng_uniform(&r), v + 0.05);
            double h = sizing_field_spacing(g, x, &gradient);
            steepest = fmax(steepest, fabs(sizing_field_spacing(g, y, NULL) - h) / vec3_norm(vec3_sub(y, x)));
            slope = fmax(slope, vec3_norm(gradient));
        }
        print_message("# gradation %.1f: steepest %.3f, gradient %.3f\n", gradation, steepest, slope);
        assert_true(slope < (1 + 1e-12) * gradation && slope > 0.9 * gradation);
        assert_true(steepest < 1.5 * gradation && steepest > 0.8 * gradation);
        sizing_field_free(g);
    }
    release(&s);
}

static void bounds_are_kept_and_reported(void **state)
{
    (void)state;
    scanned s = scan_shape(&torus, 1);
    sizing_field_params params = {
        .kind = SIZING_FIELD_RATIO, .ratio = 10, .exponent = 12.6, .gradation = INFINITY};
    params.min_spacing = 0.03;
    params.max_spacing = 0.08;
    sizing_field *g = grade(&s, params, 10000);
    assert_close(torus_points(g) / 10000, 1, 5e-3);
    for (int j = 0; j < 64; j++) {
        double h = sizing_field_spacing(g, torus_point(j, 0.1 * j), NULL);
        assert_true(h > 0.03 * (1 - 1e-3) && h < 0.08 * (1 + 1e-3));
    }
    sizing_field_free(g);
    error e = {0};
    double most = s.scan->area / (sqrt(3) / 2 * 9e-4), least = s.scan->area / (sqrt(3) / 2 * 64e-4);
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, (size_t)most + 500, s.pool, &e));
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    char words[64];
    snprintf(words, sizeof words, "min_spacing 0.03 allows at most %.0f: ", most);
    assert_non_null(strstr(e.message, words));
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, (size_t)least - 500, s.pool, &e));
    snprintf(words, sizeof words, "max_spacing 0.08 requires at least %.0f: ", least);
    assert_non_null(strstr(e.message, words));
    params.min_spacing = params.max_spacing = 0.05; /* a single count is possible, to half a point */
    sizing_field_free(grade(&s, params, (size_t)round(s.scan->area / (sqrt(3) / 2 * 25e-4))));
    /* without bounds: small deviations of the count are not an error */
    params.min_spacing = params.max_spacing = 0;
    for (size_t count = 4; count < 20; count += 5) {
        g = grade(&s, params, count);
        assert_close(torus_points(g) / (double)count, 1, 0.02);
        sizing_field_free(g);
    }
    params.memory_limit = 1000;
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, 1000, s.pool, &e));
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    release(&s);
}

static double unpainted_above(const void *context, vec3 x)
{
    return x.z > 0 ? NAN : *(const double *)context;
}

/* A map that is undefined in a part leaves it to the growth limit. A map that is undefined everywhere is
 * refused. */
static void maps_with_holes(void **state)
{
    (void)state;
    scanned s = scan_shape(&torus, 1);
    double value = 0.05;
    sizing_field_params params = {
        .kind = SIZING_FIELD_SPACING, .map = unpainted_above, .map_context = &value, .gradation = 0.2};
    sizing_field *g = grade(&s, params, 3000);
    double below = sizing_field_spacing(g, torus_point(0, -M_PI / 2), NULL);
    double above = sizing_field_spacing(g, torus_point(0, M_PI / 2), NULL);
    assert_close(above, below + 0.2 * M_PI / 2 * 0.4, 0.15 * above);
    sizing_field_free(g);
    error e = {0};
    value = NAN;
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, 3000, s.pool, &e));
    assert_int_equal(e.code, ERROR_INPUT_UNSUPPORTED);
    value = 0;
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, 3000, s.pool, &e));
    assert_non_null(strstr(e.message, "above 0"));
    params.kind = SIZING_FIELD_DENSITY; /* a density of 0 requests no points */
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, 3000, s.pool, &e));
    assert_non_null(strstr(e.message, "no points anywhere"));
    release(&s);
}

/* If the pool is stopped, the work ends with the pool's code. */
static void a_stop_ends_the_work(void **state)
{
    (void)state;
    scanned s = scan_shape(&torus, 1);
    volatile sig_atomic_t stop = 0;
    error e = {0};
    threads *pool = threads_new(1, &stop, &e);
    const sizing_field_params params = {
        .kind = SIZING_FIELD_RATIO, .ratio = 10, .exponent = 1, .gradation = 0.2};
    stop = 1;
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, 1000, pool, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    threads_free(pool);
    release(&s);
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    scanned one = scan_shape(&torus, 1), many = scan_shape(&torus, 3);
    const sizing_field_params params = {
        .kind = SIZING_FIELD_RATIO, .ratio = 10, .exponent = 5, .gradation = 0.2};
    sizing_field *a = grade(&one, params, 1000), *b = grade(&many, params, 1000);
    for (int j = 0; j < 64; j++)
        assert_true(sizing_field_spacing(a, torus_point(j, 0.1 * j), NULL) ==
                    sizing_field_spacing(b, torus_point(j, 0.1 * j), NULL));
    sizing_field_free(a);
    sizing_field_free(b);
    release(&one);
    release(&many);
}

/* A shape that is thin at one end: a ratio of the feature size bounds the spacing. The resulting number of
 * points is a possible count, and a copy for another count has that count. */
static void features_bound_the_spacing(void **state)
{
    (void)state;
    error e = {0};
    scanned s = scan_shape(&torus, 2);
    sizing_field_params params = {.kind = SIZING_FIELD_EVEN,
                                  .feature_ratio = 0.5,
                                  .feature_floor = 1e-3,
                                  .max_spacing = 0.25,
                                  .gradation = 0.2};
    sizing_field *g = sizing_field_new(&s.a->base, s.scan, &params, 0, s.pool, &e);
    if (!g) fail_msg("%s", e.message);
    sizing_field_facts facts = sizing_field_describe(g);
    /* the tube's radius of 0.4 is the feature size everywhere */
    assert_close(facts.features.median, 0.4, 0.04);
    assert_close(facts.points, torus_points(g), 5e-3 * facts.points);
    assert_true(facts.largest <= 0.5 * 0.4 * 1.001 && facts.least > 0.5 * 0.4 * 0.85);
    sizing_field *half = sizing_field_rescale(g, s.scan->cells, (size_t)(facts.points / 2), &e);
    assert_close(torus_points(half), facts.points / 2, 5e-3 * facts.points);
    size_t enough = (size_t)(1.02 * facts.points);
    sizing_field_free(grade(&s, params, enough));
    assert_null(sizing_field_new(&s.a->base, s.scan, &params, enough / 2, s.pool, &e));
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    const char *advice = strstr(e.message, "set it to at least ");
    assert_non_null(advice);
    sizing_field_free(grade(&s, params, strtoul(advice + strlen("set it to at least "), NULL, 10)));
    sizing_field_free(half);
    sizing_field_free(g);
    release(&s);
}

/* The tip of a cone is small: with the usual share of the area at the fine end, the growth limit leaves 5.9
 * of a ratio of 10. */
static void a_finer_end_compensates_the_growth_limit(void **state)
{
    (void)state;
    const analytic_params cone = {
        .shape = ANALYTIC_FRUSTUM, .axis = {0, 0, 1}, .core = {-1, 1, 0, 0.4}, .rounding = 0.04};
    const sizing_field_params params = {
        .kind = SIZING_FIELD_RATIO, .ratio = 10, .exponent = 1, .scale_spacings = 4, .gradation = 0.2};
    scanned s = scan_shape(&cone, 2);
    sizing_field *g = grade(&s, params, 3000);
    const sizing_field_facts facts = sizing_field_describe(g);
    assert_close(facts.points, 3000, 1);
    assert_true(facts.largest > 8 * facts.least && facts.largest < 10.01 * facts.least);
    sizing_field_free(g);
    release(&s);
}

/* The ends of a flat ellipsoid: a finer end would reduce the ratio, so the usual one is kept. */
static void a_finer_end_without_effect_is_discarded(void **state)
{
    (void)state;
    const analytic_params shape = {.shape = ANALYTIC_ELLIPSOID, .radii = {1, 1, 0.2}};
    const sizing_field_params params = {
        .kind = SIZING_FIELD_RATIO, .ratio = 6, .exponent = 1, .scale_spacings = 8, .gradation = 0.2};
    scanned s = scan_shape(&shape, 2);
    sizing_field *g = grade(&s, params, 2000);
    const sizing_field_facts facts = sizing_field_describe(g);
    assert_true(facts.largest > 4.2 * facts.least);
    sizing_field_free(g);
    release(&s);
}

/* A curve around the outside of the tube and one across it: the share there, growth with the distance, and
 * the count. */
static void curves_are_finer_than_the_surface(void **state)
{
    (void)state;
    enum { SIDES = 256 };
    static vec3 vertex[2 * SIDES];
    uint32_t ends[2] = {0, 0};
    field_curve curve[2];
    for (int c = 0; c < 2; c++) {
        for (int k = 0; k < SIDES; k++)
            vertex[c * SIDES + k] =
                torus_point(c == 0 ? 2 * M_PI * k / SIDES : 0, c == 1 ? 2 * M_PI * k / SIDES : 0);
        curve[c] = (field_curve){
            .first = (size_t)c * SIDES, .count = SIDES, .closed = true, .patch_first = c, .patch_count = 1};
    }
    const field_patches patches = {
        .count = 1, .curve_count = 2, .curve = curve, .vertex = vertex, .curve_patch = ends};
    error e = {0};
    const double even = 0.0966; /* of 2 500 points */
    curve_distance *curves = curve_distance_new(&patches, true, 0.05 * even, NULL, &e);
    scanned s = scan_shape(&torus, 2);
    sizing_field_params params = {
        .kind = SIZING_FIELD_EVEN, .curves = curves, .curve_share = 0.5, .gradation = 0.2};
    sizing_field *g = grade(&s, params, 2500);
    const double far = sizing_field_describe(g).largest;
    assert_close(torus_points(g) / 2500, 1, 0.01);
    assert_close(sizing_field_describe(g).least, 0.5 * far, 1e-6);
    assert_close(sizing_field_spacing(g, torus_point(M_PI, M_PI), NULL), far, 1e-6);
    for (int k = 0; k < 64; k++) { /* across the outer curve, far from the other one */
        double v = 0.8 * k / 64, away = 2 * torus.minor_radius * sin(v / 2);
        vec3 slope;
        double h = sizing_field_spacing(g, torus_point(M_PI, v), &slope);
        assert_close(h, fmin(0.5 * far + 0.2 * away, far), 0.01 * far);
        assert_true(vec3_norm(slope) <= 0.2 * (1 + 1e-9));
    }
    sizing_field *half = sizing_field_rescale(g, s.scan->cells, 1250, &e);
    assert_close(torus_points(half) / 1250, 1, 0.01);
    sizing_field_free(half);
    sizing_field_free(g);
    params.min_spacing = 0.8 * far; /* a lower bound for the curves */
    g = grade(&s, params, 2500);
    assert_close(sizing_field_describe(g).least, 0.8 * far, 1e-6);
    sizing_field_free(g);
    release(&s);
    curve_distance_free(curves);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ratio_follows_the_curvature),
        cmocka_unit_test(a_finer_end_compensates_the_growth_limit),
        cmocka_unit_test(a_finer_end_without_effect_is_discarded),
        cmocka_unit_test(chord_error_gives_the_spacing_of_the_larger_curvature),
        cmocka_unit_test(growth_is_limited),
        cmocka_unit_test(bounds_are_kept_and_reported),
        cmocka_unit_test(maps_with_holes),
        cmocka_unit_test(a_stop_ends_the_work),
        cmocka_unit_test(features_bound_the_spacing),
        cmocka_unit_test(curves_are_finer_than_the_surface),
        cmocka_unit_test(result_does_not_depend_on_threads),
    };
    return cmocka_run_group_tests_name("grading", tests, NULL, NULL);
}
