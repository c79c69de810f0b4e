// SPDX-License-Identifier: Apache-2.0
/* Opened volumes: accuracy, derivatives, boundaries of bands and tiles. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/threads.h"
#include "surface/field/region.h"
#include "sampling/solver/particles/coverage.h"
#include "surface/scan/surface.h"
#include "surface/volume/example.h"
#include "cells.h"
#include "close.h"
#include "volume_fixture.h"

#define SEED 20240229u

static double ball(vec3 p)
{
    return vec3_norm(p) - 1.0;
}

/* Smooth, with features of five voxels and more in every direction. */
static double waves(vec3 p)
{
    return 0.5 + 0.3 * sin(7 * p.x + 2 * p.y) + 0.25 * cos(6 * p.y - 3 * p.z) + 0.2 * sin(8 * p.z + p.x);
}

static uint64_t noise_state = SEED;
static double noise(vec3 p)
{
    (void)p;
    return fixture_random(&noise_state);
}

static const double *const transforms[] = {fixture_uniform, fixture_nonuniform, fixture_rotated,
                                           fixture_mirrored};
#define TRANSFORMS (sizeof transforms / sizeof *transforms)

static void the_spline_goes_through_the_samples(void **state)
{
    (void)state;
    /* Noise is the hardest case: its coefficients are ten times its values. Floats have a precision of
     * 6e-8 of them. */
    const double tolerance = 3e-6;
    print_message("# seed %u\n", SEED);
    for (size_t t = 0; t < TRANSFORMS; t++) {
        fixture g = fixture_make(transforms[t], 14, noise, 0);
        volume *v = fixture_volume(&g, 0.5, VOLUME_INTERPOLATING);
        const field *f = volume_field(v);
        size_t cells = f->ops->cell_count(f);
        assert_true(cells > 1000);
        double worst = 0;
        for (size_t k = 0; k < cells; k++) {
            field_cell cell;
            field_sample s;
            f->ops->cell(f, k, &cell);
            bool inside = false, outside = false;
            check_middle(f, k, &cell);
            for (int c = 0; c < 8; c++) {
                /* A corner on the far face of a coefficient block belongs to the next coefficient block: move
                 * inwards. */
                assert_true(field_sample_at(f, cell.corner[c], FIELD_GRADIENT, &s));
                worst = fmax(worst, fabs(s.value - cell.value[c]));
                *(cell.value[c] < 0 ? &inside : &outside) = true;
            }
            assert_true((inside && outside) || cell.hidden_crossing);
        }
        if (worst > tolerance) fail_msg("transform %zu: a sample is missed by %g", t, worst);
        volume_close(v);
        fixture_free(&g);
    }
}

/* Distances with errors of up to a tenth of a voxel of 0.1, which vary with the position. */
static double noisy_ball(vec3 p)
{
    rng r = rng_seed(SEED,
                     (uint64_t)(llround(10 * p.x) + 1000 * llround(10 * p.y) + 1000000 * llround(10 * p.z)));
    return vec3_norm(p) - 1 + 0.02 * (rng_uniform(&r) - 0.5);
}

/* Whatever the values beyond three voxels. */
static void the_spline_interpolates_a_narrow_band(void **state)
{
    (void)state;
    const double voxel = 0.1;
    fixture g = fixture_make(fixture_uniform, 16, noisy_ball, 3 * voxel);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(v);
    double worst = 0;
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        field_cell cell;
        f->ops->cell(f, k, &cell);
        for (int c = 0; c < 8; c++) {
            field_sample s;
            assert_true(field_sample_at(f, cell.corner[c], FIELD_GRADIENT, &s));
            worst = fmax(worst, fabs(s.value - cell.value[c]) / voxel);
        }
    }
    print_message("# narrow band: samples are missed by %.1e voxel at most\n", worst);
    assert_true(worst < 1e-6);
    volume_close(v);
    fixture_free(&g);
}

/* Distances from a cube whose faces are planes of voxels. */
static double cube(vec3 p)
{
    return 1e-6 * round(1e6 * (fmax(fabs(p.x), fmax(fabs(p.y), fabs(p.z))) - 1));
}

/* The spline oscillates about such a face by less than the threshold: except at the edges, no cell beyond it
 * belongs to the surface. */
static void a_face_in_a_plane_of_voxels_is_in_one_layer_of_cells(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 16, cube, 0.35);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(v);
    const size_t cells = f->ops->cell_count(f);
    size_t beyond = 0;
    for (size_t k = 0; k < cells; k++) {
        field_cell cell;
        bool inside = false;
        f->ops->cell(f, k, &cell);
        for (int c = 0; c < 8; c++) inside |= cell.value[c] < 0;
        const vec3 p = vec3_scale(vec3_add(cell.corner[0], cell.corner[7]), 0.5);
        const double second = fabs(p.x) + fabs(p.y) + fabs(p.z) -
                              fmax(fabs(p.x), fmax(fabs(p.y), fabs(p.z))) -
                              fmin(fabs(p.x), fmin(fabs(p.y), fabs(p.z)));
        if (!inside && second < 0.5) beyond++; /* five voxels from the nearest edge */
    }
    print_message("# %zu cells of the cube, %zu beyond its faces\n", cells, beyond);
    assert_int_equal(beyond, 0);
    volume_close(v);
    fixture_free(&g);
}

