// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/dense_grid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/volume/samples.h"

#define SIDE VDB_LEAF_SIDE

/* Bits of a sample: it is inside; its value is above DENSE_GRID_LARGEST. */
enum { INSIDE = 1, BEYOND = 2 };
/* Fraction of the cells that may have a corner beyond: single defects inside a solid. */
static const double MOST_BEYOND = 0.01;
/* Number of blocks kept around a crossed one: volume.c reads 13 voxels around crossed cells. */
enum { AROUND = 2 };

static const uint32_t NONE = UINT32_MAX;

typedef struct work {
    slices *source;
    threads *pool; /* for its flag to stop */
    double isovalue, no_data;
    double on; /* the isovalue in the type of the file: the nearest float */
    int64_t size[3];
    int64_t blocks[3];      /* along each axis, with AROUND at both ends */
    int64_t stride;         /* of a row of `inside`; rows end with zeros, so that whole words can be read */
    double *values;         /* one slice */
    uint8_t *inside[2];     /* two slices: INSIDE where the value is above the isovalue, and BEYOND */
    uint64_t cells, beyond; /* crossed ones, and those of them with a corner that is BEYOND */
    thin_walls_search *walls;
    uint32_t *number; /* per block: first 1 if it is crossed; then the index of its leaf, or NONE */
    vdb_grid *grid;
} work;

/* Index of a block; coordinates start at -AROUND, the third axis is fastest. */
static size_t block_at(const work *w, int64_t x, int64_t y, int64_t z)
{
    return (size_t)(((x + AROUND) * w->blocks[1] + y + AROUND) * w->blocks[2] + z + AROUND);
}

static bool begin(work *w, size_t memory_limit, error *e)
{
    double cells = 1, slice = (double)w->size[0] * (double)w->size[1];
    for (int k = 0; k < 3; k++) {
        w->blocks[k] = (w->size[k] + SIDE - 1) / SIDE + 2 * AROUND;
        cells *= (double)w->blocks[k];
    }
    w->stride = w->size[0] + 2 * SIDE;
    double needed = slice * sizeof(double) + 2 * (double)w->stride * (double)w->size[1] +
                    cells * sizeof(uint32_t) + (double)thin_walls_bytes(w->size[0], w->size[1]);
    if (needed > (double)memory_limit)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "its %lld x %lld x %lld samples require %.0f MiB for a few slices and the table of "
                         "blocks, and %zu MiB of the limit are left: raise limits.memory_mb by at least %.0f",
                         (long long)w->size[0], (long long)w->size[1], (long long)w->size[2],
                         ceil(needed / (1 << 20)), memory_limit >> 20,
                         ceil((needed - (double)memory_limit) / (1 << 20)));
    size_t row = (size_t)(w->stride * w->size[1]);
    w->values = mem_array((size_t)slice, sizeof(double), "a slice of the volume", e);
    w->inside[0] = mem_array(row, 1, "a slice of the volume", e);
    w->inside[1] = mem_array(row, 1, "a slice of the volume", e);
    w->number = mem_array((size_t)cells, sizeof *w->number, "the table of blocks", e);
    w->walls = thin_walls_begin(w->size[0], w->size[1], e);
    return w->values && w->inside[0] && w->inside[1] && w->number && w->walls;
}

static void end(work *w)
{
    free(w->values);
    free(w->inside[0]);
    free(w->inside[1]);
    free(w->number);
    thin_walls_end(w->walls);
}

/* ---- first pass: finds crossed blocks */

/* Whether the value means that there are no data: files may have it as a float. */
static bool is_no_data(const work *w, double value)
{
    return value == w->no_data || value == (double)(float)w->no_data;
}

