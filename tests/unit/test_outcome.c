// SPDX-License-Identifier: Apache-2.0
/* The outcome of perfect lattices, and of results with one known fault each. */
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
#include "base/core/memory.h"
#include "job/report/advice.h"
#include "job/report/outcome.h"

static const spec_requirement nothing_required[SPEC_REQUIRE_COUNT];

/* A solve that has converged and met its targets. */
static outcome_input good_solve(const measures *m)
{
    return (outcome_input){.measures = m,
                           .rms_step = 1e-4,
                           .step_left = 1e-4,
                           .step_tolerance = 1e-3,
                           .gain = 1e-4,
                           .gain_tolerance = 1e-3,
                           .energy_error = 1e-4,
                           .energy_tolerance = 1e-3,
                           .residual = 1e-7,
                           .rms_residual = 1e-8,
                           .require = nothing_required};
}

static outcome_result judge_scene(scene *s)
{
    const measures m = scene_measure(s, NULL);
    const outcome_input in = good_solve(&m);
    scene_free(s);
    return outcome_evaluate(&in);
}

static bool has_reason(const outcome_result *v, const char *criterion)
{
    for (size_t k = 0; k < v->reason_count; k++)
        if (strcmp(v->reason[k].criterion, criterion) == 0) return true;
    return false;
}

/* `criteria` are all expected reasons, at most three. */
static void check_reasons(const outcome_result *v, outcome_kind outcome, const char *const criteria[3])
{
    size_t count = 0;
    for (; count < 3 && criteria[count]; count++)
        if (!has_reason(v, criteria[count])) fail_msg("no reason %s", criteria[count]);
    for (size_t k = count; k < v->reason_count; k++)
        if (v->reason_count > count)
            fail_msg("%zu reasons, the last is %s with %g", v->reason_count,
                     v->reason[v->reason_count - 1].criterion, v->reason[v->reason_count - 1].value);
    assert_string_equal(outcome_names[v->outcome], outcome_names[outcome]);
}

static void check_unresolved(scene s, const char *a, const char *b, const char *c)
{
    const char *const criteria[3] = {a, b, c};
    const outcome_result v = judge_scene(&s);
    check_reasons(&v, OUTCOME_UNRESOLVED, criteria);
}

/* ---- good results */

static void points_in_perfect_order_are_converged(void **state)
{
    (void)state;
    const double right[] = {0, M_PI / 2, M_PI, 1.5 * M_PI}, three[] = {0, 2 * M_PI / 3, 4 * M_PI / 3};
    scene all[] = {scene_rectangle(30, 31),
                   scene_open_triangle(12),
                   scene_plate(30, 31, 0.5),
                   scene_plate(20, 21, ROW),
                   scene_cube(5),
                   scene_tube(24, 11),
                   scene_torus(25, 8),
                   scene_tetrahedron(2),
                   scene_octahedron(5),
                   scene_icosahedron(4),
                   scene_half_planes(12, 11, right, 4),
                   scene_half_planes(12, 11, three, 3),
                   scene_shells(4, 0.95)};
    const char *const none[3] = {NULL, NULL, NULL};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) {
        const outcome_result v = judge_scene(&all[k]);
        check_reasons(&v, OUTCOME_CONVERGED, none);
    }
}

/* ---- scenes of faulty results */

typedef struct ball {
    vec3 centre;
    double radius;
} ball;

static bool in_ball(vec3 x, const void *context)
{
    const ball *b = context;
    return vec3_norm(vec3_sub(x, b->centre)) < b->radius;
}

static bool outside_ball(vec3 x, const void *context)
{
    return !in_ball(x, context);
}

/* A half space: n . x > offset. */
typedef struct half_space {
    vec3 n;
    double offset;
} half_space;

static bool beyond(vec3 x, const void *context)
{
    const half_space *h = context;
    return vec3_dot(h->n, x) > h->offset;
}

static bool at_random(vec3 x, const void *context)
{
    (void)x;
    return rng_uniform((rng *)context) < 0.5;
}

static scene without(scene s, vec3 n, double offset)
{
    const half_space h = {n, offset};
    scene_remove(&s, beyond, &h);
    return s;
}

