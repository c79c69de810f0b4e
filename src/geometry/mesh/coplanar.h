// SPDX-License-Identifier: Apache-2.0
/* coplanar: finds and removes overlaps of coplanar faces of different parts of a mesh, as under a box on a
 * larger face.
 *
 * A part is a set of coplanar triangles connected by edges of exactly two triangles. Where two parts overlap,
 * both are cut along each other's outlines, together with neighbours outside of the plane, so that closed
 * meshes stay closed. Each overlap then has two congruent faces:
 * - Same orientation: the face of the first part is kept.
 * - Opposite orientation in connected components that are closed: both are removed where they are a contact
 *   (contacts.h), since they bound nothing. Elsewhere the face of the first part is kept.
 * - Opposite orientation in an open component, where the orientation is arbitrary: the face of the first part is
 *   kept.
 * A part that overlaps itself is not changed. Single-threaded; no shared state.
 */
#ifndef HEXAD_GEOMETRY_MESH_COPLANAR_H
#define HEXAD_GEOMETRY_MESH_COPLANAR_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/mesh_edges.h"
#include "geometry/mesh/rounding.h"

/* Tolerance, as a multiple of the rounding error of the coordinates. Corners within this distance are
 * joined, and thinner overlaps are ignored. The intersection of two edges is computed once for each of them,
 * with an error that increases as their angle decreases. Cuts may leave triangles thinner than this: remove
 * them with flat_triangles_remove_thin. */
#define COPLANAR_THIN 4

typedef struct coplanar_overlap {
    /* Area of the overlaps, each counted once. same: equal orientation. opposite: opposite orientation, one
     * face kept. contact: opposite orientation, both removed. */
    double same, opposite, contact;
    /* the cuts did not terminate: the mesh is unchanged, with its overlaps, and all three areas are 0 */
    bool unfinished;
} coplanar_overlap;

/* Removes the overlaps of a welded mesh with these edges. Faces within the rounding error `r` are coplanar.
 * m->welded is true afterwards only if no triangle was cut; the mesh is unchanged then. Errors: limit_memory,
 * input_unsupported, cancelled. */
bool coplanar_cut(mesh *m, const mesh_edges *edges, const rounding *r, threads *pool, coplanar_overlap *out,
                  error *e);

#endif
