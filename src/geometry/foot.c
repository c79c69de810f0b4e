#include "geometry/foot.h"

ISA_CLONES void foot_find_lanes(foot_lanes *f)
{
    for (int l = 0; l < VEC3_LANES; l++) {
        const foot_triangle t = {{vec3_lanes_get(&f->corner[0], l), vec3_lanes_get(&f->corner[1], l),
                                  vec3_lanes_get(&f->corner[2], l)},
                                 {vec3_lanes_get(&f->normal[0], l), vec3_lanes_get(&f->normal[1], l),
                                  vec3_lanes_get(&f->normal[2], l)}};
        double weight[3];
        vec3 sum;
        const vec3 x = vec3_lanes_get(&f->x, l), own = foot_own_normal(&t);
        const double above = foot_weights(&t, x, weight);
        const vec3 off = foot_off(&t, weight, x, &sum), unit = vec3_unit(sum);
        const double smooth = vec3_norm2(sum) > 0 ? above : -1;
        f->above[l] = vec3_norm2(own) > 0 ? smooth : -1;
        f->value[l] = foot_distance(off, unit, own);
        vec3_lanes_put(&f->unit, l, unit);
    }
}