static scene without_ball(scene s, vec3 centre, double radius)
{
    const ball b = {centre, radius};
    scene_remove(&s, in_ball, &b);
    return s;
}

/* Adds `count` points along x, beginning at `from`, one spacing apart. */
static scene with_row(scene s, vec3 from, int count)
{
    for (int k = 0; k < count; k++) scene_point_again(&s, vec3_add(from, (vec3){k, 0, 0}));
    return s;
}

/* ---- one result for each criterion, which no other criterion detects */

/* Four points around the midpoint of an edge are missing: the nearest point is at sqrt(7) / 2, and the area
 * of the hole is 0.02 of a cell. */
static void a_hole_in_a_lattice_fails_coverage(void **state)
{
    (void)state;
    check_unresolved(without_ball(scene_rectangle(30, 31), (vec3){15.5, 14 * ROW, 0}, 0.9), "coverage", NULL,
                     NULL);
}

/* The opposite wall is .3 away, so that distances in space are small. */
static void a_wall_without_points_fails_missing_share(void **state)
{
    (void)state;
    scene s = scene_plate(16, 17, 0.3);
    scene top = without(scene_plate(16, 17, 0.3), (vec3){0, 0, -1}, -0.1);
    scene_free(&s);
    check_unresolved(top, "missing_share", NULL, NULL);
}

static void a_row_beside_a_row_fails_close_share(void **state)
{
    (void)state;
    check_unresolved(with_row(scene_rectangle(30, 31), (vec3){0, 14 * ROW + 0.1, 0}, 31), "close_share", NULL,
                     NULL);
}

/* Two of 947 points are close, which is less than .01. */
static void a_point_on_a_point_fails_coincident(void **state)
{
    (void)state;
    check_unresolved(with_row(scene_rectangle(30, 31), (vec3){10, 0, 0}, 1), "coincident", NULL, NULL);
}

/* The inner shell is .15 inside the outer one, whose points are near and not on an opposite wall. */
static void a_shell_without_points_fails_parts_without_points(void **state)
{
    (void)state;
    scene s = scene_shells(4, 0.95);
    s.points /= 2; /* the points of the outer shell come first */
    check_unresolved(s, "parts_without_points", NULL, NULL);
}

static void three_points_on_a_sphere_fail_unmeasured_share(void **state)
{
    (void)state;
    scene s = scene_sphere(24, 48);
    for (int k = 0; k < 3; k++) scene_point(&s, (vec3){cos(2 * M_PI * k / 3), sin(2 * M_PI * k / 3), 0});
    scene_set_spacing(&s, sqrt(8 * M_PI / (sqrt(3) * 3)));
    check_unresolved(s, "unmeasured_share", NULL, NULL);
}

/* ---- numbers of the solve */

typedef struct solve_fault {
    const char *criterion;
    outcome_kind outcome;
    outcome_input changed; /* members other than 0 replace those of a good solve */
} solve_fault;

static void replace(double *to, double from)
{
    if (from != 0) *to = from;
}

static void a_fault_of_the_solve_is_the_only_reason(void **state)
{
    (void)state;
    const solve_fault faults[] = {
        {"rms_step", OUTCOME_NOT_CONVERGED, {.stopped = true}},
        {"step_left", OUTCOME_NOT_CONVERGED, {.step_left = 0.002}},
        {"gain", OUTCOME_NOT_CONVERGED, {.gain = 0.002}},
        {"target_energy", OUTCOME_NOT_CONVERGED, {.energy_error = 0.002}},
        {"count_error", OUTCOME_NOT_CONVERGED, {.count_error = 1}},
        {"lost", OUTCOME_NOT_CONVERGED, {.lost = 1}},
        {"max_residual", OUTCOME_NOT_CONVERGED, {.residual = 0.0011}},
        {"max_residual", OUTCOME_NOT_CONVERGED, {.residual = NAN}},
        {"lost_area", OUTCOME_UNRESOLVED, {.lost_area = 0.011}},
        {"ringing", OUTCOME_UNRESOLVED, {.ringing = 0.011}},
        {"lost_walls", OUTCOME_UNRESOLVED, {.lost_walls = 0.021}},
    };
    scene s = scene_octahedron(3);
    const measures m = scene_measure(&s, NULL);
    scene_free(&s);
    for (size_t k = 0; k < sizeof faults / sizeof *faults; k++) {
        const outcome_input *c = &faults[k].changed;
        const char *const criteria[3] = {faults[k].criterion};
        outcome_input in = good_solve(&m);
        in.stopped = c->stopped;
        in.count_error = c->count_error;
        in.lost = c->lost;
        replace(&in.step_left, c->step_left);
        replace(&in.gain, c->gain);
        replace(&in.energy_error, c->energy_error);
        replace(&in.residual, c->residual);
        replace(&in.lost_area, c->lost_area);
        replace(&in.ringing, c->ringing);
        replace(&in.lost_walls, c->lost_walls);
        const outcome_result v = outcome_evaluate(&in);
        check_reasons(&v, faults[k].outcome, criteria);
    }
}

