#include "volume/crossings.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

#define CORNERS 9 /* of the cells of a block, along an axis */

enum { BLOCKS = 256 }; /* in a chunk of work */

/* Index coordinates this near to the limits of int32 would overflow in the neighbours of a block. */
static const int32_t farthest_block = (1 << 28) - 16;

void crossings_free(crossings *c)
{
    free(c->blocks);
    memset(c, 0, sizeof *c);
}

static bool append(crossings *c, const crossing_block *b, error *e)
{
    crossing_block *blocks = mem_grow(c->blocks, c->count, &c->room, 256, sizeof *blocks,
                                      "the blocks that the surface crosses", e);
    if (!blocks) return false;
    c->blocks = blocks;
    c->blocks[c->count++] = *b;
    return true;
}

/* Of four rows of corners around a row of cells, bit z for cell z. */
static unsigned some(const uint16_t *rows)
{
    unsigned r = rows[0] | rows[1] | rows[CORNERS] | rows[CORNERS + 1];
    return (r | r >> 1) & 0xFF;
}

static unsigned all(const uint16_t *rows)
{
    unsigned r = rows[0] & rows[1] & rows[CORNERS] & rows[CORNERS + 1];
    return r & r >> 1 & 0xFF;
}

static void note_open(crossings *c, const int32_t block[3], int x, int y, unsigned bits)
{
    if (c->open_cells == 0) {
        c->open_at[0] = block[0] * GRID_VIEW_SIDE + x;
        c->open_at[1] = block[1] * GRID_VIEW_SIDE + y;
        c->open_at[2] = block[2] * GRID_VIEW_SIDE + __builtin_ctz(bits);
    }
    c->open_cells += (unsigned)__builtin_popcount(bits);
}

bool crossings_add(crossings *c, const int32_t block[3], const float corners[729], const uint16_t *known,
                   error *e)
{
    uint16_t inside[CORNERS * CORNERS], outside[CORNERS * CORNERS];
    for (int row = 0; row < CORNERS * CORNERS; row++) {
        unsigned below = 0, above = 0;
        for (int z = 0; z < CORNERS; z++) {
            below |= (unsigned)(corners[row * CORNERS + z] < 0) << z;
            above |= (unsigned)(corners[row * CORNERS + z] > 0) << z;
        }
        inside[row] = (uint16_t)below;
        outside[row] = (uint16_t)above;
    }
    crossing_block b = {.block = {block[0], block[1], block[2]}};
    uint64_t cells = 0;
    for (int x = 0; x < GRID_VIEW_SIDE; x++)
        for (int y = 0; y < GRID_VIEW_SIDE; y++) {
            const int row = CORNERS * x + y;
            unsigned bits = some(inside + row) & ~all(inside + row);
            if (c->known_only) bits &= all(known + row);
            if (!bits) continue;
            for (int axis = 0; axis < 3; axis++)
                if (block[axis] > farthest_block || block[axis] < -farthest_block)
                    return error_set(
                        e, ERROR_INPUT_UNSUPPORTED,
                        "the volume has its surface at the limits of 32-bit index coordinates, near voxel "
                        "%lld along axis %d: move the grid nearer to its origin",
                        (long long)block[axis] * GRID_VIEW_SIDE, axis);
            unsigned open = known ? bits & ~all(known + row) : 0;
            if (open) note_open(c, block, x, y, open);
            b.rows[GRID_VIEW_SIDE * x + y] = (uint8_t)bits;
            b.flat |= (bits & ~some(outside + row)) != 0;
            cells += (unsigned)__builtin_popcount(bits);
        }
    c->cells += cells;
    return cells == 0 || append(c, &b, e);
}

/* Of a block or a neighbour above it the part that the block's cells touch: one layer where `upper` says so. */
static void read_part(const grid_view *l, grid_view_block from, const int upper[3], float *corners,
                      uint16_t *known)
{
    const int nx = upper[0] ? 1 : GRID_VIEW_SIDE, ny = upper[1] ? 1 : GRID_VIEW_SIDE,
              nz = upper[2] ? 1 : GRID_VIEW_SIDE;
    for (int x = 0; x < nx; x++)
        for (int y = 0; y < ny; y++) {
            const int row = CORNERS * (x + GRID_VIEW_SIDE * upper[0]) + y + GRID_VIEW_SIDE * upper[1];
            unsigned bits =
                grid_view_read_row(l, from, x, y, nz, corners + CORNERS * row + GRID_VIEW_SIDE * upper[2]);
            known[row] = (uint16_t)(known[row] | bits << (GRID_VIEW_SIDE * upper[2]));
        }
}