static void note_values(const work *w, int64_t z, uint8_t *inside, dense_grid_facts *facts)
{
    for (int64_t y = 0; y < w->size[1] && !threads_stopped(w->pool); y++) {
        const double *row = w->values + y * w->size[0];
        uint8_t *bits = inside + y * w->stride;
        for (int64_t x = 0; x < w->size[0]; x++) {
            const bool is_missing = is_no_data(w, row[x]);
            bits[x] = is_missing || !(row[x] > w->isovalue) || row[x] == w->on ? 0
                      : row[x] > DENSE_GRID_LARGEST                            ? INSIDE | BEYOND
                                                                               : INSIDE;
            if (is_missing) {
                facts->missing++;
            } else if (fabs(row[x]) <= DENSE_GRID_LARGEST) {
                facts->lowest = fmin(facts->lowest, row[x]);
                facts->highest = fmax(facts->highest, row[x]);
            } else if (facts->unusable++ == 0) {
                memcpy(facts->unusable_at, (const int64_t[3]){x, y, z}, sizeof facts->unusable_at);
            }
        }
    }
}

static uint64_t word_at(const uint8_t *bytes)
{
    uint64_t word;
    memcpy(&word, bytes, sizeof word);
    return word;
}

/* Marks the blocks that have crossed cells between slices z and z + 1. */
static void mark_layer(work *w, int64_t z)
{
    for (int64_t y = 0; y + 1 < w->size[1] && !threads_stopped(w->pool); y++)
        for (int64_t x = 0; x + 1 < w->size[0]; x += SIDE) {
            uint64_t any = 0, all = ~(uint64_t)0;
            for (int k = 0; k < 8; k++) {
                uint64_t word = word_at(w->inside[k & 1] + (y + (k >> 1 & 1)) * w->stride + x + (k >> 2));
                any |= word;
                all &= word;
            }
            int64_t cells = w->size[0] - 1 - x;
            uint64_t valid =
                cells < SIDE ? ((uint64_t)1 << (SIDE * cells)) - 1 : ~(uint64_t)0; /* little-endian */
            const uint64_t crossed = (any ^ all) & valid & UINT64_C(0x0101010101010101) * INSIDE;
            w->cells += (uint64_t)__builtin_popcountll(crossed);
            w->beyond += (uint64_t)__builtin_popcountll(crossed & any >> 1);
            if (crossed) w->number[block_at(w, x / SIDE, y / SIDE, z / SIDE)] = 1;
        }
}

static bool find_blocks(work *w, dense_grid_facts *facts, error *e)
{
    *facts = (dense_grid_facts){.lowest = INFINITY, .highest = -INFINITY};
    for (int64_t z = 0; z < w->size[2]; z++) {
        uint8_t *before = w->inside[0];
        w->inside[0] = w->inside[1];
        w->inside[1] = before;
        if (!w->source->ops->read(w->source, z, w->values, e)) return false;
        note_values(w, z, w->inside[1], facts);
        thin_walls_add(w->walls, w->values, w->isovalue, w->no_data);
        if (z > 0) mark_layer(w, z - 1);
        if (!threads_may_go_on(w->pool, e)) return false;
    }
    facts->walls = thin_walls_take(w->walls);
    return true;
}

/* Numbers the blocks to keep; returns their number. */
static size_t number_blocks(work *w)
{
    enum { CROSSED = 1, NEAR = 2 };
    size_t all = (size_t)(w->blocks[0] * w->blocks[1] * w->blocks[2]), count = 0;
    const size_t step = (size_t)w->blocks[2], leap = step * (size_t)w->blocks[1];
    for (size_t k = 0; k < all; k++) {
        if (w->number[k] != CROSSED) continue; /* at least AROUND from every end of the table */
        size_t low = k - AROUND * (leap + step + 1);
        for (size_t x = 0; x <= 2 * AROUND; x++)
            for (size_t y = 0; y <= 2 * AROUND; y++)
                for (size_t z = 0; z <= 2 * AROUND; z++) {
                    uint32_t *near = &w->number[low + x * leap + y * step + z];
                    if (*near == 0) *near = NEAR;
                }
    }
    for (size_t k = 0; k < all; k++) w->number[k] = w->number[k] ? (uint32_t)count++ : NONE;
    return count;
}

/* ---- second pass: fills leaves */

