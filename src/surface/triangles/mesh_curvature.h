// SPDX-License-Identifier: Apache-2.0
/* mesh_curvature: the curvature of the smooth surface that the triangles of a mesh approximate.
 *
 * - A crease is a side at which the smooth surface ends: a side without exactly one neighbour, or a side that is
 *   sharper than a given angle. The triangles around a vertex between two creases are a sector of the vertex.
 * - Coplanar triangles that are connected by sides which are not creases are a facet. Its corners are the
 *   vertices at which the boundary of the facet turns, or at which more than two facets meet. Other vertices of a
 *   facet are where the file divides it: they do not lie on the smooth surface.
 * - A sector of a corner has a jet (surface/triangles/jet.h) through the corners around it. The neighbourhood
 *   consists of whole rings of neighbours, so that it follows the size of the facets.
 * - A position in a facet has the mean of the shape operators at the corners of the facet, with barycentric
 *   weights; in a facet of several triangles with mean value coordinates (Hormann and Floater 2006, "Mean value
 *   coordinates for arbitrary planar polygons"). Each shape operator is turned with its normal.
 *
 * The curvature is 0 in a facet that is bounded by creases only, and in a sector whose triangles are coplanar
 * between two creases. It is undefined where the corners do not determine it. doc/method.md explains the steps of
 * the fit. Only jets that mesh_curvature_prepare requires are computed. Lengths are those of the mesh.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_CURVATURE_H
#define HEXAD_SURFACE_TRIANGLES_MESH_CURVATURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"
#include "geometry/space/sym3.h"

typedef struct mesh_curvature mesh_curvature;

/* The surface at a position of the mesh. */
typedef struct mesh_curvature_value {
    bool defined;
    vec3 normal; /* unit, on the side of the triangle's normal; if not defined, that of the triangle */
    /* symmetric and tangential; its eigenvalues are positive where the surface bends away from the normal, as
     * on a sphere with outward normals. Not defined: 0 */
    sym3 shape;
} mesh_curvature_value;

typedef enum mesh_curvature_feature {
    MESH_CURVATURE_SMOOTH,
    MESH_CURVATURE_CREASE, /* on a crease */
    MESH_CURVATURE_CORNER  /* at a vertex at which a crease bends or ends */
} mesh_curvature_feature;

/* Finds creases. `m` is not owned and outlives the result, as does `beside`: per triangle, the triangle across the
 * side from corner k, UINT32_MAX: none; NULL: it is computed. Sides with a larger dihedral angle than `crease`
 * (radians; INFINITY: none) are creases. Errors: limit_memory, cancelled. */
mesh_curvature *mesh_curvature_new(const mesh *m, const uint32_t (*beside)[3], double crease, threads *pool,
                                   error *e);
void mesh_curvature_free(mesh_curvature *c); /* accepts NULL */

/* Computes the jets that mesh_curvature_at requires at positions of these triangles. May be called several times.
 * The jets do not depend on the number of threads or on other calls. Error: limit_memory, cancelled. */
bool mesh_curvature_prepare(mesh_curvature *c, const uint32_t *triangle, size_t count, threads *pool,
                            error *e);

/* The number of jets. */
size_t mesh_curvature_jets(const mesh_curvature *c);

/* The value at the position of a prepared triangle that has these barycentric weights. Any thread. */
mesh_curvature_value mesh_curvature_at(const mesh_curvature *c, uint32_t triangle, const double weight[3]);

/* Whether the position is on a crease: a weight is 0. *along: a vector along the crease (MESH_CURVATURE_CREASE).
 * Any thread. */
mesh_curvature_feature mesh_curvature_feature_at(const mesh_curvature *c, uint32_t triangle,
                                                 const double weight[3], vec3 *along);

#endif
