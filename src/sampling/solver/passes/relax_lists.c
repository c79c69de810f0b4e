// SPDX-License-Identifier: Apache-2.0
/* relax_lists: neighbour lists and particle flags of a relaxation (relax.h). */
#include "sampling/solver/passes/relax_internal.h"

#include <assert.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/packing/independent_sets.h"

/* Minimum number of particles for guarded steps in SIMD lanes (single precision). */
static const size_t MIN_LANES_COUNT = 4000;
/* Minimum fraction of particles with divergent neighbour normals for guarded steps in lanes. Below it double
 * precision gives more order: hex_fraction 0.988 instead of 0.985 on a cube with 100 000 points. */
static const double LANES_SHARE = 0.25;
/* Displacements below this over the support change neither energies nor steps in single precision. */
static const double NEGLIGIBLE_MOVE = 5e-5;

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
    free(r->flags);
    free(r->factors);
    free(r->moved);
    free(r->parts);
    free(r->skipping);
    neighbours_free(r->near);
    free(r);
}

/* Allocates scratch memory for the longest list and for the sums of all blocks. */
static bool grow(relax *r, error *e)
{
    if (r->near->blocks > r->part_capacity) {
        const size_t capacity = r->near->blocks + r->near->blocks / 8;
        free(r->parts);
        r->part_capacity = 0;
        if (!(r->parts = mem_array(capacity, sizeof *r->parts, "the sums of a sweep", e))) return false;
        r->part_capacity = capacity;
    }
    size_t length = (r->near->longest + PAIR_LANES - 1) / PAIR_LANES * PAIR_LANES;
    if (length <= r->scratch_entries) return true;
    for (int k = 0; k < threads_count(r->pool); k++) {
        double *m = mem_array(PAIR_LIST_ARRAYS * length, sizeof *m, "a gathered list", e);
        if (!m) return false;
        free(r->scratch[k].memory);
        r->scratch[k] = (gather){m, pair_list_in(m, length)};
    }
    r->scratch_entries = length;
    return true;
}

/* Whether a particle is fixed or has a fixed particle within its support. (The lists reach beyond the
 * support.) */
static bool is_near_curve(const relax *r, const particles *p, size_t i)
{
    const uint32_t *list = neighbours_list(r->near, i);
    bool near = particles_is_fixed(p, i);
    for (uint32_t k = 0; k < r->near->list_count[i] && !near; k++)
        near = particles_is_fixed(p, list[k]) && relax_are_within(p, i, list[k], r->sigma);
    return near;
}

/* Sets flat, near_boundary (with fixed particles) and moved after a list build. */
static void facing_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const particles *p = job->p;
    const neighbours *near = job->r->near;
    const double flat = p->patch && job->r->fast ? RELAX_FLAT_COSINE_OF_PATCHES : RELAX_FLAT_COSINE;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const uint32_t *list = neighbours_list(near, i);
        double least = 1;
        for (uint32_t k = 0; k < near->list_count[i] && least > flat; k++) {
            double cosine = particles_facing(p, i, list[k]);
            least = cosine < least ? cosine : least;
        }
        if (p->place) p->near_boundary[i] = (!p->patch && p->near_boundary[i]) || is_near_curve(job->r, p, i);
        job->r->flat[i] = (uint8_t)((least > flat) + (least > RELAX_SMOOTH_COSINE));
        job->r->moved[i] = 0;
    }
}

static void mark_displaced(relax *r, const particles *p, size_t i)
{
    if (particles_is_fixed(p, i) || (r->flags[i] & RELAX_DISPLACED)) return;
    r->flags[i] |= RELAX_DISPLACED;
    r->displaced_count++;
}

static void mark_neighbourhood(relax *r, const particles *p, size_t i)
{
    const uint32_t *list = neighbours_list(r->near, i);
    mark_displaced(r, p, i);
    for (uint32_t k = 0; k < r->near->list_count[i]; k++) mark_displaced(r, p, list[k]);
}

void relax_mark_displaced(relax *r, const particles *p, size_t i)
{
    if (r->flag_count != p->count) return;
    r->relocated_count += (r->flags[i] & RELAX_RELOCATED) == 0;
    r->flags[i] |= RELAX_RELOCATED;
    mark_neighbourhood(r, p, i);
}

void relax_clear_displaced(relax *r)
{
    for (size_t i = 0; i < r->flag_count && r->relocated_count > 0; i++) r->flags[i] &= RELAX_GUARDED;
    r->displaced_count = r->relocated_count = 0;
}

/* Sets guards_in_lanes, uses_normals and mostly_divergent. */
static void choose_lanes(relax *r, const particles *p)
{
    const bool may_use_lanes = r->fast && !p->patch && p->count >= MIN_LANES_COUNT;
    const double share = r->fast ? relax_divergent_share(r, p) : 0;
    r->guards_in_lanes = may_use_lanes && share > LANES_SHARE;
    r->uses_normals = r->guards_in_lanes || (p->patch && share > 0);
    r->mostly_divergent = may_use_lanes && share >= RELAX_MOSTLY_DIVERGENT;
}