static bool make_leaves(work *w, size_t count, size_t memory_limit, error *e)
{
    size_t leaf = SIDE * sizeof(uint64_t) + VDB_LEAF_VOXELS * sizeof(float) + sizeof(int32_t[3]);
    size_t needed = count * leaf + samples_bytes(count, false);
    if (needed > memory_limit)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "the volume requires %zu MiB for the %zu blocks around its surface, and %zu MiB of "
                         "the limit are left: raise limits.memory_mb by at least %zu",
                         (needed >> 20) + 1, count, memory_limit >> 20, ((needed - memory_limit) >> 20) + 1);
    vdb_grid *g = w->grid = mem_alloc(sizeof *g);
    g->grid_class = VDB_FOG;
    g->zero = w->isovalue;
    memcpy(g->index_to_world, w->source->index_to_world, sizeof g->index_to_world);
    g->active_voxels = (uint64_t)w->size[0] * (uint64_t)w->size[1] * (uint64_t)w->size[2];
    g->leaf_count = count;
    g->leaf_origin = mem_array(count, sizeof *g->leaf_origin, "the blocks around the surface", e);
    g->leaf_values = mem_array(count * VDB_LEAF_VOXELS, sizeof(float), "the blocks around the surface", e);
    g->leaf_active = mem_array(count * SIDE, sizeof(uint64_t), "the blocks around the surface", e);
    if (!g->leaf_origin || !g->leaf_values || !g->leaf_active) return false;
    for (int32_t x = 0; x < w->blocks[0]; x++)
        for (int32_t y = 0; y < w->blocks[1]; y++)
            for (int32_t z = 0; z < w->blocks[2]; z++) {
                uint32_t n = w->number[block_at(w, x - AROUND, y - AROUND, z - AROUND)];
                const int32_t origin[3] = {(x - AROUND) * SIDE, (y - AROUND) * SIDE, (z - AROUND) * SIDE};
                if (n != NONE) memcpy(g->leaf_origin[n], origin, sizeof origin);
            }
    return true;
}

