#include "sampler/neighbours.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/bbox.h"

static const size_t GRAIN = 16; /* bins in a chunk of work */
#define AXIS_BITS 21            /* of a bin's coordinate in its key */
static const size_t FIRST_STRIDE = 32;

neighbours *neighbours_new(size_t capacity, size_t list_limit, error *e)
{
    neighbours *n = mem_alloc(sizeof *n);
    n->capacity = capacity;
    n->list_limit = list_limit;
    n->stride = FIRST_STRIDE;
    n->table_size = 64;
    while (n->table_size < 2 * capacity) n->table_size *= 2;
    const char *what = "neighbour lists";
    if (!(n->bin_begin = mem_array(capacity + 1, sizeof *n->bin_begin, what, e)) ||
        !(n->bin_item = mem_array(capacity, sizeof *n->bin_item, what, e)) ||
        !(n->bin_key = mem_array(capacity, sizeof *n->bin_key, what, e)) ||
        !(n->bin_of = mem_array(capacity, sizeof *n->bin_of, what, e)) ||
        !(n->table = mem_array(n->table_size, sizeof *n->table, what, e)) ||
        !(n->colour_bin = mem_array(capacity, sizeof *n->colour_bin, what, e)) ||
        !(n->list = mem_array(capacity * n->stride, sizeof *n->list, what, e)) ||
        !(n->list_count = mem_array(capacity, sizeof *n->list_count, what, e))) {
        neighbours_free(n);
        return NULL;
    }
    return n;
}

void neighbours_free(neighbours *n)
{
    if (!n) return;
    free(n->bin_begin);
    free(n->bin_item);
    free(n->bin_key);
    free(n->bin_of);
    free(n->table);
    free(n->colour_bin);
    free(n->list);
    free(n->list_count);
    free(n);
}

static uint64_t key_make(int64_t i, int64_t j, int64_t k)
{
    return (uint64_t)i | (uint64_t)j << AXIS_BITS | (uint64_t)k << 2 * AXIS_BITS;
}

static uint64_t key_of(const neighbours *n, vec3 x)
{
    vec3 d = vec3_scale(vec3_sub(x, n->origin), 1 / n->cutoff);
    return key_make((int64_t)d.x, (int64_t)d.y, (int64_t)d.z);
}

/* The slot of a key: where its bin is, or where it would go. */
static size_t slot_of(const neighbours *n, uint64_t key)
{
    size_t slot = (size_t)(key * 0x9e3779b97f4a7c15u >> 20) & (n->table_size - 1);
    while (n->table[slot] && n->bin_key[n->table[slot] - 1] != key) slot = (slot + 1) & (n->table_size - 1);
    return slot;
}

/* Bins are numbered as points first fall into them, so their order follows that of the points. */
static void fill_bins(neighbours *n, const vec3 *x)
{
    memset(n->table, 0, n->table_size * sizeof *n->table);
    n->bin_count = 0;
    for (size_t i = 0; i < n->count; i++) {
        uint64_t key = key_of(n, x[i]);
        size_t slot = slot_of(n, key);
        if (!n->table[slot]) {
            n->bin_key[n->bin_count] = key;
            n->bin_begin[n->bin_count] = 0;
            n->table[slot] = (uint32_t)++n->bin_count;
        }
        n->bin_of[i] = n->table[slot] - 1;
        n->bin_begin[n->bin_of[i]]++;
    }
    uint32_t total = 0; /* counts to ends; filling from the back turns ends into begins */
    for (size_t b = 0; b < n->bin_count; b++) n->bin_begin[b] = total += n->bin_begin[b];
    n->bin_begin[n->bin_count] = total;
    for (size_t i = n->count; i-- > 0;) n->bin_item[--n->bin_begin[n->bin_of[i]]] = (uint32_t)i;
}

static int colour_of(uint64_t key)
{
    return (int)((key & 1) | (key >> AXIS_BITS & 1) << 1 | (key >> 2 * AXIS_BITS & 1) << 2);
}

