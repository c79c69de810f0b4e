// SPDX-License-Identifier: Apache-2.0
/* mesh_fixture: small meshes for tests, as arrays and as files in memory. */
#ifndef HEXAD_TESTS_MESH_FIXTURE_H
#define HEXAD_TESTS_MESH_FIXTURE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

/* A pool of two workers that exists until the program ends. */
threads *mesh_fixture_pool(void);

/* A ball: an icosahedron whose triangles are split in four `splits` times; normals point outwards. */
mesh mesh_fixture_ball(vec3 center, double radius, int splits);
/* A box of 12 triangles with outward normals, rotated about an oblique axis by `angle`. */
mesh mesh_fixture_box(vec3 center, vec3 half, double angle);
/* The inverse rotation: converts a point relative to the centre to the axes of the box. */
vec3 mesh_fixture_unturn(vec3 p, double angle);

/* A grid of squares of two triangles each, over u and v in [0, 1]; `place` returns the positions. */
mesh mesh_fixture_sheet(int nu, int nv, vec3 (*place)(double u, double v));
vec3 mesh_fixture_moebius(double u, double v); /* for a Moebius strip of radius 1 and width .6 */
/* Rounds coordinates, so that those of ends that meet are equal. */
vec3 mesh_fixture_rounded(vec3 p);

/* Appends b to a, and frees b. */
void mesh_fixture_append(mesh *a, mesh b);
void mesh_fixture_turn(mesh *m, size_t triangle); /* reverses its orientation */
void mesh_fixture_remove(mesh *m, size_t triangle);
void mesh_fixture_add(mesh *m, uint32_t a, uint32_t b, uint32_t c);

double mesh_fixture_area(const mesh *m);

enum { MESH_FIXTURE_POINTS = 4000 };

typedef struct mesh_fixture_points {
    size_t count;
    vec3 position[MESH_FIXTURE_POINTS], normal[MESH_FIXTURE_POINTS];
    double spacing[MESH_FIXTURE_POINTS];
    uint32_t name[MESH_FIXTURE_POINTS]; /* the index of each point */
} mesh_fixture_points;

/* Points drawn from the mesh by area. No point on the same side of the triangle is closer than .7
 * spacings. The caller frees them. */
mesh_fixture_points *mesh_fixture_scatter(const mesh *m, double spacing, uint64_t seed, int trials);

/* A file in this format ("obj", "off", "ply", "stl", "bstl" for binary STL), in memory. */
char *mesh_fixture_print(const mesh *m, const char *format, size_t *bytes);

#endif
