/* mesh_projection: projects points that were computed on level sets of meshes onto the triangles, and measures their
 * distance from the triangles. */
#ifndef HEXAD_SOURCE_MESH_PROJECTION_H
#define HEXAD_SOURCE_MESH_PROJECTION_H

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "source/source.h"

typedef struct mesh_projection {
    field
        base; /* F in world space is the distance from the surface on which points are delivered: from its triangles, if it has
                 * some */
    const source *source;
} mesh_projection;

/* False, with *out untouched, if no mesh of the surface is to be projected onto (/surface/mesh/on_mesh). */
bool mesh_projection_find(const source *s, mesh_projection *out);

/* The same for the distance only, also if points were computed on triangles: of a mesh, or the mesh of labels. */
bool mesh_projection_find_distance(const source *s, mesh_projection *out);

/* Moves points of the sampled surface onto their nearest triangles; points on a face of a region stay on it. Where
 * shells meet, points may come close to each other: those nearer than about half their `spacing` are moved apart on the
 * triangles. *largest: the largest move onto the triangles, world units. Errors: cancelled, limit_memory. */
bool mesh_projection_apply(const mesh_projection *l, vec3 *place, const double *spacing, size_t count,
                           threads *pool, double *largest, error *e);

/* Projects the points that are farther than `most` from the triangles once more. */
void mesh_projection_repeat(const mesh_projection *l, vec3 *place, size_t count, double most, threads *pool);

#endif
