// SPDX-License-Identifier: Apache-2.0
/* mesh_patches: divides any triangle mesh into smooth patches, which end in curves; curves end in corners.
 *
 * - A patch is a maximal set of triangles connected by edges of exactly two triangles that are not feature
 *   edges. Its triangles are oriented like the majority.
 * - A curve is a chain of edges of one triangle, of three or more, or of two whose dihedral angle exceeds the
 *   feature angle.
 * - A corner is a vertex of a curve where one such edge ends or three or more meet, where the incident
 *   patches change, or where a chain bends by more than the feature angle.
 * Pure functions except for allocation.
 */
#ifndef HEXAD_SURFACE_TRIANGLES_MESH_PATCHES_H
#define HEXAD_SURFACE_TRIANGLES_MESH_PATCHES_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "surface/field/patches.h"
#include "geometry/mesh/mesh.h"
#include "geometry/mesh/mesh_edges.h"

/* Value for feature_angle: mesh_patches_make decides. It uses MESH_PATCHES_ANGLE if the dihedral angles of
 * the mesh are those of a CAD model: few of them are near MESH_PATCHES_ANGLE, compared with the larger ones.
 * Otherwise, as for scans, it uses 0: there are no feature edges. */
#define MESH_PATCHES_AUTOMATIC (-1.0)
#define MESH_PATCHES_ANGLE 0.7 /* radians */

typedef struct mesh_patches_params {
    /* a vertex within weld * (longest side of the mesh's bounding box) of an open edge is welded to it */
    double weld;
    /* radians; 0: edges of two triangles are not features; or MESH_PATCHES_AUTOMATIC */
    double feature_angle;
    double spacing; /* of the points that will be placed, world units; 0: unknown */
    /* Per triangle; patches end between triangles of different kinds. NULL: one kind. A mesh with kinds is
     * complete: nothing is welded, and triangles keep their order within a patch. */
    const uint32_t *kind;
    const mesh_edges *edges; /* the edges of *m, if mesh_weld was called already; NULL: not computed yet */
    threads *pool;           /* or NULL; the result does not depend on it */
} mesh_patches_params;

typedef struct mesh_patches {
    /* Triangles sorted by patch. Vertices on curves are duplicated: one copy for each incident patch, and one
     * for each side of a curve that runs through the inside of a patch. */
    mesh m;
    size_t count;
    size_t *first;    /* patch p has the triangles first[p] .. first[p + 1] - 1 */
    bool *one_sided;  /* per patch: not orientable (Moebius strip) */
    size_t *reversed; /* per patch: number of triangles whose orientation was reversed */
    /* total number of triangles whose orientation was reversed; set by mesh_orientation_fix */
    size_t turned;
    uint32_t *kind; /* per patch; NULL without kinds */
    /* per patch: Euler characteristic of its inside, without the curves: vertices minus edges plus triangles */
    int64_t *euler;
    size_t curve_count;
    field_curve *curve;    /* `on` is NULL: the polyline is the curve */
    vec3 *vertex;          /* of the curves */
    uint32_t *curve_patch; /* incident patches of the curves, see field_curve.patch_first */
    double feature_angle;  /* that was used, radians; 0: edges of two triangles are not features */
    size_t open_edges, feature_edges, nonmanifold_edges;
    bool closed; /* an even number of triangles meets at every edge of the input mesh */
    size_t corner_count;
    /* see surface/field/patches.h; false unless the owner sets them */
    bool merges_near_curves, has_rough_curves, has_many_parts;
    /* the triangles before a region cut them, if it did; otherwise empty. Vertices are shared within a patch only.
     * Set by the owner */
    mesh uncut;
} mesh_patches;

/* Takes ownership of *m and zeroes it, also on failure: the caller has nothing to free then. *out is
 * unchanged on failure; free it after success. Each duplicate triangle is used once, whatever its
 * orientation. Errors: no_surface (no triangle is left), limit_memory, cancelled. */
bool mesh_patches_make(mesh *m, const mesh_patches_params *params, mesh_notes *notes, mesh_patches *out,
                       error *e);
void mesh_patches_free(mesh_patches *p); /* accepts a zeroed object */

#endif
