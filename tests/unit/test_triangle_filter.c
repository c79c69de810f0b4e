// SPDX-License-Identifier: Apache-2.0
/* The triangle filter against a test of single triangles in double precision: flat, bent and creased
 * neighbourhoods, opposite walls, uniform and varying spacing.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/voronoi/triangle_filter.h"
#include "shapes.h"

enum { MOST = 48 };

typedef struct around {
    vec3 at[MOST], normal[MOST];
    double x[MOST], y[MOST], z[MOST], nx[MOST], ny[MOST], nz[MOST], other[MOST], square[MOST];
    triangle_filter_input shown;
} around;

/* Three points and their Voronoi line, clipped by one point after another (voronoi.h). */
typedef struct line {
    vec3 corner[3], normal[3], across, centre;
    double low, high;
    int low_by, high_by;
} line;

static bool span(const around *s, uint32_t b, uint32_t c, line *out)
{
    const double least = fmin(1, fmin(s->other[b], s->other[c])),
                 most = fmax(1, fmax(s->other[b], s->other[c]));
    const vec3 u = s->at[b], v = s->at[c], w = vec3_cross(u, v);
    const double u2 = vec3_norm2(u), v2 = vec3_norm2(v), w2 = vec3_norm2(w);
    const vec3 to =
        vec3_scale(vec3_add(vec3_scale(vec3_cross(w, u), v2), vec3_scale(vec3_cross(v, w), u2)), 0.5 / w2);
    const vec3 facing = vec3_add(s->shown.normal, vec3_add(s->normal[b], s->normal[c]));
    const double deep2 = pow(0.5 * VORONOI_REACH * least, 2) - vec3_norm2(to);
    *out = (line){{{0, 0, 0}, u, v}, {s->shown.normal, s->normal[b], s->normal[c]}, .centre = to};
    out->across = vec3_scale(w, copysign(1, vec3_dot(w, facing)));
    out->high = deep2 < pow(TRIANGLE_MIN_DEPTH * least, 2) ? INFINITY : sqrt(deep2 / w2);
    out->low = -out->high;
    out->low_by = out->high_by = -1;
    return w2 > 1e-12 * u2 * v2 && vec3_norm(to) < TRIANGLE_MAX_CIRCUMRADIUS * most;
}

static bool cut(const around *s, uint32_t b, uint32_t c, line *t)
{
    const vec3 facing = vec3_add(t->normal[0], vec3_add(t->normal[1], t->normal[2]));
    for (uint32_t d = 0; d < s->shown.count; d++) {
        if (d == b || d == c || vec3_dot(s->normal[d], facing) <= VORONOI_OPPOSITE_COSINE * vec3_norm(facing))
            continue;
        const vec3 q = vec3_sub(s->at[d], t->centre);
        const double along = 2 * vec3_dot(t->across, q), rest = vec3_norm2(q) - vec3_norm2(t->centre);
        if (along > 0 && rest / along < t->high) t->high = rest / along, t->high_by = (int)d;
        if (along < 0 && rest / along > t->low) t->low = rest / along, t->low_by = (int)d;
    }
    return t->low < t->high;
}

static bool is_inside(const around *s, const line *t, double end, int by)
{
    const vec3 x = vec3_axpy(end, t->across, t->centre);
    int outside = 0;
    for (int k = 0; k < 4; k++) {
        const double height = k < 3 ? vec3_dot(vec3_sub(x, t->corner[k]), t->normal[k])
                                    : vec3_dot(vec3_sub(x, s->at[by]), s->normal[by]);
        outside += (height > 0) - (height < 0);
    }
    return outside < 0;
}

static bool crosses(const around *s, uint32_t b, uint32_t c)
{
    line t;
    if (!span(s, b, c, &t) || !cut(s, b, c, &t)) return false;
    return (t.low_by < 0 || is_inside(s, &t, t.low, t.low_by)) !=
           (t.high_by >= 0 && is_inside(s, &t, t.high, t.high_by));
}

