// SPDX-License-Identifier: Apache-2.0
/* relax_measures: energies, remaining steps and defects of particles that do not move (relax.h). */
#include <assert.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "geometry/space/packing.h"
#include "sampling/solver/passes/relax_internal.h"

/* Minimum number of neighbours within the support for a meaningful Newton step. With fewer the Hessian is
 * nearly singular. */
enum { MIN_NEIGHBOURS = 3 };
/* Length of a list from which a smooth particle is assumed to have MIN_NEIGHBOURS neighbours within its
 * support. */
enum { MIN_LISTED = 9 };

/* Sets p->energy by the kernel. `has_facing`: pairs have facing weights. */
static void sum_energies(const sweep_job *job, bool has_facing, const uint32_t *items, size_t count)
{
    const fast_kernel_params params = {.unit = job->r->near->unit,
                                       .support = job->sigma,
                                       .factors = job->r->factors,
                                       .has_facing = has_facing,
                                       .has_amplitudes = job->r->has_amplitudes};
    fast_kernel_particles own;
    float energy[FAST_KERNEL_LANES];
    if (count == 0) return;
    relax_fill_lanes(job->r, job->p, items, count, &own);
    job->r->fast->energy(job->r->near->place, &own, &params, count, energy);
    for (size_t l = 0; l < count; l++) job->p->energy[items[l]] = energy[l];
}

static void energy_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    particles *p = job->p;
    uint32_t smooth[FAST_KERNEL_LANES], divergent[FAST_KERNEL_LANES];
    size_t smooth_count = 0, divergent_count = 0;
    for (size_t i = begin; i < end; i++) {
        if (!job->r->fast || (!job->r->flat[i] && !job->r->guards_in_lanes))
            p->energy[i] = (float)pair_energy_at(relax_gather_list(job->r, p, worker, i), job->r->energy,
                                                 p->position[i], job->sigma * particles_size(p, i));
        else if (job->r->flat[i] || job->r->ignores_normals)
            smooth[smooth_count++] = (uint32_t)i;
        else
            divergent[divergent_count++] = (uint32_t)i;
        if (smooth_count == FAST_KERNEL_LANES) {
            sum_energies(job, false, smooth, smooth_count);
            smooth_count = 0;
        }
        if (divergent_count == FAST_KERNEL_LANES) {
            sum_energies(job, true, divergent, divergent_count);
            divergent_count = 0;
        }
    }
    sum_energies(job, false, smooth, smooth_count);
    sum_energies(job, true, divergent, divergent_count);
}

/* Energy over the ideal energy beyond which a particle nearly coincides with another. */
static const double COINCIDENT_ENERGY = 1000;

/* Mean energy over amplitude. `most`: particles of a larger energy over amplitude are excluded. */
static double mean_energy(relax *r, particles *p, double sigma, double most)
{
    assert(p->count == r->near->count);
    sweep_job job = {.r = r, .p = p, .sigma = sigma};
    if (!(r->cached.energies && r->cached.sigma == sigma)) {
        relax_copy_factors(r, p);
        threads_run(r->pool, p->count, THREADS_GRAIN, energy_chunk, &job);
    }
    double sum = 0, alpha = 0, all = 0, all_alpha = 0;
    for (size_t i = 0; i < p->count; i++) {
        const double energy = (double)p->energy[i];
        all += energy;
        all_alpha += particles_amplitude(p, i);
        if (p->near_boundary[i] || energy > most * particles_amplitude(p, i)) continue;
        sum += energy;
        alpha += particles_amplitude(p, i);
    }
    return alpha > 0 ? sum / alpha : all / all_alpha;
}

double relax_mean_energy(relax *r, particles *p, double sigma)
{
    return mean_energy(r, p, sigma, INFINITY);
}

double relax_packing_energy(relax *r, particles *p, double sigma)
{
    return mean_energy(r, p, sigma, COINCIDENT_ENERGY * r->energy->ideal);
}

/* Newton step in spacings from which a particle takes guarded steps only. Convergence requires an rms of a
 * few thousandths. */
static const double GUARDED_STEP = 3e-3;

typedef struct steps_job {
    sweep_job sweep;
    double spacing;
    bool watch; /* particles with a long step take guarded steps from now on */
    size_t grain;
    relax_steps squares[THREADS_SUM_PARTS]; /* sums of squares */
    size_t counts[THREADS_SUM_PARTS];
    double pairs[THREADS_SUM_PARTS]; /* neighbours within the support, by the kernel */
    bool whole[THREADS_SUM_PARTS];   /* all particles of the part were evaluated by the kernel */
} steps_job;

