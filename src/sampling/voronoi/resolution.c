// SPDX-License-Identifier: Apache-2.0
#include "sampling/voronoi/resolution.h"

#include <math.h>
#include <stdatomic.h>

#include "sampling/packing/point_flags.h"
#include "geometry/space/packing.h"
#include "sampling/voronoi/partitions.h"
#include "sampling/voronoi/voronoi.h"

typedef struct resolution_job {
    const resolution_input *in;
    const partition *part;
    voronoi_sites sites; /* of the partition */
    atomic_size_t inner, resolved, hex;
} resolution_job;

static bool is_unresolved(const voronoi_sites *s, uint32_t i)
{
    const uint32_t *list = neighbours_list(s->near, i);
    for (uint32_t k = 0; k < s->near->list_count[i]; k++) {
        const uint32_t j = list[k];
        if (vec3_dot(s->normal[i], s->normal[j]) >= RESOLUTION_OPPOSITE) continue;
        const vec3 r = vec3_sub(s->position[j], s->position[i]);
        const double mean = 0.5 * (s->spacing[i] + s->spacing[j]), reach = RESOLUTION_REACH * mean,
                     gap = fmin(fabs(vec3_dot(s->normal[i], r)), fabs(vec3_dot(s->normal[j], r)));
        if (gap < RESOLUTION_GAP * mean && vec3_norm2(r) < reach * reach) return true;
    }
    return false;
}

static bool is_resolved(const voronoi_sites *s, uint32_t i, const voronoi_star *star)
{
    bool is = star->count > 0 && !star->pinched && !is_unresolved(s, i);
    for (uint32_t k = 0; is && k < star->count; k++) is = !is_unresolved(s, star->point[k]);
    return is;
}

static void measure_chunk(void *context, int worker, size_t begin, size_t end)
{
    resolution_job *job = context;
    const resolution_input *in = job->in;
    const partition *p = job->part;
    (void)worker;
    for (uint32_t i = (uint32_t)begin; i < end; i++) {
        voronoi_star star;
        if (!partition_owns(p, i) || (in->every > 0 && p->index[i] % in->every != 0) ||
            (in->open && packing_is_near_boundary(in->domain, p->position[i], p->spacing[i])))
            continue;
        voronoi_star_at(&job->sites, i, &star);
        atomic_fetch_add(&job->inner, 1);
        atomic_fetch_add(&job->hex, star.count == PACKING_IDEAL_DEGREE);
        atomic_fetch_add(&job->resolved, is_resolved(&job->sites, i, &star));
    }
}

bool resolution_measure(const resolution_input *in, threads *pool, resolution *out, error *e)
{
    const partitions_input cut = {in->count, in->position, in->normal,   in->spacing,
                                  NULL,      NULL,         VORONOI_REACH};
    partitions all;
    partition part = {0};
    resolution_job job = {.in = in, .part = &part};
    bool ok = partitions_cut(&cut, pool, &all, e);
    for (size_t k = 0; ok && k < all.count; k++) {
        ok = partition_fill(&cut, &all, k, pool, &part, e);
        job.sites = (voronoi_sites){part.position, part.normal, part.spacing, part.near, NULL, part.index};
        if (ok) threads_run(pool, part.count, THREADS_GRAIN, measure_chunk, &job);
    }
    partition_free(&part);
    partitions_free(&all);
    if (!ok) return false;
    const double inner = (double)atomic_load(&job.inner);
    *out = (resolution){(double)atomic_load(&job.resolved) / inner, (double)atomic_load(&job.hex) / inner};
    return true;
}
