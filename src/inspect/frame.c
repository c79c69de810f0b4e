#include "inspect/frame.h"

#include <math.h>

#include "geometry/bbox.h"
#include "run/report.h"

static void put_index(json *o, const char *key, const int64_t at[3])
{
    json *array = json_put_array(o, key);
    for (int k = 0; k < 3; k++) json_append_number(array, (double)at[k]);
}

void frame_describe(const double m[16], const int64_t low[3], const int64_t high[3], json *o)
{
    json *matrix = json_put_array(o, "index_to_world"), *voxel = json_put_array(o, "voxel_size");
    for (int k = 0; k < 16; k++) json_append_number(matrix, m[k]);
    for (int k = 0; k < 3; k++)
        json_append_number(voxel, sqrt(m[k] * m[k] + m[4 + k] * m[4 + k] + m[8 + k] * m[8 + k]));
    if (high[0] < low[0]) return;
    json *box = json_put_object(o, "index_box");
    put_index(box, "min", low);
    put_index(box, "max", high);
    bbox world = bbox_empty();
    for (int corner = 0; corner < 8; corner++) {
        double at[3];
        for (int k = 0; k < 3; k++) at[k] = (double)(corner >> k & 1 ? high[k] : low[k]);
        world = bbox_include(world, vec3_make(m[0] * at[0] + m[1] * at[1] + m[2] * at[2] + m[3],
                                              m[4] * at[0] + m[5] * at[1] + m[6] * at[2] + m[7],
                                              m[8] * at[0] + m[9] * at[1] + m[10] * at[2] + m[11]));
    }
    report_put_box(o, world);
}
