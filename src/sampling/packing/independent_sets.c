// SPDX-License-Identifier: Apache-2.0
#include "sampling/packing/independent_sets.h"

#include <assert.h>
#include <stdbool.h>
#include <string.h>

#include "base/core/isa.h"

/* Number of sets that are filled at the same time. An even packing needs about eight until the first ones
 * are full. */
enum { OPEN = 16 };
/* Maximum number of points of two groups. */
static const size_t TWO_GROUPS = 3072;

/* Position of unused entries: far from every point, and differences from it do not overflow. */
static const int32_t NOWHERE = INT32_MAX;

typedef struct independent_set {
    int32_t x[INDEPENDENT_SET_MOST], y[INDEPENDENT_SET_MOST], z[INDEPENDENT_SET_MOST];
    float size[INDEPENDENT_SET_MOST];
    uint32_t point[INDEPENDENT_SET_MOST];
    size_t count;
} independent_set;

static void clear(independent_set *s)
{
    s->count = 0;
    for (int l = 0; l < INDEPENDENT_SET_MOST; l++) {
        s->x[l] = s->y[l] = s->z[l] = NOWHERE;
        s->size[l] = 0;
    }
}

/* Whether the set can take the point at p: no point of it is a neighbour. */
ISA_INLINE bool may_take(const independent_set *s, const neighbours_place *p, float half_cutoff2)
{
    int32_t near = 0;
    for (int l = 0; l < INDEPENDENT_SET_MOST; l++) {
        float x = (float)(s->x[l] - p->x), y = (float)(s->y[l] - p->y), z = (float)(s->z[l] - p->z),
              sizes = s->size[l] + p->size;
        near |= x * x + y * y + z * z <= half_cutoff2 * (sizes * sizes);
    }
    return !near;
}

static void join(independent_set *s, uint32_t point, const neighbours_place *p)
{
    NEIGHBOURS_CHECK(s->count < INDEPENDENT_SET_MOST && !(point & INDEPENDENT_SET_LAST));
    size_t l = s->count++;
    s->x[l] = p->x;
    s->y[l] = p->y;
    s->z[l] = p->z;
    s->size[l] = p->size;
    s->point[l] = point;
}

static uint32_t *write_set(const independent_set *s, uint32_t *to)
{
    assert(s->count > 0);
    memcpy(to, s->point, s->count * sizeof *to);
    to[s->count - 1] |= INDEPENDENT_SET_LAST;
    return to + s->count;
}

/* Adds each point to the first set that can take it. Works in place: never more points have been written
 * than read. */
ISA_CLONES static void form(neighbours *n, uint32_t begin, uint32_t end)
{
    independent_set open[OPEN];
    size_t count = 0;
    uint32_t *to = n->bin_item + begin;
    const float half_cutoff = (float)(0.5 * n->cutoff / n->unit), half_cutoff2 = half_cutoff * half_cutoff;
    for (uint32_t a = begin; a < end; a++) {
        uint32_t point = n->bin_item[a];
        const neighbours_place *p = &n->place[point];
        size_t k = 0;
        while (k < count && !may_take(&open[k], p, half_cutoff2)) k++;
        if (k == OPEN) {
            to = write_set(&open[0], to);
            memmove(open, open + 1, (OPEN - 1) * sizeof *open);
            count = --k;
        }
        if (k == count) clear(&open[count++]);
        join(&open[k], point, p);
        if (open[k].count < INDEPENDENT_SET_MOST) continue;
        to = write_set(&open[k], to);
        memmove(open + k, open + k + 1, (--count - k) * sizeof *open);
    }
    for (size_t k = 0; k < count; k++) to = write_set(&open[k], to);
}

size_t independent_sets_groups(const neighbours *n, int colour)
{
    uint32_t begin, end;
    neighbours_block_points(n, n->colour_begin[colour], n->colour_begin[colour + 1], &begin, &end);
    return 2 * ((end - begin + TWO_GROUPS - 1) / TWO_GROUPS);
}

/* Groups have nearly equal numbers of points. A block belongs to the group to which its middle point belongs
 * if the colour's points are divided equally. */
size_t independent_sets_group_begin(const neighbours *n, int colour, size_t group)
{
    uint32_t begin, end;
    neighbours_block_points(n, n->colour_begin[colour], n->colour_begin[colour + 1], &begin, &end);
    const uint64_t groups = independent_sets_groups(n, colour), twice = 2 * (uint64_t)(end - begin) * group;
    size_t low = n->colour_begin[colour], high = n->colour_begin[colour + 1];
    while (low < high) {
        const size_t block = (low + high) / 2;
        uint32_t from, to;
        neighbours_block_points(n, block, block + 1, &from, &to);
        if (groups * (from - begin + (uint64_t)(to - begin)) < twice)
            low = block + 1;
        else
            high = block;
    }
    return low;
}

typedef struct form_job {
    neighbours *n;
    int colour;
} form_job;

static void form_chunk(void *context, int worker, size_t begin, size_t end)
{
    const form_job *job = context;
    uint32_t from, to;
    (void)worker;
    neighbours_block_points(job->n, independent_sets_group_begin(job->n, job->colour, begin),
                            independent_sets_group_begin(job->n, job->colour, end), &from, &to);
    form(job->n, from, to);
}

void independent_sets_form(neighbours *n, threads *pool)
{
    for (int c = 0; c < n->colours; c++) {
        form_job job = {n, c};
        threads_run(pool, independent_sets_groups(n, c), 1, form_chunk, &job);
    }
}
