// SPDX-License-Identifier: Apache-2.0
/* creases: the curves in which the leaves of a solid meet, joined from sides of triangles that lie on two
 * leaves. */
#ifndef HEXAD_SURFACE_FIELD_CREASES_H
#define HEXAD_SURFACE_FIELD_CREASES_H

#include "base/core/error.h"
#include "surface/field/patches.h"
#include "surface/field/solid.h"

/* A segment of a curve. */
typedef struct crease_segment {
    vec3 end[2];
    uint64_t on[2]; /* the set of leaves that contain each end, as bits */
    int leaf[2];    /* the leaves that meet along it */
    uint64_t sides; /* sides of all other leaves along it, as bits */
} crease_segment;

/* Joins segments into curves: sets `curve`, `vertex` and `curve_patch` of *out, which the caller frees.
 * patch_of[2 leaf] is the patch of a leaf where the solid is inside it, patch_of[2 leaf + 1] where the solid
 * is outside; UINT32_MAX: none. `on` of the curves points to leaves of the solid. Ends on three or more
 * leaves that are closer than `tolerance`, world units, are joined. Sorts the segments. Error:
 * limit_memory. */
bool creases_join(const solid *s, crease_segment *segment, size_t count, const uint32_t *patch_of,
                  double tolerance, field_patches *out, error *e);

#endif
