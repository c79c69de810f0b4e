// SPDX-License-Identifier: Apache-2.0
/* Surfaces of patches that meet in curves, from the random start to the triangles. The faces are flat, so
 * that curves and corners are known.
 */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "faces.h"
#include "sampling/voronoi/triangulation.h"
#include "sampling/solver/solver.h"
#include "measure_result.h"
#include "shapes.h"
#include "sampling/solver/curves/curve_samples.h"
#include "sampling/solver/curves/near_curves.h"
#include "sampling/solver/curves/quota.h"
#include "sampling/solver/particles/coverage.h"
#include "sampling/sizing/curve_distance.h"

static const solver_params even = {.count = 2000,
                                   .seed = 1,
                                   .coarse_to_fine = true,
                                   .max_sweeps = 5000,
                                   .list_limit = SIZE_MAX,
                                   .step_tolerance = 3e-3,
                                   .energy_tolerance = 0.05};

typedef struct solved {
    const faces *faces;
    threads *pool;
    surface *scan;
    solver *s;
    const solver_points *points;
    measures q;
    triangulation mesh;
    double farthest; /* largest distance of the surface from the points, in spacings */
} solved;

static bool is_within(const void *context, uint32_t label, vec3 x)
{
    return field_is_within(field_of_patch(context, label), x);
}

static void solve(const faces *f, const solver_params *params, int workers, solved *out)
{
    error e = {0};
    *out = (solved){.faces = f, .pool = threads_new(workers, NULL, &e)};
    out->scan = surface_scan(&f->base, out->pool, &e);
    out->s = solver_new(&f->base, out->scan, params, out->pool, &e);
    if (!out->s) fail_msg("%s", e.message);
    while (!solver_ended(out->s))
        if (!solver_step(out->s, &e)) fail_msg("%s", e.message);
    if (!solver_finalize(out->s, &e)) fail_msg("%s", e.message);
    out->points = solver_result_points(out->s);
    const solver_patch_points *stands = &out->points->patch_points;
    out->q = measure_result(out->scan, out->s, false, out->pool);
    const triangulation_input sites = {.count = stands->count,
                                       .position = stands->position,
                                       .normal = stands->normal,
                                       .spacing = stands->spacing,
                                       .label = stands->patch,
                                       .flags = stands->flags,
                                       .point = stands->point,
                                       .points = out->points->count,
                                       .is_within = is_within,
                                       .context = &f->base};
    assert_true(triangulation_make(&sites, out->pool, &out->mesh, &e));
    double *farthest = calloc(coverage_parts(out->scan), sizeof *farthest);
    assert_true(coverage_measure(out->scan, out->points->position, out->points->spacing, out->points->count,
                                 out->pool, farthest, &e));
    out->farthest = 0;
    for (size_t k = 0; k < coverage_parts(out->scan); k++) out->farthest = fmax(out->farthest, farthest[k]);
    free(farthest);
}

static void release(solved *x)
{
    triangulation_free(&x->mesh);
    solver_free(x->s);
    surface_free(x->scan);
    threads_free(x->pool);
}

/* The position of a point along a straight curve; NAN if it is not on the curve. */
static double place_along(const solved *x, size_t curve, size_t i)
{
    vec3 from = x->faces->vertex[2 * curve], side = vec3_sub(x->faces->vertex[2 * curve + 1], from);
    vec3 r = vec3_sub(x->points->position[i], from);
    double length = vec3_norm(side), along = vec3_dot(r, side) / length;
    bool on = vec3_norm2(r) - along * along < 1e-20 && along > -1e-9 && along < length + 1e-9;
    return on && x->points->feature[i] != SOLVER_ON_PATCH ? along : NAN;
}

/* A curve has the number of equal steps that fits best. */
static void check_row(const solved *x, size_t curve)
{
    const vec3 *end = x->faces->vertex + 2 * curve;
    double length = vec3_norm(vec3_sub(end[1], end[0])), steps = round(length / solver_spacing(x->s)),
           seen = 0;
    for (size_t i = 0; i < x->points->count; i++) {
        double along = place_along(x, curve, i) * steps / length;
        if (isnan(along)) continue;
        assert_close(along, round(along), 1e-9);
        seen++;
    }
    assert_close(seen, steps + 1, 0);
}

/* Every point is on its face, and curve samples are at the expected positions. */
static void check_places(const solved *x)
{
    const faces *f = x->faces;
    size_t on[3] = {0};
    for (size_t i = 0; i < x->points->count; i++) {
        on[x->points->feature[i]]++;
        const field *patch = field_of_patch(&f->base, x->points->patch[i]);
        field_sample s;
        assert_true(field_sample_at(patch, x->points->position[i], FIELD_GRADIENT, &s));
        assert_true(fabs(s.value) < 1e-9 && field_is_within(patch, x->points->position[i]));
    }
    for (size_t c = 0; c < f->patches.curve_count; c++) check_row(x, c);
    assert_true(on[SOLVER_ON_PATCH] + on[SOLVER_ON_CURVE] + on[SOLVER_ON_CORNER] == x->points->count);
}

