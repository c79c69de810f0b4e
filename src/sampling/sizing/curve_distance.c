// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/curve_distance.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/point_tree.h"

/* Maximum number of samples of a side of a curve. */
static const double PARTS_MOST = 1e4;

struct curve_distance {
    size_t count; /* number of patches */
    bool joined;  /* all patches are one */
    size_t *begin;
    vec3 *place;       /* samples of patch p: begin[p] .. begin[p + 1] - 1 */
    point_tree **tree; /* NULL: no curves */
};

static size_t parts_of(const field_patches *p, const field_curve *c, size_t side, double step)
{
    vec3 from = p->vertex[c->first + side], to = p->vertex[c->first + (side + 1) % c->count];
    return (size_t)fmin(1 + vec3_norm(vec3_sub(to, from)) / step, PARTS_MOST);
}

/* First pass (place NULL): counts the samples of patch p in begin[p + 1]. Second pass: stores them from
 * begin[p], which is advanced. */
static void sample_curves(const field_patches *p, double step, curve_distance *d)
{
    for (const field_curve *c = p->curve; c < p->curve + p->curve_count; c++)
        for (size_t k = 0; k < c->count - !c->closed; k++) {
            vec3 from = p->vertex[c->first + k];
            vec3 side = vec3_sub(p->vertex[c->first + (k + 1) % c->count], from);
            size_t parts = parts_of(p, c, k, step);
            for (size_t m = 0; m <= parts; m++)
                for (size_t n = 0; n < (d->joined ? 1 : c->patch_count); n++) {
                    uint32_t patch = d->joined ? 0 : p->curve_patch[c->patch_first + n];
                    if (d->place)
                        d->place[d->begin[patch]++] = vec3_axpy((double)m / (double)parts, side, from);
                    else
                        d->begin[patch + 1]++;
                }
        }
}

curve_distance *curve_distance_new(const field_patches *patches, bool joined, double step,
                                   const threads *pool, error *e)
{
    const char *what = "the curves of a surface";
    curve_distance *d = mem_alloc(sizeof *d);
    d->joined = joined;
    d->count = joined ? 1 : patches->count;
    d->begin = mem_array(d->count + 1, sizeof *d->begin, what, e);
    d->tree = mem_array(d->count, sizeof *d->tree, what, e);
    if (!d->begin || !d->tree) goto fail;
    sample_curves(patches, step, d);
    for (size_t k = 0; k < d->count; k++) d->begin[k + 1] += d->begin[k];
    d->place = mem_array(d->begin[d->count], sizeof *d->place, what, e);
    if (!d->place) goto fail;
    sample_curves(patches, step, d);
    for (size_t k = d->count; k > 0; k--) d->begin[k] = d->begin[k - 1]; /* each was advanced to its end */
    d->begin[0] = 0;
    for (size_t k = 0; k < d->count; k++) {
        size_t places = d->begin[k + 1] - d->begin[k];
        if (!threads_may_go_on(pool, e)) goto fail;
        if (places > 0 && !(d->tree[k] = point_tree_new(d->place + d->begin[k], places, e))) goto fail;
    }
    return d;
fail:
    curve_distance_free(d);
    return NULL;
}

void curve_distance_free(curve_distance *d)
{
    if (!d) return;
    for (size_t k = 0; d->tree && k < d->count; k++) point_tree_free(d->tree[k]);
    free(d->tree);
    free(d->begin);
    free(d->place);
    free(d);
}

double curve_distance_nearest(const curve_distance *d, uint32_t patch, vec3 x, vec3 *nearest)
{
    double distance = INFINITY;
    if (!d->tree[patch]) return INFINITY;
    *nearest = d->place[d->begin[patch] + point_tree_nearest(d->tree[patch], x, 0, &distance)];
    return distance;
}

double curve_distance_at(const curve_distance *d, uint32_t patch, vec3 x)
{
    vec3 nearest;
    return curve_distance_nearest(d, patch, x, &nearest);
}
