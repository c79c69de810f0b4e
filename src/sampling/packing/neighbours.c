// SPDX-License-Identifier: Apache-2.0
#include "sampling/packing/neighbours.h"

#include <assert.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

#include "base/core/compare.h"
#include "base/core/isa.h"
#include "base/core/memory.h"
#include "geometry/space/bbox.h"
#include "sampling/packing/neighbour_bins.h"

static const int PLACE_BITS = 30; /* bits of a coordinate: differences fit into 32 bits, with a margin for
                                   * moving points */
/* Expected mean length of a list; an even packing with the widest skin has 19. Sorting into bins needs two
 * entries per point. */
static const size_t FIRST_ENTRIES = 20;
/* Bins are slightly wider than the cutoff of the largest size of their level, so that rounding cannot move a
 * point to the next level. */
static const double BIN_HAIR = 1e-6;
enum { LANES = 16 };
enum { CHUNK = 4096 }; /* points in a chunk of work */
/* Points of a bin from which on its candidates are sorted by label, so that a point is compared only with points of its label.
 * Bins on a surface have about 10 points; the sort then takes longer than the comparisons that it saves. */
enum { MANY_POINTS = 256 };
/* A block with its adjacent bins: number of cells along each axis, and in total. */
enum { WIDE_BLOCK = BLOCK_WIDTH + 2, WIDE_CELLS = WIDE_BLOCK * WIDE_BLOCK * WIDE_BLOCK };