static void bounds_of_blue_noise_apply_to_that_pattern_only(void **state)
{
    (void)state;
    const char *const too_close[3] = {"min_spacing_ratio"}, *const too_far[3] = {"relative_coverage"};
    scene s = scene_octahedron(3);
    measures m = scene_measure(&s, NULL);
    scene_free(&s);
    m.min_spacing_ratio = 0.735;
    m.coverage = 0.7;
    outcome_input in = good_solve(&m);
    outcome_result v = outcome_evaluate(&in);
    assert_int_equal(v.outcome, OUTCOME_CONVERGED);
    in.is_blue_noise = true;
    v = outcome_evaluate(&in);
    check_reasons(&v, OUTCOME_NOT_CONVERGED, too_close);
    m.min_spacing_ratio = 0.7395; /* within the tolerance */
    v = outcome_evaluate(&in);
    assert_int_equal(v.outcome, OUTCOME_CONVERGED);
    m.coverage = 0.78;
    v = outcome_evaluate(&in);
    check_reasons(&v, OUTCOME_NOT_CONVERGED, too_far);
}

static const char *message_of(const outcome_result *v, const char *criterion)
{
    for (size_t k = 0; k < v->reason_count; k++)
        if (strcmp(v->reason[k].criterion, criterion) == 0) return v->reason[k].message;
    fail_msg("no reason %s", criterion);
    return NULL;
}

static void a_message_gives_value_and_bound_before_the_advice(void **state)
{
    (void)state;
    scene s = scene_octahedron(3);
    measures m = scene_measure(&s, NULL);
    m.coverage = 1.87;
    m.missing_share = 0.125;
    outcome_input in = good_solve(&m);
    in.lost = 3;
    scene_free(&s);
    const outcome_result v = outcome_evaluate(&in);
    assert_string_equal(
        message_of(&v, "coverage"),
        "coverage: a place of the surface is 1.87 spacings from its nearest point (at most 1.2). Ask for "
        "more points, or for smaller voxels if a mesh is sampled through a level set.");
    assert_non_null(strstr(message_of(&v, "missing_share"), "missing_share: 12.5 % of the area"));
    assert_non_null(strstr(message_of(&v, "missing_share"), "(at most 1 %)"));
    assert_non_null(strstr(message_of(&v, "lost"), "not on the surface is 3, a fault of hexad. Report it"));
}

static void a_solve_that_was_stopped_names_its_limit(void **state)
{
    (void)state;
    scene s = scene_octahedron(3);
    const measures m = scene_measure(&s, NULL);
    outcome_input in = good_solve(&m);
    scene_free(&s);
    in.stopped = true;
    outcome_result v = outcome_evaluate(&in);
    assert_int_equal(v.reason_count, 1);
    assert_non_null(strstr(message_of(&v, "rms_step"), "Raise solver.max_sweeps."));
}

/* A solve that ended by itself does not continue with a higher limit. */
static void points_that_still_move_do_not_require_more_sweeps(void **state)
{
    (void)state;
    scene s = scene_octahedron(3);
    const measures m = scene_measure(&s, NULL);
    outcome_input in = good_solve(&m);
    scene_free(&s);
    in.step_left = 0.00884;
    const outcome_result v = outcome_evaluate(&in);
    assert_int_equal(v.reason_count, 1);
    assert_null(strstr(message_of(&v, "step_left"), "max_sweeps"));
    assert_non_null(strstr(message_of(&v, "step_left"), "use region"));
}

