#include "volume/grid_view.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* Half floats carry 11 bits: a stored clamp may differ from the background by this part of it. */
static const float half_step = 1.0f / 1024;

static const int tile_shift[GRID_VIEW_TILE_LEVELS] = {0, 4, 9}; /* block coordinates to the tile's */

/* A value that the isovalue means, as far as floats tell, is on it. */
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

static void scan_range(grid_view *l)
{
    const vdb_grid *g = l->grid;
    l->lowest = l->highest = g->background;
    for (size_t i = 0; i < g->tile_count; i++) {
        l->lowest = fminf(l->lowest, g->tiles[i].value);
        l->highest = fmaxf(l->highest, g->tiles[i].value);
    }
    for (size_t i = 0; i < g->leaf_count * GRID_VIEW_VOXELS; i++) {
        float v = g->leaf_values[i];
        if (!isfinite(v)) {
            l->not_finite++;
            continue;
        }
        l->lowest = fminf(l->lowest, v);
        l->highest = fmaxf(l->highest, v);
    }
}

/* Some writers leave clamped voxels active. Where values go beyond the background, the grid is not
 * clamped on that side (the whole inside may be filled), and then only activity tells. */
static void set_clamp(grid_view *l)
{
    float b = fabsf(l->grid->background);
    l->clamp_below = -INFINITY;
    l->clamp_above = INFINITY;
    if (l->kind != GRID_VIEW_LEVEL_SET || !(b > 0)) return;
    if (l->lowest >= -b * (1 + half_step)) l->clamp_below = -b * (1 - half_step);
    if (l->highest <= b * (1 + half_step)) l->clamp_above = b * (1 - half_step);
}

static bool add_tiles(grid_view *l, error *e)
{
    size_t counts[GRID_VIEW_TILE_LEVELS] = {0};
    for (size_t i = 0; i < l->grid->tile_count; i++) counts[level_of(l->grid->tiles[i].side)]++;
    for (int level = 0; level < GRID_VIEW_TILE_LEVELS; level++) {
        if (!block_map_init(&l->tiles[level], counts[level], e)) return false;
        l->tile_values[level] = mem_array(counts[level], sizeof(float), "the tiles of the grid", e);
        if (!l->tile_values[level]) return false;
    }
    for (size_t i = 0; i < l->grid->tile_count; i++) {
        const vdb_tile *t = &l->grid->tiles[i];
        int level = level_of(t->side), shift = 3 + tile_shift[level];
        uint32_t n;
        if (!block_map_find_or_add(&l->tiles[level], t->origin[0] >> shift, t->origin[1] >> shift,
                                   t->origin[2] >> shift, &n, e))
            return false;
        l->tile_values[level][n] = to_f(l, t->value);
    }
    return true;
}

bool grid_view_init(grid_view *l, const vdb_grid *grid, grid_view_kind kind, double isovalue, error *e)
{
    memset(l, 0, sizeof *l);
    l->grid = grid;
    l->kind = kind;
    l->isovalue = isovalue;
    scan_range(l);
    set_clamp(l);
    l->background = to_f(l, grid->background);
    if (!block_map_init(&l->leaves, grid->leaf_count, e) || !add_tiles(l, e)) {
        grid_view_free(l);
        return false;
    }
    for (size_t i = 0; i < grid->leaf_count; i++) {
        const int32_t *o = grid->leaf_origin[i];
        uint32_t n;
        if (!block_map_find_or_add(&l->leaves, o[0] >> 3, o[1] >> 3, o[2] >> 3, &n, e)) {
            grid_view_free(l);
            return false;
        }
        if (n != i) {
            grid_view_free(l);
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "the volume has two leaves at (%d, %d, %d): it is damaged", o[0], o[1], o[2]);
        }
    }
    return true;
}

void grid_view_free(grid_view *l)
{
    block_map_free(&l->leaves);
    for (int level = 0; level < GRID_VIEW_TILE_LEVELS; level++) {
        block_map_free(&l->tiles[level]);
        free(l->tile_values[level]);
    }
    memset(l, 0, sizeof *l);
}

grid_view_block grid_view_find(const grid_view *l, int32_t x, int32_t y, int32_t z)
{
    grid_view_block b = {block_map_find(&l->leaves, x, y, z), l->background};
    for (int level = 0; b.leaf == BLOCK_MAP_NONE && level < GRID_VIEW_TILE_LEVELS; level++) {
        if (l->tiles[level].count == 0) continue;
        int shift = tile_shift[level];
        uint32_t n = block_map_find(&l->tiles[level], x >> shift, y >> shift, z >> shift);
        if (n == BLOCK_MAP_NONE) continue;
        b.constant = l->tile_values[level][n];
        break;
    }
    return b;
}

unsigned grid_view_read_row(const grid_view *l, grid_view_block b, int x, int y, int count, float *f)
{
    const unsigned all = (1u << count) - 1;
    if (b.leaf == BLOCK_MAP_NONE) {
        for (int z = 0; z < count; z++) f[z] = b.constant;
        return l->kind == GRID_VIEW_FOG ? all : 0;
    }
    const float *values = l->grid->leaf_values + (size_t)b.leaf * GRID_VIEW_VOXELS + 64 * x + 8 * y;
    for (int z = 0; z < count; z++) f[z] = to_f(l, values[z]);
    if (l->kind == GRID_VIEW_FOG) return all;
    unsigned known = (unsigned)(l->grid->leaf_active[(size_t)b.leaf * 8 + (size_t)x] >> (8 * y)) & all;
    for (int z = 0; z < count && l->kind == GRID_VIEW_LEVEL_SET; z++)
        known &= ~((unsigned)(values[z] <= l->clamp_below || values[z] >= l->clamp_above) << z);
    return known;
}

void grid_view_read(const grid_view *l, grid_view_block b, float f[GRID_VIEW_VOXELS],
                    uint64_t known[GRID_VIEW_SIDE])
{
    for (int x = 0; x < GRID_VIEW_SIDE; x++) {
        known[x] = 0;
        for (int y = 0; y < GRID_VIEW_SIDE; y++)
            known[x] |= (uint64_t)grid_view_read_row(l, b, x, y, GRID_VIEW_SIDE, f + 64 * x + 8 * y)
                        << (8 * y);
    }
}
