/* mesh_repair: checks that triangles enclose a volume, and turns them so that they agree which side is inside.
 *
 * A component is a set of triangles connected by edges. It is closed when an even number of triangles meets at each
 * of its edges. Its triangles are turned to agree with the majority. Outermost components are turned so that
 * their volume is positive; components inside one turn with it. A component within another one of the opposite orientation is a cavity of it. A solid is a component
 * with its cavities; the shape is the union of the solids.
 */
#ifndef HEXAD_MESH_MESH_REPAIR_H
#define HEXAD_MESH_MESH_REPAIR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"
#include "triangles/mesh_edges.h"
#include "mesh/winding_number.h"

typedef struct mesh_solids {
    size_t solid_count;
    uint32_t *first; /* triangles of solid s: first[s] .. first[s + 1] */
    bool *one_sided; /* of a solid: its triangles cannot be turned to agree, only parity tells its inside */
} mesh_solids;

/* Where the mesh is. */
typedef struct mesh_place {
    double tolerance;             /* vertices this near to an open edge lie on it */
    const double *index_to_world; /* of the mesh's units, for messages */
    const mesh_edges *edges;      /* of the mesh, or NULL: not known */
    threads *pool;                /* or NULL; does not show */
} mesh_place;

/* Equal vertices must have been joined (mesh_weld). Splits triangles at open edges (see seams.h), turns them and sorts
 * them by solid. The mesh is in voxels (winding_fix). Adds notes on oddities. Errors:
 * input_unsupported for a mesh that is not closed, with the number of boundary edges, of holes, and the boxes of the
 * largest; limit_memory; cancelled. */
bool mesh_repair_solids(mesh *m, const mesh_place *place, mesh_solids *out, mesh_notes *notes, error *e);
void mesh_solids_free(mesh_solids *t);

#endif
