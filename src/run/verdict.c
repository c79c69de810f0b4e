#include "run/verdict.h"

#include <math.h>

const char *const verdict_names[] = {VERDICT_LIST(WORDS_TEXT, VERDICT)};

/* More unresolved points than this share, and the measures speak for too little of the surface. */
static const double UNRESOLVED_SHARE = 0.02;
/* Where six of ten points have six neighbours it is 0.13, where nine of ten have, 0.06. */
static const double DISORDERED_EDGES = 0.1;
/* Defects leave distances down to 0.8 of the spacing, creases down to 0.6. Closer points have merged or face each other
 * through a thin part. */
static const double CLOSEST_POINTS = 0.5;

/* One criterion. `value` returns the number that is compared with its bound, both of the input. */
typedef struct criterion {
    const char *name;
    verdict_outcome otherwise; /* the outcome when it fails */
    double (*value)(const verdict_input *in, double *bound);
    bool is_least; /* the bound is the least value, not the largest */
    const char *message;
} criterion;

static double rms_step(const verdict_input *in, double *bound)
{
    size_t count;
    const sampler_sweep *sweep = sampler_sweeps(in->sampler, &count);
    sampler_outcome end = sampler_result(in->sampler);
    bool is_stopped = end == SAMPLER_RUNNING || end == SAMPLER_OUT_OF_SWEEPS;
    *bound = is_stopped ? in->step_tolerance : INFINITY;
    return count > 0 ? sweep[count - 1].rms_step : 0;
}

static double gain(const verdict_input *in, double *bound)
{
    size_t count;
    const sampler_round *round = sampler_rounds(in->sampler, &count);
    *bound = sampler_coarsest_gain(in->sampler);
    return count > 0 ? round[count - 1].gain : 0;
}

static double target_energy(const verdict_input *in, double *bound)
{
    const sampler_points *p = sampler_result_points(in->sampler);
    *bound = in->energy_tolerance;
    return fabs(p->mean_energy / p->ideal_energy - 1);
}

/* Particles of which there are as many as a method comes to; the count of all others is exact. */
static double count_error(const verdict_input *in, double *bound)
{
    double count = (double)sampler_result_points(in->sampler)->count;
    *bound = 0;
    return in->count > 0 ? fabs(count - (double)in->count) : 0;
}

static double lost(const verdict_input *in, double *bound)
{
    *bound = 0;
    return (double)sampler_result_points(in->sampler)->lost;
}

static double unresolved_share(const verdict_input *in, double *bound)
{
    size_t inner = sampler_result_points(in->sampler)->count - in->quality->rim_count;
    *bound = UNRESOLVED_SHARE;
    return inner > 0 ? (double)in->quality->unresolved_count / (double)inner : 0;
}

static double energy_excess(const verdict_input *in, double *bound)
{
    *bound = in->energy_tolerance;
    return in->quality->energy_excess;
}

static double edge_cv(const verdict_input *in, double *bound)
{
    *bound = DISORDERED_EDGES;
    return in->quality->edge_cv;
}

static double min_spacing_ratio(const verdict_input *in, double *bound)
{
    *bound = CLOSEST_POINTS;
    return in->quality->min_spacing_ratio;
}

static const criterion criteria[] = {
    {"rms_step", VERDICT_NOT_CONVERGED, rms_step, false,
     "the solve ended while the points still moved: raise solver.max_sweeps or sampling.time_s"},
    {"gain", VERDICT_NOT_CONVERGED, gain, false,
     "some points creep without end, most often at features smaller than the spacing: ask for more points"},
    {"target_energy", VERDICT_NOT_CONVERGED, target_energy, false,
     "the support that was found or allowed does not give the ideal energy: see sigma, and max_sigma of the spec"},
    {"count_error", VERDICT_NOT_CONVERGED, count_error, false,
     "the method came to so many more or fewer points than requested: use method sized for an exact count"},
    {"lost", VERDICT_NOT_CONVERGED, lost, false,
     "points ended off the surface: it has no gradient there, or it ends; report this surface as a fault"},
    {"unresolved_share", VERDICT_UNRESOLVED, unresolved_share, false,
     "other sheets of the surface lie closer than 1.2 spacings to so many points: ask for more points, or a finer "
     "spacing"},
    {"energy_excess", VERDICT_UNRESOLVED, energy_excess, false,
     "the points are at rest but not in order: ask for more points where the surface has small features, and use the "
     "cotangent energy"},
    {"edge_cv", VERDICT_UNRESOLVED, edge_cv, false,
     "distances between neighbours differ more than in an ordered packing: ask for more points where the surface has "
     "small features, and use the cotangent energy"},
    {"min_spacing_ratio", VERDICT_UNRESOLVED, min_spacing_ratio, true,
     "two points are this close, in spacings: ask for more points where the surface has small features, and use the "
     "cotangent energy"},
};

_Static_assert(sizeof criteria / sizeof *criteria <= VERDICT_MOST_REASONS, "each criterion can be a reason");

verdict verdict_judge(const verdict_input *in)
{
    verdict v = {.outcome = VERDICT_CONVERGED};
    for (size_t k = 0; k < sizeof criteria / sizeof *criteria; k++) {
        const criterion *c = &criteria[k];
        double bound, value = c->value(in, &bound);
        if (c->is_least ? !(value < bound) : !(value > bound)) continue; /* without points to measure: NaN */
        if (c->otherwise > v.outcome) v.outcome = c->otherwise;
        v.reason[v.reason_count++] = (verdict_reason){c->name, value, bound, c->message};
    }
    return v;
}

void verdict_describe(const verdict *v, json *report)
{
    json_put_string(report, "outcome", verdict_names[v->outcome]);
    json *array = json_put_array(report, "outcome_reasons");
    for (size_t k = 0; k < v->reason_count; k++) {
        json *object = json_append_object(array);
        json_put_string(object, "criterion", v->reason[k].criterion);
        json_put_number(object, "value", v->reason[k].value);
        json_put_number(object, "bound", v->reason[k].bound);
        json_put_string(object, "message", v->reason[k].message);
    }
}
