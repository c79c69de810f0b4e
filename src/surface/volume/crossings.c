// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/crossings.h"

#include <endian.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/isa.h"
#include "base/core/memory.h"

enum { BLOCKS = 256, NODES = 64 }; /* in a chunk of work */

/* Coordinates of blocks closer than this to the limits of int32 would overflow in neighbouring blocks. */
static const int32_t farthest_block = (1 << 28) - 16;

void crossings_free(crossings *c)
{
    free(c->blocks);
    memset(c, 0, sizeof *c);
}

static bool append(crossings *c, const crossing_block *b, error *e)
{
    if (!MEM_GROW(c->blocks, c->count, &c->room, "the blocks that the surface crosses", e)) return false;
    c->blocks[c->count++] = *b;
    return true;
}

/* The corners of the cells of a layer, as bits of the cells: the corner of the cell, and those one step
 * along y, along z, and along both. */
typedef struct cell_corners {
    uint64_t own, y, z, yz;
} cell_corners;

ISA_INLINE cell_corners corners_of(const corner_bits *c, int x)
{
    const uint64_t low = 0x0101010101010101u;
    cell_corners b = {.own = c->at[0][x]};
    /* corners z = 8; from y = 1 */
    const uint64_t upper = (c->at[2][x] & low) >> 8 | c->at[3][x] << 56;
    b.y = b.own >> 8 | c->at[1][x] << 56;
    b.z = (b.own >> 1 & ~(low << 7)) | (c->at[2][x] & low) << 7;
    b.yz = (b.y >> 1 & ~(low << 7)) | (upper & low) << 7;
    return b;
}

/* `some`, `all`: bits of the cells of a layer of which at least one corner, or all four corners, have the
 * bit. */
ISA_INLINE uint64_t some(const corner_bits *c, int x)
{
    const cell_corners b = corners_of(c, x);
    return b.own | b.y | b.z | b.yz;
}

ISA_INLINE uint64_t all(const corner_bits *c, int x)
{
    const cell_corners b = corners_of(c, x);
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

static bool is_near_enough(const int32_t block[3], error *e)
{
    int axis = 0;
    while (axis < 3 && block[axis] <= farthest_block && block[axis] >= -farthest_block) axis++;
    if (axis == 3) return true;
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
        if (bits && cells == 0 && !is_near_enough(block, e)) return false;
        if (bits & ~known) note_open(c, block, x, bits & ~known);
        b.flat |= (bits & ~(some(&corners->outside, x) | some(&corners->outside, x + 1))) != 0;
        cells += (unsigned)__builtin_popcountll(bits);
        bits = htole64(bits);
        memcpy(b.rows + GRID_VIEW_SIDE * x, &bits, sizeof bits);
    }
    if (cells == 0) return true;
    c->cells += cells;
    return append(c, &b, e);
}

/* A block and the seven blocks above it, which its cells touch. Bits 0 to 2 of k: one step along x, y, z. */
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

/* Examines the blocks whose cells touch leaf n. A block that touches several leaves is examined for the
 * first of them in the order of `near` only. */
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

/* Examines a block at a face of a tile. Blocks next to leaves are skipped, because look_around examines
 * them. */
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

/* Adds the blocks whose cells touch the faces of a tile that is `side` blocks wide: along each axis the
 * layer below the tile and its last layer. */
static bool add_shell(const int32_t origin[3], int32_t side, block_map *candidates, error *e)
{
    for (int32_t x = 0; x <= side; x++)
        for (int32_t y = 0; y <= side; y++) {
            bool edge = x == 0 || x == side || y == 0 || y == side;
            for (int32_t z = 0; z <= side; z += edge ? 1 : side)
                if (!block_map_find_or_add(candidates, origin[0] - 1 + x, origin[1] - 1 + y,
                                           origin[2] - 1 + z, NULL, e))
                    return false;
        }
    return true;
}

/* Finds the tiles of a level at which the sign of F may change. Only tiles on the opposite side of the
 * background are needed, since a change next to a tile on its side occurs at a leaf or at another tile. Bits
 * are those of the nodes of the tile table. */
