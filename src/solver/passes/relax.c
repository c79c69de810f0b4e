#include "solver/passes/relax_internal.h"

#include <assert.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"
#include "field/projection.h"
#include "packing/independent_sets.h"

/* Where the energy is smooth a particle that moves only under such damping (log10) is misled by its place: good steps need
 * less. At creases and boundaries they need it, and there a place that is corrected would be left again, for ever. */
static const double MISLED_LAMBDA = 2;
/* The potential's value is bounded at this fraction of sigma where it only scales a turning. */
static const double TURNING_NEAREST = 0.05;
/* A trial ends on the surface to within this fraction of h, or is refused. */
static const double TRIAL_REJECT = 0.01;
static const double TRIAL_ACCEPT = 1e-4, STRAIGHT_ACCEPT = 1e-7;
static const int TRIAL_STEPS = 3;
/* So many points before its turn a particle's data are asked for: all of it fits into a core's nearest
 * cache. */
static const uint32_t NEAR_AHEAD = 24, FAR_AHEAD = 88;
/* Guarded steps are taken side by side where so many particles, and this share of them, see others turned from them: as of smoke.
 * Elsewhere they cost little, and single precision would show: at the edges of a cube with 100 000 points hex_fraction is .988
 * in double and .985 in single. Fewer particles come to as good an order where most see none turned from them, as on coarse levels
 * of scans; smoke with 10 000 points comes to .72 instead of .76. */
static const size_t ROUGH_COUNT = 20000, ROUGH_COUNT_CALM = 4000;
static const double ROUGH_SHARE = 0.25, CALM_SHARE = 0.5;
/* Over h size: whose last step was shorter is left out until those around, by their ways in all, have gone so many times as far.
 * That leaves out a quarter in the extra sweeps of a scan. With twice as much a third, and .001 of hex_fraction is lost; four times
 * as much brings them to a stop. */
static const double IDLE_STEP = 0.01, IDLE_AROUND = 6;
/* A fast step ends with one Newton step. From this fraction of h it leaves an error of about its square times
 * kappa h. It is at most that of so many cells: a level set tells distances for three voxels on either side, and beyond those a
 * Newton step leads anywhere. */
static const double FAST_STEP_FARTHEST = 0.05, FAST_STEP_CELLS = 30;
/* Over the support and the size: who is put this near tells no other energy or step, in single precision. */
static const double SAME_PLACE = 5e-5;

relax *relax_new(size_t capacity, const energy_function *energy, const fast_kernel *fast, size_t list_limit,
                 threads *pool, error *e)
{
    relax *r = mem_alloc(sizeof *r);
    r->pool = pool;
    r->energy = energy;
    r->fast = fast;
    r->scratch = mem_alloc((size_t)threads_count(pool) * sizeof *r->scratch);
    r->near = neighbours_new(capacity, list_limit, e);
    r->flat = mem_array(capacity, sizeof *r->flat, "neighbour lists", e);
    r->moved = mem_array(capacity, sizeof *r->moved, "neighbour lists", e);
    if (!r->near || !r->flat || !r->moved) {
        relax_free(r);
        return NULL;
    }
    return r;
}

static void free_scratch(relax *r)
{
    for (int k = 0; k < threads_count(r->pool); k++) free(r->scratch[k].memory);
}

void relax_free(relax *r)
{
    if (!r) return;
    free_scratch(r);
    free(r->scratch);
    free(r->flat);
    free(r->notes);
    free(r->normal);
    free(r->moved);
    free(r->parts);
    free(r->idle);
    neighbours_free(r->near);
    free(r);
}

/* Room for a gathered list as long as the longest that the lists may hold, and for the sums of the blocks. */
static bool grow(relax *r, error *e)
{
    if (r->near->blocks > r->part_capacity) {
        const size_t room = r->near->blocks + r->near->blocks / 8;
        free(r->parts);
        r->part_capacity = 0;
        if (!(r->parts = mem_array(room, sizeof *r->parts, "the sums of a sweep", e))) return false;
        r->part_capacity = room;
    }
    size_t length = (r->near->longest + PAIR_LANES - 1) / PAIR_LANES * PAIR_LANES;
    if (length <= r->scratch_entries) return true;
    for (int k = 0; k < threads_count(r->pool); k++) {
        double *m = mem_array(9 * length, sizeof *m, "a gathered list", e);
        if (!m) return false;
        free(r->scratch[k].memory);
        r->scratch[k] = (gather){m,
                                 {0, m, m + length, m + 2 * length, m + 3 * length, m + 4 * length,
                                  m + 5 * length, m + 6 * length, m + 7 * length, m + 8 * length}};
    }
    r->scratch_entries = length;
    return true;
}