neighbours *neighbours_new(size_t capacity, size_t list_limit, error *e)
{
    neighbours *n = mem_alloc(sizeof *n);
    n->capacity = capacity;
    n->list_limit = list_limit;
    const char *what = "neighbour lists";
    if (!neighbour_bins_reserve(n, capacity, e) ||
        !(n->place = mem_array(capacity, sizeof *n->place, what, e)) ||
        !(n->bin_item = mem_array(capacity, sizeof *n->bin_item, what, e)) ||
        !(n->list = mem_array(n->list_capacity = capacity * FIRST_ENTRIES, sizeof *n->list, what, e)) ||
        !(n->list_begin = mem_array(capacity, sizeof *n->list_begin, what, e)) ||
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
    for (int axis = 0; axis < 3; axis++) free(n->gap[axis]);
    free(n->bin_begin);
    free(n->bin_item);
    free(n->bin_cell);
    free(n->table);
    free(n->block_key);
    free(n->block_first);
    free(n->block_size);
    free(n->block_begin);
    free(n->cell);
    free(n->list);
    free(n->list_begin);
    free(n->list_count);
    free(n);
}

/* Points as separate arrays, for SIMD. */
typedef struct candidates {
    size_t count, capacity;
    int32_t *x, *y, *z;
    float *size;
    uint32_t *item, *label;
} candidates;

/* Finds the candidates that are neighbours of point i; with labels, those that have its label. Returns their
 * number. */
typedef size_t (*finder)(const candidates *s, neighbours_place own, uint32_t i, uint32_t label, float cutoff2,
                         uint32_t *found);

/* The cells of a block, and the number of its first bin. */
typedef struct block_cells {
    const uint16_t *cell;
    uint32_t first;
} block_cells;

/* The points of a label in `by_label`, in whole vectors. */
typedef struct label_range {
    uint32_t label;
    size_t begin, count;
} label_range;

/* Working memory of one worker; aligned so that two workers share no cache line. */
typedef struct list_search {
    _Alignas(64) neighbours *n;
    block_cells around[27]; /* cells of the 27 blocks around the current bin; its own block is in the
                             * middle */
    struct {
        uint64_t key;
        block_cells cells;
    } last[NEIGHBOURS_LEVELS]; /* per level: the block of the last lookup */
    place at;                  /* current bin */
    candidates near;           /* points that may be neighbours of the points of the current bin */
    candidates
        all; /* if all bins have one level: the points of the block and of the adjacent bins, cell after
              * cell */
    uint32_t cell_begin[WIDE_CELLS + 1]; /* ranges of the cells in `all` */
    candidates by_label; /* the points of `near`, sorted by label; each label begins a vector */
    label_range *range;  /* per label of `by_label`, ascending */
    size_t ranges, range_capacity;
    uint32_t *number; /* scratch memory of the sort */
    size_t number_capacity;
    size_t entries, entry_capacity; /* lists of the block, one after the other */
    uint32_t *entry;
} list_search;

typedef struct build_job {
    neighbours *n;
    const vec3 *x;
    const double *size;
    finder find;
    list_search *searches;                       /* one per worker */
    _Alignas(64) atomic_size_t longest, entries; /* written by all workers */
} build_job;

/* Appends the items whose `hit` is set. Returns the new count. */
ISA_INLINE size_t pack(const uint32_t hit[LANES], const uint32_t *item, size_t count, uint32_t *found)
{
    for (int l = 0; l < LANES; l++) {
        found[count] = item[l];
        count += hit[l];
    }
    return count;
}

#ifdef __x86_64__
/* For each 4-bit mask: the indices of its set bits, first. */
static const int32_t packed[16][4] = {{0, 0, 0, 0}, {0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0},
                                      {2, 0, 0, 0}, {0, 2, 0, 0}, {1, 2, 0, 0}, {0, 1, 2, 0},
                                      {3, 0, 0, 0}, {0, 3, 0, 0}, {1, 3, 0, 0}, {0, 1, 3, 0},
                                      {2, 3, 0, 0}, {0, 2, 3, 0}, {1, 2, 3, 0}, {0, 1, 2, 3}};

ISA_TARGET_AVX2 static inline size_t pack_avx2(const uint32_t hit[LANES], const uint32_t *item, size_t count,
                                               uint32_t *found)
{
    for (int l = 0; l < LANES; l += 4) {
        const __m128i hits = _mm_slli_epi32(_mm_loadu_si128((const __m128i *)(hit + l)), 31);
        const int mask = _mm_movemask_ps(_mm_castsi128_ps(hits));
        const __m128 items = _mm_loadu_ps((const float *)(item + l));
        _mm_storeu_ps((float *)(found + count),
                      _mm_permutevar_ps(items, _mm_loadu_si128((const __m128i *)packed[mask])));
        count += (size_t)__builtin_popcount((unsigned)mask);
    }
    return count;
}

/* Uses the compress instruction, which compilers do not generate from the code above. */
ISA_TARGET_AVX512 static inline size_t pack_avx512(const uint32_t hit[LANES], const uint32_t *item,
                                                   size_t count, uint32_t *found)
{
    __m512i hits = _mm512_loadu_si512(hit);
    __mmask16 mask = _mm512_test_epi32_mask(hits, hits);
    _mm512_storeu_si512(found + count, _mm512_maskz_compress_epi32(mask, _mm512_loadu_si512(item)));
    return count + (size_t)__builtin_popcount(mask);
}
#else
#define pack_avx2 pack
#define pack_avx512 pack
#endif

#define VERSION(name, target, pack, with_labels)                                                     \
    target static size_t name(const candidates *s, neighbours_place own, uint32_t i, uint32_t label, \
                              float cutoff2, uint32_t *found)                                        \
    {                                                                                                \
        size_t count = 0;                                                                            \
        (void)label;                                                                                 \
        for (size_t b = 0; b < s->count; b += LANES) {                                               \
            uint32_t hit[LANES], any = 0;                                                            \
            for (int l = 0; l < LANES; l++) {                                                        \
                float x = (float)(s->x[b + l] - own.x), y = (float)(s->y[b + l] - own.y),            \
                      z = (float)(s->z[b + l] - own.z), mean = 0.5f * (s->size[b + l] + own.size);   \
                hit[l] = (x * x + y * y + z * z < cutoff2 * (mean * mean)) & (s->item[b + l] != i);  \
                if (with_labels) hit[l] &= s->label[b + l] == label;                                 \
                any |= hit[l];                                                                       \
            }                                                                                        \
            if (with_labels && !any) continue;                                                       \
            count = pack(hit, s->item + b, count, found);                                            \
        }                                                                                            \
        return count;                                                                                \
    }
VERSION(find_portable, , pack, false)
VERSION(find_avx2, ISA_TARGET_AVX2, pack_avx2, false)
VERSION(find_avx512, ISA_TARGET_AVX512, pack_avx512, false)
VERSION(find_labelled_portable, , pack, true)
VERSION(find_labelled_avx2, ISA_TARGET_AVX2, pack_avx2, true)
VERSION(find_labelled_avx512, ISA_TARGET_AVX512, pack_avx512, true)

static finder best_finder(bool with_labels)
{
    static const finder versions[ISA_COUNT][2] = {{find_portable, find_labelled_portable},
                                                  {find_avx2, find_labelled_avx2},
                                                  {find_avx512, find_labelled_avx512}};
    return versions[isa_best()][with_labels];
}

/* Makes room for `more` candidates, rounded up to whole vectors. */
static void reserve_candidates(candidates *c, size_t more)
{
    if (c->count + more + LANES <= c->capacity) return;
    c->capacity = 2 * (c->count + more + LANES);
    c->x = mem_resize(c->x, c->capacity * sizeof *c->x);
    c->y = mem_resize(c->y, c->capacity * sizeof *c->y);
    c->z = mem_resize(c->z, c->capacity * sizeof *c->z);
    c->size = mem_resize(c->size, c->capacity * sizeof *c->size);
    c->item = mem_resize(c->item, c->capacity * sizeof *c->item);
    c->label = mem_resize(c->label, c->capacity * sizeof *c->label);
}

static void free_candidates(candidates *c)
{
    free(c->x);
    free(c->y);
    free(c->z);
    free(c->size);
    free(c->item);
    free(c->label);
}

/* Appends the points of a cell's bin, if it has one. */
static void add_bin(const neighbours *n, candidates *c, const block_cells *block, uint32_t cell)
{
    const uint32_t number = block->cell[cell] & CELL_BIN;
    if (!number) return;
    const uint32_t bin = block->first + number - 1, end = n->bin_begin[bin + 1];
    reserve_candidates(c, end - n->bin_begin[bin]);
    for (uint32_t b = n->bin_begin[bin]; b < end; b++) {
        const neighbours_place *p = &n->place[n->bin_item[b]];
        c->x[c->count] = p->x;
        c->y[c->count] = p->y;
        c->z[c->count] = p->z;
        c->size[c->count] = p->size;
        if (n->label) c->label[c->count] = n->label[n->bin_item[b]];
        c->item[c->count++] = n->bin_item[b];
    }
}

/* Appends the points `begin` .. `end` of `from`, in whole vectors. */
ISA_CLONES static void add_range(const candidates *from, size_t begin, size_t end, bool with_labels,
                                 candidates *to)
{
    for (size_t b = begin; b < end; b += LANES) {
        const size_t at = to->count + b - begin;
        memcpy(to->x + at, from->x + b, LANES * sizeof *to->x);
        memcpy(to->y + at, from->y + b, LANES * sizeof *to->y);
        memcpy(to->z + at, from->z + b, LANES * sizeof *to->z);
        memcpy(to->size + at, from->size + b, LANES * sizeof *to->size);
        memcpy(to->item + at, from->item + b, LANES * sizeof *to->item);
        if (with_labels) memcpy(to->label + at, from->label + b, LANES * sizeof *to->label);
    }
    to->count += end - begin;
}

/* The cells of a block; without bins if the block does not exist. */
static block_cells find_cells(const neighbours *n, uint64_t key)
{
    static const uint16_t none[BLOCK_CELLS];
    const uint32_t block = n->table[slot_of(n, key)];
    return block ? (block_cells){n->cell + (block - 1) * (size_t)BLOCK_CELLS, n->block_first[block - 1]}
                 : (block_cells){none, 0};
}

/* As find_cells, for a bin of another level than the current one, with a cache of the last block. */
static const block_cells *cells_of(list_search *s, const place *bin)
{
    place block = block_of(bin);
    uint64_t key = key_of(&block);
    if (s->last[bin->level].key != key) {
        s->last[bin->level].key = key;
        s->last[bin->level].cells = find_cells(s->n, key);
    }
    return &s->last[bin->level].cells;
}

/* Appends the points of coarser bins, `up` levels above. Their distance from neighbours is at most the mean
 * of the two edges. */
static void search_coarser(list_search *s, int up)
{
    int64_t reach = ((1 << up) + 2) / 2, low[3], high[3];
    for (int a = 0; a < 3; a++) {
        low[a] = (s->at.at[a] - reach) >> up;
        high[a] = (s->at.at[a] + reach) >> up;
    }
    place p = {.level = s->at.level + up};
    for (p.at[2] = low[2]; p.at[2] <= high[2]; p.at[2]++)
        for (p.at[1] = low[1]; p.at[1] <= high[1]; p.at[1]++)
            for (p.at[0] = low[0]; p.at[0] <= high[0]; p.at[0]++)
                add_bin(s->n, &s->near, cells_of(s, &p), cell_of(&p));
}

static void search_finer(list_search *s, const place *parent);

/* Appends the points of a cell's bin and of the finer bins in it. */
static void search_cell(list_search *s, const block_cells *block, const place *bin)
{
    const uint32_t cell = cell_of(bin);
    add_bin(s->n, &s->near, block, cell);
    if (block->cell[cell] & CELL_SPLIT) search_finer(s, bin);
}

/* Appends the points of the finer bins in a bin that is split. */
static void search_finer(list_search *s, const place *parent)
{
    int down = s->at.level - parent->level + 1;
    int64_t reach = ((1 << down) + 2) / 2;
    for (int k = 0; k < 8; k++) {
        place p = {
            parent->level - 1,
            {2 * parent->at[0] + (k & 1), 2 * parent->at[1] + (k >> 1 & 1), 2 * parent->at[2] + (k >> 2)}};
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            int64_t low = s->at.at[a] << down, high = (s->at.at[a] + 1) << down;
            inside = inside && p.at[a] >= low - reach && p.at[a] < high + reach;
        }
        if (inside) search_cell(s, cells_of(s, &p), &p);
    }
}

