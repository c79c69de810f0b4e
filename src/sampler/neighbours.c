#include "sampler/neighbours.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geometry/bbox.h"

static const size_t GRAIN = 16; /* bins in a chunk of work */
#define AXIS_BITS 20            /* of a bin's coordinate in its key; the level stands above the three */
static const size_t FIRST_STRIDE = 32;
static const size_t FEWEST_BINS = 64;

/* Bins with points are no more than points; those above them rarely as many again. */
static bool reserve_bins(neighbours *n, size_t bins, error *e)
{
    const char *what = "neighbour lists";
    size_t table_size = FEWEST_BINS;
    while (table_size < 2 * bins) table_size *= 2;
    uint32_t *begin = mem_array(bins + 1, sizeof *begin, what, e),
             *colour_bin = mem_array(bins, sizeof *colour_bin, what, e),
             *table = mem_array(table_size, sizeof *table, what, e);
    uint64_t *key = mem_array(bins, sizeof *key, what, e);
    bool *split = mem_array(bins, sizeof *split, what, e);
    if (!begin || !colour_bin || !table || !key || !split) {
        free(begin);
        free(colour_bin);
        free(table);
        free(key);
        free(split);
        return false;
    }
    free(n->bin_begin);
    free(n->colour_bin);
    free(n->table);
    free(n->bin_key);
    free(n->bin_split);
    n->bin_begin = begin;
    n->colour_bin = colour_bin;
    n->table = table;
    n->bin_key = key;
    n->bin_split = split;
    n->bin_capacity = bins;
    n->table_size = table_size;
    return true;
}

