/* crossings: where the surface passes, found before anything large is allocated.
 *
 * A cell is the cube between voxels (i, j, k) and (i+1, j+1, k+1) and belongs to the block of its
 * lowest voxel; it is crossed when F has both signs among its corners, zero counting as outside.
 * Blocks come in the order of their coordinates, so that it does not matter how the file had them. Threads:
 * crossings_find has those of a pool, whose number does not show; the others none.
 */
#ifndef HEXAD_VOLUME_CROSSINGS_H
#define HEXAD_VOLUME_CROSSINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "volume/grid_view.h"

typedef struct crossing_block {
    int32_t block[3];
    uint8_t rows[64]; /* bit z of rows[8 x + y]: cell (x, y, z) is crossed */
    bool flat;        /* one of them has nothing but zeros outside */
} crossing_block;

typedef struct crossings {
    crossing_block *blocks;
    size_t count, room;
    uint64_t cells;
    bool known_only;     /* cells with a corner that is not known do not count: the data end there */
    uint64_t open_cells; /* crossed cells with a corner that is not known */
    int32_t open_at[3];  /* the first of them */
} crossings;

/* Looks at every block where the sign of F may change. `memory_limit` bounds the search's own memory. */
bool crossings_find(const grid_view *l, size_t memory_limit, threads *pool, crossings *out, error *e);

/* Adds a block whose corners are F at (x, y, z), 0..8 each, offset 81 x + 9 y + z; nothing is added
 * where no cell is crossed. `known`, bit z of known[9 x + y], may be NULL: all of them. */
bool crossings_add(crossings *c, const int32_t block[3], const float corners[729], const uint16_t *known,
                   error *e);

/* How many crossed cells have nothing but zeros outside, and around them nothing but zeros beyond: the samples come to
 * the isovalue there and do not pass it. */
uint64_t crossings_count_plateau(const grid_view *l, const crossings *c);

void crossings_free(crossings *c);

#endif
