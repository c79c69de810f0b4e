#include "voxels/reach.h"

#include <endian.h>
#include <string.h>

#define SIDE GRID_VIEW_SIDE

/* Blocks as far away as REACH_MOST reaches along an axis, on either side. */
enum { FARTHEST = 2, AROUND = 2 * FARTHEST + 1, OFFSETS = AROUND * AROUND * AROUND };

/* A block beside that of the cells, and those cells of each layer along x that are near it, as bits 8 y + z. */
typedef struct neighbour {
    int32_t step[3];
    uint64_t near[SIDE];
} neighbour;

/* How far the corners of a cell lie from a block that is so many blocks away along an axis. */
static int gap(int cell, int step)
{
    return step > 0 ? SIDE * step - cell - 1 : step < 0 ? cell - (SIDE * step + SIDE - 1) : 0;
}

static bool is_near(reach_limits r, int x, int y, int z)
{
    const bool along = x <= r.axis && y <= r.axis && z <= r.axis;
    return along || x * x + y * y + z * z <= r.straight * r.straight || x + y + z <= r.path;
}

/* Returns how many there are. */
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

bool reach_add_blocks(const crossings *c, reach_limits limits, block_map *map, error *e)
{
    neighbour around[OFFSETS];
    const int count = find_neighbours(limits, around);
    for (size_t i = 0; i < c->count; i++) {
        const crossing_block *b = &c->blocks[i];
        uint64_t cells[SIDE];
        memcpy(cells, b->rows, sizeof cells);
        for (int x = 0; x < SIDE; x++) cells[x] = le64toh(cells[x]);
        for (int k = 0; k < count; k++) {
            const neighbour *n = &around[k];
            uint64_t any = 0;
            for (int x = 0; x < SIDE; x++) any |= cells[x] & n->near[x];
            if (any && !block_map_find_or_add(map, b->block[0] + n->step[0], b->block[1] + n->step[1],
                                              b->block[2] + n->step[2], NULL, e))
                return false;
        }
    }
    return true;
}
