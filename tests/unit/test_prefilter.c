// SPDX-License-Identifier: Apache-2.0
/* The prefilter of known voxels: the spline has their values, is extrapolated as a parabola, and leaves other
 * voxels unchanged. Extrapolation of a band by any number of threads.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "samples_fixture.h"
#include "shapes.h"
#include "surface/volume/band_extension.h"
#include "surface/volume/prefilter.h"

enum {
    BLOCKS = 4,
    SIDE = GRID_VIEW_SIDE,
    ALL = BLOCKS * SIDE,
    VOXELS = ALL * ALL * ALL,
    BOXES = 60,
    LEAST = 3,
    MOST = 9
};

/* Voxels by position, of all blocks. Voxels of missing blocks must not change. */
typedef struct cube {
    float f[VOXELS];
    bool known[VOXELS];
} cube;

static int place(int x, int y, int z)
{
    return (x * ALL + y) * ALL + z;
}

/* The index of voxel k of a block in the cube. */
static int place_in(const int32_t block[3], int k)
{
    return place(block[0] * SIDE + k / 64, block[1] * SIDE + k / 8 % 8, block[2] * SIDE + k % 8);
}

static int draw_below(rng *r, int most)
{
    return (int)(rng_uniform(r) * most);
}

/* Boxes of at least three voxels along each axis, so that each run has three. */
static void draw_known(cube *c, rng *r)
{
    memset(c->known, 0, sizeof c->known);
    for (int k = 0; k < BOXES; k++) {
        int low[3], size[3];
        for (int axis = 0; axis < 3; axis++) {
            size[axis] = LEAST + draw_below(r, MOST - LEAST);
            low[axis] = draw_below(r, ALL - size[axis]);
        }
        for (int x = 0; x < size[0]; x++)
            for (int y = 0; y < size[1]; y++)
                memset(c->known + place(low[0] + x, low[1] + y, low[2]), 1, (size_t)size[2]);
    }
}

static void copy(samples *s, cube *c, bool back)
{
    for (size_t n = 0; n < s->map.count; n++)
        for (int k = 0; k < GRID_VIEW_VOXELS; k++) {
            float *at = &c->f[place_in(s->map.blocks[n], k)];
            *(back ? at : &s->f[n][k]) = back ? s->f[n][k] : *at;
        }
}

/* Samples of the cube's voxels. */
static samples make_samples(cube *c, bool gaps)
{
    error e = {0};
    rng unused = rng_seed(1, 0);
    samples s = samples_fixture(BLOCKS, 0, gaps, &unused);
    s.known = mem_array(s.map.count * SIDE, sizeof *s.known, "voxels", &e);
    s.near = mem_array(s.map.count * 6, sizeof *s.near, "voxels", &e);
    assert_true(s.known && s.near);
    for (size_t n = 0; n < s.map.count; n++) {
        const int32_t *b = s.map.blocks[n];
        for (int k = 0; k < GRID_VIEW_VOXELS; k++)
            if (c->known[place_in(b, k)]) s.known[n * SIDE + (size_t)(k / 64)] |= (uint64_t)1 << k % 64;
        for (int k = 0; k < 6; k++) {
            int32_t at[3] = {b[0], b[1], b[2]};
            at[k / 2] += k % 2 ? 1 : -1;
            s.near[6 * n + (size_t)k] = block_map_find(&s.map, at[0], at[1], at[2]);
        }
    }
    copy(&s, c, false);
    return s;
}

/* Filters the cube's voxels. */
static void filter(cube *c, int workers)
{
    error e = {0};
    samples s = make_samples(c, false);
    threads *pool = threads_new(workers, NULL, &e);
    assert_non_null(pool);
    assert_true(prefilter_run(&s, true, pool, &e));
    copy(&s, c, true);
    samples_free(&s);
    threads_free(pool);
}

/* The value of the spline at a voxel whose neighbours are all known; otherwise false. */
static bool spline_at(const cube *c, int x, int y, int z, double *value)
{
    static const double weight[3] = {1 / 6., 4 / 6., 1 / 6.};
    *value = 0;
    for (int k = 0; k < 27; k++) {
        const int at[3] = {x + k / 9 - 1, y + k / 3 % 3 - 1, z + k % 3 - 1};
        for (int axis = 0; axis < 3; axis++)
            if (at[axis] < 0 || at[axis] >= ALL) return false;
        if (!c->known[place(at[0], at[1], at[2])]) return false;
        *value +=
            weight[k / 9] * weight[k / 3 % 3] * weight[k % 3] * (double)c->f[place(at[0], at[1], at[2])];
    }
    return true;
}

static cube before, after, other;

static void the_spline_has_the_known_values(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    size_t seen = 0, left = 0;
    draw_known(&before, &r);
    for (int k = 0; k < VOXELS; k++) before.f[k] = (float)rng_uniform(&r);
    after = before;
    filter(&after, 1);
    for (int k = 0; k < VOXELS; k++) {
        double value;
        if (!before.known[k]) {
            assert_memory_equal(&after.f[k], &before.f[k], sizeof *after.f);
            left++;
        } else if (spline_at(&after, k / (ALL * ALL), k / ALL % ALL, k % ALL, &value)) {
            assert_true(fabs(value - (double)before.f[k]) < 1e-5);
            seen++;
        }
    }
    assert_true(seen > 500 && left > 500);
}

