// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/samples.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/isa.h"
#include "base/core/memory.h"
#include "surface/volume/block_lines.h"

#define SIDE GRID_VIEW_SIDE
#define VOXELS GRID_VIEW_VOXELS

enum { BLOCKS = 64 }; /* in a chunk of work */
/* If a smaller fraction of the grid's leaves is used, as in fogs, these are copied and the grid is freed. */
static const double MOST_LEAVES = 0.75;
/* Larger values are refused: sums of floats would overflow. */
static const float largest_value = 1e30f;

size_t samples_bytes(size_t count, bool settled)
{
    const size_t while_made = settled ? 0 : 2 * SIDE * sizeof(uint64_t) + 6 * sizeof(uint32_t);
    return count * (VOXELS * sizeof(float) + sizeof(float *) + while_made) + block_map_bytes(count);
}

void samples_settle(samples *s)
{
    free(s->known);
    free(s->inside);
    free(s->near);
    s->known = s->inside = NULL;
    s->near = NULL;
}

void samples_free(samples *s)
{
    block_map_free(&s->map);
    samples_settle(s);
    free(s->f);
    free(s->leaves.f);
    free(s->leaves.highest);
    free(s->others.f);
    free(s->others.highest);
    memset(s, 0, sizeof *s);
}

static bool is_usable(float value)
{
    return fabsf(value) <= largest_value; /* false for NaN */
}

static bool report_unusable(const samples *s, error *e)
{
    size_t bad = 0, first = 0, total = (size_t)s->map.count * VOXELS;
    for (size_t i = 0; i < total; i++)
        if (!is_usable(s->f[i / VOXELS][i % VOXELS]) && bad++ == 0) first = i;
    const int32_t *b = s->map.blocks[first / VOXELS];
    size_t v = first % VOXELS;
    return error_set(
        e, ERROR_INPUT_DAMAGED,
        "the volume has %zu voxels near its surface whose values are not finite or beyond %g, the first at (%d, %d, %d): replace their values",
        bad, (double)largest_value, b[0] * SIDE + (int)(v >> 6), b[1] * SIDE + (int)(v >> 3 & 7),
        b[2] * SIDE + (int)(v & 7));
}

typedef struct sample_job {
    const grid_view *from;
    samples *s;
    bool sound; /* all values of the grid are usable */
    atomic_bool unusable;
} sample_job;

/* Whether all values of the grid are usable, so that blocks need no test. */
static bool is_sound(const grid_view *l)
{
    bool good = l->not_finite == 0 && is_usable(l->background);
    for (int level = 0; level < GRID_VIEW_TILE_LEVELS; level++)
        for (uint32_t k = 0; k < l->tiles[level].count; k++)
            good = good && is_usable(l->tile_values[level][k]);
    return good && fabs((double)l->lowest - l->isovalue) < (double)largest_value &&
           fabs((double)l->highest - l->isovalue) < (double)largest_value;
}

static void read_chunk(void *context, int worker, size_t begin, size_t end)
{
    sample_job *job = context;
    samples *s = job->s;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const int32_t *b = s->map.blocks[n];
        float *f = s->f[n];
        int good = 1;
        const grid_view_block from = grid_view_find(job->from, b[0], b[1], b[2]);
        grid_view_signs constant;
        const grid_view_signs *signs = grid_view_find_signs(job->from, from, &constant);
        if (from.leaf == BLOCK_MAP_NONE || !s->leaves.f || !job->from->plain)
            grid_view_read(job->from, from, f);
        memcpy(s->known + n * SIDE, signs->known, SIDE * sizeof *s->known);
        memcpy(s->inside + n * SIDE, signs->inside, SIDE * sizeof *s->inside);
        if (!job->sound)
            for (int i = 0; i < VOXELS; i++) good &= is_usable(f[i]);
        if (!good) atomic_store(&job->unusable, true);
        for (size_t k = 0; k < 6; k += 2) { /* also enters this block in the block above it */
            const uint32_t above = block_map_find(&s->map, b[0] + (k == 0), b[1] + (k == 2), b[2] + (k == 4));
            s->near[6 * n + k + 1] = above;
            if (above != BLOCK_MAP_NONE) s->near[6 * (size_t)above + k] = (uint32_t)n;
        }
    }
}

