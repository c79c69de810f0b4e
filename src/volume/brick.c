#include "volume/brick.h"

#include <sched.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { BLOCKS = 64 }; /* per chunk of work */
/* Number of bricks after which memory of samples is freed; it costs as much as a batch. */
enum { BATCH = 4096 };

static const int lowest_voxel[3] = {-1, -1, -1}; /* of a brick, relative to its block */

/* Number of bricks that fit into the caches: 40 MB. */
static const size_t MANY = 8192;
/* Bricks that a point accesses, on a surface with more bricks. */
static const size_t PER_POINT = 2;

typedef struct brick_job {
    const samples *samples;
    const block_map *map;
    size_t first; /* of the bricks to fill */
    float *coefficients;
} brick_job;

static void fill_chunk(void *context, int worker, size_t begin, size_t end)
{
    const brick_job *job = context;
    (void)worker;
    for (size_t n = job->first + begin; n < job->first + end; n++)
        samples_window(job->samples, job->map->blocks[n], lowest_voxel, BRICK_SIDE,
                       job->coefficients + n * BRICK_SIZE);
}

/* For each batch of bricks: the lowest first coordinate in it and in all later batches. */
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
    int32_t *lowest = mem_array(batches, sizeof *lowest, "the spline's bricks", e);
    brick_job job = {.samples = s, .map = map, .coefficients = coefficients};
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

size_t bricks_capacity(size_t blocks, size_t points)
{
    const size_t capacity = MANY + PER_POINT * points;
    if (points == 0 || blocks <= MANY + points) return 0;
    return capacity < blocks ? capacity : blocks;
}

bool bricks_make(samples *s, const block_map *map, size_t later, threads *pool, bricks *out, error *e)
{
    const char *what = "the spline's bricks";
    bricks b = {.map = map, .capacity = later > 0 ? later : map->count, .coefficients = *s};
    memset(s, 0, sizeof *s);
    samples_settle(&b.coefficients);
    b.memory = mem_array(b.capacity * BRICK_SIZE, sizeof *b.memory, what, e);
    bool ok = b.memory;
    if (ok && later > 0) ok = (b.place = mem_array((size_t)map->count + 1, sizeof *b.place, what, e)) != NULL;
    if (ok && later == 0) {
        ok = fill_all(&b.coefficients, map, pool, b.memory, e);
        samples_free(&b.coefficients);
    }
    if (ok)
        *out = b;
    else
        bricks_free(&b);
    return ok;
}

void bricks_free(bricks *b)
{
    samples_free(&b->coefficients);
    free(b->memory);
    free(b->place);
    memset(b, 0, sizeof *b);
}

const float *bricks_wait(const bricks *b, uint32_t n)
{
    atomic_uint *place = &b->place[n], *made = &b->place[b->map->count];
    for (;;) {
        unsigned now = atomic_load_explicit(place, memory_order_acquire);
        if (now >= BRICK_THERE) return b->memory + (size_t)(now - BRICK_THERE) * BRICK_SIZE;
        if (now == BRICK_BEING_MADE) {
            sched_yield();
            continue;
        }
        if (atomic_load_explicit(made, memory_order_relaxed) >= b->capacity) return NULL;
        if (!atomic_compare_exchange_strong(place, &now, BRICK_BEING_MADE)) continue;
        const unsigned at = atomic_fetch_add(made, 1); /* several threads may claim the last one */
        if (at < b->capacity)
            samples_window(&b->coefficients, b->map->blocks[n], lowest_voxel, BRICK_SIDE,
                           b->memory + (size_t)at * BRICK_SIZE);
        atomic_store_explicit(place, at < b->capacity ? at + BRICK_THERE : BRICK_MISSING,
                              memory_order_release);
    }
}

const float *bricks_read_once(const bricks *b, uint32_t n, float buffer[BRICK_SIZE])
{
    if (!b->place || atomic_load_explicit(&b->place[n], memory_order_acquire) >= BRICK_THERE)
        return bricks_at(b, n);
    samples_window(&b->coefficients, b->map->blocks[n], lowest_voxel, BRICK_SIDE, buffer);
    return buffer;
}

void bricks_gather_cell(const bricks *b, uint32_t n, const int cell[3], float buffer[BRICK_CELL])
{
    float cube[4][4][4];
    const int low[3] = {cell[0] - 1, cell[1] - 1, cell[2] - 1};
    samples_window(&b->coefficients, b->map->blocks[n], low, 4, cube[0][0]);
    for (int x = 0; x < 4; x++)
        for (int y = 0; y < 4; y++)
            memcpy(buffer + x * BRICK_SLAB + y * BRICK_SIDE, cube[x][y], sizeof cube[x][y]);
}

void bricks_forget(const bricks *b)
{
    if (!b->place || atomic_load_explicit(&b->place[b->map->count], memory_order_relaxed) == 0) return;
    for (size_t n = 0; n <= b->map->count; n++)
        atomic_store_explicit(&b->place[n], BRICK_MISSING, memory_order_relaxed);
}

void brick_note_sides(const samples *s, const block_map *map, uint64_t *inside)
{
    for (uint32_t n = 0; n < map->count; n++) {
        const int32_t *b = map->blocks[n];
        const uint64_t *from = s->inside + GRID_VIEW_SIDE * (size_t)block_map_find(&s->map, b[0], b[1], b[2]);
        memcpy(inside + GRID_VIEW_SIDE * (size_t)n, from, GRID_VIEW_SIDE * sizeof *inside);
    }
}
