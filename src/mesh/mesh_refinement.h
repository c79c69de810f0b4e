/* mesh_refinement: cuts long sides of triangles where the surface bends, so that normals that are interpolated between vertices
 * turn near the edges of large triangles only, over about the length of a side. The surface stays the same. Pure function but for
 * allocation.
 */
#ifndef HEXAD_MESH_MESH_REFINEMENT_H
#define HEXAD_MESH_MESH_REFINEMENT_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "triangles/mesh.h"

/* Halves sides longer than `longest` once, if a vertex normal (unit) of an adjacent triangle differs from the triangle's own. Does nothing if
 * the result would have more than `most` triangles. Vertices at one place may be several, one for each patch: a side is halved in
 * all patches or in none. first[0] .. first[count]: the first triangle of each group, before and after. *changed: a side was halved. *m
 * is valid also after failure. Errors: limit_memory, cancelled. */
bool mesh_refine(mesh *m, const vec3 *normal, double longest, size_t most, size_t *first, size_t count,
                 bool *changed, error *e);

#endif
