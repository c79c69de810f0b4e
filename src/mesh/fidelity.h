/* fidelity: how well a level set represents the mesh from which it was made, and the voxel size that would represent it better.
 *
 * The mesh is sampled at points spread over its triangles. A point that the zero set does not follow is classified:
 * - hidden: inside the union of the solids, or where two solids touch;
 * - thin: between two faces that are closer than the voxels can represent;
 * - otherwise at a crease.
 * Fractions are of the mesh's area. Results do not depend on the number of threads of the pool, which may be NULL.
 */
#ifndef HEXAD_MESH_FIDELITY_H
#define HEXAD_MESH_FIDELITY_H

#include <stdbool.h>

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "triangles/mesh.h"

typedef struct fidelity {
    double area;         /* of the mesh, world units squared */
    double rms_vox;      /* rms distance of the mesh from the zero set where that follows it, voxels */
    double close;        /* fraction nearer than 0.05 voxels */
    double unresolved;   /* fraction that is not followed */
    double thin, hidden; /* fractions */
    double thin_voxel;   /* largest voxel size, world units, for which `thin` is at most FIDELITY_MAX_THIN */
    double worth_voxel;  /* the same, at least `finest`, for the part that such voxels can represent */
    /* largest voxel size, world units, for which a tenth of the thin area remains thin */
    double tenth_voxel;
    vec3 *thin_place; /* sampled thin points, world units */
    size_t thin_places;
} fidelity;

/* Maximum fraction that may remain thin. */
#define FIDELITY_MAX_THIN 0.005

/* Measures `m`, as levelset_make left it, against `f`. `f` NULL: no point is followed. `finest`: smallest voxel size that is possible, world units.
 * If it represents no more than the present voxels, thin_voxel and worth_voxel are the present size. *out is zeroed or the result of an
 * earlier call; free it with fidelity_free. The result is incomplete after a stop of the pool. Error: limit_memory. */
bool fidelity_measure(const mesh *m, const double index_to_world[16], const field *f, double finest,
                      threads *pool, fidelity *out, error *e);
void fidelity_free(fidelity *f);

/* Estimates the fraction of a closed mesh that lies inside its solids, whatever the orientation of its shells. Error: limit_memory. */
bool fidelity_hidden(const mesh *m, double *share, error *e);

/* Estimates, from 1024 points, the fraction of such a mesh that is not hidden and that voxels of size `voxel`, world units, cannot represent.
 * Error: limit_memory. */
bool fidelity_thin(const mesh *m, double voxel, double *share, error *e);

#endif
