/* mesh_surface: a triangle mesh as a field that is made of patches (see field/patches.h), each with a zero set that is its
 * triangles.
 *
 * Of the patch F at x is the distance from the triangle nearest to x along the normal there, which goes over from corner to
 * corner: a Newton step from beside a triangle ends on it. Beyond the curves a patch goes on in the planes of its last
 * triangles. Second derivatives are those of the normals, as a shape operator at each vertex. Long sides are cut where the surface bends
 * (mesh_refinement.h), so that normals turn within a spacing of an edge. Cells are the triangles, cut into pieces. World units. Threads: sampling is safe in any number.
 */
#ifndef HEXAD_MESH_MESH_SURFACE_H
#define HEXAD_MESH_MESH_SURFACE_H

#include "base/error.h"
#include "field/field.h"
#include "mesh/mesh_patches.h"

typedef struct mesh_surface mesh_surface;

/* No side of a piece, nor of a triangle where the surface bends, is longer than `longest`, and pieces take at most `memory_limit` bytes with what a scan of them does.
 * Takes over *patches, and zeroes it, also on failure. Errors: no_surface (no area), limit_memory. */
mesh_surface *mesh_surface_new(mesh_patches *patches, double longest, size_t memory_limit, error *e);
void mesh_surface_free(mesh_surface *s); /* NULL will do */

const field *mesh_surface_field(const mesh_surface *s);
/* The patches, with refined triangles; and the number of triangles before refinement. */
const mesh_patches *mesh_surface_patches(const mesh_surface *s);
size_t mesh_surface_triangles(const mesh_surface *s);
/* The nearest place of all triangles. */
vec3 mesh_surface_nearest(const mesh_surface *s, vec3 x);
size_t mesh_surface_bytes(const mesh_surface *s);

#endif
