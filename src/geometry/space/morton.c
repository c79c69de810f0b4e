// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/morton.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"

enum { FEWEST_BITS = 5, MOST_BITS = 14 };
/* The sort uses PARTS parts for any number of threads, and one part for at most FEW points, so that the
 * result does not depend on the threads. */
enum { PARTS = 8 };
static const size_t FEW = 50000;

/* Bits of each coordinate. n points on a surface have about sqrt(n) points along an axis; the cells of the
 * curve are a quarter of their distance. */
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

typedef struct sort_job {
    morton_place *place;
    const void *context;
    size_t count, parts;
    threads *pool;
    int bits, shift; /* bits of a digit; position of the current digit */
    double scale;
    vec3 low;
    bbox box[PARTS];
    uint64_t *key;
    const uint32_t *from; /* order before the pass; NULL: the order of the input */
    uint32_t *to;
    uint32_t *begin; /* per part and digit: the next position of its points in the output */
} sort_job;

static size_t part_begin(const sort_job *j, size_t part)
{
    return j->count * part / j->parts;
}

static void bound_part(void *context, int worker, size_t part, size_t end)
{
    sort_job *j = context;
    (void)worker;
    for (; part < end; part++) {
        j->box[part] = bbox_empty();
        for (size_t i = part_begin(j, part); i < part_begin(j, part + 1); i++)
            j->box[part] = bbox_include(j->box[part], j->place(j->context, i));
    }
}

static void key_part(void *context, int worker, size_t part, size_t end)
{
    const sort_job *j = context;
    (void)worker;
    for (size_t i = part_begin(j, part); i < part_begin(j, end); i++) {
        vec3 d = vec3_scale(vec3_sub(j->place(j->context, i), j->low), j->scale);
        j->key[i] = spread((uint64_t)d.x) | spread((uint64_t)d.y) << 1 | spread((uint64_t)d.z) << 2;
    }
}

static uint32_t digit_at(const sort_job *j, size_t k, uint32_t *item)
{
    *item = j->from ? j->from[k] : (uint32_t)k;
    return (uint32_t)(j->key[*item] >> j->shift) & ((1u << j->bits) - 1);
}

static void count_part(void *context, int worker, size_t part, size_t end)
{
    const sort_job *j = context;
    (void)worker;
    for (; part < end; part++) {
        uint32_t *begin = j->begin + (part << j->bits), item;
        memset(begin, 0, sizeof *begin << j->bits);
        for (size_t k = part_begin(j, part); k < part_begin(j, part + 1); k++) begin[digit_at(j, k, &item)]++;
    }
}

static void move_part(void *context, int worker, size_t part, size_t end)
{
    const sort_job *j = context;
    (void)worker;
    for (; part < end; part++) {
        uint32_t *begin = j->begin + (part << j->bits), item;
        for (size_t k = part_begin(j, part); k < part_begin(j, part + 1); k++) {
            const uint32_t digit = digit_at(j, k, &item);
            j->to[begin[digit]++] = item;
        }
    }
}

/* One pass of a radix sort: by the digit at `shift`. */
static void sort_digit(sort_job *j, const uint32_t *from, int shift, uint32_t *to)
{
    uint32_t sum = 0;
    j->from = from;
    j->to = to;
    j->shift = shift;
    threads_run(j->pool, j->parts, 1, count_part, j);
    for (size_t d = 0; d < (size_t)1 << j->bits; d++)
        for (size_t part = 0; part < j->parts; part++) {
            uint32_t *begin = &j->begin[(part << j->bits) + d], here = *begin;
            *begin = sum;
            sum += here;
        }
    threads_run(j->pool, j->parts, 1, move_part, j);
}

static void find_keys(sort_job *j)
{
    bbox box = bbox_empty();
    threads_run(j->pool, j->parts, 1, bound_part, j);
    /* a stopped pool skipped parts; the keys must fit their bits */
    if (threads_stopped(j->pool)) threads_run(NULL, j->parts, 1, bound_part, j);
    for (size_t part = 0; part < j->parts; part++) box = bbox_unite(box, j->box[part]);
    const double size = bbox_longest(box), cells = (double)((1 << j->bits) - 1);
    j->scale = size > 0 ? cells / size : 0;
    j->low = box.min;
    threads_run(j->pool, j->parts, 1, key_part, j);
}

static vec3 place_in_array(const void *context, size_t k)
{
    return ((const vec3 *)context)[k];
}

bool morton_order(const vec3 *x, size_t count, threads *pool, uint32_t *order, error *e)
{
    return morton_order_of(place_in_array, x, count, pool, order, e);
}

bool morton_order_of(morton_place *place, const void *context, size_t count, threads *pool, uint32_t *order,
                     error *e)
{
    const char *what = "the order of points";
    sort_job j = {.place = place,
                  .context = context,
                  .count = count,
                  .parts = count < FEW ? 1 : PARTS,
                  .pool = count < FEW ? NULL : pool,
                  .bits = bits_of(count)};
    uint32_t *other = mem_array(count, sizeof *other, what, e);
    j.key = mem_array(count, sizeof *j.key, what, e);
    j.begin = mem_array(j.parts << j.bits, sizeof *j.begin, what, e);
    bool ok = j.key && other && j.begin;
    if (ok) {
        find_keys(&j);
        sort_digit(&j, NULL, 0, order);
        sort_digit(&j, order, j.bits, other);
        sort_digit(&j, other, 2 * j.bits, order);
    }
    free(j.key);
    free(other);
    free(j.begin);
    return ok;
}
