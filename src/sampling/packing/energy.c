// SPDX-License-Identifier: Apache-2.0
#include "sampling/packing/energy.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/isa.h"

const double energy_cot_polynomial[ENERGY_COT_TERMS] = {
    0.9999999999999993,      -0.33333333333263604,    -0.02222222223830475,   -0.0021164019721737048,
    -0.00021164087743914922, -2.1375983579127956e-05, -2.167559271749789e-06, -2.156164995572121e-07,
    -2.506174706812694e-08,  -7.482250235439409e-10,  -7.488432880992186e-10, 8.722701840462539e-11,
    -1.4174855412866178e-11,
};

ISA_CLONES double energy_cotangent_sum(const double *u2, const double *weight, size_t count)
{
    assert(count % ENERGY_LANES == 0);
    double sum[ENERGY_LANES] = {0};
    for (size_t k = 0; k < count; k += ENERGY_LANES)
        for (int l = 0; l < ENERGY_LANES; l++) {
            double s = M_PI_2 * M_PI_2 * u2[k + l], w = sqrt(s);
            double cot = energy_cot_polynomial[ENERGY_COT_TERMS - 1];
#pragma GCC unroll 16
            for (int t = ENERGY_COT_TERMS - 2; t >= 0; t--) cot = cot * s + energy_cot_polynomial[t];
            sum[l] += weight[k + l] * (cot / w + w - M_PI_2);
        }
    return ((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]));
}

static double cotangent_value(double u)
{
    double w = u * M_PI_2;
    return u < 1 ? 1 / elementary_tan(w) + w - M_PI_2 : 0;
}

static double cotangent_first(double u)
{
    double c = u < 1 ? 1 / elementary_tan(u * M_PI_2) : 0;
    return -M_PI_2 * c * c; /* (7): 1 - 1/sin^2 = -cot^2 */
}

static double cotangent_second(double u)
{
    double c = u < 1 ? 1 / elementary_tan(u * M_PI_2) : 0;
    return M_PI_2 * M_PI_2 * 2 * c * (1 + c * c);
}

const energy_function energy_cotangent = {
    .name = "cotangent",
    .value = cotangent_value,
    .first = cotangent_first,
    .second = cotangent_second,
    .ideal = 0.7108259081922546,      /* 6 phi(1 / sqrt 3) */
    .ideal_slope = 4.685640854798417, /* -u phi'(u) / phi(u) at u = 1 / sqrt 3 */
};

/* The standard deviation of the Gaussian, as a fraction of the support. */
#define GAUSSIAN_DEVIATION (1.0 / 3)

static double gaussian_value(double u)
{
    double z = u / GAUSSIAN_DEVIATION;
    return u < 1 ? elementary_exp(-0.5 * z * z) : 0;
}

static double gaussian_first(double u)
{
    return -u / (GAUSSIAN_DEVIATION * GAUSSIAN_DEVIATION) * gaussian_value(u);
}

static double gaussian_second(double u)
{
    double z = u / GAUSSIAN_DEVIATION;
    return (z * z - 1) / (GAUSSIAN_DEVIATION * GAUSSIAN_DEVIATION) * gaussian_value(u);
}

const energy_function energy_gaussian = {
    .name = "gaussian",
    .value = gaussian_value,
    .first = gaussian_first,
    .second = gaussian_second,
    .ideal = 1.3387809608905789, /* 6 exp(-3 / 2) */
    .ideal_slope = 3,            /* (u / deviation)^2 */
};

static double electrostatic_value(double u)
{
    return u < 1 ? 1 / u : 0;
}

static double electrostatic_first(double u)
{
    return u < 1 ? -1 / (u * u) : 0;
}

static double electrostatic_second(double u)
{
    return u < 1 ? 2 / (u * u * u) : 0;
}

const energy_function energy_electrostatic = {
    .name = "electrostatic",
    .value = electrostatic_value,
    .first = electrostatic_first,
    .second = electrostatic_second,
    .ideal = 10.392304845413264, /* 6 sqrt 3 */
    .ideal_slope = 1,
};

const energy_function *energy_find(const char *name)
{
    static const energy_function *const all[] = {&energy_cotangent, &energy_gaussian, &energy_electrostatic};
    for (size_t k = 0; k < sizeof all / sizeof all[0]; k++)
        if (strcmp(all[k]->name, name) == 0) return all[k];
    return NULL;
}
