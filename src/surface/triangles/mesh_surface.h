// SPDX-License-Identifier: Apache-2.0
/* mesh_surface: a triangle mesh as a field of patches (surface/field/patches.h). The zero set of each patch
 * is its triangles.
 *
 * F of a patch at x is the signed distance from x to the plane of the closest triangle, along the
 * interpolated normal at the closest point of that triangle. One Newton step from x therefore ends in that
 * plane. Beyond its curves a patch continues in the planes of its last triangles. Second derivatives are
 * those of the interpolated normals, as a shape operator at each vertex. Long edges are halved where the
 * surface bends (mesh_refinement.h), so that normals turn within a spacing of an edge. The grid cells of the
 * field are the triangles, divided into pieces. World units. Sampling: any thread.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_SURFACE_H
#define HEXAD_SURFACE_TRIANGLES_MESH_SURFACE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/field.h"
#include "surface/triangles/mesh_patches.h"
#include "surface/triangles/mesh_place.h"

typedef struct mesh_surface mesh_surface;

/* Takes ownership of *patches and zeroes it, also on failure. `longest`: maximum edge length of a piece, and
 * of a triangle where the surface bends. `memory_limit`: maximum size, in bytes, of the triangles, the
 * pieces, and the data that a scan of the surface (surface_scan) keeps for each piece. NULL on error:
 * no_surface (no area), limit_memory, cancelled. */
mesh_surface *mesh_surface_new(mesh_patches *patches, double longest, size_t memory_limit, threads *pool,
                               error *e);
void mesh_surface_free(mesh_surface *s); /* accepts NULL */

/* Frees the shape operators: the second derivatives of the field are 0 then. No other thread uses the surface. */
void mesh_surface_drop_shapes(mesh_surface *s);

const field *mesh_surface_field(const mesh_surface *s);
/* The patches, with refined triangles. */
const mesh_patches *mesh_surface_patches(const mesh_surface *s);
/* The number of triangles before refinement; the mesh of these triangles. Vertices are shared within a patch only. */
size_t mesh_surface_triangles(const mesh_surface *s);
const mesh *mesh_surface_given(const mesh_surface *s);
/* Per triangle of mesh_surface_given: the triangle across the side from corner k, UINT32_MAX: the patch ends there.
 * *own: an array that the caller frees after use, or NULL. Error: limit_memory, NULL. */
const uint32_t (*mesh_surface_neighbours(const mesh_surface *s, uint32_t (**own)[3], error *e))[3];
/* The dihedral angle, in radians, above which sides of triangles within a patch are creases: INFINITY if the mesh
 * has feature edges, where patches end. */
double mesh_surface_crease(const mesh_surface *s);
/* The place on mesh_surface_given of a point x of a patch (UINT32_MAX: of any patch) with this unit normal. The hint:
 * one that `sample_near` of the patch returned for a place nearby, or FIELD_NO_HINT. */
mesh_place mesh_surface_find_given(const mesh_surface *s, uint32_t patch, vec3 x, vec3 normal, uint32_t hint);
/* The closest place of all triangles. */
vec3 mesh_surface_nearest(const mesh_surface *s, vec3 x);
/* A place of a patch. */
typedef struct mesh_surface_place {
    uint32_t patch, triangle; /* triangle: of mesh_surface_patches; the hint of the patch's field there */
    vec3 normal;              /* of the patch's field, unit */
    double distance;          /* of the point from the place */
} mesh_surface_place;

enum {
    MESH_SURFACE_PLACES = 8
}; /* patches that are distinguished at one place; at corners there may be more */

/* The patches on which x lies, or its nearest place does, ascending (mesh_place.h), at most
 * MESH_SURFACE_PLACES. Returns their number, at least 1; 0 if x is not finite. */
size_t mesh_surface_places(const mesh_surface *s, vec3 x, mesh_surface_place out[MESH_SURFACE_PLACES]);
size_t mesh_surface_bytes(const mesh_surface *s);

#endif