static bool make_store(samples_store *store, size_t blocks, error *e)
{
    store->parts = (blocks + SAMPLES_RELEASED - 1) / SAMPLES_RELEASED;
    store->highest = mem_array(store->parts, sizeof *store->highest, "the voxels around the surface", e);
    for (size_t k = 0; store->highest && k < store->parts; k++) store->highest[k] = INT32_MIN;
    return store->highest;
}

static float *take_place(samples_store *store, size_t at, int32_t x)
{
    int32_t *highest = &store->highest[at / SAMPLES_RELEASED];
    if (x > *highest) *highest = x;
    return store->f + at * VOXELS;
}

samples_leaves samples_look(const grid_view *l, const block_map *map)
{
    const size_t leaf = VOXELS * sizeof(float), all = l->grid->leaf_count;
    size_t used = 0;
    for (uint32_t n = 0; n < map->count; n++) {
        const int32_t *b = map->blocks[n];
        used += block_map_find(&l->leaves, b[0], b[1], b[2]) != BLOCK_MAP_NONE;
    }
    if ((double)used < MOST_LEAVES * (double)all) return (samples_leaves){0, 0};
    return (samples_leaves){used * leaf, (all - used) * leaf};
}

/* Assigns the memory of each block: the leaf of the grid if leaves are taken over, otherwise a place in
 * `others`. */
static bool place_blocks(samples *s, const grid_view *l, samples_leaves taken, error *e)
{
    const bool shared = taken.used > 0;
    const size_t leaves = l->grid->leaf_count, own = s->map.count - taken.used / (VOXELS * sizeof(float));
    size_t others = 0;
    s->spare = taken.spare;
    s->leaves.f = shared ? l->grid->leaf_values : NULL;
    s->others.f = mem_array(own * VOXELS, sizeof(float), "the voxels around the surface", e);
    if (!s->others.f || !make_store(&s->leaves, shared ? leaves : 0, e) || !make_store(&s->others, own, e))
        return false;
    for (uint32_t n = 0; n < s->map.count; n++) {
        const int32_t *b = s->map.blocks[n];
        const uint32_t leaf = shared ? block_map_find(&l->leaves, b[0], b[1], b[2]) : BLOCK_MAP_NONE;
        const bool is_leaf = leaf != BLOCK_MAP_NONE;
        s->f[n] = take_place(is_leaf ? &s->leaves : &s->others, is_leaf ? leaf : others++, b[0]);
    }
    return true;
}

bool samples_read(const grid_view *l, vdb_grid *grid, samples_leaves taken, block_map *map, threads *pool,
                  samples *out, error *e)
{
    samples s = {.map = *map};
    memset(map, 0, sizeof *map);
    size_t n = s.map.count;
    s.f = mem_array(n, sizeof *s.f, "the voxels around the surface", e);
    s.known = mem_array(n * SIDE, sizeof *s.known, "the voxels around the surface", e);
    s.inside = mem_array(n * SIDE, sizeof *s.inside, "the voxels around the surface", e);
    s.near = mem_array(n * 6, sizeof *s.near, "the voxels around the surface", e);
    bool ok = s.f && s.known && s.inside && s.near && place_blocks(&s, l, taken, e);
    if (ok) {
        memset(s.near, 0xFF, n * 6 * sizeof *s.near); /* all entries become BLOCK_MAP_NONE */
        sample_job job = {l, &s, is_sound(l), false};
        threads_run(pool, n, BLOCKS, read_chunk, &job);
        ok = !atomic_load(&job.unusable) || report_unusable(&s, e);
    }
    if (s.leaves.f) grid->leaf_values = NULL;
    if (ok)
        *out = s;
    else
        samples_free(&s);
    return ok;
}

