// SPDX-License-Identifier: Apache-2.0
/* Refinement of spheres: the edges that get a particle, found here pair by pair. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/voronoi/voronoi.h"
#include "sampling/solver/passes/refine.h"
#include "shapes.h"

enum { POINTS = 600, EDGES = 3 * POINTS - 6, MOST = 4 * EDGES };

typedef struct ball {
    analytic *field;
    particles *p;
    double spacing;
    threads *pool;
} ball;

static double sphere_spacing(size_t count)
{
    return sqrt(8 * M_PI / (sqrt(3) * (double)count)) * shapes[0].radius;
}

/* A perturbed Fibonacci lattice on the first shape, without a belt of three times `gap` of the radius. */
static void make_ball(ball *b, double gap, int workers, const volatile sig_atomic_t *stop)
{
    error e = {0};
    rng r = rng_seed(test_seed(), 0);
    b->field = analytic_new(&shapes[0], NULL, &e);
    b->pool = threads_new(workers, stop, &e);
    b->p = particles_new(MOST, &e);
    if (!b->field || !b->pool || !b->p) fail_msg("%s", e.message);
    b->spacing = sphere_spacing(POINTS);
    b->p->count = 0;
    for (int k = 0; k < POINTS; k++) {
        double z = 1 - (2 * k + 1.0) / POINTS, turn = k * M_PI * (3 - sqrt(5)), w = sqrt(1 - z * z);
        vec3 noise = random_between(&r, (vec3){-0.05, -0.05, -0.05}, (vec3){0.05, 0.05, 0.05});
        vec3 n = vec3_unit(
            vec3_axpy(b->spacing / shapes[0].radius, noise, (vec3){w * cos(turn), w * sin(turn), z}));
        if (n.z > -gap && n.z < 2 * gap) continue;
        b->p->position[b->p->count] = vec3_axpy(shapes[0].radius, n, shapes[0].center);
        b->p->normal[b->p->count] = n;
        b->p->size[b->p->count++] = 1;
    }
}

static void free_ball(ball *b)
{
    particles_free(b->p);
    threads_free(b->pool);
    analytic_free(b->field);
}

static void refine_ball(ball *b, size_t count)
{
    error e = {0};
    refine_mesh *m = refine_mesh_new(b->p, b->spacing, b->pool, &e);
    if (!m ||
        !refine_particles(&b->field->base, NULL, NULL, NULL, m, b->p, count, b->spacing, 1, b->pool, &e))
        fail_msg("%s", e.message);
    refine_mesh_free(m);
    assert_int_equal(b->p->count, count);
}

typedef struct span {
    uint32_t a, b;
    double length;
} span;

static int compare_spans(const void *x, const void *y)
{
    const span *a = x, *b = y;
    return (a->length > b->length) - (a->length < b->length);
}

/* Shortest first. */
static size_t find_spans(const ball *b, span *out)
{
    error e = {0};
    size_t found = 0;
    double spacing[POINTS];
    for (int k = 0; k < POINTS; k++) spacing[k] = b->spacing;
    neighbours *near = neighbours_new(POINTS, SIZE_MAX, &e);
    if (!near || !neighbours_build(near, b->p->count, b->p->position, spacing, VORONOI_REACH, b->pool, &e))
        fail_msg("%s", e.message);
    const voronoi_sites sites = {b->p->position, b->p->normal, spacing, near, NULL, NULL};
    for (uint32_t i = 0; i < b->p->count; i++) {
        voronoi_star star;
        voronoi_star_triangles(&sites, i, &star);
        for (uint32_t k = 0; k < star.count; k++)
            if (star.point[k] > i) out[found++] = (span){i, star.point[k], star.distance[k]};
    }
    neighbours_free(near);
    qsort(out, found, sizeof *out, compare_spans);
    return found;
}

/* Number of new particles, beginning at `first`, above the point at a share of a span. */
static int count_over(const ball *b, size_t first, const span *s, double share)
{
    vec3 from = b->p->position[s->a], along = vec3_sub(b->p->position[s->b], from);
    vec3 n = vec3_unit(vec3_sub(vec3_axpy(share, along, from), shapes[0].center));
    int found = 0;
    for (size_t k = first; k < b->p->count; k++) {
        vec3 x = vec3_axpy(shapes[0].radius, n, shapes[0].center);
        found += vec3_norm(vec3_sub(b->p->position[k], x)) < 1e-3 * b->spacing;
    }
    return found;
}

/* A field that ends closer to its surface than the midpoints of edges, like the band of a level set. */
static const double BAND = 1e-4; /* of the radius */
static const field_ops *whole;

