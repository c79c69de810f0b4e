// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/crossed_cells.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/isa.h"
#include "base/core/memory.h"

enum { SIDE = GRID_VIEW_SIDE, CORNERS = SIDE + 1, BLOCKS = 64 /* per chunk of work */ };

static const char what[] = "the cells that the surface crosses";

typedef struct cells_job {
    const crossings *crossings;
    const samples *samples;
    crossed_cells *out;
    bool smooth;
} cells_job;

/* A range of corners along the last axis: from the first to the last one plus 1. */
typedef struct span {
    int from, end;
} span;

/* The range of corners (x, y, .) that cells of the block have. */
static span span_of(const cell_block *b, int x, int y)
{
    const uint64_t cells = (x > 0 ? b->layer[x - 1] : 0) | (x < SIDE ? b->layer[x] : 0);
    const unsigned any = ((y > 0 ? cells >> (8 * y - 8) : 0) | (y < SIDE ? cells >> 8 * y : 0)) & 0xff;
    if (any == 0) return (span){0, 0};
    return (span){__builtin_ctz(any), 33 - __builtin_clz(any)};
}

/* Counts the cells and values of each block. `cells` and `values` of a block are its own numbers until
 * add_up. */
ISA_CLONES static void count_chunk(void *context, int worker, size_t begin, size_t end)
{
    const cells_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const crossing_block *from = &job->crossings->blocks[i];
        cell_block *b = &job->out->blocks[i];
        b->block = block_map_find(job->out->map, from->block[0], from->block[1], from->block[2]);
        memcpy(b->layer, from->rows, sizeof b->layer);
        b->cells = b->values = 0;
        for (int x = 0; x < SIDE; x++) {
            b->layer[x] = le64toh(b->layer[x]);
            b->before[x] = (uint16_t)b->cells;
            b->cells += (size_t)__builtin_popcountll(b->layer[x]);
        }
        for (int k = 0; k < CORNERS * CORNERS; k++) {
            const span s = span_of(b, k / CORNERS, k % CORNERS);
            b->row[k] = (int16_t)((int)b->values - s.from);
            b->values += (size_t)(s.end - s.from);
        }
    }
}

/* Replaces the numbers of each block by the totals of the blocks before it. */
static bool add_up(crossed_cells *c, error *e)
{
    size_t cells = 0, values = 0;
    for (cell_block *b = c->blocks; b <= c->blocks + c->block_count; b++) {
        const size_t own_cells = b->cells, own_values = b->values;
        b->cells = cells;
        b->values = values;
        cells += own_cells;
        values += own_values;
    }
    c->count = cells;
    c->block_of = mem_array(cells / CROSSED_CELLS_STEP + 1, sizeof *c->block_of, what, e);
    if (!c->block_of) return false;
    for (size_t i = 0, k = 0; i < c->block_count; i++)
        for (; k < c->blocks[i + 1].cells; k += CROSSED_CELLS_STEP)
            c->block_of[k / CROSSED_CELLS_STEP] = (uint32_t)i;
    return true;
}

bool crossed_cells_list(const crossings *c, const block_map *map, threads *pool, crossed_cells *out, error *e)
{
    crossed_cells made = {.map = map, .block_count = c->count};
    cells_job job = {.crossings = c, .out = &made};
    made.blocks = mem_array(c->count + 1, sizeof *made.blocks, what, e);
    bool ok = made.blocks;
    if (ok) threads_run(pool, c->count, BLOCKS, count_chunk, &job);
    ok = ok && threads_may_go_on(pool, e);
    ok = ok && add_up(&made, e);
    if (ok)
        *out = made;
    else
        crossed_cells_free(&made);
    return ok;
}

static void value_chunk(void *context, int worker, size_t begin, size_t end)
{
    const cells_job *job = context;
    float corners[CORNERS * CORNERS * CORNERS + CORNERS] = {0}, packed[sizeof corners / sizeof *corners];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const cell_block *b = &job->out->blocks[i];
        const block_map *map = job->out->map;
        if (i + 1 < end) samples_fetch(job->samples, map->blocks[b[1].block]);
        samples_corners(job->samples, map->blocks[b->block], job->smooth, corners);
        /* copies whole rows: the excess is overwritten by the next row */
        for (int k = 0; k < CORNERS * CORNERS; k++) {
            const int from = span_of(b, k / CORNERS, k % CORNERS).from;
            memcpy(packed + (b->row[k] + from), corners + CORNERS * k + from, CORNERS * sizeof *packed);
        }
        memcpy(job->out->value + b->values, packed, (b[1].values - b->values) * sizeof *packed);
    }
}

