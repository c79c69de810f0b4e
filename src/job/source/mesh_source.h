// SPDX-License-Identifier: Apache-2.0
/* mesh_source: opens a mesh, as a level set or as patches on its triangles. */
#ifndef HEXAD_JOB_SOURCE_MESH_SOURCE_H
#define HEXAD_JOB_SOURCE_MESH_SOURCE_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/json/json.h"
#include "io/meshes/mesh_array.h"
#include "surface/triangles/mesh_surface.h"
#include "spec/spec.h"
#include "surface/volume/volume.h"

typedef struct mesh_source_request {
    const spec_mesh *spec;
    const struct spec *target; /* if the count follows from the area of the triangles; otherwise NULL */
    double memory,
        most_memory; /* bytes: the limit of the job, and the largest one that it may have (0: unknown) */
    /* the mesh is the whole surface, or the whole of a surface that is placed or cut by a box: it may be
     * opened as patches */
    bool alone;
    bool as_level_set; /* a closed mesh is sampled through a level set, unless its features are requested */
    bool resolve;
    const double (*to_world)[4]; /* transform that is applied to patches; or NULL */
    const bbox *region;          /* box to which patches are cut; or NULL */
    bool may_move;           /* a mesh far from the origin is opened relative to a place near its middle */
    int fd;                  /* the file */
    const mesh_array *array; /* read instead of the file; or NULL */
    volume_mesh_request as_volume;
} mesh_source_request;

/* Opens the mesh either as patches or as a volume, by the table in doc/meshes.md. Patches are transformed
 * and cut, a volume is not. *notes: notes on the patches. *origin: the vector that was subtracted from all
 * coordinates, without rounding; 0 unless may_move is set and the mesh is far from the origin. Errors, after
 * which the outputs are unchanged: those of volume_of_mesh and mesh_surface_new, prefixed with the path. */
bool mesh_source_open(const mesh_source_request *request, volume **as_volume, mesh_surface **as_patches,
                      vec3 *origin, mesh_notes *notes, error *e);

/* Adds the properties of the mesh to `surface` of the report, and its notes to `warnings`. */
void mesh_source_describe(const mesh_surface *s, const mesh_notes *notes, json *surface, json *warnings);

#endif
