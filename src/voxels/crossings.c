#include "voxels/crossings.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"

enum { BLOCKS = 256, TILES = 1024 }; /* in a chunk of work */

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

/* The corners of a layer as the cells (y, z) have them: their own, and those one farther along y, z and both. */
typedef struct beside {
    uint64_t own, y, z, yz;
} beside;

ISA_INLINE beside corners_of(const corner_bits *c, int x)
{
    const uint64_t low = 0x0101010101010101u;
    beside b = {.own = c->at[0][x]};
    const uint64_t upper = (c->at[2][x] & low) >> 8 | c->at[3][x] << 56; /* z = 8, from y = 1 on */
    b.y = b.own >> 8 | c->at[1][x] << 56;
    b.z = (b.own >> 1 & ~(low << 7)) | (c->at[2][x] & low) << 7;
    b.yz = (b.y >> 1 & ~(low << 7)) | (upper & low) << 7;
    return b;
}

/* Whether some and whether all of a layer's corners of each cell are so. */
ISA_INLINE uint64_t some(const corner_bits *c, int x)
{
    const beside b = corners_of(c, x);
    return b.own | b.y | b.z | b.yz;
}

ISA_INLINE uint64_t all(const corner_bits *c, int x)
{
    const beside b = corners_of(c, x);
    return b.own & b.y & b.z & b.yz;
}

static void note_open(crossings *c, const int32_t block[3], int x, uint64_t bits)
{
    if (c->open_cells == 0) {
        const int first = __builtin_ctzll(bits);
        c->open_at[0] = block[0] * GRID_VIEW_SIDE + x;
        c->open_at[1] = block[1] * GRID_VIEW_SIDE + (first >> 3);
        c->open_at[2] = block[2] * GRID_VIEW_SIDE + (first & 7);
    }
    c->open_cells += (unsigned)__builtin_popcountll(bits);
}

static bool too_far(const int32_t block[3], error *e)
{
    int axis = 0;
    while (block[axis] <= farthest_block && block[axis] >= -farthest_block) axis++;
    return error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "the volume has its surface at the limits of 32-bit index coordinates, near voxel "
                     "%lld along axis %d: move the grid nearer to its origin",
                     (long long)block[axis] * GRID_VIEW_SIDE, axis);
}

bool crossings_add(crossings *c, const int32_t block[3], const corner_signs *corners, error *e)
{
    crossing_block b = {.block = {block[0], block[1], block[2]}};
    uint64_t cells = 0;
    for (int x = 0; x < GRID_VIEW_SIDE; x++) {
        uint64_t bits = (some(&corners->inside, x) | some(&corners->inside, x + 1)) &
                        ~(all(&corners->inside, x) & all(&corners->inside, x + 1));
        if (!bits) continue;
        const uint64_t known = all(&corners->known, x) & all(&corners->known, x + 1);
        if (c->known_only) bits &= known;
        if (bits & ~known) note_open(c, block, x, bits & ~known);
        b.flat |= (bits & ~(some(&corners->outside, x) | some(&corners->outside, x + 1))) != 0;
        cells += (unsigned)__builtin_popcountll(bits);
        bits = htole64(bits);
        memcpy(b.rows + GRID_VIEW_SIDE * x, &bits, sizeof bits);
    }
    if (cells == 0) return true;
    for (int axis = 0; axis < 3; axis++)
        if (block[axis] > farthest_block || block[axis] < -farthest_block) return too_far(block, e);
    c->cells += cells;
    return append(c, &b, e);
}

/* The block and those above it, which its cells touch: bits 0 to 2 of k for x, y, z. */
static void find_near(const grid_view *l, const int32_t block[3], grid_view_block near[8])
{
    for (int k = 0; k < 8; k++)
        near[k] = grid_view_find(l, block[0] + (k & 1), block[1] + (k >> 1 & 1), block[2] + (k >> 2));
}

static bool look_at(const grid_view *l, const int32_t block[3], const grid_view_block near[8], crossings *out,
                    error *e)
{
    corner_signs corners;
    for (int k = 0; k < 8; k++) {
        grid_view_signs constant;
        const grid_view_signs *s = grid_view_find_signs(l, near[k], &constant);
        const int part = k >> 1, from = k & 1 ? GRID_VIEW_SIDE : 0;
        const size_t bytes = k & 1 ? sizeof(uint64_t) : sizeof s->inside;
        memcpy(corners.inside.at[part] + from, s->inside, bytes);
        memcpy(corners.outside.at[part] + from, s->outside, bytes);
        memcpy(corners.known.at[part] + from, s->known, bytes);
    }
    return crossings_add(out, block, &corners, e);
}

/* The blocks with cells that touch the leaf n. Of those that touch several leaves each belongs to the one that comes first
 * around it. */
static bool look_around(const grid_view *l, uint32_t n, crossings *out, error *e)
{
    const int32_t *leaf = l->leaves.blocks[n];
    grid_view_block around[27], near[8];
    grid_view_around(l, leaf, around);
    for (int k = 0; k < 8; k++) {
        const int below[3] = {k & 1, k >> 1 & 1, k >> 2};
        const int32_t block[3] = {leaf[0] - below[0], leaf[1] - below[1], leaf[2] - below[2]};
        bool first = true;
        for (int j = 0; j < 8; j++) {
            near[j] =
                around[13 + 9 * ((j & 1) - below[0]) + 3 * ((j >> 1 & 1) - below[1]) + (j >> 2) - below[2]];
            first &= j >= k || near[j].leaf == BLOCK_MAP_NONE;
        }
        if (first && !look_at(l, block, near, out, e)) return false;
    }
    return true;
}

