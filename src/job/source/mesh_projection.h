// SPDX-License-Identifier: Apache-2.0
/* mesh_projection: projects points that were computed on level sets of meshes onto the triangles, and
 * measures their distance from the triangles. */
#ifndef HEXAD_JOB_SOURCE_MESH_PROJECTION_H
#define HEXAD_JOB_SOURCE_MESH_PROJECTION_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "job/source/source.h"

typedef struct mesh_projection {
    /* F in world space is the distance from the surface on which points are delivered: from its triangles, if
     * it has triangles */
    field base;
    const source *source;
} mesh_projection;

/* False, with *out unchanged, if points are not to be projected onto a mesh of the surface
 * (/surface/mesh/on_mesh). */
bool mesh_projection_find(const source *s, mesh_projection *out);

/* mesh_projection_find for measuring distances only; also true if points were computed on triangles: of a
 * mesh, or of interfaces of labels. */
bool mesh_projection_find_distance(const source *s, mesh_projection *out);

/* Moves points of the sampled surface onto the nearest triangles. Points on a face of a region stay on it.
 * Where shells meet, projected points may be close to each other: points closer than about half of their
 * `spacing` are moved apart on the triangles. *largest: the largest displacement by the projection, world
 * units. Errors: cancelled, limit_memory. */
bool mesh_projection_apply(const mesh_projection *l, vec3 *place, const double *spacing, size_t count,
                           threads *pool, double *largest, error *e);

/* Projects points whose distance from the triangles is more than `most` again. */
void mesh_projection_repeat(const mesh_projection *l, vec3 *place, size_t count, double most, threads *pool);

#endif
