// SPDX-License-Identifier: Apache-2.0
/* count: control of the number of particles by a bound on the support (section 6.1, adaptation.h).
 *
 * With a fixed count, sigma is adapted to the ideal energy. With a bound on sigma the steady state is the
 * smallest system with the ideal energy: the minimum count and a sigma within its bound, or sigma at its
 * bound and the count that follows. */
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/packing.h"
#include "sampling/solver/particles/population.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/adaptation.h"

/* Maximum relative deviation of the count from the count that the bound requires. Missing particles decrease
 * the energy: their maximum also follows from energy_tolerance. Additional particles only decrease sigma. */
static const double COUNT_TOLERANCE = 0.02;
/* Maximum factor on the count in one round: a particle splits once, and its twin must first move away. */
static const double MAX_GROWTH = 2;
/* Distance of twins from the position of their particle over the new spacing. */
static const double TWIN_OFFSET = 0.25;

/* Splits `k` particles, chosen at random with a bias to low energy. *done: the number of splits that
 * succeeded. */
static bool insert_particles(solver *s, size_t k, rng *r, size_t *done, error *e)
{
    uint32_t *chosen = mem_array(k, sizeof *chosen, "the choice of particles", e);
    bool ok =
        chosen && solver_reserve(s, s->state.p->count + k, e) &&
        population_choose(s->state.p, k, s->setup.params.unbiased ? POPULATION_RANDOM : POPULATION_LOW_ENERGY,
                          r, chosen, e);
    double offset = TWIN_OFFSET * packing_spacing(s->setup.scan->area, (double)(s->state.p->count + k));
    *done = 0;
    for (size_t i = 0; ok && i < k; i++)
        *done += population_split(s->setup.field, s->state.p, chosen[i], offset, r);
    free(chosen);
    return ok;
}

/* Deletes `k` particles, chosen at random with a bias to high energy. */
static bool delete_particles(solver *s, size_t k, rng *r, error *e)
{
    uint32_t *chosen = mem_array(k, sizeof *chosen, "the choice of particles", e);
    bool *marked = mem_array(s->state.p->count, sizeof *marked, "the choice of particles", e);
    bool ok = chosen && marked &&
              population_choose(s->state.p, k,
                                s->setup.params.unbiased ? POPULATION_RANDOM : POPULATION_HIGH_ENERGY, r,
                                chosen, e);
    for (size_t i = 0; ok && i < k; i++) marked[chosen[i]] = true;
    if (ok) population_remove(s->state.p, marked);
    free(chosen);
    free(marked);
    return ok;
}

/* The count for which the ideal support equals the bound. The current support is the ideal one of the current
 * particles. The spacing is proportional to the square root of the area per particle, and the ideal support
 * to the spacing. Near the ideal energy this equals N (E_ideal / E)^(2 / slope); far from it that power
 * law would overshoot. */
static size_t bounded_count(const solver *s)
{
    double ratio = s->state.sigma / s->setup.params.max_sigma, count = (double)solver_point_count(s),
           needed = count * ratio * ratio;
    double short_of =
        fmin(COUNT_TOLERANCE, s->setup.params.energy_tolerance / s->setup.params.energy->ideal_slope);
    if (count >= ceil(needed * (1 - short_of)) &&
        count <= fmax(ceil(needed * (1 + COUNT_TOLERANCE)), (double)s->setup.params.min_count))
        return solver_point_count(s);
    return (size_t)fmin(fmax(ceil(needed), (double)s->setup.params.min_count), MAX_GROWTH * count);
}

/* Inserts or deletes particles to change the count from `before` to `after`. */
static bool change_count(solver *s, size_t before, size_t after, rng *r, solver_round *round, error *e)
{
    if (after > before && !insert_particles(s, after - before, r, &round->inserted, e)) return false;
    round->deleted = after < before ? before - after : 0;
    return after >= before || delete_particles(s, before - after, r, e);
}

/* With patches: changes the number of points to `wanted` and replaces the curve samples. */
static bool change_patch_counts(solver *s, size_t wanted, rng *r, solver_round *round, error *e)
{
    const quota_input in = {s->setup.field,
                            s->setup.scan,
                            s->setup.params.sizing,
                            packing_spacing(s->setup.scan->area, (double)s->setup.params.count),
                            false,
                            s->setup.pool};
    quota next, *current = &s->state.plan.quotas[s->state.level];
    size_t before = particles_free_count(s->state.p);
    bool ok =
        quota_for_count(&in, wanted, &next, e) &&
        change_count(s, before, next.free_count < 2 * before ? next.free_count : 2 * before, r, round, e) &&
        solver_reserve(s, s->state.p->count + next.samples.copies, e) &&
        quota_replace_samples(&next, s->state.p, e);
    if (!ok) {
        quota_free(&next);
        return false;
    }
    quota_free(current);
    *current = next;
    s->state.spacing = next.spacing;
    return true;
}

bool solver_adapt_count(solver *s, bool *changed, error *e)
{
    size_t before = solver_point_count(s), wanted = bounded_count(s);
    *changed = wanted != before;
    if (!*changed) return true;
    free(s->record.replaced); /* indices change */
    s->record.replaced = NULL;
    solver_round *round = &s->record.round[s->record.round_count - 1];
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_ROUND + (uint64_t)s->state.control_rounds);
    if (s->state.p->patch ? !change_patch_counts(s, wanted, &r, round, e)
                          : !change_count(s, before, wanted, &r, round, e))
        return false;
    if (!s->state.p->patch)
        s->state.spacing = packing_spacing(s->setup.scan->area, (double)s->state.p->count);
    s->state.sigma *= sqrt((double)before / (double)solver_point_count(s));
    return true;
}
