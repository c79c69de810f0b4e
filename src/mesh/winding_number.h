/* winding_number: which voxels a mesh encloses, by the signed crossings of its triangles with the lines
 * x = i, y = j of the voxel grid.
 *
 * The winding number of a closed mesh at a voxel is the sum of the signed crossings above it: right for any
 * shape of triangles, cavities and overlaps. The crossings of a line are found in integers, with ties
 * broken as if the line were shifted by (eps, eps^2), so that each is counted once whatever vertices and
 * edges the line meets. For that vertices are rounded to 2^-16 voxel across the lines; voxels as near as
 * that to the surface may be taken for either side. Units: voxels. Threads: reading is safe in any number.
 * Source: the tie rule is that of Edelsbrunner and Muecke 1990, "Simulation of Simplicity".
 */
#ifndef HEXAD_MESH_WINDING_NUMBER_H
#define HEXAD_MESH_WINDING_NUMBER_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "triangles/mesh.h"

#define WINDING_BITS 16
#define WINDING_MOST_VOXELS 8192 /* along a side: products of two differences fit 64 bits */

typedef struct winding_point {
    int32_t x, y;
    double z;
} winding_point;

typedef struct crossing {
    double z;
    uint32_t solid;
    int32_t sign; /* +1: the triangle looks upwards */
} crossing;

typedef struct winding_columns {
    int32_t nx, ny; /* lines x = 0 .. nx - 1, y = 0 .. ny - 1 */
    uint64_t
        *first; /* crossings of line (x, y): first[ny x + y] .. first[ny x + y + 1], by solid, then upwards */
    crossing *crossings;
} winding_columns;

/* A vertex in voxels to fixed point; coordinates from 0 to WINDING_MOST_VOXELS. */
static inline winding_point winding_fix(vec3 v)
{
    const double one = 1 << WINDING_BITS;
    return (winding_point){(int32_t)lrint(v.x * one), (int32_t)lrint(v.y * one), v.z};
}

/* Whether the line through (x, y), in fixed point, crosses the triangle: 0, or +1 or -1 as in crossing, with *z. */
int winding_cross(const winding_point *a, const winding_point *b, const winding_point *c, int32_t x,
                  int32_t y, double *z);

/* Of a mesh in voxels. `first_of_solid` has solid_count + 1 members. `pool` may be NULL, and does not show. Errors: limit_memory
 * when more than `memory_limit` is needed, cancelled. */
bool winding_make(const mesh *m, const uint32_t *first_of_solid, size_t solid_count, threads *pool,
                  size_t memory_limit, winding_columns *out, error *e);
void winding_free(winding_columns *c);

/* Bit z of the result: the point (x, y, z0 + z) is inside the solid, z < 8. Where there is no line nothing
 * is inside. */
unsigned winding_inside(const winding_columns *c, uint32_t solid, bool by_parity, int32_t x, int32_t y,
                        int32_t z0);

/* Whether the voxel is inside any solid, leaving out those with stamp[solid] == stamped; `stamp` may be NULL. */
bool winding_covers(const winding_columns *c, const bool *by_parity, const uint32_t *stamp, uint32_t stamped,
                    const int32_t at[3]);

#endif
