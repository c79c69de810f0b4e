/* landing: points that were found on the level sets of meshes, put on the triangles; how far points are from the triangles of meshes. */
#ifndef HEXAD_SOURCE_LANDING_H
#define HEXAD_SOURCE_LANDING_H

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "source/source.h"

typedef struct landing {
    field
        base; /* F at a place of the world is the distance from where points are delivered: from triangles, where the surface has
                 * some */
    const source *source;
} landing;

/* False, with *out untouched, where there is nothing to land on: no mesh, or none that asks for it. */
bool landing_find(const source *s, landing *out);

/* The same for the distance alone, also where points were found on the triangles: of a mesh, or the mesh of labels. */
bool landing_measures(const source *s, landing *out);

/* Moves places of the sampled surface onto the triangles that they are nearest to; those on a face of a region stay on it.
 * Where shells meet places may come upon each other: those nearer than half their `spacing` are moved apart on the triangles.
 * *largest: of the moves onto the triangles. Errors: cancelled, limit_memory. */
bool landing_move(const landing *l, vec3 *place, const double *spacing, size_t count, threads *pool,
                  double *largest, error *e);

/* Puts the places that are farther than `most` from where they should be onto the triangles again. */
void landing_repeat(const landing *l, vec3 *place, size_t count, double most, threads *pool);

#endif
