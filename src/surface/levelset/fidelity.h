// SPDX-License-Identifier: Apache-2.0
/* fidelity: how well a level set represents the mesh from which it was made, and the voxel size that would
 * represent it better.
 *
 * The mesh is sampled at points spread over its triangles. A point that the zero set does not follow is
 * classified:
 * - hidden: inside the union of the solids, or where two solids touch;
 * - thin: between two faces that are closer than the voxels can represent;
 * - otherwise at a crease.
 * Fractions are of the mesh's area. Results do not depend on the number of threads of the pool, which may be
 * NULL.
 */
#ifndef HEXAD_SURFACE_LEVELSET_FIDELITY_H
#define HEXAD_SURFACE_LEVELSET_FIDELITY_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "geometry/mesh/mesh.h"

typedef struct fidelity {
    double area;         /* of the mesh, world units squared */
    double rms_vox;      /* rms distance of the mesh from the zero set where that follows it, voxels */
    double close;        /* fraction nearer than 0.05 voxels */
    double unresolved;   /* fraction that the zero set does not follow: hidden, thin or at a crease */
    double thin, hidden; /* fractions */
    /* The next three are voxel sizes in world units, at most the present one. They are the present one if
     * that suffices. */
    double thin_voxel; /* largest for which `thin` would be at most FIDELITY_MAX_THIN */
    /* largest for which at most FIDELITY_MAX_THIN of the mesh would be thin, without the area that even
     * voxels of size `finest` (fidelity_measure) cannot represent; thus at least `finest` */
    double worth_voxel;
    double tenth_voxel; /* largest for which a tenth of the thin area would remain thin */
    vec3 *thin_place;   /* sampled thin points, world units */
    size_t thin_places;
} fidelity;

/* Maximum fraction that may remain thin. */
#define FIDELITY_MAX_THIN 0.005

/* Measures `m`, as levelset_make left it, against `f`. `f` NULL: no point is followed. The present voxel size
 * is index_to_world[0]. `finest`: smallest voxel size that is possible, world units. Before the call *out
 * must be zeroed or the result of an earlier call; free it with fidelity_free, also after failure. If the
 * pool is stopped, the function may return true with an incomplete result: test threads_stopped. Error:
 * limit_memory. */
bool fidelity_measure(const mesh *m, const double index_to_world[16], const field *f, double finest,
                      threads *pool, fidelity *out, error *e);
void fidelity_free(fidelity *f);

/* Estimates, from 2048 points, the fraction of the area of a closed mesh that lies inside its solids,
 * whatever the orientation of its shells. Error: limit_memory. */
bool fidelity_hidden(const mesh *m, double *share, error *e);

/* Estimates, from 1024 points, the fraction of the area of a closed mesh that is thin for voxels of size
 * `voxel` (in the units of the mesh): not hidden, but between two faces that are closer than such voxels can
 * represent. Error: limit_memory. */
bool fidelity_thin(const mesh *m, double voxel, double *share, error *e);

#endif
