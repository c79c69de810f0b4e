// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/start.h"

#include <stdatomic.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "sampling/solver/curves/boundary.h"
#include "surface/field/projection.h"
#include "geometry/space/packing.h"
#include "sampling/solver/particles/random_streams.h"

/* |H| / |grad F| times the grid cell size from which a zero is degenerate: the gradient vanishes with F, and
 * there is no surface. Example: the centre of (15). If the cells resolve the surface the value is below 2. */
static const double DEGENERATE_RATIO = 50;

static vec3 random_in_domain(const field *f, rng *r)
{
    vec3 size = bbox_size(f->domain), u;
    u.x = rng_uniform(r);
    u.y = rng_uniform(r);
    u.z = rng_uniform(r);
    return vec3_add(f->domain.min, (vec3){u.x * size.x, u.y * size.y, u.z * size.z});
}

static vec3 random_in_cell(const field *f, size_t cells, rng *r)
{
    field_cell cell;
    size_t k = (size_t)(rng_uniform(r) * (double)cells);
    f->ops->cell(f, k < cells ? k : cells - 1, &cell);
    vec3 p = cell.corner[0];
    for (int axis = 0; axis < 3; axis++)
        p = vec3_axpy(rng_uniform(r), vec3_sub(cell.corner[1 << axis], cell.corner[0]), p);
    return p;
}

/* A random point in a random grid cell, inside the domain if the surface is open. */
static vec3 random_in_cells(const field *f, size_t cells, rng *r)
{
    vec3 p = random_in_cell(f, cells, r);
    for (int draw = 0; f->open && draw < START_MAX_DRAWS && !bbox_contains(f->domain, p); draw++)
        p = random_in_cell(f, cells, r);
    return p;
}

/* Random draws of the initial positions. */
typedef struct draw_job {
    const field *field;
    const surface *scan;
    const solver_params *params;
    const level_plan *plan;
    int level;
    double spacing;
    bbox near; /* of the surface; farther away Newton's method has diverged */
    const boundary_request *boundary;
    particles *p;
    size_t first;        /* the first free particle; samples of boundaries and curves precede */
    size_t *patch_first; /* per patch: its first free particle; NULL without patches */
    bool *is_placed;     /* per particle: it is at a given point; NULL: none is */
    uint64_t seed;
    threads *pool;
    atomic_int drawn_again; /* failed draws */
    atomic_size_t lost;     /* the first particle whose draws all failed; the count if there is none */
} draw_job;

/* Whether the first draws are in strata of equal area. These follow the grid cells, whose regular order
 * blue noise would show. */
static bool has_strata(const solver_params *params)
{
    return params->start == SOLVER_START_SURFACE && !params->blue_noise;
}

/* A random point for particle i, the k-th of `count` free particles of its patch. False: the draw failed. */
static bool draw_on_patch(const draw_job *job, size_t i, size_t k, size_t count, int draw, rng *r, vec3 *x,
                          uint32_t *hint)
{
    bool stratum = draw == 0 && has_strata(job->params);
    double where = rng_uniform(r);
    if (stratum) where = ((double)k + where) / (double)count;
    const double *weight = sizing_field_weight(job->params->sizing, job->scan);
    return surface_patch_point(job->scan, weight, job->p->patch[i], where, r, x, hint);
}

/* Whether x is too near to a curve of its patch: the particle would move among the samples of the curve. */
static bool is_too_near_curve(const draw_job *job, uint32_t patch, vec3 x)
{
    const boundary_request *request = job->boundary;
    return curve_distance_at(job->plan->curves, patch, x) < START_CLEARANCE * boundary_spacing(request, x);
}

/* Draws particle i of a surface with patches until it is on its patch. False: all draws failed, or the
 * pool was stopped. */
static bool draw_patch_particle(draw_job *job, size_t i, rng *r)
{
    particles *p = job->p;
    const uint32_t patch = p->patch[i];
    const field *f = particles_field(p, job->field, i);
    const projection_limits limits = projection_draft(job->spacing);
    for (int draw = 0; draw <= START_MAX_DRAWS && !threads_stopped(job->pool); draw++) {
        vec3 x;
        uint32_t hint;
        size_t count = job->plan->quotas[job->level].free[patch];
        if (!draw_on_patch(job, i, i - job->patch_first[patch], count, draw, r, &x, &hint)) continue;
        bool projected = projection_find_near(f, &limits, &hint, &x, &p->normal[i]) &&
                         bbox_contains(job->near, x) && field_is_within_near(f, x, &hint);
        if (projected &&
            (job->params->blue_noise || draw >= START_CLEAR_DRAWS || !is_too_near_curve(job, patch, x))) {
            p->position[i] = x;
            p->hint[i] = hint;
            return true;
        }
        atomic_fetch_add(&job->drawn_again, !projected);
    }
    return false;
}

