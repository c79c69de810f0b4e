// SPDX-License-Identifier: Apache-2.0
/* Random points on random meshes: the measures against a program that compares all triangles, points and
 * places with each other.
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
#include "lattice_scenes.h"
#include "shapes.h"

enum { MOST_POINTS = 96, MOST_CORNERS = 3 + MOST_POINTS, PLACES = 24 };
/* Cosine up to which a place and a point are on opposite walls, minimum length of a side, and distance of a
 * missing place (MEASURES.md). */
static const double OPPOSITE = -0.4, SIDE = 1e-4, MISSING = 1.2;

/* ---- the exhaustive program */

typedef struct brute {
    const scene *s;
    int piece_of_point[MOST_POINTS];
    int normals[MOST_POINTS];
    vec3 normal[MOST_POINTS][8];
    double angle[MOST_POINTS]; /* of the surface around each point */
    int *piece;                /* of each triangle */
    double area[MOST_POINTS], side[MOST_POINTS][MOST_POINTS];
} brute;

static vec3 corner_of(const scene *s, size_t t, int k)
{
    return s->vertex[s->triangle[t][k]];
}

static vec3 cross_of(const scene *s, size_t t)
{
    const vec3 a = corner_of(s, t, 0);
    return vec3_cross(vec3_sub(corner_of(s, t, 1), a), vec3_sub(corner_of(s, t, 2), a));
}

static bool share_edge(const scene *s, size_t t, size_t u)
{
    int shared = 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) shared += s->triangle[t][i] == s->triangle[u][k];
    return shared >= 2;
}

static void find_pieces(brute *b)
{
    const size_t n = b->s->triangles;
    bool changed = true;
    for (size_t t = 0; t < n; t++) b->piece[t] = (int)t;
    while (changed) {
        changed = false;
        for (size_t t = 0; t < n; t++)
            for (size_t u = 0; u < n; u++)
                if (b->piece[t] < b->piece[u] && share_edge(b->s, t, u)) {
                    b->piece[u] = b->piece[t];
                    changed = true;
                }
    }
}

/* Whether x lies on a triangle: in its plane and on the inner side of each edge. */
static bool is_on(const scene *s, size_t t, vec3 x)
{
    const vec3 n = vec3_unit(cross_of(s, t));
    if (fabs(vec3_dot(n, vec3_sub(x, corner_of(s, t, 0)))) > SCENE_ON) return false;
    for (int k = 0; k < 3; k++) {
        const vec3 a = corner_of(s, t, k),
                   inner = vec3_unit(vec3_cross(n, vec3_sub(corner_of(s, t, (k + 1) % 3), a)));
        if (vec3_dot(inner, vec3_sub(x, a)) < -SCENE_ON) return false;
    }
    return true;
}

/* The angle at x of a triangle that contains x. */
static double angle_at(const scene *s, size_t t, vec3 x)
{
    double on_edge = 2 * M_PI;
    for (int k = 0; k < 3; k++) {
        const vec3 a = corner_of(s, t, k), ab = vec3_sub(corner_of(s, t, (k + 1) % 3), a),
                   ac = vec3_sub(corner_of(s, t, (k + 2) % 3), a), ax = vec3_sub(x, a);
        if (vec3_norm(ax) <= SCENE_ON) return acos(vec3_dot(vec3_unit(ab), vec3_unit(ac)));
        if (vec3_norm(vec3_cross(vec3_unit(ab), ax)) <= SCENE_ON) on_edge = M_PI;
    }
    return on_edge;
}

static void find_normals(brute *b)
{
    for (size_t i = 0; i < b->s->points; i++)
        for (size_t t = 0; t < b->s->triangles; t++) {
            if (!is_on(b->s, t, b->s->point[i])) continue;
            assert_in_range(b->normals[i], 0, 7);
            b->normal[i][b->normals[i]++] = vec3_unit(cross_of(b->s, t));
            b->piece_of_point[i] = b->piece[t];
            b->angle[i] += angle_at(b->s, t, b->s->point[i]);
        }
}

static bool faces(const brute *b, size_t i, vec3 n)
{
    for (int k = 0; k < b->normals[i]; k++)
        if (vec3_dot(b->normal[i][k], n) > OPPOSITE) return true;
    return false;
}

