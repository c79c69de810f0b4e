// SPDX-License-Identifier: Apache-2.0
/* measure_result: the measures of points on a scanned surface (sampling/measures/measures.h), for tests of
 * the solver. Include after cmocka.
 */
#ifndef HEXAD_TESTS_MEASURE_RESULT_H
#define HEXAD_TESTS_MEASURE_RESULT_H

#include <stdlib.h>

#include "sampling/measures/measures.h"
#include "sampling/solver/solver.h"

static inline measures measure_result(const surface *scan, const solver *s, bool is_sized, threads *pool)
{
    const solver_points *p = solver_result_points(s);
    const solver_patch_points *copies = &p->patch_points;
    const size_t patches = scan->field->patches ? scan->field->patches->count : 1;
    const measures_input in = {.surface = {.scan = scan, .patch_count = patches},
                               .count = p->count,
                               .position = p->position,
                               .spacing = p->spacing,
                               .h = solver_spacing(s),
                               .sized = is_sized,
                               .copy_count = copies->count,
                               .copy_normal = copies->normal,
                               .copy_point = copies->point,
                               .copy_patch = copies->patch,
                               .copy_flags = copies->flags};
    double *local = calloc(p->count, sizeof *local), *farthest = calloc(patches, sizeof *farthest);
    measures m;
    error e = {0};
    if (!measures_take(&in, pool, local, NULL, farthest, &m, &e)) fail_msg("%s", e.message);
    free(local);
    free(farthest);
    return m;
}

#endif
