// SPDX-License-Identifier: Apache-2.0
/* label_lines: smooths the lines where interfaces meet or end, by planes or quadrics fitted to the
 * interfaces.
 *
 * Voxels determine a line less accurately than the interfaces that meet at it: where a material ends in a
 * wedge, the distance of the last voxel with its centre inside from the edge increases as the wedge gets
 * narrower. A plane or a quadric is fitted by least squares to each interface at a vertex of a line. The
 * residual is the distance by which it fails to separate the voxels of the two labels. The fit extends as far
 * as the plane or quadric separates these voxels, at most twice the radius. The vertex moves to the point
 * with the least sum of squared distances from all of them. Near a junction of lines, voxels farther away are
 * included.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_LINES_H
#define HEXAD_SURFACE_LABELS_LABEL_LINES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/labels/label_graph.h"

typedef struct label_lines {
    const mesh *m;            /* smoothed; the source of the normals */
    const label_graph *graph; /* neighbours of the vertices of `m` */
    const vec3 *middle;       /* per vertex: the position before smoothing */
    double radius;            /* initial radius of the neighbourhood of a fit, in the units of `m` */
} label_lines;

/* Stores the new positions of the vertices of lines in `out`, and leaves the other elements unchanged.
 * Errors: limit_memory. */
bool label_lines_fit(const label_lines *l, threads *pool, vec3 *out, error *e);

#endif
