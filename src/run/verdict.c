#include "run/verdict.h"

const char *const verdict_names[] = {VERDICT_LIST(WORDS_TEXT, VERDICT)};

/* In spacings. The maximum distance of a place from the nearest point is .58 in an ideal packing, and 1 at a vacancy. A
 * place beyond COVERAGE_MISSING is a hole. */
static const double LARGEST_COVERAGE = 1.2;
/* Maximum fractions of the area or of the points; smaller defects are not visible to users. */
static const double MISSING_SHARE = 0.01, CLOSE_SHARE = 0.01, EMPTY_SHARE = 0.01, LOST_SHARE = 0.01;
/* Maximum fraction of points without a proper Voronoi cell: with more, the measures describe too little of the result. */
static const double UNMEASURED_SHARE = 0.1;

/* One criterion. `fails` also returns the number that was compared, and its bound. */
typedef struct criterion {
    const char *name;
    verdict_outcome otherwise; /* the outcome when it fails */
    bool of_thin_parts;        /* see verdict_reason */
    bool (*fails)(const verdict_input *in, double *value, double *bound);
    const char *message;
} criterion;

static bool exceeds(double number, double most, double *value, double *bound)
{
    *value = number;
    *bound = most;
    return number > most;
}

/* Fails if the solve was stopped, whatever its last step. */
static bool rms_step(const verdict_input *in, double *value, double *bound)
{
    *value = in->rms_step;
    *bound = in->step_tolerance;
    return in->stopped;
}

/* Measured on the delivered points, independent of the solver; NaN does not fail. */
static bool step_left(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->step_left, in->step_tolerance, value, bound);
}

static bool gain(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->gain, in->gain_tolerance, value, bound);
}

static bool target_energy(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->energy_error, in->energy_tolerance, value, bound);
}

static bool count_error(const verdict_input *in, double *value, double *bound)
{
    return exceeds((double)in->count_error, 0, value, bound);
}

static bool lost(const verdict_input *in, double *value, double *bound)
{
    return exceeds((double)in->lost, 0, value, bound);
}

static bool max_residual(const verdict_input *in, double *value, double *bound)
{
    *value = in->residual;
    *bound = VERDICT_RESIDUAL;
    return !(*value <= *bound);
}

static bool coverage(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->measures->coverage, LARGEST_COVERAGE, value, bound);
}

static bool missing_share(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->measures->missing_share, MISSING_SHARE, value, bound);
}

static bool close_share(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->measures->close_share, CLOSE_SHARE, value, bound);
}

static bool coincident(const verdict_input *in, double *value, double *bound)
{
    return exceeds((double)in->measures->coincident, 0, value, bound);
}

static bool parts_without_points(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->measures->empty_area_share, EMPTY_SHARE, value, bound);
}

static bool unmeasured_share(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->measures->unmeasured_share, UNMEASURED_SHARE, value, bound);
}

static bool lost_area(const verdict_input *in, double *value, double *bound)
{
    return exceeds(in->lost_area, LOST_SHARE, value, bound);
}

static const criterion criteria[] = {
    {"rms_step", VERDICT_NOT_CONVERGED, false, rms_step,
     "rms_step: the RMS step of the last sweep, in spacings, exceeds its bound: the solve "
     "has not converged. Raise solver.max_sweeps or sampling.time_s."},
    {"step_left", VERDICT_NOT_CONVERGED, false, step_left,
     "step_left: the next relaxation step, in spacings, exceeds its bound: the solve has "
     "not converged. Raise solver.max_sweeps, or solver.step for the gradient minimiser."},
    {"gain", VERDICT_NOT_CONVERGED, true, gain,
     "gain: the largest fraction by which a point can lower its energy exceeds its bound, "
     "usually at features smaller than the spacing. Ask for more points."},
    {"target_energy", VERDICT_NOT_CONVERGED, false, target_energy,
     "target_energy: the relative difference between the mean energy and the ideal one "
     "exceeds its bound. Change sigma, or max_sigma of sampling.control."},
    {"count_error", VERDICT_NOT_CONVERGED, false, count_error,
     "count_error: the number of points differs from the requested count. Use method "
     "sized for an exact count."},
    {"lost", VERDICT_NOT_CONVERGED, false, lost,
     "lost: points have left the surface; the value is their number. Report this input as "
     "a fault."},
    {"max_residual", VERDICT_NOT_CONVERGED, false, max_residual,
     "max_residual: the largest distance of a point from the surface, in spacings, "
     "exceeds its bound. Report this input as a fault."},
    {"coverage", VERDICT_UNRESOLVED, false, coverage,
     "coverage: the largest distance from the surface to its nearest point, in spacings, "
     "exceeds its bound. Ask for more points; for a mesh that is sampled through a level "
     "set, ask for smaller voxels."},
    {"missing_share", VERDICT_UNRESOLVED, true, missing_share,
     "missing_share: the share of the area without a point within 1.2 spacings on the "
     "same side exceeds its bound: one wall of a thin part may have no points. Ask for "
     "more points."},
    {"close_share", VERDICT_UNRESOLVED, true, close_share,
     "close_share: the share of the points with another one within 0.25 spacings on the "
     "same side exceeds its bound, as on double rows along the rims of thin walls. Ask "
     "for more points."},
    {"coincident", VERDICT_UNRESOLVED, true, coincident,
     "coincident: points have another one within 0.001 spacings; the value is their "
     "number. Report this input as a fault."},
    {"parts_without_points", VERDICT_UNRESOLVED, false, parts_without_points,
     "parts_without_points: connected components of the surface have no points; the value "
     "is their share of the area. Ask for more points."},
    {"unmeasured_share", VERDICT_UNRESOLVED, false, unmeasured_share,
     "unmeasured_share: the share of the points with fewer than three neighbours exceeds "
     "its bound, so the packing is not measured. Ask for more points."},
    {"lost_area", VERDICT_UNRESOLVED, false, lost_area,
     "lost_area: the share of the area that is thinner than a voxel, or than the cells of "
     "a combination, exceeds its bound; it is not sampled. Follow the warning about it."},
};

