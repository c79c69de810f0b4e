// SPDX-License-Identifier: Apache-2.0
/* Whether points resolve their surface: hexagonal lattices, opposite or bent, with known results. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "shapes.h"
#include "sampling/voronoi/resolution.h"

enum { SIDE = 40, LATTICE = SIDE * SIDE, MOST = 2 * LATTICE + 1 };

/* A lattice of spacing 1 that is open at its outline, and points below it with opposite normals. */
typedef struct scene {
    vec3 position[MOST], normal[MOST];
    double spacing[MOST];
    resolution_input in;
} scene;

static scene *make_scene(void)
{
    scene *s = calloc(1, sizeof *s);
    for (int k = 0; k < MOST; k++) s->spacing[k] = 1;
    for (int k = 0; k < LATTICE; k++) {
        s->position[k] = (vec3){k % SIDE + 0.5 * (k / SIDE & 1), k / SIDE * sqrt(3) / 2, 0};
        s->normal[k] = (vec3){0, 0, 1};
    }
    s->in = (resolution_input){.count = LATTICE,
                               .position = s->position,
                               .normal = s->normal,
                               .spacing = s->spacing,
                               .open = true,
                               .domain = {{0, 0, -SIDE}, {SIDE - 0.5, (SIDE - 1) * sqrt(3) / 2, SIDE}}};
    return s;
}

/* Adds the first `rows` rows of the opposite wall, `gap` below. */
static void add_wall(scene *s, double gap, int rows)
{
    for (int k = 0; k < rows * SIDE; k++) {
        s->position[s->in.count] = vec3_add(s->position[k], (vec3){0.5, 0.3, -gap});
        s->normal[s->in.count++] = (vec3){0, 0, -1};
    }
}

static resolution measure(const scene *s, int workers)
{
    error e = {0};
    resolution r;
    threads *pool = threads_new(workers, NULL, &e);
    if (!resolution_measure(&s->in, pool, &r, &e)) fail_msg("%s", e.message);
    threads_free(pool);
    return r;
}

static resolution measure_plate(double gap, int rows)
{
    scene *s = make_scene();
    add_wall(s, gap, rows);
    const resolution r = measure(s, 2);
    free(s);
    return r;
}

static void a_lattice_is_resolved_and_ordered(void **state)
{
    (void)state;
    const resolution r = measure_plate(0, 0);
    assert_true(r.resolved == 1 && r.hex == 1);
}

static void walls_closer_than_the_limit_are_ordered_but_unresolved(void **state)
{
    (void)state;
    const resolution near = measure_plate(RESOLUTION_GAP - 0.01, SIDE),
                     far = measure_plate(RESOLUTION_GAP + 0.01, SIDE);
    assert_true(near.resolved == 0 && near.hex > 0.99);
    assert_true(far.resolved == 1 && far.hex == 1);
}

/* Half of the lattice has an opposite wall. Points with an unresolved neighbour are unresolved, too. */
static void a_wall_below_a_half_leaves_the_other_half_resolved(void **state)
{
    (void)state;
    const int rows = SIDE / 2;
    const resolution whole = measure_plate(10, rows), half = measure_plate(1, rows);
    assert_true(whole.resolved == 1);
    /* Two spacings from a boundary are three rows: three on each side of the lattice, three of the wall. Two
     * to six rows beyond the wall are unresolved. */
    const double measured = (SIDE - 6) + (rows - 3), beyond = SIDE - rows - 3;
    assert_true(half.resolved <= (beyond - 2) / measured && half.resolved >= (beyond - 6) / measured);
}

static void normals_at_random_resolve_nothing(void **state)
{
    (void)state;
    scene *s = make_scene();
    rng r = rng_seed(test_seed(), 5);
    for (int k = 0; k < LATTICE; k++) s->normal[k].z = rng_uniform(&r) < 0.5 ? -1 : 1;
    const resolution found = measure(s, 2);
    assert_true(found.resolved == 0 && found.hex < 0.5);
    free(s);
}

static void a_point_far_from_all_others_is_unresolved(void **state)
{
    (void)state;
    scene *s = make_scene();
    s->in.open = false;
    const double before = measure(s, 2).resolved;
    s->position[s->in.count] = (vec3){SIDE / 2, SIDE / 2, 6};
    s->normal[s->in.count++] = (vec3){0, 0, 1};
    assert_close(measure(s, 2).resolved, before * LATTICE / (LATTICE + 1.0), 1e-12);
    free(s);
}

/* Two faces that meet at a right angle, convex and concave. */
static void creases_are_resolved(void **state)
{
    (void)state;
    for (int side = -1; side <= 1; side += 2) {
        scene *s = make_scene();
        for (int k = 0; k < LATTICE; k++) {
            const double beyond = s->position[k].x - SIDE / 2;
            if (beyond > 0) {
                s->position[k] = (vec3){SIDE / 2, s->position[k].y, -side * beyond};
                s->normal[k] = (vec3){side, 0, 0};
            } else if (beyond == 0)
                s->normal[k] = vec3_unit((vec3){side, 0, 1});
        }
        assert_true(measure(s, 2).resolved == 1);
        free(s);
    }
}

static void a_sample_has_the_fractions_of_all(void **state)
{
    (void)state;
    scene *s = make_scene();
    add_wall(s, 1, SIDE / 2);
    const resolution all = measure(s, 2);
    s->in.every = 7;
    const resolution sample = measure(s, 2);
    assert_close(sample.resolved, all.resolved, 0.05);
    assert_close(sample.hex, all.hex, 0.05);
    free(s);
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    scene *s = make_scene();
    add_wall(s, 1, SIDE / 2);
    const resolution one = measure(s, 1), three = measure(s, 3);
    assert_true(one.resolved == three.resolved && one.hex == three.hex);
    free(s);
}

static void points_near_a_boundary_have_no_fraction(void **state)
{
    (void)state;
    scene *s = make_scene();
    s->in.count = SIDE; /* one row */
    const resolution r = measure(s, 1);
    assert_true(isnan(r.resolved) && isnan(r.hex));
    free(s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_lattice_is_resolved_and_ordered),
        cmocka_unit_test(walls_closer_than_the_limit_are_ordered_but_unresolved),
        cmocka_unit_test(a_wall_below_a_half_leaves_the_other_half_resolved),
        cmocka_unit_test(normals_at_random_resolve_nothing),
        cmocka_unit_test(a_point_far_from_all_others_is_unresolved),
        cmocka_unit_test(creases_are_resolved),
        cmocka_unit_test(a_sample_has_the_fractions_of_all),
        cmocka_unit_test(result_does_not_depend_on_threads),
        cmocka_unit_test(points_near_a_boundary_have_no_fraction),
    };
    return cmocka_run_group_tests_name("resolution", tests, NULL, NULL);
}