/* Appends the points of the bins around the current bin, of its own level. */
static void search_level(list_search *s)
{
    int low[3]; /* lowest of these bins, relative to the lowest of the blocks around */
    for (int a = 0; a < 3; a++) low[a] = (int)(s->at.at[a] & (BLOCK_WIDTH - 1)) + BLOCK_WIDTH - 1;
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++) {
                const place p = {s->at.level,
                                 {s->at.at[0] + i - 1, s->at.at[1] + j - 1, s->at.at[2] + k - 1}};
                const int z = (low[2] + k) >> BLOCK_SHIFT, y = (low[1] + j) >> BLOCK_SHIFT;
                search_cell(s, &s->around[(z * 3 + y) * 3 + ((low[0] + i) >> BLOCK_SHIFT)], &p);
            }
}

/* Gathers the points of a block and of the adjacent bins, if all bins have one level. Each bin is looked up
 * once, and the points of successive bins are contiguous. */
static void gather_block(list_search *s)
{
    /* positions are relative to the lowest of the blocks around */
    const int mask = BLOCK_WIDTH - 1, end = 2 * BLOCK_WIDTH + 1;
    uint32_t *begin = s->cell_begin;
    s->all.count = 0;
    for (int z = mask; z < end; z++)
        for (int y = mask; y < end; y++) {
            const block_cells *along = &s->around[((z >> BLOCK_SHIFT) * 3 + (y >> BLOCK_SHIFT)) * 3];
            const int row = ((z & mask) << BLOCK_SHIFT | (y & mask)) << BLOCK_SHIFT;
            for (int x = mask; x < end; x++) {
                const block_cells *block = &along[x >> BLOCK_SHIFT];
                *begin++ = (uint32_t)s->all.count;
                if (block->cell[row | (x & mask)])
                    add_bin(s->n, &s->all, block, (uint32_t)(row | (x & mask)));
            }
        }
    *begin = (uint32_t)s->all.count;
    reserve_candidates(&s->all, 0);
}

