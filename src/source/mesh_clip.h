/* mesh_clip: a triangle mesh moved by a matrix, and what of it lies within a box. Pure functions but for allocation. */
#ifndef HEXAD_SOURCE_MESH_CLIP_H
#define HEXAD_SOURCE_MESH_CLIP_H

#include "base/error.h"
#include "triangles/mesh.h"

/* World = `to_world` applied to the mesh. Where that mirrors, triangles are turned, so that what was outside of them stays it. */
void mesh_move(mesh *m, const double to_world[3][4]);

/* Cuts triangles along the faces of the box; cuts of triangles that share a side share their ends to the last bit. In place.
 * Errors: no_surface when nothing is left, limit_memory. */
bool mesh_clip(mesh *m, bbox box, error *e);

#endif
