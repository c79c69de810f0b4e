/* histogram: how often something took how long, as Prometheus counts it.
 *
 * The bounds are the same for all: from a tenth of a second to a day. Any thread may add and read; a reader may see a
 * value in `count` before it is in the sum.
 */
#ifndef HEXAD_BASE_HISTOGRAM_H
#define HEXAD_BASE_HISTOGRAM_H

#include <stdatomic.h>
#include <stdint.h>

#define HISTOGRAM_BOUNDS 16

/* The upper bounds of all counts but the last, which has none. */
extern const double histogram_bounds_s[HISTOGRAM_BOUNDS];

typedef struct histogram {
    atomic_uint_fast64_t
        count[HISTOGRAM_BOUNDS + 1]; /* of values up to this bound and above the one before */
    atomic_int_fast64_t sum_ms;
} histogram;

void histogram_add(histogram *h, int64_t ms);

#endif
