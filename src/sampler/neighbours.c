#include "sampler/neighbours.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"
#include "geometry/bbox.h"

static const size_t GRAIN = 16; /* bins in a chunk of work */
#define AXIS_BITS 19            /* of a bin's coordinate in its key; the level stands above the three */
#define BLOCK_BIT 61            /* set in the keys of blocks */
static const int BLOCK_SHIFT =
    3; /* a block is this power of two of bins wide: what it reads fits into a core's cache */
static const int PLACE_BITS = 30; /* of a place: differences fit into 32 with room to move */
static const size_t FIRST_STRIDE = 24;
static const size_t FEWEST_BINS = 64;
/* Points on a surface share bins, some six to one; there is always room for more. */
static const size_t POINTS_PER_BIN = 4;
/* Bins are a hair wider than the cutoff of the least size, so that no rounding puts it on level 1. */
static const double BIN_HAIR = 1e-6;
enum { BATCH = 256, LANES = 16 };

/* Bins with points are no more than points; those above them rarely as many again. */
static bool reserve_bins(neighbours *n, size_t bins, error *e)
{
    const char *what = "neighbour lists";
    size_t table_size = 2 * FEWEST_BINS;
    if (bins < FEWEST_BINS) bins = FEWEST_BINS;
    while (table_size < 2 * bins) table_size *= 2;
    uint32_t *begin = mem_array(bins + 1, sizeof *begin, what, e),
             *block = mem_array(4 * bins + 1, sizeof *block, what, e),
             *table = mem_array(table_size, sizeof *table, what, e);
    uint64_t *key = mem_array(bins, sizeof *key, what, e);
    bool *split = mem_array(bins, sizeof *split, what, e);
    if (!begin || !block || !table || !key || !split) {
        free(begin);
        free(block);
        free(table);
        free(key);
        free(split);
        return false;
    }
    free(n->bin_begin);
    free(n->block_of);
    free(n->table);
    free(n->bin_key);
    free(n->bin_split);
    n->bin_begin = begin;
    n->block_of = block;
    n->block_rank = block + bins;
    n->block_bin = block + 2 * bins;
    n->block_begin = block + 3 * bins;
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
    const char *what = "neighbour lists";
    if (!reserve_bins(n, capacity / POINTS_PER_BIN, e) ||
        !(n->place = mem_array(capacity, sizeof *n->place, what, e)) ||
        !(n->bin_item = mem_array(capacity, sizeof *n->bin_item, what, e)) ||
        !(n->bin_of = mem_array(capacity, sizeof *n->bin_of, what, e)) ||
        !(n->list = mem_array(n->list_room = capacity * FIRST_STRIDE, sizeof *n->list, what, e)) ||
        !(n->list_count = mem_array(capacity, sizeof *n->list_count, what, e))) {
        neighbours_free(n);
        return NULL;
    }
    return n;
}