/* Whether a particle is held on a curve, or sees one that is within its support, whatever the lists hold beyond that. */
static bool is_near_curve(const relax *r, const particles *p, size_t i)
{
    const uint32_t *list = neighbours_list(r->near, i);
    bool near = particles_is_fixed(p, i);
    for (uint32_t k = 0; k < r->near->list_count[i] && !near; k++)
        near = particles_is_fixed(p, list[k]) && relax_are_within(p, i, list[k], r->sigma);
    return near;
}

/* Notes who has neighbours that face another way; nobody has moved. */
static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const particles *p = job->p;
    const neighbours *near = job->r->near;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const uint32_t *list = neighbours_list(near, i);
        double least = 1;
        for (uint32_t k = 0; k < near->list_count[i] && least > RELAX_FLAT_COSINE; k++) {
            double cosine = particles_facing(p, i, list[k]);
            least = cosine < least ? cosine : least;
        }
        if (p->place) p->near_boundary[i] = is_near_curve(job->r, p, i);
        job->r->flat[i] = (uint8_t)((least > RELAX_FLAT_COSINE) + (least > RELAX_SMOOTH_COSINE));
        job->r->moved[i] = 0;
    }
}

static void stir(relax *r, const particles *p, size_t i)
{
    if (particles_is_fixed(p, i) || (r->notes[i] & RELAX_STIRRED)) return;
    r->notes[i] |= RELAX_STIRRED;
    r->stirred_count++;
}

static void stir_around(relax *r, const particles *p, size_t i)
{
    const uint32_t *list = neighbours_list(r->near, i);
    stir(r, p, i);
    for (uint32_t k = 0; k < r->near->list_count[i]; k++) stir(r, p, list[k]);
}

void relax_mark_displaced(relax *r, const particles *p, size_t i)
{
    if (r->noted_count != p->count) return;
    r->put_count += (r->notes[i] & RELAX_PUT) == 0;
    r->notes[i] |= RELAX_PUT;
    stir_around(r, p, i);
}

void relax_clear_displaced(relax *r)
{
    for (size_t i = 0; i < r->noted_count && r->put_count > 0; i++) r->notes[i] &= RELAX_WATCHED;
    r->stirred_count = r->put_count = 0;
}

static void tell_rough(relax *r, const particles *p)
{
    const bool is_asked = r->fast && !p->patch && p->count >= ROUGH_COUNT_CALM;
    const double share = is_asked ? relax_divergent_share(r, p) : 0;
    r->rough = share > ROUGH_SHARE && (p->count >= ROUGH_COUNT || share < CALM_SHARE);
    r->mostly_creased = r->rough && share >= CALM_SHARE;
}

bool relax_build(relax *r, particles *p, double sigma, double skin, error *e)
{
    r->near->label = p->patch;
    if (!r->notes) {
        r->notes = mem_array(r->near->capacity, sizeof *r->notes, "neighbour lists", e);
        if (!r->notes) return false;
    }
    if (r->noted_count != p->count) {
        memset(r->notes, 0, p->count * sizeof *r->notes);
        r->stirred_count = r->put_count = 0;
        r->noted_count = p->count;
    }
    if (!neighbours_build(r->near, p->count, p->position, p->size, sigma + skin, r->pool, e) || !grow(r, e))
        return false;
    r->sigma = sigma;
    r->skin = skin;
    r->seen = (rest_seen){0};
    r->idle_known = false;
    if (r->fast) independent_sets_form(r->near, r->pool);
    sweep_job job = {.r = r, .p = p};
    threads_run(r->pool, p->count, 512, look_chunk, &job);
    for (size_t i = 0; i < p->count && r->put_count > 0; i++)
        if (r->notes[i] & RELAX_PUT) stir_around(r, p, i);
    tell_rough(r, p);
    if (r->rough && !r->normal)
        r->normal = mem_array(r->near->capacity, sizeof *r->normal, "neighbour lists", e);
    return !r->rough || r->normal;
}

static void note_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) relax_note_normal(job->r, job->p, i);
}

void relax_note_normals(relax *r, const particles *p)
{
    sweep_job job = {.r = r, .p = (particles *)p};
    if (r->rough && !r->through) threads_run(r->pool, p->count, 4096, note_chunk, &job);
}

void relax_ignore_normals(relax *r)
{
    r->through = true;
    r->seen = (rest_seen){0};
}

