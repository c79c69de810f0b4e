// SPDX-License-Identifier: Apache-2.0
/* curvature: principal curvatures from the first and second derivatives of a field (field.h). */
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
