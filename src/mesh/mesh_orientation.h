/* mesh_orientation: turns the patches of a mesh so that normals agree along edges and point out of closed parts.
 *
 * Patches that meet in an edge of two triangles run along it in opposite ways, as far as the surface is orientable; of a part that is not
 * closed most triangles stay as they are. The normals of a closed part that lies in no other point outwards. A closed part inside others is
 * turned with the outermost of them, so that a cavity stays a cavity. Pure functions.
 */
#ifndef HEXAD_MESH_MESH_ORIENTATION_H
#define HEXAD_MESH_MESH_ORIENTATION_H

#include "base/error.h"
#include "mesh/mesh_patches.h"

/* Sets p->turned. Error: limit_memory; the mesh is unchanged then. */
bool mesh_orientation_fix(mesh_patches *p, error *e);

#endif
