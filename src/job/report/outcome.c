// SPDX-License-Identifier: Apache-2.0
#include "job/report/outcome.h"

#include <math.h>
#include <stdio.h>

#include "sampling/solver/solver_params.h"
#include "surface/volume/thin_walls.h"

const char *const outcome_names[] = {OUTCOME_LIST(WORDS_TEXT, OUTCOME)};

/* In spacings. The maximum distance of a place from the nearest point is .58 in an ideal packing, and 1 at a
 * vacancy. A place beyond COVERAGE_MISSING is a hole. */
static const double LARGEST_COVERAGE = 1.2;
/* Maximum fractions of the area or of the points; smaller defects are not visible to users. */
static const double MISSING_SHARE = 0.01, CLOSE_SHARE = 0.01, EMPTY_SHARE = 0.01, LOST_SHARE = 0.01,
                    RINGING_SHARE = 0.01;
/* Maximum fraction of points without a proper Voronoi cell: with more, the measures describe too little of
 * the result. */
static const double UNMEASURED_SHARE = 0.1;

/* One criterion. `fails` also returns the number that was compared, and its bound. */
typedef struct criterion {
    const char *name;
    outcome_kind otherwise; /* the outcome when it fails */
    bool of_thin_parts;     /* see outcome_reason */
    bool (*fails)(const outcome_input *in, double *value, double *bound);
    /* a format: what was found, with the value and perhaps the bound as arguments, then what to do */
    const char *message;
    double unit; /* factor of both arguments: 100 for a percentage */
} criterion;

static bool exceeds(double number, double most, double *value, double *bound)
{
    *value = number;
    *bound = most;
    return number > most;
}

/* Fails if the solve was stopped, whatever its last step. */
static bool out_of_sweeps(const outcome_input *in, double *value, double *bound)
{
    *value = in->rms_step;
    *bound = in->step_tolerance;
    return in->stopped;
}

/* Measured on the delivered points, independent of the solver; NaN does not fail. */
static bool step_left(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->step_left, in->step_tolerance, value, bound);
}

static bool gain(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->gain, in->gain_tolerance, value, bound);
}

/* Tolerance of the bounds of blue noise: distances are rounded to the precision of the outputs. */
static const double PATTERN_TOLERANCE = 1e-3;

static bool least_distance(const outcome_input *in, double *value, double *bound)
{
    *value = in->measures->min_spacing_ratio;
    *bound = SOLVER_BLUE_NOISE_LEAST;
    return in->is_blue_noise && !(*value >= (1 - PATTERN_TOLERANCE) * *bound);
}

static bool relative_coverage(const outcome_input *in, double *value, double *bound)
{
    *value = in->measures->coverage / in->measures->min_spacing_ratio;
    *bound = SOLVER_BLUE_NOISE_COVERAGE;
    return in->is_blue_noise && !(*value <= (1 + PATTERN_TOLERANCE) * *bound);
}

static bool target_energy(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->energy_error, in->energy_tolerance, value, bound);
}

static bool count_error(const outcome_input *in, double *value, double *bound)
{
    return exceeds((double)in->count_error, 0, value, bound);
}

static bool lost(const outcome_input *in, double *value, double *bound)
{
    return exceeds((double)in->lost, 0, value, bound);
}

static bool max_residual(const outcome_input *in, double *value, double *bound)
{
    *value = in->residual;
    *bound = OUTCOME_RESIDUAL;
    return !(*value <= *bound);
}

static bool coverage(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->measures->coverage, LARGEST_COVERAGE, value, bound);
}

static bool missing_share(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->measures->missing_share, MISSING_SHARE, value, bound);
}

static bool close_share(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->measures->close_share, CLOSE_SHARE, value, bound);
}

static bool coincident(const outcome_input *in, double *value, double *bound)
{
    return exceeds((double)in->measures->coincident, 0, value, bound);
}

static bool parts_without_points(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->measures->empty_area_share, EMPTY_SHARE, value, bound);
}

static bool unmeasured_share(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->measures->unmeasured_share, UNMEASURED_SHARE, value, bound);
}

static bool lost_area(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->lost_area, LOST_SHARE, value, bound);
}

