// SPDX-License-Identifier: Apache-2.0
/* Polygons as triangles: simple planar polygons are covered once, whatever their shape; the work is
 * bounded. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/rng.h"
#include "io/meshes/polygon.h"

enum { SEED = 20261127, MOST = 4096 };

typedef struct outline {
    size_t count;
    double at[MOST][2];
} outline;

static void add(outline *o, double x, double y)
{
    assert_true(o->count < MOST);
    o->at[o->count][0] = x;
    o->at[o->count++][1] = y;
}

/* ---- shapes, counter-clockwise */

/* Star-shaped about the origin, with spikes. */
static void make_star(outline *o, size_t count, rng *r)
{
    for (size_t k = 0; k < count; k++) {
        const double angle = 2 * M_PI * ((double)k + 0.8 * rng_uniform(r)) / (double)count,
                     radius = 0.1 + 0.9 * pow(rng_uniform(r), 2);
        add(o, radius * cos(angle), radius * sin(angle));
    }
}

/* Teeth on a bar, with corners in the middle of straight sides. */
static void make_comb(outline *o, size_t teeth, rng *r)
{
    add(o, 0, 0);
    for (size_t k = 1; k < teeth; k++) add(o, (double)k, 0);
    add(o, (double)teeth, 0);
    for (size_t k = teeth; k-- > 0;) {
        const double high = 2 + floor(3 * rng_uniform(r));
        add(o, (double)k + 1, high);
        add(o, (double)k + 0.5, high);
        add(o, (double)k + 0.5, 1);
        add(o, (double)k + 0.25, 1);
        if (k > 0) add(o, (double)k, 1);
    }
    add(o, 0, 1);
}

/* A corridor that winds inwards. */
static void make_spiral(outline *o, size_t steps, rng *r)
{
    const double thick = 0.2 + 0.6 * rng_uniform(r);
    for (size_t k = 0; k <= steps; k++) {
        const double angle = 0.5 * (double)k, radius = 1 + 0.1 * (double)k;
        add(o, radius * cos(angle), radius * sin(angle));
    }
    for (size_t k = steps + 1; k-- > 0;) {
        const double angle = 0.5 * (double)k, radius = 1 + 0.1 * (double)k - thick;
        add(o, radius * cos(angle), radius * sin(angle));
    }
}

/* A square with square holes, joined to it by bridges of two coinciding sides. */
static void make_keyhole(outline *o, size_t holes, rng *r)
{
    const double end = (double)holes;
    add(o, 0, 0);
    for (size_t k = 0; k < holes; k++) {
        const double x = (double)k + 0.2, y = 0.2 + 0.2 * rng_uniform(r), side = 0.1 + 0.5 * rng_uniform(r);
        add(o, x, 0);
        add(o, x, y);
        add(o, x, y + side);
        add(o, x + side, y + side);
        add(o, x + side, y);
        add(o, x, y);
        add(o, x, 0);
    }
    add(o, end, 0);
    add(o, end, 1);
    add(o, 0, 1);
}

static double area_of(const outline *o)
{
    double twice = 0;
    for (size_t k = 0; k < o->count; k++) {
        const double *a = o->at[k], *b = o->at[(k + 1) % o->count];
        twice += a[0] * b[1] - a[1] * b[0];
    }
    return twice / 2;
}

static void make_shape(outline *o, int kind, size_t size, rng *r)
{
    o->count = 0;
    if (kind == 0) make_star(o, size + 3, r);
    if (kind == 1) make_comb(o, size + 1, r);
    if (kind == 2) make_spiral(o, size + 2, r);
    if (kind == 3) make_keyhole(o, size + 1, r);
    assert_true(area_of(o) > 0);
}

/* ---- checks */

static void vec3_across(const double a[3], const double b[3], const double c[3], double out[3])
{
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
    }
}

/* Each side of the polygon belongs to one triangle, in its direction. Each other side belongs to two
 * triangles, in both directions. */
static void assert_sides(size_t count, const uint32_t (*out)[3])
{
    signed char *sides = calloc(count * count, 1);
    assert_non_null(sides);
    for (size_t n = 0; n + 2 < count; n++)
        for (int k = 0; k < 3; k++) {
            const size_t a = out[n][k], b = out[n][(k + 1) % 3];
            assert_true(a < count && b < count && a != b);
            sides[a * count + b]++;
        }
    for (size_t a = 0; a < count; a++)
        for (size_t b = 0; b < count; b++) {
            const int own = b == (a + 1) % count;
            assert_int_equal(sides[a * count + b] - sides[b * count + a], own - (a == (b + 1) % count));
            assert_true(sides[a * count + b] <= 1);
        }
    free(sides);
}

/* Moves the polygon to a plane in space and back: the triangles add up to the polygon, and none is
 * reversed. */
