// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/smooth_triangle.h"

ISA_CLONES void smooth_triangle_find_lanes(smooth_triangle_lanes *f)
{
    for (int l = 0; l < VEC3_LANES; l++) {
        const smooth_triangle t = {{vec3_lanes_get(&f->corner[0], l), vec3_lanes_get(&f->corner[1], l),
                                    vec3_lanes_get(&f->corner[2], l)},
                                   {vec3_lanes_get(&f->normal[0], l), vec3_lanes_get(&f->normal[1], l),
                                    vec3_lanes_get(&f->normal[2], l)}};
        double weight[3];
        vec3 sum;
        const vec3 x = vec3_lanes_get(&f->x, l), own = smooth_triangle_own_normal(&t);
        const double above = smooth_triangle_weights(&t, x, weight);
        const vec3 off = smooth_triangle_offset(&t, weight, x, &sum), unit = vec3_unit(sum);
        const double smooth = vec3_norm2(sum) > 0 ? above : -1;
        f->above[l] = vec3_norm2(own) > 0 ? smooth : -1;
        f->value[l] = smooth_triangle_distance(off, unit, own);
        vec3_lanes_put(&f->unit, l, unit);
    }
}
