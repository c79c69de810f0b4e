// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/example.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/vec3.h"
#include "io/vdb/vdb.h"

/* Half-width of the narrow band, voxels: the default of OpenVDB's tools. */
#define BAND_VOX 3

/* Number of chords of the closed curve: the longest is 0.009 units and deviates from the curve by 5e-6 units,
 * less than the resolution of a half float at the edge of the band. */
#define CHORDS 1500

/* Half sizes of the index box of the knot with tube and band: 1 + 0.15 + 0.06 units horizontally, 0.34 + 0.21
 * vertically. */
enum { HALF_XY = 62, HALF_Z = 29, SIDE_XY = 2 * HALF_XY + 1, SIDE_Z = 2 * HALF_Z + 1 };
#define VOXELS ((size_t)SIDE_XY * SIDE_XY * SIDE_Z)

static vec3 knot(int k)
{
    double t = 2 * M_PI * k / CHORDS;
    return (vec3){(elementary_sin(t) + 2 * elementary_sin(2 * t)) / 3,
                  (elementary_cos(t) - 2 * elementary_cos(2 * t)) / 3, -elementary_sin(3 * t) / 3};
}

static size_t offset_of(int x, int y, int z)
{
    return ((size_t)(x + HALF_XY) * SIDE_XY + (size_t)(y + HALF_XY)) * SIDE_Z + (size_t)(z + HALF_Z);
}

static int clip(double v, int half)
{
    return v < -half ? -half : v > half ? half : (int)v;
}

/* Sets `distance` to the minimum of itself and the distance from the chord a b, near the chord. */
static void add_chord(vec3 a, vec3 b, float *distance)
{
    const double reach = EXAMPLE_TUBE_RADIUS + (BAND_VOX + 1) * EXAMPLE_VOXEL;
    const vec3 along = vec3_sub(b, a);
    int low[3], high[3];
    for (int axis = 0; axis < 3; axis++) {
        double p = vec3_get(a, axis), q = vec3_get(b, axis);
        low[axis] = clip(floor((fmin(p, q) - reach) / EXAMPLE_VOXEL), axis == 2 ? HALF_Z : HALF_XY);
        high[axis] = clip(ceil((fmax(p, q) + reach) / EXAMPLE_VOXEL), axis == 2 ? HALF_Z : HALF_XY);
    }
    for (int x = low[0]; x <= high[0]; x++)
        for (int y = low[1]; y <= high[1]; y++)
            for (int z = low[2]; z <= high[2]; z++) {
                vec3 p = vec3_sub((vec3){x * EXAMPLE_VOXEL, y * EXAMPLE_VOXEL, z * EXAMPLE_VOXEL}, a);
                double t = fmin(1, fmax(0, vec3_dot(p, along) / vec3_norm2(along)));
                float d = (float)vec3_norm(vec3_axpy(-t, along, p));
                float *at = &distance[offset_of(x, y, z)];
                if (d < *at) *at = d;
            }
}

static void fill_draft(const float *distance, int32_t (*voxels)[3], float *values, bool *active,
                       vdb_draft *draft)
{
    const double background = BAND_VOX * EXAMPLE_VOXEL;
    size_t n = 0;
    for (int x = -HALF_XY; x <= HALF_XY; x++)
        for (int y = -HALF_XY; y <= HALF_XY; y++)
            for (int z = -HALF_Z; z <= HALF_Z; z++) {
                double f = (double)distance[offset_of(x, y, z)] - EXAMPLE_TUBE_RADIUS;
                if (!(f < background)) continue;
                voxels[n][0] = x;
                voxels[n][1] = y;
                voxels[n][2] = z;
                active[n] = f > -background;
                values[n++] = (float)fmax(f, -background);
            }
    draft->voxel_count = n;
    draft->background = background;
}

bool example_write(int fd, error *e)
{
    static const double matrix[16] = {
        EXAMPLE_VOXEL, 0, 0, 0, 0, EXAMPLE_VOXEL, 0, 0, 0, 0, EXAMPLE_VOXEL, 0, 0, 0, 0, 1};
    bool ok = false;
    float *distance = mem_array(VOXELS, sizeof *distance, "the example", e);
    float *values = mem_array(VOXELS, sizeof *values, "the example", e);
    bool *active = mem_array(VOXELS, sizeof *active, "the example", e);
    int32_t(*voxels)[3] = mem_array(VOXELS, sizeof *voxels, "the example", e);
    if (distance && values && active && voxels) {
        for (size_t i = 0; i < VOXELS; i++) distance[i] = INFINITY;
        for (int k = 0; k < CHORDS; k++) add_chord(knot(k), knot(k + 1), distance);
        vdb_draft draft = {.name = EXAMPLE_GRID,
                           .type = "float",
                           .half = true,
                           .grid_class = VDB_LEVEL_SET,
                           .index_to_world = matrix,
                           .voxels = (const int32_t(*)[3])voxels,
                           .values = values,
                           .active = active};
        fill_draft(distance, voxels, values, active, &draft);
        ok = vdb_write_grids(fd, &draft, 1, VDB_SEEKABLE, true, e);
    }
    free(distance);
    free(values);
    free(active);
    free(voxels);
    return ok;
}