static void assert_covered(const outline *o, rng *r, bool flat_ones_too)
{
    double(*place)[3] = malloc(o->count * sizeof *place), axis[3][3];
    uint32_t *corner = malloc(o->count * sizeof *corner), (*out)[3] = malloc(o->count * sizeof *out);
    assert_true(place && corner && out);
    for (int k = 0; k < 9; k++) axis[k / 3][k % 3] = rng_uniform(r) - 0.5;
    double normal[3], origin[3] = {0, 0, 0};
    vec3_across(origin, axis[0], axis[1], normal);
    const double scale = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (size_t k = 0; k < o->count; k++) {
        corner[k] = (uint32_t)k;
        for (int i = 0; i < 3; i++)
            place[k][i] = axis[2][i] + o->at[k][0] * axis[0][i] + o->at[k][1] * axis[1][i];
    }
    assert_int_equal(polygon_cut((const double(*)[3])place, corner, o->count, NULL, out), POLYGON_CUT);
    assert_sides(o->count, (const uint32_t(*)[3])out);
    double sum = 0;
    for (size_t n = 0; n + 2 < o->count; n++) {
        double across[3];
        vec3_across(place[out[n][0]], place[out[n][1]], place[out[n][2]], across);
        const double length = sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]),
                     along = (across[0] * normal[0] + across[1] * normal[1] + across[2] * normal[2]) / scale;
        sum += length / 2;
        if (!(along > (flat_ones_too ? -1e-12 * scale * area_of(o) : 0)))
            fail_msg("triangle %zu is turned over", n);
    }
    const double wanted = area_of(o) * scale;
    if (!(fabs(sum - wanted) <= 1e-12 * wanted)) fail_msg("area %.17g, not %.17g", sum, wanted);
    free(place);
    free(corner);
    free(out);
}

static void simple_polygons_are_covered_once(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 0);
    outline o;
    for (int n = 0; n < 800; n++) {
        make_shape(&o, n % 4, (size_t)(pow(rng_uniform(&r), 3) * 60), &r);
        assert_covered(&o, &r, true);
    }
}

static double turn(const double a[2], const double b[2], const double c[2])
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/* Whether the segment from corner `at` to a tip crosses no side and does not lie on a side of the corner. */
static bool is_clear(const outline *o, size_t at, const double tip[2])
{
    const double *a = o->at[at];
    for (size_t k = 0; k < o->count; k++) {
        const double *c = o->at[k], *d = o->at[(k + 1) % o->count];
        if (k == at || (k + 1) % o->count == at) {
            const double *far = k == at ? d : c;
            if (fabs(turn(a, tip, far)) < 1e-3 &&
                (far[0] - a[0]) * (tip[0] - a[0]) + (far[1] - a[1]) * (tip[1] - a[1]) > 0)
                return false;
        } else if (turn(a, tip, c) * turn(a, tip, d) <= 0 && turn(c, d, a) * turn(c, d, tip) <= 0) {
            return false;
        }
    }
    return true;
}

/* Adds a spike without area at a corner: it continues the side before or after it, and returns to the
 * corner. */
static bool put_spike(outline *o, size_t at, rng *r)
{
    const bool is_before = rng_uniform(r) < 0.5;
    const double *corner = o->at[at], *from = o->at[(at + (is_before ? o->count - 1 : 1)) % o->count],
                 share = 0.1 + rng_uniform(r);
    const double tip[2] = {corner[0] + share * (corner[0] - from[0]),
                           corner[1] + share * (corner[1] - from[1])};
    if (!is_clear(o, at, tip)) return false;
    const size_t place = is_before ? at : at + 1;
    memmove(o->at[place + 1], o->at[place], (o->count - place) * sizeof *o->at);
    memcpy(o->at[place], tip, sizeof tip);
    o->count++;
    return true;
}

/* Such spikes occur where triangles without area were joined with their neighbours, inside the polygon or
 * outside. */
static void spikes_have_no_area(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 5);
    outline o;
    size_t spikes = 0;
    for (int n = 0; n < 2000; n++) {
        if (n % 4 < 3) {
            make_shape(&o, n % 4, 4 + (size_t)(rng_uniform(&r) * 12), &r);
        } else {
            o.count = 0;
            for (int k = 0; k < 3; k++) add(&o, cos(2 * k + rng_uniform(&r)), sin(2 * k + rng_uniform(&r)));
            if (!(area_of(&o) > 0.1)) continue;
        }
        const size_t most = o.count == 3 ? 1 : 3;
        size_t put = 0;
        for (int k = 0; k < 20 && put < most; k++)
            put += put_spike(&o, (size_t)(rng_uniform(&r) * (double)o.count), &r);
        spikes += put;
        assert_covered(&o, &r, true);
    }
    assert_true(spikes > 2000);
}

