#include "sampler/refine.h"

#include <stdlib.h>

#include "base/memory.h"
#include "base/rng.h"
#include "sampler/project.h"
#include "sampler/voronoi.h"

/* A middle lies within a few hundredths of h of the surface; one that is farther joins two sheets. */
static const double MIDDLE_FARTHEST = 0.5;
static const double MIDDLE_ACCEPT = 1e-3;
/* Draws per particle that the edges did not give. */
static const int MAX_DRAWS = 1000;

size_t refine_coarser(size_t count)
{
    return (count + 6 + 3) / 4;
}

typedef struct middle {
    vec3 position, normal;
} middle;

/* The middles of the edges, projected, in the order of their first and second end. */
static size_t find_middles(const field *f, const voronoi_sites *sites, size_t count, middle *out,
                           size_t capacity)
{
    size_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *list = neighbours_list(sites->near, i);
        for (uint32_t k = 0; k < sites->near->list_count[i] && found < capacity; k++) {
            double length;
            if (list[k] < i || vec3_dot(sites->normal[i], sites->normal[list[k]]) <= VORONOI_OTHER_SIDE ||
                !voronoi_edge(sites, i, list[k], &length))
                continue;
            double spacing = fmin(sites->spacing[i], sites->spacing[list[k]]),
                   accept = MIDDLE_ACCEPT * spacing;
            const project_limits limits = {5, accept, accept, accept};
            vec3 m = vec3_scale(vec3_add(sites->position[i], sites->position[list[k]]), 0.5), x = m, n;
            if (project_point(f, &limits, &x, &n) &&
                vec3_norm2(vec3_sub(x, m)) < MIDDLE_FARTHEST * MIDDLE_FARTHEST * spacing * spacing)
                out[found++] = (middle){x, n};
        }
    }
    return found;
}

/* Particles that the edges did not give, anywhere on the surface. */
static bool draw_rest(const field *f, const surface *scan, const grading *graded, particles *p, size_t count,
                      double spacing, uint64_t seed, error *e)
{
    rng r = rng_seed(seed, 3);
    const project_limits limits = {20, MIDDLE_ACCEPT * spacing, MIDDLE_ACCEPT * spacing,
                                   MIDDLE_ACCEPT * spacing};
    for (int draws = 0; p->count < count; draws++) {
        vec3 x = grading_draw(graded, scan, rng_uniform(&r), &r), n;
        if (draws == MAX_DRAWS)
            return error_set(e, ERROR_NO_SURFACE,
                             "particle %zu of %zu does not reach the surface in %d draws", p->count + 1,
                             count, draws);
        if (!project_point(f, &limits, &x, &n)) continue;
        p->position[p->count] = x;
        p->normal[p->count++] = n;
        draws = 0;
    }
    return true;
}

bool refine_particles(const field *f, const surface *scan, const grading *graded, particles *p, size_t count,
                      double spacing, uint64_t seed, threads *pool, error *e)
{
    bool ok = false;
    size_t wanted = count - p->count, capacity = 4 * p->count;
    double *local = mem_array(p->count, sizeof *local, "refinement", e);
    middle *middles = mem_array(capacity, sizeof *middles, "refinement", e);
    neighbours *near = neighbours_new(p->count, SIZE_MAX, e);
    if (!local || !middles || !near) goto done;
    for (size_t i = 0; i < p->count; i++) local[i] = spacing * p->size[i];
    if (!neighbours_build(near, p->count, p->position, local, VORONOI_REACH, pool, e)) goto done;
    const voronoi_sites sites = {p->position, p->normal, local, near};
    size_t found = find_middles(f, &sites, p->count, middles, capacity);
    for (size_t k = 0; k < found; k++) {
        /* of `found` keep `wanted`, evenly spread */
        if (found > wanted && k * wanted / found == (k + 1) * wanted / found) continue;
        p->position[p->count] = middles[k].position;
        p->normal[p->count++] = middles[k].normal;
    }
    ok = draw_rest(f, scan, graded, p, count, spacing, seed, e);
done:
    neighbours_free(near);
    free(middles);
    free(local);
    return ok;
}
