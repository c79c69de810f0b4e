// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/coefficient_block.h"

#include <sched.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

enum { BLOCKS = 64 }; /* per chunk of work */
/* Number of coefficient blocks after which memory of samples is freed; it costs as much as a batch. */
enum { BATCH = 4096 };

static const int lowest_voxel[3] = {-1, -1, -1}; /* of a coefficient block, relative to its block */

/* Number of coefficient blocks that fit into the caches: 40 MB. */
static const size_t MANY = 8192;
/* Coefficient blocks that a point accesses, on a surface with more coefficient blocks. */
static const size_t PER_POINT = 2;

typedef struct fill_job {
    const samples *samples;
    const block_map *map;
    size_t first; /* of the coefficient blocks to fill */
    float *coefficients;
} fill_job;

static void fill_chunk(void *context, int worker, size_t begin, size_t end)
{
    const fill_job *job = context;
    (void)worker;
    for (size_t n = job->first + begin; n < job->first + end; n++)
        samples_window(job->samples, job->map->blocks[n], lowest_voxel, COEFFICIENT_BLOCK_SIDE,
                       job->coefficients + n * COEFFICIENT_BLOCK_SIZE);
}

/* For each batch of coefficient blocks: the lowest first coordinate in it and in all later batches. */
static void find_lowest(const block_map *map, int32_t *lowest)
{
    int32_t low = INT32_MAX;
    for (uint32_t n = map->count; n-- > 0;) {
        if (map->blocks[n][0] < low) low = map->blocks[n][0];
        lowest[n / BATCH] = low;
    }
}

static bool fill_all(samples *s, const block_map *map, threads *pool, float *coefficients, error *e)
{
    const size_t batches = (map->count + BATCH - 1) / BATCH;
    int32_t *lowest = mem_array(batches, sizeof *lowest, "the coefficients of the spline", e);
    fill_job job = {.samples = s, .map = map, .coefficients = coefficients};
    if (!lowest) return false;
    find_lowest(map, lowest);
    for (size_t k = 0; k < batches; k++) {
        const size_t left = map->count - k * BATCH;
        if (k > 0) samples_release_below(s, lowest[k] - 1);
        job.first = k * BATCH;
        threads_run(pool, left < BATCH ? left : BATCH, BLOCKS, fill_chunk, &job);
    }
    free(lowest);
    return true;
}

size_t coefficient_blocks_capacity(size_t blocks, size_t points)
{
    const size_t capacity = MANY + PER_POINT * points;
    if (points == 0 || blocks <= MANY + points) return 0;
    return capacity < blocks ? capacity : blocks;
}

bool coefficient_blocks_build(samples *s, const block_map *map, size_t later, threads *pool,
                              coefficient_blocks *out, error *e)
{
    const char *what = "the coefficients of the spline";
    coefficient_blocks b = {.map = map, .capacity = later > 0 ? later : map->count, .source = *s};
    memset(s, 0, sizeof *s);
    samples_settle(&b.source);
    b.memory = mem_array(b.capacity * COEFFICIENT_BLOCK_SIZE, sizeof *b.memory, what, e);
    bool ok = b.memory;
    if (ok && later > 0) ok = (b.place = mem_array((size_t)map->count + 1, sizeof *b.place, what, e)) != NULL;
    if (ok && later == 0) {
        ok = fill_all(&b.source, map, pool, b.memory, e);
        samples_free(&b.source);
    }
    if (ok)
        *out = b;
    else
        coefficient_blocks_free(&b);
    return ok;
}

void coefficient_blocks_free(coefficient_blocks *b)
{
    samples_free(&b->source);
    free(b->memory);
    free(b->place);
    memset(b, 0, sizeof *b);
}

const float *coefficient_blocks_wait(const coefficient_blocks *b, uint32_t n)
{
    atomic_uint *place = &b->place[n], *made = &b->place[b->map->count];
    for (;;) {
        unsigned now = atomic_load_explicit(place, memory_order_acquire);
        if (now >= COEFFICIENT_BLOCK_PRESENT)
            return b->memory + (size_t)(now - COEFFICIENT_BLOCK_PRESENT) * COEFFICIENT_BLOCK_SIZE;
        if (now == COEFFICIENT_BLOCK_IN_PROGRESS) {
            sched_yield();
            continue;
        }
        if (atomic_load_explicit(made, memory_order_relaxed) >= b->capacity) return NULL;
        if (!atomic_compare_exchange_strong(place, &now, COEFFICIENT_BLOCK_IN_PROGRESS)) continue;
        const unsigned at = atomic_fetch_add(made, 1); /* several threads may claim the last one */
        if (at < b->capacity)
            samples_window(&b->source, b->map->blocks[n], lowest_voxel, COEFFICIENT_BLOCK_SIDE,
                           b->memory + (size_t)at * COEFFICIENT_BLOCK_SIZE);
        atomic_store_explicit(place,
                              at < b->capacity ? at + COEFFICIENT_BLOCK_PRESENT : COEFFICIENT_BLOCK_MISSING,
                              memory_order_release);
    }
}

const float *coefficient_blocks_read_once(const coefficient_blocks *b, uint32_t n,
                                          float buffer[COEFFICIENT_BLOCK_SIZE])
{
    if (!b->place || atomic_load_explicit(&b->place[n], memory_order_acquire) >= COEFFICIENT_BLOCK_PRESENT)
        return coefficient_blocks_at(b, n);
    samples_window(&b->source, b->map->blocks[n], lowest_voxel, COEFFICIENT_BLOCK_SIDE, buffer);
    return buffer;
}

void coefficient_blocks_gather_cell(const coefficient_blocks *b, uint32_t n, const int cell[3],
                                    float buffer[COEFFICIENT_BLOCK_CELL])
{
    float cube[4][4][4];
    const int low[3] = {cell[0] - 1, cell[1] - 1, cell[2] - 1};
    samples_window(&b->source, b->map->blocks[n], low, 4, cube[0][0]);
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(buffer + x * COEFFICIENT_BLOCK_SLAB + y * COEFFICIENT_BLOCK_SIDE, cube[x][y],
                   sizeof cube[x][y]);
}

void coefficient_blocks_discard(const coefficient_blocks *b)
{
    if (!b->place || atomic_load_explicit(&b->place[b->map->count], memory_order_relaxed) == 0) return;
    for (size_t n = 0; n <= b->map->count; n++)
        atomic_store_explicit(&b->place[n], COEFFICIENT_BLOCK_MISSING, memory_order_relaxed);
}

void coefficient_block_set_sides(const samples *s, const block_map *map, uint64_t *inside)
{
    for (uint32_t n = 0; n < map->count; n++) {
        const int32_t *b = map->blocks[n];
        const uint64_t *from = s->inside + GRID_VIEW_SIDE * (size_t)block_map_find(&s->map, b[0], b[1], b[2]);
        memcpy(inside + GRID_VIEW_SIDE * (size_t)n, from, GRID_VIEW_SIDE * sizeof *inside);
    }
}
