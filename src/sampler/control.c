/* control: the global control of section 6.1, one action at the end of each round. See sampler_internal.h.
 *
 * With a count alone sigma grows and shrinks to the ideal energy. With a bound on sigma as well the steady
 * state is the smallest system that keeps both: either the least count and a sigma within its bound, or sigma
 * at its bound and as many particles as have the ideal energy under it. */
#include <assert.h>
#include <stdlib.h>

#include "base/memory.h"
#include "packing/packing.h"
#include "particles/population.h"
#include "particles/random_streams.h"
#include "sampler/sampler_internal.h"

/* The search for the ideal support: within one set of lists it may shrink to this fraction and grow by the
 * other; so many Newton steps settle it to the tolerance, so many sets of lists reach it from anywhere. */
static const double SHRINK_LIMIT = 0.2, SUPPORT_GROWTH = 0.5, SUPPORT_TOLERANCE = 1e-6;
enum { SUPPORT_STEPS = 6, SUPPORT_BUILDS = 24 };

/* Bounds of the support, over the spacing. A smaller one has only pairs of nearly coincident particles, whose energy no support
 * lowers. A larger one would be found only where few particles have neighbours on their patch: no support gives them the ideal
 * energy, and under a large one particles do not keep apart. */
static const double SUPPORT_LEAST = 0.5, SUPPORT_MOST = 3;

/* Of the count: by how much it may miss that which the bound on sigma asks for. With too few particles the
 * energy falls short under that bound, so that no more may be missing than half of energy_tolerance is worth;
 * with too many sigma is a little below it. */
static const double COUNT_SLACK = 0.02;
/* In a round at most every particle splits: twins first have to find their places. */
static const double GROWTH = 2;
/* Twins start this far from where their particle was, of the new spacing. */
static const double TWIN_OFFSET = 0.25;

/* A step of Newton's method on log E against log sigma, from a support and the energy under it. */
static double nearer_support(const sampler *s, double sigma, double energy)
{
    return sigma * pow(energy / s->setup.params.energy->ideal, -1 / s->setup.params.energy->ideal_slope);
}

/* The support under which the particles, where they are, have the ideal energy (6.1: a one-dimensional
 * optimisation), no farther than the lists cover. */
static double ideal_support(const sampler *s)
{
    double low = SHRINK_LIMIT * s->state.sigma, high = relax_max_support(s->scratch.relax),
           sigma = s->state.sigma;
    for (int k = 0; k < SUPPORT_STEPS; k++) {
        double energy = relax_packing_energy(s->scratch.relax, s->state.p, sigma);
        if (!(energy > 0)) return high;
        if (fabs(energy / s->setup.params.energy->ideal - 1) < SUPPORT_TOLERANCE) break;
        sigma = fmin(fmax(nearer_support(s, sigma, energy), low), high);
    }
    return sigma;
}

/* Grows or shrinks sigma to its ideal, with new lists as often as it leaves the old ones' range; where there is none it stays. */
static bool find_support(sampler *s, error *e)
{
    const double given = s->state.sigma;
    for (int k = 0; k < SUPPORT_BUILDS; k++) {
        double before = s->state.sigma;
        s->state.skin = s->setup.schedule->skin_wide * s->state.spacing;
        if (k > 0 || !relax_is_rough(s->scratch.relax))
            s->state.skin = fmax(s->state.skin, SUPPORT_GROWTH * s->state.sigma);
        if (!sampler_build_lists(s, e)) return false;
        s->state.sigma = fmin(ideal_support(s), SUPPORT_MOST * s->state.spacing);
        if (s->state.sigma < SUPPORT_LEAST * s->state.spacing) {
            s->state.sigma = given;
            break;
        }
        bool at_bound = s->state.sigma >= (1 - SUPPORT_TOLERANCE) * relax_max_support(s->scratch.relax) ||
                        s->state.sigma <= (1 + SUPPORT_TOLERANCE) * SHRINK_LIMIT * before;
        if (!at_bound) break;
    }
    return true;
}

