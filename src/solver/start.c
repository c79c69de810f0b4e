#include "solver/start.h"

#include <stdatomic.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/rng.h"
#include "solver/curves/boundary.h"
#include "field/projection.h"
#include "packing/packing.h"
#include "solver/particles/random_streams.h"

/* Points that start anywhere in the domain need a walk; those from cells are nearly there. */
static const int WALK_STEPS = 50;
/* A start is good to this fraction of h; the relaxation does the rest. */
static const double START_ACCEPT = 1e-3;
/* Draws per particle before the surface is given up: a fifth of random starts may be lost. */
static const size_t MAX_DRAWS = 1000;
/* |H| / |grad F| times the size of a cell above this marks a degenerate zero, such as the centre of (15),
 * where the gradient vanishes with F: Newton's method creeps there, but there is no surface. On a surface
 * that its cells resolve the ratio is below 2. */
static const double DEGENERATE = 50;
/* Other particles keep this far from boundaries, in h: half of what a row and the next have between them. Where
 * there is no room for that, so many draws try. */
static const double BOUNDARY_CLEAR = 0.45;
static const size_t BOUNDARY_DRAWS = 20;
/* Newton's method that ends farther outside of the surface's box than this times h, or a cell, ran off. */
static const double FARTHEST = 1.0;

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

/* Of a cell that a face of the domain cuts, only what is inside. */
static vec3 random_in_cells(const field *f, size_t cells, rng *r)
{
    vec3 p = random_in_cell(f, cells, r);
    for (size_t draw = 0; f->open && draw < MAX_DRAWS && !bbox_contains(f->domain, p); draw++)
        p = random_in_cell(f, cells, r);
    return p;
}

/* Where particles are drawn from, and what becomes of them. */
typedef struct draw_job {
    const field *field;
    const surface *scan;
    const solver_params *params;
    const level_plan *plan;
    int level;
    double spacing;
    bbox near; /* a point that ends outside ran off */
    const boundary_request *boundary;
    particles *p;
    size_t first;        /* the number of those on boundaries, which come before */
    size_t *patch_first; /* of a surface with patches the first free particle of each */
    uint64_t seed;
    threads *pool;
    atomic_size_t drawn_again, lost; /* the first particle that never reached the surface, or the count */
} draw_job;

/* A draw for particle i, which is the k-th of the `count` free ones of its patch. */
static bool draw_on_patch(const draw_job *job, size_t i, size_t k, size_t count, size_t draw, rng *r, vec3 *x)
{
    bool stratum = draw == 0 && job->params->start == SOLVER_START_SURFACE;
    double where = rng_uniform(r);
    if (stratum) where = ((double)k + where) / (double)count;
    const double *weight = sizing_field_weight(job->params->sizing, job->scan);
    return surface_patch_point(job->scan, weight, job->p->patch[i], where, r, x);
}

/* Whether a place is so near to a curve of its patch that it would push its way into the row there. */
static bool crowds_curve(const draw_job *job, uint32_t patch, vec3 x)
{
    const boundary_request *request = job->boundary;
    return curve_distance_at(job->plan->curves, patch, x) < BOUNDARY_CLEAR * boundary_spacing(request, x);
}

/* Draws particle i, of a surface with patches, until it is on its patch; likewise. */
static bool draw_patch_particle(draw_job *job, size_t i, rng *r)
{
    particles *p = job->p;
    const uint32_t patch = p->patch[i];
    const field *f = particles_field(p, job->field, i);
    const projection_limits limits = {WALK_STEPS, START_ACCEPT * job->spacing, START_ACCEPT * job->spacing,
                                      START_ACCEPT * job->spacing};
    for (size_t draw = 0; draw <= MAX_DRAWS && !threads_stopped(job->pool); draw++) {
        vec3 x;
        size_t count = job->plan->quotas[job->level].free[patch];
        if (!draw_on_patch(job, i, i - job->patch_first[patch], count, draw, r, &x)) continue;
        bool settled = projection_find(f, &limits, &x, &p->normal[i]) && bbox_contains(job->near, x) &&
                       field_is_within(f, x);
        if (settled && !(draw < BOUNDARY_DRAWS && crowds_curve(job, patch, x))) {
            p->position[i] = x;
            return true;
        }
        atomic_fetch_add(&job->drawn_again, !settled);
    }
    return false;
}

/* Draw number `draw` of particle i of `count`. The surface start takes its k-th stratum of area; strata follow each other
 * through the cells. */
