// SPDX-License-Identifier: Apache-2.0
/* Particles: an index denotes one particle in all arrays, after copying, permuting and growing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/solver/particles/particles.h"
#include "shapes.h"

enum { COUNT = 1000 };

/* Sets every array of particle i to a distinct number. */
static void fill(particles *p, size_t i)
{
    double v = (double)i + 1;
    p->position[i] = (vec3){v, 2 * v, 3 * v};
    p->normal[i] = (vec3){-v, -2 * v, -3 * v};
    p->alpha[i] = 4 * v;
    p->lambda[i] = (float)(6 * v);
    p->patch[i] = (uint32_t)i % 7;
    p->hint[i] = (uint32_t)i + 8;
    p->place[i] = (uint32_t)i + 9;
}

static void assert_is(const particles *p, size_t at, size_t i)
{
    double v = (double)i + 1;
    assert_close(p->position[at].z, 3 * v, 0);
    assert_close(p->normal[at].y, -2 * v, 0);
    assert_close(p->alpha[at], 4 * v, 0);
    assert_close(p->lambda[at], 6 * v, 0);
    assert_int_equal(p->patch[at], i % 7);
    assert_int_equal(p->hint[at], i + 8);
    assert_int_equal(p->place[at], i + 9);
}

static particles *filled(void)
{
    static const field_patches patches = {.count = 7};
    error e = {0};
    particles *p = particles_new(COUNT, &e);
    assert_non_null(p);
    assert_true(particles_set_patches(p, &patches, COUNT, &e));
    for (size_t i = 0; i < COUNT; i++)
        assert_true(p->hint[i] == FIELD_NO_HINT && p->place[i] == PARTICLES_FREE);
    p->count = COUNT;
    for (size_t i = 0; i < COUNT; i++) fill(p, i);
    return p;
}

static void test_new_particles_have_unit_amplitude_and_size(void **state)
{
    (void)state;
    error e = {0};
    particles *p = particles_new(COUNT, &e);
    for (size_t i = 0; i < COUNT; i++) assert_true(p->alpha[i] == 1 && p->size[i] == 1);
    particles_free(p);
}

/* Uniform particles have no arrays of ones until these are requested. They grow and are copied like other
 * particles. */
static void test_uniform_particles_have_no_arrays_of_ones(void **state)
{
    (void)state;
    error e = {0};
    particles *p = particles_new_even(COUNT, &e);
    const uint32_t order[] = {1, 0};
    p->count = 2;
    assert_true(!p->alpha && !p->size && particles_amplitude(p, 1) == 1 && particles_size(p, 1) == 1);
    assert_true(particles_arrange(p, order, NULL, &e) && particles_grow(p, 2 * COUNT, &e));
    particles_copy(p, 1, 0);
    assert_true(!p->alpha && !p->size && particles_add_sizes(p, &e) && !p->alpha);
    p->size[1] = 2;
    assert_true(particles_grow(p, 3 * COUNT, &e) && particles_add_amplitudes(p, &e) &&
                particles_add_sizes(p, &e));
    assert_true(particles_size(p, 1) == 2 && p->size[3 * COUNT - 1] == 1 && p->alpha[3 * COUNT - 1] == 1);
    particles_free(p);
}

static void test_a_permutation_arranges_all_arrays(void **state)
{
    (void)state;
    particles *p = filled();
    error e = {0};
    uint32_t order[COUNT];
    rng r = rng_seed(test_seed(), 1);
    for (uint32_t i = 0; i < COUNT; i++) order[i] = i;
    for (uint32_t i = COUNT - 1; i > 0; i--) {
        uint32_t j = (uint32_t)(rng_uniform(&r) * (i + 1)), was = order[i];
        order[i] = order[j];
        order[j] = was;
    }
    assert_true(particles_arrange(p, order, NULL, &e));
    for (size_t k = 0; k < COUNT; k++) assert_is(p, k, order[k]);
    particles_reset_damping(p);
    for (size_t k = 0; k < COUNT; k++) assert_true(p->lambda[k] == 0);
    particles_free(p);
}

static void test_growing_keeps_the_particles(void **state)
{
    (void)state;
    particles *p = filled();
    error e = {0};
    assert_true(particles_grow(p, 10 * COUNT, &e));
    assert_int_equal(p->count, COUNT);
    for (size_t i = 0; i < COUNT; i++) assert_is(p, i, i);
    assert_true(p->hint[COUNT] == FIELD_NO_HINT);
    particles_copy(p, 10 * COUNT - 1, 7);
    assert_is(p, 10 * COUNT - 1, 7);
    particles_free(p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_new_particles_have_unit_amplitude_and_size),
        cmocka_unit_test(test_uniform_particles_have_no_arrays_of_ones),
        cmocka_unit_test(test_a_permutation_arranges_all_arrays),
        cmocka_unit_test(test_growing_keeps_the_particles),
    };
    return cmocka_run_group_tests_name("particles", tests, NULL, NULL);
}
