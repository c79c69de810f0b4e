// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/grid_view.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/isa.h"
#include "base/core/memory.h"

/* Relative tolerance between a stored clamp and the background: half floats have 11 bits. */
static const float half_step = 1.0f / 1024;

static const char leaves[] = "the leaves of the grid";

enum { LEAVES = 256 }; /* in a chunk of work */

/* A value that equals the isovalue in single precision is on the surface. */
static float to_f(const grid_view *l, float value)
{
    if (value == (float)l->isovalue) return 0;
    return (float)(l->kind == GRID_VIEW_LEVEL_SET ? (double)value - l->isovalue
                                                  : l->isovalue - (double)value);
}

static int level_of(int32_t side)
{
    return side == 8 ? 0 : side == 128 ? 1 : 2;
}

/* FOUR: lanes of a vector; available with every instruction set. */
enum { FOUR = 4 };
typedef float row __attribute__((vector_size(16)));
typedef int32_t choice __attribute__((vector_size(16))); /* -1: true; 0: false */

ISA_INLINE row row_at(const float *values)
{
    row r;
    memcpy(&r, values, sizeof r);
    return r;
}

ISA_INLINE row row_of(float value)
{
    return (row){value, value, value, value};
}

ISA_INLINE row choose(choice which, row yes, row no)
{
    return (row)((which & (choice)yes) | (~which & (choice)no));
}

ISA_INLINE uint64_t bits_of(choice which)
{
#ifdef __SSE2__
    return (uint64_t)__builtin_ia32_movmskps((row)which);
#else
    const choice bit = which & (choice){1, 2, 4, 8};
    return (uint64_t)(bit[0] | bit[1] | bit[2] | bit[3]);
#endif
}

typedef struct range {
    float lowest, highest;
    uint64_t not_finite;
} range;

typedef struct scan {
    grid_view *view;
    range *of_chunk;
} scan;

static void range_chunk(void *context, int worker, size_t begin, size_t end)
{
    const scan *job = context;
    const float background = job->view->grid->background;
    row low = row_of(background), high = low;
    choice finite = {0};
    (void)worker;
    for (size_t i = begin * GRID_VIEW_VOXELS; i < end * GRID_VIEW_VOXELS; i += FOUR) {
        const row v = row_at(job->view->grid->leaf_values + i);
        const choice usable = (v <= FLT_MAX) & (v >= -FLT_MAX);
        finite -= usable;
        low = choose(usable & (v < low), v, low);
        high = choose(usable & (v > high), v, high);
    }
    range r = {background, background, (end - begin) * GRID_VIEW_VOXELS};
    for (int k = 0; k < FOUR; k++) {
        r.lowest = fminf(r.lowest, low[k]);
        r.highest = fmaxf(r.highest, high[k]);
        r.not_finite -= (uint64_t)finite[k];
    }
    job->of_chunk[begin / LEAVES] = r;
}

static void widen(grid_view *l, float lowest, float highest)
{
    l->lowest = lowest < l->lowest ? lowest : l->lowest; /* comparisons with NaN are false */
    l->highest = highest > l->highest ? highest : l->highest;
}

static bool add_tiles(grid_view *l, size_t memory_limit, error *e)
{
    size_t counts[GRID_VIEW_TILE_LEVELS] = {0};
    for (size_t i = 0; i < l->grid->tile_count; i++) counts[level_of(l->grid->tiles[i].side)]++;
    for (int level = 0; level < GRID_VIEW_TILE_LEVELS; level++) {
        if (!block_map_init(&l->tiles[level], counts[level], e)) return false;
        l->tiles[level].limit = memory_limit / GRID_VIEW_TABLES;
        l->tile_values[level] = mem_array(counts[level], sizeof(float), "the tiles of the grid", e);
        if (!l->tile_values[level]) return false;
    }
    for (size_t i = 0; i < l->grid->tile_count; i++) {
        const vdb_tile *t = &l->grid->tiles[i];
        int level = level_of(t->side), shift = 3 + grid_view_tile_shift[level];
        uint32_t n;
        if (!block_map_find_or_add(&l->tiles[level], t->origin[0] >> shift, t->origin[1] >> shift,
                                   t->origin[2] >> shift, &n, e))
            return false;
        l->tile_values[level][n] = to_f(l, t->value);
        widen(l, t->value, t->value);
    }
    return true;
}

