/* count: the number of particles with which the ideal support keeps its bound (section 6.1). See solver_state.h.
 *
 * With a count alone sigma grows and shrinks to the ideal energy. With a bound on sigma as well the steady
 * state is the smallest system that keeps both: either the least count and a sigma within its bound, or sigma
 * at its bound and as many particles as have the ideal energy under it. */
#include <stdlib.h>

#include "base/memory.h"
#include "packing/packing.h"
#include "solver/particles/population.h"
#include "solver/particles/random_streams.h"
#include "solver/adaptation.h"

/* Of the count: by how much it may miss that which the bound on sigma asks for. With too few particles the
 * energy falls short under that bound, so that no more may be missing than half of energy_tolerance is worth;
 * with too many sigma is a little below it. */
static const double COUNT_SLACK = 0.02;
/* In a round at most every particle splits: twins first have to find their places. */
static const double GROWTH = 2;
/* Twins start this far from where their particle was, of the new spacing. */
static const double TWIN_OFFSET = 0.25;

/* Splits `k` particles, those with little energy first. *done: how many found a place. */
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

/* Deletes `k` particles, those with much energy first. */
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

/* The count of which the support at hand, the ideal one of the particles at hand, becomes the bound: spacing
 * goes as the root of the area per particle, and the ideal support as the spacing. Near the ideal energy this
 * is the system's energy, N (E_ideal / E)^(2 / slope); far from it that power law would overshoot. */
static size_t bounded_count(const solver *s)
{
    double ratio = s->state.sigma / s->setup.params.max_sigma, count = (double)solver_point_count(s),
           needed = count * ratio * ratio;
    double short_of =
        fmin(COUNT_SLACK, s->setup.params.energy_tolerance / s->setup.params.energy->ideal_slope);
    if (count >= ceil(needed * (1 - short_of)) &&
        count <= fmax(ceil(needed * (1 + COUNT_SLACK)), (double)s->setup.params.min_count))
        return solver_point_count(s);
    return (size_t)fmin(fmax(ceil(needed), (double)s->setup.params.min_count), GROWTH * count);
}

/* Inserts or deletes so many. */
static bool change_count(solver *s, size_t before, size_t after, rng *r, solver_round *round, error *e)
{
    if (after > before && !insert_particles(s, after - before, r, &round->inserted, e)) return false;
    round->deleted = after < before ? before - after : 0;
    return after >= before || delete_particles(s, before - after, r, e);
}

/* The same of a surface with patches, whose rows along curves become others: in all there are to be `wanted` points. */
static bool change_rows(solver *s, size_t wanted, rng *r, solver_round *round, error *e)
{
    const quota_input in = {s->setup.field, s->setup.scan, s->setup.params.sizing,
                            packing_spacing(s->setup.scan->area, (double)s->setup.params.count)};
    quota next, *held = &s->state.plan.quotas[s->state.level];
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
    quota_free(held);
    *held = next;
    s->state.spacing = next.spacing;
    return true;
}

/* Inserts or deletes particles until sigma, which is the ideal one of those at hand, is within its bound. */
bool solver_adapt_count(solver *s, bool *changed, error *e)
{
    size_t before = solver_point_count(s), wanted = bounded_count(s);
    *changed = wanted != before;
    if (!*changed) return true;
    free(s->record.replaced); /* particles are others from here on */
    s->record.replaced = NULL;
    solver_round *round = &s->record.round[s->record.round_count - 1];
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_ROUND + (uint64_t)s->state.control_rounds);
    if (s->state.p->patch ? !change_rows(s, wanted, &r, round, e)
                          : !change_count(s, before, wanted, &r, round, e))
        return false;
    if (!s->state.p->patch)
        s->state.spacing = packing_spacing(s->setup.scan->area, (double)s->state.p->count);
    s->state.sigma *= sqrt((double)before / (double)solver_point_count(s));
    return true;
}
