/* mesh_source: opens a mesh, as a level set or as patches on its triangles. */
#ifndef HEXAD_SOURCE_MESH_SOURCE_H
#define HEXAD_SOURCE_MESH_SOURCE_H

#include <stdbool.h>

#include "base/error.h"
#include "json/json.h"
#include "mesh/mesh_surface.h"
#include "spec/spec.h"
#include "volume/volume.h"

typedef struct mesh_source_request {
    const spec_mesh *spec;
    bool
        alone; /* the mesh is all of the surface, or of what is placed or cut by a box: it may be one of patches */
    bool as_level_set; /* a closed mesh is sampled through a level set, unless its features are requested */
    bool resolve;
    const double (*to_world)[4]; /* places it, where it is one of patches; or NULL */
    const bbox *region;          /* cuts it, likewise */
    bool may_move; /* a mesh far from the origin is opened relative to a place near its middle */
    int fd;        /* the file */
    volume_mesh_request as_volume;
} mesh_source_request;

/* Opens either patches or a volume; doc/volumes.md has the table. Patches are placed and cut, a volume is not. *notes
 * are about the patches. Errors: those of volume_of_mesh and mesh_surface_new, prefixed with the path; outputs are
 * untouched then. *origin: what was subtracted from all coordinates, exactly; 0 unless the mesh may move and is far from
 * the origin. */
bool mesh_source_open(const mesh_source_request *request, volume **as_volume, mesh_surface **as_patches,
                      vec3 *origin, mesh_notes *notes, error *e);

/* Adds the mesh to the report's `surface`, and its notes to `warnings`. */
void mesh_source_describe(const mesh_surface *s, const mesh_notes *notes, json *surface, json *warnings);

#endif