/* Whether an amplitude differs from 1. */
static bool any_amplitudes(const particles *p)
{
    for (size_t i = 0; p->alpha && i < p->count; i++)
        if (p->alpha[i] != 1) return true;
    return false;
}

bool relax_build(relax *r, particles *p, double sigma, double skin, error *e)
{
    r->near->label = p->patch;
    if (!r->flags) {
        r->flags = mem_array(r->near->capacity, sizeof *r->flags, "neighbour lists", e);
        if (!r->flags) return false;
    }
    if (r->flag_count != p->count) {
        memset(r->flags, 0, p->count * sizeof *r->flags);
        r->displaced_count = r->relocated_count = 0;
        r->flag_count = p->count;
    }
    if (!neighbours_build(r->near, p->count, p->position, p->size, sigma + skin, r->pool, e) || !grow(r, e))
        return false;
    r->sigma = sigma;
    r->skin = skin;
    r->cached = (cached_steps){0};
    r->skip_known = false;
    if (r->fast) independent_sets_form(r->near, r->pool);
    sweep_job job = {.r = r, .p = p};
    threads_run(r->pool, p->count, THREADS_GRAIN, facing_chunk, &job);
    for (size_t i = 0; i < p->count && r->relocated_count > 0; i++)
        if (r->flags[i] & RELAX_RELOCATED) mark_neighbourhood(r, p, i);
    choose_lanes(r, p);
    r->has_amplitudes = r->fast && any_amplitudes(p);
    const bool has_factors = r->uses_normals || r->has_amplitudes;
    if (has_factors && !r->factors)
        r->factors = mem_array(r->near->capacity, sizeof *r->factors, "neighbour lists", e);
    return !has_factors || r->factors;
}

static void copy_factors_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) job->r->factors[i] = relax_factors(job->p, i);
}

void relax_copy_factors(relax *r, const particles *p)
{
    sweep_job job = {.r = r, .p = (particles *)p};
    if (r->has_amplitudes || (r->uses_normals && !r->ignores_normals))
        threads_run(r->pool, p->count, THREADS_GRAIN, copy_factors_chunk, &job);
}

void relax_ignore_normals(relax *r)
{
    r->ignores_normals = true;
    r->cached = (cached_steps){0};
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
        vec3 move = {now->x - before.x, now->y - before.y, now->z - before.z};
        const double length = vec3_norm(move) * near->unit;
        moved[i] += (float)length;
        away |= length > NEGLIGIBLE_MOVE * job->sigma * particles_size(job->p, i) || now->size != before.size;
        /* each particle of a pair contributes half of the reach */
        double reach = 0.5 * (job->r->sigma + job->r->skin) * (double)before.size;
        if ((double)moved[i] + 0.5 * job->sigma * particles_size(job->p, i) > reach)
            atomic_store(&job->stale, true);
    }
    if (away) atomic_store(&job->moved, true);
}

bool relax_refresh(relax *r, const particles *p, double sigma)
{
    if (p->count != r->near->count) return false; /* never built, or for other particles */
    refresh_job job = {r, p, sigma, false, false};
    threads_run(r->pool, p->count, THREADS_GRAIN, refresh_chunk, &job);
    if (atomic_load(&job.moved)) r->cached = (cached_steps){0};
    return !atomic_load(&job.stale);
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
        pair_list_set(g, k, p->position[j], normal,
                      0.5 * (particles_amplitude(p, i) + particles_amplitude(p, j)),
                      0.5 * (1 + particles_size(p, j) / particles_size(p, i)));
    }
    vec3 away = p->position[i];
    away.x += r->sigma * particles_size(p, i);
    for (size_t k = count; k < g->blocks * PAIR_LANES; k++) pair_list_set(g, k, away, p->normal[i], 0, 1);
    if (!r->flat[i] && !r->ignores_normals) pair_weigh(g, p->normal[i]);
    return g;
}

double relax_allowed_step(const relax *r, const particles *p, size_t i)
{
    double allowed_step = 0.5 * r->skin * particles_size(p, i) - (double)r->moved[i];
    return allowed_step > 0 ? allowed_step : 0;
}

void relax_fill_lanes(const relax *r, const particles *p, const uint32_t *items, size_t count,
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
        out->amplitude[l] = (float)particles_amplitude(p, i);
        out->position.x[l] = x->x;
        out->position.y[l] = x->y;
        out->position.z[l] = x->z;
        out->normal.x[l] = n->x;
        out->normal.y[l] = n->y;
        out->normal.z[l] = n->z;
    }
}

double relax_max_support(const relax *r)
{
    return r->sigma + r->skin;
}

void relax_set_support(relax *r, double sigma)
{
    assert(sigma <= relax_max_support(r));
    r->skin = relax_max_support(r) - sigma;
    r->sigma = sigma;
}

double relax_divergent_share(const relax *r, const particles *p)
{
    size_t divergent = 0;
    for (size_t i = 0; i < p->count; i++) divergent += !r->flat[i];
    return (double)divergent / (double)p->count;
}

bool relax_has_divergent_normals(const relax *r)
{
    return r->guards_in_lanes;
}

bool relax_has_mostly_divergent_normals(const relax *r)
{
    return r->mostly_divergent;
}
