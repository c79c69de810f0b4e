// SPDX-License-Identifier: Apache-2.0
#include "job/inspect/value_statistics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/memory.h"

enum { KEPT = 1 << 20, BINS = 32, FINE_BINS = 1024 };

/* Otsu's threshold uses the values between these quantiles: a few outliers would otherwise leave all other
 * values in one bin. */
static const double TAIL = 0.001;
/* Quantiles, of the values above the most frequent one, that are suggested as isovalues. */
static const double QUANTILES[] = {0.5, 0.25, 0.9};
/* A value is frequent, a plateau, if more than this fraction of the values are equal to it. */
static const double FREQUENT = 0.02;
/* Candidates that differ by less than this fraction of the range are considered equal. */
static const double ALIKE = 1e-3;

values value_statistics_begin(void)
{
    return (values){.lowest = INFINITY,
                    .highest = -INFINITY,
                    .integral = true,
                    .kept = mem_alloc(KEPT * sizeof(double)),
                    .stride = 1};
}

void value_statistics_free(values *v)
{
    free(v->kept);
    v->kept = NULL;
}

static void keep(values *v, double number)
{
    if (v->until_next > 0) {
        v->until_next--;
        return;
    }
    if (v->kept_count == KEPT) {
        for (size_t k = 0; k < KEPT / 2; k++) v->kept[k] = v->kept[2 * k];
        v->kept_count = KEPT / 2;
        v->stride *= 2;
    }
    v->kept[v->kept_count++] = number;
    v->until_next = v->stride - 1;
}

void value_statistics_add(values *v, const double *number, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        const double x = number[k];
        v->count++;
        if (!isfinite(x)) {
            v->not_finite++;
            continue;
        }
        v->lowest = fmin(v->lowest, x);
        v->highest = fmax(v->highest, x);
        v->integral = v->integral && x == floor(x);
        keep(v, x);
    }
}

void value_statistics_describe(const values *v, json *object)
{
    size_t bin[BINS] = {0};
    double size = (v->highest - v->lowest) / BINS;
    json_put_integer(object, "values", (int64_t)v->count);
    json_put_integer(object, "not_finite", (int64_t)v->not_finite);
    json_put_bool(object, "integral", v->kept_count > 0 && v->integral);
    json *range = json_put_array(object, "range");
    json_append_number(range, v->lowest);
    json_append_number(range, v->highest);
    for (size_t k = 0; k < v->kept_count; k++) {
        size_t at = size > 0 ? (size_t)((v->kept[k] - v->lowest) / size) : 0;
        bin[at < BINS ? at : BINS - 1]++;
    }
    json *histogram = json_put_array(object, "histogram");
    for (int k = 0; v->kept_count > 0 && k < BINS; k++)
        json_append_number(histogram, (double)bin[k] / v->kept_count);
}

static double quantile(const double *sorted, size_t count, double share)
{
    return sorted[(size_t)(share * (double)(count - 1))];
}

/* The threshold with the largest variance between the classes below and above it. */
static double otsu(const double *sorted, size_t count)
{
    double low = quantile(sorted, count, TAIL), high = quantile(sorted, count, 1 - TAIL), all = 0, sum = 0;
    double bin[FINE_BINS] = {0}, below = 0, sum_below = 0, best = -1, at = 0.5 * (low + high);
    /* nearly all values are equal */
    if (!(high > low)) return 0.5 * (sorted[0] + sorted[count - 1]);
    for (size_t k = 0; k < count; k++) {
        double place = (sorted[k] - low) / (high - low) * FINE_BINS;
        if (place >= 0 && place <= FINE_BINS) bin[place < FINE_BINS ? (size_t)place : FINE_BINS - 1]++;
    }
    for (int k = 0; k < FINE_BINS; k++) {
        all += bin[k];
        sum += k * bin[k];
    }
    for (int k = 0; k + 1 < FINE_BINS; k++) {
        below += bin[k];
        sum_below += k * bin[k];
        if (!(below > 0 && below < all)) continue;
        double apart = sum_below / below - (sum - sum_below) / (all - below);
        double between = below * (all - below) * apart * apart;
        if (between > best) {
            best = between;
            at = low + (high - low) * (k + 1) / FINE_BINS;
        }
    }
    return at;
}

/* The fraction of the most frequent value. *end: the index after its last occurrence in the sorted values. */
static double most_frequent(const double *sorted, size_t count, size_t *end)
{
    size_t most = 0;
    for (size_t k = 0, next; k < count; k = next) {
        for (next = k + 1; next < count && sorted[next] == sorted[k];) next++;
        if (next - k > most) {
            most = next - k;
            *end = next;
        }
    }
    return (double)most / (double)count;
}

/* Moves an isovalue off a plateau: between whole numbers, or halfway to the next value that occurs. */
static double between_values(const values *v, double at)
{
    if (v->integral) return floor(at) + 0.5;
    size_t low = 0, high = v->kept_count, equal = 0;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (v->kept[middle] < at)
            low = middle + 1;
        else
            high = middle;
    }
    while (low + equal < v->kept_count && v->kept[low + equal] == at) equal++;
    if ((double)equal <= FREQUENT * v->kept_count || low + equal == v->kept_count) return at;
    return 0.5 * (at + v->kept[low + equal]);
}

size_t value_statistics_candidates(values *v, double out[VALUE_STATISTICS_CANDIDATES])
{
    size_t count = 0, begin = 0;
    if (v->kept_count == 0 || !(v->highest > v->lowest)) return 0;
    qsort(v->kept, v->kept_count, sizeof *v->kept, compare_doubles);
    double tried[VALUE_STATISTICS_CANDIDATES] = {otsu(v->kept, v->kept_count)};
    if (most_frequent(v->kept, v->kept_count, &begin) <= FREQUENT || begin == v->kept_count) begin = 0;
    for (int k = 1; k < VALUE_STATISTICS_CANDIDATES; k++)
        tried[k] = quantile(v->kept + begin, v->kept_count - begin, QUANTILES[k - 1]);
    for (int k = 0; k < VALUE_STATISTICS_CANDIDATES; k++) {
        double at = between_values(v, tried[k]);
        bool is_new = at > v->lowest && at < v->highest;
        for (size_t i = 0; i < count; i++)
            is_new = is_new && fabs(at - out[i]) > ALIKE * (v->highest - v->lowest);
        if (is_new) out[count++] = at;
    }
    return count;
}
