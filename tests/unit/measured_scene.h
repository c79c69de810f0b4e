// SPDX-License-Identifier: Apache-2.0
/* measured_scene: surfaces of few triangles with points, and their measures. Include after cmocka.
 *
 * A point lies on every triangle within SCENE_ON of it. It has a copy for each different normal of these
 * triangles. Points with several normals, and points on borders, are on curves, as in a solve.
 */
#ifndef HEXAD_TESTS_MEASURED_SCENE_H
#define HEXAD_TESTS_MEASURED_SCENE_H

#include "base/core/rng.h"
#include "sampling/measures/measures.h"

#define SCENE_ON 1e-9

typedef struct scene {
    size_t vertices, triangles, points;
    vec3 *vertex, *point;
    uint32_t (*triangle)[3];
    double *spacing; /* of each point */
    bool smooth;     /* the triangles approximate a smooth surface: a point has the normal of one triangle */
} scene;

void scene_free(scene *s);

/* The index of the vertex at x; it is added if it is missing. */
uint32_t scene_vertex(scene *s, vec3 x);
void scene_triangle(scene *s, vec3 a, vec3 b, vec3 c);
void scene_quad(scene *s, vec3 a, vec3 b, vec3 c, vec3 d); /* the triangles a b c and a c d */
/* adds a point of spacing 1 unless there is a point at x */
void scene_point(scene *s, vec3 x);
void scene_point_again(scene *s, vec3 x);                 /* adds a point even if there is a point at x */
void scene_random_points(scene *s, size_t count, rng *r); /* uniform on the triangles */
void scene_remove(scene *s, bool (*drop)(vec3 x, const void *context), const void *context);
void scene_set_spacing(scene *s, double h);

/* Adds rows of points of spacing 1 along the unit vector `along`, sqrt(3) / 2 apart along `up`. Row 0 begins
 * at `origin` and has n + 1 points. Odd rows begin half a spacing later and have n points. */
void scene_rows(scene *s, vec3 origin, vec3 along, vec3 up, int n, int rows);

/* A triangle with n spacings per side, with its lattice of points. */
void scene_lattice_triangle(scene *s, vec3 a, vec3 b, vec3 c, int n);

/* The same surface and points, moved by a rotation and a translation. */
scene scene_moved(const scene *s);
/* The same surface with each triangle divided into four at the middles of its edges. */
scene scene_subdivided(const scene *s);
/* Vertices, triangles, corners of triangles and points in a random order. */
scene scene_shuffled(const scene *s, uint64_t seed);
scene scene_copy(const scene *s);

typedef struct scene_options {
    int workers;                                       /* 0: 2 */
    double *local;                                     /* of each point, or NULL */
    double *degree;                                    /* of each point, or NULL */
    double (*spacing_at)(const void *context, vec3 x); /* see measures_input */
    bool exact;                                        /* see measures_input */
} scene_options;

measures scene_measure(const scene *s, const scene_options *options);

#endif
