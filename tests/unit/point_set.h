// SPDX-License-Identifier: Apache-2.0
/* point_set: synthetic points for tests of formats. */
#ifndef HEXAD_TESTS_POINT_SET_H
#define HEXAD_TESTS_POINT_SET_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "io/points/points.h"

typedef struct point_set {
    points points;
    vec3 *position, *normal;
    double *scalar[7]; /* kappa .. spacing_local, in the order of `points` */
} point_set;

static inline point_set point_set_new(size_t count)
{
    point_set s = {0};
    s.position = mem_alloc(count * sizeof *s.position);
    s.normal = mem_alloc(count * sizeof *s.normal);
    for (int k = 0; k < 7; k++) s.scalar[k] = mem_alloc(count * sizeof(double));
    s.points = (points){.count = count,
                        .position = s.position,
                        .normal = s.normal,
                        .kappa = s.scalar[0],
                        .kappa1 = s.scalar[1],
                        .kappa2 = s.scalar[2],
                        .alpha = s.scalar[3],
                        .energy = s.scalar[4],
                        .spacing = s.scalar[5],
                        .spacing_local = s.scalar[6]};
    return s;
}

static inline void point_set_free(point_set *s)
{
    free(s->position);
    free(s->normal);
    for (int k = 0; k < 7; k++) free(s->scalar[k]);
}

static inline void point_set_scalars(point_set *s, size_t i, double kappa1, double kappa2, double alpha,
                                     double spacing)
{
    double values[7] = {
        sqrt(kappa1 * kappa1 + kappa2 * kappa2), kappa1, kappa2, alpha, 0.71, spacing, spacing};
    for (int k = 0; k < 7; k++) s->scalar[k][i] = values[k];
}

/* A Fibonacci lattice on a sphere, nearly uniform. */
static inline point_set point_set_sphere(size_t count, vec3 center, double radius)
{
    point_set s = point_set_new(count);
    double spacing = radius * sqrt(8 * M_PI / (sqrt(3) * (double)count));
    for (size_t i = 0; i < count; i++) {
        double z = 1 - 2 * ((double)i + 0.5) / (double)count, r = sqrt(1 - z * z),
               turn = 2.399963229728653 * (double)i;
        s.normal[i] = vec3_make(r * cos(turn), r * sin(turn), z);
        s.position[i] = vec3_axpy(radius, s.normal[i], center);
        point_set_scalars(&s, i, 1 / radius, 1 / radius, 1, spacing);
    }
    return s;
}

#endif