/* Appends the gathered points of the bins around the current bin, in the order of search_level. */
static void search_gathered(list_search *s)
{
    const int mask = BLOCK_WIDTH - 1;
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++) {
            const int z = (int)(s->at.at[2] & mask) + k, y = (int)(s->at.at[1] & mask) + j;
            const uint32_t *row = s->cell_begin + (z * WIDE_BLOCK + y) * WIDE_BLOCK + (s->at.at[0] & mask);
            reserve_candidates(&s->near, row[3] - row[0] + LANES);
            add_range(&s->all, row[0], row[3], s->n->label, &s->near);
        }
}

/* Fills the last vector with points that are never neighbours. */
static void fill_vector(candidates *c)
{
    for (; c->count % LANES; c->count++) {
        c->x[c->count] = c->y[c->count] = c->z[c->count] = 0;
        c->item[c->count] = UINT32_MAX;
        c->label[c->count] = 0;
        c->size[c->count] = NAN;
    }
}

/* Sorts the numbers of the candidates by label, stably, digit by digit. Returns the sorted numbers. */
static const uint32_t *sorted_numbers(list_search *s)
{
    enum { BITS = 8, DIGITS = 1 << BITS };
    const candidates *c = &s->near;
    if (2 * c->count > s->number_capacity) {
        s->number_capacity = 4 * c->count;
        s->number = mem_resize(s->number, s->number_capacity * sizeof *s->number);
    }
    uint32_t *from = s->number, *to = from + c->count, used = 0;
    for (size_t k = 0; k < c->count; k++) {
        from[k] = (uint32_t)k;
        used |= c->label[k];
    }
    for (int shift = 0; shift < 32 && used >> shift; shift += BITS) {
        size_t begin[DIGITS + 1] = {0};
        for (size_t k = 0; k < c->count; k++) begin[(c->label[k] >> shift) % DIGITS + 1]++;
        for (int d = 0; d < DIGITS; d++) begin[d + 1] += begin[d];
        for (size_t k = 0; k < c->count; k++) to[begin[(c->label[from[k]] >> shift) % DIGITS]++] = from[k];
        uint32_t *swap = from;
        from = to;
        to = swap;
    }
    return from;
}