static void a_cube_has_curve_samples_along_its_edges(void **state)
{
    (void)state;
    static faces cube;
    make_cube(&cube);
    const size_t counts[] = {150, 2000, 10000};
    for (size_t k = 0; k < sizeof counts / sizeof *counts; k++) {
        solver_params params = even;
        solved x;
        params.count = counts[k];
        params.seed = test_seed() + k;
        solve(&cube, &params, 2, &x);
        assert_int_equal(x.points->count, counts[k]);
        assert_int_equal(solver_result(x.s), SOLVER_CONVERGED);
        check_places(&x);
        assert_true(x.farthest < 1);
        assert_true(counts[k] < 5000 || x.q.hex_fraction >= 0.85); /* including edges */
        assert_true(triangulation_is_closed(&x.mesh.facts));
        assert_int_equal(x.mesh.facts.euler, 2);
        release(&x);
    }
}

/* The results for any number of threads are equal bit by bit. */
static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    static faces cube;
    solver_params params = even;
    solved one, more;
    make_cube(&cube);
    params.seed = test_seed();
    solve(&cube, &params, 1, &one);
    for (int workers = 2; workers <= 3; workers++) {
        solve(&cube, &params, workers, &more);
        assert_int_equal(more.points->patch_points.count, one.points->patch_points.count);
        assert_memory_equal(more.points->patch_points.position, one.points->patch_points.position,
                            one.points->patch_points.count * sizeof(vec3));
        release(&more);
    }
    release(&one);
}

static size_t count_on_patch(const solved *x, uint32_t patch)
{
    size_t count = 0;
    for (size_t i = 0; i < x->points->patch_points.count; i++)
        count += x->points->patch_points.patch[i] == patch;
    return count;
}

/* Two squares so close to each other that their points could not be distinguished without the numbers of
 * their patches. */