bool crossed_cells_take_values(crossed_cells *c, const samples *s, bool smooth, threads *pool, error *e)
{
    cells_job job = {.samples = s, .out = c, .smooth = smooth};
    c->value = mem_array(c->blocks[c->block_count].values, sizeof *c->value, what, e);
    if (c->value) threads_run(pool, c->block_count, BLOCKS, value_chunk, &job);
    return c->value;
}

typedef struct rows_job {
    const crossed_cells *cells;
    uint8_t *rows;
} rows_job;

static void mark_chunk(void *context, int worker, size_t begin, size_t end)
{
    const rows_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const cell_block *b = &job->cells->blocks[i];
        for (size_t x = 0; x < SIDE; x++) {
            const uint64_t layer = htole64(b->layer[x]);
            memcpy(job->rows + 64 * (size_t)b->block + SIDE * x, &layer, sizeof layer);
        }
    }
}

void crossed_cells_mark(const crossed_cells *c, threads *pool, uint8_t *rows)
{
    rows_job job = {c, rows};
    threads_run(pool, c->block_count, BLOCKS, mark_chunk, &job);
}

void crossed_cells_free(crossed_cells *c)
{
    free(c->blocks);
    free(c->block_of);
    free(c->value);
    free(c->late);
    memset(c, 0, sizeof *c);
}

void crossed_cells_add_late(crossed_cells *c, crossed_cell *late, size_t count)
{
    c->late = late;
    c->count += count;
}

/* The index of the set bit with n set bits below it; n is small. */
static int nth_bit(uint64_t bits, unsigned n)
{
    for (; n > 0; n--) bits &= bits - 1;
    return __builtin_ctzll(bits);
}

const cell_block *crossed_cells_block(const crossed_cells *c, size_t k)
{
    const cell_block *b = &c->blocks[c->block_of[k / CROSSED_CELLS_STEP]];
    while (b[1].cells <= k) b++;
    return b;
}

/* The block of cell k, and the position within it. */
static const cell_block *find_in_blocks(const crossed_cells *c, size_t k, int within[3])
{
    const cell_block *b = crossed_cells_block(c, k);
    const uint32_t in_block = (uint32_t)(k - b->cells);
    int x = 0;
    while (x + 1 < SIDE && b->before[x + 1] <= in_block) x++;
    const int bit = nth_bit(b->layer[x], in_block - b->before[x]);
    within[0] = x;
    within[1] = bit >> 3;
    within[2] = bit & 7;
    return b;
}

static void place_in_blocks(const crossed_cells *c, const cell_block *b, const int within[3], int32_t at[3])
{
    for (int a = 0; a < 3; a++) at[a] = c->map->blocks[b->block][a] * SIDE + within[a];
}

void crossed_cells_place(const crossed_cells *c, size_t k, int32_t at[3])
{
    const size_t in_blocks = crossed_cells_in_blocks(c);
    if (k >= in_blocks) {
        memcpy(at, c->late[k - in_blocks].at, sizeof c->late->at);
        return;
    }
    int within[3];
    const cell_block *b = find_in_blocks(c, k, within);
    place_in_blocks(c, b, within, at);
}

void crossed_cells_get(const crossed_cells *c, size_t k, crossed_cell *out)
{
    const size_t in_blocks = crossed_cells_in_blocks(c);
    if (k >= in_blocks) {
        *out = c->late[k - in_blocks];
        return;
    }
    int within[3];
    const cell_block *b = find_in_blocks(c, k, within);
    const int x = within[0], y = within[1], z = within[2];
    place_in_blocks(c, b, within, out->at);
    out->block = b->block;
    for (int corner = 0; corner < 8; corner++)
        out->value[corner] =
            c->value[b->values + (size_t)(b->row[CORNERS * (x + (corner & 1)) + y + (corner >> 1 & 1)] + z +
                                          (corner >> 2))];
}

size_t crossed_cells_bytes(const crossed_cells *c)
{
    const size_t in_blocks = crossed_cells_in_blocks(c);
    return (c->block_count + 1) * sizeof *c->blocks +
           (in_blocks / CROSSED_CELLS_STEP + 1) * sizeof *c->block_of +
           c->blocks[c->block_count].values * sizeof *c->value + (c->count - in_blocks) * sizeof *c->late;
}
