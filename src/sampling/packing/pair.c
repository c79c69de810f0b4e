// SPDX-License-Identifier: Apache-2.0
#include "sampling/packing/pair.h"

#include "base/core/isa.h"
#include "sampling/packing/energy.h"

/* Minimum distance for the potential, over sigma. It keeps the energy of coincident particles finite
 * (section 7: "a very small value added to all denominators"). */
static const double CLOSEST = 1e-6;

/* Adds the lanes in a fixed order. */
static inline double lane_sum(const double *a)
{
    return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
}

/* Input and output of the potential for one group of neighbours. */
typedef struct lanes {
    double dx[PAIR_LANES], dy[PAIR_LANES], dz[PAIR_LANES];
    double size2[PAIR_LANES];
    double r2[PAIR_LANES];     /* squared distance over size2, clamped to (CLOSEST sigma)^2 .. sigma^2 */
    double weight[PAIR_LANES]; /* 0 outside the support */
    double w[PAIR_LANES];      /* r / sigma * pi / 2 */
    double cot[PAIR_LANES];    /* cot w */
} lanes;

/* Loads one group. The loops are vectorised. Distances outside the support are clamped, so that nothing
 * overflows. */
static inline __attribute__((always_inline)) void lanes_load(lanes *p, const pair_list *list, size_t block,
                                                             vec3 x, double sigma)
{
    const double *px = list->x + block * PAIR_LANES, *py = list->y + block * PAIR_LANES,
                 *pz = list->z + block * PAIR_LANES, *pw = list->weight + block * PAIR_LANES,
                 *ps = list->size2 + block * PAIR_LANES;
    const double sigma2 = sigma * sigma, closest2 = CLOSEST * CLOSEST * sigma2, k = M_PI_2 / sigma;
    for (int l = 0; l < PAIR_LANES; l++) {
        double dx = x.x - px[l], dy = x.y - py[l], dz = x.z - pz[l], weight = pw[l];
        double r2 = (dx * dx + dy * dy + dz * dz) / ps[l];
        p->dx[l] = dx;
        p->dy[l] = dy;
        p->dz[l] = dz;
        p->size2[l] = ps[l];
        p->weight[l] = r2 < sigma2 ? weight : 0.0;
        r2 = r2 < sigma2 ? r2 : sigma2;
        p->r2[l] = r2 > closest2 ? r2 : closest2;
    }
    for (int l = 0; l < PAIR_LANES; l++) p->w[l] = k * sqrt(p->r2[l]);
    for (int l = 0; l < PAIR_LANES; l++) {
        double s = p->w[l] * p->w[l], cot = energy_cot_polynomial[ENERGY_COT_TERMS - 1];
#pragma GCC unroll 16
        for (int t = ENERGY_COT_TERMS - 2; t >= 0; t--) cot = cot * s + energy_cot_polynomial[t];
        p->cot[l] = cot / p->w[l];
    }
}

ISA_CLONES void pair_weigh(pair_list *list, vec3 n)
{
    const double *nx = list->nx, *ny = list->ny, *nz = list->nz, *amplitude = list->amplitude;
    double *restrict weight = list->weight;
    for (size_t k = 0; k < list->blocks * PAIR_LANES; k++) {
        double t = (n.x * nx[k] + n.y * ny[k] + n.z * nz[k] - PAIR_FACING_NONE) / PAIR_FACING_RANGE;
        t = t < 0 ? 0 : t;
        t = t > 1 ? 1 : t;
        weight[k] = amplitude[k] * t * t * (3 - 2 * t);
    }
}

ISA_CLONES static double cotangent_energy(const pair_list *list, vec3 x, double sigma)
{
    double energy[PAIR_LANES] = {0};
    for (size_t b = 0; b < list->blocks; b++) {
        lanes p;
        lanes_load(&p, list, b, x, sigma);
        for (int l = 0; l < PAIR_LANES; l++)
            energy[l] += p.weight[l] * p.size2[l] * (p.cot[l] + p.w[l] - M_PI_2);
    }
    return lane_sum(energy);
}