static void close_parallel_patches_do_not_interact(void **state)
{
    (void)state;
    static faces two;
    solver_params params = even;
    solved x;
    two = (faces){0};
    params.seed = test_seed();
    add_face(&two, (vec3){0, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    add_face(&two, (vec3){0, 0, 0.01}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    faces_join(&two);
    solve(&two, &params, 2, &x);
    assert_true(0.01 < 0.3 * solver_spacing(x.s));
    assert_int_equal(solver_result(x.s), SOLVER_CONVERGED);
    assert_true(x.q.unmeasured_share == 0);
    assert_int_equal(count_on_patch(&x, 0), count_on_patch(&x, 1));
    assert_int_equal(x.mesh.facts.euler, 2);
    assert_true(triangulation_is_manifold(&x.mesh.facts) && x.mesh.facts.boundary_edges > 0);
    check_places(&x);
    release(&x);
}

/* Three patches that meet in one edge, which belongs to three triangles everywhere. */
static void three_patches_share_the_samples_of_their_edge(void **state)
{
    (void)state;
    static faces three;
    solver_params params = even;
    solved x;
    three = (faces){0};
    params.seed = test_seed();
    add_face(&three, (vec3){0.5, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    add_face(&three, (vec3){-0.5, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    add_face(&three, (vec3){0, 0, 0.5}, (vec3){0, 0, 0.5}, (vec3){0, 0.5, 0});
    faces_join(&three);
    solve(&three, &params, 2, &x);
    assert_int_equal(solver_result(x.s), SOLVER_CONVERGED);
    check_places(&x);
    size_t steps = (size_t)round(1 / solver_spacing(x.s));
    assert_int_equal(x.points->patch_points.count - x.points->count, 2 * (steps + 1));
    assert_int_equal(x.mesh.facts.nonmanifold_edges, steps);
    assert_true(x.mesh.facts.boundary_edges == x.mesh.facts.rim_edges && x.farthest < 1);
    release(&x);
}

/* The method of the paper, from random positions and with insertion: curve samples become denser as the
 * count rises. */
static void curve_samples_follow_the_count(void **state)
{
    (void)state;
    static faces cube;
    solver_params params = even;
    solved x;
    make_cube(&cube);
    params.coarse_to_fine = false;
    params.start = SOLVER_START_RANDOM;
    params.count = params.min_count = 200;
    params.max_sigma = 0.15;
    params.seed = test_seed();
    solve(&cube, &params, 2, &x);
    assert_true(x.points->count > 600 && x.points->sigma <= 0.15 * (1 + 1e-9));
    check_places(&x);
    release(&x);
}

static double finer_to_one_side(const void *context, vec3 x)
{
    (void)context;
    return 1 + 0.8 * x.x;
}

/* With a grading, the steps of curve samples follow the spacing, like the packing. */
static void curve_samples_are_graded(void **state)
{
    (void)state;
    static faces sheet;
    error e = {0};
    sheet = (faces){0};
    add_face(&sheet, (vec3){0, 0, 0}, (vec3){1, 0, 0}, (vec3){0, 1, 0});
    faces_join(&sheet);
    threads *pool = threads_new(2, NULL, &e);
    surface *scan = surface_scan(&sheet.base, pool, &e);
    const sizing_field_params asked = {
        .kind = SIZING_FIELD_SPACING, .map = finer_to_one_side, .gradation = INFINITY};
    solver_params params = even;
    solved x;
    params.seed = test_seed();
    sizing_field *sizing = sizing_field_new(&sheet.base, scan, &asked, params.count, pool, &e);
    assert_non_null(sizing);
    params.sizing = sizing;
    solve(&sheet, &params, 2, &x);
    assert_int_equal(solver_result(x.s), SOLVER_CONVERGED);
    double low = 0, high = 0;
    for (size_t i = 0; i < x.points->count; i++) {
        if (x.points->feature[i] == SOLVER_ON_PATCH || x.points->position[i].y != 1) continue;
        low += x.points->position[i].x < 0;
        high += x.points->position[i].x > 0;
    }
    assert_close(low / high, log(1 / 0.2) / log(1.8), 0.25); /* integrals of 1 / spacing */
    release(&x);
    sizing_field_free(sizing);
    surface_free(scan);
    threads_free(pool);
}

/* A face with a round hole in it and a slit that is shorter than half a spacing. */
static void make_holed_face(faces *s)
{
    enum { ROUND = 20 };
    *s = (faces){0};
    add_face(s, (vec3){0, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    faces_join(s);
    field_curve *hole = &s->curve[s->patches.curve_count++], *slit = &s->curve[s->patches.curve_count++];
    *hole = (field_curve){.first = 8, .count = ROUND, .closed = true, .patch_first = 4, .patch_count = 1};
    for (int k = 0; k < ROUND; k++)
        s->vertex[8 + k] = (vec3){0.2 * cos(2 * M_PI * k / ROUND), 0.2 * sin(2 * M_PI * k / ROUND), 0};
    *slit = (field_curve){.first = 8 + ROUND, .count = 2, .patch_first = 5, .patch_count = 2};
    s->vertex[8 + ROUND] = (vec3){0.4, 0.4, 0};
    s->vertex[9 + ROUND] = (vec3){0.44, 0.4, 0};
    for (int k = 4; k < 7; k++) s->curve_patch[k] = 0;
}

static void a_loop_without_samples_uses_no_points(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    make_holed_face(&s);
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    s.patches.curve_count--; /* no slit */
    for (size_t k = 0; k < s.curve[4].count; k++) s.vertex[8 + k] = vec3_scale(s.vertex[8 + k], 0.02);
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_int_equal(rows.count, 4 * 10);
    assert_close(rows.border[0], 0.5 * 4 * 10 - (2 - 1), 1e-9);
    curve_samples_free(&rows);
}

/* With two samples its patches would meet twice along one edge. */
static void a_loop_never_has_two_samples(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    const double length[] = {1.4, 1.6, 1.9, 2.1, 2.4, 2.6};
    for (int n = 0; n < 6; n++) {
        make_holed_face(&s);
        s.patches.curve_count--; /* no slit */
        const double round = 20 * 2 * 0.2 * sin(M_PI / 20);
        for (size_t k = 0; k < s.curve[4].count; k++)
            s.vertex[8 + k] = vec3_scale(s.vertex[8 + k], 0.1 * length[n] / round);
        assert_true(curve_samples_make(&s.base, &request, &rows, &e));
        assert_int_equal(rows.count, 4 * 10 + (n < 3 ? 1 : 3));
        curve_samples_free(&rows);
    }
}

static void loops_and_short_curves_have_samples(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    make_holed_face(&s);
    boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    /* a square with ten steps per side, the length of 1.25 of the hole, and one end of the slit */
    assert_int_equal(rows.corners, 4 + 1);
    assert_int_equal(rows.count, 4 * 10 + 13 + 1);
    assert_int_equal(rows.copies, rows.count); /* where a patch meets itself, there is one copy */
    /* halves of cells beside the samples, those of the slit twice, less an Euler characteristic of 2 - 2.5
     * loops; the single sample of the slit occupies a cell */
    assert_close(rows.border[0], 0.5 * (4 * 10 + 13) + 0.5 - (2 - 2.5), 1e-9);
    curve_samples_free(&rows);
    request.most = 7;
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_true(rows.count > 4 && rows.count <= 7);
    curve_samples_free(&rows);
    curve_distance *d = curve_distance_new(&s.patches, false, 0.01, NULL, &e);
    assert_close(curve_distance_at(d, 0, (vec3){0.1, 0, 0}), 0.1, 2e-3);
    assert_close(curve_distance_at(d, 0, (vec3){0, 0.35, 0}), 0.15, 4e-3);
    curve_distance_free(d);
}

static void curves_are_not_sampled_when_the_pool_is_stopped(void **state)
{
    (void)state;
    static faces s;
    const volatile sig_atomic_t stop = 1;
    const surface scan = {.area = 1};
    error e = {0};
    quota q;
    make_holed_face(&s);
    threads *pool = threads_new(1, &stop, &e);
    assert_null(curve_distance_new(&s.patches, false, 0.01, pool, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    e = (error){0};
    assert_false(quota_for_spacing(&(quota_input){.field = &s.base, .scan = &scan, .pool = pool}, 0.1,
                                   SIZE_MAX, &q, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    quota_free(&q);
    threads_free(pool);
}

/* A face with two slits from (0.1, 0.1): along x, and to the given end. */
static void make_slit_face(faces *s, vec3 from, vec3 to)
{
    *s = (faces){0};
    add_face(s, (vec3){0, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    faces_join(s);
    const vec3 end[4] = {{-0.35, 0.1, 0}, {0.35, 0.1, 0}, from, to};
    for (uint32_t k = 0; k < 2; k++) {
        s->curve[s->patches.curve_count++] =
            (field_curve){.first = 8 + 2 * k, .count = 2, .patch_first = 4 + 2 * k, .patch_count = 2};
        s->vertex[8 + 2 * k] = end[2 * k];
        s->vertex[9 + 2 * k] = end[2 * k + 1];
    }
    for (int k = 4; k < 8; k++) s->curve_patch[k] = 0;
    s->patches.merges_near_curves = true;
}

static double least_distance(const curve_samples *r)
{
    double least = INFINITY;
    for (size_t i = 0; i < r->count; i++)
        for (size_t j = 0; j < i; j++)
            least = fmin(least, vec3_norm(vec3_sub(r->position[i], r->position[j])));
    return least;
}

/* Samples of two curves a tenth of a spacing apart, as at a low step, would cause slivers between them. */
static void curve_samples_of_a_low_step_are_merged(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    make_slit_face(&s, (vec3){-0.35, 0.11, 0}, (vec3){0.35, 0.11, 0});
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_int_equal(rows.count, 4 * 10 + 8);
    assert_int_equal(rows.corners, 4 + 2);
    assert_int_equal(rows.copies, rows.count);
    assert_true(least_distance(&rows) > 0.09);
    /* the step occupies seven cells, as one slit does */
    assert_close(rows.border[0], 0.5 * 4 * 10 + 7 - (2 - 3), 1e-9);
    curve_samples_free(&rows);
    /* also if all samples just fit into the limit */
    const boundary_request full = {.spacing = 0.1, .even = 0.1, .most = 4 * 10 + 16};
    assert_true(curve_samples_make(&s.base, &full, &rows, &e));
    assert_int_equal(rows.count, 4 * 10 + 8);
    curve_samples_free(&rows);
    /* and if the remaining samples just fit */
    const boundary_request merged = {.spacing = 0.1, .even = 0.1, .most = 4 * 10 + 8};
    assert_true(curve_samples_make(&s.base, &merged, &rows, &e));
    assert_int_equal(rows.count, 4 * 10 + 8);
    curve_samples_free(&rows);
    s.patches.merges_near_curves = false;
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_int_equal(rows.count, 4 * 10 + 16);
    curve_samples_free(&rows);
}

/* Curves that cross without a common corner, as lines between labels may, have one sample where a sample of each
 * would be. Near samples at different places remain. */
static void curve_samples_at_the_same_place_are_one(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    const double apart[] = {0, 1e-8, -1e-8, 0.01};
    for (int k = 0; k < 4; k++) {
        make_slit_face(&s, (vec3){0.05 + apart[k], -0.2, 0}, (vec3){0.05 + apart[k], 0.3, 0});
        s.patches.merges_near_curves = false;
        assert_true(curve_samples_make(&s.base, &request, &rows, &e));
        assert_int_equal(rows.corners, 4 + 4);
        assert_int_equal(rows.count, 4 * 10 + 8 + (k < 3 ? 5 : 6));
        assert_int_equal(rows.copies, rows.count);
        assert_true(least_distance(&rows) > (k < 3 ? 0.09 : 0.009));
        curve_samples_free(&rows);
    }
}

/* Four corners of each of two squares that no curve connects are too many for one sample. The curves then
 * have no samples, because a part of them would lie on one side of the surface. */
static void too_many_corners_have_no_samples(void **state)
{
    (void)state;
    static faces two;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = 1};
    two = (faces){0};
    add_face(&two, (vec3){0, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    add_face(&two, (vec3){0, 0, 3}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    faces_join(&two);
    two.patches.merges_near_curves = true;
    assert_true(curve_samples_make(&two.base, &request, &rows, &e));
    assert_int_equal(rows.count, 0);
    assert_int_equal(rows.copies, 0);
    assert_true(rows.border[0] == 0 && rows.border[1] == 0);
    curve_samples_free(&rows);
}

/* Samples of an edge that are merged into those of the adjacent curve are displaced by less than a third of a
 * spacing. */
static void merging_curve_samples_cuts_off_less_than_a_third(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    for (int k = 5; k < 40; k++) {
        const double height = 0.001 * k + 0.0005;
        make_slit_face(&s, (vec3){-0.35, 0.1 + height, 0}, (vec3){0.35, 0.1 + height, 0});
        assert_true(curve_samples_make(&s.base, &request, &rows, &e));
        assert_int_equal(rows.count, 4 * 10 + (height < 0.03 ? 8 : 16));
        curve_samples_free(&rows);
    }
}

/* Two curves that diverge at seven degrees have common first samples. */
static void curves_with_a_small_angle_share_their_first_samples(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    make_slit_face(&s, (vec3){-0.35, 0.1, 0}, (vec3){0.35, 0.1 + 0.7 * tan(7 * M_PI / 180), 0});
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_true(rows.count > 4 * 10 + 8 && rows.count < 4 * 10 + 8 + 6);
    assert_true(least_distance(&rows) > 0.029);
    assert_int_equal(rows.corners, 4 + 3);
    curve_samples_free(&rows);
}

/* A cut that ends in a hook: c is joined to both a and b by short curves and merged into b. The curve from a
 * to c then joins a and b. */
static void corners_connected_through_a_merged_corner_are_merged(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    const vec3 a = {0.1, 0.11, 0}, b = {0.11, 0.1, 0}, c = {0.12, 0.1, 0};
    make_slit_face(&s, b, c);
    s.vertex[8] = (vec3){0.11, -0.2, 0};
    s.vertex[9] = b;
    s.curve[s.patches.curve_count] =
        (field_curve){.first = 12, .count = 2, .patch_first = 8, .patch_count = 2};
    s.vertex[12] = c;
    s.vertex[13] = a;
    s.curve_patch[8] = s.curve_patch[9] = 0;
    s.patches.curve_count++;
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_true(least_distance(&rows) > 0.09);
    assert_int_equal(rows.corners, 4 + 2);
    curve_samples_free(&rows);
}

/* A curve that folds back between two samples, which would be a fifth of a spacing apart, or at a sample. */
static void a_curve_that_folds_back_has_no_close_samples(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    for (int odd = 0; odd < 2; odd++) { /* number of steps along the curve: 8 or 7 */
        make_slit_face(&s, (vec3){0, 0, 0}, (vec3){0, 0, 0});
        const double length = odd ? 0.34 : 0.39;
        s.patches.curve_count--;
        s.curve[s.patches.curve_count - 1].count = 4;
        s.vertex[8] = (vec3){0, -0.01, 0};
        s.vertex[9] = (vec3){length, -0.01, 0};
        s.vertex[10] = (vec3){length, 0.01, 0};
        s.vertex[11] = (vec3){0, 0.01, 0};
        assert_true(curve_samples_make(&s.base, &request, &rows, &e));
        assert_true(least_distance(&rows) > 0.03);
        assert_int_equal(rows.corners, 4 + 1);
        assert_in_range(rows.count, 4 * 10 + 4, 4 * 10 + 5);
        curve_samples_free(&rows);
    }
}

/* A crease that begins half a spacing from another one makes no corner there. */
static void ends_of_creases_keep_their_distance(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    make_slit_face(&s, (vec3){0.05, 0.15, 0}, (vec3){0.05, 0.4, 0});
    s.patches.has_rough_curves = true;
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_int_equal(rows.corners, 4 + 3);
    assert_true(least_distance(&rows) > 0.08);
    curve_samples_free(&rows);
}

/* Curves on a scan bend irregularly: a corner at which two of them continue is treated like the samples
 * between. */
static void bends_of_rough_curves_are_no_corners(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    make_slit_face(&s, (vec3){0.44, 0.1, 0}, (vec3){0.44, -0.3, 0});
    s.vertex[9] = s.vertex[10]; /* 0.6 spacings from the samples at the boundary of the face */
    for (int rough = 0; rough < 2; rough++) {
        s.patches.has_rough_curves = rough;
        assert_true(curve_samples_make(&s.base, &request, &rows, &e));
        assert_int_equal(rows.corners, 4 + 3 - 2 * rough);
        curve_samples_free(&rows);
    }
}

/* The boundary of a patch on one side of a thin part differs from the boundary on the other side. */
static void curve_samples_on_opposite_sides_are_not_merged(void **state)
{
    (void)state;
    static faces s;
    error e = {0};
    curve_samples rows;
    const boundary_request request = {.spacing = 0.1, .even = 0.1, .most = SIZE_MAX};
    s = (faces){0};
    add_face(&s, (vec3){0, 0, 0}, (vec3){0.5, 0, 0}, (vec3){0, 0.5, 0});
    add_face(&s, (vec3){0, 0, -0.01}, (vec3){0, 0.5, 0}, (vec3){0.5, 0, 0});
    faces_join(&s);
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    const size_t before = rows.count;
    curve_samples_free(&rows);
    s.patches.merges_near_curves = true;
    assert_true(curve_samples_make(&s.base, &request, &rows, &e));
    assert_int_equal(rows.count, before);
    curve_samples_free(&rows);
}

/* The same holds if one patch is on both sides: the direction of the normals decides. */
static void curve_samples_of_one_patch_merge_on_one_side_only(void **state)
{
    (void)state;
    enum { PLACES = 10 };
    const bool closed[2] = {true, true};
    const size_t first[3] = {0, PLACES, 2 * PLACES};
    uint32_t end[2][2] = {{0}};
    double spacing[2 * PLACES], half[2 * PLACES];
    for (int facing = -1; facing <= 1; facing += 2) {
        curve_samples rows = {.count = 2 * PLACES, .copies = 2 * PLACES};
        rows.position = calloc(2 * PLACES, sizeof *rows.position);
        rows.curve = calloc(2 * PLACES, sizeof *rows.curve);
        rows.place = calloc(2 * PLACES, sizeof *rows.place);
        rows.patch = calloc(2 * PLACES, sizeof *rows.patch);
        rows.normal = calloc(2 * PLACES, sizeof *rows.normal);
        rows.border = calloc(1, sizeof *rows.border);
        for (uint32_t k = 0; k < 2 * PLACES; k++) { /* circles, one slightly above the other */
            const double angle = 2 * M_PI * k / PLACES;
            rows.position[k] = (vec3){cos(angle), sin(angle), k < PLACES ? 0 : 0.05};
            rows.curve[k] = k / PLACES;
            rows.place[k] = k;
            rows.normal[k] = (vec3){0, 0, k < PLACES ? 1 : facing};
            rows.border[0] += half[k] = 0.5;
            spacing[k] = 2 * M_PI / PLACES;
        }
        const near_curves_input in = {2, 2, closed, end, first, spacing, half, false, false};
        error e = {0};
        assert_true(near_curves_merge(&in, &rows, &e));
        assert_int_equal(rows.count, facing < 0 ? 2 * PLACES : PLACES);
        assert_close(rows.border[0], 0.5 * (double)rows.count, 1e-12);
        curve_samples_free(&rows);
    }
}

/* Where a part is pinched, samples of its two sides are at the same place: they are one, whatever their normals. */
static void curve_samples_at_a_pinched_place_are_one(void **state)
{
    (void)state;
    enum { PLACES = 10 };
    const bool closed[2] = {true, true};
    const size_t first[3] = {0, PLACES, 2 * PLACES};
    uint32_t end[2][2] = {{0}};
    double spacing[2 * PLACES], half[2 * PLACES];
    for (int facing = -1; facing <= 1; facing += 2) {
        curve_samples rows = {.count = 2 * PLACES, .copies = 2 * PLACES};
        rows.position = calloc(2 * PLACES, sizeof *rows.position);
        rows.curve = calloc(2 * PLACES, sizeof *rows.curve);
        rows.place = calloc(2 * PLACES, sizeof *rows.place);
        rows.patch = calloc(2 * PLACES, sizeof *rows.patch);
        rows.normal = calloc(2 * PLACES, sizeof *rows.normal);
        rows.border = calloc(1, sizeof *rows.border);
        for (uint32_t k = 0; k < 2 * PLACES; k++) { /* circles, one slightly above the other */
            const double angle = 2 * M_PI * k / PLACES;
            rows.position[k] = (vec3){cos(angle), sin(angle), k < PLACES ? 0 : 1e-8};
            rows.curve[k] = k / PLACES;
            rows.place[k] = k;
            rows.normal[k] = (vec3){0, 0, k < PLACES ? 1 : facing};
            rows.border[0] += half[k] = 0.5;
            spacing[k] = 2 * M_PI / PLACES;
        }
        const near_curves_input in = {2, 2, closed, end, first, spacing, half, false, true};
        error e = {0};
        assert_true(near_curves_merge(&in, &rows, &e));
        assert_int_equal(rows.count, PLACES);
        assert_close(rows.border[0], 0.5 * (double)rows.count, 1e-12);
        curve_samples_free(&rows);
    }
}

/* Samples on circles of radius 1 around the z axis: circle c has copies for two patches. */
typedef struct circles {
    curve_samples rows;
    near_curves_input in;
    bool closed[3];
    size_t first[4];
    uint32_t end[3][2];
    double spacing[30], half[60];
} circles;

static void make_circles(circles *c, size_t count, uint32_t places, const double *height,
                         const uint32_t (*patch)[2], const vec3 *normal)
{
    const size_t samples = count * places;
    *c = (circles){.rows = {.count = samples, .copies = 2 * samples}};
    c->rows.position = calloc(samples, sizeof *c->rows.position);
    c->rows.curve = calloc(samples, sizeof *c->rows.curve);
    c->rows.place = calloc(2 * samples, sizeof *c->rows.place);
    c->rows.patch = calloc(2 * samples, sizeof *c->rows.patch);
    c->rows.normal = calloc(2 * samples, sizeof *c->rows.normal);
    c->rows.border = calloc(4, sizeof *c->rows.border);
    for (uint32_t k = 0; k < samples; k++) {
        const double angle = 2 * M_PI * k / places;
        const uint32_t curve = k / places;
        c->rows.position[k] = (vec3){cos(angle), sin(angle), height[curve]};
        c->rows.curve[k] = curve;
        c->spacing[k] = 2 * M_PI / places;
        for (int i = 0; i < 2; i++) {
            c->rows.place[2 * k + i] = k;
            c->rows.patch[2 * k + i] = patch[curve][i];
            c->rows.normal[2 * k + i] = normal[patch[curve][i]];
            c->rows.border[patch[curve][i]] += c->half[2 * k + i] = 0.5;
        }
    }
    for (size_t k = 0; k < count; k++) {
        c->closed[k] = true;
        c->first[k + 1] = (k + 1) * places;
    }
    c->in = (near_curves_input){4, count, c->closed, c->end, c->first, c->spacing, c->half, false, false};
}

/* The rim of a thin plate is an acute wedge of two faces. Its upper and its lower edge are on opposite walls.
 * After the edge of the wedge was merged, both have copies for both faces of the wedge. */
static void curve_samples_at_a_wedge_between_opposite_walls_are_merged(void **state)
{
    (void)state;
    enum { PLACES = 10 };
    const double height[3] = {0.07, 0, -0.07};
    const uint32_t patch[3][2] = {{0, 2}, {2, 3}, {3, 1}};
    const vec3 normal[4] = {{0, 0, 1}, {0, 0, -1}, {0.47, 0, 0.88}, {0.47, 0, -0.88}};
    static circles c;
    error e = {0};
    make_circles(&c, 3, PLACES, height, patch, normal);
    assert_true(near_curves_merge(&c.in, &c.rows, &e));
    assert_int_equal(c.rows.count, PLACES);
    assert_int_equal(c.rows.copies, 4 * PLACES);
    curve_samples_free(&c.rows);
}

/* A closed curve of one sample has no neighbours along it. */
static void single_samples_of_two_closed_curves_are_merged(void **state)
{
    (void)state;
    const double height[2] = {0, 0.3};
    const uint32_t patch[2][2] = {{0, 1}, {1, 2}};
    const vec3 normal[4] = {{0, 0, -1}, {1, 0, 0}, {0, 0, 1}, {0, 0, 1}};
    static circles c;
    error e = {0};
    make_circles(&c, 2, 1, height, patch, normal);
    assert_true(near_curves_merge(&c.in, &c.rows, &e));
    assert_int_equal(c.rows.count, 1);
    assert_int_equal(c.rows.copies, 3);
    curve_samples_free(&c.rows);
}

/* A closed curve of two straight parts close together: their samples are merged, except one at each bend. */
static void samples_of_a_curve_that_folds_back_are_merged(void **state)
{
    (void)state;
    enum { PART = 20, PLACES = 2 * PART };
    const bool closed = true;
    const size_t first[2] = {0, PLACES};
    uint32_t end[1][2] = {{0}};
    double spacing[PLACES], half[PLACES];
    curve_samples rows = {.count = PLACES, .copies = PLACES};
    rows.position = calloc(PLACES, sizeof *rows.position);
    rows.curve = calloc(PLACES, sizeof *rows.curve);
    rows.place = calloc(PLACES, sizeof *rows.place);
    rows.patch = calloc(PLACES, sizeof *rows.patch);
    rows.normal = calloc(PLACES, sizeof *rows.normal);
    rows.border = calloc(1, sizeof *rows.border);
    for (uint32_t k = 0; k < PLACES; k++) {
        rows.position[k] = (vec3){k < PART ? k : PLACES - 1 - k, k < PART ? 0 : 0.2, 0};
        rows.place[k] = k;
        rows.normal[k] = (vec3){0, 0, 1};
        rows.border[0] += half[k] = 0.5;
        spacing[k] = 1;
    }
    const near_curves_input in = {1, 1, &closed, end, first, spacing, half, false, false};
    error e = {0};
    assert_true(near_curves_merge(&in, &rows, &e));
    assert_in_range(rows.count, PART, PART + 2);
    curve_samples_free(&rows);
}

/* Points move to given positions of their patches and stay there; the other points converge around them. */
static void points_are_held_at_given_positions(void **state)
{
    (void)state;
    static faces cube;
    make_cube(&cube);
    solved x;
    error e = {0};
    solve(&cube, &even, 2, &x);
    const size_t count = x.points->count;
    const vec3 aside = {2, 0, 0};
    vec3 at[2];
    size_t found = 0;
    for (size_t i = 0; i < count && found < 2;
         i++) { /* between a point on a face and its nearest neighbour */
        if (x.points->feature[i] != SOLVER_ON_PATCH) continue;
        size_t other = i;
        double least = INFINITY;
        for (size_t j = 0; j < count; j++) {
            const double away = vec3_norm(vec3_sub(x.points->position[i], x.points->position[j]));
            if (j != i && x.points->patch[j] == x.points->patch[i] && away < least) {
                least = away;
                other = j;
            }
        }
        if (x.points->feature[other] != SOLVER_ON_PATCH) continue;
        at[found] = vec3_scale(vec3_add(x.points->position[i], x.points->position[other]), 0.5);
        found += found == 0 || vec3_norm(vec3_sub(at[0], at[1])) > 0.5;
    }
    assert_int_equal(found, 2);
    bool goes_on = true;
    assert_true(solver_pin(x.s, &aside, 1, &goes_on, &e));
    assert_false(goes_on);
    assert_int_equal(solver_result_points(x.s)->count, count);
    assert_true(solver_pin(x.s, at, 2, &goes_on, &e));
    assert_true(goes_on);
    while (!solver_ended(x.s)) assert_true(solver_step(x.s, &e));
    assert_int_equal(solver_result(x.s), SOLVER_CONVERGED);
    assert_true(solver_finalize(x.s, &e));
    x.points = solver_result_points(x.s);
    assert_int_equal(x.points->count, count);
    check_places(&x);
    for (size_t k = 0; k < 2; k++) {
        double least = INFINITY;
        for (size_t i = 0; i < count; i++)
            if (x.points->feature[i] == SOLVER_ON_PATCH)
                least = fmin(least, vec3_norm(vec3_sub(x.points->position[i], at[k])));
        assert_true(least < 1e-9);
    }
    assert_true(x.points->step_left < even.step_tolerance);
    size_t next = 0; /* nearest neighbour of the held point */
    for (size_t i = 1; i < count; i++)
        if (fabs(vec3_norm(vec3_sub(x.points->position[i], at[0])) - x.points->patch_points.spacing[i]) <
            fabs(vec3_norm(vec3_sub(x.points->position[next], at[0])) - x.points->patch_points.spacing[next]))
            next = i;
    const vec3 beside = vec3_axpy(0.2, vec3_sub(x.points->position[next], at[0]), at[0]);
    assert_true(solver_pin(x.s, &beside, 1, &goes_on, &e));
    assert_false(goes_on); /* two held points keep their distance */
    release(&x);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_has_curve_samples_along_its_edges),
        cmocka_unit_test(result_does_not_depend_on_threads),
        cmocka_unit_test(close_parallel_patches_do_not_interact),
        cmocka_unit_test(three_patches_share_the_samples_of_their_edge),
        cmocka_unit_test(curve_samples_follow_the_count),
        cmocka_unit_test(curve_samples_are_graded),
        cmocka_unit_test(curve_samples_of_a_low_step_are_merged),
        cmocka_unit_test(curve_samples_at_the_same_place_are_one),
        cmocka_unit_test(points_are_held_at_given_positions),
        cmocka_unit_test(merging_curve_samples_cuts_off_less_than_a_third),
        cmocka_unit_test(curves_with_a_small_angle_share_their_first_samples),
        cmocka_unit_test(corners_connected_through_a_merged_corner_are_merged),
        cmocka_unit_test(a_curve_that_folds_back_has_no_close_samples),
        cmocka_unit_test(ends_of_creases_keep_their_distance),
        cmocka_unit_test(bends_of_rough_curves_are_no_corners),
        cmocka_unit_test(curve_samples_on_opposite_sides_are_not_merged),
        cmocka_unit_test(curve_samples_of_one_patch_merge_on_one_side_only),
        cmocka_unit_test(curve_samples_at_a_pinched_place_are_one),
        cmocka_unit_test(curve_samples_at_a_wedge_between_opposite_walls_are_merged),
        cmocka_unit_test(single_samples_of_two_closed_curves_are_merged),
        cmocka_unit_test(too_many_corners_have_no_samples),
        cmocka_unit_test(samples_of_a_curve_that_folds_back_are_merged),
        cmocka_unit_test(loops_and_short_curves_have_samples),
        cmocka_unit_test(curves_are_not_sampled_when_the_pool_is_stopped),
        cmocka_unit_test(a_loop_without_samples_uses_no_points),
        cmocka_unit_test(a_loop_never_has_two_samples),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
