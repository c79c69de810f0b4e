// SPDX-License-Identifier: Apache-2.0
/* Both ways to measure, certain cells and all cells from triangles, give the same measures and the same outcome of
 * bad results: the faults of test_outcome.c. HEXAD_SCENE_POINTS: points of a lattice, 6 000 by default. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "lattice_scenes.h"
#include "job/report/outcome.h"

static int across; /* spacings per side; the even number of rows is larger by 1 / ROW */

static int odd_rows(void)
{
    return 2 * (int)(0.5 * across / ROW) + 1;
}

static double height(void)
{
    return (odd_rows() - 1) * ROW;
}

/* scene_rows without the search for points in the same place. */
static void add_rows(scene *s, double z)
{
    for (int row = 0; row < odd_rows(); row++)
        for (int k = 0; k <= across - row % 2; k++)
            scene_point_again(s, (vec3){k + 0.5 * (row % 2), row * ROW, z});
}

static void add_wall(scene *s, double z)
{
    scene_quad(s, (vec3){0, 0, z}, (vec3){across, 0, z}, (vec3){across, height(), z}, (vec3){0, height(), z});
}

static scene lattice(void)
{
    scene s = {0};
    add_wall(&s, 0);
    add_rows(&s, 0);
    return s;
}

/* Two walls with rims, as scene_plate. */
static scene plate(double thickness)
{
    scene s = scene_plate(1, 3, thickness);
    for (size_t k = 0; k < s.vertices; k++) {
        s.vertex[k].x *= across;
        s.vertex[k].y *= height() / (2 * ROW);
    }
    s.points = 0;
    add_rows(&s, 0);
    add_rows(&s, thickness);
    return s;
}

static bool is_within(double a, double b, double bound)
{
    return fabs(a - b) <= bound + 1e-12;
}

static void assert_same(const char *name, const measures *a, const measures *b)
{
    const struct {
        const char *name;
        double a, b, bound;
    } all[] = {{"hex_fraction", a->hex_fraction, b->hex_fraction, 0.002},
               {"edge_cv", a->edge_cv, b->edge_cv, 0.001},
               {"area_cv", a->area_cv, b->area_cv, 0.001},
               {"energy_excess", a->energy_excess, b->energy_excess, 0.001},
               {"disorder", a->disorder, b->disorder, 0.001},
               {"min_spacing_ratio", a->min_spacing_ratio, b->min_spacing_ratio, 1e-6},
               {"coverage", a->coverage, b->coverage, 0.02},
               {"missing_share", a->missing_share, b->missing_share, 1e-4},
               {"close_share", a->close_share, b->close_share, 1e-4},
               {"unmeasured_share", a->unmeasured_share, b->unmeasured_share, 1e-4},
               {"coincident", (double)a->coincident, (double)b->coincident, 0},
               {"thin_count", (double)a->thin_count, (double)b->thin_count, 0},
               {"euler", a->euler, b->euler, 1e-6},
               {"parts_without_points", (double)a->parts_without_points, (double)b->parts_without_points, 0}};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        if (!is_within(all[k].a, all[k].b, all[k].bound))
            fail_msg("%s: %s is %g, from triangles %g", name, all[k].name, all[k].a, all[k].b);
}

static outcome_kind outcome_of(const measures *m)
{
    static const spec_requirement none[SPEC_REQUIRE_COUNT];
    const outcome_input in = {
        .measures = m, .step_tolerance = 1, .gain_tolerance = 1, .energy_tolerance = 1, .require = none};
    return outcome_evaluate(&in).outcome;
}

/* Prints the shares of certain cells, for measurements. */
static void check(const char *name, scene s, outcome_kind expected)
{
    const measures certain = scene_measure(&s, NULL),
                   exact = scene_measure(&s, &(scene_options){.exact = true});
    scene_free(&s);
    print_message("%s: %.4f of the cells are certain\n", name, certain.certain_share);
    assert_same(name, &certain, &exact);
    assert_string_equal(outcome_names[outcome_of(&certain)], outcome_names[outcome_of(&exact)]);
    assert_string_equal(outcome_names[outcome_of(&certain)], outcome_names[expected]);
}

/* ---- faults */

typedef struct region {
    vec3 low, high;
    rng *random; /* NULL: all points in the box; else half of them */
} region;

static bool in_region(vec3 x, const void *context)
{
    const region *r = context;
    return x.x > r->low.x && x.y > r->low.y && x.z > r->low.z && x.x < r->high.x && x.y < r->high.y &&
           x.z < r->high.z && (!r->random || rng_uniform(r->random) < 0.5);
}

static scene without(scene s, region r)
{
    scene_remove(&s, in_region, &r);
    return s;
}