/* The warning about walls on half of the points. The caller frees it. */
static char *walls_text(const spec *s, advice_resolution to)
{
    json *advice = json_new_array(), *warnings = json_new_array();
    advice_put_walls(advice, warnings, s, 0.5, false, to);
    json_at list = json_root(warnings), none = json_root(advice);
    assert_true(json_size(list) == 1 && json_size(none) == 0);
    char *text = mem_strdup(json_string(json_first(&list), ""));
    json_free(advice);
    json_free(warnings);
    return text;
}

/* What matters only to triangles between the points is advice, not a warning. */
static void walls_of_a_represented_surface_are_advice(void **state)
{
    (void)state;
    const spec s = {.surface = {.kind = SPEC_SURFACE_MESH}};
    json *advice = json_new_array(), *warnings = json_new_array();
    advice_put_walls(advice, warnings, &s, 0.5, true, advice_resolve(1, 1000, 0.5, 0));
    json_at list = json_root(advice), item = json_first(&list), none = json_root(warnings);
    assert_true(json_size(list) == 1 && json_size(none) == 0);
    assert_string_equal(json_string(json_member(&item, "code"), ""), "thin_walls");
    assert_non_null(strstr(json_string(json_member(&item, "message"), ""),
                           "This matters only if triangles are made from the points alone."));
    json_free(advice);
    json_free(warnings);
}

/* A factor of 0 or NAN without a limit is unknown: the count is a number that a spec accepts. */
static void an_unknown_factor_gives_a_count(void **state)
{
    (void)state;
    const double unknown[] = {0, (double)NAN, 1};
    for (int k = 0; k < 3; k++) {
        const advice_resolution to = advice_resolve(1, 1000, unknown[k], 0);
        assert_true(to.count == 4000 && to.spacing > 0 && !to.reached);
    }
}

/* More points than separate walls of half a voxel are not advised, whatever the distance of the walls. */
static void a_resolution_is_not_finer_than_the_data(void **state)
{
    (void)state;
    const spec s = {.surface = {.kind = SPEC_SURFACE_VOLUME}};
    const double area = 1000, thinnest = 0.12;
    const size_t count[] = {1000, 10000, 100000};
    const advice_resolution first = advice_resolve(area, 1000, 1e-6, thinnest);
    for (int k = 0; k < 3; k++) {
        const advice_resolution to = advice_resolve(area, count[k], 0.001 * k, thinnest);
        assert_true(to.of_voxels && !to.reached && fabs(to.count / first.count - 1) < 0.02);
        assert_true(to.spacing < thinnest / 1.2 && to.spacing > 0.8 * thinnest / 1.2);
        assert_true(advice_resolve(area, count[k], 0.001, 0).count > 1e8);
    }
    const advice_resolution coarser = advice_resolve(area, 1000, 0.5, thinnest),
                            beyond = advice_resolve(area, 1000000, 0.5, thinnest);
    assert_true(!coarser.of_voxels && coarser.count == 4000);
    assert_true(beyond.reached);
    char *of_first = walls_text(&s, first), *of_beyond = walls_text(&s, beyond);
    assert_non_null(strstr(of_first, "walls of half a voxel, the thinnest that the data determine, ask for"));
    assert_non_null(strstr(of_beyond, "which the data do not determine: smooth the input"));
    assert_null(strstr(of_beyond, "ask for"));
    free(of_first);
    free(of_beyond);
}

/* The spec refuses a region of labels. */
static void a_resolution_beyond_all_counts_is_not_advised_a_region_of_labels(void **state)
{
    (void)state;
    const advice_resolution to = {.spacing = 0.001, .count = 2e9};
    spec s = {.surface = {.kind = SPEC_SURFACE_MESH}};
    char *of_mesh = walls_text(&s, to);
    s.surface.kind = SPEC_SURFACE_LABELS;
    char *of_labels = walls_text(&s, to);
    assert_non_null(
        strstr(of_mesh, "maximum of 100000000 points: smooth the input, or sample a region of it."));
    assert_null(strstr(of_labels, "region"));
    assert_non_null(strstr(of_labels, "smooth the labels with surface.labels.majority, or merge"));
    free(of_mesh);
    free(of_labels);
}

