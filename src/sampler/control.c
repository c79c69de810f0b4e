/* control: the global control of section 6.1, one action at the end of each round. See state.h. */
#include "sampler/state.h"

/* A round relaxes until no particle can lower its energy by more than this fraction; each later one
 * looks closer. The first evens out the density, so that sigma is adapted before much work is done
 * under a wrong one. */
const double sampler_stage_gain[SAMPLER_STAGES] = {1e-4, 1e-6, 1e-8};

/* The search for the ideal support: within one set of lists it may shrink to this fraction and grow by the
 * other; so many Newton steps settle it to the tolerance, so many sets of lists reach it from anywhere. */
static const double SHRINK_LIMIT = 0.2, SUPPORT_GROWTH = 0.5, SUPPORT_TOLERANCE = 1e-6;
enum { SUPPORT_STEPS = 6, SUPPORT_BUILDS = 24 };
/* A system that rests only under a coarser gain than this is not converged. */
static const double COARSEST_GAIN = 1e-5;

/* The support under which the particles, where they are, have the ideal energy: Newton's method on log E
 * against log sigma (6.1: a one-dimensional optimisation), no farther than the lists cover. */
static double ideal_support(const sampler *s)
{
    double low = SHRINK_LIMIT * s->sigma, high = relax_max_support(s->relax), sigma = s->sigma;
    for (int k = 0; k < SUPPORT_STEPS; k++) {
        double energy = relax_mean_energy(s->relax, s->p, sigma);
        if (!(energy > 0)) return high;
        double ratio = energy / s->params.energy->ideal;
        if (fabs(ratio - 1) < SUPPORT_TOLERANCE) break;
        sigma *= pow(ratio, -1 / s->params.energy->ideal_slope);
        sigma = fmin(fmax(sigma, low), high);
    }
    return sigma;
}

/* Grows or shrinks sigma to its ideal, with new lists as often as it leaves the old ones' range. */
static bool adapt_support(sampler *s, error *e)
{
    for (int k = 0; k < SUPPORT_BUILDS; k++) {
        double before = s->sigma;
        s->skin = fmax(SAMPLER_SKIN_WIDE * s->spacing, SUPPORT_GROWTH * s->sigma);
        if (!sampler_build_lists(s, e)) return false;
        s->sigma = fmin(ideal_support(s), bbox_longest(s->scan->box) * 2);
        bool at_bound = s->sigma >= (1 - SUPPORT_TOLERANCE) * relax_max_support(s->relax) ||
                        s->sigma <= (1 + SUPPORT_TOLERANCE) * SHRINK_LIMIT * before;
        if (!at_bound) break;
    }
    s->skin = SAMPLER_SKIN_WIDE * s->spacing;
    return sampler_build_lists(s, e);
}

static void note_round(sampler *s, double energy)
{
    s->round[s->round_count++] =
        (sampler_round){s->sweeps_in_round, 0, 0, s->sigma, s->p->count, energy, s->gain};
    s->sweeps_in_round = 0;
    s->resizes = 0;
}

/* A round has come to rest: adapt the support and look closer, refine, or end. */
bool sampler_control(sampler *s, error *e)
{
    double energy = relax_mean_energy(s->relax, s->p, s->sigma);
    note_round(s, energy);
    bool last_stage = s->stage == SAMPLER_STAGES - 1, again = false;
    if (s->level == 0 && s->levels > 1 && s->stage > 0 && !sampler_replan(s, &again, e)) return false;
    if (again) return true;
    if (last_stage && s->level < s->levels - 1) return sampler_refine(s, e);
    bool on_target = sampler_is_on_target(s, energy);
    if (last_stage && (on_target || s->round_count == SAMPLER_MAX_ROUNDS)) {
        s->outcome = on_target && s->gain <= COARSEST_GAIN ? SAMPLER_CONVERGED : SAMPLER_STALLED;
        return true;
    }
    if (!last_stage) s->stage++;
    s->gain = sampler_stage_gain[s->stage];
    for (size_t i = 0; i < s->p->count; i++) s->p->lambda[i] = 0;
    return adapt_support(s, e);
}