/* Copies of all points of the box, displaced by `by`. */
static scene with_copies(scene s, region r, vec3 by)
{
    const size_t count = s.points;
    for (size_t k = 0; k < count; k++)
        if (in_region(s.point[k], &r)) scene_point_again(&s, vec3_add(s.point[k], by));
    return s;
}

static region middle(double half_width, double half_height)
{
    const double x = across / 2 + 0.25, y = odd_rows() / 4 * 2 * ROW;
    return (region){{x - half_width, y - half_height, -1}, {x + half_width, y + half_height, 1}, NULL};
}

static void perfect_lattices_agree(void **state)
{
    (void)state;
    check("lattice", lattice(), OUTCOME_CONVERGED);
    check("plate of half a spacing", plate(0.5), OUTCOME_CONVERGED);
}

static void results_with_gaps_agree(void **state)
{
    (void)state;
    rng r = rng_seed(1, 0);
    const region all = {{-1, -1, -1}, {2.0 * across, 2.0 * across, 1}, &r};
    check("a hole", without(lattice(), middle(1.6, 0.9)), OUTCOME_UNRESOLVED);
    check("a wide hole", without(lattice(), middle(4, 4)), OUTCOME_UNRESOLVED);
    check("half of the points lost", without(lattice(), all), OUTCOME_UNRESOLVED);
    check("a half without points", without(lattice(), middle(across, 0.25 * across)), OUTCOME_UNRESOLVED);
    check("a sparse strip", without(lattice(), middle(across, 1.5)), OUTCOME_UNRESOLVED);
}

static void walls_and_parts_without_points_agree(void **state)
{
    (void)state;
    region below = middle(across, across);
    below.high.z = 0.2;
    check("a wall without points", without(plate(0.4), below), OUTCOME_UNRESOLVED);
    below.low.y += across;
    check("half a wall without points", without(plate(0.4), below), OUTCOME_UNRESOLVED);
    scene s = lattice();
    add_wall(&s, 9);
    check("a part without points", s, OUTCOME_UNRESOLVED);
}

static void points_too_close_agree(void **state)
{
    (void)state;
    check("a plate a tenth thick", plate(0.1), OUTCOME_UNRESOLVED);
    check("rows beside rows", with_copies(lattice(), middle(across / 2.5, 0.02 * across), (vec3){0.2, 0, 0}),
          OUTCOME_UNRESOLVED);
    check("merged points", with_copies(lattice(), middle(10, 0.1), (vec3){5e-4, 0, 0}), OUTCOME_UNRESOLVED);
    check("two lattices", with_copies(lattice(), middle(across / 2.5, across / 2.5), (vec3){0.1, 0.07, 0}),
          OUTCOME_UNRESOLVED);
}

static void random_points_agree(void **state)
{
    (void)state;
    rng r = rng_seed(2, 0);
    scene s = lattice();
    const size_t count = s.points;
    s.points = 0;
    scene_random_points(&s, count, &r);
    check("random points", s, OUTCOME_UNRESOLVED);
}

/* Cuts a hole into every 200th triangle, away from its edges. Points beside it have cells that the hole makes smaller. */
static scene tube_with_holes(void)
{
    scene tube = scene_tube(24, 31);
    scene s = {.smooth = true};
    for (size_t k = 0; k < tube.points; k++) scene_point_again(&s, tube.point[k]);
    for (size_t k = 0; k < tube.triangles; k++) {
        vec3 c[3], in[3];
        for (int i = 0; i < 3; i++) c[i] = tube.vertex[tube.triangle[k][i]];
        const vec3 centre = vec3_scale(vec3_add(c[0], vec3_add(c[1], c[2])), 1.0 / 3);
        for (int i = 0; i < 3; i++) in[i] = vec3_axpy(0.6, vec3_sub(c[i], centre), centre);
        if (k % 200 != 100)
            scene_triangle(&s, c[0], c[1], c[2]);
        else
            for (int i = 0; i < 3; i++) scene_quad(&s, c[i], c[(i + 1) % 3], in[(i + 1) % 3], in[i]);
    }
    scene_free(&tube);
    return s;
}

static void holes_between_points_agree(void **state)
{
    (void)state;
    check("holes between points", tube_with_holes(), OUTCOME_CONVERGED);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(perfect_lattices_agree),
                                       cmocka_unit_test(results_with_gaps_agree),
                                       cmocka_unit_test(walls_and_parts_without_points_agree),
                                       cmocka_unit_test(points_too_close_agree),
                                       cmocka_unit_test(random_points_agree),
                                       cmocka_unit_test(holes_between_points_agree)};
    const char *given = getenv("HEXAD_SCENE_POINTS");
    across = (int)sqrt(given ? atof(given) : 6000);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