static void sort_colours(neighbours *n)
{
    memset(n->colour_begin, 0, sizeof n->colour_begin);
    for (size_t b = 0; b < n->bin_count; b++) n->colour_begin[colour_of(n->bin_key[b]) + 1]++;
    uint32_t next[NEIGHBOURS_COLOURS];
    for (int c = 0; c < NEIGHBOURS_COLOURS; c++) {
        n->colour_begin[c + 1] += n->colour_begin[c];
        next[c] = n->colour_begin[c];
    }
    for (size_t b = 0; b < n->bin_count; b++) n->colour_bin[next[colour_of(n->bin_key[b])]++] = (uint32_t)b;
}

typedef struct build_job {
    neighbours *n;
    const vec3 *x;
    atomic_size_t longest;
} build_job;

/* The lists of one bin's points; entries beyond the stride are counted, not stored. */
static size_t list_bin(const build_job *job, size_t bin)
{
    neighbours *n = job->n;
    uint32_t near[27];
    int near_count = 0;
    uint64_t key = n->bin_key[bin];
    for (int k = 0; k < 27; k++) {
        uint64_t other = key + key_make(k % 3, k / 3 % 3, k / 9) - key_make(1, 1, 1);
        uint32_t entry = n->table[slot_of(n, other)];
        if (entry) near[near_count++] = entry - 1;
    }
    double cutoff2 = n->cutoff * n->cutoff;
    size_t longest = 0;
    for (uint32_t a = n->bin_begin[bin]; a < n->bin_begin[bin + 1]; a++) {
        uint32_t i = n->bin_item[a];
        uint32_t *list = n->list + i * n->stride;
        size_t count = 0;
        for (int k = 0; k < near_count; k++)
            for (uint32_t b = n->bin_begin[near[k]]; b < n->bin_begin[near[k] + 1]; b++) {
                uint32_t j = n->bin_item[b];
                if (vec3_norm2(vec3_sub(job->x[i], job->x[j])) >= cutoff2 || j == i) continue;
                if (count < n->stride) list[count] = j;
                count++;
            }
        n->list_count[i] = (uint32_t)(count < n->stride ? count : n->stride);
        if (count > longest) longest = count;
    }
    return longest;
}

static void list_chunk(void *context, int worker, size_t begin, size_t end)
{
    build_job *job = context;
    (void)worker;
    size_t longest = 0;
    for (size_t bin = begin; bin < end; bin++) {
        size_t l = list_bin(job, bin);
        if (l > longest) longest = l;
    }
    size_t seen = atomic_load(&job->longest);
    while (longest > seen && !atomic_compare_exchange_weak(&job->longest, &seen, longest)) continue;
}

static bool fill_lists(neighbours *n, const vec3 *x, threads *pool, error *e)
{
    build_job job = {n, x, 0};
    threads_run(pool, n->bin_count, GRAIN, list_chunk, &job);
    size_t longest = atomic_load(&job.longest);
    if (longest <= n->stride) return true;
    size_t stride = (longest + longest / 4 + 7) / 8 * 8;
    if ((double)n->capacity * (double)stride * sizeof *n->list > (double)n->list_limit)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "within %g of a point there are up to %zu others: lists of that take %.0f MB, %.0f are "
            "left: lower solver.sigma, or raise limits.memory_mb",
            n->cutoff, longest, (double)n->capacity * (double)stride * sizeof *n->list / (1 << 20),
            (double)n->list_limit / (1 << 20));
    uint32_t *list = mem_array(n->capacity * stride, sizeof *list, "neighbour lists", e);
    if (!list) return false;
    free(n->list);
    n->list = list;
    n->stride = stride;
    threads_run(pool, n->bin_count, GRAIN, list_chunk, &job);
    return true;
}

bool neighbours_build(neighbours *n, size_t count, const vec3 *x, double cutoff, threads *pool, error *e)
{
    bbox box = bbox_empty();
    for (size_t i = 0; i < count; i++) box = bbox_include(box, x[i]);
    /* one bin of margin, so that the 27 bins around any have no negative coordinate */
    if (bbox_longest(box) / cutoff > (1 << AXIS_BITS) - 4)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "the support %g is too small for a surface of size %g: ask for fewer points", cutoff,
                         bbox_longest(box));
    n->count = count;
    n->cutoff = cutoff;
    n->origin = vec3_sub(box.min, vec3_make(cutoff, cutoff, cutoff));
    fill_bins(n, x);
    sort_colours(n);
    return fill_lists(n, x, pool, e);
}
