// SPDX-License-Identifier: Apache-2.0
#include "surface/field/field.h"

void field_sample_lanes(const field *f, const vec3_lanes *x, bool defined[VEC3_LANES],
                        double value[VEC3_LANES], vec3_lanes *gradient)
{
    if (f->ops->sample_lanes) {
        f->ops->sample_lanes(f, x, defined, value, gradient);
        return;
    }
    for (int l = 0; l < VEC3_LANES; l++) {
        field_sample s = {0};
        defined[l] = defined[l] && field_sample_at(f, (vec3){x->x[l], x->y[l], x->z[l]}, FIELD_GRADIENT, &s);
        value[l] = s.value;
        gradient->x[l] = s.gradient.x;
        gradient->y[l] = s.gradient.y;
        gradient->z[l] = s.gradient.z;
    }
}