static double two_balls(vec3 p)
{
    return fmin(vec3_norm(vec3_sub(p, (vec3){0.6, 0, 0})), vec3_norm(vec3_add(p, (vec3){0.7, 0, 0}))) - 0.5;
}

/* Also across the ends of blocks. */
static void one_part_is_distinguished_from_two(void **state)
{
    (void)state;
    const fixture_function shape[] = {ball, two_balls};
    for (size_t parts = 1; parts <= 2; parts++) {
        error e = {0};
        fixture g = fixture_make(fixture_uniform, 16, shape[parts - 1], 0.35);
        volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
        surface *s = surface_scan(volume_field(v), NULL, &e);
        assert_non_null(s);
        assert_int_equal(volume_field(v)->joined, parts == 1);
        assert_int_equal(s->parts.count, parts);
        surface_free(s);
        volume_close(v);
        fixture_free(&g);
    }
}

/* Central differences of step d have errors of d^2/6 times the third derivative, and of rounding/d. */
static void check_derivatives(const field *f, vec3 x, double *worst_gradient, double *worst_hessian)
{
    const double d = 1e-4 * f->cell_size;
    field_sample s, low, high;
    if (!field_sample_at(f, x, FIELD_HESSIAN, &s)) return;
    const double rows[3][3] = {{s.hessian.xx, s.hessian.xy, s.hessian.xz},
                               {s.hessian.xy, s.hessian.yy, s.hessian.yz},
                               {s.hessian.xz, s.hessian.yz, s.hessian.zz}};
    double scale = vec3_norm(s.gradient) + 1e-3; /* the values are of size 1; beyond them F is flat */
    for (int i = 0; i < 9; i++) scale += fabs(rows[i / 3][i % 3]) * f->cell_size;
    for (int axis = 0; axis < 3; axis++) {
        vec3 a = x, b = x;
        vec3_set(&a, axis, vec3_get(x, axis) - d);
        vec3_set(&b, axis, vec3_get(x, axis) + d);
        if (!field_sample_at(f, a, FIELD_GRADIENT, &low) || !field_sample_at(f, b, FIELD_GRADIENT, &high))
            return;
        double slope = (high.value - low.value) / (2 * d);
        *worst_gradient = fmax(*worst_gradient, fabs(slope - vec3_get(s.gradient, axis)) / scale);
        for (int other = 0; other < 3; other++) {
            double bend = (vec3_get(high.gradient, other) - vec3_get(low.gradient, other)) / (2 * d);
            *worst_hessian = fmax(*worst_hessian, fabs(bend - rows[axis][other]) * f->cell_size / scale);
        }
    }
}