/* Whether a guarded particle has found no step that decreases its energy. */
static bool has_converged_on_kink(const relax *r, const particles *p, uint32_t i)
{
    return (r->flags[i] & RELAX_GUARDED) && p->lambda[i] >= (float)RELAX_LAMBDA_CAP;
}

/* Whether the kernel without normals computes the energy of particle i. */
static bool has_kernel_energy(const relax *r, size_t i)
{
    return r->fast && (r->flat[i] || r->ignores_normals);
}

/* Sum of the squared Newton steps over size of particles without divergent neighbour normals. A step is
 * limited to the distance of the nearest neighbour, as in a sweep: if the Hessian is nearly singular the
 * step is meaningless. */
static relax_steps squared_steps(const steps_job *steps, int worker, const uint32_t *items, size_t count,
                                 double *pairs)
{
    const sweep_job *job = &steps->sweep;
    const double spacing = steps->spacing;
    const relax *r = job->r;
    particles *p = job->p;
    pair_forces f[FAST_KERNEL_LANES];
    relax_steps squares = {0, 0};
    double unit = 1;
    if (r->fast && count > 0) {
        const fast_kernel_params params = {.unit = r->near->unit,
                                           .support = job->sigma,
                                           .factors = r->factors,
                                           .has_amplitudes = r->has_amplitudes};
        fast_kernel_particles own;
        fast_kernel_forces forces;
        relax_fill_lanes(r, p, items, count, &own);
        r->fast->forces(r->near->place, &own, &params, &forces);
        for (size_t l = 0; l < count; l++) p->energy[items[l]] = forces.energy[l];
        for (size_t l = 0; l < count; l++) *pairs += (double)forces.pairs[l];
        for (size_t l = 0; l < count; l++)
            f[l] = (pair_forces){.d1 = (double)forces.d1[l],
                                 .d2 = (double)forces.d2[l],
                                 .h11 = (double)forces.h11[l],
                                 .h12 = (double)forces.h12[l],
                                 .h22 = (double)forces.h22[l],
                                 .nearest2 = (double)forces.nearest2[l]};
        unit = r->near->unit;
    } else {
        for (size_t l = 0; l < count; l++) {
            uint32_t i = items[l];
            vec3 axis1, axis2;
            vec3_frame(p->normal[i], &axis1, &axis2);
            pair_forces_at(relax_gather_list(r, p, worker, i), r->energy, p->position[i], axis1, axis2,
                           job->sigma * particles_size(p, i), &f[l]);
        }
    }
    for (size_t l = 0; l < count; l++) {
        double s1, s2, over = unit / particles_size(p, items[l]);
        relax_damped_step(&f[l], 0, &s1, &s2);
        double square = fmin(s1 * s1 + s2 * s2, f[l].nearest2) * over * over;
        squares.all += square;
        if (!has_converged_on_kink(r, p, items[l])) squares.without_kinks += square;
        if (steps->watch && square > GUARDED_STEP * GUARDED_STEP * spacing * spacing)
            r->flags[items[l]] |= RELAX_GUARDED;
    }
    return squares;
}

/* Whether the Newton step of particle i is meaningful: no boundary and no edge within its support, and at
 * least MIN_NEIGHBOURS neighbours. */
static bool has_meaningful_step(const sweep_job *job, size_t i)
{
    const particles *p = job->p;
    const uint32_t *list = neighbours_list(job->r->near, i), listed = job->r->near->list_count[i];
    const bool is_smooth = job->r->flat[i] > 1;
    size_t within = 0;
    if (p->near_boundary[i]) return false;
    if (is_smooth && listed >= MIN_LISTED) return true;
    for (uint32_t k = 0; k < listed; k++) {
        const uint32_t j = list[k];
        if (!relax_are_within(p, i, j, job->sigma)) continue;
        if (!is_smooth && particles_facing(p, i, j) < RELAX_SMOOTH_COSINE) return false;
        within++;
    }
    return within >= MIN_NEIGHBOURS;
}

static void steps_chunk(void *context, int worker, size_t begin, size_t end)
{
    steps_job *job = context;
    uint32_t items[FAST_KERNEL_LANES];
    size_t count = 0, part = begin / job->grain;
    bool whole = true;
    for (size_t i = begin; i < end; i++) {
        const bool is_measured = has_meaningful_step(&job->sweep, i);
        if (is_measured) items[count++] = (uint32_t)i;
        whole = whole && is_measured && has_kernel_energy(job->sweep.r, i);
        if (count < FAST_KERNEL_LANES && i + 1 < end) continue;
        const relax_steps squares = squared_steps(job, worker, items, count, &job->pairs[part]);
        job->squares[part].all += squares.all;
        job->squares[part].without_kinks += squares.without_kinks;
        job->counts[part] += count;
        count = 0;
    }
    job->whole[part] = whole;
}

