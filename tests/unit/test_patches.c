/* Surfaces of patches that meet in curves, from the start to the triangles: flat faces, whose curves and corners are known. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "faces.h"
#include "packing/quality.h"
#include "packing/triangulation.h"
#include "sampler/sampler.h"
#include "shapes.h"
#include "surface/coverage.h"
#include "surface/curve_distance.h"
#include "surface/curve_rows.h"

static const sampler_params even = {.count = 2000,
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
    sampler *s;
    const sampler_points *points;
    quality q;
    triangulation mesh;
    double farthest; /* place of the surface from the points, in spacings */
} solved;

static bool is_within(const void *context, uint32_t label, vec3 x)
{
    return field_is_within(field_of_patch(context, label), x);
}

static void solve(const faces *f, const sampler_params *params, int workers, solved *out)
{
    error e = {0};
    *out = (solved){.faces = f, .pool = threads_new(workers, NULL, &e)};
    out->scan = surface_scan(&f->base, out->pool, &e);
    out->s = sampler_new(&f->base, out->scan, params, out->pool, &e);
    if (!out->s) fail_msg("%s", e.message);
    while (!sampler_ended(out->s))
        if (!sampler_step(out->s, &e)) fail_msg("%s", e.message);
    if (!sampler_finalize(out->s, &e)) fail_msg("%s", e.message);
    out->points = sampler_result_points(out->s);
    const sampler_stands *stands = &out->points->stands;
    const quality_input in = {.count = stands->count,
                              .position = stands->position,
                              .normal = stands->normal,
                              .spacing = stands->spacing,
                              .h = sampler_spacing(out->s),
                              .label = stands->patch,
                              .flags = stands->flags};
    assert_true(quality_measure(&in, out->pool, NULL, NULL, &out->q, &e));
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
    assert_true(coverage_measure(out->scan, out->points->position, out->points->spacing, out->points->count,
                                 out->pool, &out->farthest, &e));
}

static void release(solved *x)
{
    triangulation_free(&x->mesh);
    sampler_free(x->s);
    surface_free(x->scan);
    threads_free(x->pool);
}

/* Every point is on a face, those on curves and corners exactly, and they are equally far from each other. */
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
    for (size_t c = 0; c < f->patches.curve_count; c++) {
        vec3 from = f->vertex[2 * c], side = vec3_sub(f->vertex[2 * c + 1], from);
        double length = vec3_norm(side), steps = 0, off = 0;
        for (size_t i = 0; i < x->points->count; i++) {
            vec3 r = vec3_sub(x->points->position[i], from);
            double along = vec3_dot(r, side) / length, height2 = vec3_norm2(r) - along * along;
            if (x->points->feature[i] != SAMPLER_ON_PATCH && height2 < 1e-20 && along < length - 1e-9)
                steps++;
        }
        assert_close(steps, round(length / sampler_spacing(x->s)), 0.5);
        for (size_t i = 0; i < x->points->count; i++) {
            vec3 r = vec3_sub(x->points->position[i], from);
            double along = vec3_dot(r, side) / length, height2 = vec3_norm2(r) - along * along;
            if (x->points->feature[i] == SAMPLER_ON_PATCH || height2 >= 1e-20) continue;
            off = fmax(off, fabs(along * steps / length - round(along * steps / length)));
        }
        assert_true(off < 1e-9);
    }
    assert_true(on[SAMPLER_ON_PATCH] + on[SAMPLER_ON_CURVE] + on[SAMPLER_ON_CORNER] == x->points->count);
}

static void a_cube_has_rows_along_its_edges(void **state)
{
    (void)state;
    static faces cube;
    make_cube(&cube);
    const size_t counts[] = {150, 2000, 10000};
    for (size_t k = 0; k < sizeof counts / sizeof *counts; k++) {
        sampler_params params = even;
        solved x;
        params.count = counts[k];
        params.seed = test_seed() + k;
        solve(&cube, &params, 2, &x);
        print_message(
            "count %zu: hex %.4f edge_cv %.4f excess %.4f farthest %.3f rim %zu closing %zu nonmanifold "
            "%zu %zu boundary %zu\n",
            counts[k], x.q.resolved.hex_fraction, x.q.resolved.edge_cv, x.q.energy_excess, x.farthest,
            x.q.rim_count, x.mesh.facts.closing, x.mesh.facts.nonmanifold_edges,
            x.mesh.facts.nonmanifold_vertices, x.mesh.facts.boundary_edges);
        assert_int_equal(x.points->count, counts[k]);
        assert_int_equal(sampler_result(x.s), SAMPLER_CONVERGED);
        check_places(&x);
        assert_true(x.farthest < 1);
        assert_true(counts[k] < 5000 || x.q.resolved.hex_fraction >= 0.93);
        assert_true(triangulation_is_closed(&x.mesh.facts));
        assert_int_equal(x.mesh.facts.euler, 2);
        release(&x);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_has_rows_along_its_edges),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