static void derivatives_are_those_of_the_values(void **state)
{
    (void)state;
    /* The second derivative has kinks at cell faces: a difference across a face is the mean of two third
     * derivatives, of about 1 per voxel, times the step. In the gradient this is a sixth of the squared step,
     * compared with as little as a hundredth where F is flat. */
    const double gradient_tolerance = 1e-5, hessian_tolerance = 1e-3;
    uint64_t seed = SEED;
    for (size_t t = 0; t < TRANSFORMS; t++)
        for (int how = 0; how < 2; how++) {
            fixture g = fixture_make(transforms[t], 14, waves, 0);
            volume *v = fixture_volume(&g, 0.5, how ? VOLUME_SMOOTHING : VOLUME_INTERPOLATING);
            const field *f = volume_field(v);
            size_t cells = f->ops->cell_count(f);
            double gradient = 0, hessian = 0;
            for (int i = 0; i < 2000; i++) {
                vec3 x = fixture_cell_center(f, (size_t)(fixture_random(&seed) * (double)cells));
                for (int axis = 0; axis < 3; axis++)
                    vec3_set(&x, axis, vec3_get(x, axis) + (fixture_random(&seed) - 0.5) * 4 * f->cell_size);
                check_derivatives(f, x, &gradient, &hessian);
            }
            print_message("# transform %zu, reconstruction %d: gradient %.2e, hessian %.2e\n", t, how,
                          gradient, hessian);
            assert_true(gradient > 0 && gradient < gradient_tolerance);
            assert_true(hessian > 0 && hessian < hessian_tolerance);
            volume_close(v);
            fixture_free(&g);
        }
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The radius error of the unit ball in voxels (median and largest), and the median of both curvatures. */
static void measure_ball(const volume *v, double *median, double *largest, double curvature[2])
{
    const field *f = volume_field(v);
    size_t cells = f->ops->cell_count(f), n = 0;
    double *errors = mem_array(cells, sizeof(double), "errors", NULL),
           *k1 = mem_array(cells, sizeof(double), "k", NULL),
           *k2 = mem_array(cells, sizeof(double), "k", NULL);
    for (size_t k = 0; k < cells; k++) {
        vec3 x;
        field_sample s;
        assert_true(fixture_project(f, fixture_cell_center(f, k), &x));
        assert_true(field_sample_at(f, x, FIELD_HESSIAN, &s));
        errors[n] = fabs(vec3_norm(x) - 1) / volume_describe(v)->voxel_size;
        field_curvature(&s, &k1[n], &k2[n]);
        assert_true(vec3_dot(s.gradient, x) > 0);
        n++;
    }
    qsort(errors, n, sizeof(double), by_size);
    qsort(k1, n, sizeof(double), by_size);
    qsort(k2, n, sizeof(double), by_size);
    *median = errors[n / 2];
    *largest = errors[n - 1];
    curvature[0] = k1[n / 2];
    curvature[1] = k2[n / 2];
    free(errors);
    free(k1);
    free(k2);
}

static void a_ball_has_its_radius_and_curvature(void **state)
{
    (void)state;
    static const struct {
        const char *type;
        bool half;
        double median, largest; /* voxels: errors of the interpolation, and of the rounding of the values */
    } cases[] = {{"float", false, 5e-5, 5e-4}, {"float", true, 2e-4, 1e-3}, {"double", false, 5e-5, 5e-4}};
    for (size_t t = 0; t < TRANSFORMS; t++)
        for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
            /* Three voxels along the longest edge; the radius of the ball is 6.7 to 12.5 voxels. */
            fixture g = fixture_make(transforms[t], 18, ball, 3 * (t == 0 ? 0.1 : 0.15));
            g.draft.type = cases[c].type;
            g.draft.half = cases[c].half;
            volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
            double median, largest, k[2];
            measure_ball(v, &median, &largest, k);
            print_message(
                "# ball, transform %zu, %s%s: median %.6f, largest %.6f voxel, curvatures %.4f %.4f\n", t,
                cases[c].type, cases[c].half ? " as half" : "", median, largest, k[0], k[1]);
            assert_true(volume_describe(v)->level_set);
            assert_true(median < cases[c].median && largest < cases[c].largest);
            assert_true(fabs(k[0] - 1) < 0.02 && fabs(k[1] - 1) < 0.02);
            volume_close(v);
            fixture_free(&g);
        }
}

static double far_up(vec3 p)
{
    return 1e6 - 64 * ball(p);
}

static double near_zero(vec3 p)
{
    return -64 * ball(p);
}

/* Voxels of drafts are floats, which represent values near 1e6 to 1/16. Both volumes have such values, and
 * one isovalue is between two floats. */
static void the_isovalue_is_subtracted_before_doubles_become_floats(void **state)
{
    (void)state;
    fixture far = fixture_make(fixture_uniform, 14, far_up, 0),
            near = fixture_make(fixture_uniform, 14, near_zero, 0);
    far.draft.type = near.draft.type = "double";
    far.draft.background = 1e6 - 100;
    near.draft.background = -100;
    for (size_t k = 0; k < far.draft.voxel_count; k++) near.values[k] = (float)((double)far.values[k] - 1e6);
    volume *a = fixture_volume(&far, 1e6 + 0.01, VOLUME_INTERPOLATING),
           *b = fixture_volume(&near, 0.01, VOLUME_INTERPOLATING);
    const field *f = volume_field(a), *g = volume_field(b);
    assert_true(f->ops->cell_count(f) == g->ops->cell_count(g));
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        field_sample s, r;
        const vec3 x = fixture_cell_center(f, k);
        assert_true(field_sample_at(f, x, FIELD_GRADIENT, &s) && field_sample_at(g, x, FIELD_GRADIENT, &r));
        assert_true(fabs(s.value - r.value) < 1e-6);
    }
    volume_close(a);
    volume_close(b);
    fixture_free(&far);
    fixture_free(&near);
}