static void a_step_that_is_not_known_fails_nothing(void **state)
{
    (void)state;
    const char *const none[3] = {NULL, NULL, NULL};
    scene s = scene_octahedron(3);
    const measures m = scene_measure(&s, NULL);
    outcome_input in = good_solve(&m);
    in.step_left = NAN;
    scene_free(&s);
    const outcome_result v = outcome_evaluate(&in);
    check_reasons(&v, OUTCOME_CONVERGED, none);
}

static void a_solve_that_still_moves_outranks_gaps(void **state)
{
    (void)state;
    const char *const both[3] = {"coverage", "rms_step"};
    scene s = without_ball(scene_rectangle(30, 31), (vec3){15.5, 14 * ROW, 0}, 0.9);
    const measures m = scene_measure(&s, NULL);
    outcome_input in = good_solve(&m);
    in.stopped = true;
    scene_free(&s);
    const outcome_result v = outcome_evaluate(&in);
    check_reasons(&v, OUTCOME_NOT_CONVERGED, both);
}

/* ---- outcome.require */

static void a_requirement_that_is_missed_is_a_reason(void **state)
{
    (void)state;
    const char *const hex[3] = {"hex_fraction"}, *const none[3] = {NULL};
    spec_requirement require[SPEC_REQUIRE_COUNT] = {0};
    scene s = scene_rectangle(30, 31); /* hex_fraction .9387 */
    const measures m = scene_measure(&s, NULL);
    outcome_input in = good_solve(&m);
    scene_free(&s);
    in.require = require;
    require[SPEC_REQUIRE_HEX_FRACTION] = (spec_requirement){true, 0.95};
    outcome_result v = outcome_evaluate(&in);
    check_reasons(&v, OUTCOME_UNRESOLVED, hex);
    assert_non_null(
        strstr(message_of(&v, "hex_fraction"), "the measure is 0.939 (outcome.require: at least 0.95)."));
    require[SPEC_REQUIRE_HEX_FRACTION].bound = 0.93;
    require[SPEC_REQUIRE_COVERAGE] = (spec_requirement){true, 0.6};
    v = outcome_evaluate(&in);
    check_reasons(&v, OUTCOME_CONVERGED, none);
}

/* ---- other bad results */

static void half_of_the_points_lost_at_random_leave_gaps(void **state)
{
    (void)state;
    rng r = rng_seed(1, 0);
    scene s = scene_rectangle(30, 31);
    scene_remove(&s, at_random, &r);
    check_unresolved(s, "coverage", "missing_share", NULL);
}

static void a_half_without_points_leaves_a_gap(void **state)
{
    (void)state;
    check_unresolved(without(scene_rectangle(30, 31), (vec3){1, 0, 0}, 15.2), "coverage", "missing_share",
                     NULL);
}

static void a_wide_hole_leaves_a_gap(void **state)
{
    (void)state;
    check_unresolved(without_ball(scene_rectangle(30, 31), (vec3){15, 13, 0}, 4), "coverage", "missing_share",
                     NULL);
}

static void a_corner_without_points_leaves_a_gap(void **state)
{
    (void)state;
    check_unresolved(without_ball(scene_cube(5), (vec3){0, 0, 0}, 1.9), "coverage", "missing_share", NULL);
}

static void a_face_of_a_cube_without_points_leaves_a_gap(void **state)
{
    (void)state;
    check_unresolved(without(scene_cube(6), (vec3){0, 0, 1}, 5.5), "coverage", "missing_share", NULL);
}

static void a_ring_without_points_leaves_a_gap(void **state)
{
    (void)state;
    scene s = scene_tube(24, 11);
    scene below = without(scene_copy(&s), (vec3){0, 0, 1}, 3.5);
    for (size_t k = 0; k < s.points; k++)
        if (s.point[k].z > 5.9) scene_point(&below, s.point[k]);
    scene_free(&s);
    check_unresolved(below, "coverage", "missing_share", NULL);
}

