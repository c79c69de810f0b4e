// SPDX-License-Identifier: Apache-2.0
/* histogram: a histogram of durations in the form of Prometheus.
 *
 * All histograms have the same bounds, from 0.1 s to a day. Any thread may add and read; a reader may see a
 * value in `count` before it is in the sum.
 */
#ifndef HEXAD_BASE_CORE_HISTOGRAM_H
#define HEXAD_BASE_CORE_HISTOGRAM_H

#include <stdatomic.h>
#include <stdint.h>

#define HISTOGRAM_BOUNDS 16

/* Upper bounds of all counts except the last, which has none. */
extern const double histogram_bounds_s[HISTOGRAM_BOUNDS];

typedef struct histogram {
    atomic_uint_fast64_t
        count[HISTOGRAM_BOUNDS + 1]; /* Number of values up to this bound and above the previous one. */
    atomic_int_fast64_t sum_ms;
} histogram;

void histogram_add(histogram *h, int64_t ms);

#endif