static void a_clamped_band_does_not_ring(void **state)
{
    (void)state;
    /* The same ball with a band of 3 voxels and with one of 9, which includes all values that have an
     * effect. */
    const double tolerance_vox = 1e-4, curvature_tolerance = 0.01;
    fixture narrow = fixture_make(fixture_uniform, 22, ball, 0.3),
            wide = fixture_make(fixture_uniform, 22, ball, 0.9);
    volume *a = fixture_volume(&narrow, NAN, VOLUME_INTERPOLATING),
           *b = fixture_volume(&wide, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(a), *g = volume_field(b);
    size_t cells = f->ops->cell_count(f);
    assert_int_equal(cells, g->ops->cell_count(g));
    double moved = 0, bent = 0;
    for (size_t k = 0; k < cells; k++) {
        vec3 x;
        field_sample s, r;
        double k1, k2, r1, r2;
        assert_true(fixture_project(f, fixture_cell_center(f, k), &x));
        assert_true(field_sample_at(f, x, FIELD_HESSIAN, &s) && field_sample_at(g, x, FIELD_HESSIAN, &r));
        moved = fmax(moved, fabs(r.value) / vec3_norm(r.gradient) / 0.1);
        field_curvature(&s, &k1, &k2);
        field_curvature(&r, &r1, &r2);
        bent = fmax(bent, fmax(fabs(k1 - r1), fabs(k2 - r2)));
    }
    print_message("# narrow against wide band: %.2e voxel, curvature %.2e of 1\n", moved, bent);
    assert_true(moved < tolerance_vox && bent < curvature_tolerance);
    volume_close(a);
    volume_close(b);
    fixture_free(&narrow);
    fixture_free(&wide);
}

static double large_ball(vec3 p)
{
    return vec3_norm(p) - 2.0;
}

/* A particle that leaves the surface must be able to return. */
static void the_field_is_extrapolated_beyond_the_band(void **state)
{
    (void)state;
    const double voxel = 0.1, margin = 4 * voxel;
    fixture g = fixture_make(fixture_uniform, 25, large_ball, 3 * voxel);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(v);
    double near = 0, far = 0, turned = 1;
    uint64_t r = SEED;
    for (int seen = 0; seen < 50000;) {
        const vec3 x = {6 * fixture_random(&r) - 3, 6 * fixture_random(&r) - 3, 6 * fixture_random(&r) - 3};
        field_sample s;
        const double d = large_ball(x), away = fabs(d);
        if (away > 2 * margin || !field_sample_at(f, x, FIELD_GRADIENT, &s)) continue;
        const double miss = fabs(s.value - d);
        seen++;
        if (away < margin)
            near = fmax(near, miss / voxel);
        else
            far = fmax(far, miss / away);
        turned = fmin(turned, vec3_dot(vec3_unit(s.gradient), vec3_unit(x)));
    }
    print_message(
        "# beyond the band: off by %.4f voxel within the margin, %.3f of the distance twice as far, cosine %.3f\n",
        near, far, turned);
    assert_true(near < 0.03 && far < 0.2 && turned > 0.4);
    volume_close(v);
    fixture_free(&g);
}

static void a_filled_inside_leaves_the_outside_clamped(void **state)
{
    (void)state;
    /* The whole inside is known; the outside is active but clamped, which must be detected. */
    fixture filled = fixture_make(fixture_uniform, 22, ball, 1.1),
            all = fixture_make(fixture_uniform, 22, ball, 1.1);
    for (size_t i = 0; i < filled.draft.voxel_count; i++) filled.values[i] = fminf(filled.values[i], 0.3f);
    filled.draft.background = 0.3;
    volume *a = fixture_volume(&filled, NAN, VOLUME_INTERPOLATING),
           *b = fixture_volume(&all, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(a), *g = volume_field(b);
    double moved = 0;
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        vec3 x;
        field_sample s;
        assert_true(fixture_project(f, fixture_cell_center(f, k), &x) &&
                    field_sample_at(g, x, FIELD_GRADIENT, &s));
        moved = fmax(moved, fabs(s.value) / vec3_norm(s.gradient) / 0.1);
    }
    print_message("# filled inside, clamped outside: %.2e voxel\n", moved);
    assert_true(moved < 1e-4);
    volume_close(a);
    volume_close(b);
    fixture_free(&filled);
    fixture_free(&all);
}

static double thin_box(vec3 p)
{
    double q[3] = {fabs(p.x) - 1, fabs(p.y) - 0.8, fabs(p.z) - 0.33}, outside = 0, inside = -INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        outside += fmax(q[axis], 0) * fmax(q[axis], 0);
        inside = fmax(inside, q[axis]);
    }
    return sqrt(outside) + fmin(inside, 0);
}

static void errors_at_edges_and_thin_walls_are_bounded(void **state)
{
    (void)state;
    /* The interior is 6.6 voxels thick, so both bands nearly meet there. At sharp edges a cubic spline rounds
     * and overshoots by a part of a voxel, most in cells that it enters between their corners. The kink in
     * the middle contributes at most 0.268^3.3 of its bend at the faces. Runs of known voxels end beside
     * it. */
    fixture g = fixture_make(fixture_uniform, 16, thin_box, 0.3);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(v);
    double worst = 0, flat = 0;
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        vec3 x, middle = fixture_cell_center(f, k);
        assert_true(fixture_project(f, middle, &x));
        double miss = fabs(thin_box(x)) / 0.1;
        worst = fmax(worst, miss);
        if (fabs(middle.x) < 0.5 && fabs(middle.y) < 0.4) flat = fmax(flat, miss);
    }
    print_message("# box: largest miss %.4f voxel, on the flat %.2e\n", worst, flat);
    assert_true(worst < 0.2 && flat < 5e-3);
    volume_close(v);
    fixture_free(&g);
}

