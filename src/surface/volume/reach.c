// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/reach.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

#define SIDE GRID_VIEW_SIDE

/* FARTHEST: maximum distance, in blocks along an axis, that REACH_MOST can span. */
enum { FARTHEST = 2, AROUND = 2 * FARTHEST + 1, OFFSETS = AROUND * AROUND * AROUND };

/* At most this number of crossed blocks is processed by one thread. */
enum { FEW = 2048 };

/* An offset between blocks, and the cells of a block that are within reach of the block at this offset; bit
 * 8 y + z of near[x]. */
typedef struct neighbour {
    int32_t step[3];
    uint64_t near[SIDE];
} neighbour;

/* Distance, in voxels, from the corners of a cell to the block that is `step` blocks away along an axis. */
static int gap(int cell, int step)
{
    return step > 0 ? SIDE * step - cell - 1 : step < 0 ? cell - (SIDE * step + SIDE - 1) : 0;
}

static bool is_near(reach_limits r, int x, int y, int z)
{
    const bool along = x <= r.axis && y <= r.axis && z <= r.axis;
    return along || x * x + y * y + z * z <= r.straight * r.straight || x + y + z <= r.path;
}

/* Lists the offsets with cells within reach. Returns their number. */
static int find_neighbours(reach_limits r, neighbour out[OFFSETS])
{
    int count = 0;
    for (int k = 0; k < OFFSETS; k++) {
        neighbour n = {
            {k / (AROUND * AROUND) - FARTHEST, k / AROUND % AROUND - FARTHEST, k % AROUND - FARTHEST}, {0}};
        uint64_t any = 0;
        for (int cell = 0; cell < GRID_VIEW_VOXELS; cell++) {
            const int x = cell >> 6, y = cell >> 3 & 7, z = cell & 7;
            if (is_near(r, gap(x, n.step[0]), gap(y, n.step[1]), gap(z, n.step[2])))
                any |= n.near[x] |= (uint64_t)1 << (cell & 63);
        }
        if (any) out[count++] = n;
    }
    return count;
}

/* A part of the crossed blocks: the blocks within its reach. */
typedef struct part {
    block_map map;
    error fault; /* code ERROR_NONE: no error */
} part;

typedef struct search {
    const crossings *crossings;
    const neighbour *around;
    int count; /* number of offsets */
    part *parts;
    size_t each; /* crossed blocks per part */
} search;

static bool add_around(const search *job, const crossing_block *b, block_map *map, error *e)
{
    uint64_t cells[SIDE];
    memcpy(cells, b->rows, sizeof cells);
    for (int x = 0; x < SIDE; x++) cells[x] = le64toh(cells[x]);
    for (int k = 0; k < job->count; k++) {
        const neighbour *n = &job->around[k];
        uint64_t any = 0;
        for (int x = 0; x < SIDE; x++) any |= cells[x] & n->near[x];
        if (any && !block_map_find_or_add(map, b->block[0] + n->step[0], b->block[1] + n->step[1],
                                          b->block[2] + n->step[2], NULL, e))
            return false;
    }
    return true;
}

static void part_chunk(void *context, int worker, size_t begin, size_t end)
{
    const search *job = context;
    part *own = &job->parts[begin / job->each];
    (void)worker;
    if (!block_map_init(&own->map, 2 * (end - begin), &own->fault)) return;
    for (size_t i = begin; i < end; i++)
        if (!add_around(job, &job->crossings->blocks[i], &own->map, &own->fault)) return;
}

/* Adds the blocks of a part that earlier parts did not add. The order is that of a single thread. */
static bool add_part(const part *p, block_map *map, error *e)
{
    if (p->fault.code != ERROR_NONE) {
        *e = p->fault;
        return false;
    }
    for (uint32_t n = 0; n < p->map.count; n++) {
        const int32_t *b = p->map.blocks[n];
        if (!block_map_find_or_add(map, b[0], b[1], b[2], NULL, e)) return false;
    }
    return true;
}

bool reach_add_blocks(const crossings *c, reach_limits limits, threads *pool, block_map *map, error *e)
{
    neighbour around[OFFSETS];
    const size_t workers = (size_t)threads_count(pool), each = (c->count + workers - 1) / workers;
    search job = {c, around, find_neighbours(limits, around), NULL, each};
    bool ok = true;
    if (workers == 1 || c->count < FEW) {
        for (size_t i = 0; ok && i < c->count; i++) ok = add_around(&job, &c->blocks[i], map, e);
        return ok;
    }
    job.parts = mem_array(workers, sizeof *job.parts, "the blocks around the surface", e);
    if (!job.parts) return false;
    threads_run(pool, c->count, each, part_chunk, &job);
    for (size_t k = 0; k < workers; k++) {
        ok = ok && add_part(&job.parts[k], map, e);
        block_map_free(&job.parts[k].map);
    }
    free(job.parts);
    ok = ok && threads_may_go_on(pool, e);
    return ok;
}
