// SPDX-License-Identifier: Apache-2.0
#include "base/core/histogram.h"

#include <stddef.h>

const double histogram_bounds_s[HISTOGRAM_BOUNDS] = {0.1, 0.25, 0.5, 1,   2.5,  5,    10,    30,
                                                     60,  120,  300, 600, 1800, 3600, 14400, 86400};

void histogram_add(histogram *h, int64_t ms)
{
    size_t i = 0;
    while (i < HISTOGRAM_BOUNDS && (double)ms > 1000 * histogram_bounds_s[i]) i++;
    h->count[i]++;
    h->sum_ms += ms;
}
