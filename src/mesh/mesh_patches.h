/* mesh_patches: a triangle mesh as smooth pieces (patches) that end in curves, which end in corners; whatever the mesh is.
 *
 * A patch is a set of triangles that hang together by edges of two triangles that are no features. Its triangles are
 * turned to agree with most of them. A curve is a chain of edges of one triangle, of three and more, or of two that meet
 * at more than the feature angle. A corner is where other than two such edges meet, where other patches begin, or where a
 * chain bends by more than the feature angle. Pure functions but for allocation.
 */
#ifndef HEXAD_MESH_MESH_PATCHES_H
#define HEXAD_MESH_MESH_PATCHES_H

#include "base/error.h"
#include "base/threads.h"
#include "field/patches.h"
#include "triangles/mesh.h"
#include "triangles/mesh_edges.h"

/* In place of a feature angle: MESH_PATCHES_ANGLE where the edges of the mesh are sharp, else none. */
#define MESH_PATCHES_FOUND (-1.0)
#define MESH_PATCHES_ANGLE 0.7 /* radians */

typedef struct mesh_patches_params {
    double
        weld; /* what lies nearer to an open edge is on it: a share of the longest side of the mesh's box */
    double feature_angle; /* radians; 0: no edge of two triangles is a feature; or MESH_PATCHES_FOUND */
    double spacing;       /* of the points that the mesh is to have; 0: not known */
    const uint32_t *
        kind; /* of each triangle, or NULL: patches end between triangles that differ in it. Such a mesh is whole:
                           * nothing is welded, and its triangles keep their order within a patch */
    const mesh_edges *edges; /* of the mesh, which is welded then, or NULL: not known */
    threads *pool;           /* or NULL; does not show */
} mesh_patches_params;

typedef struct mesh_patches {
    mesh
        m; /* triangles patch after patch; a vertex belongs to one patch, and to one side of a curve within it */
    size_t count;
    size_t *first;    /* triangles of patch p: first[p] .. first[p + 1] */
    bool *one_sided;  /* no way of turning makes its triangles agree */
    size_t *reversed; /* of each patch: the triangles that run another way than in the mesh as given */
    size_t turned;    /* of all, once mesh_orientation_fix was called */
    uint32_t *kind;   /* of patch p, where triangles have one; else NULL */
    size_t curve_count;
    field_curve *curve; /* `on` is NULL: the polyline is the curve */
    vec3 *vertex;       /* of the curves */
    uint32_t *curve_patch;
    double feature_angle; /* that was used for edges between triangles; 0: none is a feature */
    size_t open_edges, feature_edges, nonmanifold_edges;
    bool closed; /* an even number of triangles meets at every edge of the mesh as given */
    size_t corner_count;
    bool merges_near_rows, has_rough_curves,
        has_many_parts; /* field/patches; false unless the owner says so */
} mesh_patches;

/* `m` is taken over, and zeroed, also on failure. Each triangle counts once, whichever way it is turned. Errors:
 * no_surface where no triangle is left, limit_memory, cancelled. */
bool mesh_patches_make(mesh *m, const mesh_patches_params *params, mesh_notes *notes, mesh_patches *out,
                       error *e);
void mesh_patches_free(mesh_patches *p); /* a zeroed one will do */

#endif
