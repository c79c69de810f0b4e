/* patches: a surface made of smooth pieces (patches) that end in curves, which end in corners.
 *
 * Each patch is a field of its own. A curve is where patches end: a boundary where one does, a seam where two meet, an edge
 * that is no manifold where more do. A corner is a vertex at which curves end; curves that end at one corner have the same
 * doubles there. Curves are held fixed while patches are sampled: corners first, then curves, then patches (Meyer,
 * Whitaker, Kirby, Ledergerber and Pfister 2008, "Particle-based sampling and meshing of surfaces in multimaterial
 * volumes"; Bronson, Levine and Whitaker 2012, "Particle systems for adaptive, isotropic meshing of CAD models").
 *
 * World space. Immutable once built; whoever makes a field with patches owns these too.
 */
#ifndef HEXAD_FIELD_PATCHES_H
#define HEXAD_FIELD_PATCHES_H

#include <stdint.h>

#include "field/field.h"

typedef struct field_patch {
    /* Its own F: zero on the patch, defined some spacings around it. Beyond its curves the patch goes on tangentially. No
     * sheet of another patch is a zero of it. Of the ops only `sample`, `sample_near` and `within` are asked for. */
    const field *field;
    bool one_sided; /* it has no orientation (a Moebius strip): the sign of its normals means nothing */
    double area;    /* > 0 */
} field_patch;

typedef struct field_curve {
    size_t first, count; /* its polyline in `vertex`, count >= 2 (closed: 3) */
    bool closed;         /* the last vertex joins the first, and no vertex is a corner */
    size_t patch_first,
        patch_count;    /* in `curve_patch`, >= 1: the patches that end there; one that meets itself there
                         * stands twice */
    double cosine;      /* the least between the normals of the faces that meet along it; 0: not known */
    const field *on[2]; /* both NULL: the polyline is the curve. Else a place of the polyline is brought onto
                         * both zero sets */
} field_curve;

typedef struct field_patches {
    size_t count; /* > 0 */
    field_patch *patch;
    size_t curve_count; /* 0: the patches are closed */
    field_curve *curve;
    vec3 *vertex;
    uint32_t *curve_patch;
    bool merges_near_rows; /* rows of points that come nearer to each other than points can lie become one */
    bool
        has_rough_curves; /* with that: where a curve bends it has a corner for no reason of its own, as on a scan */
    bool
        has_many_parts; /* as a segmentation: every place is to have a point near it, however few points there are */
} field_patches;

/* Whether a place near the zero set of a patch is one of the patch. The hint is as of `within` in field_ops. */
static inline bool field_is_within_near(const field *patch, vec3 x, uint32_t *hint)
{
    return !patch->ops->within || patch->ops->within(patch, x, hint);
}

static inline bool field_is_within(const field *patch, vec3 x)
{
    uint32_t hint = FIELD_NO_HINT;
    return field_is_within_near(patch, x, &hint);
}

/* The field that holds for particles of a patch: the patch's own, or all of a surface without patches. */
static inline const field *field_of_patch(const field *f, uint32_t patch)
{
    return f->patches ? f->patches->patch[patch].field : f;
}

#endif