static void an_end_of_a_torus_without_points_leaves_a_gap(void **state)
{
    (void)state;
    check_unresolved(without(scene_torus(25, 8), (vec3){1, 0, 0}, 3), "coverage", "missing_share", NULL);
}

static void a_half_plane_without_points_leaves_a_gap(void **state)
{
    (void)state;
    const double angle[] = {0, M_PI / 2, M_PI, 1.5 * M_PI};
    check_unresolved(without(scene_half_planes(12, 11, angle, 4), (vec3){0, 0, 1}, 0.1), "coverage",
                     "missing_share", NULL);
}

/* As on fins: the strips between rows 3 and 7 have no points. */
static void a_sparse_strip_leaves_a_gap(void **state)
{
    (void)state;
    scene s = scene_rectangle(20, 21), sparse = scene_rectangle(20, 21);
    sparse.points = 0;
    for (size_t k = 0; k < s.points; k++)
        if (s.point[k].y < 3.1 * ROW || s.point[k].y > 6.9 * ROW) scene_point(&sparse, s.point[k]);
    scene_free(&s);
    check_unresolved(sparse, "coverage", "missing_share", NULL);
}

static void a_far_piece_without_points_is_a_part_and_a_gap(void **state)
{
    (void)state;
    scene s = scene_rectangle(20, 21);
    scene_quad(&s, (vec3){0, 0, 9}, (vec3){20, 0, 9}, (vec3){20, 9, 9}, (vec3){0, 9, 9});
    check_unresolved(s, "coverage", "missing_share", "parts_without_points");
}

static void a_plate_a_tenth_thick_has_double_rows(void **state)
{
    (void)state;
    check_unresolved(scene_plate(30, 31, 0.1), "close_share", NULL, NULL);
}

/* All points of both rims twice, .2 apart. */
static void doubled_rims_of_a_plate_are_close(void **state)
{
    (void)state;
    scene s = scene_plate(30, 31, 0.5);
    s = with_row(s, (vec3){0.2, 0, 0}, 30);
    check_unresolved(with_row(s, (vec3){0.2, 0, 0.5}, 30), "close_share", NULL, NULL);
}

static void two_lattices_on_each_other_are_close(void **state)
{
    (void)state;
    scene s = scene_rectangle(20, 21);
    const size_t count = s.points;
    for (size_t k = 0; k < count; k++)
        if (s.point[k].x < 19.5 && s.point[k].y < 17)
            scene_point_again(&s, vec3_add(s.point[k], (vec3){0.1, 0.07, 0}));
    check_unresolved(s, "close_share", NULL, NULL);
}

static void merged_points_are_coincident(void **state)
{
    (void)state;
    check_unresolved(with_row(scene_rectangle(30, 31), (vec3){3 + 5e-4, 0, 0}, 20), "close_share",
                     "coincident", NULL);
}

static void points_in_one_place_fail_all(void **state)
{
    (void)state;
    const ball b = {{10, 10 * ROW, 0}, 1.1};
    scene s = scene_rectangle(20, 21);
    scene_remove(&s, outside_ball, &b);
    for (int k = 0; k < 100; k++) scene_point_again(&s, (vec3){10, 10 * ROW, 0});
    const outcome_result v = judge_scene(&s);
    assert_true(v.outcome == OUTCOME_UNRESOLVED && has_reason(&v, "coverage") &&
                has_reason(&v, "missing_share") && has_reason(&v, "close_share") &&
                has_reason(&v, "coincident") && has_reason(&v, "unmeasured_share"));
}

/* The points of the lower wall lie in a strip along one rim only. */
static void half_a_wall_without_points_is_missing(void **state)
{
    (void)state;
    scene s = scene_plate(20, 21, 0.4), half = scene_plate(20, 21, 0.4);
    half.points = 0;
    for (size_t k = 0; k < s.points; k++)
        if (s.point[k].z > 0.1 || s.point[k].y < 9) scene_point(&half, s.point[k]);
    scene_free(&s);
    check_unresolved(half, "missing_share", NULL, NULL);
}

