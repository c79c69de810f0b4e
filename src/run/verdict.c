#include "run/verdict.h"

#include <math.h>

const char *const verdict_names[] = {VERDICT_LIST(WORDS_TEXT, VERDICT)};

/* With more of the points near boundaries the measures speak for none of them. */
static const double BOUNDARY_SHARE = 0.98;
/* More of a mesh than this is missed by people who look. */
static const double MISSING_SHARE = 0.01;
/* Where six of ten points have six neighbours it is 0.13, where nine of ten have, 0.06. */
static const double DISORDERED_EDGES = 0.1;
/* Defects leave distances down to 0.8 of the spacing, creases down to 0.6. Closer points have merged or face each other
 * through a thin part. */
static const double CLOSEST_POINTS = 0.5;
/* An ideal packing leaves places .58 of the spacing from the nearest point, a vacancy 1. */
static const double FARTHEST_PLACE = 1.2;

/* One criterion. `fails` also returns the number that was compared, and its bound. */
typedef struct criterion {
    const char *name;
    verdict_outcome otherwise; /* the outcome when it fails */
    bool (*fails)(const verdict_input *in, double *value, double *bound);
    const char *message;
    const char
        *of_thin; /* the message where some labels are thin; NULL: the same, and they are not the cause */
} criterion;

/* After what is so there. */
#define AROUND_VOXELS                                                                                           \
    ", as on labels that are one voxel thin, which the warnings name: follow advice; where it says nothing of " \
    "them, ask for more points"

/* The solve was stopped, whatever its last step. */
static bool rms_step(const verdict_input *in, double *value, double *bound)
{
    size_t count;
    const sampler_sweep *sweep = sampler_sweeps(in->sampler, &count);
    sampler_outcome end = sampler_result(in->sampler);
    *value = count > 0 ? sweep[count - 1].rms_step : 0;
    *bound = in->step_tolerance;
    return end == SAMPLER_RUNNING || end == SAMPLER_OUT_OF_SWEEPS;
}

/* Of the points as they are delivered, whatever the solve thought of them; NaN fails nothing. */
static bool step_left(const verdict_input *in, double *value, double *bound)
{
    *value = sampler_result_points(in->sampler)->step_to_rest;
    *bound = in->step_tolerance;
    return *value > *bound;
}

static bool gain(const verdict_input *in, double *value, double *bound)
{
    size_t count;
    const sampler_round *round = sampler_rounds(in->sampler, &count);
    *value = count > 0 ? round[count - 1].gain : 0;
    *bound = sampler_coarsest_gain(in->sampler);
    return *value > *bound;
}

/* Near boundaries pairs are missing, and energies with them: where all but a few points lie there it is boundary_share that fails. */
static bool target_energy(const verdict_input *in, double *value, double *bound)
{
    const sampler_points *p = sampler_result_points(in->sampler);
    *value = fabs(p->mean_energy / p->ideal_energy - 1);
    *bound = in->energy_tolerance;
    return *value > *bound && !verdict_is_near_boundaries(in->quality, p);
}

/* Some methods end with as many particles as they come to; the count of others is exact. */
static bool count_error(const verdict_input *in, double *value, double *bound)
{
    *value = fabs((double)sampler_result_points(in->sampler)->count - (double)in->count);
    *bound = 0;
    return in->count > 0 && *value > *bound;
}

static bool lost(const verdict_input *in, double *value, double *bound)
{
    *value = (double)sampler_result_points(in->sampler)->lost;
    *bound = 0;
    return *value > *bound;
}

static bool max_residual(const verdict_input *in, double *value, double *bound)
{
    *value = in->residual;
    *bound = VERDICT_RESIDUAL;
    return !(*value <= *bound);
}

static bool unresolved_share(const verdict_input *in, double *value, double *bound)
{
    *value = quality_unresolved_share(in->quality);
    *bound = VERDICT_UNRESOLVED_SHARE;
    return *value > *bound;
}

static double share_near_boundaries(const quality *q, const sampler_points *p)
{
    return (double)q->rim_count / (double)p->stands.count;
}

static bool boundary_share(const verdict_input *in, double *value, double *bound)
{
    *value = share_near_boundaries(in->quality, sampler_result_points(in->sampler));
    *bound = BOUNDARY_SHARE;
    return *value > *bound;
}

static bool missing_share(const verdict_input *in, double *value, double *bound)
{
    *value = in->missing;
    *bound = MISSING_SHARE;
    return *value > *bound;
}

/* Measures are NaN, which fails nothing, where no point can be measured. */
static bool disorder(const verdict_input *in, double *value, double *bound)
{
    *value = in->quality->disorder;
    *bound = in->energy_tolerance;
    return *value > *bound;
}

static bool edge_cv(const verdict_input *in, double *value, double *bound)
{
    *value = in->quality->resolved.edge_cv;
    *bound = DISORDERED_EDGES;
    return *value > *bound;
}

