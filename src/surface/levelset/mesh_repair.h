// SPDX-License-Identifier: Apache-2.0
/* mesh_repair: tests whether triangles enclose a volume, and orients them consistently.
 *
 * A component is a set of triangles connected by edges. It is closed if an even number of triangles meets at
 * each of its edges. Its triangles are oriented like the majority. An outermost component is oriented so that
 * its volume is positive; if it is reversed for that, so are all components inside it. A component inside
 * another one is a cavity of it if their orientations are opposite. A solid is a component with its cavities.
 * The shape is the union of the solids.
 */
#ifndef HEXAD_SURFACE_LEVELSET_MESH_REPAIR_H
#define HEXAD_SURFACE_LEVELSET_MESH_REPAIR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/mesh_edges.h"
#include "surface/levelset/winding_number.h"

typedef struct mesh_solids {
    size_t solid_count;
    uint32_t *first; /* solid s has the triangles first[s] .. first[s + 1] - 1 */
    bool *one_sided; /* per solid: not orientable; only the parity of crossings determines its inside */
} mesh_solids;

/* Coordinates and edges of the mesh. */
typedef struct mesh_repair_input {
    double tolerance; /* distance, in voxels, within which a vertex counts as lying on an open edge */
    const double *index_to_world; /* from voxels to world units, for messages; 16 entries */
    const mesh_edges *edges;      /* the edges of the mesh; NULL: not computed yet */
    threads *pool;                /* or NULL; the result does not depend on it */
} mesh_repair_input;

/* Splits triangles at open edges (see geometry/mesh/seams.h), orients them and sorts them by solid. Before
 * the call, equal vertices must have been joined (mesh_weld), and the coordinates must be in voxels and in
 * the range of winding_fix. Adds notes on what was repaired. *out is unchanged on failure. Errors:
 * input_unsupported (the mesh is not closed; with the numbers of boundary edges and holes, and the boxes of
 * the largest holes), limit_memory, cancelled. */
bool mesh_repair_solids(mesh *m, const mesh_repair_input *in, mesh_solids *out, mesh_notes *notes, error *e);
void mesh_solids_free(mesh_solids *t);

#endif