typedef struct tile_search {
    const grid_view *from;
    int level;
    uint64_t *odd;    /* per node: tiles on the opposite side of the background */
    uint64_t *counts; /* per node: those of them that have such a face */
} tile_search;

static void odd_chunk(void *context, int worker, size_t begin, size_t end)
{
    const tile_search *job = context;
    const grid_view *l = job->from;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (int k = 0; k < BLOCK_MAP_NODE; k++) {
            const uint32_t tile = l->tiles[job->level].nodes[n][k];
            const bool odd =
                tile != BLOCK_MAP_NONE && (l->tile_values[job->level][tile] < 0) != (l->background < 0);
            job->odd[n] |= (uint64_t)odd << k;
        }
}

/* Bits of the children of a node whose neighbour at face 2 axis + high is marked in `odd`. */
static uint64_t odd_beside(const tile_search *job, const block_map_slot *s, int face)
{
    static const int step[3] = {16, 4, 1};
    static const uint64_t lowest[3] = {0x000000000000ffffu, 0x000f000f000f000fu, 0x1111111111111111u};
    const int axis = face >> 1, by = step[axis];
    const uint64_t low = lowest[axis], high = low << 3 * by, here = job->odd[s->node];
    int32_t key[3] = {s->key[0], s->key[1], s->key[2]};
    key[axis] += face & 1 ? 1 : -1;
    const uint32_t node = block_map_slot_of(&job->from->tiles[job->level], key)->node;
    const uint64_t there = node == BLOCK_MAP_NONE ? 0 : job->odd[node];
    return face & 1 ? (here >> by & ~high) | (there << 3 * by & high)
                    : (here << by & ~low) | (there >> 3 * by & low);
}

/* Whether a block beyond a face of a tile is constant and has the side of the background. Edges and corners
 * need no test: if tiles of both sides meet only there, the blocks beside both are leaves, which are
 * examined, or have one of the sides and share a face with the other. */
static bool meets_background(const grid_view *l, const int32_t origin[3], int32_t side, int face)
{
    const int axis = face >> 1, a = (axis + 1) % 3, b = (axis + 2) % 3;
    for (int32_t k = 0; k < side * side; k++) {
        int32_t at[3] = {origin[0], origin[1], origin[2]};
        at[axis] += face & 1 ? side : -1;
        at[a] += k / side;
        at[b] += k % side;
        const grid_view_block next = grid_view_find(l, at[0], at[1], at[2]);
        if (next.leaf == BLOCK_MAP_NONE && (next.constant < 0) == (l->background < 0)) return true;
    }
    return false;
}

/* The lowest block of a tile of a level. */
static void find_origin(const grid_view *l, int level, uint32_t tile, int32_t origin[3])
{
    for (int axis = 0; axis < 3; axis++)
        origin[axis] = l->tiles[level].blocks[tile][axis] * (1 << grid_view_tile_shift[level]);
}

static void tile_chunk(void *context, int worker, size_t begin, size_t end)
{
    const tile_search *job = context;
    const grid_view *l = job->from;
    const block_map *tiles = &l->tiles[job->level];
    const int32_t side = 1 << grid_view_tile_shift[job->level];
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const block_map_slot *s = &tiles->slots[i];
        if (s->node == BLOCK_MAP_NONE || job->odd[s->node] == 0) continue;
        for (int face = 0; face < 6; face++) {
            uint64_t open = job->odd[s->node] & ~odd_beside(job, s, face) & ~job->counts[s->node];
            for (; open; open &= open - 1) {
                const int k = __builtin_ctzll(open);
                int32_t origin[3];
                find_origin(l, job->level, tiles->nodes[s->node][k], origin);
                if (meets_background(l, origin, side, face)) job->counts[s->node] |= (uint64_t)1 << k;
            }
        }
    }
}

