// SPDX-License-Identifier: Apache-2.0
/* left_out: finds places of a mesh that are far from the triangles between points on it.
 *
 * Examples: a bump, a dent or the tip of a spike about as large as the spacing, with points beside it but
 * none on it. World space. No shared state.
 */
#ifndef HEXAD_SURFACE_REMESH_LEFT_OUT_H
#define HEXAD_SURFACE_REMESH_LEFT_OUT_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

typedef struct left_out_input {
    const mesh *on;
    size_t count;
    const vec3 *position; /* points on the mesh */
    const double *spacing;
    const uint32_t (*triangle)[3]; /* triangles between these points; at least one */
    size_t triangles;
} left_out_input;

/* Finds places of the mesh whose distance from all triangles exceeds `share` times the spacing, and places of
 * the mesh nearest to places of triangles that are as far from the mesh. They are sorted by decreasing
 * distance, and each keeps the spacing as distance from the earlier ones; at most `most`. The caller
 * frees *place. Deterministic. Error: limit_memory. */
bool left_out_find(const left_out_input *in, double share, size_t most, threads *pool, vec3 **place,
                   size_t *count, error *e);

#endif