/* Corners on straight sides are used such that no triangle is flat: the coordinates are exact. */
static void straight_corners_give_no_flat_triangles(void **state)
{
    (void)state;
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 1);
    outline o;
    for (int n = 0; n < 40; n++) {
        double place[MOST][3];
        uint32_t corner[MOST], out[MOST][3];
        o.count = 0;
        make_comb(&o, 1 + (size_t)n % 12, &r);
        for (size_t k = 0; k < o.count; k++) {
            corner[k] = (uint32_t)k;
            place[k][0] = o.at[k][1];
            place[k][1] = 7;
            place[k][2] = o.at[k][0];
        }
        assert_int_equal(polygon_cut((const double(*)[3])place, corner, o.count, NULL, out), POLYGON_CUT);
        for (size_t t = 0; t + 2 < o.count; t++) {
            double across[3];
            vec3_across(place[out[t][0]], place[out[t][1]], place[out[t][2]], across);
            assert_true(across[1] > 0);
        }
    }
}

static void assert_quadrangle(const double place[4][3], size_t first)
{
    static const uint32_t corner[4] = {0, 1, 2, 3};
    uint32_t out[2][3];
    assert_int_equal(polygon_cut(place, corner, 4, NULL, out), POLYGON_CUT);
    assert_int_equal(out[0][0], first);
    assert_int_equal(out[0][2], first + 2);
}

static void quadrangles_are_cut_along_the_shorter_diagonal_within(void **state)
{
    (void)state;
    static const double square[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
                        kite[4][3] = {{0, 0, 0}, {2, 1, 0}, {4, 0, 0}, {2, -1, 0}}, /* clockwise */
        bent[4][3] = {{0, 0, 0}, {2, 1, 0.3}, {4, 0, 0}, {2, -1, 0.3}},
                        long_way[4][3] = {{0, 0, 0.3}, {1, 1, 0}, {0, 6, 0.3}, {-1, 1, 0}},
                        dart[4][3] = {{0, 0, 0}, {1, -2, 0}, {0, 6, 0}, {-1, -2, 0}},
                        bent_dart[4][3] = {{1, -2, 0.2}, {0, 6, 0}, {-1, -2, 0.2}, {0, 0, 0}};
    assert_quadrangle(square, 0);
    assert_quadrangle(kite, 1);
    assert_quadrangle(bent, 1);
    assert_quadrangle(long_way, 1);
    assert_quadrangle(dart, 0); /* the shorter diagonal is outside */
    assert_quadrangle(bent_dart, 1);
}

static int by_number(const void *left, const void *right)
{
    const uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right;
    return (a > b) - (a < b);
}

static int by_numbers(const void *left, const void *right)
{
    for (int k = 0; k < 3; k++) {
        const int order = by_number((const uint32_t *)left + k, (const uint32_t *)right + k);
        if (order) return order;
    }
    return 0;
}

/* The triangles of a polygon in an order that depends on their corners only. */
static void cut_and_sort(const double (*place)[3], const uint32_t *corner, size_t count, uint32_t (*out)[3])
{
    assert_int_equal(polygon_cut(place, corner, count, NULL, out), POLYGON_CUT);
    for (size_t t = 0; t + 2 < count; t++) qsort(out[t], 3, sizeof out[t][0], by_number);
    qsort(out, count - 2, sizeof *out, by_numbers);
}

static void copies_of_a_polygon_are_cut_in_the_same_way(void **state)
{
    (void)state;
    static const double square[][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}},
                        triangle[][2] = {{0, 0}, {1, 0}, {2, 0}, {1, 1}, {0, 2}, {0, 1}},
                        arrow[][2] = {{0, 0}, {4, 0}, {4, 3}, {2, 1}, {0, 3}, {-1, 2}};
    static const struct {
        const double (*at)[2];
        size_t count;
    } shapes[] = {{square, 4}, {triangle, 6}, {arrow, 6}};
    for (size_t n = 0; n < sizeof shapes / sizeof *shapes; n++) {
        const size_t count = shapes[n].count;
        double place[6][3] = {{0}};
        for (size_t k = 0; k < count; k++) memcpy(place[k], shapes[n].at[k], sizeof shapes[n].at[k]);
        uint32_t first[4][3], other[4][3], corner[6];
        for (size_t turn = 0; turn < 2 * count; turn++) {
            for (size_t k = 0; k < count; k++)
                corner[k] = (uint32_t)((turn < count ? k + turn : 3 * count - k - turn) % count);
            cut_and_sort((const double(*)[3])place, corner, count, turn ? other : first);
            if (turn) assert_memory_equal(first, other, (count - 2) * sizeof *first);
        }
    }
}

