// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/witkin_heckbert.h"

#include "base/core/elementary.h"

static double gaussian(const witkin_heckbert_params *params, double r2, double sigma)
{
    double z2 = r2 / (sigma * sigma);
    return z2 < WITKIN_HECKBERT_REACH * WITKIN_HECKBERT_REACH ? params->alpha * elementary_exp(-0.5 * z2) : 0;
}

void witkin_heckbert_sum(const witkin_heckbert_params *params, const vec3 *x, const double *sigma, size_t i,
                         const uint32_t *list, size_t count, witkin_heckbert_terms *out)
{
    witkin_heckbert_terms t = {0};
    for (size_t k = 0; k < count; k++) {
        uint32_t j = list[k];
        vec3 r = vec3_sub(x[i], x[j]);
        double r2 = vec3_norm2(r), ratio = sigma[i] / sigma[j];
        double own = gaussian(params, r2, sigma[i]), other = gaussian(params, r2, sigma[j]);
        t.energy += own;
        t.push = vec3_axpy(own + ratio * ratio * other, r, t.push);
        t.growth += r2 / (sigma[i] * sigma[i]) * own;
        t.near += own > 0;
    }
    *out = t;
}

double witkin_heckbert_radius_rate(const witkin_heckbert_params *params, const vec3 *x, const vec3 *velocity,
                                   const double *sigma, size_t i, const uint32_t *list, size_t count,
                                   const witkin_heckbert_terms *terms)
{
    double rate = -params->rho * (terms->energy - params->e_hat * params->alpha);
    double s2 = sigma[i] * sigma[i];
    for (size_t k = 0; k < count; k++) {
        uint32_t j = list[k];
        vec3 r = vec3_sub(x[i], x[j]);
        double own = gaussian(params, vec3_norm2(r), sigma[i]);
        if (own > 0) rate += own / s2 * vec3_dot(r, vec3_sub(velocity[i], velocity[j]));
    }
    return sigma[i] * rate / (terms->growth + params->beta);
}

/* Sum of Gaussians over the points of a hexagonal lattice with neighbour distance u >= 1, up to the
 * cut-off. */
static double lattice_sum(double u)
{
    const int most = (int)WITKIN_HECKBERT_REACH;
    double sum = -1; /* without the particle itself */
    for (int a = -most; a <= most; a++)
        for (int b = -most; b <= most; b++) sum += elementary_exp(-0.5 * (a * a + a * b + b * b) * u * u);
    return sum;
}

double witkin_heckbert_packing(const witkin_heckbert_params *params)
{
    double low = 0.5, high = WITKIN_HECKBERT_REACH, u = 0.5 * (low + high);
    for (; low < u && u < high; u = 0.5 * (low + high)) {
        if (lattice_sum(u) > params->e_hat)
            low = u;
        else
            high = u;
    }
    return u;
}
