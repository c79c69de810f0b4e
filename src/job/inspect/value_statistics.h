// SPDX-License-Identifier: Apache-2.0
/* value_statistics: statistics of the values of a volume: range, distribution, and isovalues of probable
 * surfaces.
 *
 * Values are added one after the other. At most a fixed number of them is kept: when it is reached, every
 * second one is dropped and only every second of the next ones is kept, so that kept values are spread
 * evenly. Range and counts are of all values.
 */
#ifndef HEXAD_JOB_INSPECT_VALUE_STATISTICS_H
#define HEXAD_JOB_INSPECT_VALUE_STATISTICS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/json/json.h"

typedef struct values {
    double lowest, highest; /* of the finite values */
    size_t count, not_finite;
    bool integral; /* all values are whole numbers */
    double *kept;
    size_t kept_count, stride, until_next;
} values;

values value_statistics_begin(void);
void value_statistics_add(values *v, const double *number, size_t count);
void value_statistics_free(values *v);

/* Adds `range`, `values`, `not_finite`, `integral` and `histogram` (low, high, and the fraction of the values
 * in each of several bins of equal width). */
void value_statistics_describe(const values *v, json *object);

/* Stores isovalues in `out`, the most promising first: the value that best separates the values into two
 * classes (Otsu 1979), then quantiles of the values above the most frequent one. No isovalue is a frequent
 * value, since that would select a plateau. Sorts the kept values. Returns the number of isovalues. */
enum { VALUE_STATISTICS_CANDIDATES = 4 };
size_t value_statistics_candidates(values *v, double out[VALUE_STATISTICS_CANDIDATES]);

#endif
