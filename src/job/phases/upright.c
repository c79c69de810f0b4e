// SPDX-License-Identifier: Apache-2.0
#include "job/phases/upright.h"

#include <math.h>

#include "geometry/space/bbox.h"

/* A base is the part of the surface within the fraction LOW of the height, whose normals point down with a
 * cosine of at least DOWN. */
static const double LOW = 0.02, DOWN = 0.9;
/* A base must have at least the fraction BASE of the area of the bounding box across the axis, and at least
 * CLEARLY times the base along the other axis. In the collection, statues and the screwdriver have 0.33 and
 * 0.7; objects whose base is along the other axis have at most 0.02. */
static const double BASE = 0.1, CLEARLY = 3;

/* The area of the base over that of the bounding box, with `axis` up. Normals of points on open surfaces may
 * have either sign. */
static double base_share(const points *set, bbox box, int axis)
{
    const vec3 size = bbox_size(box);
    const double height = vec3_get(size, axis), across = size.x * size.y * size.z / height;
    double area = 0;
    for (size_t i = 0; i < set->count; i++)
        if (vec3_get(set->position[i], axis) <= vec3_get(box.min, axis) + LOW * height &&
            fabs(vec3_get(set->normal[i], axis)) >= DOWN)
            area += 0.5 * sqrt(3) * set->spacing_local[i] * set->spacing_local[i];
    return height > 0 && across > 0 ? area / across : 0;
}

bool upright_y(const spec *s, const points *set)
{
    const bool y = spec_y_up(s);
    const bbox box = bbox_of_points(set->position, set->count, NULL);
    if (spec_up_is_certain(s)) return y;
    const double share = base_share(set, box, y ? 1 : 2), other_share = base_share(set, box, y ? 2 : 1);
    return other_share >= BASE && other_share >= CLEARLY * share ? !y : y;
}