static void crossed_polygons_are_reported(void **state)
{
    (void)state;
    static const double bow[4][3] = {{0, 0, 0}, {2, 2, 0}, {2, 0, 0}, {0, 1, 0}},
                        star[5][3] = {{0, 0, 0}, {4, 0, 0}, {0, 3, 0}, {2, -2, 0}, {4, 3, 0}},
                        line[5][3] = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}};
    static const uint32_t corner[5] = {0, 1, 2, 3, 4};
    uint32_t out[3][3];
    assert_int_equal(polygon_cut(bow, corner, 4, NULL, out), POLYGON_CROSSED);
    assert_int_equal(polygon_cut(star, corner, 5, NULL, out), POLYGON_CROSSED);
    assert_int_equal(polygon_cut(line, corner, 5, NULL, out), POLYGON_CUT);
}

/* 100 000 corners on a wave and on a comb do not take quadratic time. */
static void large_polygons_are_cut(void **state)
{
    (void)state;
    enum { COUNT = 100000 };
    double(*place)[3] = calloc(COUNT, sizeof *place);
    uint32_t *corner = malloc(COUNT * sizeof *corner), (*out)[3] = malloc(COUNT * sizeof *out);
    assert_true(place && corner && out);
    for (int shape = 0; shape < 2; shape++) {
        double sum = 0, wanted = 0;
        for (uint32_t k = 0; k < COUNT; k++) {
            const double angle = 2 * M_PI * k / COUNT,
                         radius = shape ? (k / 2 % 2 ? 1 : 0.5) : 1 + 0.2 * sin(1000 * angle);
            corner[k] = k;
            place[k][0] = radius * cos(angle);
            place[k][1] = radius * sin(angle);
        }
        for (uint32_t k = 0; k < COUNT; k++) {
            const double *a = place[k], *b = place[(k + 1) % COUNT];
            wanted += (a[0] * b[1] - a[1] * b[0]) / 2;
        }
        assert_int_equal(polygon_cut((const double(*)[3])place, corner, COUNT, NULL, out), POLYGON_CUT);
        for (size_t n = 0; n + 2 < COUNT; n++) {
            double across[3];
            vec3_across(place[out[n][0]], place[out[n][1]], place[out[n][2]], across);
            sum += fabs(across[2]) / 2;
        }
        assert_true(fabs(sum - wanted) <= 1e-9 * wanted);
    }
    free(place);
    free(corner);
    free(out);
}

/* Corners at six places, over and over: cut without a search for ears that do not exist, within the limit of the work. */
static void polygons_with_repeated_corners_are_cut(void **state)
{
    (void)state;
    enum { COUNT = 24000, PLACES = 6 };
    double place[PLACES][3] = {{0}};
    uint32_t *corner = malloc(COUNT * sizeof *corner), (*out)[3] = malloc(COUNT * sizeof *out);
    assert_true(corner && out);
    print_message("# seed %d\n", SEED);
    rng r = rng_seed(SEED, 6);
    for (int k = 0; k < PLACES; k++) {
        place[k][0] = cos(M_PI * k / 3);
        place[k][1] = sin(M_PI * k / 3);
    }
    for (uint32_t k = 0; k < COUNT; k++) corner[k] = (uint32_t)(PLACES * rng_uniform(&r));
    assert_int_equal(polygon_cut((const double(*)[3])place, corner, COUNT, NULL, out), POLYGON_CROSSED);
    for (size_t n = 0; n + 2 < COUNT; n++)
        for (int k = 0; k < 3; k++) assert_true(out[n][k] < PLACES);
    /* a path forth and back has no area */
    for (uint32_t k = 0; k < COUNT; k++) corner[k] = k / PLACES % 2 ? PLACES - 1 - k % PLACES : k % PLACES;
    assert_int_equal(polygon_cut((const double(*)[3])place, corner, COUNT, NULL, out), POLYGON_CUT);
    for (size_t n = 0; n + 2 < COUNT; n++)
        assert_true(out[n][0] == out[n][1] || out[n][1] == out[n][2] || out[n][2] == out[n][0]);
    const sig_atomic_t stop = 1;
    for (uint32_t k = 0; k < COUNT; k++) corner[k] = (uint32_t)(PLACES * rng_uniform(&r));
    assert_int_equal(polygon_cut((const double(*)[3])place, corner, COUNT, &stop, out), POLYGON_STOPPED);
    free(corner);
    free(out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(simple_polygons_are_covered_once),
        cmocka_unit_test(spikes_have_no_area),
        cmocka_unit_test(straight_corners_give_no_flat_triangles),
        cmocka_unit_test(quadrangles_are_cut_along_the_shorter_diagonal_within),
        cmocka_unit_test(copies_of_a_polygon_are_cut_in_the_same_way),
        cmocka_unit_test(crossed_polygons_are_reported),
        cmocka_unit_test(large_polygons_are_cut),
        cmocka_unit_test(polygons_with_repeated_corners_are_cut),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