static void smoothing_blurs_by_what_theory_says(void **state)
{
    (void)state;
    /* Samples used as coefficients add the Laplacian / 6: 2/R/6 of a voxel for a ball of R = 10 voxels,
     * inwards. */
    fixture g = fixture_make(fixture_uniform, 16, ball, 0.4);
    volume *v = fixture_volume(&g, NAN, VOLUME_SMOOTHING);
    const field *f = volume_field(v);
    double mean = 0;
    size_t cells = f->ops->cell_count(f);
    for (size_t k = 0; k < cells; k++) {
        vec3 x;
        field_cell cell;
        field_sample s;
        assert_true(fixture_project(f, fixture_cell_center(f, k), &x));
        mean += (1 - vec3_norm(x)) / 0.1 / (double)cells;
        f->ops->cell(f, k, &cell);
        assert_true(field_sample_at(f, cell.corner[0], FIELD_GRADIENT, &s));
        assert_true(fabs(s.value - cell.value[0]) < 1e-6);
    }
    print_message("# smoothing moves the ball by %.5f voxel\n", mean);
    assert_true(fabs(mean - 1.0 / 30) < 0.003);
    volume_close(v);
    fixture_free(&g);
}

static void an_isovalue_moves_a_level_set(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 18, ball, 0.4);
    volume *v = fixture_volume(&g, 0.1, VOLUME_INTERPOLATING);
    const field *f = volume_field(v);
    for (size_t k = 0; k < f->ops->cell_count(f); k += 7) {
        vec3 x;
        assert_true(fixture_project(f, fixture_cell_center(f, k), &x));
        assert_true(fabs(vec3_norm(x) - 1.1) < 1e-4);
    }
    volume_close(v);
    fixture_free(&g);
}

static void surfaces_on_the_faces_of_tiles_are_found(void **state)
{
    (void)state;
    /* A fog cube of one tile of 128^3, and a tile of 8^3 beside it, without leaves. */
    const vdb_tile tiles[] = {{{0, 0, 0}, 128, 1, true}, {{256, 8, 16}, 8, 1, true}};
    vdb_draft draft = {.name = "tiles",
                       .type = "float",
                       .grid_class = VDB_FOG,
                       .index_to_world = fixture_uniform,
                       .tile_count = 2,
                       .tiles = tiles};
    error e = {0};
    int fd = fixture_write(&draft, 1, VDB_SEEKABLE, false);
    volume *v = fixture_open(fd, NULL, 0.5, VOLUME_INTERPOLATING, &e);
    if (!v) fail_msg("%s", e.message);
    const uint64_t large = 129 * 129 * 129 - 127 * 127 * 127, small = 9 * 9 * 9 - 7 * 7 * 7;
    assert_int_equal(volume_describe(v)->crossing_cells, large + small);
    vec3 x;
    assert_true(fixture_project(volume_field(v), (vec3){6.4, 6.4, 12.74}, &x));
    assert_true(fabs(x.z - 12.75) < 1e-5); /* half way between voxels 127 and 128 */
    volume_close(v);
    close(fd);
}

static void files_without_offsets_read_the_same(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_rotated, 18, ball, 0.45);
    vdb_draft drafts[3];
    for (int i = 0; i < 3; i++) drafts[i] = fixture_draft(&g);
    drafts[0].type = "vec3s";
    drafts[1].type = "int32";
    for (int layout = 0; layout < 2; layout++)
        for (int packed = 0; packed < 2; packed++) {
            error e = {0};
            int fd = fixture_write(drafts, 3, layout ? VDB_STREAM : VDB_SEEKABLE, packed);
            volume *v = fixture_open(fd, "surface[2]", NAN, VOLUME_INTERPOLATING, &e);
            if (!v) fail_msg("layout %d: %s", layout, e.message);
            double median, largest, k[2];
            measure_ball(v, &median, &largest, k);
            assert_true(median < 5e-4);
            assert_string_equal(volume_describe(v)->grid, "surface[2]");
            volume_close(v);
            close(fd);
        }
    fixture_free(&g);
}

static void opening_twice_gives_the_same_bits(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_rotated, 14, waves, 0);
    volume *a = fixture_volume(&g, 0.5, VOLUME_INTERPOLATING),
           *b = fixture_volume(&g, 0.5, VOLUME_INTERPOLATING);
    const field *f = volume_field(a), *h = volume_field(b);
    assert_int_equal(f->ops->cell_count(f), h->ops->cell_count(h));
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        field_cell p = {0}, q = {0};
        field_sample s, r;
        f->ops->cell(f, k, &p);
        h->ops->cell(h, k, &q);
        assert_memory_equal(&p, &q, sizeof p);
        assert_true(field_sample_at(f, p.corner[0], FIELD_HESSIAN, &s) &&
                    field_sample_at(h, p.corner[0], FIELD_HESSIAN, &r));
        assert_memory_equal(&s, &r, sizeof s);
    }
    volume_close(a);
    volume_close(b);
    fixture_free(&g);
}

