/* Stars against edges judged a pair at a time: on sets that are even, shaken, bent, creased, degenerate. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "sampler/project.h"
#include "sampler/voronoi.h"
#include "shapes.h"

enum { SIDE = 24, SHEET = SIDE * SIDE, MOST = 3000 };

typedef struct set {
    size_t count;
    vec3 position[MOST], normal[MOST];
    double spacing[MOST];
} set;

static neighbours *list_neighbours(const set *s)
{
    error e = {0};
    threads *pool = threads_new(1, NULL, &e);
    neighbours *near = neighbours_new(s->count, SIZE_MAX, &e);
    if (!near || !neighbours_build(near, s->count, s->position, s->spacing, VORONOI_REACH, pool, &e))
        fail_msg("%s", e.message);
    threads_free(pool);
    return near;
}

static int find_in_star(const voronoi_star *star, uint32_t b)
{
    for (uint32_t k = 0; k < star->count; k++)
        if (star->point[k] == b) return (int)k;
    return -1;
}

static bool is_joined(const voronoi_sites *sites, uint32_t a, uint32_t b, double *length)
{
    return vec3_dot(sites->normal[a], sites->normal[b]) > VORONOI_OTHER_SIDE &&
           voronoi_edge(sites, a, b, length);
}

static double cotangent_at(const voronoi_sites *sites, uint32_t p, uint32_t a, uint32_t b)
{
    vec3 u = vec3_sub(sites->position[a], sites->position[p]);
    vec3 v = vec3_sub(sites->position[b], sites->position[p]);
    return vec3_dot(u, v) / vec3_norm(vec3_cross(u, v));
}

/* Of an edge of a star that is not clear: that of its two triangles, where it has two, or its pair's. */
static double length_by_triangles(const voronoi_sites *sites, uint32_t a, uint32_t b,
                                  const voronoi_star *star, double length)
{
    double sum = 0, other;
    int triangles = 0;
    for (uint32_t k = 0; k < star->count; k++)
        if (star->point[k] != b && is_joined(sites, b, star->point[k], &other)) {
            sum += cotangent_at(sites, star->point[k], a, b);
            triangles++;
        }
    vec3 r = vec3_sub(sites->position[a], sites->position[b]);
    return triangles == 2 && star->count <= 32 ? fmax(0.5 * vec3_norm(r) * sum, 0) : length;
}

/* Every listed point is in the star exactly if its pair has an edge, in a clear star of the same length. */
static void compare_star(const voronoi_sites *sites, uint32_t a, const voronoi_star *star, bool clear)
{
    const uint32_t *list = neighbours_list(sites->near, a);
    uint32_t edges = 0;
    for (uint32_t k = 0; k < sites->near->list_count[a]; k++) {
        uint32_t b = list[k];
        double length = 0;
        bool joined = is_joined(sites, a, b, &length);
        int at = find_in_star(star, b);
        if (joined != (at >= 0)) fail_msg("points %u, %u: %d by their pair, star has %d", a, b, joined, at);
        edges += joined;
        if (!joined) continue;
        assert_int_equal(star->place[at], k);
        if (!clear) length = length_by_triangles(sites, a, b, star, length);
        assert_close(star->edge[at], length, 1e-9 * sites->spacing[a]);
        assert_close(star->distance[at], vec3_norm(vec3_sub(sites->position[a], sites->position[b])),
                     1e-12 * sites->spacing[a]);
    }
    assert_int_equal(edges, star->count);
}

/* How many of the stars are clear; all are compared. */
static size_t compare_stars(const set *s)
{
    neighbours *near = list_neighbours(s);
    const voronoi_sites sites = {s->position, s->normal, s->spacing, near};
    size_t clear = 0;
    for (uint32_t a = 0; a < s->count; a++) {
        voronoi_star star;
        bool is_clear = voronoi_star_clear(&sites, a, &star);
        voronoi_star_at(&sites, a, &star);
        compare_star(&sites, a, &star, is_clear);
        clear += is_clear;
    }
    neighbours_free(near);
    return clear;
}

