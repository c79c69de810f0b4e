// SPDX-License-Identifier: Apache-2.0
/* Population: choice of particles, positions of twins, and removal. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "close.h"
#include "sampling/solver/particles/population.h"
#include "shapes.h"

enum { COUNT = 400, CHOSEN = 100, ROUNDS = 200 };

static particles *energies(void)
{
    error e = {0};
    particles *p = particles_new(COUNT, &e);
    assert_non_null(p);
    p->count = COUNT;
    for (int i = 0; i < COUNT; i++) p->energy[i] = (float)i;
    return p;
}

/* Number of times that each particle is chosen, in ROUNDS rounds. */
static void count_choices(population_bias bias, int times[COUNT])
{
    particles *p = energies();
    rng r = rng_seed(test_seed(), 1);
    uint32_t chosen[CHOSEN];
    error e = {0};
    for (int round = 0; round < ROUNDS; round++) {
        assert_true(population_choose(p, CHOSEN, bias, &r, chosen, &e));
        for (int k = 0; k < CHOSEN; k++) {
            assert_true(chosen[k] < COUNT);
            if (k > 0) assert_true(chosen[k - 1] < chosen[k]); /* ascending, without duplicates */
            times[chosen[k]]++;
        }
    }
    particles_free(p);
}

static int sum(const int *times, int begin, int end)
{
    int all = 0;
    for (int i = begin; i < end; i++) all += times[i];
    return all;
}

static void test_the_bias_selects_the_requested_energies(void **state)
{
    (void)state;
    int high[COUNT] = {0}, low[COUNT] = {0}, random[COUNT] = {0};
    count_choices(POPULATION_HIGH_ENERGY, high);
    count_choices(POPULATION_LOW_ENERGY, low);
    count_choices(POPULATION_RANDOM, random);
    int half = COUNT / 2, all = CHOSEN * ROUNDS;
    assert_true(sum(high, half, COUNT) > 3 * sum(high, 0, half));
    assert_true(sum(low, 0, half) > 3 * sum(low, half, COUNT));
    /* ten standard deviations of a fair choice */
    assert_close(sum(random, 0, half), all / 2.0, 10 * sqrt(all / 4.0));
    for (int i = 0; i < COUNT; i++) assert_true(random[i] > 0); /* each particle is chosen */
}

/* With varying amplitudes the energy is large where they are large; the energy relative to the
 * surroundings decides. */
static void test_amplitudes_do_not_affect_the_choice(void **state)
{
    (void)state;
    particles *p = energies();
    rng r = rng_seed(test_seed(), 3);
    uint32_t chosen[CHOSEN];
    int flat = 0;
    for (int i = 0; i < COUNT; i++) {
        p->alpha[i] = i % 2 ? 0.1 : 1.4;
        p->energy[i] = p->alpha[i] * (1 + 0.1 * sin(i));
    }
    for (int round = 0; round < ROUNDS; round++) {
        assert_true(population_choose(p, CHOSEN, POPULATION_HIGH_ENERGY, &r, chosen, NULL));
        for (int k = 0; k < CHOSEN; k++) flat += chosen[k] % 2 == 0;
    }
    assert_close(flat / (double)(CHOSEN * ROUNDS), 0.5, 0.05);
    particles_free(p);
}

static void test_all_particles_can_be_chosen(void **state)
{
    (void)state;
    particles *p = energies();
    rng r = rng_seed(test_seed(), 2);
    uint32_t chosen[COUNT];
    error e = {0};
    assert_true(population_choose(p, COUNT, POPULATION_HIGH_ENERGY, &r, chosen, &e));
    for (uint32_t i = 0; i < COUNT; i++) assert_int_equal(chosen[i], i);
    particles_free(p);
}

static void test_twins_are_on_the_surface_on_either_side(void **state)
{
    (void)state;
    error e = {0};
    analytic *sphere = analytic_new(&shapes[0], NULL, &e);
    particles *p = particles_new(2, &e);
    assert_true(sphere && p);
    const vec3 center = shapes[0].center;
    const double radius = shapes[0].radius, offset = 0.1;
    rng r = rng_seed(test_seed(), 3);
    p->count = 1;
    p->normal[0] = (vec3){0, 0, 1};
    p->position[0] = vec3_axpy(radius, p->normal[0], center);
    const vec3 before = p->position[0];
    assert_true(population_split(&sphere->base, p, 0, offset, &r));
    assert_int_equal(p->count, 2);
    for (int i = 0; i < 2; i++) {
        vec3 out = vec3_sub(p->position[i], center);
        assert_close(vec3_norm(out), radius, 1e-3 * offset);
        assert_close(vec3_dot(p->normal[i], out), radius, 1e-3 * radius);
        assert_close(vec3_norm(vec3_sub(p->position[i], before)), offset, 0.05 * offset);
    }
    assert_close(vec3_norm(vec3_sub(p->position[0], p->position[1])), 2 * offset, 0.1 * offset);
    particles_free(p);
    analytic_free(sphere);
}

static void test_remaining_particles_keep_their_order(void **state)
{
    (void)state;
    particles *p = energies();
    bool marked[COUNT] = {false};
    for (int i = 0; i < COUNT; i += 3) marked[i] = true;
    for (int i = 0; i < COUNT; i++) p->position[i].x = i;
    assert_int_equal(population_remove(p, marked), (COUNT + 2) / 3);
    assert_int_equal(p->count, COUNT - (COUNT + 2) / 3);
    size_t k = 0;
    for (int i = 0; i < COUNT; i++)
        if (i % 3) assert_close(p->position[k++].x, i, 0);
    particles_free(p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_bias_selects_the_requested_energies),
        cmocka_unit_test(test_amplitudes_do_not_affect_the_choice),
        cmocka_unit_test(test_all_particles_can_be_chosen),
        cmocka_unit_test(test_twins_are_on_the_surface_on_either_side),
        cmocka_unit_test(test_remaining_particles_keep_their_order),
    };
    return cmocka_run_group_tests_name("population", tests, NULL, NULL);
}