/* ---- windows */

/* A coordinate that may lie outside a block: the nearest coordinate inside, the distance from it, and the
 * memory offset from it to its inner neighbour. */
typedef struct nearest {
    int within, away, back;
} nearest;

ISA_INLINE nearest nearest_to(int at, int stride)
{
    const int within = at < 0 ? 0 : at < SIDE ? at : SIDE - 1;
    return (nearest){within, abs(at - within), at < 0 ? stride : at < SIDE ? 0 : -stride};
}

/* Reads `count` voxels of a missing block that is next to the block f. Values are extrapolated linearly from
 * the nearest voxel of f and its inner neighbours. If that would change the sign, the value of the nearest
 * voxel is used. */
ISA_INLINE void go_beyond(const float *f, int x, int y, int z, int count, float *to)
{
    const nearest a = nearest_to(x, block_stride[0]), b = nearest_to(y, block_stride[1]);
    const float *line = f + block_stride[0] * a.within + block_stride[1] * b.within;
    for (int k = 0; k < count; k++) {
        const nearest c = nearest_to(z + k, block_stride[2]);
        const float *at = line + c.within, end = *at;
        const float change = (float)a.away * (end - at[a.back]) + (float)b.away * (end - at[b.back]) +
                             (float)c.away * (end - at[c.back]);
        const float on = end + change;
        to[k] =
            /* compares signs separately: a product of floats could underflow to 0 */
            ((on > 0) & (end > 0)) | ((on < 0) & (end < 0)) ? on : end;
    }
}

/* The part of a range of voxels along an axis that lies in one block: first voxel and length. */
typedef struct extent {
    int from, count;
} extent;

ISA_INLINE extent part_of(int low, int side, int at)
{
    const int from = low > SIDE * at ? low : SIDE * at,
              end = low + side < SIDE * (at + 1) ? low + side : SIDE * (at + 1);
    return (extent){from, end - from};
}

ISA_INLINE void take_window(const samples *s, const int32_t block[3], const int low[3], int side, float *out)
{
    const float *near[3][3][3];
    uint32_t around[27];
    extent part[3][3]; /* per axis: the parts in the block below, in the block, and in the block above */
    block_map_around(&s->map, block, around);
    const float *own = s->f[around[13]];
#pragma GCC unroll 9
    for (int k = 0; k < 9; k++) part[k / 3][k % 3] = part_of(low[k / 3], side, k % 3 - 1);
#pragma GCC unroll 27
    for (int k = 0; k < 27; k++) { /* prefetch all blocks first */
        const int at[3] = {k / 9, k / 3 % 3, k % 3};
        const bool beside = (at[0] == 1) + (at[1] == 1) + (at[2] == 1) == 2;
        near[at[0]][at[1]][at[2]] = around[k] == BLOCK_MAP_NONE ? NULL : s->f[around[k]];
        if (beside && part[0][at[0]].count > 0 && part[1][at[1]].count > 0 && part[2][at[2]].count > 0 &&
            around[k] != BLOCK_MAP_NONE)
            block_fetch(s->f[around[k]]);
    }
#pragma GCC unroll 9
    for (int k = 0; k < 9; k++) {
        const extent i = part[0][k / 3], j = part[1][k % 3];
        const float *const *blocks = near[k / 3][k % 3];
        for (int x = i.from; x < i.from + i.count; x++)
            for (int y = j.from; y < j.from + j.count; y++) {
                float *to = out + side * (side * (x - low[0]) + y - low[1]);
#pragma GCC unroll 3
                for (int l = 0; l < 3; l++) {
                    const extent z = part[2][l];
                    if (z.count <= 0) continue;
                    if (blocks[l])
                        for (int m = 0; m < z.count; m++)
                            to[m] = blocks[l][64 * (x & 7) + 8 * (y & 7) + (z.from & 7) + m];
                    else
                        go_beyond(own, x, y, z.from, z.count, to);
                    to += z.count;
                }
            }
    }
}

