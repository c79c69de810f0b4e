// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/slices.h"

#include "base/core/elementary.h"

bool slices_choose_volume(const slices *s, int64_t *index, error *e)
{
    const int64_t count = s->volumes > 1 ? s->volumes : 1;
    if (*index < 0 && count > 1)
        return error_set(e, ERROR_GRID_AMBIGUOUS,
                         "the file has %lld volumes of %lld x %lld x %lld: choose one with index, 0 to %lld",
                         (long long)count, (long long)s->size[0], (long long)s->size[1],
                         (long long)s->size[2], (long long)count - 1);
    if (*index >= count)
        return error_set(e, ERROR_GRID_MISSING, "the file has no volume %lld: choose index from 0 to %lld",
                         (long long)*index, (long long)count - 1);
    if (*index < 0) *index = 0;
    return true;
}

void slices_set_voxel_size(slices *s, const double size[3])
{
    for (int k = 0; k < 3; k++) {
        double *m = s->index_to_world, length = elementary_hypot(elementary_hypot(m[k], m[4 + k]), m[8 + k]);
        for (int row = 0; row < 3; row++)
            m[4 * row + k] = length > 0 ? m[4 * row + k] * (size[k] / length) : row == k ? size[k] : 0;
    }
}
