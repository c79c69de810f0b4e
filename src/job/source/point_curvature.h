// SPDX-License-Identifier: Apache-2.0
/* point_curvature: the curvature of points on meshes, from the triangles of the files (mesh_curvature.h), whether the
 * points were computed on the triangles, or on level sets of them. On volumes it is undefined beside limited samples
 * (ringing.h).
 *
 * A point of a combination has the curvature of the part on which it lies. It is undefined within two voxels of
 * another part. On a mesh at an offset d, a principal curvature k of the mesh becomes k / (1 + d k); it is undefined
 * where 1 + d k is not above 0. Around a crease it is 1 / d across and 0 along the crease, at a corner 1 / d twice.
 * Transforms apply to the result.
 */
#ifndef HEXAD_JOB_SOURCE_POINT_CURVATURE_H
#define HEXAD_JOB_SOURCE_POINT_CURVATURE_H

#include "base/core/error.h"
#include "base/core/threads.h"
#include "job/source/source.h"

/* Points of the sampled surface, in the sampled space. */
typedef struct point_curvature_input {
    size_t count;
    const vec3 *position, *normal;
    /* per point, of a surface with patches: its patch, or NULL; and a hint for the field of this patch
     * (FIELD_NO_HINT: none), or NULL */
    const uint32_t *patch, *hint;
} point_curvature_input;

typedef struct point_curvature {
    bool is_special; /* on a mesh, or undefined on a volume; otherwise the other members are 0 */
    bool is_defined; /* otherwise the members below are 0 */
    double kappa1, kappa2;
    vec3 direction1; /* unit, with any sign, in the sampled space */
} point_curvature;

/* Whether a part of the surface is a mesh. */
bool point_curvature_has_mesh(const source *s);

/* Whether a point may be special. */
bool point_curvature_is_special(const source *s);

/* Computes the curvature of the points. `out`: one per point. Errors: limit_memory, cancelled. The result does not
 * depend on the number of threads or on other points. */
bool point_curvature_find(const source *s, const point_curvature_input *in, threads *pool,
                          point_curvature *out, error *e);

#endif