typedef struct refresh_job {
    relax *r;
    const particles *p;
    double sigma;
    atomic_bool stale, moved;
} refresh_job;

static void refresh_chunk(void *context, int worker, size_t begin, size_t end)
{
    refresh_job *job = context;
    neighbours *near = job->r->near;
    float *moved = job->r->moved;
    bool away = false;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        neighbours_place before = near->place[i], *now = &near->place[i];
        neighbours_move(near, i, job->p->position[i]);
        now->size = (float)particles_size(job->p, i);
        vec3 way = {now->x - before.x, now->y - before.y, now->z - before.z};
        const double length = vec3_norm(way) * near->unit;
        moved[i] += (float)length;
        away |= length > SAME_PLACE * job->sigma * particles_size(job->p, i) || now->size != before.size;
        /* of a pair's reach each has its half */
        double reach = 0.5 * (job->r->sigma + job->r->skin) * (double)before.size;
        if ((double)moved[i] + 0.5 * job->sigma * particles_size(job->p, i) > reach)
            atomic_store(&job->stale, true);
    }
    if (away) atomic_store(&job->moved, true);
}

bool relax_refresh(relax *r, const particles *p, double sigma)
{
    if (p->count != r->near->count) return false; /* never built, or for others */
    refresh_job job = {r, p, sigma, false, false};
    threads_run(r->pool, p->count, 4096, refresh_chunk, &job);
    if (atomic_load(&job.moved)) r->seen = (rest_seen){0};
    return !atomic_load(&job.stale);
}

typedef struct attempt {
    const relax_params *params;
    const field *field; /* of the particle */
    uint32_t *hint;     /* of its place on that field, see `sample_near` in field_ops */
    bool bounded;       /* the patch may end nearby */
    const energy_function *potential;
    pair_list *near;
    bool flat; /* all weights are 1 */
    /* The surface may have facets. Their normals are interpolated: a step in the tangent plane ends off that plane by its angle to the
     * facet, and forces, which are taken in the plane, do not tell how the energy changes on the facet. */
    bool faceted;
    bool
        has_fast; /* fast steps move particles whose weights are 1, but for those that they would carry too far */
    vec3 x, axis1, axis2;
    double sigma, spacing; /* times the particle's size */
    double bound;          /* longest step in the tangent plane */
    double limit;          /* longest displacement */
    double energy;
    unsigned boundary_axes; /* axes of the faces that the particle slides along, and never leaves */
} attempt;

/* What the turning of the particle's own normal adds to its forces, through the weights: along axis e of the
 * frame the normal turns by S e, S the shape operator. */
static void add_turning(const attempt *a, pair_forces *f)
{
    field_sample s;
    if (!field_sample_near(a->field, a->x, FIELD_HESSIAN, a->hint, &s)) return;
    double length = vec3_norm(s.gradient);
    vec3 n = vec3_scale(s.gradient, 1 / length);
    vec3 turn1 = vec3_scale(sym3_apply(s.hessian, a->axis1), 1 / length);
    vec3 turn2 = vec3_scale(sym3_apply(s.hessian, a->axis2), 1 / length);
    turn1 = vec3_axpy(-vec3_dot(turn1, n), n, turn1);
    turn2 = vec3_axpy(-vec3_dot(turn2, n), n, turn2);
    const pair_list *g = a->near;
    for (size_t k = 0; k < g->blocks * PAIR_LANES; k++) {
        vec3 nj = {g->nx[k], g->ny[k], g->nz[k]};
        double t = (vec3_dot(n, nj) - PAIR_FACING_NONE) / PAIR_FACING_RANGE;
        double r = vec3_norm(vec3_sub(a->x, (vec3){g->x[k], g->y[k], g->z[k]}));
        double support = sqrt(g->size2[k]) * a->sigma;
        if (t <= 0 || t >= 1 || r >= support) continue;
        double slope = g->amplitude[k] * g->size2[k] * 6 * t * (1 - t) / PAIR_FACING_RANGE *
                       a->potential->value(fmax(r / support, TURNING_NEAREST));
        f->d1 += slope * vec3_dot(turn1, nj);
        f->d2 += slope * vec3_dot(turn2, nj);
    }
}

static void gather_place(pair_list *g, size_t k, vec3 x, vec3 n, double amplitude, double size)
{
    g->x[k] = x.x;
    g->y[k] = x.y;
    g->z[k] = x.z;
    g->nx[k] = n.x;
    g->ny[k] = n.y;
    g->nz[k] = n.z;
    g->amplitude[k] = g->weight[k] = amplitude;
    g->size2[k] = size * size;
}