static bool min_spacing_ratio(const verdict_input *in, double *value, double *bound)
{
    *value = in->quality->min_spacing_ratio;
    *bound = CLOSEST_POINTS;
    return *value < *bound;
}

static bool coverage(const verdict_input *in, double *value, double *bound)
{
    *value = in->coverage;
    *bound = FARTHEST_PLACE;
    return *value > *bound;
}

static const criterion criteria[] = {
    {"rms_step", VERDICT_NOT_CONVERGED, rms_step,
     "the solve ended while the points still moved: raise solver.max_sweeps or sampling.time_s", NULL},
    {"step_left", VERDICT_NOT_CONVERGED, step_left,
     "the delivered points are so far, in spacings, from where their energy wants them: raise solver.max_sweeps, or "
     "solver.step for the gradient minimiser",
     NULL},
    {"gain", VERDICT_NOT_CONVERGED, gain,
     "some points creep without end, most often at features smaller than the spacing: ask for more points",
     "some points creep without end" AROUND_VOXELS},
    {"target_energy", VERDICT_NOT_CONVERGED, target_energy,
     "the support that was found or allowed does not give the ideal energy: see sigma, and max_sigma of the spec",
     NULL},
    {"count_error", VERDICT_NOT_CONVERGED, count_error,
     "the method came to so many more or fewer points than requested: use method sized for an exact count",
     NULL},
    {"lost", VERDICT_NOT_CONVERGED, lost,
     "points ended off the surface: it has no gradient there, or it ends; report this surface as a fault",
     NULL},
    {"max_residual", VERDICT_NOT_CONVERGED, max_residual,
     "a point is this far from the surface, in spacings, also after it was projected again: report this surface as a fault",
     NULL},
    {"unresolved_share", VERDICT_UNRESOLVED, unresolved_share,
     "so many points have no cell of their own: another sheet of the surface lies closer than 1.2 spacings to them or to a "
     "neighbour: ask for more points, or a finer spacing",
     "so many points have no cell of their own: another sheet of the surface lies closer than 1.2 spacings to them or to a "
     "neighbour, as the two sides of a label one voxel thin do: the warnings name such, and advice says what to do"},
    {"boundary_share", VERDICT_UNRESOLVED, boundary_share,
     "so many points lie within two spacings of a boundary, where no packing is measured: ask for more points, or a "
     "wider region",
     NULL},
    {"missing_share", VERDICT_UNRESOLVED, missing_share,
     "so much of the area is thinner than a voxel, or a combination's cells, and has no points: the warning says what shows it",
     NULL},
    {"disorder", VERDICT_UNRESOLVED, disorder,
     "the points are at rest but not in order: ask for more points where the surface has small features, and use the "
     "cotangent energy",
     "the points are at rest but not in order" AROUND_VOXELS},
    {"edge_cv", VERDICT_UNRESOLVED, edge_cv,
     "distances between neighbours differ more than in an ordered packing: ask for more points where the surface has "
     "small features, and use the cotangent energy",
     "distances between neighbours differ more than in an ordered packing" AROUND_VOXELS},
    {"min_spacing_ratio", VERDICT_UNRESOLVED, min_spacing_ratio,
     "two points are this close, in spacings: ask for more points where the surface has small features, and use the "
     "cotangent energy",
     "two points are this close, in spacings" AROUND_VOXELS},
    {"coverage", VERDICT_UNRESOLVED, coverage,
     "a place of the surface is this far, in spacings, from all points: a part is too small for a point of its own, or, of "
     "a mesh, thinner than a voxel: ask for more points, or for smaller voxels",
     NULL},
};

_Static_assert(sizeof criteria / sizeof *criteria <= VERDICT_MOST_REASONS, "each criterion can be a reason");

bool verdict_is_near_boundaries(const quality *q, const sampler_points *p)
{
    return share_near_boundaries(q, p) > BOUNDARY_SHARE;
}

bool verdict_is_of_thin_parts(const verdict *v)
{
    bool is = false;
    for (size_t k = 0; k < v->reason_count; k++) is |= v->reason[k].of_thin_parts;
    return is;
}

verdict verdict_judge(const verdict_input *in)
{
    verdict v = {.outcome = VERDICT_CONVERGED};
    for (size_t k = 0; k < sizeof criteria / sizeof *criteria; k++) {
        const criterion *c = &criteria[k];
        const char *message = in->thin_labels && c->of_thin ? c->of_thin : c->message;
        verdict_reason reason = {
            .criterion = c->name, .message = message, .of_thin_parts = c->of_thin != NULL};
        if (!c->fails(in, &reason.value, &reason.bound)) continue;
        if (c->otherwise > v.outcome) v.outcome = c->otherwise;
        v.reason[v.reason_count++] = reason;
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