/* ---- outcome.require */

typedef struct requirement {
    double (*measure)(const verdict_input *in);
    bool minimum;
} requirement;

#define MEASURE(name)                                      \
    static double required_##name(const verdict_input *in) \
    {                                                      \
        return in->measures->name;                         \
    }
MEASURE(hex_fraction)
MEASURE(edge_cv)
MEASURE(area_cv)
MEASURE(energy_excess)
MEASURE(disorder)
MEASURE(defect_share)
MEASURE(min_spacing_ratio)
MEASURE(close_share)
MEASURE(coverage)
MEASURE(missing_share)
MEASURE(unmeasured_share)
#undef MEASURE

static double required_max_residual(const verdict_input *in)
{
    return in->residual;
}

static double required_rms_residual(const verdict_input *in)
{
    return in->rms_residual;
}

/* Order of SPEC_REQUIRE_LIST. */
#define ROW(prefix, NAME, word, minimum) {required_##word, minimum},
static const requirement requirements[] = {SPEC_REQUIRE_LIST(ROW, )};
#undef ROW
#define ROW(prefix, NAME, word, minimum) #word,
static const char *const requirement_names[] = {SPEC_REQUIRE_LIST(ROW, )};
#undef ROW
#define ROW(prefix, NAME, word, minimum) \
#word ": the measure misses the bound of outcome.require. Ask for more points, or change it.",
static const char *const requirement_messages[] = {SPEC_REQUIRE_LIST(ROW, )};
#undef ROW

enum {
    CRITERIA = sizeof criteria / sizeof *criteria,
    REQUIREMENTS = sizeof requirements / sizeof *requirements
};
_Static_assert(CRITERIA + REQUIREMENTS <= VERDICT_MOST_REASONS, "each criterion can be a reason");

bool verdict_is_of_thin_parts(const verdict *v)
{
    bool is = false;
    for (size_t k = 0; k < v->reason_count; k++) is |= v->reason[k].of_thin_parts;
    return is;
}

static void add_reason(verdict *v, verdict_outcome otherwise, const verdict_reason *reason)
{
    if (otherwise > v->outcome) v->outcome = otherwise;
    v->reason[v->reason_count++] = *reason;
}

/* NaN, from too few points, does not meet a requirement. */
static bool is_missed(const requirement *r, double value, double bound)
{
    return r->minimum ? !(value >= bound) : !(value <= bound);
}

verdict verdict_judge(const verdict_input *in)
{
    verdict v = {.outcome = VERDICT_CONVERGED};
    for (size_t k = 0; k < CRITERIA; k++) {
        const criterion *c = &criteria[k];
        verdict_reason reason = {
            .criterion = c->name, .message = c->message, .of_thin_parts = c->of_thin_parts};
        if (c->fails(in, &reason.value, &reason.bound)) add_reason(&v, c->otherwise, &reason);
    }
    for (size_t k = 0; k < REQUIREMENTS; k++) {
        const verdict_reason reason = {.criterion = requirement_names[k],
                                       .value = requirements[k].measure(in),
                                       .bound = in->require[k].bound,
                                       .message = requirement_messages[k]};
        if (in->require[k].given && is_missed(&requirements[k], reason.value, reason.bound))
            add_reason(&v, VERDICT_UNRESOLVED, &reason);
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
