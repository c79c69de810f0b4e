// SPDX-License-Identifier: Apache-2.0
#include "job/inspect/frame.h"

#include "geometry/space/affine.h"
#include "job/report/report.h"

static void put_index(json *o, const char *key, const int64_t at[3])
{
    json *array = json_put_array(o, key);
    for (int k = 0; k < 3; k++) json_append_number(array, (double)at[k]);
}

void frame_describe(const double m[16], const int64_t low[3], const int64_t high[3], json *o)
{
    const double(*to_world)[4] = (const double(*)[4])m;
    json *matrix = json_put_array(o, "index_to_world"), *voxel = json_put_array(o, "voxel_size");
    for (int k = 0; k < 16; k++) json_append_number(matrix, m[k]);
    for (int k = 0; k < 3; k++) json_append_number(voxel, vec3_norm(affine_axis(to_world, k)));
    if (high[0] < low[0]) return;
    json *box = json_put_object(o, "index_box");
    put_index(box, "min", low);
    put_index(box, "max", high);
    const bbox index = {vec3_make((double)low[0], (double)low[1], (double)low[2]),
                        vec3_make((double)high[0], (double)high[1], (double)high[2])};
    report_put_box(o, affine_box(to_world, index));
}
