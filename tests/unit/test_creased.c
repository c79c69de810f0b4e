// SPDX-License-Identifier: Apache-2.0
/* Solids with sharp edges as patches: areas, creases, corners and positions against closed forms. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "surface/field/combination.h"
#include "surface/field/creased.h"

static const double HERE[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
static const analytic_params cube = {.shape = ANALYTIC_BOX, .center = {0.1, 0, 0}, .half_size = {1, 1, 1}};
static const analytic_params can = {.shape = ANALYTIC_FRUSTUM, .axis = {0, 0, 1}, .core = {-1.5, 1.5, 1, 1}};

static double length_of(const field_patches *p, const field_curve *c)
{
    double sum = 0;
    for (size_t k = 1; k < c->count + c->closed; k++)
        sum += vec3_norm(vec3_sub(p->vertex[c->first + k % c->count], p->vertex[c->first + k - 1]));
    return sum;
}

static double worst_gap(const field_patches *p)
{
    double worst = 0;
    for (size_t n = 0; n < p->curve_count; n++)
        for (size_t k = 0; k < p->curve[n].count; k++)
            for (int on = 0; on < 2; on++) {
                field_sample s;
                const vec3 x = p->vertex[p->curve[n].first + k];
                assert_true(field_sample_at(p->curve[n].on[on], x, FIELD_GRADIENT, &s));
                worst = fmax(worst, fabs(s.value) / vec3_norm(s.gradient));
            }
    return worst;
}

typedef struct expected {
    size_t patches, curves, corners;
    double area, length;
    double tolerance;
} expected;

static size_t count_corners(const field_patches *p)
{
    size_t count = 0;
    for (size_t n = 0; n < 2 * p->curve_count; n++) { /* the first curve of each corner counts it */
        const field_curve *c = &p->curve[n / 2];
        const vec3 *at = &p->vertex[n % 2 ? c->first + c->count - 1 : c->first];
        bool seen = c->closed;
        for (size_t m = 0; m < n && !seen; m++) {
            const field_curve *d = &p->curve[m / 2];
            const vec3 *other = &p->vertex[m % 2 ? d->first + d->count - 1 : d->first];
            seen = !d->closed && memcmp(at, other, sizeof *at) == 0;
        }
        count += !seen;
    }
    return count;
}

/* Checks a solid, and frees it. */
static void check(const char *name, solid *s, const field *whole, bbox box, expected wanted)
{
    error e = {0};
    creased *c = creased_new(s, whole, box, &e);
    if (!c) fail_msg("%s: %s", name, e.message);
    const field_patches *p = creased_field(c)->patches;
    double area = 0, length = 0;
    for (size_t k = 0; k < p->count; k++) area += p->patch[k].area;
    for (size_t k = 0; k < p->curve_count; k++) length += length_of(p, &p->curve[k]);
    print_message("# %s: %zu patches, %zu curves, %zu corners, area off %.1e, length off %.1e, gap %.1e\n",
                  name, p->count, p->curve_count, count_corners(p), area / wanted.area - 1,
                  length / wanted.length - 1, worst_gap(p));
    assert_int_equal(p->count, wanted.patches);
    assert_int_equal(p->curve_count, wanted.curves);
    assert_int_equal(count_corners(p), wanted.corners);
    assert_close(area, wanted.area, wanted.tolerance * wanted.area);
    assert_close(length, wanted.length, wanted.tolerance * wanted.length);
    assert_true(worst_gap(p) < 1e-9);
    creased_free(c);
}

static analytic *make(const analytic_params *p)
{
    error e = {0};
    analytic *a = analytic_new(p, NULL, &e);
    if (!a) fail_msg("%s", e.message);
    return a;
}

static const bbox everywhere = {{-1e3, -1e3, -1e3}, {1e3, 1e3, 1e3}};

static void a_cube_and_a_cylinder(void **state)
{
    (void)state;
    analytic *a = make(&cube), *b = make(&can);
    solid *s = solid_new(2);
    solid_push_shape(s, &s->inside, &cube, HERE, false);
    check("cube", s, &a->base, everywhere, (expected){6, 12, 8, 24, 24, 1e-9});
    s = solid_new(3);
    solid_push_shape(s, &s->inside, &can, HERE, false);
    check("cylinder", s, &b->base, everywhere, (expected){3, 2, 0, 8 * M_PI, 4 * M_PI, 1e-3});
    analytic_free(a);
    analytic_free(b);
}

/* Crossing bars: each has lost its middle, and coplanar faces are one patch. */
static void combinations(void **state)
{
    (void)state;
    const analytic_params along = {.shape = ANALYTIC_BOX, .half_size = {2, 1, 1}},
                          across = {.shape = ANALYTIC_BOX, .half_size = {1, 2, 1}},
                          higher = {.shape = ANALYTIC_BOX, .half_size = {0.5, 1.5, 2}};
    analytic *a = make(&along), *b = make(&across), *c = make(&higher);
    error e = {0};
    const field *flat[2] = {&a->base, &b->base}, *raised[2] = {&a->base, &c->base};
    combination *u = combination_new(COMBINATION_UNION, flat, 2, 12, 0, 0, SIZE_MAX, NULL, &e);
    combination *d = combination_new(COMBINATION_UNION, raised, 2, 12, 0, 0, SIZE_MAX, NULL, &e);
    assert_true(u && d);
    solid *s = solid_new(4);
    solid_push_shape(s, &s->inside, &along, HERE, false);
    solid_push_shape(s, &s->inside, &across, HERE, false);
    solid_join(s, &s->inside, true);
    /* a plus sign: two faces of 12, twelve sides in ten planes */
    check("plus", s, combination_field(u), everywhere,
          (expected){10, 36, 24, 2 * 12 + 2 * 16, 2 * 16 + 12 * 2, 1e-9});
    s = solid_new(4);
    solid_push_shape(s, &s->inside, &along, HERE, false);
    solid_push_shape(s, &s->inside, &higher, HERE, false);
    solid_join(s, &s->inside, true);
    /* each extends beyond the other: areas of 40 and 38, less the parts inside the other; edges of the first,
     * the second, both */
    check("crossed", s, combination_field(d), everywhere,
          (expected){12, 16 + 12 + 8, 24, 40 - 8 + 38 - 8, 12 + 16 + 32 + 16, 1e-9});
    combination_free(u);
    combination_free(d);
    analytic_free(a);
    analytic_free(b);
    analytic_free(c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_and_a_cylinder),
        cmocka_unit_test(combinations),
    };
    return cmocka_run_group_tests_name("creased", tests, NULL, NULL);
}