static vec3 draw_point(const draw_job *job, size_t i, size_t count, size_t draw, rng *r,
                       surface_last_cell *last)
{
    const solver_params *params = job->params;
    if (params->start == SOLVER_START_SURFACE) {
        double where = ((double)i + rng_uniform(r)) / (double)count;
        if (draw > 0) where = rng_uniform(r);
        return sizing_field_draw(params->sizing, job->scan, level_plan_place(job->plan, job->level, where), r,
                                 draw > 0 ? NULL : last);
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
    double limit = DEGENERATE / f->cell_size;
    return norm2 > limit * limit * vec3_norm2(s.gradient);
}

/* A draw, onto the surface; those from its own cells are nearly there and need no doubt. */
static bool settle(const field *f, const solver_params *params, double spacing, bbox near, vec3 *x,
                   vec3 *normal)
{
    const projection_limits limits = {WALK_STEPS, START_ACCEPT * spacing, START_ACCEPT * spacing,
                                      START_ACCEPT * spacing};
    return projection_find(f, &limits, x, normal) && bbox_contains(near, *x) &&
           (params->start == SOLVER_START_SURFACE || !is_degenerate(f, *x));
}

/* The first particles, in rows along the boundaries. *count is how many. */
static bool place_boundary(const surface *scan, const boundary_request *request, particles *p, size_t *count,
                           error *e)
{
    boundary row;
    bool ok = boundary_find(scan, request, &row, e);
    for (size_t i = 0; ok && i < row.count; i++) {
        p->position[i] = row.position[i];
        p->normal[i] = row.normal[i];
    }
    *count = ok ? row.count : 0;
    boundary_free(&row);
    return ok;
}

/* Whether a point is so near to a boundary, along the surface, that it would push its way into the row there. */
static bool crowds_boundary(const field *f, const boundary_request *request, vec3 x, vec3 normal)
{
    double clear = BOUNDARY_CLEAR * boundary_spacing(request, x);
    for (int axis = 0; axis < 3; axis++) {
        double at = vec3_get(x, axis), n = vec3_get(normal, axis), slope = sqrt(fmax(1 - n * n, 0));
        double height =
            fmin(at - vec3_get(f->boundary_box.min, axis), vec3_get(f->boundary_box.max, axis) - at);
        if (height < clear * slope) return true;
    }
    return false;
}

/* Draws particle i until it is on the surface; false when it never is, or the pool was told to stop. */
static bool draw_particle(draw_job *job, size_t i, surface_last_cell *last)
{
    particles *p = job->p;
    rng r = rng_seed(job->seed, i); /* of its own: who draws more changes nothing for the others */
    if (p->patch) return draw_patch_particle(job, i, &r);
    for (size_t draw = 0; draw <= MAX_DRAWS && !threads_stopped(job->pool); draw++) {
        vec3 x = draw_point(job, i - job->first, p->count - job->first, draw, &r, last);
        bool settled = settle(job->field, job->params, job->spacing, job->near, &x, &p->normal[i]);
        if (settled && !(job->first > 0 && draw < BOUNDARY_DRAWS &&
                         crowds_boundary(job->field, job->boundary, x, p->normal[i]))) {
            p->position[i] = x;
            return true;
        }
        atomic_fetch_add(&job->drawn_again, !settled);
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
        if (draw_particle(job, i, &last)) continue;
        while (i < lost && !atomic_compare_exchange_weak(&job->lost, &lost, i)) continue;
        return;
    }
}

/* Rows along curves, and labels for the free particles of each patch, which come patch after patch. */
static bool place_rows(const quota *a, particles *p, size_t *first, size_t **patch_first, error *e)
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

/* The particles on boundaries, before all others: also before random draws, of which many end on the boundaries, run into them
 * from outside, and stay. */
static bool place_first(draw_job *job, error *e)
{
    if (job->p->patch)
        return place_rows(&job->plan->quotas[job->level], job->p, &job->first, &job->patch_first, e);
    return place_boundary(job->scan, job->boundary, job->p, &job->first, e);
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
                    .near = bbox_grow(scan->box, FARTHEST * fmax(spacing, f->cell_size)),
                    .boundary = &request,
                    .p = p,
                    .seed = rng_next(&r),
                    .pool = pool};
    if (!place_first(&job, e)) return false;
    atomic_store(&job.lost, p->count);
    threads_run(pool, p->count - job.first, 256, draw_chunk, &job);
    free(job.patch_first);
    size_t lost = atomic_load(&job.lost);
    if (threads_stopped(pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    if (lost < p->count)
        return error_set(e, ERROR_NO_SURFACE,
                         "particle %zu of %zu does not reach the surface in %zu draws: the field "
                         "has no usable gradient near its isosurface",
                         lost + 1, p->count, MAX_DRAWS);
    *removed = atomic_load(&job.drawn_again);
    return true;
}