static bool face_each_other(const brute *b, size_t i, size_t j)
{
    for (int k = 0; k < b->normals[i]; k++)
        if (faces(b, j, b->normal[i][k])) return true;
    return false;
}

typedef struct cut {
    int count;
    vec3 corner[MOST_CORNERS];
    int behind[MOST_CORNERS]; /* the point on the other side of the edge to the next corner, or -1 */
} cut;

/* Keeps the part that is nearer to p than to q. */
static void keep_nearer(cut *c, vec3 p, vec3 q, int behind)
{
    const vec3 n = vec3_sub(q, p), middle = vec3_scale(vec3_add(p, q), 0.5);
    cut out = {0};
    for (int k = 0; k < c->count; k++) {
        const int next = (k + 1) % c->count;
        const double here = vec3_dot(n, vec3_sub(c->corner[k], middle)),
                     there = vec3_dot(n, vec3_sub(c->corner[next], middle));
        if (here <= 0) {
            out.corner[out.count] = c->corner[k];
            out.behind[out.count++] = c->behind[k];
        }
        if ((here <= 0) == (there <= 0)) continue;
        out.corner[out.count] =
            vec3_axpy(here / (here - there), vec3_sub(c->corner[next], c->corner[k]), c->corner[k]);
        out.behind[out.count++] = here <= 0 ? behind : c->behind[k];
    }
    *c = out;
}

static void add_cell(brute *b, size_t t, size_t i)
{
    const scene *s = b->s;
    const vec3 n = vec3_unit(cross_of(s, t));
    if (b->piece_of_point[i] != b->piece[t] || !faces(b, i, n)) return;
    cut c = {.count = 3};
    for (int k = 0; k < 3; k++) {
        c.corner[k] = corner_of(s, t, k);
        c.behind[k] = -1;
    }
    for (size_t j = 0; j < s->points && c.count > 0; j++)
        if (j != i && b->piece_of_point[j] == b->piece[t] && faces(b, j, n))
            keep_nearer(&c, s->point[i], s->point[j], (int)j);
    for (int k = 2; k < c.count; k++)
        b->area[i] += 0.5 * vec3_norm(vec3_cross(vec3_sub(c.corner[k - 1], c.corner[0]),
                                                 vec3_sub(c.corner[k], c.corner[0])));
    for (int k = 0; k < c.count; k++)
        if (c.behind[k] >= 0)
            b->side[i][c.behind[k]] += vec3_norm(vec3_sub(c.corner[(k + 1) % c.count], c.corner[k]));
}

static brute *solve(const scene *s)
{
    brute *b = calloc(1, sizeof *b);
    assert_non_null(b);
    assert_in_range(s->points, 1, MOST_POINTS);
    b->s = s;
    b->piece = calloc(s->triangles, sizeof *b->piece);
    assert_non_null(b->piece);
    find_pieces(b);
    find_normals(b);
    for (size_t t = 0; t < s->triangles; t++)
        for (size_t i = 0; i < s->points; i++) add_cell(b, t, i);
    return b;
}

/* ---- comparison */

static double pair_mean(const scene *s, size_t i, size_t j)
{
    return 0.5 * (s->spacing[i] + s->spacing[j]);
}

/* Cells and sides are equal to rounding, and the degree except for sides near the minimum length. */
static void compare_cells(const brute *b, const double *local, const double *degree)
{
    const scene *s = b->s;
    for (size_t i = 0; i < s->points; i++) {
        int least = 0, most = 0;
        for (size_t j = 0; j < s->points; j++) {
            const double length = fmax(b->side[i][j], b->side[j][i]) / pair_mean(s, i, j);
            least += length > 1.1 * SIDE;
            most += length > 0.9 * SIDE;
        }
        if (degree[i] < least || degree[i] > most)
            fail_msg("point %zu has degree %g, not %d to %d", i, degree[i], least, most);
        const double cell = sqrt(0.75) * local[i] * local[i] * b->angle[i] / (2 * M_PI);
        if (b->area[i] > 0) assert_close(cell, b->area[i], 1e-8 * s->spacing[i] * s->spacing[i]);
    }
}