/* Draw number `draw` of particle i of `count`. The first draw of a surface start is in the i-th stratum of
 * the area; consecutive strata are near each other. */
static vec3 draw_point(const draw_job *job, size_t i, size_t count, int draw, rng *r, surface_last_cell *last)
{
    const solver_params *params = job->params;
    if (params->start == SOLVER_START_SURFACE) {
        double where = ((double)i + rng_uniform(r)) / (double)count;
        if (draw > 0 || !has_strata(params)) where = rng_uniform(r);
        return sizing_field_draw(params->sizing, job->scan, level_plan_place(job->plan, job->level, where), r,
                                 draw > 0 || !has_strata(params) ? NULL : last);
    }
    return params->random_in_cells ? random_in_cells(job->field, job->scan->cells, r)
                                   : random_in_domain(job->field, r);
}

static bool is_degenerate(const field *f, vec3 x)
{
    field_sample s;
    if (!field_sample_at(f, x, FIELD_HESSIAN, &s)) return true;
    sym3 h = s.hessian;
    double norm2 = h.xx * h.xx + h.yy * h.yy + h.zz * h.zz + 2 * (h.xy * h.xy + h.xz * h.xz + h.yz * h.yz);
    double limit = DEGENERATE_RATIO / f->cell_size;
    return norm2 > limit * limit * vec3_norm2(s.gradient);
}

/* Projects a drawn point onto the surface. False: the projection failed or ended at a degenerate zero. */
static bool project_draw(const field *f, const solver_params *params, double spacing, bbox near, vec3 *x,
                         vec3 *normal)
{
    const projection_limits limits = projection_draft(spacing);
    return projection_find(f, &limits, x, normal) && bbox_contains(near, *x) &&
           (params->start == SOLVER_START_SURFACE || !is_degenerate(f, *x));
}

/* Places the first particles along the boundaries. *count: their number. */
static bool place_boundary(const surface *scan, const boundary_request *request, particles *p, size_t *count,
                           error *e)
{
    boundary samples;
    bool ok = boundary_find(scan, request, &samples, e);
    for (size_t i = 0; ok && i < samples.count; i++) {
        p->position[i] = samples.position[i];
        p->normal[i] = samples.normal[i];
    }
    *count = ok ? samples.count : 0;
    boundary_free(&samples);
    return ok;
}

/* Whether x is too near to a boundary along the surface: the particle would move among the boundary
 * particles. */
static bool is_too_near_boundary(const field *f, const boundary_request *request, vec3 x, vec3 normal)
{
    double clear = START_CLEARANCE * boundary_spacing(request, x);
    for (int axis = 0; axis < 3; axis++) {
        double at = vec3_get(x, axis), n = vec3_get(normal, axis), slope = sqrt(fmax(1 - n * n, 0));
        double height =
            fmin(at - vec3_get(f->boundary_box.min, axis), vec3_get(f->boundary_box.max, axis) - at);
        if (height < clear * slope) return true;
    }
    return false;
}

/* Draws particle i until it is on the surface. False: all draws failed, or the pool was stopped. */
static bool draw_particle(draw_job *job, size_t i, surface_last_cell *last)
{
    particles *p = job->p;
    rng r = rng_seed(job->seed, i); /* per particle: independent of the draws of other particles */
    if (p->patch) return draw_patch_particle(job, i, &r);
    for (int draw = 0; draw <= START_MAX_DRAWS && !threads_stopped(job->pool); draw++) {
        vec3 x = draw_point(job, i - job->first, p->count - job->first, draw, &r, last);
        bool projected = project_draw(job->field, job->params, job->spacing, job->near, &x, &p->normal[i]);
        if (projected && !(job->first > 0 && draw < START_CLEAR_DRAWS &&
                           is_too_near_boundary(job->field, job->boundary, x, p->normal[i]))) {
            p->position[i] = x;
            return true;
        }
        atomic_fetch_add(&job->drawn_again, !projected);
    }
    return false;
}

static void draw_chunk(void *context, int worker, size_t begin, size_t end)
{
    draw_job *job = context;
    surface_last_cell last;
    (void)worker;
    last.known = false;
    for (size_t k = begin; k < end; k++) {
        size_t i = job->first + k, lost = atomic_load(&job->lost);
        if (job->is_placed && job->is_placed[i]) continue;
        if (draw_particle(job, i, &last)) continue;
        while (i < lost && !atomic_compare_exchange_weak(&job->lost, &lost, i)) continue;
        return;
    }
}

/* Places the curve samples and assigns patches to the free particles, patch after patch. */
static bool place_curve_samples(const quota *a, particles *p, size_t *first, size_t **patch_first, error *e)
{
    size_t patches = p->patches->count;
    *patch_first = mem_array(patches, sizeof **patch_first, "the start", e);
    if (!*patch_first) return false;
    p->count = 0;
    quota_add_samples(a, p);
    *first = p->count;
    for (uint32_t k = 0; k < patches; k++) {
        (*patch_first)[k] = p->count;
        for (uint32_t n = 0; n < a->free[k]; n++, p->count++) {
            p->patch[p->count] = k;
            p->hint[p->count] = FIELD_NO_HINT;
            p->place[p->count] = PARTICLES_FREE;
        }
    }
    return true;
}