static int by_distance(const void *a, const void *b)
{
    const double x = vec3_norm2(*(const vec3 *)a), y = vec3_norm2(*(const vec3 *)b);
    return (x > y) - (x < y);
}

/* Points on a wall that is bent or creased along x; in some rounds with an opposite wall above or below
 * it. */
static void scatter(around *s, rng *r)
{
    const double bend = 1.5 * (rng_uniform(r) - 0.5), roof = rng_uniform(r) < 0.3 ? rng_uniform(r) : 0;
    const double tilt = 0.2 * rng_uniform(r), uneven = rng_uniform(r) < 0.5 ? 0.4 * rng_uniform(r) : 0;
    const double gap = rng_uniform(r) < 0.5 ? 0.3 + rng_uniform(r) : 0;
    const uint32_t count = 8 + (uint32_t)(rng_uniform(r) * (MOST - 8));
    for (uint32_t k = 0; k < count; k++)
        s->at[k] =
            random_between(r, (vec3){-2, -2, gap > 0 && k % 3 == 0}, (vec3){2, 2, gap > 0 && k % 3 == 0});
    for (uint32_t k = 0; k < count; k++) {
        vec3 *x = &s->at[k];
        x->z = x->z * gap + 0.5 * bend * x->x * x->x - roof * fabs(x->x);
    }
    qsort(s->at, count, sizeof *s->at, by_distance);
    for (uint32_t k = 0; k < count; k++) {
        const vec3 x = s->at[k], off = random_between(r, (vec3){-tilt, -tilt, 0}, (vec3){tilt, tilt, 0});
        const double sheet = x.z - 0.5 * bend * x.x * x.x + roof * fabs(x.x);
        const vec3 n = vec3_unit((vec3){off.x - bend * x.x + copysign(roof, x.x), off.y, 1});
        s->normal[k] = sheet > 0.1 ? vec3_scale(n, -1) : n;
        s->other[k] = 1 + uneven * (2 * rng_uniform(r) - 1);
        s->square[k] = vec3_norm2(x);
        s->x[k] = x.x, s->y[k] = x.y, s->z[k] = x.z;
        s->nx[k] = s->normal[k].x, s->ny[k] = s->normal[k].y, s->nz[k] = s->normal[k].z;
    }
    s->shown = (triangle_filter_input){count, {0, 0, 0}, {0, 0, 1}, 1,     s->x,     s->y,
                                       s->z,  s->nx,     s->ny,     s->nz, s->other, s->square};
}

static void triangles_of_the_surface_are_kept(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    around *s = calloc(1, sizeof *s);
    triangle_filter *filter = calloc(1, sizeof *filter);
    uint32_t left[VORONOI_STAR_MAX];
    int32_t by[VORONOI_STAR_MAX][2];
    size_t all = 0, kept = 0, found = 0;
    for (int round = 0; round < 2000; round++) {
        scatter(s, &r);
        triangle_filter_fill(&s->shown, filter);
        for (uint32_t b = 0; b < s->shown.count; b++) {
            uint32_t thirds = 0, at = 0;
            for (uint32_t c = 0; c < s->shown.count; c++)
                if (c != b) left[thirds++] = c;
            const uint32_t stay = triangle_filter_third_corners(filter, b, thirds, left, by);
            all += thirds;
            kept += stay;
            for (uint32_t c = 0; c < s->shown.count; c++) {
                const bool stays = at < stay && left[at] == c;
                at += stays;
                if (c == b || !crosses(s, b, c)) continue;
                found++;
                if (!stays)
                    fail_msg("round %d: the triangle of the point, %u and %u is discarded", round, b, c);
            }
            assert_int_equal(at, stay);
        }
    }
    print_message("%zu triangles, %zu stay, %zu cross the surface\n", all, kept, found);
    assert_true(kept < all / 3);
    free(filter);
    free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(triangles_of_the_surface_are_kept)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
