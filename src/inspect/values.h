/* values: what the numbers of a volume are like: range, distribution, and isovalues at which a surface may be worth having.
 *
 * Numbers come one after the other; beyond a fixed number of them every second one is dropped, again and again, so that
 * what is kept is spread evenly over the whole. Range and counts are of all of them. */
#ifndef HEXAD_INSPECT_VALUES_H
#define HEXAD_INSPECT_VALUES_H

#include <stdbool.h>
#include <stddef.h>

#include "json/json.h"

typedef struct values {
    double lowest, highest; /* finite ones */
    size_t count, not_finite;
    bool integral; /* all are whole numbers */
    double *kept;
    size_t kept_count, stride, until_next;
} values;

values values_begin(void);
void values_add(values *v, const double *number, size_t count);
void values_free(values *v);

/* Adds `range`, `values`, `not_finite`, `integral` and `histogram` (low, high, and the share of the values in each of equal
 * bins). */
void values_describe(const values *v, json *object);

/* Isovalues to try, the most promising first: the one that parts the values best in two classes (Otsu 1979), then
 * quantiles of those above the most frequent value. None equals a frequent value, at which there is a plateau. Sorts what
 * is kept. Returns how many. */
enum { VALUES_CANDIDATES = 4 };
size_t values_candidates(values *v, double out[VALUES_CANDIDATES]);

#endif
