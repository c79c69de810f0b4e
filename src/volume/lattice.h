/* lattice: the voxels of a loaded grid as values of F, by 8^3 blocks, wherever one asks.
 *
 * F = value - isovalue for a level set and isovalue - value otherwise, so that F < 0 is inside. A
 * voxel of a level set is known when it is active and not at the clamp, +-background; the others say
 * only on which side they lie. Every voxel of a fog is known: outside the leaves it has its tile's or the
 * background's value. Of the leaves of a dense volume the active voxels are known, and no others. Voxel
 * (x, y, z) of a block has offset 64 x + 8 y + z and bit 8 y + z of word x, as in vdb.h. Units: index space; F
 * in the grid's own unit.
 * Threads: reading is safe in any number.
 */
#ifndef HEXAD_VOLUME_LATTICE_H
#define HEXAD_VOLUME_LATTICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "vdb/vdb.h"
#include "volume/blockmap.h"

#define LATTICE_SIDE 8
#define LATTICE_VOXELS 512
#define LATTICE_TILE_LEVELS 3

typedef enum lattice_kind { LATTICE_LEVEL_SET, LATTICE_FOG, LATTICE_DENSE } lattice_kind;

typedef struct lattice {
    const vdb_grid *grid; /* the caller's, as long as the lattice lives */
    double isovalue;
    lattice_kind kind;
    float clamp_below, clamp_above; /* active values from these on, outwards, are the clamp; or infinite */
    float background;               /* as F */
    blockmap leaves;
    blockmap tiles[LATTICE_TILE_LEVELS];
    float *tile_values[LATTICE_TILE_LEVELS]; /* as F */
    float lowest, highest;                   /* of the grid's own finite values, background included */
    uint64_t not_finite;                     /* voxels in leaves */
} lattice;

/* A block that has one value everywhere, or a leaf. */
typedef struct lattice_block {
    uint32_t leaf;  /* BLOCKMAP_NONE: a constant block */
    float constant; /* F */
} lattice_block;

bool lattice_init(lattice *l, const vdb_grid *grid, lattice_kind kind, double isovalue, error *e);
void lattice_free(lattice *l);

lattice_block lattice_find(const lattice *l, int32_t x, int32_t y, int32_t z);

/* F of all 512 voxels and which of them are known. */
void lattice_read(const lattice *l, lattice_block b, float f[LATTICE_VOXELS], uint64_t known[LATTICE_SIDE]);

#endif