static void begin_range(list_search *s, uint32_t label)
{
    if (s->ranges == s->range_capacity) {
        s->range_capacity = 2 * s->range_capacity + LANES;
        s->range = mem_resize(s->range, s->range_capacity * sizeof *s->range);
    }
    s->range[s->ranges++] = (label_range){label, s->by_label.count, 0};
}

/* Sorts the candidates by label into `by_label`. Points of one label keep their order. */
static void sort_by_label(list_search *s)
{
    const candidates *from = &s->near;
    candidates *to = &s->by_label;
    const uint32_t *number = sorted_numbers(s);
    to->count = s->ranges = 0;
    for (size_t k = 0; k < from->count; k++) {
        const size_t b = number[k];
        if (k == 0 || from->label[b] != from->label[number[k - 1]]) {
            fill_vector(to);
            begin_range(s, from->label[b]);
        }
        reserve_candidates(to, 1);
        to->x[to->count] = from->x[b];
        to->y[to->count] = from->y[b];
        to->z[to->count] = from->z[b];
        to->size[to->count] = from->size[b];
        to->label[to->count] = from->label[b];
        to->item[to->count++] = from->item[b];
        label_range *own = &s->range[s->ranges - 1];
        own->count = to->count - own->begin;
    }
    reserve_candidates(to, 0);
    fill_vector(to);
}

