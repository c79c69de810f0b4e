// SPDX-License-Identifier: Apache-2.0
/* mesh_clip: transforms a triangle mesh by a matrix, and cuts it to a box. Pure functions except for memory
 * allocation.
 */
#ifndef HEXAD_JOB_SOURCE_MESH_CLIP_H
#define HEXAD_JOB_SOURCE_MESH_CLIP_H

#include "base/core/error.h"
#include "geometry/mesh/mesh.h"

/* Applies `to_world` to the vertices. If the matrix mirrors, the triangles are reversed, so that their
 * outside remains the outside. */
void mesh_move(mesh *m, const double to_world[3][4]);

/* Removes the parts of the mesh outside of the box, in place. Where triangles share a side, the vertices of
 * the cut on this side are equal to the last bit. Errors: no_surface (no triangle remains), limit_memory. */
bool mesh_clip(mesh *m, bbox box, error *e);

#endif
