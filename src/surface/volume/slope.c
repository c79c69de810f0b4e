// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/slope.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"

#define SIDE VDB_LEAF_SIDE

/* Tolerance for a slope of 1: distances in half floats, or on curved surfaces. */
static const double still_one = 0.02;
/* Maximum ratio of the upper and the lower quartile for distances; creases affect less than a quarter of
 * the voxels. */
static const double widest = 1.25;
/* Maximum relative difference of the slopes at the surface and at the offset. */
static const double farthest = 0.1;

static bool is_active(const vdb_grid *g, size_t leaf, int at)
{
    return g->leaf_active[8 * leaf + (size_t)(at >> 6)] >> (at & 63) & 1;
}

/* |grad| at the voxel; 0 if its upper neighbours are not all active and in the leaf, or if all have one
 * sign. */
static double slope_at(const vdb_grid *g, size_t leaf, int at, double value, const double to_index[3][4])
{
    static const int step[3] = {SIDE * SIDE, SIDE, 1};
    const float *f = g->leaf_values + leaf * VDB_LEAF_VOXELS;
    const bool below = (double)f[at] < value;
    bool passes = false;
    double d[3];
    if (!is_active(g, leaf, at)) return 0;
    for (int axis = 0; axis < 3; axis++) {
        const int next = at + step[axis];
        if (at / step[axis] % SIDE == SIDE - 1 || !is_active(g, leaf, next)) return 0;
        d[axis] = (double)f[next] - (double)f[at];
        passes |= ((double)f[next] < value) != below;
    }
    return passes ? vec3_norm(affine_pull_gradient(to_index, (vec3){d[0], d[1], d[2]})) : 0;
}

static int by_size(const void *left, const void *right)
{
    const float a = *(const float *)left, b = *(const float *)right;
    return (a > b) - (a < b);
}

bool slope_measure(const vdb_grid *g, double value, const double to_index[3][4], slope *out, error *e)
{
    float *all = NULL;
    size_t count = 0;
    for (int pass = 0; pass < 2; pass++) {
        if (pass && !(all = mem_array(count, sizeof *all, "the slopes of the grid", e))) return false;
        count = 0;
        for (size_t leaf = 0; leaf < g->leaf_count; leaf++)
            for (int at = 0; at < VDB_LEAF_VOXELS; at++) {
                const float s = (float)slope_at(g, leaf, at, value, to_index);
                if (!(s > 0)) continue;
                if (pass) all[count] = s;
                count++;
            }
    }
    *out = (slope){.count = count};
    if (count > 0) {
        qsort(all, count, sizeof *all, by_size);
        *out = (slope){count, (double)all[count / 4], (double)all[count / 2],
                       (double)all[count - 1 - count / 4]};
    }
    free(all);
    return true;
}

bool slope_find_offset(const vdb_grid *g, double isovalue, double offset, const double to_index[3][4],
                       double *out, double *unit, error *e)
{
    slope at, there;
    if (!slope_measure(g, isovalue, to_index, &at, e)) return false;
    if (at.count == 0) at = (slope){0, 1, 1, 1};
    if (at.high > widest * at.low)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "an offset requires distances, but the values of the grid change per world unit by "
                         "%.3g in one place of the surface and by %.3g in another; rebuild it as a level set",
                         at.low, at.high);
    const double scale = fabs(at.median - 1) <= still_one ? 1 : at.median, value = isovalue + offset * scale;
    if (!slope_measure(g, value, to_index, &there, e)) return false;
    if (there.count > 0 && fabs(there.median / at.median - 1) > farthest)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "an offset requires distances, but the values of the grid change per world unit by "
                         "%.3g at %g from the surface and by %.3g at the surface; rebuild it with a "
                         "wider band",
                         there.median, offset, at.median);
    *out = value;
    *unit = scale;
    return true;
}