neighbours *neighbours_new(size_t capacity, size_t list_limit, error *e)
{
    neighbours *n = mem_alloc(sizeof *n);
    n->capacity = capacity;
    n->list_limit = list_limit;
    n->stride = FIRST_STRIDE;
    const char *what = "neighbour lists";
    if (!reserve_bins(n, capacity, e) || !(n->bin_item = mem_array(capacity, sizeof *n->bin_item, what, e)) ||
        !(n->bin_of = mem_array(capacity, sizeof *n->bin_of, what, e)) ||
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
    free(n->bin_split);
    free(n->bin_of);
    free(n->table);
    free(n->colour_bin);
    free(n->list);
    free(n->list_count);
    free(n);
}

/* A bin's place: coordinates in units of its level's edge. */
typedef struct place {
    int level;
    int64_t at[3];
} place;

static uint64_t key_of(const place *p)
{
    return (uint64_t)p->at[0] | (uint64_t)p->at[1] << AXIS_BITS | (uint64_t)p->at[2] << 2 * AXIS_BITS |
           (uint64_t)p->level << 3 * AXIS_BITS;
}

static place place_of(uint64_t key)
{
    const uint64_t mask = ((uint64_t)1 << AXIS_BITS) - 1;
    return (place){
        (int)(key >> 3 * AXIS_BITS),
        {(int64_t)(key & mask), (int64_t)(key >> AXIS_BITS & mask), (int64_t)(key >> 2 * AXIS_BITS & mask)}};
}

static int level_of(const neighbours *n, double size)
{
    double over = size * n->cutoff / n->edge;
    int level = 0;
    while (level < NEIGHBOURS_LEVELS - 1 && over > (double)(1 << level)) level++;
    return level;
}

static place place_at(const neighbours *n, vec3 x, int level)
{
    vec3 d = vec3_scale(vec3_sub(x, n->origin), 1 / n->edge);
    return (place){level, {(int64_t)d.x >> level, (int64_t)d.y >> level, (int64_t)d.z >> level}};
}

static place parent_of(const place *p)
{
    return (place){p->level + 1, {p->at[0] >> 1, p->at[1] >> 1, p->at[2] >> 1}};
}

/* The slot of a key: where its bin is, or where it would go. */
static size_t slot_of(const neighbours *n, uint64_t key)
{
    size_t slot = (size_t)((key ^ key >> 29) * 0x9e3779b97f4a7c15u >> 32) & (n->table_size - 1);
    while (n->table[slot] && n->bin_key[n->table[slot] - 1] != key) slot = (slot + 1) & (n->table_size - 1);
    return slot;
}

#define NO_BIN UINT32_MAX

/* The bin of a key, made if there is none; NO_BIN when there is no room for it. */
static uint32_t bin_at(neighbours *n, uint64_t key)
{
    size_t slot = slot_of(n, key);
    if (!n->table[slot]) {
        if (n->bin_count == n->bin_capacity) return NO_BIN;
        n->bin_key[n->bin_count] = key;
        n->bin_begin[n->bin_count] = 0;
        n->bin_split[n->bin_count] = false;
        n->table[slot] = (uint32_t)++n->bin_count;
    }
    return n->table[slot] - 1;
}

/* Bins are numbered as points first fall into them, so their order follows that of the points; then come
 * those that have only bins below them. False when there are more than there is room for. */
static bool number_bins(neighbours *n, const vec3 *x, const double *size)
{
    memset(n->table, 0, n->table_size * sizeof *n->table);
    n->bin_count = 0;
    n->levels = 1;
    for (size_t i = 0; i < n->count; i++) {
        place p = place_at(n, x[i], size ? level_of(n, size[i]) : 0);
        if (p.level >= n->levels) n->levels = p.level + 1;
        n->bin_of[i] = bin_at(n, key_of(&p));
        n->bin_begin[n->bin_of[i]]++;
    }
    for (size_t b = 0; b < n->bin_count; b++) {
        place p = place_of(n->bin_key[b]);
        if (p.level == n->levels - 1) continue;
        p = parent_of(&p);
        uint32_t parent = bin_at(n, key_of(&p));
        if (parent == NO_BIN) return false;
        n->bin_split[parent] = true;
    }
    return true;
}

static bool fill_bins(neighbours *n, const vec3 *x, const double *size, error *e)
{
    while (!number_bins(n, x, size))
        if (!reserve_bins(n, 2 * n->bin_capacity, e)) return false;
    uint32_t total = 0; /* counts to ends; filling from the back turns ends into begins */
    for (size_t b = 0; b < n->bin_count; b++) n->bin_begin[b] = total += n->bin_begin[b];
    n->bin_begin[n->bin_count] = total;
    for (size_t i = n->count; i-- > 0;) n->bin_item[--n->bin_begin[n->bin_of[i]]] = (uint32_t)i;
    return true;
}

static int colour_of(uint64_t key)
{
    return (int)((key & 1) | (key >> AXIS_BITS & 1) << 1 | (key >> 2 * AXIS_BITS & 1) << 2 |
                 (key >> 3 * AXIS_BITS) << 3);
}

static bool has_points(const neighbours *n, size_t bin)
{
    return n->bin_begin[bin] < n->bin_begin[bin + 1];
}

static void sort_colours(neighbours *n)
{
    n->colours = 8 * n->levels;
    memset(n->colour_begin, 0, sizeof n->colour_begin);
    for (size_t b = 0; b < n->bin_count; b++)
        if (has_points(n, b)) n->colour_begin[colour_of(n->bin_key[b]) + 1]++;
    uint32_t next[NEIGHBOURS_COLOURS];
    for (int c = 0; c < n->colours; c++) {
        n->colour_begin[c + 1] += n->colour_begin[c];
        next[c] = n->colour_begin[c];
    }
    for (size_t b = 0; b < n->bin_count; b++)
        if (has_points(n, b)) n->colour_bin[next[colour_of(n->bin_key[b])]++] = (uint32_t)b;
}

typedef struct build_job {
    neighbours *n;
    const vec3 *x;
    const double *size;
    atomic_size_t longest;
} build_job;

/* Bins that may hold neighbours of one bin's points, handed on in batches. */
typedef struct search {
    const build_job *job;
    size_t bin;
    place at;
    uint32_t near[64];
    int near_count;
} search;

/* Lists what the batch holds; entries beyond the stride are counted, not stored. */
static void list_batch(search *s)
{
    neighbours *n = s->job->n;
    const vec3 *x = s->job->x;
    const double *size = s->job->size;
    double cutoff2 = n->cutoff * n->cutoff;
    for (uint32_t a = n->bin_begin[s->bin]; a < n->bin_begin[s->bin + 1]; a++) {
        uint32_t i = n->bin_item[a];
        uint32_t *list = n->list + i * n->stride;
        size_t count = n->list_count[i];
        for (int k = 0; k < s->near_count; k++)
            for (uint32_t b = n->bin_begin[s->near[k]]; b < n->bin_begin[s->near[k] + 1]; b++) {
                uint32_t j = n->bin_item[b];
                double mean = size ? 0.5 * (size[i] + size[j]) : 1;
                if (vec3_norm2(vec3_sub(x[i], x[j])) >= cutoff2 * (mean * mean) || j == i) continue;
                if (count < n->stride) list[count] = j;
                count++;
            }
        n->list_count[i] = (uint32_t)count;
    }
    s->near_count = 0;
}

static void add_near(search *s, uint32_t bin)
{
    if (!has_points(s->job->n, bin)) return;
    if (s->near_count == (int)(sizeof s->near / sizeof *s->near)) list_batch(s);
    s->near[s->near_count++] = bin;
}

/* The points of bins of level `up` above are neighbours no farther than the mean of the two edges. */
static void search_coarser(search *s, int up)
{
    const neighbours *n = s->job->n;
    int64_t reach = ((1 << up) + 2) / 2, low[3], high[3];
    for (int a = 0; a < 3; a++) {
        low[a] = (s->at.at[a] - reach) >> up;
        high[a] = (s->at.at[a] + reach) >> up;
    }
    place p = {.level = s->at.level + up};
    for (p.at[2] = low[2]; p.at[2] <= high[2]; p.at[2]++)
        for (p.at[1] = low[1]; p.at[1] <= high[1]; p.at[1]++)
            for (p.at[0] = low[0]; p.at[0] <= high[0]; p.at[0]++) {
                uint32_t entry = n->table[slot_of(n, key_of(&p))];
                if (entry) add_near(s, entry - 1);
            }
}

/* Likewise those of the levels below, down from a bin that has some. */
static void search_finer(search *s, uint32_t bin)
{
    const neighbours *n = s->job->n;
    place parent = place_of(n->bin_key[bin]);
    int down = s->at.level - parent.level + 1;
    int64_t reach = ((1 << down) + 2) / 2;
    for (int k = 0; k < 8; k++) {
        place p = {
            parent.level - 1,
            {2 * parent.at[0] + (k & 1), 2 * parent.at[1] + (k >> 1 & 1), 2 * parent.at[2] + (k >> 2)}};
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            int64_t low = s->at.at[a] << down, high = (s->at.at[a] + 1) << down;
            inside = inside && p.at[a] >= low - reach && p.at[a] < high + reach;
        }
        uint32_t entry = inside ? n->table[slot_of(n, key_of(&p))] : 0;
        if (!entry) continue;
        add_near(s, entry - 1);
        if (n->bin_split[entry - 1]) search_finer(s, entry - 1);
    }
}

