/* label_lines: smooth lines where interfaces meet or end: moves their vertices to where planes or quadrics fitted to these interfaces meet.
 *
 * Voxels determine a line less accurately than the interfaces that meet there: where a material ends in a wedge, the
 * last voxel with its centre inside lies the farther from the edge the narrower the wedge. To each interface that a
 * vertex of a line belongs to a plane or quadric is fitted, by least squares of by how much it does not pass between the
 * voxels that it parts nearby: as far around as it does pass between them, twice the radius at most. The vertex goes to
 * the place that is nearest to all of them. Where lines meet, voxels farther away are looked at, too.
 */
#ifndef HEXAD_LABELS_LABEL_LINES_H
#define HEXAD_LABELS_LABEL_LINES_H

#include "base/error.h"
#include "base/threads.h"
#include "labels/label_graph.h"

typedef struct label_lines {
    const mesh *m;            /* smoothed: gives the normals */
    const label_graph *graph; /* of its vertices */
    const vec3 *middle;       /* of each vertex: before smoothing */
    double radius;            /* of what is near, in the same units */
} label_lines;

/* Where the vertices of lines go, into their places of `out`; others are untouched. Errors: limit_memory. */
bool label_lines_fit(const label_lines *l, threads *pool, vec3 *out, error *e);

#endif
