// SPDX-License-Identifier: Apache-2.0
/* winding_number: which voxels a mesh encloses, by the signed crossings of its triangles with the lines x =
 * i, y = j of the voxel grid.
 *
 * The winding number of a closed mesh at a voxel is the sum of the signed crossings above it. It is correct
 * for any shape of triangles, for cavities and for overlaps. Crossings of a line are computed in integers,
 * with ties broken as if the line were shifted by (eps, eps^2). Each crossing is therefore counted once,
 * whatever vertices and edges the line meets. For this, x and y of the vertices are rounded to 2^-16 voxel (z
 * is not); voxels within that distance of the surface may get either side. Units: voxels. Reading: any
 * thread. Source of the tie rule: Edelsbrunner and Muecke 1990, "Simulation of Simplicity".
 */
#ifndef HEXAD_SURFACE_LEVELSET_WINDING_NUMBER_H
#define HEXAD_SURFACE_LEVELSET_WINDING_NUMBER_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "geometry/mesh/mesh.h"

#define WINDING_BITS 16          /* fractional bits of the fixed point */
#define WINDING_MOST_VOXELS 8192 /* along a side: products of two differences fit 64 bits */

typedef struct winding_point {
    int32_t x, y;
    double z;
} winding_point;

typedef struct crossing {
    double z;
    uint32_t solid;
    int32_t sign; /* +1: the normal of the triangle points upwards */
} crossing;

typedef struct winding_columns {
    int32_t nx, ny; /* lines x = 0 .. nx - 1, y = 0 .. ny - 1 */
    /* line (x, y) has the crossings first[ny * x + y] .. first[ny * x + y + 1] - 1, sorted by solid, then
     * by z */
    uint64_t *first;
    crossing *crossings;
} winding_columns;

/* Converts a vertex to fixed point. Coordinates are from 0 to WINDING_MOST_VOXELS. */
static inline winding_point winding_fix(vec3 v)
{
    const double one = 1 << WINDING_BITS;
    return (winding_point){(int32_t)lrint(v.x * one), (int32_t)lrint(v.y * one), v.z};
}

/* The crossing of the line through (x, y), in fixed point, with the triangle: 0 if there is none, else its
 * sign (see crossing) and *z. */
int winding_cross(const winding_point *a, const winding_point *b, const winding_point *c, int32_t x,
                  int32_t y, double *z);

/* Computes the crossings of all lines with a mesh in voxels. `first_of_solid`: solid_count + 1 entries.
 * `pool` may be NULL; the result does not depend on it. Errors: limit_memory (more than `memory_limit` bytes
 * are needed), cancelled. */
bool winding_make(const mesh *m, const uint32_t *first_of_solid, size_t solid_count, threads *pool,
                  size_t memory_limit, winding_columns *out, error *e);
void winding_free(winding_columns *c);

/* Bit z, 0 <= z < 8, of the result: the point (x, y, z0 + z) is inside the solid. `by_parity`: by the parity
 * of the crossings, not by their sum. 0 for x and y without a line. */
unsigned winding_inside(const winding_columns *c, uint32_t solid, bool by_parity, int32_t x, int32_t y,
                        int32_t z0);

/* Whether the voxel is inside any solid. Solids with stamp[solid] == stamped are skipped; `stamp` NULL:
 * none is. */
bool winding_covers(const winding_columns *c, const bool *by_parity, const uint32_t *stamp, uint32_t stamped,
                    const int32_t at[3]);

#endif