/* The lists of one bin's points. */
static size_t list_bin(const build_job *job, size_t bin)
{
    neighbours *n = job->n;
    if (!has_points(n, bin)) return 0;
    search s = {.job = job, .bin = bin, .at = place_of(n->bin_key[bin])};
    for (uint32_t a = n->bin_begin[bin]; a < n->bin_begin[bin + 1]; a++) n->list_count[n->bin_item[a]] = 0;
    for (int k = 0; k < 27; k++) {
        place p = {s.at.level, {s.at.at[0] + k % 3 - 1, s.at.at[1] + k / 3 % 3 - 1, s.at.at[2] + k / 9 - 1}};
        uint32_t entry = n->table[slot_of(n, key_of(&p))];
        if (!entry) continue;
        add_near(&s, entry - 1);
        if (n->bin_split[entry - 1]) search_finer(&s, entry - 1);
    }
    for (int up = 1; s.at.level + up < n->levels; up++) search_coarser(&s, up);
    list_batch(&s);
    size_t longest = 0;
    for (uint32_t a = n->bin_begin[bin]; a < n->bin_begin[bin + 1]; a++) {
        uint32_t *count = &n->list_count[n->bin_item[a]];
        if (*count > longest) longest = *count;
        if (*count > n->stride) *count = (uint32_t)n->stride;
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

static bool fill_lists(neighbours *n, const vec3 *x, const double *size, threads *pool, error *e)
{
    build_job job = {n, x, size, 0};
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

bool neighbours_build(neighbours *n, size_t count, const vec3 *x, const double *size, double cutoff,
                      threads *pool, error *e)
{
    bbox box = bbox_empty();
    double least = size && count > 0 ? size[0] : 1, largest = least;
    for (size_t i = 0; i < count; i++) {
        box = bbox_include(box, x[i]);
        if (!size) continue;
        least = fmin(least, size[i]);
        largest = fmax(largest, size[i]);
    }
    n->count = count;
    n->cutoff = cutoff;
    /* a hair wider, so that rounding does not put the least size on level 1 */
    n->edge = (1 + 1e-9) * cutoff * fmax(least, ldexp(largest, 1 - NEIGHBOURS_LEVELS));
    /* one bin of margin on any level, so that the bins around one have no negative coordinate */
    double margin = cutoff * 2 * largest;
    if ((bbox_longest(box) + 2 * margin) / n->edge > (1 << AXIS_BITS) - 4)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "the support %g is too small for a surface of size %g: ask for fewer points",
                         n->edge, bbox_longest(box));
    n->origin = vec3_sub(box.min, vec3_make(margin, margin, margin));
    if (!fill_bins(n, x, size, e)) return false;
    sort_colours(n);
    return fill_lists(n, x, size, pool, e);
}