static void compare_pairs(const brute *b, const measures *got)
{
    const scene *s = b->s;
    size_t close = 0, coincident = 0;
    double least = INFINITY;
    for (size_t i = 0; i < s->points; i++) {
        double nearest = INFINITY;
        for (size_t j = 0; j < s->points; j++)
            if (j != i && b->piece_of_point[i] == b->piece_of_point[j] && face_each_other(b, i, j))
                nearest = fmin(nearest, vec3_norm(vec3_sub(s->point[i], s->point[j])) / pair_mean(s, i, j));
        close += nearest < 0.25;
        coincident += nearest < 1e-3;
        least = fmin(least, nearest);
    }
    assert_close(got->close_share, (double)close / (double)s->points, 1e-12);
    assert_true(got->coincident == coincident);
    if (least < 1.7)
        assert_close(got->min_spacing_ratio, least, 1e-6); /* pairs are compared up to the support */
}

/* A place of a triangle that is divided into PLACES^2 parts: the centre of part (i, k), on either side of the
 * diagonal of a parallelogram. */
static vec3 place_of(const scene *s, size_t t, int i, int k, bool upper)
{
    const vec3 a = corner_of(s, t, 0), ab = vec3_sub(corner_of(s, t, 1), a),
               ac = vec3_sub(corner_of(s, t, 2), a);
    const double more = upper ? 2.0 / 3 : 1.0 / 3;
    return vec3_axpy((i + more) / PLACES, ab, vec3_axpy((k + more) / PLACES, ac, a));
}

/* Distances of places from the nearest points. */
typedef struct gaps {
    /* the largest distance, and the largest distance of places from the corners of their parts */
    double farthest, radius;
    double least_area, most_area; /* bounds of the missing area */
} gaps;

static void look_at_place(const brute *b, vec3 x, vec3 n, double area, double radius, gaps *g)
{
    double any = INFINITY, facing = INFINITY;
    for (size_t i = 0; i < b->s->points; i++) {
        const double d = vec3_norm(vec3_sub(x, b->s->point[i])) / b->s->spacing[i];
        any = fmin(any, d);
        if (faces(b, i, n)) facing = fmin(facing, d);
    }
    g->farthest = fmax(g->farthest, any);
    g->radius = fmax(g->radius, radius);
    if (facing - radius > MISSING) g->least_area += area;
    if (facing + radius > MISSING) g->most_area += area;
}

/* With one spacing for all points, the distance of a place changes at most by the displacement of the
 * place. */
static void compare_gaps(const brute *b, const measures *got)
{
    const scene *s = b->s;
    gaps g = {0};
    double whole = 0;
    for (size_t t = 0; t < s->triangles; t++) {
        const vec3 cross = cross_of(s, t), n = vec3_unit(cross),
                   middle = vec3_scale(
                       vec3_add(corner_of(s, t, 0), vec3_add(corner_of(s, t, 1), corner_of(s, t, 2))),
                       1.0 / 3);
        const double area = 0.5 * vec3_norm(cross);
        double radius = 0;
        for (int k = 0; k < 3; k++) radius = fmax(radius, vec3_norm(vec3_sub(corner_of(s, t, k), middle)));
        whole += area;
        for (int i = 0; i < PLACES; i++)
            for (int k = 0; k < PLACES - i; k++) {
                look_at_place(b, place_of(s, t, i, k, false), n, area / (PLACES * PLACES),
                              radius / (PLACES * s->spacing[0]), &g);
                if (k + 1 < PLACES - i)
                    look_at_place(b, place_of(s, t, i, k, true), n, area / (PLACES * PLACES),
                                  radius / (PLACES * s->spacing[0]), &g);
            }
    }
    if (got->coverage < g.farthest - 0.02 || got->coverage > g.farthest + g.radius)
        fail_msg("coverage %g, not %g to %g", got->coverage, g.farthest - 0.02, g.farthest + g.radius);
    if (got->missing_share < g.least_area / whole - 1e-3 || got->missing_share > g.most_area / whole + 1e-3)
        fail_msg("missing_share %g, not %g to %g", got->missing_share, g.least_area / whole,
                 g.most_area / whole);
}

