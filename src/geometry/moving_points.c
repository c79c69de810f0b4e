#include "geometry/moving_points.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/near_points.h"

struct moving_points {
    const vec3 *points;
    const uint32_t *moving;
    size_t moving_count;
    vec3 *rest;        /* the others */
    near_points *near; /* of these; NULL: there are none */
};

moving_points *moving_points_new(const vec3 *points, size_t count, const uint32_t *moving,
                                 size_t moving_count, threads *pool, error *e)
{
    moving_points *m = mem_alloc(sizeof *m);
    size_t next = 0, rest = 0;
    *m = (moving_points){points, moving, moving_count,
                         mem_array(count - moving_count, sizeof *m->rest, "the search for near points", e),
                         NULL};
    for (size_t i = 0; m->rest && i < count; i++)
        if (next < moving_count && moving[next] == i)
            next++;
        else
            m->rest[rest++] = points[i];
    assert(!m->rest || rest + moving_count == count);
    if (m->rest && (rest == 0 || (m->near = near_points_new(m->rest, rest, pool, e)))) return m;
    moving_points_free(m);
    return NULL;
}

void moving_points_free(moving_points *m)
{
    if (!m) return;
    near_points_free(m->near);
    free(m->rest);
    free(m);
}

double moving_points_nearest2(const moving_points *m, vec3 x, uint32_t except)
{
    double nearest2 = INFINITY, distance;
    if (m->near) nearest2 = vec3_norm2(vec3_sub(x, m->rest[near_points_nearest(m->near, x, 0, &distance)]));
    for (size_t k = 0; k < m->moving_count; k++)
        if (m->moving[k] != except) {
            const double other2 = vec3_norm2(vec3_sub(x, m->points[m->moving[k]]));
            nearest2 = other2 < nearest2 ? other2 : nearest2;
        }
    return nearest2;
}
