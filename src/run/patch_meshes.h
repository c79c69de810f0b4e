/* patch_meshes: the triangles between the points of a surface of patches, patch by patch. Where the points of a patch alone
 * make no whole surface, as those of sheets that are nearer than their spacing, they are made along the patch's triangles. */
#ifndef HEXAD_RUN_PATCH_MESHES_H
#define HEXAD_RUN_PATCH_MESHES_H

#include "base/error.h"
#include "base/threads.h"
#include "mesh/mesh_patches.h"
#include "voronoi/triangulation.h"

/* Edges and vertices at which triangles are no surface, or end where they should not. */
size_t patch_meshes_faults(const triangulation_facts *facts);

/* `made`: by triangulation_make of `in`, whose labels are the patches of `on`; patches that have fewer faults the other way
 * become so. As it was after failure. Errors: limit_memory, cancelled. Deterministic for any number of threads. */
bool patch_meshes_mend(const triangulation_input *in, const mesh_patches *on, threads *pool,
                       triangulation *made, error *e);

#endif
