// SPDX-License-Identifier: Apache-2.0
/* curvature: principal curvatures from the first and second derivatives of a field (field.h). */
#include "base/core/elementary.h"
#include "surface/field/field.h"

double field_curvature(const field_sample *s, double *kappa1, double *kappa2)
{
    double length = vec3_norm(s->gradient);
    if (!(length > 0)) {
        *kappa1 = *kappa2 = 0;
        return 0;
    }
    /* In a frame (u, v) of the tangent plane, P H P / |grad F| is the 2x2 form below. It has no component
     * along n, so its Frobenius norm is that of the two eigenvalues. */
    vec3 n = vec3_scale(s->gradient, 1 / length), u, v;
    vec3_frame(n, &u, &v);
    vec3 hu = sym3_apply(s->hessian, u), hv = sym3_apply(s->hessian, v);
    sym2_eigenvalues(vec3_dot(u, hu) / length, vec3_dot(u, hv) / length, vec3_dot(v, hv) / length, kappa1,
                     kappa2);
    return sqrt(*kappa1 * *kappa1 + *kappa2 * *kappa2);
}

vec3 field_principal_direction(const field_sample *s, bool larger)
{
    static const double zero = 1e-9;
    vec3 n = vec3_unit(s->gradient), u, v;
    vec3_frame(n, &u, &v);
    vec3 hu = sym3_apply(s->hessian, u), hv = sym3_apply(s->hessian, v);
    double a = vec3_dot(u, hu), b = vec3_dot(u, hv), c = vec3_dot(v, hv);
    const elementary_sines turn =
        elementary_sincos(0.5 * elementary_atan2(2 * b, a - c) + (larger ? 0 : M_PI / 2));
    vec3 d = vec3_add(vec3_scale(u, turn.cos), vec3_scale(v, turn.sin));
    for (int axis = 0; axis < 3; axis++) {
        double component = vec3_get(d, axis);
        if (fabs(component) > zero) return component < 0 ? vec3_scale(d, -1) : d;
    }
    return d;
}