static bool add_leaves(grid_view *l, error *e)
{
    const vdb_grid *g = l->grid;
    if (!block_map_init(&l->leaves, g->leaf_count, e)) return false;
    for (size_t i = 0; i < g->leaf_count; i++) {
        const int32_t *o = g->leaf_origin[i];
        uint32_t n;
        if (!block_map_find_or_add(&l->leaves, o[0] >> 3, o[1] >> 3, o[2] >> 3, &n, e)) return false;
        if (n != i)
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "the volume has two leaves at (%d, %d, %d): it is damaged", o[0], o[1], o[2]);
    }
    return true;
}

/* Builds the tables of leaves and tiles while other threads read the values of leaves. */
typedef struct tables {
    grid_view *view;
    size_t memory_limit;
    bool ok;
    error *e;
} tables;

static void make_tables(void *context)
{
    tables *t = context;
    t->ok = add_leaves(t->view, t->e) && add_tiles(t->view, t->memory_limit, t->e);
}

static bool look_through(grid_view *l, size_t memory_limit, threads *pool, error *e)
{
    const vdb_grid *g = l->grid;
    const size_t chunks = (g->leaf_count + LEAVES - 1) / LEAVES;
    tables made = {l, memory_limit, false, e};
    scan job = {l, mem_array(chunks, sizeof *job.of_chunk, leaves, e)};
    if (!job.of_chunk) return false;
    l->lowest = l->highest = g->background;
    threads_run_beside(pool, make_tables, &made, g->leaf_count, LEAVES, range_chunk, &job);
    for (size_t k = 0; k < chunks; k++) {
        widen(l, job.of_chunk[k].lowest, job.of_chunk[k].highest);
        l->not_finite += job.of_chunk[k].not_finite;
    }
    free(job.of_chunk);
    if (!threads_may_go_on(pool, e)) return false;
    return made.ok;
}

/* Some writers leave clamped voxels active. Where values go beyond the background, the grid is not
 * clamped on that side (the whole inside may be filled), and then only the active state shows which voxels
 * are known. */
static void set_clamp(grid_view *l)
{
    float b = fabsf(l->grid->background);
    l->clamp_below = -INFINITY;
    l->clamp_above = INFINITY;
    if (l->kind != GRID_VIEW_LEVEL_SET || !(b > 0)) return;
    if (l->lowest >= -b * (1 + half_step)) l->clamp_below = -b * (1 - half_step);
    if (l->highest <= b * (1 + half_step)) l->clamp_above = b * (1 - half_step);
}

static void sign_chunk(void *context, int worker, size_t begin, size_t end)
{
    const scan *job = context;
    const grid_view *l = job->view;
    const float at = (float)l->isovalue; /* comparing floats with the rounded isovalue equals comparing F
                                          * with 0, see to_f */
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const float *values = l->grid->leaf_values + n * GRID_VIEW_VOXELS;
        grid_view_signs *s = &l->signs[n];
        for (int x = 0; x < GRID_VIEW_SIDE; x++) {
            uint64_t less = 0, more = 0, clamped = 0;
            for (int yz = 0; yz < 64; yz += FOUR) {
                const row v = row_at(values + 64 * x + yz);
                less |= bits_of(v < at) << yz;
                more |= bits_of(v > at) << yz;
                clamped |= bits_of((v <= l->clamp_below) | (v >= l->clamp_above)) << yz;
            }
            s->inside[x] = l->kind == GRID_VIEW_LEVEL_SET ? less : more;
            s->outside[x] = l->kind == GRID_VIEW_LEVEL_SET ? more : less;
            s->known[x] =
                l->kind == GRID_VIEW_FOG ? ~(uint64_t)0 : l->grid->leaf_active[8 * n + (size_t)x] & ~clamped;
        }
    }
}

