#include "geometry/morton.h"

#include <stdlib.h>

#include "base/memory.h"
#include "geometry/bbox.h"

enum { FEWEST_BITS = 5, MOST_BITS = 14 };

/* Of each coordinate: of n points on a surface, root n lie along an axis; times four. */
static int bits_of(size_t count)
{
    int bits = FEWEST_BITS;
    while (bits < MOST_BITS && (size_t)1 << 2 * (bits - 2) < count) bits++;
    return bits;
}

/* Bit k of v to bit 3 k. */
static uint64_t spread(uint64_t v)
{
    v = (v | v << 16) & 0x0000ff0000ff;
    v = (v | v << 8) & 0x00f00f00f00f;
    v = (v | v << 4) & 0x0c30c30c30c3;
    return (v | v << 2) & 0x249249249249;
}

static void find_keys(const vec3 *x, size_t count, int bits, uint64_t *key)
{
    bbox box = bbox_empty();
    for (size_t i = 0; i < count; i++) box = bbox_include(box, x[i]);
    double size = bbox_longest(box), cells = (double)((1 << bits) - 1), scale = size > 0 ? cells / size : 0;
    for (size_t i = 0; i < count; i++) {
        vec3 d = vec3_scale(vec3_sub(x[i], box.min), scale);
        key[i] = spread((uint64_t)d.x) | spread((uint64_t)d.y) << 1 | spread((uint64_t)d.z) << 2;
    }
}

/* One pass of a radix sort: by the digit at `shift`. */
static void sort_digit(const uint64_t *key, const uint32_t *from, size_t count, int shift, int bits,
                       uint32_t *begin, uint32_t *to)
{
    uint32_t digits = 1u << bits, sum = 0;
    for (uint32_t d = 0; d < digits; d++) begin[d] = 0;
    for (size_t k = 0; k < count; k++) begin[key[k] >> shift & (digits - 1)]++;
    for (uint32_t d = 0; d < digits; d++) {
        uint32_t here = begin[d];
        begin[d] = sum;
        sum += here;
    }
    for (size_t k = 0; k < count; k++) to[begin[key[from[k]] >> shift & (digits - 1)]++] = from[k];
}

bool morton_order(const vec3 *x, size_t count, uint32_t *order, error *e)
{
    int bits = bits_of(count);
    uint64_t *key = mem_array(count, sizeof *key, "the order of points", e);
    uint32_t *other = mem_array(count, sizeof *other, "the order of points", e);
    uint32_t *begin = mem_array((size_t)1 << bits, sizeof *begin, "the order of points", e);
    bool ok = key && other && begin;
    if (ok) {
        find_keys(x, count, bits, key);
        for (size_t i = 0; i < count; i++) other[i] = (uint32_t)i;
        sort_digit(key, other, count, 0, bits, begin, order);
        sort_digit(key, order, count, bits, bits, begin, other);
        sort_digit(key, other, count, 2 * bits, bits, begin, order);
    }
    free(key);
    free(other);
    free(begin);
    return ok;
}
