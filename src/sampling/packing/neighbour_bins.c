// SPDX-License-Identifier: Apache-2.0
#include "sampling/packing/neighbour_bins.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const size_t FEWEST_BINS = 64, FEWEST_BLOCKS = 8;
/* Assumed points per bin and bins per block for the initial allocation; a surface has about six and sixty.
 * The arrays grow if necessary. */
static const size_t POINTS_PER_BIN = 4, POINTS_PER_BLOCK = 128;
/* Points in a chunk of work, and slots of the hash table of a chunk's spots. */
enum { CHUNK = 4096, SPOT_SLOTS = 2 * CHUNK };
enum { BLOCK_CHUNK = 64 }; /* blocks in a chunk of work */

/* There are at most as many bins with points as points. Bins above them are rarely as many again. */
static bool reserve_bins(neighbours *n, size_t bins, error *e)
{
    const char *what = "neighbour lists";
    if (bins < FEWEST_BINS) bins = FEWEST_BINS;
    free(n->bin_begin);
    free(n->bin_cell);
    n->bin_capacity = bins;
    n->bin_begin = mem_array(bins + 1, sizeof *n->bin_begin, what, e);
    n->bin_cell = mem_array(bins, sizeof *n->bin_cell, what, e);
    return n->bin_begin && n->bin_cell;
}

static bool reserve_blocks(neighbours *n, size_t blocks, error *e)
{
    const char *what = "neighbour lists";
    if (blocks < FEWEST_BLOCKS) blocks = FEWEST_BLOCKS;
    n->table_size = 2 * FEWEST_BLOCKS;
    while (n->table_size < 2 * blocks) n->table_size *= 2;
    free(n->table);
    free(n->block_key);
    free(n->block_first);
    free(n->block_size);
    free(n->block_begin);
    free(n->cell);
    n->block_capacity = blocks;
    n->table = mem_array(n->table_size, sizeof *n->table, what, e);
    n->block_key = mem_array(blocks, sizeof *n->block_key, what, e);
    n->block_first = mem_array(blocks, sizeof *n->block_first, what, e);
    n->block_size = mem_array(blocks, sizeof *n->block_size, what, e);
    n->block_begin = mem_array(blocks + 1, sizeof *n->block_begin, what, e);
    n->cell = mem_array(blocks, BLOCK_CELLS * sizeof *n->cell, what, e);
    return n->table && n->block_key && n->block_first && n->block_size && n->block_begin && n->cell;
}

bool neighbour_bins_reserve(neighbours *n, size_t points, error *e)
{
    return reserve_bins(n, points / POINTS_PER_BIN, e) && reserve_blocks(n, points / POINTS_PER_BLOCK, e);
}

static place parent_of(const place *p)
{
    return (place){p->level + 1, {p->at[0] >> 1, p->at[1] >> 1, p->at[2] >> 1}};
}

/* The block of the last lookup; the next lookup is mostly in the same block. */
typedef struct visit {
    uint64_t key;
    uint32_t block;
} visit;

#define NO_CELL UINT32_MAX

/* The key of a bin: its cell in the lower bits, the key of its block above. */
static uint64_t spot_of(const place *bin)
{
    const place block = block_of(bin);
    return key_of(&block) << 3 * BLOCK_SHIFT | cell_of(bin);
}

/* The index in `cell` of a spot's cell. Creates its bin if it has none. NO_CELL: the arrays are full. */
static uint32_t cell_at(neighbours *n, uint64_t spot, visit *last)
{
    const uint64_t key = spot >> 3 * BLOCK_SHIFT;
    if (key != last->key) {
        size_t slot = slot_of(n, key);
        if (!n->table[slot]) {
            if (n->blocks == n->block_capacity) return NO_CELL;
            n->block_key[n->blocks] = key;
            n->block_size[n->blocks] = 0;
            memset(n->cell + n->blocks * BLOCK_CELLS, 0, BLOCK_CELLS * sizeof *n->cell);
            n->table[slot] = (uint32_t)++n->blocks;
        }
        *last = (visit){key, n->table[slot] - 1};
    }
    const uint32_t at = last->block * BLOCK_CELLS + (uint32_t)(spot & (BLOCK_CELLS - 1));
    if (!n->cell[at]) {
        if (n->bin_count == n->bin_capacity) return NO_CELL;
        n->bin_count++;
        n->cell[at] = (uint16_t)++n->block_size[last->block];
    }
    return at;
}

