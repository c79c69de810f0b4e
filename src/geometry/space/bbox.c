// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/bbox.h"

enum { PARTS = 16 };

typedef struct bound_job {
    const vec3 *points;
    const uint32_t *list; /* indices of the points; NULL: all points */
    size_t count;
    bbox box[PARTS];
} bound_job;

static void bound_part(void *context, int worker, size_t part, size_t end)
{
    bound_job *j = context;
    (void)worker;
    for (; part < end; part++) {
        bbox box = bbox_empty();
        for (size_t i = j->count * part / PARTS; i < j->count * (part + 1) / PARTS; i++)
            box = bbox_include(box, j->points[j->list ? j->list[i] : i]);
        j->box[part] = box;
    }
}

/* Fewer points are bounded by the calling thread: starting other threads takes longer. */
static const size_t FEW = 20000;

bbox bbox_of_points(const vec3 *points, size_t count, threads *pool)
{
    return bbox_of_corners(points, NULL, count, pool);
}

bbox bbox_of_corners(const vec3 *points, const uint32_t *list, size_t count, threads *pool)
{
    bound_job j = {.points = points, .list = list, .count = count};
    bbox box = bbox_empty();
    threads_run(count < FEW ? NULL : pool, PARTS, 1, bound_part, &j);
    /* a stopped pool skipped parts; the box must be complete */
    if (threads_stopped(pool)) threads_run(NULL, PARTS, 1, bound_part, &j);
    for (int k = 0; k < PARTS; k++) box = bbox_unite(box, j.box[k]);
    return box;
}