/* What a sheet is bent and shaken by. */
typedef struct bend {
    double k1, k2, twist, cubic; /* z = k1 x^2 / 2 + k2 y^2 / 2 + twist x y + cubic x^3 / 6 */
    double roof;                 /* and - roof |x| */
    double shake;                /* of the lattice, in spacings */
    double tilt;                 /* of the normals, at random */
    double growth;               /* spacing 1 + growth x */
    double height;               /* of the lattice's rows over spacing: sqrt(3) / 2 for hexagons */
    double offset;               /* of every other row: 1 / 2 for hexagons */
} bend;

static void make_sheet(set *s, const bend *b, rng *r)
{
    s->count = SHEET;
    for (int k = 0; k < SHEET; k++) {
        int i = k % SIDE, j = k / SIDE;
        vec3 noise = random_between(r, (vec3){-b->shake, -b->shake, 0}, (vec3){b->shake, b->shake, 0});
        double scale = exp(b->growth * (i - SIDE / 2)), x = i - SIDE / 2 + b->offset * (j & 1) + noise.x;
        double y = (j - SIDE / 2) * b->height + noise.y;
        if (b->growth > 0) { /* a conformal map, so that cells keep their shapes */
            double angle = b->growth * y, radius = exp(b->growth * x) / b->growth;
            x = radius * cos(angle) - 1 / b->growth;
            y = radius * sin(angle);
        }
        double z = 0.5 * b->k1 * x * x + 0.5 * b->k2 * y * y + b->twist * x * y + b->cubic * x * x * x / 6;
        vec3 slope = {b->k1 * x + b->twist * y + 0.5 * b->cubic * x * x - copysign(b->roof, x),
                      b->k2 * y + b->twist * x, 0};
        vec3 tilt = random_between(r, (vec3){-b->tilt, -b->tilt, 0}, (vec3){b->tilt, b->tilt, 0});
        s->position[k] = (vec3){x, y, z - b->roof * fabs(x)};
        s->normal[k] = vec3_unit((vec3){tilt.x - slope.x, tilt.y - slope.y, 1});
        s->spacing[k] = scale;
    }
}

static double random_within(rng *r, double low, double high)
{
    return low + (high - low) * rng_uniform(r);
}

static const double HEXAGONS = 0.86602540378443865;

static void bent_sheets_agree(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    set *s = calloc(1, sizeof *s);
    size_t clear = 0, all = 0;
    for (int round = 0; round < 400; round++) {
        double most = random_within(&r, 0, 0.3);
        bend b = {.k1 = random_within(&r, -most, most),
                  .k2 = random_within(&r, -most, most),
                  .twist = random_within(&r, -most, most),
                  .cubic = random_within(&r, -most, most) * 0.1,
                  .roof = round % 3 == 1 ? random_within(&r, -0.5, 0.5) : 0,
                  .shake = random_within(&r, 0, 0.4),
                  .tilt = round % 3 == 2 ? random_within(&r, 0, 0.15) : 0,
                  .growth = round % 4 == 3 ? random_within(&r, 0.001, 0.05) : 0,
                  .height = random_within(&r, 0.75, 1),
                  .offset = random_within(&r, 0.3, 0.5)};
        make_sheet(s, &b, &r);
        clear += compare_stars(s);
        all += s->count;
    }
    assert_in_range(clear, all / 20, all);
    free(s);
}

/* All of a lattice's inner points are clear, though a little shaken; none of squares, whose diagonals tie. */
static void lattices_are_clear_or_not(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    set *s = calloc(1, sizeof *s);
    const bend hexagons = {.shake = 0.05, .height = HEXAGONS, .offset = 0.5, .k1 = 0.02, .k2 = -0.01};
    make_sheet(s, &hexagons, &r);
    assert_in_range(compare_stars(s), (SIDE - 4) * (SIDE - 4), SHEET);
    for (int k = 0; k < 3; k++) {
        const bend squares = {.shake = k * 1e-3, .height = 1};
        make_sheet(s, &squares, &r);
        assert_int_equal(compare_stars(s), 0);
    }
    free(s);
}