/* The bin of a point. */
static place place_at(const neighbours_place *p, double scale, double size_scale)
{
    double over = (double)p->size * size_scale;
    int level = 0;
    while (level < NEIGHBOURS_LEVELS - 1 && over > (double)(1 << level)) level++;
    return (place){level,
                   {(int64_t)(p->x * scale) >> level, (int64_t)(p->y * scale) >> level,
                    (int64_t)(p->z * scale) >> level}};
}

/* Finds the spots (bins) of a chunk's points, each once, in the order of the points. The arrays of the lists
 * serve as scratch memory. list_begin of a point: the index of its spot within the chunk. For the k-th spot
 * of a chunk that begins with point b: `list` has its key, as a uint64_t at b + k; bin_item[b + k] has the
 * number of the chunk's points in it; list_count[b + k] has its cell, then its bin, then the position in
 * bin_item of the chunk's points in this bin. bin_item ends with a 0. */
static void spot_chunk(void *context, int worker, size_t begin, size_t end)
{
    neighbours *n = context;
    uint64_t *spot = (uint64_t *)n->list + begin;
    uint16_t slot[SPOT_SLOTS] = {0}, spots = 0; /* hash table with open addressing: index of the spot + 1, or
                                                 * 0 */
    (void)worker;
    assert(end - begin <= CHUNK && 2 * end <= n->list_capacity);
    for (size_t i = begin; i < end; i++) {
        const place at = place_at(&n->place[i], n->unit / n->edge, n->cutoff / n->edge);
        const uint64_t own = spot_of(&at);
        size_t s = own * 0x9e3779b97f4a7c15u >> 32 & (SPOT_SLOTS - 1);
        while (slot[s] && spot[slot[s] - 1] != own) s = (s + 1) & (SPOT_SLOTS - 1);
        if (!slot[s]) {
            n->bin_item[begin + spots] = 0;
            spot[spots] = own;
            slot[s] = ++spots;
        }
        n->list_begin[i] = slot[s] - 1u;
        n->bin_item[begin + n->list_begin[i]]++;
    }
    if (begin + spots < end) n->bin_item[begin + spots] = 0;
}

/* Whether the chunk that begins with a point has a spot with index k. */
static inline bool has_spot(const neighbours *n, size_t begin, size_t k)
{
    return k < n->count && k < begin + CHUNK && n->bin_item[k] > 0;
}

/* Creates the bins above those of a level. False: the arrays are full. */
static bool split_level(neighbours *n, int level, visit *last)
{
    for (size_t b = 0; b < n->blocks; b++) {
        const place block = place_of_block(n->block_key[b]);
        if (block.level != level) continue;
        for (uint32_t c = 0; c < BLOCK_CELLS; c++) {
            if (!n->cell[b * BLOCK_CELLS + c]) continue;
            const place bin = place_of_bin(&block, c), parent = parent_of(&bin);
            const uint32_t at = cell_at(n, spot_of(&parent), last);
            if (at == NO_CELL) return false;
            n->cell[at] |= CELL_SPLIT;
        }
    }
    return true;
}

/* Numbers the bins of each block in the order in which points first fall into them; bins that only contain
 * finer bins come last. False: the arrays are full. */
static bool number_bins(neighbours *n)
{
    memset(n->table, 0, n->table_size * sizeof *n->table);
    n->bin_count = n->blocks = 0;
    n->levels = 1;
    visit last = {NO_KEY, 0};
    for (size_t begin = 0; begin < n->count; begin += CHUNK)
        for (size_t k = begin; has_spot(n, begin, k); k++) {
            const uint64_t spot = ((const uint64_t *)n->list)[k];
            const int level = (int)(spot >> 3 * (BLOCK_SHIFT + BLOCK_BITS));
            if ((n->list_count[k] = cell_at(n, spot, &last)) == NO_CELL) return false;
            if (level >= n->levels) n->levels = level + 1;
        }
    for (int level = 0; level < n->levels - 1; level++)
        if (!split_level(n, level, &last)) return false;
    return true;
}

static int colour_of(uint64_t key)
{
    return (int)((key & 1) | (key >> BLOCK_BITS & 1) << 1 | (key >> 2 * BLOCK_BITS & 1) << 2 |
                 (key >> 3 * BLOCK_BITS & (NEIGHBOURS_LEVELS - 1)) << 3);
}