static bool look_at(const grid_view *l, const int32_t block[3], crossings *out, error *e)
{
    grid_view_block near[8];
    bool leaf = false, inside = false, outside = false;
    for (int k = 0; k < 8; k++) {
        near[k] = grid_view_find(l, block[0] + (k & 1), block[1] + (k >> 1 & 1), block[2] + (k >> 2));
        if (near[k].leaf != BLOCK_MAP_NONE)
            leaf = true;
        else if (near[k].constant < 0)
            inside = true;
        else
            outside = true;
    }
    if (!leaf && !(inside && outside)) return true;
    float corners[CORNERS * CORNERS * CORNERS];
    uint16_t known[CORNERS * CORNERS] = {0};
    for (int k = 0; k < 8; k++) {
        const int upper[3] = {k & 1, k >> 1 & 1, k >> 2};
        read_part(l, near[k], upper, corners, known);
    }
    return crossings_add(out, block, corners, known, e);
}

/* The blocks whose cells touch a face of a tile: in each axis the layer below it and its last one. */
static bool add_shell(const vdb_tile *t, size_t most, block_map *candidates, error *e)
{
    int32_t low[3], side = t->side / GRID_VIEW_SIDE;
    for (int axis = 0; axis < 3; axis++) low[axis] = (t->origin[axis] >> 3) - 1;
    for (int32_t x = 0; x <= side; x++)
        for (int32_t y = 0; y <= side; y++) {
            bool edge = x == 0 || x == side || y == 0 || y == side;
            for (int32_t z = 0; z <= side; z += edge ? 1 : side)
                if (!block_map_find_or_add(candidates, low[0] + x, low[1] + y, low[2] + z, NULL, e))
                    return false;
        }
    if (candidates->count > most)
        return error_set(
            e, ERROR_LIMIT_MEMORY,
            "the faces of its tiles touch more than %zu blocks, too many for the memory limit: raise "
            "limits.memory_mb",
            most);
    return true;
}

static bool add_candidates(const grid_view *l, size_t memory_limit, block_map *candidates, error *e)
{
    for (uint32_t n = 0; n < l->leaves.count; n++) {
        const int32_t *b = l->leaves.blocks[n];
        for (int k = 0; k < 8; k++)
            if (!block_map_find_or_add(candidates, b[0] - (k & 1), b[1] - (k >> 1 & 1), b[2] - (k >> 2), NULL,
                                       e))
                return false;
    }
    /* The table doubles when it grows, and old and new exist side by side then. */
    size_t most = memory_limit / (3 * block_map_bytes(1024) / 1024);
    bool background_inside = l->background < 0;
    for (size_t i = 0; i < l->grid->tile_count; i++) {
        const vdb_tile *t = &l->grid->tiles[i];
        const int32_t *o = t->origin;
        /* A tile on the background's side matters only beside leaves and other tiles, which count. */
        bool tile_inside = grid_view_find(l, o[0] >> 3, o[1] >> 3, o[2] >> 3).constant < 0;
        if (tile_inside == background_inside) continue;
        if (!add_shell(t, most, candidates, e)) return false;
    }
    return true;
}

static int by_place(const void *a, const void *b)
{
    const int32_t *p = ((const crossing_block *)a)->block, *q = ((const crossing_block *)b)->block;
    for (int axis = 0; axis < 3; axis++)
        if (p[axis] != q[axis]) return p[axis] < q[axis] ? -1 : 1;
    return 0;
}

typedef struct search {
    const grid_view *from;
    const block_map *candidates;
    crossings *found; /* of each chunk */
    error *fault;     /* likewise; of those without one the code is OK */
} search;

static void search_chunk(void *context, int worker, size_t begin, size_t end)
{
    const search *job = context;
    const size_t chunk = begin / BLOCKS;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        if (!look_at(job->from, job->candidates->blocks[n], &job->found[chunk], &job->fault[chunk])) return;
}