static void compare(scene *s)
{
    double local[MOST_POINTS], degree[MOST_POINTS];
    const scene_options options = {.local = local, .degree = degree};
    brute *b = solve(s);
    const measures got = scene_measure(s, &options);
    compare_cells(b, local, degree);
    compare_pairs(b, &got);
    bool even = true;
    for (size_t i = 1; i < s->points; i++) even &= s->spacing[i] == s->spacing[0];
    if (even) compare_gaps(b, &got);
    free(b->piece);
    free(b);
}

/* ---- random surfaces */

static double between(rng *r, double low, double high)
{
    return low + (high - low) * rng_uniform(r);
}

static double area_of(const scene *s)
{
    double sum = 0;
    for (size_t t = 0; t < s->triangles; t++) sum += 0.5 * vec3_norm(cross_of(s, t));
    return sum;
}

/* Sets the spacing that a perfect lattice would have, equal or varying. */
static void set_spacing(scene *s, rng *r, bool even)
{
    const double h = sqrt(2 * area_of(s) / (sqrt(3) * (double)s->points));
    for (size_t i = 0; i < s->points; i++) s->spacing[i] = even ? h : h * between(r, 0.8, 1.25);
}

static void stretch(scene *s, rng *r)
{
    const vec3 by = {between(r, 0.3, 2), between(r, 0.3, 2), between(r, 0.3, 2)};
    for (size_t k = 0; k < s->vertices; k++)
        s->vertex[k] = (vec3){by.x * s->vertex[k].x, by.y * s->vertex[k].y, by.z * s->vertex[k].z};
}

static void roughen(scene *s, rng *r)
{
    for (size_t k = 0; k < s->vertices; k++) s->vertex[k] = vec3_scale(s->vertex[k], between(r, 0.4, 1.4));
}

static scene bare(scene s)
{
    s.points = 0;
    return s;
}

static void try_surface(scene s, rng *r)
{
    for (int round = 0; round < 2; round++) {
        scene with = scene_copy(&s);
        scene_random_points(&with, (size_t)between(r, 4, 60), r);
        set_spacing(&with, r, round == 0);
        compare(&with);
        scene_free(&with);
    }
    scene_free(&s);
}

enum { TRIALS = 8 };

static void points_on_convex_solids_are_measured_as_by_brute_force(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 0);
    for (int k = 0; k < TRIALS; k++) {
        scene s = bare(scene_icosahedron(1));
        stretch(&s, &r);
        try_surface(s, &r);
    }
}

static void points_on_rough_spheres_are_measured_as_by_brute_force(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 1);
    for (int k = 0; k < TRIALS; k++) {
        scene s = scene_sphere(5, 8);
        s.smooth = false;
        roughen(&s, &r);
        try_surface(s, &r);
    }
}

/* Walls are between .02 and 3 spacings thick. */
static void points_on_plates_are_measured_as_by_brute_force(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 2);
    for (int k = 0; k < TRIALS; k++)
        try_surface(bare(scene_plate(4, 5, exp(between(&r, log(0.02), log(3))))), &r);
}

static void points_on_pieces_near_each_other_are_measured_as_by_brute_force(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 3);
    for (int k = 0; k < TRIALS; k++) try_surface(bare(scene_shells(1, between(&r, 0.3, 0.99))), &r);
}

/* Points on the edge of several faces have all of their normals. */
static void points_on_half_planes_are_measured_as_by_brute_force(void **state)
{
    (void)state;
    rng r = rng_seed(test_seed(), 4);
    for (int k = 0; k < TRIALS; k++) {
        double angle[5];
        const int count = 2 + k % 4;
        for (int i = 0; i < count; i++)
            angle[i] = between(&r, 2 * M_PI * i / count, 2 * M_PI * (i + 0.8) / count);
        scene s = scene_half_planes(3, 5, angle, count);
        s.points = 4;
        try_surface(s, &r);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_on_convex_solids_are_measured_as_by_brute_force),
        cmocka_unit_test(points_on_rough_spheres_are_measured_as_by_brute_force),
        cmocka_unit_test(points_on_plates_are_measured_as_by_brute_force),
        cmocka_unit_test(points_on_pieces_near_each_other_are_measured_as_by_brute_force),
        cmocka_unit_test(points_on_half_planes_are_measured_as_by_brute_force),
    };
    return cmocka_run_group_tests_name("measures_random", tests, NULL, NULL);
}