pair_list *relax_gather_list(const relax *r, const particles *p, int worker, size_t i)
{
    pair_list *g = &r->scratch[worker].list;
    const uint32_t *list = neighbours_list(r->near, i);
    size_t count = r->near->list_count[i];
    bool one_sided = particles_is_one_sided(p, i);
    g->blocks = (count + PAIR_LANES - 1) / PAIR_LANES;
    assert(g->blocks * PAIR_LANES <= r->scratch_entries);
    for (size_t k = 0; k < count; k++) {
        uint32_t j = list[k];
        vec3 normal = p->normal[j];
        if (one_sided && vec3_dot(normal, p->normal[i]) < 0) normal = vec3_scale(normal, -1);
        gather_place(g, k, p->position[j], normal,
                     0.5 * (particles_amplitude(p, i) + particles_amplitude(p, j)),
                     0.5 * (1 + particles_size(p, j) / particles_size(p, i)));
    }
    vec3 away = p->position[i];
    away.x += r->sigma * particles_size(p, i);
    for (size_t k = count; k < g->blocks * PAIR_LANES; k++) gather_place(g, k, away, p->normal[i], 0, 1);
    if (!r->flat[i] && !r->through) pair_weigh(g, p->normal[i]);
    return g;
}

double relax_damped_step(const pair_forces *f, double lambda, double *s1, double *s2)
{
    double floor = FAST_KERNEL_HESSIAN_FLOOR * (f->h11 + f->h22);
    double a = f->h11 * (1 + lambda) + floor, c = f->h22 * (1 + lambda) + floor, b = f->h12;
    double determinant = a * c - b * b, over = 1 / determinant;
    if (!(determinant > 0)) {
        *s1 = *s2 = 0;
        return 0;
    }
    *s1 = (b * f->d2 - c * f->d1) * over;
    *s2 = (b * f->d1 - a * f->d2) * over;
    return -0.5 * (*s1 * f->d1 + *s2 * f->d2);
}

/* Moves along the tangent plane (8), to *beside, and back onto the surface (9). */
static bool move(const attempt *a, double s1, double s2, vec3 *beside, vec3 *x, vec3 *normal)
{
    double h = projection_scale(a->field, a->spacing);
    const projection_limits limits = {TRIAL_STEPS, TRIAL_ACCEPT * h, RELAX_TRIAL_SHORTCUT * h,
                                      TRIAL_REJECT * h};
    double length = sqrt(s1 * s1 + s2 * s2), scale = length > a->bound ? a->bound / length : 1;
    vec3 q = vec3_axpy(scale * s1, a->axis1, vec3_axpy(scale * s2, a->axis2, a->x)), n;
    for (int axis = 0; axis < 3; axis++)
        if (a->boundary_axes >> axis & 1) vec3_set(&q, axis, vec3_get(a->x, axis));
    *beside = q;
    if (!projection_find_near(a->field, &limits, a->hint, &q, &n)) return false;
    if (a->bounded && !field_is_within_near(a->field, q, a->hint)) return false;
    /* what the projection adds must not carry it past its neighbour, nor past what the lists cover */
    if (vec3_norm(vec3_sub(q, a->x)) > a->limit) return false;
    *x = q;
    *normal = n;
    return true;
}

/* Moves, and looks whether the energy falls. On facets it has to fall in the tangent plane. Once the level has had its sweeps it also has
 * to fall on the facet, or particles would go round across the edges of facets for ever; without fast steps only where neighbours
 * face other ways. */
static bool try_step(const attempt *a, double s1, double s2, vec3 *x, vec3 *normal)
{
    vec3 beside, q, n;
    if (!move(a, a->params->omega * s1, a->params->omega * s2, &beside, &q, &n)) return false;
    if (!a->flat) pair_weigh(a->near, n);
    const double most = a->energy * (1 - a->params->gain);
    const bool in_plane_only = a->faceted && (a->params->shaken || (a->flat && !a->has_fast));
    if (a->faceted && !(pair_energy_at(a->near, a->potential, beside, a->sigma) < most)) return false;
    if (!in_plane_only && !(pair_energy_at(a->near, a->potential, q, a->sigma) < most)) return false;
    *x = q;
    *normal = n;
    return true;
}

/* A particle whose expected gain does not come is misled by a place and a normal that are off by the last Newton step, and
 * would creep by damped steps for ever: put it on the surface to well below what `gain` can see. */