/* A block that may touch a tile's face: without leaves, which look around themselves. */
static bool look_at_tiles(const grid_view *l, const int32_t block[3], crossings *out, error *e)
{
    grid_view_block near[8];
    bool inside = false, outside = false;
    find_near(l, block, near);
    for (int k = 0; k < 8; k++) {
        if (near[k].leaf != BLOCK_MAP_NONE) return true;
        inside |= near[k].constant < 0;
        outside |= !(near[k].constant < 0);
    }
    return !(inside && outside) || look_at(l, block, near, out, e);
}

/* The blocks whose cells touch a face of a tile: in each axis the layer below it and its last one. */
static bool add_shell(const vdb_tile *t, block_map *candidates, error *e)
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
    return true;
}

/* Whether one of its six neighbours is constant and on the other side. Where tiles of both sides meet at an edge or a corner
 * alone, what lies beside both is a leaf, which looks around itself, or is on one side, and so meets the other by a face. */
static bool meets_other_side(const grid_view *l, const int32_t block[3], bool inside)
{
    for (int k = 0; k < 6; k++) {
        int32_t at[3] = {block[0], block[1], block[2]};
        at[k / 2] += k % 2 ? 1 : -1;
        const uint32_t tile =
            block_map_find(&l->tiles[0], at[0], at[1], at[2]); /* most are beside their like */
        if (tile != BLOCK_MAP_NONE && (l->tile_values[0][tile] < 0) == inside) continue;
        const grid_view_block next = grid_view_find(l, at[0], at[1], at[2]);
        if (next.leaf == BLOCK_MAP_NONE && (next.constant < 0) != inside) return true;
    }
    return false;
}

/* Which tiles part the surface from what lies beyond them. A tile on the background's side matters only beside leaves and other
 * tiles, which count. */
typedef struct tile_search {
    const grid_view *from;
    uint8_t *counts; /* of each tile */
} tile_search;

static void tile_chunk(void *context, int worker, size_t begin, size_t end)
{
    const tile_search *job = context;
    const grid_view *l = job->from;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const vdb_tile *t = &l->grid->tiles[i];
        const int32_t low[3] = {t->origin[0] >> 3, t->origin[1] >> 3, t->origin[2] >> 3};
        const bool inside = grid_view_find(l, low[0], low[1], low[2]).constant < 0;
        job->counts[i] =
            inside != (l->background < 0) && (t->side != GRID_VIEW_SIDE || meets_other_side(l, low, inside));
    }
}

static bool add_shells(const grid_view *l, size_t memory_limit, threads *pool, block_map *candidates,
                       error *e)
{
    const size_t count = l->grid->tile_count;
    tile_search job = {l, mem_array(count, 1, "the tiles of the grid", e)};
    bool ok = job.counts;
    candidates->limit = memory_limit / GRID_VIEW_TABLES;
    if (ok) threads_run(pool, count, TILES, tile_chunk, &job);
    for (size_t i = 0; ok && i < count; i++)
        if (job.counts[i]) ok = add_shell(&l->grid->tiles[i], candidates, e);
    free(job.counts);
    return ok;
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
    const block_map *shells; /* blocks that touch faces of tiles */
    crossings *found;        /* of each chunk of leaves and these */
    error *fault;            /* likewise; the code is ERROR_NONE where there is none */
} search;

static void search_chunk(void *context, int worker, size_t begin, size_t end)
{
    const search *job = context;
    const size_t chunk = begin / BLOCKS, leaves = job->from->leaves.count;
    crossings *found = &job->found[chunk];
    error *fault = &job->fault[chunk];
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const bool good = n < leaves
                              ? look_around(job->from, (uint32_t)n, found, fault)
                              : look_at_tiles(job->from, job->shells->blocks[n - leaves], found, fault);
        if (!good) return;
    }
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
    block_map shells;
    search job = {l, &shells, NULL, NULL};
    crossings found = {.known_only = l->kind == GRID_VIEW_DENSE};
    bool ok = block_map_init(&shells, 0, e) && add_shells(l, memory_limit, pool, &shells, e);
    const size_t count = l->leaves.count + (size_t)shells.count, chunks = (count + BLOCKS - 1) / BLOCKS;
    if (ok) {
        job.found = mem_array(chunks, sizeof *job.found, what, e);
        job.fault = mem_array(chunks, sizeof *job.fault, what, e);
        ok = job.found && job.fault;
    }
    if (ok) {
        for (size_t k = 0; k < chunks; k++) job.found[k].known_only = found.known_only;
        threads_run(pool, count, BLOCKS, search_chunk, &job);
        ok = gather(job.found, job.fault, chunks, &found, e);
    }
    for (size_t k = 0; job.found && k < chunks; k++) crossings_free(&job.found[k]);
    free(job.found);
    free(job.fault);
    block_map_free(&shells);
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
    grid_view_block around[27];
    grid_view_around(l, block, around);
    for (int n = 0; n < 27; n++) {
        const int step[3] = {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1};
        float f[GRID_VIEW_VOXELS];
        grid_view_read(l, around[n], f);
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