/* The candidates of a label, which has at least one, in whole vectors. */
static candidates candidates_of(const list_search *s, uint32_t label)
{
    size_t low = 0, high = s->ranges;
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (s->range[middle].label <= label)
            low = middle;
        else
            high = middle;
    }
    const candidates *c = &s->by_label;
    const size_t at = s->range[low].begin;
    return (candidates){.count = (s->range[low].count + LANES - 1) / LANES * LANES,
                        .x = c->x + at,
                        .y = c->y + at,
                        .z = c->z + at,
                        .size = c->size + at,
                        .item = c->item + at,
                        .label = c->label + at};
}

/* Makes the lists of the points of the current bin; positions are relative to the lists of the block.
 * Entries that do not fit are counted, but not stored. */
static size_t list_bin(list_search *s, finder find, size_t bin)
{
    neighbours *n = s->n;
    const double cutoff = n->cutoff / n->unit;
    candidates *c = &s->near;
    c->count = 0;
    if (n->levels == 1)
        search_gathered(s);
    else
        search_level(s);
    for (int up = 1; s->at.level + up < n->levels; up++) search_coarser(s, up);
    const bool sorted = n->label && n->bin_begin[bin + 1] - n->bin_begin[bin] >= MANY_POINTS;
    if (sorted) sort_by_label(s);
    fill_vector(c);
    size_t longest = 0;
    for (uint32_t a = n->bin_begin[bin]; a < n->bin_begin[bin + 1]; a++) {
        uint32_t i = n->bin_item[a];
        size_t begin = s->entries <= n->list_capacity ? s->entries : 0;
        const uint32_t label = n->label ? n->label[i] : 0;
        const candidates own = sorted ? candidates_of(s, label) : *c;
        if (begin + own.count + LANES > s->entry_capacity) {
            s->entry_capacity = 2 * (begin + own.count + LANES);
            s->entry = mem_resize(s->entry, s->entry_capacity * sizeof *s->entry);
        }
        size_t count = find(&own, n->place[i], i, label, (float)(cutoff * cutoff), s->entry + begin);
        n->list_begin[i] = (uint32_t)begin;
        n->list_count[i] = (uint32_t)count;
        s->entries += count;
        longest = count > longest ? count : longest;
    }
    return longest;
}

/* Stores the lists of a block. Their position in `list` depends on the threads, but their contents do not. */
static void keep_lists(build_job *job, const list_search *s, uint32_t first, uint32_t last)
{
    neighbours *n = job->n;
    size_t begin = atomic_fetch_add(&job->entries, s->entries);
    if (begin + s->entries > n->list_capacity) return;
    memcpy(n->list + begin, s->entry, s->entries * sizeof *n->list);
    for (uint32_t a = n->bin_begin[first]; a < n->bin_begin[last]; a++)
        n->list_begin[n->bin_item[a]] += (uint32_t)begin;
}

/* Makes the lists of a block's points. */
static size_t list_block(build_job *job, list_search *s, size_t block)
{
    neighbours *n = s->n = job->n;
    const uint32_t begin = n->block_first[block], end = begin + n->block_size[block];
    size_t longest = 0;
    if (n->bin_begin[begin] == n->bin_begin[end]) return 0;
    for (int l = 0; l < n->levels; l++) s->last[l].key = NO_KEY;
    const place own = place_of_block(n->block_key[block]);
    for (int k = 0; k < 27; k++) {
        place p = {own.level, {own.at[0] + k % 3 - 1, own.at[1] + k / 3 % 3 - 1, own.at[2] + k / 9 - 1}};
        s->around[k] = find_cells(n, key_of(&p));
    }
    if (n->levels == 1) gather_block(s);
    s->entries = 0;
    for (uint32_t bin = begin; bin < end; bin++) {
        /* all points of this bin are in finer bins */
        if (n->bin_begin[bin] == n->bin_begin[bin + 1]) continue;
        s->at = place_of_bin(&own, n->bin_cell[bin]);
        size_t l = list_bin(s, job->find, bin);
        if (l > longest) longest = l;
    }
    keep_lists(job, s, begin, end);
    return longest;
}

