// SPDX-License-Identifier: Apache-2.0
/* mesh_orientation: orients the patches of a mesh so that normals agree across edges and point out of closed
 * parts.
 *
 * Patches that share an edge of two triangles get consistent orientations, if the surface is orientable. In a
 * part that is not closed, the majority of the triangles keeps its orientation. The normals of a closed part
 * that lies in no other part point outwards. A closed part inside another one is turned with the outermost
 * part around it, so that a cavity remains a cavity. Pure functions.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_ORIENTATION_H
#define HEXAD_SURFACE_TRIANGLES_MESH_ORIENTATION_H

#include "base/core/error.h"
#include "surface/triangles/mesh_patches.h"

/* Orients the triangles and sets p->turned. Error: limit_memory; *p is unchanged then. */
bool mesh_orientation_fix(mesh_patches *p, error *e);

#endif