/* With patches: minimum fraction of measured particles. On a model of many small faces nearly all particles
 * are near feature curves; the rms of the few others is not representative. */
static const double MIN_MEASURED_SHARE = 0.2;

static relax_steps rms_steps(steps_job *job)
{
    const size_t n = job->sweep.p->count;
    relax_steps squares = {0, 0};
    size_t count = 0;
    relax *r = job->sweep.r;
    job->grain = n / THREADS_SUM_PARTS + 1;
    memset(job->whole, true, sizeof job->whole); /* parts may be empty */
    if (r->has_amplitudes) relax_copy_factors(r, job->sweep.p);
    threads_run(r->pool, n, job->grain, steps_chunk, job);
    r->cached = (cached_steps){job->sweep.sigma, job->spacing, {NAN, NAN}, true, 0};
    for (int k = 0; k < THREADS_SUM_PARTS; k++) {
        r->cached.energies = r->cached.energies && job->whole[k];
        r->cached.pairs += job->pairs[k];
        squares.all += job->squares[k].all;
        squares.without_kinks += job->squares[k].without_kinks;
        count += job->counts[k];
    }
    if (count > 0 && (!job->sweep.p->patch || (double)count >= MIN_MEASURED_SHARE * (double)n))
        r->cached.left = (relax_steps){sqrt(squares.all / (double)count) / job->spacing,
                                       sqrt(squares.without_kinks / (double)count) / job->spacing};
    return r->cached.left;
}

relax_steps relax_rms_steps_left(relax *r, particles *p, double sigma, double spacing, bool watch)
{
    if (!watch && r->cached.sigma == sigma && r->cached.spacing == spacing) return r->cached.left;
    steps_job job = {
        .sweep = {.r = r, .p = p, .sigma = sigma}, .spacing = spacing, .watch = watch && p->patch};
    const relax_steps rms = rms_steps(&job);
    if (rms.without_kinks > GUARDED_STEP && watch && !p->patch) {
        steps_job again = {.sweep = job.sweep, .spacing = spacing, .watch = true};
        rms_steps(&again);
    }
    return rms;
}

/* Maximum number of particles that are sampled for the defect fraction. */
static const size_t MAX_SAMPLED = 200000;

/* Counts pairs within `reach` times the mean size, and particles without six of them. */
typedef struct pairs_job {
    const relax *r;
    const particles *p;
    double reach;
    size_t every; /* stride of the sampled particles */
    bool smooth;  /* particles with divergent neighbour normals are not defects */
    atomic_size_t pairs, defects;
} pairs_job;

static void pairs_chunk(void *context, int worker, size_t begin, size_t end)
{
    pairs_job *job = context;
    const particles *p = job->p;
    size_t pairs = 0, defects = 0;
    (void)worker;
    for (size_t i = (begin + job->every - 1) / job->every * job->every; i < end; i += job->every) {
        size_t own = 0;
        for (uint32_t k = 0; k < job->r->near->list_count[i]; k++)
            own += relax_are_within(p, i, neighbours_list(job->r->near, i)[k], job->reach);
        pairs += own;
        defects += own != PACKING_IDEAL_DEGREE && !p->near_boundary[i] && !(job->smooth && !job->r->flat[i]);
    }
    atomic_fetch_add(&job->pairs, pairs);
    atomic_fetch_add(&job->defects, defects);
}

double relax_mean_neighbours(const relax *r, const particles *p, double sigma)
{
    if (r->cached.energies && r->cached.sigma == sigma) return r->cached.pairs / (double)p->count;
    pairs_job job = {.r = r, .p = p, .reach = sigma, .every = 1};
    threads_run(r->pool, p->count, THREADS_GRAIN, pairs_chunk, &job);
    return (double)atomic_load(&job.pairs) / (double)p->count;
}

double relax_defect_fraction(const relax *r, const particles *p, double spacing, bool smooth)
{
    const double divergent = smooth ? relax_divergent_share(r, p) : 0,
                 sampled = divergent < 1 ? 1 - divergent : 1;
    const size_t every = 1 + p->count / MAX_SAMPLED;
    pairs_job job = {
        .r = r, .p = p, .reach = packing_first_shell(spacing), .every = every, .smooth = sampled < 1};
    threads_run(r->pool, p->count, THREADS_GRAIN, pairs_chunk, &job);
    return (double)atomic_load(&job.defects) / (sampled * (double)((p->count + every - 1) / every));
}