/* Processes blocks in memory order: consecutive blocks use the same adjacent points. */
static void list_chunk(void *context, int worker, size_t begin, size_t end)
{
    build_job *job = context;
    size_t longest = 0;
    for (size_t block = begin; block < end; block++) {
        size_t l = list_block(job, &job->searches[worker], block);
        if (l > longest) longest = l;
    }
    size_t seen = atomic_load(&job->longest);
    while (longest > seen && !atomic_compare_exchange_weak(&job->longest, &seen, longest)) continue;
}

/* Allocates lists for `entries` entries; their previous content is discarded. */
static bool reserve_lists(neighbours *n, size_t entries, error *e)
{
    double bytes = (double)entries * sizeof *n->list;
    if (bytes > (double)n->list_limit || entries > UINT32_MAX)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "within %g of a point there are up to %zu others: lists of that take %.0f MiB, %.0f are "
            "left: lower solver.sigma, or raise limits.memory_mb",
            n->cutoff, n->longest, bytes / (1 << 20), (double)n->list_limit / (1 << 20));
    uint32_t *list = mem_array(entries, sizeof *list, "neighbour lists", e);
    if (!list) return false;
    free(n->list);
    n->list = list;
    n->list_capacity = entries;
    return true;
}

#ifdef __SANITIZE_ADDRESS__
/* Checks that lists are valid. Only in the sanitized build, since it is slow. */
static void check_lists(const neighbours *n)
{
    for (size_t i = 0; i < n->count; i++) {
        assert(n->list_count[i] <= n->longest);
        const uint32_t *list = neighbours_list(n, i);
        for (uint32_t k = 0; k < n->list_count[i]; k++) assert(list[k] < n->count && list[k] != i);
    }
}
#else
#define check_lists(n) (void)(n)
#endif