/* Windows of the usual size, a block and its border, have separate code, in which the length of rows is
 * constant. */
ISA_CLONES void samples_window(const samples *s, const int32_t block[3], const int low[3], int side,
                               float *out)
{
    static const int at_block[3] = {0, 0, 0}, before_block[3] = {-1, -1, -1};
    if (side == 9 && memcmp(low, at_block, sizeof at_block) == 0)
        take_window(s, block, (const int[]){0, 0, 0}, 9, out);
    else if (side == 11 && memcmp(low, before_block, sizeof before_block) == 0)
        take_window(s, block, (const int[]){-1, -1, -1}, 11, out);
    else
        take_window(s, block, low, side, out);
}

void samples_fetch(const samples *s, const int32_t block[3])
{
    const uint32_t n = block_map_find(&s->map, block[0], block[1], block[2]);
    if (n != BLOCK_MAP_NONE) block_fetch(s->f[n]);
}

static void release_below(samples_store *store, int32_t x)
{
    const size_t bytes = SAMPLES_RELEASED * VOXELS * sizeof *store->f;
    for (; store->released + 1 < store->parts && store->highest[store->released] < x; store->released++)
        mem_release((char *)store->f + store->released * bytes, bytes);
}

void samples_release_below(samples *s, int32_t x)
{
    release_below(&s->leaves, x);
    release_below(&s->others, x);
}

void samples_corners(const samples *s, const int32_t block[3], bool smooth, float corners[729])
{
    if (!smooth) {
        samples_window(s, block, (const int[]){0, 0, 0}, 9, corners);
        return;
    }
    float c[11 * 11 * 11];
    samples_window(s, block, (const int[]){-1, -1, -1}, 11, c);
    static const int step_of[3] = {121, 11, 1};
    for (int axis = 0; axis < 3; axis++) { /* in place: `before` has the overwritten value */
        int d = step_of[axis], a = step_of[axis == 0 ? 1 : 0], b = step_of[axis == 2 ? 1 : 2];
        for (int i = 0; i < 11; i++)
            for (int j = 0; j < 11; j++) {
                float *line = c + i * a + j * b, before = line[0];
                for (int k = 1; k < 10; k++) {
                    float here = line[k * d];
                    line[k * d] =
                        (float)(((double)before + 4 * (double)here + (double)line[(k + 1) * d]) / 6);
                    before = here;
                }
            }
    }
    for (int x = 0; x < 9; x++)
        for (int y = 0; y < 9; y++)
            for (int z = 0; z < 9; z++) *corners++ = c[((x + 1) * 11 + y + 1) * 11 + z + 1];
}

void samples_signs(const samples *s, const int32_t block[3], bool smooth, corner_signs *out)
{
    enum { CORNERS = SIDE + 1 };
    float f[CORNERS * CORNERS * CORNERS];
    samples_corners(s, block, smooth, f);
    memset(out, 0, sizeof *out);
    for (int k = 0; k < CORNERS * CORNERS * CORNERS; k++) {
        const int x = k / (CORNERS * CORNERS), y = k / CORNERS % CORNERS, z = k % CORNERS,
                  part = (y == SIDE) + 2 * (z == SIDE), bit = 8 * (y & 7) + (z & 7);
        out->inside.at[part][x] |= (uint64_t)(f[k] < 0) << bit;
        out->outside.at[part][x] |= (uint64_t)(f[k] > 0) << bit;
    }
    for (int k = 0; k < 8; k++) {
        const uint32_t n =
            block_map_find(&s->map, block[0] + (k & 1), block[1] + (k >> 1 & 1), block[2] + (k >> 2));
        for (int x = 0; n != BLOCK_MAP_NONE && x < (k & 1 ? 1 : SIDE); x++)
            out->known.at[k >> 1][x + (k & 1 ? SIDE : 0)] = s->known[(size_t)n * SIDE + (size_t)x];
    }
}
