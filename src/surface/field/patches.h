// SPDX-License-Identifier: Apache-2.0
/* patches: a surface made of smooth pieces (patches) that end in curves, which end in corners.
 *
 * Each patch is a field of its own. A curve is where patches end: a boundary of one patch, a seam of two, a
 * nonmanifold edge of more. A corner is a vertex at which curves end; curves that end at one corner have
 * bitwise equal coordinates there. Curves are held fixed while patches are sampled: corners first, then
 * curves, then patches (Meyer, Whitaker, Kirby, Ledergerber and Pfister 2008, "Particle-based sampling and
 * meshing of surfaces in multimaterial volumes"; Bronson, Levine and Whitaker 2012, "Particle systems for
 * adaptive, isotropic meshing of CAD models").
 *
 * World space. Immutable after construction, any thread. The creator of a field with patches owns them.
 */
#ifndef HEXAD_SURFACE_FIELD_PATCHES_H
#define HEXAD_SURFACE_FIELD_PATCHES_H

#include <stdint.h>

#include "surface/field/field.h"

typedef struct field_patch {
    /* F of the patch: zero on it, defined within some spacings of it. Beyond its curves the patch continues
     * tangentially. It is not zero on other patches. Only the operations `sample`, `sample_near` and `within`
     * are called. */
    const field *field;
    bool one_sided; /* not orientable (a Moebius strip): the sign of its normals is arbitrary */
    double area;    /* > 0 */
} field_patch;

typedef struct field_curve {
    size_t first, count; /* its polyline in `vertex`, count >= 2 (closed: 3) */
    bool closed;         /* the last vertex is connected to the first, and no vertex is a corner */
    /* In `curve_patch`, at least 1: the incident patches. A patch that meets itself along the curve occurs
     * twice. */
    size_t patch_first, patch_count;
    double cosine; /* minimum cosine between the normals of the faces that meet along it; 0: unknown */
    /* Both NULL: the polyline is the curve. Else a place of the polyline is projected onto both zero sets. */
    const field *on[2];
} field_curve;

typedef struct field_patches {
    size_t count; /* > 0 */
    field_patch *patch;
    size_t curve_count; /* 0: the patches are closed */
    field_curve *curve;
    vec3 *vertex;
    uint32_t *curve_patch;
    /* Samples of different curves that are closer to each other than points of a packing may be are merged
     * (sampling/solver/curves/near_curves.h). */
    bool merges_near_curves;
    /* With merges_near_curves: curves have corners where they bend, without a corner of the surface, as on
     * scans. */
    bool has_rough_curves;
    /* There are many small patches, as in a segmentation: every place needs a point nearby, however few
     * points there are. */
    bool has_many_parts;
} field_patches;

/* The sum of the areas of all patches. */
static inline double field_patches_area(const field_patches *p)
{
    double area = 0;
    for (size_t k = 0; k < p->count; k++) area += p->patch[k].area;
    return area;
}

/* Whether a place near the zero set of a patch lies on the patch, not beyond its curves. The hint: see
 * `within` in field_ops. */
static inline bool field_is_within_near(const field *patch, vec3 x, uint32_t *hint)
{
    return !patch->ops->within || patch->ops->within(patch, x, hint);
}

static inline bool field_is_within(const field *patch, vec3 x)
{
    uint32_t hint = FIELD_NO_HINT;
    return field_is_within_near(patch, x, &hint);
}

/* The field of a patch; on a surface without patches, f. */
static inline const field *field_of_patch(const field *f, uint32_t patch)
{
    return f->patches ? f->patches->patch[patch].field : f;
}

#endif
