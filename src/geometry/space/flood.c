// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/flood.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

enum { SIDE = 8 };

static const uint64_t lowest_z = 0x0101010101010101u, lowest_y = 0xFF;

/* Sets of cells as bit masks, one word for each layer x of a block; the bit 8 y + z is cell (x, y, z). */
typedef struct flood {
    const block_map *map;
    uint64_t *cells, *reached; /* SIDE words per block: the cells of the set, and those reached so far */
    uint32_t *waiting;         /* queue of blocks from which the flood has to continue */
    uint8_t *waits;            /* per block: it is in the queue */
    size_t count;              /* length of the queue */
} flood;

static void spread_within(const uint64_t cells[SIDE], uint64_t reached[SIDE])
{
    for (bool more = true; more;) {
        more = false;
        for (int x = 0; x < SIDE; x++) {
            const uint64_t here = reached[x];
            uint64_t to =
                here | here << 8 | here >> 8 | (here << 1 & ~lowest_z) | (here >> 1 & ~(lowest_z << 7));
            if (x > 0) to |= reached[x - 1];
            if (x + 1 < SIDE) to |= reached[x + 1];
            reached[x] = to & cells[x];
            more |= reached[x] != here;
        }
    }
}

/* The cells in layer x of the adjacent block whose neighbours across the common face are reached. `axis`,
 * `high`: the face of this block. */
static uint64_t beside(const uint64_t reached[SIDE], int axis, int high, int x)
{
    const int shift = axis == 1 ? 56 : 7;
    const uint64_t low = axis == 1 ? lowest_y : lowest_z;
    if (axis == 0) return x == (high ? 0 : SIDE - 1) ? reached[high ? SIDE - 1 : 0] : 0;
    return high ? reached[x] >> shift & low : (reached[x] & low) << shift;
}

static void spread_beyond(flood *f, uint32_t n, int axis, int high)
{
    int32_t at[3];
    uint64_t next[SIDE], any = 0;
    for (int x = 0; x < SIDE; x++) any |= next[x] = beside(f->reached + (size_t)n * SIDE, axis, high, x);
    if (!any) return;
    memcpy(at, f->map->blocks[n], sizeof at);
    at[axis] += high ? 1 : -1;
    const uint32_t there = block_map_find(f->map, at[0], at[1], at[2]);
    if (there == BLOCK_MAP_NONE) return;
    uint64_t fresh = 0;
    for (int x = 0; x < SIDE; x++) {
        const size_t word = (size_t)there * SIDE + (size_t)x;
        const uint64_t to = next[x] & f->cells[word] & ~f->reached[word];
        f->reached[word] |= to;
        fresh |= to;
    }
    if (!fresh || f->waits[there]) return;
    f->waits[there] = 1;
    f->waiting[f->count++] = there;
}

/* Floods from the first cell of the set. Returns whether it reaches all cells. */
static bool run(flood *f)
{
    const size_t words = (size_t)f->map->count * SIDE;
    size_t first = 0;
    while (first < words && f->cells[first] == 0) first++;
    if (first == words) return true;
    f->reached[first] = f->cells[first] & -f->cells[first];
    f->waiting[f->count++] = (uint32_t)(first / SIDE);
    f->waits[first / SIDE] = 1;
    while (f->count > 0) {
        const uint32_t n = f->waiting[--f->count];
        f->waits[n] = 0;
        spread_within(f->cells + (size_t)n * SIDE, f->reached + (size_t)n * SIDE);
        for (int face = 0; face < 6; face++) spread_beyond(f, n, face / 2, face % 2);
    }
    return memcmp(f->cells, f->reached, words * sizeof *f->cells) == 0;
}

bool flood_reaches_all(const block_map *map, const uint8_t *cells, bool *all, error *e)
{
    const char *what = "the surface's parts";
    const size_t words = (size_t)map->count * SIDE;
    flood f = {.map = map,
               .cells = mem_array(words, sizeof *f.cells, what, e),
               .reached = mem_array(words, sizeof *f.reached, what, e),
               .waiting = mem_array(map->count, sizeof *f.waiting, what, e),
               .waits = mem_array(map->count, 1, what, e)};
    const bool ok = f.cells && f.reached && f.waiting && f.waits;
    if (ok) {
        memcpy(f.cells, cells, words * sizeof *f.cells);
        for (size_t w = 0; w < words; w++) f.cells[w] = le64toh(f.cells[w]);
        *all = run(&f);
    }
    free(f.cells);
    free(f.reached);
    free(f.waiting);
    free(f.waits);
    return ok;
}