static bool ringing(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->ringing, RINGING_SHARE, value, bound);
}

static bool lost_walls(const outcome_input *in, double *value, double *bound)
{
    return exceeds(in->lost_walls, THIN_WALLS_MOST_LOST, value, bound);
}

static const criterion criteria[] = {
    {"rms_step", OUTCOME_NOT_CONVERGED, false, out_of_sweeps,
     "rms_step: the solve reached solver.max_sweeps before it converged; the RMS step of its last sweep is "
     "%.3g spacings. Raise solver.max_sweeps.",
     1},
    {"step_left", OUTCOME_NOT_CONVERGED, false, step_left,
     "step_left: the points have not converged: their next relaxation step is %.3g spacings (at most %.3g), usually "
     "at details, edges or walls smaller than the spacing. Ask for more points. If an intersection only cuts off a "
     "part of a surface, use region instead. With the minimiser gradient, raise solver.step.",
     1},
    {"gain", OUTCOME_NOT_CONVERGED, true, gain,
     "gain: a point can lower its energy by a fraction of %.3g (at most %.3g), usually at features smaller "
     "than the spacing. Ask for more points.",
     1},
    {"target_energy", OUTCOME_NOT_CONVERGED, false, target_energy,
     "target_energy: the mean energy differs from the ideal one by %.3g %% (at most %.3g %%). Change "
     "sampling.control.max_sigma, or solver.sigma if the spec has no sampling.control.",
     100},
    {"min_spacing_ratio", OUTCOME_NOT_CONVERGED, true, least_distance,
     "min_spacing_ratio: two points are %.3g spacings from each other (pattern blue_noise: at least %.3g). Ask for "
     "more points.",
     1},
    {"relative_coverage", OUTCOME_NOT_CONVERGED, true, relative_coverage,
     "relative_coverage: a place of the surface is %.4g times the least distance from its nearest point (pattern "
     "blue_noise: at most %.3g). Ask for more points.",
     1},
    {"count_error", OUTCOME_NOT_CONVERGED, false, count_error,
     "count_error: the number of points differs from the requested count by %.0f. Use the method sized, "
     "which meets the count.",
     1},
    {"lost", OUTCOME_NOT_CONVERGED, false, lost,
     "lost: the number of points that are not on the surface is %.0f, a fault of hexad. Report it with the "
     "spec and the input.",
     1},
    {"max_residual", OUTCOME_NOT_CONVERGED, false, max_residual,
     "max_residual: a point is %.3g spacings from the surface (at most %.3g), a fault of hexad. Report it "
     "with the spec and the input.",
     1},
    {"coverage", OUTCOME_UNRESOLVED, false, coverage,
     "coverage: a place of the surface is %.3g spacings from its nearest point (at most %.3g). Ask for more "
     "points, or for smaller voxels if a mesh is sampled through a level set.",
     1},
    {"missing_share", OUTCOME_UNRESOLVED, true, missing_share,
     "missing_share: %.3g %% of the area has no point within 1.2 spacings on its side (at most %.3g %%): one "
     "wall of a thin part may have no points. Ask for more points.",
     100},
    {"close_share", OUTCOME_UNRESOLVED, true, close_share,
     "close_share: %.3g %% of the points have another one within 0.25 spacings on their side (at most %.3g "
     "%%), as along the two rims of a thin wall. Ask for more points.",
     100},
    {"coincident", OUTCOME_UNRESOLVED, true, coincident,
     "coincident: the number of points with another one within 0.001 spacings is %.0f, a fault of hexad. "
     "Report it with the spec and the input.",
     1},
    {"parts_without_points", OUTCOME_UNRESOLVED, false, parts_without_points,
     "parts_without_points: connected components with %.3g %% of the area have no points (at most %.3g %%). "
     "Ask for more points.",
     100},
    {"unmeasured_share", OUTCOME_UNRESOLVED, false, unmeasured_share,
     "unmeasured_share: %.3g %% of the points have fewer than three neighbours (at most %.3g %%), so the "
     "packing is not measured. Ask for more points.",
     100},
    {"lost_area", OUTCOME_UNRESOLVED, false, lost_area,
     "lost_area: %.3g %% of the area is thinner than a voxel, or than the cells of a combination, and is not "
     "sampled (at most %.3g %%). Follow the warning that gives this share.",
     100},
    {"ringing", OUTCOME_UNRESOLVED, false, ringing,
     "ringing: %.3g %% of the cells of the surface are made or displaced by overshoot of the spline beside a jump of "
     "the samples (at most %.3g %%). If a value means that there are no data, give it as no_data; otherwise choose an "
     "isovalue in the middle of the jump, or set reconstruction to \"smoothing\".",
     100},
    {"lost_walls", OUTCOME_UNRESOLVED, false, lost_walls,
     "lost_walls: about %.3g %% of the area is of walls that lie between the samples of the volume, and is not "
     "sampled (at most %.3g %%). Use a volume with smaller voxels, or choose another isovalue.",
     100},
};