static void straighten(const attempt *a, vec3 *x, vec3 *normal)
{
    double h = projection_scale(a->field, a->spacing);
    const projection_limits limits = {TRIAL_STEPS, STRAIGHT_ACCEPT * h, 0, TRIAL_REJECT * h};
    projection_find_near(a->field, &limits, a->hint, x, normal);
}

/* Steps 1 to 4 of section 5. */
static void descend_damped(const sweep_job *job, const attempt *a, const pair_forces *f, size_t i,
                           double allowed_step, block_sums *sums)
{
    const relax_params *params = a->params;
    particles *p = job->p;
    double lambda = p->lambda[i] >= (float)RELAX_LAMBDA_CAP ? 0 : (double)p->lambda[i];
    for (bool first = true;; first = false) {
        double s1, s2, expected = relax_damped_step(f, pow(10, lambda), &s1, &s2);
        if (!(expected > params->gain * f->energy) || lambda > RELAX_LAMBDA_CAP) {
            p->lambda[i] = (float)RELAX_LAMBDA_CAP;
            if (!first) straighten(a, &p->position[i], &p->normal[i]);
            return;
        }
        if (a->bound < RELAX_STEP_FLOOR * a->spacing && allowed_step < sqrt(f->nearest2)) {
            relax_note_cramped(job, i, sums);
            return;
        }
        vec3 x, normal;
        if (try_step(a, s1, s2, &x, &normal)) {
            if (lambda >= MISLED_LAMBDA && a->flat && !p->near_boundary[i]) straighten(a, &x, &normal);
            relax_take_step(job, i, x, normal, vec3_norm(vec3_sub(x, a->x)), allowed_step, sums);
            p->lambda[i] = (float)(first ? fmax(lambda - 1, RELAX_LAMBDA_FLOOR) : lambda);
            return;
        }
        sums->rejected++;
        lambda += 1;
    }
}

/* (5), as used for Table 1. */
static void descend_gradient(const sweep_job *job, const attempt *a, const pair_forces *f, size_t i,
                             double allowed_step, block_sums *sums)
{
    double scale = -a->params->step * a->sigma * a->sigma;
    vec3 beside, x, normal;
    if (move(a, scale * f->d1, scale * f->d2, &beside, &x, &normal))
        relax_take_step(job, i, x, normal, vec3_norm(vec3_sub(x, a->x)), allowed_step, sums);
    else
        sums->rejected++;
}

double relax_allowed_step(const relax *r, const particles *p, size_t i)
{
    double allowed_step = 0.5 * r->skin * particles_size(p, i) - (double)r->moved[i];
    return allowed_step > 0 ? allowed_step : 0;
}

void relax_line_up(const relax *r, const particles *p, const uint32_t *items, size_t count,
                   fast_kernel_particles *out)
{
    const neighbours *near = r->near;
    assert(count > 0 && count <= FAST_KERNEL_LANES);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        uint32_t i = items[l < count ? l : 0];
        neighbours_place own = near->place[i];
        const vec3 *x = &p->position[i], *n = &p->normal[i];
        out->list[l] = neighbours_list(near, i);
        out->count[l] = l < count ? near->list_count[i] : 0;
        out->x[l] = own.x;
        out->y[l] = own.y;
        out->z[l] = own.z;
        out->size[l] = own.size;
        out->allowed_step[l] = (float)relax_allowed_step(r, p, i);
        out->damping[l] = 0;
        out->position.x[l] = x->x;
        out->position.y[l] = x->y;
        out->position.z[l] = x->z;
        out->normal.x[l] = n->x;
        out->normal.y[l] = n->y;
        out->normal.z[l] = n->z;
    }
}

/* What the fast kernel needs to know of a sweep. */
static fast_kernel_params fast_step_params(const relax *r, const relax_params *params)
{
    return (fast_kernel_params){
        .unit = r->near->unit,
        .support = params->sigma,
        .omega = params->omega,
        .longest = params->fast_step * params->spacing,
        .farthest = FAST_STEP_FARTHEST * fmin(params->spacing, FAST_STEP_CELLS * params->field->cell_size)};
}

/* Of particles of patches, by the fastest way that there is. Who would turn over has been told of another sheet, by a hint of
 * long ago: it asks without one. */