ISA_CLONES static void cotangent_forces(const pair_list *list, vec3 x, vec3 axis1, vec3 axis2, double sigma,
                                        pair_forces *out)
{
    const double k = M_PI_2 / sigma;
    double energy[PAIR_LANES] = {0}, d1[PAIR_LANES] = {0}, d2[PAIR_LANES] = {0}, h11[PAIR_LANES] = {0},
           h12[PAIR_LANES] = {0}, h22[PAIR_LANES] = {0}, nearest[PAIR_LANES];
    for (int l = 0; l < PAIR_LANES; l++) nearest[l] = INFINITY;
    for (size_t b = 0; b < list->blocks; b++) {
        lanes p;
        lanes_load(&p, list, b, x, sigma);
        for (int l = 0; l < PAIR_LANES; l++) {
            double cot2 = p.cot[l] * p.cot[l];
            double distance2 = p.r2[l] * p.size2[l];
            double slope = -k * k * cot2 * p.weight[l] / p.w[l];                       /* phi' / r */
            double bend = 2 * k * k * p.cot[l] * (1 + cot2) * p.weight[l] / distance2; /* phi'' / r^2 */
            double a1 = p.dx[l] * axis1.x + p.dy[l] * axis1.y + p.dz[l] * axis1.z;
            double a2 = p.dx[l] * axis2.x + p.dy[l] * axis2.y + p.dz[l] * axis2.z;
            energy[l] += p.weight[l] * p.size2[l] * (p.cot[l] + p.w[l] - M_PI_2);
            d1[l] += slope * a1;
            d2[l] += slope * a2;
            h11[l] += bend * a1 * a1;
            h12[l] += bend * a1 * a2;
            h22[l] += bend * a2 * a2;
            distance2 = p.weight[l] > 0 ? distance2 : INFINITY;
            nearest[l] = distance2 < nearest[l] ? distance2 : nearest[l];
        }
    }
    double closest = nearest[0];
    for (int l = 1; l < PAIR_LANES; l++) closest = fmin(closest, nearest[l]);
    *out = (pair_forces){lane_sum(energy), lane_sum(d1),  lane_sum(d2), lane_sum(h11),
                         lane_sum(h12),    lane_sum(h22), closest};
}

double pair_energy_at(const pair_list *list, const energy_function *energy, vec3 x, double sigma)
{
    if (energy == &energy_cotangent) return cotangent_energy(list, x, sigma);
    double sum = 0;
    for (size_t k = 0; k < list->blocks * PAIR_LANES; k++) {
        double r = vec3_norm(vec3_sub(x, (vec3){list->x[k], list->y[k], list->z[k]}));
        if (list->weight[k] > 0)
            sum += list->weight[k] * list->size2[k] *
                   energy->value(fmax(r / (sqrt(list->size2[k]) * sigma), CLOSEST));
    }
    return sum;
}

void pair_forces_at(const pair_list *list, const energy_function *energy, vec3 x, vec3 axis1, vec3 axis2,
                    double sigma, pair_forces *out)
{
    if (energy == &energy_cotangent) {
        cotangent_forces(list, x, axis1, axis2, sigma, out);
        return;
    }
    *out = (pair_forces){.nearest2 = INFINITY};
    for (size_t k = 0; k < list->blocks * PAIR_LANES; k++) {
        vec3 d = vec3_sub(x, (vec3){list->x[k], list->y[k], list->z[k]});
        double support = sqrt(list->size2[k]) * sigma, weight = list->weight[k] * list->size2[k];
        double r = fmax(vec3_norm(d), CLOSEST * support), u = r / support;
        if (weight == 0 || u >= 1) continue;
        double slope = weight * energy->first(u) / (support * r);
        /* the second derivative of a potential may be negative near its centre (Gaussian): no damping
         * follows from it then */
        double bend = weight * fmax(energy->second(u), 0) / (support * support * r * r);
        double a1 = vec3_dot(d, axis1), a2 = vec3_dot(d, axis2);
        out->energy += weight * energy->value(u);
        out->d1 += slope * a1;
        out->d2 += slope * a2;
        out->h11 += bend * a1 * a1;
        out->h12 += bend * a1 * a2;
        out->h22 += bend * a2 * a2;
        out->nearest2 = fmin(out->nearest2, r * r);
    }
}