/* Maximum distance of a given point from its patch, in spacings. */
static const double MAX_GIVEN_DISTANCE = 1;

/* A given point on its patch; `patch` UINT32_MAX: on none, or on a curve. */
typedef struct given_point {
    vec3 x, normal;
    uint32_t patch;
} given_point;

static given_point find_given(const draw_job *job, size_t i)
{
    const vec3 at = job->params->given[i];
    const projection_limits limits = projection_draft(job->spacing);
    given_point g = {.x = at, .patch = job->params->given_patch[i]};
    const field *f = field_of_patch(job->field, g.patch);
    if (!projection_find(f, &limits, &g.x, &g.normal) || !field_is_within(f, g.x) ||
        vec3_norm(vec3_sub(g.x, at)) > MAX_GIVEN_DISTANCE * job->spacing ||
        is_too_near_curve(job, g.patch, g.x))
        g.patch = UINT32_MAX;
    return g;
}

/* Places the free particles of each patch at given points: at all, or evenly chosen ones if there are
 * more. */
static void fill_patches(draw_job *job, const given_point *given, size_t count, size_t *found, size_t *seen)
{
    const uint32_t *free_count = job->plan->quotas[job->level].free;
    for (size_t i = 0; i < count; i++)
        if (given[i].patch != UINT32_MAX) found[given[i].patch]++;
    for (size_t i = 0; i < count; i++) {
        const uint32_t k = given[i].patch;
        if (k == UINT32_MAX) continue;
        const size_t most = found[k] < free_count[k] ? found[k] : free_count[k],
                     slot = seen[k] * most / found[k];
        if (++seen[k] * most / found[k] == slot) continue;
        const size_t at = job->patch_first[k] + slot;
        job->p->position[at] = given[i].x;
        job->p->normal[at] = given[i].normal;
        job->is_placed[at] = true;
    }
}

/* Places particles of patches at given points. The others are drawn. */
static bool place_given(draw_job *job, error *e)
{
    const char *what = "the start";
    const size_t count = job->params->given_count, patches = job->p->patches->count;
    given_point *given = mem_array(count, sizeof *given, what, e);
    size_t *found = given ? mem_array(2 * patches, sizeof *found, what, e) : NULL;
    job->is_placed = found ? mem_array(job->p->count, sizeof *job->is_placed, what, e) : NULL;
    const bool ok = job->is_placed != NULL;
    for (size_t i = 0; ok && i < count && !threads_stopped(job->pool); i++) given[i] = find_given(job, i);
    if (ok && !threads_stopped(job->pool)) fill_patches(job, given, count, found, found + patches);
    free(given);
    free(found);
    return ok;
}

/* Places the particles on boundaries or curves first. */
static bool place_first(draw_job *job, error *e)
{
    if (job->p->patch)
        return place_curve_samples(&job->plan->quotas[job->level], job->p, &job->first, &job->patch_first,
                                   e) &&
               (job->params->start != SOLVER_START_COARSEST || place_given(job, e));
    return job->params->blue_noise || place_boundary(job->scan, job->boundary, job->p, &job->first, e);
}

bool start_place(const field *f, const surface *scan, const solver_params *params, const level_plan *plan,
                 int level, double spacing, threads *pool, particles *p, size_t *removed, error *e)
{
    rng r = rng_seed(params->seed, RANDOM_STREAM_START);
    const boundary_request request = {spacing, params->sizing,
                                      packing_spacing(scan->area, (double)params->count), p->count};
    draw_job job = {.field = f,
                    .scan = scan,
                    .params = params,
                    .plan = plan,
                    .level = level,
                    .spacing = spacing,
                    .near = bbox_grow(scan->box, fmax(spacing, f->cell_size)),
                    .boundary = &request,
                    .p = p,
                    .seed = rng_next(&r),
                    .pool = pool};
    const bool is_begun = place_first(&job, e);
    atomic_store(&job.lost, p->count);
    if (is_begun) threads_run(pool, p->count - job.first, THREADS_GRAIN, draw_chunk, &job);
    free(job.patch_first);
    free(job.is_placed);
    if (!is_begun) return false;
    size_t lost = atomic_load(&job.lost);
    if (!threads_may_go_on(pool, e)) return false;
    if (lost < p->count)
        return error_set(
            e, ERROR_NO_SURFACE,
            "no place on the surface was found for particle %zu of %zu in %d random draws: the field "
            "has no usable gradient near its isosurface",
            lost + 1, p->count, START_MAX_DRAWS);
    *removed = atomic_load(&job.drawn_again);
    return true;
}