bool grid_view_init(grid_view *l, const vdb_grid *grid, grid_view_kind kind, double isovalue,
                    size_t memory_limit, threads *pool, error *e)
{
    memset(l, 0, sizeof *l);
    l->grid = grid;
    l->kind = kind;
    l->isovalue = isovalue;
    l->plain = kind == GRID_VIEW_LEVEL_SET && isovalue == 0;
    l->background = to_f(l, grid->background);
    l->signs = mem_array(grid->leaf_count, sizeof *l->signs, leaves, e);
    const bool ok = l->signs && look_through(l, memory_limit, pool, e);
    if (ok) {
        set_clamp(l);
        scan job = {l, NULL};
        threads_run(pool, grid->leaf_count, LEAVES, sign_chunk, &job);
    } else {
        grid_view_free(l);
    }
    return ok;
}

void grid_view_free(grid_view *l)
{
    block_map_free(&l->leaves);
    free(l->signs);
    for (int level = 0; level < GRID_VIEW_TILE_LEVELS; level++) {
        block_map_free(&l->tiles[level]);
        free(l->tile_values[level]);
    }
    memset(l, 0, sizeof *l);
}

void grid_view_find_not_finite(const grid_view *l, int32_t at[3])
{
    bool found = false;
    for (size_t k = 0; k < l->grid->leaf_count * GRID_VIEW_VOXELS; k++) {
        if (isfinite(l->grid->leaf_values[k])) continue;
        const int32_t *o = l->grid->leaf_origin[k / GRID_VIEW_VOXELS], v = (int32_t)(k % GRID_VIEW_VOXELS),
                      here[3] = {o[0] + (v >> 6), o[1] + (v >> 3 & 7), o[2] + (v & 7)};
        bool before = !found;
        for (int axis = 0; axis < 3 && !before && here[axis] <= at[axis]; axis++)
            before = here[axis] < at[axis];
        if (before) memcpy(at, here, sizeof here);
        found = true;
    }
}

/* The value of the tile of this level or a larger one that the block lies in. */
static float constant_at(const grid_view *l, int level, int32_t x, int32_t y, int32_t z)
{
    for (; level < GRID_VIEW_TILE_LEVELS; level++) {
        if (l->tiles[level].count == 0) continue;
        int shift = grid_view_tile_shift[level];
        uint32_t n = block_map_find(&l->tiles[level], x >> shift, y >> shift, z >> shift);
        if (n != BLOCK_MAP_NONE) return l->tile_values[level][n];
    }
    return l->background;
}

grid_view_block grid_view_find(const grid_view *l, int32_t x, int32_t y, int32_t z)
{
    const uint32_t leaf = block_map_find(&l->leaves, x, y, z);
    return (grid_view_block){leaf, leaf == BLOCK_MAP_NONE ? constant_at(l, 0, x, y, z) : l->background};
}

void grid_view_around(const grid_view *l, const int32_t block[3], grid_view_block out[27])
{
    uint32_t leaf[27], tile[27];
    block_map_around(&l->leaves, block, leaf);
    block_map_around(&l->tiles[0], block, tile);
    for (int k = 0; k < 27; k++) {
        out[k] = (grid_view_block){leaf[k], l->background};
        if (leaf[k] != BLOCK_MAP_NONE) continue;
        out[k].constant =
            tile[k] != BLOCK_MAP_NONE
                ? l->tile_values[0][tile[k]]
                : constant_at(l, 1, block[0] + k / 9 - 1, block[1] + k / 3 % 3 - 1, block[2] + k % 3 - 1);
    }
}

void grid_view_read(const grid_view *l, grid_view_block b, float f[GRID_VIEW_VOXELS])
{
    const float *values = l->grid->leaf_values + (size_t)b.leaf * GRID_VIEW_VOXELS;
    const bool is_leaf = b.leaf != BLOCK_MAP_NONE;
    for (int k = 0; k < GRID_VIEW_VOXELS; k++) f[k] = is_leaf ? to_f(l, values[k]) : b.constant;
}

const grid_view_signs *grid_view_find_signs(const grid_view *l, grid_view_block b, grid_view_signs *constant)
{
    if (b.leaf != BLOCK_MAP_NONE) return &l->signs[b.leaf];
    memset(constant->inside, b.constant < 0 ? 0xFF : 0, sizeof constant->inside);
    memset(constant->outside, b.constant > 0 ? 0xFF : 0, sizeof constant->outside);
    memset(constant->known, l->kind == GRID_VIEW_FOG ? 0xFF : 0, sizeof constant->known);
    return constant;
}