static void outside_the_coefficient_blocks_there_is_no_field(void **state)
{
    (void)state;
    fixture g = fixture_make(fixture_uniform, 14, ball, 0.3);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    const field *f = volume_field(v);
    field_sample s = {.value = 42};
    const vec3 far[] = {{1e9, 0, 0}, {0, -1e300, 0}, {NAN, 0, 0}, {0, INFINITY, 0}, {3, 3, 3}};
    for (size_t i = 0; i < sizeof far / sizeof *far; i++)
        assert_false(field_sample_at(f, far[i], FIELD_HESSIAN, &s));
    assert_true(s.value == 42);
    const volume_info *info = volume_describe(v);
    assert_true(fabs(f->extent - 2) <= 0.21 && !f->open && fabs(f->cell_size - 0.1) < 1e-9);
    assert_true(bbox_contains(f->domain, info->surface_box.min) &&
                bbox_contains(f->domain, info->surface_box.max));
    volume_close(v);
    fixture_free(&g);
}

/* The area of the zero set by the co-area formula: the mean of |grad F| where |F| is below the band, at
 * random points. */
static double area_by_chance(const field *f, double band, int draws)
{
    uint64_t r = SEED;
    vec3 low = f->domain.min, size = bbox_size(f->domain);
    double sum = 0;
    for (int k = 0; k < draws; k++) {
        field_sample s;
        vec3 x = low;
        for (int axis = 0; axis < 3; axis++)
            vec3_set(&x, axis, vec3_get(low, axis) + fixture_random(&r) * vec3_get(size, axis));
        if (field_sample_at(f, x, FIELD_GRADIENT, &s) && fabs(s.value) < band) sum += vec3_norm(s.gradient);
    }
    return sum / draws * size.x * size.y * size.z / (2 * band);
}

/* Waves of three voxels on a ball: without the cells that the surface crosses between their corners, 1 % of
 * the area is missing. */
static double ripples(vec3 p)
{
    return 1.1 - vec3_norm(p) +
           0.05 * (sin(19 * p.x + 7 * p.y) + sin(17 * p.y - 9 * p.z) + sin(21 * p.z + 5 * p.x));
}

static void area_between_corners_counts(void **state)
{
    (void)state;
    error e = {0};
    fixture g = fixture_make(fixture_uniform, 12, ripples, 0);
    volume *v = fixture_volume(&g, 0.5, VOLUME_INTERPOLATING);
    threads *pool = threads_new(1, NULL, &e);
    surface *s = surface_scan(volume_field(v), pool, &e);
    assert_non_null(s);
    double area = s->area, by_chance = area_by_chance(volume_field(v), 0.02, 3000000);
    print_message("# area of ripples %g, by chance %g\n", area, by_chance);
    assert_true(fabs(area / by_chance - 1) < 0.01);
    surface_free(s);
    threads_free(pool);
    volume_close(v);
    fixture_free(&g);
}

/* Radii in voxels of .1; a ball has no major radius. */
static double major, minor;
static double torus(vec3 p)
{
    return hypot(hypot(p.x, p.y) - 0.1 * major, p.z) - 0.1 * minor;
}

/* For any fraction of gentle cells: all, some, and none. Only with areas by roots next to areas without, the
 * error exceeds a hundredth of a percent. */
static void areas_are_right_however_cells_bend(void **state)
{
    static const double radii[][2] = {{0, 8},  {0, 10}, {0, 11}, {0, 12}, {0, 13},
                                      {0, 14}, {0, 20}, {24, 8}, {24, 11}};
    (void)state;
    for (size_t k = 0; k < sizeof radii / sizeof *radii; k++) {
        error e = {0};
        major = radii[k][0];
        minor = radii[k][1];
        fixture g = fixture_make(fixture_uniform, (int)(major + minor) + 5, torus, 0.3);
        volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
        surface *s = surface_scan(volume_field(v), NULL, &e);
        if (!s) fail_msg("%s", e.message);
        const double voxels = s->area * 100, exact = (major > 0 ? M_PI * major : minor) * 4 * M_PI * minor;
        print_message("# radii %g, %g: area off by %.2g\n", major, minor, voxels / exact - 1);
        assert_close(voxels, exact, 5e-5 * exact);
        surface_free(s);
        volume_close(v);
        fixture_free(&g);
    }
}

/* A region cuts a ball all of whose cells are gentle: caps, beginning at the equator. */
static void areas_of_caps_are_right(void **state)
{
    (void)state;
    error e = {0};
    major = 0;
    minor = 14;
    fixture g = fixture_make(fixture_uniform, (int)minor + 5, torus, 0.3);
    volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
    for (double from = 0.01; from < 0.9; from += 0.17) {
        const double radius = 0.1 * minor, exact = 2 * M_PI * radius * radius * (1 - from);
        region *cap = region_new(volume_field(v), (bbox){{-2, -2, from * radius}, {2, 2, 2}}, &e);
        surface *s = cap ? surface_scan(region_field(cap), NULL, &e) : NULL;
        if (!s) fail_msg("%s", e.message);
        print_message("# a cap from %g: area off by %.2g\n", from, s->area / exact - 1);
        assert_close(s->area, exact, 5e-5 * exact);
        surface_free(s);
        region_free(cap);
    }
    volume_close(v);
    fixture_free(&g);
}