void neighbours_free(neighbours *n)
{
    if (!n) return;
    free(n->place);
    free(n->bin_begin);
    free(n->bin_item);
    free(n->bin_key);
    free(n->bin_split);
    free(n->bin_of);
    free(n->table);
    free(n->block_of);
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

static place place_at(const neighbours *n, const neighbours_place *p, int level)
{
    double scale = n->unit / n->edge;
    return (place){level,
                   {(int64_t)(p->x * scale) >> level, (int64_t)(p->y * scale) >> level,
                    (int64_t)(p->z * scale) >> level}};
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

/* Blocks take their numbers after all bins. */
static bool number_blocks(neighbours *n)
{
    size_t bins = n->bin_count;
    uint64_t key = UINT64_MAX;
    uint32_t block = NO_BIN;
    for (size_t b = 0; b < bins; b++) {
        if (n->bin_begin[b] == 0) continue;
        place p = place_of(n->bin_key[b]);
        for (int a = 0; a < 3; a++) p.at[a] >>= BLOCK_SHIFT;
        uint64_t k = key_of(&p) | (uint64_t)1 << BLOCK_BIT;
        if (k != key) block = bin_at(n, key = k);
        if (block == NO_BIN) return false;
        n->block_of[b] = block - (uint32_t)bins;
    }
    n->blocks = n->bin_count - bins;
    n->bin_count = bins;
    return true;
}

/* Bins are numbered as points first fall into them, so their order follows that of the points; then come
 * those that have only bins below them. False when there are more than there is room for. */
static bool number_bins(neighbours *n)
{
    memset(n->table, 0, n->table_size * sizeof *n->table);
    n->bin_count = 0;
    n->levels = 1;
    uint64_t key = UINT64_MAX; /* of the point before: in the same bin, more often than not */
    uint32_t bin = NO_BIN;
    for (size_t i = 0; i < n->count; i++) {
        place p = place_at(n, &n->place[i], level_of(n, n->place[i].size));
        if (p.level >= n->levels) n->levels = p.level + 1;
        if (key_of(&p) != key) bin = bin_at(n, key = key_of(&p));
        if (bin == NO_BIN) return false;
        n->bin_of[i] = bin;
        n->bin_begin[bin]++;
    }
    for (size_t b = 0; b < n->bin_count; b++) {
        place p = place_of(n->bin_key[b]);
        if (p.level == n->levels - 1) continue;
        p = parent_of(&p);
        uint32_t parent = bin_at(n, key_of(&p));
        if (parent == NO_BIN) return false;
        n->bin_split[parent] = true;
    }
    return number_blocks(n);
}

static bool fill_bins(neighbours *n, error *e)
{
    while (!number_bins(n))
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
                 (key >> 3 * AXIS_BITS & (NEIGHBOURS_LEVELS - 1)) << 3);
}

static inline bool has_points(const neighbours *n, size_t bin)
{
    return n->bin_begin[bin] < n->bin_begin[bin + 1];
}

/* Puts the blocks in the order of their colours, and the bins in that of their blocks. */
static void sort_blocks(neighbours *n)
{
    n->colours = 8 * n->levels;
    memset(n->colour_begin, 0, sizeof n->colour_begin);
    for (size_t k = 0; k < n->blocks; k++) n->colour_begin[colour_of(n->bin_key[n->bin_count + k]) + 1]++;
    uint32_t next[NEIGHBOURS_COLOURS];
    for (int c = 0; c < n->colours; c++) {
        n->colour_begin[c + 1] += n->colour_begin[c];
        next[c] = n->colour_begin[c];
    }
    for (size_t k = 0; k < n->blocks; k++) n->block_rank[k] = next[colour_of(n->bin_key[n->bin_count + k])]++;
    memset(n->block_begin, 0, (n->blocks + 1) * sizeof *n->block_begin);
    for (size_t b = 0; b < n->bin_count; b++)
        if (has_points(n, b)) n->block_begin[n->block_rank[n->block_of[b]]]++;
    uint32_t total = 0; /* counts to ends; filling from the back turns ends into begins */
    for (size_t k = 0; k < n->blocks; k++) n->block_begin[k] = total += n->block_begin[k];
    n->block_begin[n->blocks] = total;
    for (size_t b = n->bin_count; b-- > 0;)
        if (has_points(n, b)) n->block_bin[--n->block_begin[n->block_rank[n->block_of[b]]]] = (uint32_t)b;
}

typedef struct build_job {
    neighbours *n;
    const vec3 *x;
    const double *size;
    atomic_size_t longest;
} build_job;

/* Points that may be neighbours of one bin's points, handed on in batches: arrays for the vector unit. */
typedef struct search {
    neighbours *n;
    size_t bin;
    place at;
    size_t count;
    int32_t x[BATCH], y[BATCH], z[BATCH];
    float size[BATCH];
    uint32_t item[BATCH];
} search;

/* Which of a batch are neighbours of point i; returns how many. */
ISA_CLONES static size_t find_in_batch(const search *s, uint32_t i, float cutoff2, uint32_t *found)
{
    const neighbours_place own = s->n->place[i];
    size_t count = 0;
    for (size_t b = 0; b < s->count; b += LANES) {
        uint32_t hit[LANES];
        for (int l = 0; l < LANES; l++) {
            float x = (float)(s->x[b + l] - own.x), y = (float)(s->y[b + l] - own.y),
                  z = (float)(s->z[b + l] - own.z), mean = 0.5f * (s->size[b + l] + own.size);
            hit[l] = (x * x + y * y + z * z < cutoff2 * (mean * mean)) & (s->item[b + l] != i);
        }
        for (int l = 0; l < LANES; l++) {
            found[count] = s->item[b + l];
            count += hit[l];
        }
    }
    return count;
}

/* Lists what the batch holds; entries beyond the stride are counted, not stored. */
static void list_batch(search *s)
{
    neighbours *n = s->n;
    const double cutoff = n->cutoff / n->unit;
    uint32_t found[BATCH + LANES];
    for (; s->count % LANES; s->count++) { /* nobody's neighbours */
        s->x[s->count] = s->y[s->count] = s->z[s->count] = 0;
        s->item[s->count] = NO_BIN;
        s->size[s->count] = NAN;
    }
    for (uint32_t a = n->bin_begin[s->bin]; a < n->bin_begin[s->bin + 1]; a++) {
        uint32_t i = n->bin_item[a], *list = n->list + i * n->stride;
        size_t count = n->list_count[i], more = find_in_batch(s, i, (float)(cutoff * cutoff), found);
        size_t room = count < n->stride ? n->stride - count : 0;
        memcpy(list + (room ? count : 0), found, (more < room ? more : room) * sizeof *list);
        n->list_count[i] = (uint32_t)(count + more);
    }
    s->count = 0;
}

static void add_near(search *s, uint32_t bin)
{
    const neighbours *n = s->n;
    for (uint32_t b = n->bin_begin[bin]; b < n->bin_begin[bin + 1]; b++) {
        if (s->count == BATCH) list_batch(s);
        const neighbours_place *p = &n->place[n->bin_item[b]];
        s->x[s->count] = p->x;
        s->y[s->count] = p->y;
        s->z[s->count] = p->z;
        s->size[s->count] = p->size;
        s->item[s->count++] = n->bin_item[b];
    }
}

/* The points of bins of level `up` above are neighbours no farther than the mean of the two edges. */
static void search_coarser(search *s, int up)
{
    const neighbours *n = s->n;
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
    const neighbours *n = s->n;
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
    search s;
    s.n = n;
    s.bin = bin;
    s.at = place_of(n->bin_key[bin]);
    s.count = 0;
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

/* Room for the lists of all points; what the old ones hold is lost. */
static bool reserve_lists(neighbours *n, size_t longest, error *e)
{
    size_t room = n->count * n->stride;
    if (room <= n->list_room) return true;
    if ((double)room * sizeof *n->list > (double)n->list_limit)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "within %g of a point there are up to %zu others: lists of that take %.0f MB, %.0f are "
            "left: lower solver.sigma, or raise limits.memory_mb",
            n->cutoff, longest, (double)room * sizeof *n->list / (1 << 20),
            (double)n->list_limit / (1 << 20));
    uint32_t *list = mem_array(room, sizeof *list, "neighbour lists", e);
    if (!list) return false;
    free(n->list);
    n->list = list;
    n->list_room = room;
    return true;
}

static bool fill_lists(neighbours *n, threads *pool, error *e)
{
    build_job job = {.n = n};
    threads_run(pool, n->bin_count, GRAIN, list_chunk, &job);
    size_t longest = atomic_load(&job.longest);
    if (longest <= n->stride) return true;
    n->stride = (longest + longest / 4 + 7) / 8 * 8;
    if (!reserve_lists(n, longest, e)) return false;
    threads_run(pool, n->bin_count, GRAIN, list_chunk, &job);
    return true;
}

static void place_chunk(void *context, int worker, size_t begin, size_t end)
{
    const build_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        neighbours_move(job->n, i, job->x[i]);
        job->n->place[i].size = job->size ? (float)job->size[i] : 1;
    }
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
    if (count != n->count) n->stride = FIRST_STRIDE; /* a level's crowds say nothing about another */
    n->count = count;
    n->cutoff = cutoff;
    n->edge = (1 + BIN_HAIR) * cutoff * fmax(least, ldexp(largest, 1 - NEIGHBOURS_LEVELS));
    /* one bin of margin on any level, so that the bins around one have no negative coordinate */
    double margin = cutoff * 2 * largest, span = bbox_longest(box) + 2 * margin;
    if (span / n->edge > (1 << AXIS_BITS) - 4)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "the support %g is too small for a surface of size %g: ask for fewer points",
                         n->edge, bbox_longest(box));
    n->origin = vec3_sub(box.min, vec3_make(margin, margin, margin));
    n->unit = ldexp(span, -PLACE_BITS);
    n->per_unit = 1 / n->unit;
    build_job job = {.n = n, .x = x, .size = size};
    threads_run(pool, count, 4096, place_chunk, &job);
    if (!fill_bins(n, e)) return false;
    sort_blocks(n);
    return fill_lists(n, pool, e);
}