static bool add_shells(const grid_view *l, int level, threads *pool, block_map *candidates, error *e)
{
    const char *what = "the tiles of the grid";
    const block_map *tiles = &l->tiles[level];
    tile_search job = {l, level, mem_array(tiles->node_count, sizeof *job.odd, what, e),
                       mem_array(tiles->node_count, sizeof *job.counts, what, e)};
    bool ok = job.odd && job.counts;
    if (ok) {
        threads_run(pool, tiles->node_count, NODES, odd_chunk, &job);
        threads_run(pool, (size_t)tiles->mask + 1, NODES, tile_chunk, &job);
    }
    for (size_t n = 0; ok && n < tiles->node_count; n++)
        for (uint64_t bits = job.counts[n]; ok && bits; bits &= bits - 1) {
            int32_t origin[3];
            find_origin(l, level, tiles->nodes[n][__builtin_ctzll(bits)], origin);
            ok = add_shell(origin, 1 << grid_view_tile_shift[level], candidates, e);
        }
    free(job.odd);
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
    const block_map *shells; /* candidate blocks at faces of tiles */
    crossings *found;        /* per chunk, of leaves and then of candidates */
    error *fault;            /* likewise; code ERROR_NONE: no error */
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

/* Joins the results of the chunks in their order. */
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
    bool ok = block_map_init(&shells, 0, e);
    shells.limit = memory_limit / GRID_VIEW_TABLES;
    for (int level = 0; ok && level < GRID_VIEW_TILE_LEVELS; level++)
        ok = add_shells(l, level, pool, &shells, e);
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

/* Marks the voxels that are outside (F > 0), from one voxel below the block to two above it. Extrapolated voxels of
 * dense data do not count. */
static void read_outside(const grid_view *l, const int32_t block[3], bool outside[AROUND][AROUND][AROUND])
{
    grid_view_block around[27];
    grid_view_around(l, block, around);
    for (int n = 0; n < 27; n++) {
        const int step[3] = {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1};
        grid_view_signs constant;
        const grid_view_signs *s = grid_view_find_signs(l, around[n], &constant);
        for (int k = 0; k < GRID_VIEW_VOXELS; k++) {
            const int x = GRID_VIEW_SIDE * step[0] + (k >> 6) + 1,
                      y = GRID_VIEW_SIDE * step[1] + (k >> 3 & 7) + 1,
                      z = GRID_VIEW_SIDE * step[2] + (k & 7) + 1;
            if (x < 0 || y < 0 || z < 0 || x >= AROUND || y >= AROUND || z >= AROUND) continue;
            const uint64_t counted = l->kind == GRID_VIEW_DENSE ? s->known[k >> 6] : ~(uint64_t)0;
            outside[x][y][z] = (s->outside[k >> 6] & counted) >> (k & 63) & 1;
        }
    }
}

static bool is_plateau(bool outside[AROUND][AROUND][AROUND], int x, int y, int z)
{
    for (int k = 0; k < 64; k++)
        if (outside[x + (k >> 4)][y + (k >> 2 & 3)][z + (k & 3)]) return false;
    return true;
}

typedef struct plateau_search {
    const grid_view *from;
    const crossings *crossings;
    atomic_size_t cells; /* number of cells found */
} plateau_search;

static void plateau_chunk(void *context, int worker, size_t begin, size_t end)
{
    plateau_search *job = context;
    size_t cells = 0;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const crossing_block *b = &job->crossings->blocks[n];
        bool outside[AROUND][AROUND][AROUND];
        if (!b->flat) continue;
        read_outside(job->from, b->block, outside);
        for (int k = 0; k < GRID_VIEW_VOXELS; k++)
            if (b->rows[k >> 3] >> (k & 7) & 1) cells += is_plateau(outside, k >> 6, k >> 3 & 7, k & 7);
    }
    atomic_fetch_add(&job->cells, cells);
}

uint64_t crossings_count_plateau(const grid_view *l, const crossings *c, threads *pool)
{
    plateau_search job = {l, c, 0};
    threads_run(pool, c->count, BLOCKS, plateau_chunk, &job);
    return job.cells;
}
