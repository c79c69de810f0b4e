/* fidelity: how well a level set keeps to the mesh that it was made of, and which voxels would keep to it better.
 *
 * The mesh is looked at in points spread over its triangles. A point that the zero set does not follow is hidden in
 * the union of the solids or where two of them touch, or thin, between two faces that lie closer than the voxels
 * show; what is neither lies at a crease. Units: shares of the mesh's area. Threads: those of a pool, or NULL, whose number does
 * not show.
 */
#ifndef HEXAD_MESH_FIDELITY_H
#define HEXAD_MESH_FIDELITY_H

#include <stdbool.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "triangles/mesh.h"

typedef struct fidelity {
    double area;       /* of the mesh, world units */
    double rms_vox;    /* of the distance of the mesh from the zero set, where that follows it */
    double close;      /* nearer than 0.05 voxel */
    double unresolved; /* not followed */
    double thin, hidden;
    double thin_voxel;  /* the largest voxels, world units, that leave at most FIDELITY_MOST_THIN thin */
    double worth_voxel; /* the same, but above `finest`, and of what such voxels can show */
    double tenth_voxel; /* the largest voxels that leave at most a tenth of what is thin */
    vec3 *thin_place;   /* where it is thin, as far as it was looked at; world units */
    size_t thin_places;
} fidelity;

/* What may stay thin. */
#define FIDELITY_MOST_THIN 0.005

/* `m` as levelset_make left it; `f` NULL: nothing of it is followed; `finest`: the size of the smallest voxels that can be had. Where they would show no
 * more than these, both voxel sizes are those that there are. *out, zeroed or of an earlier call, is the caller's to free. Errors:
 * limit_memory. Incomplete where the pool was told to stop. */
bool fidelity_measure(const mesh *m, const double index_to_world[16], const field *f, double finest,
                      threads *pool, fidelity *out, error *e);
void fidelity_free(fidelity *f);

/* The share of a closed mesh that lies inside of its solids, whichever way round its shells are: an estimate from places spread evenly
 * over its area. Errors: limit_memory. */
bool fidelity_hidden(const mesh *m, double *share, error *e);

/* An estimate, from 1024 places, of the share of such a mesh that is not hidden and that voxels of this size, world units, leave out.
 * Errors: limit_memory. */
bool fidelity_thin(const mesh *m, double voxel, double *share, error *e);

#endif
