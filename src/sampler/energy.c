#include "sampler/energy.h"

#include <math.h>

const double energy_cot_polynomial[ENERGY_COT_TERMS] = {
    0.9999999999999993,      -0.33333333333263604,    -0.02222222223830475,   -0.0021164019721737048,
    -0.00021164087743914922, -2.1375983579127956e-05, -2.167559271749789e-06, -2.156164995572121e-07,
    -2.506174706812694e-08,  -7.482250235439409e-10,  -7.488432880992186e-10, 8.722701840462539e-11,
    -1.4174855412866178e-11,
};

static double cotangent_value(double u)
{
    double w = u * M_PI_2;
    return u < 1 ? 1 / tan(w) + w - M_PI_2 : 0;
}

static double cotangent_first(double u)
{
    double c = u < 1 ? 1 / tan(u * M_PI_2) : 0;
    return -M_PI_2 * c * c; /* (7): 1 - 1/sin^2 = -cot^2 */
}

static double cotangent_second(double u)
{
    double c = u < 1 ? 1 / tan(u * M_PI_2) : 0;
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