/* Places near a cell, in the next coefficient block, beyond all of them, and in masked lanes. */
static void draw_lanes(const field *f, uint64_t *seed, vec3_lanes *x, bool *defined)
{
    for (int l = 0; l < VEC3_LANES; l++) {
        size_t cells = f->ops->cell_count(f);
        vec3 p = fixture_cell_center(f, (size_t)(fixture_random(seed) * (double)cells) % cells);
        double far = l == 5 ? 1e3 : 2;
        x->x[l] = p.x + far * f->cell_size * (fixture_random(seed) - 0.5);
        x->y[l] = p.y + far * f->cell_size * (fixture_random(seed) - 0.5);
        x->z[l] = p.z + far * f->cell_size * (fixture_random(seed) - 0.5);
        defined[l] = l != 3;
    }
}

/* Sixteen samples in lanes, in single precision, equal those of `sample` to rounding. They do not depend on
 * the instruction set or on the other lanes. */
static void lanes_equal_samples_in_single_precision(void **state)
{
    (void)state;
    const double tolerance =
        4e-6; /* of a voxel; floats carry 6e-8 of the ten voxels that coefficient blocks reach */
    int fd = fixture_bytes(NULL, 0);
    volume *v[ISA_COUNT] = {0};
    uint64_t seed = SEED;
    error e = {0};
    assert_true(example_write(fd, &e));
    for (isa which = 0; which < ISA_COUNT; which++) {
        const volume_request request = {
            .fd = fd, .path = "f.vdb", .memory_limit = FIXTURE_MEMORY, .isa = which};
        if (isa_available(which) && !(v[which] = volume_open(&request, &e))) fail_msg("%s", e.message);
    }
    const field *f = volume_field(v[ISA_PORTABLE]);
    for (int round = 0; round < 300; round++) {
        vec3_lanes x, gradient, again;
        bool wanted[VEC3_LANES], defined[VEC3_LANES], also[VEC3_LANES];
        double value[VEC3_LANES], same[VEC3_LANES];
        draw_lanes(f, &seed, &x, wanted);
        memcpy(defined, wanted, sizeof wanted);
        field_sample_lanes(f, &x, defined, value, &gradient);
        for (int l = 0; l < VEC3_LANES; l++) {
            field_sample s;
            bool there = field_sample_at(f, (vec3){x.x[l], x.y[l], x.z[l]}, FIELD_GRADIENT, &s);
            assert_int_equal(defined[l], wanted[l] && there);
            if (!defined[l]) continue;
            assert_true(fabs(value[l] - s.value) < tolerance * f->cell_size);
            vec3 off = vec3_sub((vec3){gradient.x[l], gradient.y[l], gradient.z[l]}, s.gradient);
            assert_true(vec3_norm(off) < 4 * tolerance);
        }
        for (isa which = ISA_AVX2; which < ISA_COUNT; which++) {
            if (!v[which]) continue;
            memcpy(also, wanted, sizeof wanted);
            also[7] = false;
            field_sample_lanes(volume_field(v[which]), &x, also, same, &again);
            for (int l = 0; l < VEC3_LANES; l++)
                assert_true(l == 7 || !defined[l] ||
                            (also[l] && same[l] == value[l] && again.x[l] == gradient.x[l] &&
                             again.y[l] == gradient.y[l] && again.z[l] == gradient.z[l]));
        }
    }
    for (isa which = 0; which < ISA_COUNT; which++) volume_close(v[which]);
    close(fd);
}

static void the_example_is_a_knot(void **state)
{
    (void)state;
    error e = {0};
    int fd = fixture_bytes(NULL, 0);
    assert_true(example_write(fd, &e));
    assert_true(lseek(fd, 0, SEEK_END) < 500000);
    volume *v = fixture_open(fd, EXAMPLE_GRID, NAN, VOLUME_INTERPOLATING, &e);
    if (!v) fail_msg("%s", e.message);
    const field *f = volume_field(v);
    double k1, k2;
    for (size_t k = 0; k < f->ops->cell_count(f); k += 11) {
        vec3 x;
        field_sample s;
        assert_true(fixture_project(f, fixture_cell_center(f, k), &x));
        assert_true(field_sample_at(f, x, FIELD_HESSIAN, &s));
        field_curvature(&s, &k1, &k2);
        assert_true(fabs(k1 - 1 / EXAMPLE_TUBE_RADIUS) < 0.25 / EXAMPLE_TUBE_RADIUS);
    }
    print_message("# example: %llu voxels, %lld bytes\n",
                  (unsigned long long)volume_describe(v)->active_voxels, (long long)lseek(fd, 0, SEEK_END));
    volume_close(v);
    close(fd);
}

/* The largest distance of a surface from the points of a ball, one of which is missing, in spacings; the
 * spacings may differ. */