/* What the chunks found, in their order. */
static bool gather(crossings *parts, const error *fault, size_t count, crossings *out, error *e)
{
    size_t blocks = 0;
    for (size_t k = 0; k < count; k++) {
        if (fault[k].code != ERROR_NONE) {
            *e = fault[k];
            return false;
        }
        if (out->open_cells == 0) memcpy(out->open_at, parts[k].open_at, sizeof out->open_at);
        out->open_cells += parts[k].open_cells;
        out->cells += parts[k].cells;
        blocks += parts[k].count;
    }
    out->blocks = mem_array(blocks, sizeof *out->blocks, "the blocks that the surface crosses", e);
    if (!out->blocks) return false;
    for (size_t k = 0; k < count; k++) {
        if (parts[k].count)
            memcpy(out->blocks + out->count, parts[k].blocks, parts[k].count * sizeof *out->blocks);
        out->count += parts[k].count;
        crossings_free(&parts[k]);
    }
    out->room = out->count;
    if (out->count) qsort(out->blocks, out->count, sizeof *out->blocks, by_place);
    return true;
}

bool crossings_find(const grid_view *l, size_t memory_limit, threads *pool, crossings *out, error *e)
{
    const char *what = "the blocks that the surface crosses";
    block_map candidates;
    search job = {l, &candidates, NULL, NULL};
    crossings found = {.known_only = l->kind == GRID_VIEW_DENSE};
    bool ok = block_map_init(&candidates, 2 * (size_t)l->leaves.count, e) &&
              add_candidates(l, memory_limit, &candidates, e);
    const size_t chunks = (candidates.count + BLOCKS - 1) / BLOCKS;
    if (ok) {
        job.found = mem_array(chunks, sizeof *job.found, what, e);
        job.fault = mem_array(chunks, sizeof *job.fault, what, e);
        ok = job.found && job.fault;
    }
    if (ok) {
        for (size_t k = 0; k < chunks; k++) job.found[k].known_only = found.known_only;
        threads_run(pool, candidates.count, BLOCKS, search_chunk, &job);
        ok = gather(job.found, job.fault, chunks, &found, e);
    }
    for (size_t k = 0; job.found && k < chunks; k++) crossings_free(&job.found[k]);
    free(job.found);
    free(job.fault);
    block_map_free(&candidates);
    if (ok)
        *out = found;
    else
        crossings_free(&found);
    return ok;
}

#define AROUND (GRID_VIEW_SIDE + 3) /* voxels along an axis of a block's cells, with one more on each side */

/* F from one voxel below the block to two above it: +1, 0 or -1 for its sign. */
static void read_signs(const grid_view *l, const int32_t block[3], int8_t signs[AROUND][AROUND][AROUND])
{
    for (int n = 0; n < 27; n++) {
        const int step[3] = {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1};
        float f[GRID_VIEW_VOXELS];
        uint64_t known[GRID_VIEW_SIDE];
        grid_view_read(l, grid_view_find(l, block[0] + step[0], block[1] + step[1], block[2] + step[2]), f,
                       known);
        for (int k = 0; k < GRID_VIEW_VOXELS; k++) {
            const int x = GRID_VIEW_SIDE * step[0] + (k >> 6) + 1,
                      y = GRID_VIEW_SIDE * step[1] + (k >> 3 & 7) + 1,
                      z = GRID_VIEW_SIDE * step[2] + (k & 7) + 1;
            if (x < 0 || y < 0 || z < 0 || x >= AROUND || y >= AROUND || z >= AROUND) continue;
            signs[x][y][z] = (int8_t)((f[k] > 0) - (f[k] < 0));
        }
    }
}

static bool is_plateau(int8_t signs[AROUND][AROUND][AROUND], int x, int y, int z)
{
    for (int k = 0; k < 64; k++)
        if (signs[x + (k >> 4)][y + (k >> 2 & 3)][z + (k & 3)] > 0) return false;
    return true;
}

uint64_t crossings_count_plateau(const grid_view *l, const crossings *c)
{
    uint64_t count = 0;
    for (size_t n = 0; n < c->count; n++) {
        const crossing_block *b = &c->blocks[n];
        int8_t signs[AROUND][AROUND][AROUND];
        if (!b->flat) continue;
        read_signs(l, b->block, signs);
        for (int k = 0; k < GRID_VIEW_VOXELS; k++)
            if (b->rows[k >> 3] >> (k & 7) & 1) count += is_plateau(signs, k >> 6, k >> 3 & 7, k & 7);
    }
    return count;
}
