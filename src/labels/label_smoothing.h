/* label_smoothing: removes the steps of voxels from the interfaces between labels, by a low-pass filter.
 *
 * The mesh is low-pass filtered: in one step of a mean over neighbours what varies with eigenvalue 1 - k is multiplied by
 * that; the filter is the polynomial of this step, expanded in Chebyshev's, that multiplies it by exp(-(k / c)^2) instead:
 * flat at 0, so that what is smooth does not shrink (Taubin, Zhang and Golub 1996, "Optimal surface smoothing as filter
 * design"). A vertex on a line at which surfaces meet or end has neighbours along these lines only. No vertex leaves the
 * box around its place in which it parts the voxels that it parted.
 */
#ifndef HEXAD_LABELS_LABEL_SMOOTHING_H
#define HEXAD_LABELS_LABEL_SMOOTHING_H

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"

typedef struct label_smoothing {
    double length;      /* in voxels: waves of this length become 1/e; 0: nothing is smoothed */
    const float *limit; /* of each vertex: how far it may be moved along each axis, in voxels */
    int64_t size[3];    /* voxels: a vertex at an end of these stays there */
} label_smoothing;

/* `m` is in voxels; `kind` as in label_mesh: edges of triangles that differ in it are lines, too. Errors: limit_memory. */
bool label_smoothing_apply(const label_smoothing *s, mesh *m, const uint32_t *kind, threads *pool, error *e);

#endif
