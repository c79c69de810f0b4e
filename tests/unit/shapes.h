// SPDX-License-Identifier: Apache-2.0
/* shapes: formulas for tests, and random points near their surfaces. Include after cmocka. */
#ifndef HEXAD_TESTS_SHAPES_H
#define HEXAD_TESTS_SHAPES_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/core/rng.h"
#include "surface/field/analytic.h"

#define SHAPE_COUNT 6

static const analytic_params shapes[SHAPE_COUNT] = {
    {.shape = ANALYTIC_SPHERE, .center = {1, 2, 3}, .radius = 3},
    {.shape = ANALYTIC_TORUS,
     .center = {0.5, 0, -1},
     .axis = {1, 2, 2},
     .major_radius = 1,
     .minor_radius = 0.4},
    {.shape = ANALYTIC_BOX, .center = {0.1, 0.2, 0.3}, .half_size = {0.4, 0.3, 0.2}, .rounding = 0.1},
    {.shape = ANALYTIC_ELLIPSOID, .center = {0, 0, 0}, .radii = {1, 0.7, 0.4}},
    {.shape = ANALYTIC_QUARTIC, .center = {0.5, 0.5, 0.5}, .r = 0.13},
    {.shape = ANALYTIC_GYROID, .center = {0.5, 0.5, 0.5}, .size = {1, 1, 1}, .period = 1},
};

static const char *const shape_names[SHAPE_COUNT] = {"sphere",    "torus",   "box",
                                                     "ellipsoid", "quartic", "gyroid"};

/* The seed of a random test: HEXAD_TEST_SEED, or a fixed one. It is printed, so that a failure can be
 * reproduced. */
static inline uint64_t test_seed(void)
{
    const char *text = getenv("HEXAD_TEST_SEED");
    uint64_t seed = text ? strtoull(text, NULL, 10) : 20051;
    printf("# seed %llu\n", (unsigned long long)seed);
    return seed;
}

static inline vec3 random_between(rng *r, vec3 low, vec3 high)
{
    double x = rng_uniform(r), y = rng_uniform(r), z = rng_uniform(r);
    return (vec3){low.x + x * (high.x - low.x), low.y + y * (high.y - low.y), low.z + z * (high.z - low.z)};
}

/* A uniformly distributed unit vector. */
static inline vec3 random_direction(rng *r)
{
    const double z = 2 * rng_uniform(r) - 1, turn = 2 * M_PI * rng_uniform(r), side = sqrt(1 - z * z);
    return vec3_make(side * cos(turn), side * sin(turn), z);
}

#endif
