// SPDX-License-Identifier: Apache-2.0
/* label_smoothing: removes the steps of voxels from the interfaces between labels, by a low-pass filter.
 *
 * One step of averaging over neighbours multiplies a component of the mesh with eigenvalue 1 - k by 1 - k.
 * The filter is a polynomial of this step, expanded in Chebyshev polynomials, that multiplies the component
 * by exp(-(k / c)^2). It is flat at 0, so that smooth shapes do not shrink (Taubin, Zhang and Golub 1996,
 * "Optimal surface smoothing as filter design"). The neighbours of a vertex on a line at which interfaces
 * meet or end are its neighbours along such lines. Each vertex stays within the box around its first position
 * in which it separates the same voxels.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_SMOOTHING_H
#define HEXAD_SURFACE_LABELS_LABEL_SMOOTHING_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

typedef struct label_smoothing {
    /* in voxels: the amplitude of waves of this length is multiplied by 1/e; 0: no smoothing */
    double length;
    const float *limit; /* per vertex: the maximum displacement along each axis, in voxels */
    int64_t size[3];    /* of the volume, in voxels: a vertex on its boundary stays on it */
} label_smoothing;

/* `m` is in voxels. `kind`: as in label_mesh; edges between triangles of different kinds are line edges, too.
 * Errors: limit_memory. */
bool label_smoothing_apply(const label_smoothing *s, mesh *m, const uint32_t *kind, threads *pool, error *e);

#endif