static void random_points_have_gaps_and_close_pairs(void **state)
{
    (void)state;
    rng r = rng_seed(2, 0);
    scene s = scene_sphere(30, 60);
    scene_random_points(&s, 500, &r);
    scene_set_spacing(&s, sqrt(8 * M_PI / (sqrt(3) * 500)));
    check_unresolved(s, "coverage", "close_share", NULL);
}

/* The requested number of points is twice the existing number. */
static void points_too_far_apart_leave_gaps(void **state)
{
    (void)state;
    scene s = scene_icosahedron(4);
    scene_set_spacing(&s, 0.45);
    check_unresolved(s, "coverage", "missing_share", NULL);
}

static void two_points_on_a_tetrahedron_are_not_measured(void **state)
{
    (void)state;
    scene s = scene_tetrahedron(1);
    s.points = 2;
    scene_set_spacing(&s, sqrt(2 * sqrt(3) / (sqrt(3) * 2)));
    check_unresolved(s, "unmeasured_share", NULL, NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_in_perfect_order_are_converged),
        cmocka_unit_test(a_hole_in_a_lattice_fails_coverage),
        cmocka_unit_test(a_wall_without_points_fails_missing_share),
        cmocka_unit_test(a_row_beside_a_row_fails_close_share),
        cmocka_unit_test(a_point_on_a_point_fails_coincident),
        cmocka_unit_test(a_shell_without_points_fails_parts_without_points),
        cmocka_unit_test(three_points_on_a_sphere_fail_unmeasured_share),
        cmocka_unit_test(a_fault_of_the_solve_is_the_only_reason),
        cmocka_unit_test(bounds_of_blue_noise_apply_to_that_pattern_only),
        cmocka_unit_test(a_message_gives_value_and_bound_before_the_advice),
        cmocka_unit_test(walls_of_a_represented_surface_are_advice),
        cmocka_unit_test(an_unknown_factor_gives_a_count),
        cmocka_unit_test(a_solve_that_was_stopped_names_its_limit),
        cmocka_unit_test(points_that_still_move_do_not_require_more_sweeps),
        cmocka_unit_test(a_resolution_is_not_finer_than_the_data),
        cmocka_unit_test(a_resolution_beyond_all_counts_is_not_advised_a_region_of_labels),
        cmocka_unit_test(a_step_that_is_not_known_fails_nothing),
        cmocka_unit_test(a_solve_that_still_moves_outranks_gaps),
        cmocka_unit_test(a_requirement_that_is_missed_is_a_reason),
        cmocka_unit_test(half_of_the_points_lost_at_random_leave_gaps),
        cmocka_unit_test(a_half_without_points_leaves_a_gap),
        cmocka_unit_test(a_wide_hole_leaves_a_gap),
        cmocka_unit_test(a_corner_without_points_leaves_a_gap),
        cmocka_unit_test(a_face_of_a_cube_without_points_leaves_a_gap),
        cmocka_unit_test(a_ring_without_points_leaves_a_gap),
        cmocka_unit_test(an_end_of_a_torus_without_points_leaves_a_gap),
        cmocka_unit_test(a_half_plane_without_points_leaves_a_gap),
        cmocka_unit_test(a_sparse_strip_leaves_a_gap),
        cmocka_unit_test(a_far_piece_without_points_is_a_part_and_a_gap),
        cmocka_unit_test(a_plate_a_tenth_thick_has_double_rows),
        cmocka_unit_test(doubled_rims_of_a_plate_are_close),
        cmocka_unit_test(two_lattices_on_each_other_are_close),
        cmocka_unit_test(merged_points_are_coincident),
        cmocka_unit_test(points_in_one_place_fail_all),
        cmocka_unit_test(half_a_wall_without_points_is_missing),
        cmocka_unit_test(random_points_have_gaps_and_close_pairs),
        cmocka_unit_test(points_too_far_apart_leave_gaps),
        cmocka_unit_test(two_points_on_a_tetrahedron_are_not_measured),
    };
    return cmocka_run_group_tests_name("outcome", tests, NULL, NULL);
}