/* ---- outcome.require */

typedef struct requirement {
    double (*measure)(const outcome_input *in);
    bool minimum;
} requirement;

#define MEASURE(name)                                      \
    static double required_##name(const outcome_input *in) \
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

static double required_max_residual(const outcome_input *in)
{
    return in->residual;
}

static double required_rms_residual(const outcome_input *in)
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
enum {
    CRITERIA = sizeof criteria / sizeof *criteria,
    REQUIREMENTS = sizeof requirements / sizeof *requirements
};
_Static_assert(CRITERIA + REQUIREMENTS <= OUTCOME_MOST_REASONS, "each criterion can be a reason");

bool outcome_is_of_thin_parts(const outcome_result *v)
{
    bool is = false;
    for (size_t k = 0; k < v->reason_count; k++) is |= v->reason[k].of_thin_parts;
    return is;
}

static void add_reason(outcome_result *v, outcome_kind otherwise, const outcome_reason *reason)
{
    if (otherwise > v->outcome) v->outcome = otherwise;
    v->reason[v->reason_count++] = *reason;
}

/* NaN, from too few points, does not meet a requirement. */
static bool is_missed(const requirement *r, double value, double bound)
{
    return r->minimum ? !(value >= bound) : !(value <= bound);
}

static void write_requirement(const requirement *r, outcome_reason *out)
{
    char value[32] = "undefined";
    if (!isnan(out->value)) snprintf(value, sizeof value, "%.3g", out->value);
    snprintf(out->message, sizeof out->message,
             "%s: the measure is %s (outcome.require: %s %.3g). Ask for more points, or change this bound.",
             out->criterion, value, r->minimum ? "at least" : "at most", out->bound);
}

outcome_result outcome_evaluate(const outcome_input *in)
{
    outcome_result v = {.outcome = OUTCOME_CONVERGED};
    for (size_t k = 0; k < CRITERIA; k++) {
        const criterion *c = &criteria[k];
        outcome_reason reason = {.criterion = c->name, .of_thin_parts = c->of_thin_parts};
        if (!c->fails(in, &reason.value, &reason.bound)) continue;
        snprintf(reason.message, sizeof reason.message, c->message, c->unit * reason.value,
                 c->unit * reason.bound);
        add_reason(&v, c->otherwise, &reason);
    }
    for (size_t k = 0; k < REQUIREMENTS; k++) {
        outcome_reason reason = {.criterion = requirement_names[k],
                                 .value = requirements[k].measure(in),
                                 .bound = in->require[k].bound};
        if (!in->require[k].given || !is_missed(&requirements[k], reason.value, reason.bound)) continue;
        write_requirement(&requirements[k], &reason);
        add_reason(&v, OUTCOME_UNRESOLVED, &reason);
    }
    return v;
}

void outcome_describe(const outcome_result *v, json *report)
{
    json_put_string(report, "outcome", outcome_names[v->outcome]);
    json *array = json_put_array(report, "outcome_reasons");
    for (size_t k = 0; k < v->reason_count; k++) {
        json *object = json_append_object(array);
        json_put_string(object, "criterion", v->reason[k].criterion);
        json_put_number(object, "value", v->reason[k].value);
        json_put_number(object, "bound", v->reason[k].bound);
        json_put_string(object, "message", v->reason[k].message);
    }
}