/* Lists for the support that was found, held to its bound. Rough surfaces have long lists, and keep those in which it was. */
static bool settle_support(sampler *s, bool changed, error *e)
{
    const schedule *given = s->setup.schedule;
    if (s->setup.params.max_sigma > 0) s->state.sigma = fmin(s->state.sigma, s->setup.params.max_sigma);
    const double skin = relax_max_support(s->scratch.relax) - s->state.sigma;
    s->state.skin = given->skin_wide * s->state.spacing;
    if (changed || !relax_is_rough(s->scratch.relax) || skin < given->skin_narrow * s->state.spacing)
        return sampler_build_lists(s, e);
    relax_take_support(s->scratch.relax, s->state.sigma);
    return true;
}

static void note_round(sampler *s, double energy)
{
    assert(s->record.round_count < SAMPLER_MAX_ROUNDS);
    s->record.round[s->record.round_count++] = (sampler_round){
        s->state.sweeps_in_round, 0, 0, s->state.sigma, sampler_point_count(s), energy, s->state.gain};
    s->state.sweeps_in_round = 0;
    s->state.resizes = 0;
}

bool sampler_reserve(sampler *s, size_t capacity, error *e)
{
    if (capacity <= s->scratch.capacity) return true;
    if (s->setup.params.count_limit > 0 && capacity > s->setup.params.count_limit)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "more than %zu particles are needed, which is what memory holds: raise "
                         "limits.memory_mb, or ask for a larger sigma or spacing",
                         s->setup.params.count_limit);
    relax *bigger = sampler_new_relax(s, capacity, e);
    if (!bigger || !particles_grow(s->state.p, capacity, e)) {
        relax_free(bigger);
        return false;
    }
    relax_free(s->scratch.relax);
    s->scratch.relax = bigger;
    s->scratch.capacity = capacity;
    return true;
}

/* Splits `k` particles, those with little energy first. *done: how many found a place. */
static bool insert_particles(sampler *s, size_t k, rng *r, size_t *done, error *e)
{
    uint32_t *chosen = mem_array(k, sizeof *chosen, "the choice of particles", e);
    bool ok =
        chosen && sampler_reserve(s, s->state.p->count + k, e) &&
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
static bool delete_particles(sampler *s, size_t k, rng *r, error *e)
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
static size_t bounded_count(const sampler *s)
{
    double ratio = s->state.sigma / s->setup.params.max_sigma, count = (double)sampler_point_count(s),
           needed = count * ratio * ratio;
    double short_of =
        fmin(COUNT_SLACK, s->setup.params.energy_tolerance / s->setup.params.energy->ideal_slope);
    if (count >= ceil(needed * (1 - short_of)) &&
        count <= fmax(ceil(needed * (1 + COUNT_SLACK)), (double)s->setup.params.min_count))
        return sampler_point_count(s);
    return (size_t)fmin(fmax(ceil(needed), (double)s->setup.params.min_count), GROWTH * count);
}

/* Inserts or deletes so many. */
static bool change_count(sampler *s, size_t before, size_t after, rng *r, sampler_round *round, error *e)
{
    if (after > before && !insert_particles(s, after - before, r, &round->inserted, e)) return false;
    round->deleted = after < before ? before - after : 0;
    return after >= before || delete_particles(s, before - after, r, e);
}

/* The same of a surface with patches, whose rows along curves become others: in all there are to be `wanted` points. */
static bool change_rows(sampler *s, size_t wanted, rng *r, sampler_round *round, error *e)
{
    const allotment_input in = {s->setup.field, s->setup.scan, s->setup.params.sizing,
                                packing_spacing(s->setup.scan->area, (double)s->setup.params.count)};
    allotment next, *held = &s->state.plan.allotments[s->state.level];
    size_t before = particles_free_count(s->state.p);
    bool ok =
        allotment_for_count(&in, wanted, &next, e) &&
        change_count(s, before, next.free_count < 2 * before ? next.free_count : 2 * before, r, round, e) &&
        sampler_reserve(s, s->state.p->count + next.rows.stands, e) &&
        allotment_replace_rows(&next, s->state.p, e);
    if (!ok) {
        allotment_free(&next);
        return false;
    }
    allotment_free(held);
    *held = next;
    s->state.spacing = next.spacing;
    return true;
}

/* Inserts or deletes particles until sigma, which is the ideal one of those at hand, is within its bound. */
static bool adapt_count(sampler *s, bool *changed, error *e)
{
    size_t before = sampler_point_count(s), wanted = bounded_count(s);
    *changed = wanted != before;
    if (!*changed) return true;
    free(s->record.replaced); /* particles are others from here on */
    s->record.replaced = NULL;
    sampler_round *round = &s->record.round[s->record.round_count - 1];
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_ROUND + s->record.round_count);
    if (s->state.p->patch ? !change_rows(s, wanted, &r, round, e)
                          : !change_count(s, before, wanted, &r, round, e))
        return false;
    if (!s->state.p->patch)
        s->state.spacing = packing_spacing(s->setup.scan->area, (double)s->state.p->count);
    s->state.sigma *= sqrt((double)before / (double)sampler_point_count(s));
    return true;
}