static bool fill_lists(neighbours *n, threads *pool, error *e)
{
    size_t workers = (size_t)threads_count(pool);
    build_job job = {.n = n, .find = best_finder(n->label)};
    if (!(job.searches = mem_array(workers, sizeof *job.searches, "neighbour lists", e))) return false;
    threads_run(pool, n->blocks, 1, list_chunk, &job);
    n->longest = atomic_load(&job.longest);
    size_t entries = atomic_load(&job.entries);
    bool ok = true;
    if (entries + n->longest > n->list_capacity) {
        ok = reserve_lists(n, entries + entries / 8 + n->longest, e);
        atomic_store(&job.entries, 0);
        if (ok) threads_run(pool, n->blocks, 1, list_chunk, &job);
    }
    if (ok) {
        assert(entries + n->longest <= n->list_capacity);
        memset(n->list + entries, 0, n->longest * sizeof *n->list);
    }
    if (ok && threads_stopped(pool))
        ok = error_set(e, ERROR_CANCELLED, "stopped"); /* incomplete lists are not used */
    if (ok) check_lists(n);
    for (list_search *s = job.searches; s < job.searches + workers; s++) {
        free_candidates(&s->near);
        free_candidates(&s->all);
        free_candidates(&s->by_label);
        free(s->range);
        free(s->number);
        free(s->entry);
    }
    free(job.searches);
    return ok;
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

/* ---- gaps */

/* Number of bins along an axis from which on gaps are narrowed. */
static const double many_bins = 1 << 14;

vec3 neighbours_narrowed(const neighbours *n, vec3 x)
{
    double at[3] = {x.x, x.y, x.z};
    for (int axis = 0; axis < 3; axis++) {
        const neighbours_gap *gap = n->gap[axis];
        size_t low = 0, high = n->gaps[axis]; /* gaps before `low` begin at or below the coordinate */
        while (low < high) {
            const size_t middle = (low + high) / 2;
            if (gap[middle].from <= at[axis])
                low = middle + 1;
            else
                high = middle;
        }
        if (low > 0) at[axis] -= gap[low - 1].cut;
    }
    return vec3_make(at[0], at[1], at[2]);
}

/* Finds the ranges along an axis that are wider than two margins and have no points; each keeps this width, with the point
 * from which on coordinates are reduced in its middle. */
static bool find_gaps(neighbours *n, int axis, const vec3 *x, double margin, double *scratch, error *e)
{
    size_t room = 0;
    double cut = 0;
    n->gaps[axis] = 0;
    free(n->gap[axis]);
    n->gap[axis] = NULL;
    for (size_t i = 0; i < n->count; i++) scratch[i] = vec3_get(x[i], axis);
    qsort(scratch, n->count, sizeof *scratch, compare_doubles);
    for (size_t i = 1; i < n->count; i++) {
        const double width = scratch[i] - scratch[i - 1];
        if (width <= 2 * margin) continue;
        if (!MEM_GROW(n->gap[axis], n->gaps[axis], &room, "neighbour lists", e)) return false;
        cut += width - 2 * margin;
        n->gap[axis][n->gaps[axis]++] = (neighbours_gap){0.5 * (scratch[i] + scratch[i - 1]), cut};
    }
    return true;
}

/* Narrows the gaps of the scene, and its box accordingly. */
static bool narrow(neighbours *n, const vec3 *x, double margin, bbox *box, error *e)
{
    double *scratch = mem_array(n->count, sizeof *scratch, "neighbour lists", e);
    bool ok = scratch != NULL;
    for (int axis = 0; axis < 3 && ok; axis++) ok = find_gaps(n, axis, x, margin, scratch, e);
    free(scratch);
    n->has_gaps = ok;
    if (ok) box->max = neighbours_narrowed(n, box->max);
    return ok;
}

bool neighbours_build(neighbours *n, size_t count, const vec3 *x, const double *size, double cutoff,
                      threads *pool, error *e)
{
    bbox box = bbox_of_points(x, count, pool);
    double least = size && count > 0 ? size[0] : 1, largest = least;
    for (size_t i = 0; size && i < count; i++) {
        least = size[i] < least ? size[i] : least;
        largest = size[i] > largest ? size[i] : largest;
    }
    assert(count <= n->capacity && cutoff > 0);
    n->count = count;
    n->cutoff = cutoff;
    n->has_gaps = false;
    /* the largest size is the upper limit of its level: sizes within a factor of two have one level */
    const int halves = ilogb(largest / least), most = NEIGHBOURS_LEVELS - 1;
    n->edge = (1 + BIN_HAIR) * cutoff * ldexp(largest, halves < most ? -halves : -most);
    /* a margin of one bin of any level: adjacent bins have no negative coordinates */
    const double margin = cutoff * 2 * largest;
    if (bbox_longest(box) > many_bins * margin && !narrow(n, x, margin, &box, e)) return false;
    const double span = bbox_longest(box) + 2 * margin;
    /* coordinates of blocks, adjacent ones included, fit into BLOCK_BITS */
    if (span / n->edge > (1 << (BLOCK_BITS + BLOCK_SHIFT)) - 2 * BLOCK_WIDTH)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "the smallest support, %g, is too small for a surface of size %g: sample its parts in jobs of "
            "their own, or reduce the ratio of the spacings",
            cutoff * least, bbox_longest(box));
    n->origin = vec3_sub(box.min, vec3_make(margin, margin, margin));
    n->unit = ldexp(span, -PLACE_BITS);
    n->per_unit = 1 / n->unit;
    build_job job = {.n = n, .x = x, .size = size};
    threads_run(pool, count, CHUNK, place_chunk, &job);
    return neighbour_bins_fill(n, pool, e) && fill_lists(n, pool, e);
}