static bool sample_in_band(const field *f, vec3 x, field_order order, field_sample *out)
{
    const double away = vec3_norm(vec3_sub(x, shapes[0].center)) / shapes[0].radius - 1;
    return fabs(away) < BAND && whole->sample(f, x, order, out);
}

/* Refines with `more` particles than there are edges, and checks that each span gets the expected number:
 * none, one or two. */
static void try_refining(int more, bool narrow)
{
    ball b;
    span spans[EDGES];
    make_ball(&b, 0, 1, NULL);
    whole = b.field->base.ops;
    field_ops in_band = *whole;
    in_band.sample = sample_in_band;
    in_band.sample_lanes = NULL;
    if (narrow) b.field->base.ops = &in_band;
    size_t first = b.p->count;
    assert_int_equal(find_spans(&b, spans), EDGES);
    refine_ball(&b, (size_t)(POINTS + EDGES + more));
    for (int k = 0; k < EDGES; k++) {
        bool none = k < -more, two = k >= EDGES - more;
        assert_int_equal(count_over(&b, first, &spans[k], 0.5), !none && !two);
        assert_int_equal(count_over(&b, first, &spans[k], 1.0 / 3), two);
        assert_int_equal(count_over(&b, first, &spans[k], 2.0 / 3), two);
    }
    free_ball(&b);
}

static void shortest_edges_get_no_particle_and_longest_two(void **state)
{
    (void)state;
    try_refining(0, false);
    try_refining(-1, false);
    try_refining(-37, false);
    try_refining(-EDGES, false);
    try_refining(1, false);
    try_refining(53, false);
    try_refining(EDGES, false);
}

static void midpoints_outside_the_band_are_projected(void **state)
{
    (void)state;
    try_refining(0, true);
    try_refining(400, true);
}

static void edges_are_counted(void **state)
{
    (void)state;
    ball b;
    error e = {0};
    make_ball(&b, 0, 2, NULL);
    refine_mesh *m = refine_mesh_new(b.p, b.spacing, b.pool, &e);
    assert_non_null(m);
    assert_int_equal(refine_mesh_edges(m), EDGES);
    refine_mesh_free(m);
    assert_int_equal(b.p->count, POINTS);
    free_ball(&b);
}

/* Two caps of different size, separated by a belt that no edge crosses. */
static void parts_keep_their_shares(void **state)
{
    (void)state;
    for (int times = 2; times <= 5; times++) {
        ball b;
        size_t north = 0, finer = 0;
        make_ball(&b, 0.25, 1, NULL);
        size_t count = b.p->count;
        for (size_t k = 0; k < count; k++) north += b.p->normal[k].z > 0;
        assert_in_range(north, 1, count / 2 - 1);
        refine_ball(&b, (size_t)times * count);
        for (size_t k = 0; k < b.p->count; k++) finer += b.p->normal[k].z > 0;
        assert_int_equal(finer, (size_t)times * north);
        free_ball(&b);
    }
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    const int workers[] = {2, 3, 8};
    ball one;
    make_ball(&one, 0, 1, NULL);
    refine_ball(&one, POINTS + EDGES - 7);
    for (int k = 0; k < 3; k++) {
        ball b;
        make_ball(&b, 0, workers[k], NULL);
        refine_ball(&b, one.p->count);
        assert_memory_equal(b.p->position, one.p->position, one.p->count * sizeof *one.p->position);
        assert_memory_equal(b.p->normal, one.p->normal, one.p->count * sizeof *one.p->normal);
        free_ball(&b);
    }
    free_ball(&one);
}

static void a_stop_ends_it(void **state)
{
    (void)state;
    volatile sig_atomic_t stop = 0;
    error e = {0};
    ball b;
    make_ball(&b, 0, 2, &stop);
    refine_mesh *m = refine_mesh_new(b.p, b.spacing, b.pool, &e);
    assert_non_null(m);
    stop = 1;
    assert_false(refine_particles(&b.field->base, NULL, NULL, NULL, m, b.p, MOST, b.spacing, 1, b.pool, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    refine_mesh_free(m);
    e = (error){0};
    assert_null(refine_mesh_new(b.p, b.spacing, b.pool, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    free_ball(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shortest_edges_get_no_particle_and_longest_two),
        cmocka_unit_test(midpoints_outside_the_band_are_projected),
        cmocka_unit_test(edges_are_counted),
        cmocka_unit_test(parts_keep_their_shares),
        cmocka_unit_test(result_does_not_depend_on_threads),
        cmocka_unit_test(a_stop_ends_it),
    };
    return cmocka_run_group_tests_name("refine", tests, NULL, NULL);
}
