/* creases: the curves in which the leaves of a solid meet, from the sides of triangles that lie on two of them. */
#ifndef HEXAD_FIELD_CREASES_H
#define HEXAD_FIELD_CREASES_H

#include "base/error.h"
#include "field/patches.h"
#include "field/solid.h"

/* A piece of a curve. */
typedef struct crease_segment {
    vec3 end[2];
    uint64_t on[2]; /* the leaves that each end lies on */
    int leaf[2];    /* that meet along it */
    uint64_t sides; /* of the other leaves, along it */
} crease_segment;

/* Joins segments into curves: `curve`, `vertex` and `curve_patch` of *out, whose memory is the caller's. `patch_of` is the
 * number of the patch of a leaf, at 2 leaf, or 2 leaf + 1 where the solid is outside of it; UINT32_MAX: there is none. `on` of
 * the curves are the solid's leaves. Ends that are nearer than `hair` are one where three leaves meet. The segments are sorted
 * anew. Error: limit_memory. */
bool creases_join(const solid *s, crease_segment *segment, size_t count, const uint32_t *patch_of,
                  double hair, field_patches *out, error *e);

#endif