/* Sorts the blocks by colour, and numbers their bins consecutively. */
static void sort_blocks(neighbours *n)
{
    n->colours = 8 * n->levels;
    memset(n->colour_begin, 0, sizeof n->colour_begin);
    for (size_t b = 0; b < n->blocks; b++) n->colour_begin[colour_of(n->block_key[b]) + 1]++;
    uint32_t next[NEIGHBOURS_COLOURS];
    for (int c = 0; c < n->colours; c++) {
        n->colour_begin[c + 1] += n->colour_begin[c];
        next[c] = n->colour_begin[c];
    }
    for (size_t b = 0; b < n->blocks; b++) {
        /* position of the block in the order */
        n->block_first[b] = next[colour_of(n->block_key[b])]++;
        n->block_begin[n->block_first[b]] = n->block_size[b];
    }
    uint32_t total = 0;
    for (size_t k = 0; k <= n->blocks; k++) {
        const uint32_t bins = k < n->blocks ? n->block_begin[k] : 0;
        n->block_begin[k] = total;
        total += bins;
    }
    for (size_t b = 0; b < n->blocks; b++) n->block_first[b] = n->block_begin[n->block_first[b]];
}

/* Stores the cells of the bins of blocks; most cells have no bin. */
static void cell_chunk(void *context, int worker, size_t begin, size_t end)
{
    const neighbours *n = context;
    (void)worker;
    for (size_t b = begin; b < end; b++) {
        const uint16_t *cell = n->cell + b * BLOCK_CELLS;
        for (uint32_t c = 0; c < BLOCK_CELLS; c += 4) {
            uint64_t four;
            memcpy(&four, cell + c, sizeof four);
            for (uint32_t k = c; four != 0 && k < c + 4; k++)
                if (cell[k] & CELL_BIN)
                    n->bin_cell[n->block_first[b] + (cell[k] & CELL_BIN) - 1] = (uint16_t)k;
        }
    }
}

/* Replaces the cells of a chunk's spots by bins. */
static void bin_chunk(void *context, int worker, size_t begin, size_t end)
{
    neighbours *n = context;
    (void)worker, (void)end;
    for (size_t k = begin; has_spot(n, begin, k); k++) {
        const uint32_t at = n->list_count[k];
        n->list_count[k] = n->block_first[at / BLOCK_CELLS] + (n->cell[at] & CELL_BIN) - 1;
    }
}

/* Replaces the bin of each spot by the position of its points in bin_item, chunk after chunk. */
static void place_spots(neighbours *n)
{
    memset(n->bin_begin, 0, (n->bin_count + 1) * sizeof *n->bin_begin);
    for (size_t begin = 0; begin < n->count; begin += CHUNK)
        for (size_t k = begin; has_spot(n, begin, k); k++) n->bin_begin[n->list_count[k]] += n->bin_item[k];
    uint32_t total = 0; /* counts become ends of ranges; filling from the back turns these into begins */
    for (size_t b = 0; b <= n->bin_count; b++) n->bin_begin[b] = total += n->bin_begin[b];
    for (size_t begin = n->count / CHUNK * CHUNK + CHUNK; begin >= CHUNK;)
        for (size_t k = begin -= CHUNK; has_spot(n, begin, k); k++)
            n->list_count[k] = n->bin_begin[n->list_count[k]] -= n->bin_item[k];
}

/* Stores a chunk's points in their bins, after those of earlier chunks. */
static void item_chunk(void *context, int worker, size_t begin, size_t end)
{
    neighbours *n = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) n->bin_item[n->list_count[begin + n->list_begin[i]]++] = (uint32_t)i;
}

bool neighbour_bins_fill(neighbours *n, threads *pool, error *e)
{
    for (;;) {
        threads_run(pool, n->count, CHUNK, spot_chunk, n);
        if (!threads_may_go_on(pool, e)) return false;
        if (number_bins(n)) break;
        if (!reserve_bins(n, 2 * n->bin_capacity, e) || !reserve_blocks(n, 2 * n->block_capacity, e))
            return false;
    }
    sort_blocks(n);
    threads_run(pool, n->blocks, BLOCK_CHUNK, cell_chunk, n);
    threads_run(pool, n->count, CHUNK, bin_chunk, n);
    if (!threads_may_go_on(pool, e)) return false;
    place_spots(n);
    threads_run(pool, n->count, CHUNK, item_chunk, n);
    if (!threads_may_go_on(pool, e)) return false;
    return true;
}