static void sample_patch_lanes(const sweep_job *job, const uint32_t *items, size_t count,
                               fast_kernel_way *way)
{
    const field *f = job->params->field;
    uint32_t patch[VEC3_LANES] = {0}, hint[VEC3_LANES] = {0};
    for (size_t l = 0; l < count; l++) {
        patch[l] = job->p->patch[items[l]];
        hint[l] = job->p->hint[items[l]];
    }
    f->ops->sample_patch_lanes(f, patch, &way->to, way->ends_well, hint, way->value, &way->gradient);
    bool again[VEC3_LANES] = {false}, any = false;
    for (size_t l = 0; l < count; l++) {
        const vec3 gradient = {way->gradient.x[l], way->gradient.y[l], way->gradient.z[l]};
        if (!way->ends_well[l] || !(vec3_dot(gradient, job->p->normal[items[l]]) < 0)) continue;
        hint[l] = FIELD_NO_HINT;
        again[l] = any = true;
    }
    if (any) f->ops->sample_patch_lanes(f, patch, &way->to, again, hint, way->value, &way->gradient);
    for (size_t l = 0; l < count; l++) job->p->hint[items[l]] = hint[l];
}

/* The field where the particles would go: each on its own patch, where there are patches. */
static void sample_lanes(const sweep_job *job, const uint32_t *items, size_t count, fast_kernel_way *way)
{
    const field *f = job->params->field;
    if (!job->p->patch) {
        field_sample_lanes(f, &way->to, way->ends_well, way->value, &way->gradient);
        return;
    }
    if (f->ops->sample_patch_lanes) {
        sample_patch_lanes(job, items, count, way);
        return;
    }
    for (size_t l = 0; l < count; l++) {
        field_sample s = {0};
        vec3 x = {way->to.x[l], way->to.y[l], way->to.z[l]};
        way->ends_well[l] =
            way->ends_well[l] && field_sample_at(particles_field(job->p, f, items[l]), x, FIELD_GRADIENT, &s);
        way->value[l] = s.value;
        way->gradient.x[l] = s.gradient.x;
        way->gradient.y[l] = s.gradient.y;
        way->gradient.z[l] = s.gradient.z;
    }
}

void relax_fast_steps(const sweep_job *job, const uint32_t *items, size_t first, size_t count,
                      const fast_kernel_particles *own, const fast_kernel_forces *forces,
                      bool stays[FAST_KERNEL_LANES], block_sums *sums)
{
    const fast_kernel *k = job->r->fast;
    const fast_kernel_params params = fast_step_params(job->r, job->params);
    fast_kernel_way way;
    block_sums more = *sums; /* in registers */
    k->step(own, forces, &params, &way);
    for (size_t l = 0; l < first; l++) way.ends_well[l] = false;
    for (size_t l = count; l < FAST_KERNEL_LANES; l++) way.ends_well[l] = false;
    sample_lanes(job, items, count, &way);
    k->land(own, &params, &way);
    for (size_t l = first; l < count; l++) {
        stays[l] = !way.ends_well[l];
        if (stays[l]) continue;
        relax_note_energy(job, items[l], (double)forces->energy[l], &more);
        more.lambda += RELAX_LAMBDA_FLOOR;
        relax_take_step(job, items[l], vec3_lanes_get(&way.to, (int)l), vec3_lanes_get(&way.gradient, (int)l),
                        way.length[l], (double)own->allowed_step[l], &more);
    }
    *sums = more;
}

/* Moves a set of independent particles whose neighbours all face their way, by the fast kernel. Particles whose step
 * does not end well stay where they are: `items` receives them. Returns how many. */
static size_t fast_step(const sweep_job *job, uint32_t *items, size_t count, block_sums *sums)
{
    const fast_kernel_params params = fast_step_params(job->r, job->params);
    fast_kernel_particles own;
    fast_kernel_forces forces;
    bool stays[FAST_KERNEL_LANES];
    relax_line_up(job->r, job->p, items, count, &own);
    job->r->fast->forces(job->r->near->place, &own, &params, &forces);
    relax_fast_steps(job, items, 0, count, &own, &forces, stays, sums);
    size_t left = 0;
    for (size_t l = 0; l < count; l++)
        if (stays[l]) items[left++] = items[l];
    return left;
}

