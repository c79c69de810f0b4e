#include "geometry/near_points.h"

#include <stdlib.h>

#include "base/memory.h"
#include "geometry/point_bins.h"
#include "geometry/point_tree.h"

/* One of the two. */
struct near_points {
    point_bins *bins;
    point_tree *tree;
};

near_points *near_points_new(const vec3 *points, size_t count, threads *pool, error *e)
{
    near_points *n = mem_alloc(sizeof *n);
    *n = (near_points){point_bins_new(points, count, pool, e), NULL};
    bool ok = n->bins != NULL;
    if (ok && point_bins_are_dense(n->bins)) {
        point_bins_free(n->bins);
        n->bins = NULL;
        n->tree = point_tree_new(points, count, e);
        ok = n->tree != NULL;
    }
    if (ok) return n;
    near_points_free(n);
    return NULL;
}

void near_points_free(near_points *n)
{
    if (!n) return;
    point_bins_free(n->bins);
    point_tree_free(n->tree);
    free(n);
}

uint32_t near_points_nearest(const near_points *n, vec3 x, double enough, double *distance)
{
    return n->bins ? point_bins_nearest(n->bins, x, enough, distance)
                   : point_tree_nearest(n->tree, x, enough, distance);
}

void near_points_within(const near_points *n, vec3 x, double reach, near_points_visit visit, void *context)
{
    if (n->bins)
        point_bins_within(n->bins, x, reach, visit, context);
    else
        point_tree_within(n->tree, x, reach, visit, context);
}
