// SPDX-License-Identifier: Apache-2.0
/* samples_fixture: samples of random voxels. */
#ifndef HEXAD_TESTS_SAMPLES_FIXTURE_H
#define HEXAD_TESTS_SAMPLES_FIXTURE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "surface/volume/samples.h"

/* A cube of `side` blocks per axis, beginning at `low`. With `gaps`, the fourth of each seven blocks is
 * missing. */
static inline samples samples_fixture(int side, int low, bool gaps, rng *r)
{
    samples s = {0};
    error e = {0};
    assert_true(block_map_init(&s.map, 0, &e));
    for (int k = 0; k < side * side * side; k++)
        if (!gaps || k % 7 != 3)
            assert_true(block_map_find_or_add(&s.map, k / (side * side) + low, k / side % side + low,
                                              k % side + low, NULL, &e));
    s.f = mem_array(s.map.count, sizeof *s.f, "voxels", &e);
    s.others.f = mem_array(s.map.count, GRID_VIEW_VOXELS * sizeof *s.others.f, "voxels", &e);
    assert_true(s.f && s.others.f);
    for (size_t k = 0; k < s.map.count; k++) s.f[k] = s.others.f + k * GRID_VIEW_VOXELS;
    for (size_t k = 0; k < (size_t)s.map.count * GRID_VIEW_VOXELS; k++) s.others.f[k] = (float)rng_uniform(r);
    return s;
}

#endif