static void update_particle(const sweep_job *job, int worker, size_t i, block_sums *sums)
{
    particles *p = job->p;
    const relax_params *params = job->params;
    uint32_t none = FIELD_NO_HINT;
    attempt a = {.params = params,
                 .hint = p->patch ? &p->hint[i] : &none,
                 .field = particles_field(p, params->field, i),
                 .bounded = p->place && p->near_boundary[i],
                 .potential = job->r->energy,
                 .near = relax_gather_list(job->r, p, worker, i),
                 .flat = job->r->flat[i] || job->r->through,
                 .faceted = p->patch != NULL,
                 .has_fast = job->r->fast != NULL,
                 .x = p->position[i],
                 .sigma = params->sigma * particles_size(p, i),
                 .spacing = params->spacing * particles_size(p, i),
                 .boundary_axes = projection_boundary_axes(params->field, p->position[i])};
    pair_forces f;
    vec3_frame(p->normal[i], &a.axis1, &a.axis2);
    pair_forces_at(a.near, a.potential, a.x, a.axis1, a.axis2, a.sigma, &f);
    if (!a.flat) add_turning(&a, &f);
    relax_note_energy(job, i, a.energy = f.energy, sums);
    /* the neighbour penalty of section 5, as a bound; and the lists' validity */
    double allowed_step = relax_allowed_step(job->r, p, i);
    a.limit = fmin(sqrt(f.nearest2), allowed_step);
    a.bound = FAST_KERNEL_BOUND_SHARE * a.limit;
    if (params->minimiser == RELAX_GRADIENT)
        descend_gradient(job, &a, &f, i, allowed_step, sums);
    else
        descend_damped(job, &a, &f, i, allowed_step, sums);
    relax_note_normal(job->r, p, i); /* that may have been put straight */
    sums->lambda += (double)p->lambda[i];
}

/* Updates an independent set: fast steps first, then the particles that need the general way. */
static void sweep_set(const sweep_job *job, int worker, const uint32_t *items, size_t count, block_sums *sums)
{
    uint32_t creased[INDEPENDENT_SET_MOST], smooth[INDEPENDENT_SET_MOST], general[INDEPENDENT_SET_MOST];
    size_t creased_count = 0, smooth_count = 0, general_count = 0;
    const particles *p = job->p;
    const bool *near_boundary = p->near_boundary;
    const uint8_t *notes = job->r->notes, *flat = job->r->flat;
    const idleness *idle = job->idle;
    for (size_t k = 0; k < count; k++) {
        const uint32_t i = items[k];
        if (particles_is_fixed(p, i))
            continue;
        else if (idle && idle[i].sleeps) {
            sums->energy += (double)idle[i].energy;
            sums->lambda += (double)p->lambda[i];
        } else if (near_boundary[i] || (notes[i] & RELAX_WATCHED))
            general[general_count++] = i;
        else if (flat[i])
            smooth[smooth_count++] = i;
        else
            creased[creased_count++] = i;
    }
    if (creased_count > 0 && job->r->rough) { /* all of them at once */
        memcpy(creased + creased_count, smooth, smooth_count * sizeof *smooth);
        relax_rough_steps(job, creased, creased_count, creased_count + smooth_count, sums);
        smooth_count = creased_count = 0;
    }
    if (smooth_count > 0) smooth_count = fast_step(job, smooth, smooth_count, sums);
    for (size_t k = 0; k < smooth_count; k++) creased[creased_count++] = smooth[k];
    if (creased_count > 0 && job->r->rough) {
        relax_rough_steps(job, creased, creased_count, creased_count, sums);
        creased_count = 0;
    }
    for (size_t k = 0; k < creased_count; k++) update_particle(job, worker, creased[k], sums);
    for (size_t k = 0; k < general_count; k++) update_particle(job, worker, general[k], sums);
}

/* Asks for what particles will need, which is found by way of what prefetch_far has asked for. (Inlined: the
 * compiler leaves out calls of a function that does nothing else.) */
ISA_INLINE void prefetch_near(const sweep_job *job, uint32_t at, uint32_t end)
{
    const neighbours *near = job->r->near;
    const neighbours_place *place = near->place;
    const vec3 *position = job->p->position, *normal = job->p->normal;
    for (; at < end; at++) {
        const uint32_t i = independent_sets_point(near, at), *list = neighbours_list(near, i);
        __builtin_prefetch(list);
        __builtin_prefetch(list + 12);
        __builtin_prefetch(&position[i].x, 1);
        __builtin_prefetch(&position[i].z, 1);
        __builtin_prefetch(&normal[i].x, 1);
        __builtin_prefetch(&normal[i].z, 1);
        __builtin_prefetch(&place[i], 1);
    }
}

ISA_INLINE void prefetch_far(const sweep_job *job, uint32_t at, uint32_t end)
{
    const neighbours *near = job->r->near;
    const relax *r = job->r;
    const particles *p = job->p;
    const uint32_t *hint = p->patch ? p->hint : NULL;
    for (; at < end; at++) {
        const uint32_t i = independent_sets_point(near, at);
        __builtin_prefetch(&near->list_begin[i]);
        __builtin_prefetch(&near->list_count[i]);
        __builtin_prefetch(&r->moved[i], 1);
        if (hint) __builtin_prefetch(&hint[i], 1);
        __builtin_prefetch(&r->flat[i]);
        __builtin_prefetch(&r->notes[i]);
        __builtin_prefetch(&p->near_boundary[i]);
        if (p->size) __builtin_prefetch(&p->size[i]);
    }
}