static void enter_stage(sampler *s, int stage)
{
    assert(stage >= 0 && stage < SCHEDULE_STAGES);
    s->state.stage = stage;
    s->state.gain = s->setup.schedule->gain[stage];
    particles_undamp(s->state.p);
}

/* A coarsest level that is the last one: particles are near their rest now, and most sweeps are to come. */
static bool look_at_whole(sampler *s, error *e)
{
    if (!sampler_judge_coarse(s, e)) return false;
    if (!s->setup.fast || s->state.p->patch || s->state.coarse || sampler_is_given(s)) return true;
    return sampler_cover_parts(s, e) && (!s->state.lists_stale || sampler_build_lists(s, e));
}

bool sampler_control(sampler *s, error *e)
{
    double energy = relax_packing_energy(s->scratch.relax, s->state.p, s->state.sigma);
    note_round(s, energy);
    bool last_stage = s->state.stage == SCHEDULE_STAGES - 1;
    if (last_stage &&
        s->state.coarse) { /* the ideal is that of one sheet: its support is for the report alone */
        if (!find_support(s, e)) return false;
        energy = relax_packing_energy(s->scratch.relax, s->state.p, s->state.sigma);
    }
    bool bounded = s->setup.params.max_sigma > 0;
    bool changed = false, again = false;
    if (s->state.level == 0 && s->state.plan.count > 1 && !sampler_replan(s, &again, e)) return false;
    if (again) return true;
    if (last_stage &&
        s->state.level < s->state.plan.count - 1) { /* the next level starts nearer to its ideal */
        if (energy > 0) s->state.sigma = nearer_support(s, s->state.sigma, energy);
        return sampler_refine(s, e);
    }
    bool good = last_stage && sampler_is_on_target(s, energy);
    if (s->record.round_count == SAMPLER_MAX_ROUNDS || (good && !bounded)) {
        s->state.outcome =
            good && s->state.gain <= s->setup.schedule->coarsest_gain ? SAMPLER_CONVERGED : SAMPLER_STALLED;
        return true;
    }
    if (s->state.plan.count == 1 && s->state.stage == SCHEDULE_STAGES - 2 && !look_at_whole(s, e))
        return false;
    const double before = s->state.sigma;
    if (!find_support(s, e) || (bounded && !adapt_count(s, &changed, e))) return false;
    if (changed)
        enter_stage(s, 0);
    else if (good)
        s->state.outcome =
            s->state.gain <= s->setup.schedule->coarsest_gain ? SAMPLER_CONVERGED : SAMPLER_STALLED;
    else if (last_stage && s->state.sigma == before)
        s->state.outcome = SAMPLER_STALLED;
    else {
        s->state.calmed = last_stage && s->state.p->patch;
        if (s->state.calmed) s->state.is_rough = false;
        enter_stage(s, last_stage ? s->state.stage : s->state.stage + 1);
    }
    return settle_support(s, changed, e);
}