/* Its coefficients are its values less a sixth of its second differences, also at the ends of runs. */
static void a_parabola_is_extrapolated(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    double bend[3], slope[3], sum = 0;
    size_t seen = 0;
    for (int axis = 0; axis < 3; axis++) {
        slope[axis] = 2 + rng_uniform(&r);
        bend[axis] = 0.2 + 0.5 * rng_uniform(&r); /* less than half of the slope everywhere */
        sum += bend[axis];
    }
    draw_known(&before, &r);
    for (int k = 0; k < VOXELS; k++) {
        const double at[3] = {k / (ALL * ALL), k / ALL % ALL, k % ALL};
        double value = 0;
        for (int axis = 0; axis < 3; axis++) value += (slope[axis] + bend[axis] / 2 * at[axis]) * at[axis];
        before.f[k] = (float)value;
    }
    after = before;
    filter(&after, 1);
    for (int k = 0; k < VOXELS; k++) {
        if (!before.known[k]) continue;
        assert_true(fabs((double)after.f[k] - ((double)before.f[k] - sum / 6)) < 1e-3);
        seen++;
    }
    print_message("# %zu known voxels, coefficients lie %.4f from values\n", seen, fabs(sum / 6));
    assert_true(seen > 500);
}

static void filter_does_not_depend_on_threads(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    draw_known(&before, &r);
    for (int k = 0; k < VOXELS; k++) before.f[k] = (float)rng_uniform(&r);
    after = before;
    other = before;
    filter(&after, 1);
    filter(&other, 3);
    assert_memory_equal(after.f, other.f, sizeof after.f);
}

/* All voxels of the blocks of a band get a value with the sign of their side. */
static void extrapolation_does_not_depend_on_threads(void **state)
{
    (void)state;
    static const int workers[] = {1, 2, 3, 8};
    rng r = rng_seed(test_seed(), 3);
    samples s[4];
    error e = {0};
    size_t filled = 0;
    draw_known(&before, &r);
    for (int k = 0; k < VOXELS; k++)
        before.f[k] = before.known[k] ? (float)(rng_uniform(&r) - 0.5) : k % 5 ? 3 : -3;
    for (int w = 0; w < 4; w++) {
        threads *pool = threads_new(workers[w], NULL, &e);
        assert_non_null(pool);
        s[w] = make_samples(&before, true);
        assert_true(band_extension_fill(&s[w], pool, &e));
        threads_free(pool);
    }
    for (size_t n = 0; n < s[0].map.count; n++)
        for (int k = 0; k < GRID_VIEW_VOXELS; k++) {
            const int at = place_in(s[0].map.blocks[n], k);
            const float value = s[0].f[n][k];
            for (int w = 1; w < 4; w++) assert_memory_equal(&s[w].f[n][k], &value, sizeof value);
            if (before.known[at]) {
                assert_memory_equal(&before.f[at], &value, sizeof value);
            } else {
                assert_true(isfinite(value) && value * before.f[at] > 0);
                filled += value != before.f[at];
            }
        }
    for (int w = 0; w < 4; w++) {
        assert_memory_equal(s[w].known, s[0].known, s[0].map.count * SIDE * sizeof *s->known);
        samples_free(&s[w]);
    }
    print_message("# %zu voxels have new values\n", filled);
    assert_true(filled > 1000);
}

/* The band of a plane of any direction, three voxels on either side: extrapolation is exact for it. Voxels of
 * every adjacent block get its values, within the permitted range. */
static void a_plane_is_extrapolated(void **state)
{
    (void)state;
    enum { BAND = 3, PLANES = 24 };
    rng r = rng_seed(test_seed(), 4);
    error e = {0};
    size_t seen = 0;
    double worst = 0;
    for (int plane = 0; plane < PLANES; plane++) {
        double normal[3], length = 0;
        for (int k = 0; k < 3; k++) normal[k] = rng_uniform(&r) - 0.5;
        if (plane < 6) normal[plane % 3] = plane < 3 ? 2 : -2; /* nearly along an axis */
        for (int k = 0; k < 3; k++) length += normal[k] * normal[k];
        for (int k = 0; k < VOXELS; k++) {
            const int at[3] = {k / (ALL * ALL), k / ALL % ALL, k % ALL};
            double f = 0;
            for (int axis = 0; axis < 3; axis++)
                f += normal[axis] / sqrt(length) * (at[axis] - 0.5 * ALL + 0.3);
            other.f[k] = (float)f;
            before.known[k] = fabs(f) < BAND;
            before.f[k] = before.known[k] ? (float)f : f < 0 ? -BAND : BAND;
        }
        samples s = make_samples(&before, false);
        assert_true(band_extension_fill(&s, NULL, &e));
        copy(&s, &before, true);
        samples_free(&s);
        for (int k = 0; k < VOXELS; k++) {
            const double f = (double)other.f[k];
            bool within = fabs(f) <= BAND + SIDE / 2; /* the reach of coefficient blocks */
            /* slivers at the boundary of the cube cannot be extrapolated */
            for (int at = k, axis = 0; axis < 3; at /= ALL, axis++)
                within = within && at % ALL >= SIDE && at % ALL < ALL - SIDE;
            if (!within) continue;
            worst = fmax(worst, fabs((double)before.f[k] - f));
            seen += !before.known[k];
        }
    }
    print_message("# %zu voxels beyond the band, off by %.2e\n", seen, worst);
    assert_true(seen > 100 * PLANES && worst < 1e-4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_spline_has_the_known_values),
        cmocka_unit_test(a_parabola_is_extrapolated),
        cmocka_unit_test(filter_does_not_depend_on_threads),
        cmocka_unit_test(extrapolation_does_not_depend_on_threads),
        cmocka_unit_test(a_plane_is_extrapolated),
    };
    return cmocka_run_group_tests_name("prefilter", tests, NULL, NULL);
}