/* The points of `bin_item` from `at` up to `end`, each asked for before its turn comes. */
static void sweep_sets(const sweep_job *job, int worker, uint32_t at, uint32_t end, block_sums *sums)
{
    const neighbours *near = job->r->near;
    uint32_t near_end = at, far_end = at, items[INDEPENDENT_SET_MOST];
    while (at < end) {
        const uint32_t count = independent_sets_next(near, at, items), left = end - at - count;
        const uint32_t far_to = at + count + (left < FAR_AHEAD ? left : FAR_AHEAD),
                       near_to = at + count + (left < NEAR_AHEAD ? left : NEAR_AHEAD);
        prefetch_far(job, far_end, far_to);
        prefetch_near(job, near_end, near_to);
        far_end = far_to;
        near_end = near_to;
        sweep_set(job, worker, items, count, sums);
        at += count;
    }
}

static void sweep_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const neighbours *near = job->r->near;
    const size_t first = independent_sets_group_begin(near, job->colour, begin);
    uint32_t at, to;
    block_sums sums = {0};
    neighbours_block_points(near, first, independent_sets_group_begin(near, job->colour, end), &at, &to);
    if (at == to) return;
    if (job->r->fast)
        sweep_sets(job, worker, at, to, &sums);
    else
        for (; at < to; at++)
            if (!particles_is_fixed(job->p, near->bin_item[at]))
                update_particle(job, worker, near->bin_item[at], &sums);
    job->r->parts[first] = sums;
}

bool relax_allow_skipping(relax *r, error *e)
{
    if (!r->idle) r->idle = mem_array(r->near->capacity, sizeof *r->idle, "neighbour lists", e);
    return r->idle != NULL;
}

/* Tells who sleeps in the sweep to come; nobody moves. */
static void idle_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const relax *r = job->r;
    const double least = IDLE_STEP * job->params->spacing;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const uint32_t *list = neighbours_list(r->near, i);
        const double size = particles_size(job->p, i);
        idleness *own = &job->idle[i];
        float around = 0;
        for (uint32_t k = 0; k < r->near->list_count[i]; k++) around += r->moved[list[k]];
        own->sleeps = r->idle_known && !(r->notes[i] & RELAX_STIRRED) && (double)own->step < least &&
                      (double)(around - own->around) < IDLE_AROUND * least * size;
        if (own->sleeps) continue;
        own->around = around;
        own->step = 0;
    }
}

void relax_sweep(relax *r, particles *p, const relax_params *params, relax_sums *out)
{
    assert(p->count == r->near->count && params->sigma <= relax_max_support(r));
    assert(r->near->blocks <= r->part_capacity);
    sweep_job job = {.r = r, .p = p, .params = params};
    r->seen = (rest_seen){0};
    relax_note_normals(r, p);
    if (params->may_skip && r->idle && r->fast) {
        job.idle = r->idle;
        threads_run(r->pool, p->count, 1024, idle_chunk, &job);
    }
    r->idle_known = job.idle != NULL;
    memset(r->parts, 0, r->near->blocks * sizeof *r->parts);
    for (job.colour = 0; job.colour < r->near->colours; job.colour++)
        threads_run(r->pool, independent_sets_groups(r->near, job.colour), 1, sweep_chunk, &job);
    relax_sums sums = {0};
    double squares = 0, stirred = 0;
    for (size_t k = 0; k < r->near->blocks; k++) {
        const block_sums *block = &r->parts[k];
        sums.limited += block->limited;
        sums.energy += block->energy;
        sums.mean_log10_lambda += block->lambda;
        sums.rejected += block->rejected;
        sums.displaced_limited += block->displaced_limited;
        squares += block->squares;
        stirred += block->stirred_squares;
        sums.max_step = fmax(sums.max_step, block->max_step);
    }
    double count = fmax((double)particles_free_count(p), 1);
    sums.energy /= count;
    if (particles_free_count(p) == 0) sums.mean_log10_lambda = RELAX_LAMBDA_CAP; /* all are held */
    sums.mean_log10_lambda /= count;
    sums.rms_step = sqrt(squares / count) / params->spacing;
    sums.max_step /= params->spacing;
    if (r->stirred_count > 0)
        sums.displaced_step = sqrt(stirred / (double)r->stirred_count) / params->spacing;
    *out = sums;
}
