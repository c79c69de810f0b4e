// SPDX-License-Identifier: Apache-2.0
/* relax: one sweep over all particles. */
#include "sampling/solver/passes/relax_internal.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/packing/independent_sets.h"

/* A particle whose last step was below this is skipped, over h size. */
static const double SKIP_STEP = 0.01;
/* Sum of the neighbours' path lengths that reactivates it, over SKIP_STEP. Doubled: a third instead of a
 * quarter is skipped, and hex_fraction falls by 0.001. Four times: the relaxation stops. */
static const double SKIP_AROUND = 6;

/* Moves an independent set: fast steps first, then guarded steps in lanes, then damped steps. On patches, while
 * steps are unlimited, particles near curves and with divergent normals take fast steps, too: energies may rise
 * in these sweeps, and a damped step takes five times as long. */
static void sweep_set(const sweep_job *job, int worker, const uint32_t *items, size_t count, block_sums *sums)
{
    uint32_t divergent[INDEPENDENT_SET_MOST], smooth[INDEPENDENT_SET_MOST], general[INDEPENDENT_SET_MOST];
    size_t divergent_count = 0, smooth_count = 0, general_count = 0;
    const particles *p = job->p;
    const bool *near_boundary = p->near_boundary;
    const uint8_t *flags = job->r->flags, *flat = job->r->flat;
    const skip_state *skipping = job->skipping;
    const bool is_fast = p->patch && job->params->shaken;
    for (size_t k = 0; k < count; k++) {
        const uint32_t i = items[k];
        if (particles_is_fixed(p, i))
            continue;
        else if (skipping && skipping[i].is_skipped) {
            sums->energy += (double)skipping[i].energy;
            sums->lambda += (double)p->lambda[i];
        } else if ((near_boundary[i] && !is_fast) || (flags[i] & RELAX_GUARDED))
            general[general_count++] = i;
        else if (flat[i])
            smooth[smooth_count++] = i;
        else
            divergent[divergent_count++] = i;
    }
    if (divergent_count > 0 && job->r->guards_in_lanes) {
        memcpy(divergent + divergent_count, smooth, smooth_count * sizeof *smooth);
        relax_guarded_steps(job, divergent, divergent_count, divergent_count + smooth_count, sums);
        smooth_count = divergent_count = 0;
    }
    if (divergent_count > 0 && is_fast) {
        memcpy(divergent + divergent_count, smooth, smooth_count * sizeof *smooth);
        divergent_count = relax_fast_step(job, divergent, divergent_count + smooth_count, true, sums);
        smooth_count = 0;
    }
    if (smooth_count > 0) smooth_count = relax_fast_step(job, smooth, smooth_count, false, sums);
    for (size_t k = 0; k < smooth_count; k++) divergent[divergent_count++] = smooth[k];
    if (divergent_count > 0 && job->r->guards_in_lanes) {
        relax_guarded_steps(job, divergent, divergent_count, divergent_count, sums);
        divergent_count = 0;
    }
    for (size_t k = 0; k < divergent_count; k++) relax_update_particle(job, worker, divergent[k], sums);
    for (size_t k = 0; k < general_count; k++) relax_update_particle(job, worker, general[k], sums);
}

/* Prefetches the data of the points of the next set. They lie in other bins than those of the current set. */
ISA_INLINE void prefetch_set(const sweep_job *job, uint32_t at, uint32_t end)
{
    const neighbours *near = job->r->near;
    for (uint32_t k = at; k < at + INDEPENDENT_SET_MOST && k < end; k++) {
        const uint32_t i = independent_sets_point(near, k);
        __builtin_prefetch(neighbours_list(near, i));
        __builtin_prefetch(&near->place[i], 1);
        __builtin_prefetch(&job->p->position[i], 1);
        __builtin_prefetch(&job->p->normal[i], 1);
        __builtin_prefetch(&job->r->moved[i], 1);
    }
}

/* Moves the points `at` .. `end` - 1 of `bin_item` in independent sets. */
static void sweep_sets(const sweep_job *job, int worker, uint32_t at, uint32_t end, block_sums *sums)
{
    const neighbours *near = job->r->near;
    uint32_t items[INDEPENDENT_SET_MOST];
    while (at < end) {
        const uint32_t count = independent_sets_next(near, at, items);
        at += count;
        prefetch_set(job, at, end);
        sweep_set(job, worker, items, count, sums);
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
                relax_update_particle(job, worker, near->bin_item[at], &sums);
    job->r->parts[first] = sums;
}

bool relax_allow_skipping(relax *r, error *e)
{
    if (!r->skipping) r->skipping = mem_array(r->near->capacity, sizeof *r->skipping, "neighbour lists", e);
    return r->skipping != NULL;
}

/* Sets is_skipped of each particle for the next sweep. */
static void skip_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const relax *r = job->r;
    const double least = SKIP_STEP * job->params->spacing;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const uint32_t *list = neighbours_list(r->near, i);
        const double size = particles_size(job->p, i);
        skip_state *own = &job->skipping[i];
        float around = 0;
        for (uint32_t k = 0; k < r->near->list_count[i]; k++) around += r->moved[list[k]];
        own->is_skipped = r->skip_known && !(r->flags[i] & RELAX_DISPLACED) && (double)own->step < least &&
                          (double)(around - own->around) < SKIP_AROUND * least * size;
        if (own->is_skipped) continue;
        own->around = around;
        own->step = 0;
    }
}

void relax_sweep(relax *r, particles *p, const relax_params *params, relax_sums *out)
{
    assert(p->count == r->near->count && params->sigma <= relax_max_support(r));
    assert(r->near->blocks <= r->part_capacity);
    sweep_job job = {.r = r, .p = p, .params = params};
    r->cached = (cached_steps){0};
    relax_copy_factors(r, p);
    if (params->may_skip && r->skipping && r->fast) {
        job.skipping = r->skipping;
        threads_run(r->pool, p->count, THREADS_GRAIN, skip_chunk, &job);
    }
    r->skip_known = job.skipping != NULL;
    memset(r->parts, 0, r->near->blocks * sizeof *r->parts);
    for (job.colour = 0; job.colour < r->near->colours; job.colour++)
        threads_run(r->pool, independent_sets_groups(r->near, job.colour), 1, sweep_chunk, &job);
    relax_sums sums = {0};
    double squares = 0, displaced = 0;
    for (size_t k = 0; k < r->near->blocks; k++) {
        const block_sums *block = &r->parts[k];
        sums.limited += block->limited;
        sums.energy += block->energy;
        sums.mean_log10_lambda += block->lambda;
        sums.rejected += block->rejected;
        sums.displaced_limited += block->displaced_limited;
        squares += block->squares;
        displaced += block->displaced_squares;
        sums.max_step = fmax(sums.max_step, block->max_step);
    }
    double count = fmax((double)particles_free_count(p), 1);
    sums.energy /= count;
    if (particles_free_count(p) == 0) sums.mean_log10_lambda = RELAX_LAMBDA_CAP;
    sums.mean_log10_lambda /= count;
    sums.rms_step = sqrt(squares / count) / params->spacing;
    sums.max_step /= params->spacing;
    if (r->displaced_count > 0)
        sums.displaced_step = sqrt(displaced / (double)r->displaced_count) / params->spacing;
    *out = sums;
}
