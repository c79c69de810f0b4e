// SPDX-License-Identifier: Apache-2.0
/* point_flags: what distinguishes a point of a packing from one in the interior of a smooth surface. Pure
 * functions. */
#ifndef HEXAD_SAMPLING_PACKING_POINT_FLAGS_H
#define HEXAD_SAMPLING_PACKING_POINT_FLAGS_H

#include <stdbool.h>

#include "geometry/space/bbox.h"

/* Flags of a point. */
enum {
    PACKING_FIXED = 1,     /* it is fixed on a curve, where its patch ends */
    PACKING_ONE_SIDED = 2, /* the sign of its normal is arbitrary */
    PACKING_AT_WEDGE =
        4 /* it is near the samples of a sharp edge, where the faces that meet there are within reach of
           * each other */
};

/* Whether x lies within two spacings of a face of the box that cuts the surface: a point there has fewer
 * neighbours than in the interior, or other positions of them. */
static inline bool packing_is_near_boundary(bbox faces, vec3 x, double spacing)
{
    return !bbox_contains(bbox_grow(faces, -2 * spacing), x);
}

#endif
