// SPDX-License-Identifier: Apache-2.0
/* mesh: an indexed triangle mesh, and notes on its repair.
 *
 * Units: those of the file, until levelset_make converts them to voxels. Free a mesh with mesh_free.
 * Functions with a pool (or NULL) give results that do not depend on the number of threads. No shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_MESH_H
#define HEXAD_GEOMETRY_MESH_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/space/bbox.h"
#include "geometry/space/vec3.h"

typedef struct mesh {
    size_t vertex_count, triangle_count;
    vec3 *vertex;
    uint32_t (*triangle)[3]; /* counter-clockwise seen from outside, if the file follows this convention */
    /* mesh_weld would not change the mesh; in particular every vertex belongs to a triangle. Code that moves,
     * joins or removes vertices or triangles sets it to false. */
    bool welded;
} mesh;

#define MESH_MAX_NOTES 8

/* Sentences for the warnings of the report; further ones are dropped. */
typedef struct mesh_notes {
    size_t count;
    char text[MESH_MAX_NOTES][256];
} mesh_notes;

void mesh_note(mesh_notes *notes, const char *format, ...) __attribute__((format(printf, 2, 3)));

void mesh_free(mesh *m); /* accepts NULL and a zeroed object */

/* Errors: limit_memory, cancelled. */
bool mesh_copy(const mesh *m, threads *pool, mesh *out, error *e);

/* Peak memory, in bytes, of the repair of a mesh of this size, with its edges; for comparison with a memory
 * limit. */
size_t mesh_bytes(size_t vertices, size_t triangles);

/* The bounding box of the triangles; vertices without a triangle are ignored. Complete also if the pool
 * was stopped. */
bbox mesh_box(const mesh *m, threads *pool);

/* The sum of the areas of the triangles, duplicates included. */
double mesh_area(const mesh *m);

static inline void mesh_get_corners(const mesh *m, size_t n, vec3 out[3])
{
    for (int k = 0; k < 3; k++) out[k] = m->vertex[m->triangle[n][k]];
}

/* The normal of a triangle, as long as twice its area. */
static inline vec3 mesh_across(const mesh *m, size_t n)
{
    const uint32_t *t = m->triangle[n];
    return vec3_across(m->vertex[t[0]], m->vertex[t[1]], m->vertex[t[2]]);
}

/* Whether a triangle has two equal corners. */
static inline bool mesh_is_degenerate(const uint32_t t[3])
{
    return t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
}

/* Drops triangles with two equal corners. Returns their number. */
size_t mesh_drop_degenerate(mesh *m);

#endif