/* Points of a shape no closer than `least` spacings, as many as come of it: as coarse, no packing at all. */
static void scatter(set *s, int shape, double spacing, double least, rng *r)
{
    error e = {0};
    analytic *a = analytic_new(&shapes[shape], NULL, &e);
    if (!a) fail_msg("%s", e.message);
    const project_limits limits = {20, 1e-9, 1e-9, 1e-9};
    s->count = 0;
    for (int draw = 0; draw < 20000 && s->count < MOST; draw++) {
        vec3 x = random_between(r, a->base.domain.min, a->base.domain.max), n;
        if (!project_point(&a->base, &limits, &x, &n)) continue;
        bool free_place = true;
        for (size_t k = 0; k < s->count && free_place; k++)
            free_place = vec3_norm2(vec3_sub(x, s->position[k])) > least * least * spacing * spacing;
        if (!free_place) continue;
        s->position[s->count] = x;
        s->normal[s->count] = n;
        s->spacing[s->count++] = spacing;
    }
    analytic_free(a);
}

static void shapes_agree(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    set *s = calloc(1, sizeof *s);
    for (int shape = 0; shape < SHAPE_COUNT; shape++)
        for (int coarse = 0; coarse < 3; coarse++) {
            double spacing = (shape == 0 ? 3 : 0.6) * (0.05 + 0.05 * coarse);
            scatter(s, shape, spacing, 0.7, &r);
            assert_in_range(s->count, 20, MOST);
            size_t clear = compare_stars(s);
            if (shape == 0 && coarse == 0) assert_in_range(clear, 20, s->count);
        }
    free(s);
}

/* Points in one place, in a row, and alone: no star of theirs is clear, and nothing breaks. */
static void degenerate_sets_agree(void **state)
{
    (void)state;
    set *s = calloc(1, sizeof *s);
    s->count = 60;
    for (uint32_t k = 0; k < s->count; k++) {
        s->position[k] = (vec3){k < 20 ? 0 : k < 40 ? 10 + 0.3 * k : 100 + 10.0 * k, 0, 0};
        s->normal[k] = (vec3){0, 0, 1};
        s->spacing[k] = 1;
    }
    assert_int_equal(compare_stars(s), 0);
    free(s);
}

/* The corners of a hole wider than the lists reach are not joined across it. */
static void holes_are_seen_across(void **state)
{
    (void)state;
    enum { CORNERS = 8 };
    set *s = calloc(1, sizeof *s);
    s->count = CORNERS;
    for (int k = 0; k < CORNERS; k++) {
        double angle = 2 * M_PI * k / CORNERS;
        s->position[k] = (vec3){1.3 * cos(angle), (1.3 + 0.01 * (k % 2)) * sin(angle), 0};
        s->normal[k] = (vec3){0, 0, 1};
        s->spacing[k] = 1;
    }
    neighbours *near = list_neighbours(s);
    const voronoi_sites sites = {s->position, s->normal, s->spacing, near};
    double length;
    size_t across = 0;
    for (uint32_t a = 0; a < CORNERS; a++)
        for (uint32_t b = a + 1; b < CORNERS; b++)
            if (b != a + 1 && b + 1 != a + CORNERS) across += voronoi_edge(&sites, a, b, &length);
    assert_in_range(across, 0, CORNERS - 3); /* the diagonals of a triangulation, at most */
    neighbours_free(near);
    free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bent_sheets_agree),     cmocka_unit_test(lattices_are_clear_or_not),
        cmocka_unit_test(shapes_agree),          cmocka_unit_test(degenerate_sets_agree),
        cmocka_unit_test(holes_are_seen_across),
    };
    return cmocka_run_group_tests_name("voronoi", tests, NULL, NULL);
}