static double farthest_without(const surface *s, int left_out, bool is_graded)
{
    enum { POINTS = 14 };
    error e = {0};
    vec3 x[POINTS];
    double spacing[POINTS], found = 0;
    size_t count = 0;
    for (int k = 0; k < POINTS; k++) { /* the faces and the corners of a cube */
        vec3 to = {k & 1 ? 1 : -1, k >> 1 & 1 ? 1 : -1, k >> 2 & 1 ? 1 : -1};
        if (k >= 8) {
            to = (vec3){0, 0, 0};
            vec3_set(&to, (k - 8) / 2, k & 1 ? 1 : -1);
        }
        spacing[count] = (is_graded && k % 2 ? 0.6 : 0.8) * minor / 10;
        if (k != left_out) x[count++] = vec3_scale(vec3_unit(to), minor / 10);
    }
    threads *pool = threads_new(1, NULL, &e);
    assert_true(coverage_measure(s, x, spacing, count, pool, &found, &e));
    threads_free(pool);
    return found;
}

static const field_ops *volume_ops;
static size_t looks; /* number of accesses to the centres of cells */

static vec3 look_at_middle(const field *f, size_t k, double *radius)
{
    looks++;
    return volume_ops->cell_middle(f, k, radius);
}

/* Blocks near enough to a point are skipped. They contain no gap, and their cells lie within them. */
static void skipped_blocks_hide_no_gap(void **state)
{
    (void)state;
    const double *const matrices[] = {fixture_uniform, fixture_rotated};
    major = 0;
    minor = 32; /* enough cells that some are examined first */
    for (int t = 0; t < 2; t++) {
        error e = {0};
        fixture g = fixture_make(matrices[t], 46, torus, 0.5);
        volume *v = fixture_volume(&g, NAN, VOLUME_INTERPOLATING);
        const field *f = volume_field(v);
        field *changed = (field *)(uintptr_t)f;
        surface *s = surface_scan(f, NULL, &e);
        if (!s) fail_msg("%s", e.message);
        size_t groups = 0, end = 0;
        for (size_t k = 0; k < s->cells; k = end, groups++) {
            vec3 middle;
            double radius;
            assert_true(surface_cell_group(s, k, &end, &middle, &radius) && end > k && end <= s->cells);
            for (size_t i = k; i < end; i++) {
                field_cell cell;
                surface_cell(s, i, &cell);
                for (int c = 0; c < 8; c++)
                    assert_true(vec3_norm(vec3_sub(cell.corner[c], middle)) <= radius * (1 + 1e-9));
            }
        }
        assert_true(groups < s->cells / 10);
        volume_ops = f->ops;
        field_ops counted = *volume_ops, plain;
        counted.cell_middle = look_at_middle;
        plain = counted;
        plain.cell_group = NULL;
        const double all_found = farthest_without(s, -1, false);
        for (int k = -1; k < (t == 0 ? 28 : 14); k++) { /* with differing spacings from 14 */
            const int left_out = k < 14 ? k : k - 14;
            size_t looks_of[2];
            double found[2];
            for (int i = 0; i < 2; i++) {
                looks = 0;
                changed->ops = i ? &counted : &plain;
                found[i] = farthest_without(s, left_out, k >= 14);
                looks_of[i] = looks;
            }
            assert_true(found[0] == found[1] && looks_of[1] < 0.8 * (double)looks_of[0]);
            assert_true(k < 0 || k >= 14 || found[0] > all_found);
        }
        changed->ops = volume_ops;
        surface_free(s);
        volume_close(v);
        fixture_free(&g);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(skipped_blocks_hide_no_gap),
        cmocka_unit_test(the_spline_goes_through_the_samples),
        cmocka_unit_test(the_spline_interpolates_a_narrow_band),
        cmocka_unit_test(one_part_is_distinguished_from_two),
        cmocka_unit_test(a_face_in_a_plane_of_voxels_is_in_one_layer_of_cells),
        cmocka_unit_test(derivatives_are_those_of_the_values),
        cmocka_unit_test(a_ball_has_its_radius_and_curvature),
        cmocka_unit_test(the_isovalue_is_subtracted_before_doubles_become_floats),
        cmocka_unit_test(a_clamped_band_does_not_ring),
        cmocka_unit_test(the_field_is_extrapolated_beyond_the_band),
        cmocka_unit_test(a_filled_inside_leaves_the_outside_clamped),
        cmocka_unit_test(errors_at_edges_and_thin_walls_are_bounded),
        cmocka_unit_test(smoothing_blurs_by_what_theory_says),
        cmocka_unit_test(an_isovalue_moves_a_level_set),
        cmocka_unit_test(surfaces_on_the_faces_of_tiles_are_found),
        cmocka_unit_test(files_without_offsets_read_the_same),
        cmocka_unit_test(opening_twice_gives_the_same_bits),
        cmocka_unit_test(outside_the_coefficient_blocks_there_is_no_field),
        cmocka_unit_test(area_between_corners_counts),
        cmocka_unit_test(areas_are_right_however_cells_bend),
        cmocka_unit_test(areas_of_caps_are_right),
        cmocka_unit_test(lanes_equal_samples_in_single_precision),
        cmocka_unit_test(the_example_is_a_knot),
    };
    return cmocka_run_group_tests_name("volume", tests, NULL, NULL);
}