static int64_t least(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static float level_of(const work *w, double value)
{
    return value == w->on ? 0 : (float)(value - w->isovalue);
}

/* Copies slice z to the leaves of its layer. */
static void keep_slice(work *w, int64_t z, const dense_grid_facts *facts)
{
    vdb_grid *g = w->grid;
    for (int64_t x = 0; x < w->size[0] && !threads_stopped(w->pool); x += SIDE)
        for (int64_t y = 0; y < w->size[1]; y += SIDE) {
            uint32_t n = w->number[block_at(w, x / SIDE, y / SIDE, z / SIDE)];
            if (n == NONE) continue;
            for (int64_t i = x; i < least(x + SIDE, w->size[0]); i++)
                for (int64_t j = y; j < least(y + SIDE, w->size[1]); j++) {
                    double value = w->values[j * w->size[0] + i];
                    int bit = 8 * (int)(j & 7) + (int)(z & 7);
                    if (is_no_data(w, value))
                        value = facts->lowest;
                    else if (!(fabs(value) <= DENSE_GRID_LARGEST))
                        value = value > 0 ? facts->highest : facts->lowest;
                    g->leaf_values[(size_t)n * VDB_LEAF_VOXELS + 64 * (size_t)(i & 7) + (size_t)bit] =
                        level_of(w, value);
                    g->leaf_active[(size_t)n * SIDE + (size_t)(i & 7)] |= (uint64_t)1 << bit;
                }
        }
}

static bool fill_leaves(work *w, const dense_grid_facts *facts, error *e)
{
    for (int64_t z = 0; z < w->size[2]; z++) {
        if (!w->source->ops->read(w->source, z, w->values, e)) return false;
        keep_slice(w, z, facts);
        if (!threads_may_go_on(w->pool, e)) return false;
    }
    return true;
}

/* The extrapolated value of a voxel near the data. False: no leaf has the values that it depends on. */
static bool extrapolate(const work *w, const int64_t at[3], double *value)
{
    for (int axis = 0; axis < 3; axis++) {
        int64_t last = w->size[axis] - 1, end = at[axis] < 0 ? 0 : last;
        if (at[axis] >= 0 && at[axis] <= last) continue;
        int64_t edge[3] = {at[0], at[1], at[2]}, mirror[3] = {at[0], at[1], at[2]};
        double there, back;
        edge[axis] = end;
        mirror[axis] = 2 * end - at[axis];
        if (mirror[axis] < 0 || mirror[axis] > last)
            mirror[axis] = last - end; /* a volume thinner than the distance */
        if (!extrapolate(w, edge, &there)) return false;
        *value = extrapolate(w, mirror, &back) ? 2 * there - back : there;
        return true;
    }
    uint32_t n = w->number[block_at(w, at[0] / SIDE, at[1] / SIDE, at[2] / SIDE)];
    if (n == NONE) return false;
    size_t voxel = (size_t)(64 * (at[0] & 7) + 8 * (at[1] & 7) + (at[2] & 7));
    *value = (double)w->grid->leaf_values[(size_t)n * VDB_LEAF_VOXELS + voxel];
    return true;
}

static void continue_leaves(work *w, const dense_grid_facts *facts)
{
    vdb_grid *g = w->grid;
    for (size_t n = 0; n < g->leaf_count && !threads_stopped(w->pool); n++)
        for (int k = 0; k < VDB_LEAF_VOXELS; k++) {
            if (g->leaf_active[n * SIDE + (size_t)(k >> 6)] >> (k & 63) & 1) continue;
            const int32_t *origin = g->leaf_origin[n];
            const int64_t at[3] = {origin[0] + (k >> 6), origin[1] + (k >> 3 & 7), origin[2] + (k & 7)};
            double value = (double)level_of(w, facts->lowest);
            extrapolate(w, at, &value);
            g->leaf_values[n * VDB_LEAF_VOXELS + (size_t)k] = (float)value;
        }
}

static bool check_surface(const work *w, size_t leaves, const dense_grid_facts *facts, error *e)
{
    if (facts->highest > w->isovalue && (double)w->beyond > MOST_BEYOND * (double)w->cells)
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "%.3g %% of its surface lies beside values beyond %g, the first unusable one at (%lld, %lld, "
            "%lld): if they mean that there are no data, give the value as no_data; otherwise replace them",
            100 * (double)w->beyond / (double)w->cells, DENSE_GRID_LARGEST, (long long)facts->unusable_at[0],
            (long long)facts->unusable_at[1], (long long)facts->unusable_at[2]);
    if (leaves > 0) return true;
    if (!(facts->lowest <= facts->highest))
        return error_set(e, ERROR_NO_SURFACE, "the volume has no finite value: correct the file");
    if (facts->lowest == facts->highest)
        return error_set(e, ERROR_NO_SURFACE, "all values of the volume are %g: give another volume",
                         facts->lowest);
    return error_set(e, ERROR_NO_SURFACE,
                     "the volume has no surface at isovalue %g: choose an isovalue above its lowest "
                     "value, %g, and below its highest, %g",
                     w->isovalue, facts->lowest, facts->highest);
}

vdb_grid *dense_grid_make(slices *s, double isovalue, double no_data, size_t memory_limit, threads *pool,
                          dense_grid_facts *facts, error *e)
{
    work w = {.source = s,
              .pool = pool,
              .isovalue = isovalue,
              .no_data = no_data,
              .on = s->fine ? isovalue : (double)(float)isovalue};
    memcpy(w.size, s->size, sizeof w.size);
    size_t leaves = 0;
    bool ok = begin(&w, memory_limit, e) && find_blocks(&w, facts, e);
    if (ok) leaves = number_blocks(&w);
    ok = ok && check_surface(&w, leaves, facts, e) && make_leaves(&w, leaves, memory_limit, e) &&
         fill_leaves(&w, facts, e);
    if (ok) {
        continue_leaves(&w, facts);
        w.grid->background = level_of(&w, facts->lowest);
    }
    ok = ok && threads_may_go_on(w.pool, e);
    end(&w);
    if (ok) return w.grid;
    vdb_grid_free(w.grid);
    return NULL;
}
