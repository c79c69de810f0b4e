/* support: the support under which particles have the ideal energy (section 6.1). See solver_state.h. */
#include "packing/packing.h"
#include "solver/adaptation.h"

/* The search for the ideal support: within one set of lists it may shrink to this fraction and grow by the
 * other; so many Newton steps settle it to the tolerance, so many sets of lists reach it from anywhere. */
static const double SHRINK_LIMIT = 0.2, SUPPORT_GROWTH = 0.5, SUPPORT_TOLERANCE = 1e-6;
enum { SUPPORT_STEPS = 6, SUPPORT_BUILDS = 24 };

/* Bounds of the support, over the spacing. A smaller one has only pairs of nearly coincident particles, whose energy no support
 * lowers. A larger one would be found only where few particles have neighbours on their patch: no support gives them the ideal
 * energy, and under a large one particles do not keep apart. */
static const double SUPPORT_LEAST = 0.5, SUPPORT_MOST = 3;

/* A step of Newton's method on log E against log sigma, from a support and the energy under it. */
double solver_nearer_support(const solver *s, double sigma, double energy)
{
    return sigma * pow(energy / s->setup.params.energy->ideal, -1 / s->setup.params.energy->ideal_slope);
}

/* The support under which the particles, where they are, have the ideal energy (6.1: a one-dimensional
 * optimisation), no farther than the lists cover. */
static double ideal_support(const solver *s)
{
    double low = SHRINK_LIMIT * s->state.sigma, high = relax_max_support(s->scratch.relax),
           sigma = s->state.sigma;
    for (int k = 0; k < SUPPORT_STEPS; k++) {
        double energy = relax_packing_energy(s->scratch.relax, s->state.p, sigma);
        if (!(energy > 0)) return high;
        if (fabs(energy / s->setup.params.energy->ideal - 1) < SUPPORT_TOLERANCE) break;
        sigma = fmin(fmax(solver_nearer_support(s, sigma, energy), low), high);
    }
    return sigma;
}

/* Grows or shrinks sigma to its ideal, with new lists as often as it leaves the old ones' range; where there is none it stays. */
bool solver_find_support(solver *s, error *e)
{
    const double given = s->state.sigma;
    for (int k = 0; k < SUPPORT_BUILDS; k++) {
        double before = s->state.sigma;
        s->state.skin = s->state.regime->schedule->skin_wide * s->state.spacing;
        if (k > 0 || !relax_has_divergent_normals(s->scratch.relax))
            s->state.skin = fmax(s->state.skin, SUPPORT_GROWTH * s->state.sigma);
        if (!solver_build_lists(s, e)) return false;
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
bool solver_settle_support(solver *s, bool changed, error *e)
{
    const schedule *given = s->state.regime->schedule;
    if (s->setup.params.max_sigma > 0) s->state.sigma = fmin(s->state.sigma, s->setup.params.max_sigma);
    const double skin = relax_max_support(s->scratch.relax) - s->state.sigma;
    s->state.skin = given->skin_wide * s->state.spacing;
    if (changed || !relax_has_divergent_normals(s->scratch.relax) ||
        skin < given->skin_narrow * s->state.spacing)
        return solver_build_lists(s, e);
    relax_set_support(s->scratch.relax, s->state.sigma);
    return true;
}
