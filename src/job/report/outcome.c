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

typedef struct criterion {
    const char *name;
    outcome_kind otherwise; /* the outcome when it fails */
    bool of_thin_parts;     /* see outcome_reason */
    bool fails;
    double value, bound; /* the number that was compared, and its bound */
    /* a format: what was found, with the value and perhaps the bound as arguments, then what to do */
    const char *message;
    double unit; /* factor of both arguments: 100 for a percentage */
} criterion;

/* Tolerance of the bounds of blue noise: distances are rounded to the precision of the outputs. */
static const double PATTERN_TOLERANCE = 1e-3;

/* Three members of a criterion; NaN does not fail. */
#define EXCEEDS(value, bound) (value) > (bound), value, bound

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
enum { REQUIREMENTS = sizeof requirements / sizeof *requirements };

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

static void apply_criteria(const outcome_input *in, outcome_result *v)
{
    const measures *m = in->measures;
    const double relative = m->coverage / m->min_spacing_ratio;
    const criterion criteria[] = {
        /* fails if the solve was stopped, whatever its last step */
        {"rms_step", OUTCOME_NOT_CONVERGED, false, in->stopped, in->rms_step, in->step_tolerance,
         "rms_step: the solve reached solver.max_sweeps before it converged; the RMS step of its last sweep is "
         "%.3g spacings. Raise solver.max_sweeps.",
         1},
        /* measured on the delivered points, independent of the solver */
        {"step_left", OUTCOME_NOT_CONVERGED, false, EXCEEDS(in->step_left, in->step_tolerance),
         "step_left: the points have not converged: their next relaxation step is %.3g spacings (at most %.3g), usually "
         "at details, edges or walls smaller than the spacing. Ask for more points. If an intersection only cuts off a "
         "part of a surface, use region instead. With the minimiser gradient, raise solver.step.",
         1},
        {"gain", OUTCOME_NOT_CONVERGED, true, EXCEEDS(in->gain, in->gain_tolerance),
         "gain: a point can lower its energy by a fraction of %.3g (at most %.3g), usually at features smaller "
         "than the spacing. Ask for more points.",
         1},
        {"target_energy", OUTCOME_NOT_CONVERGED, false, EXCEEDS(in->energy_error, in->energy_tolerance),
         "target_energy: the mean energy differs from the ideal one by %.3g %% (at most %.3g %%). Change "
         "sampling.control.max_sigma, or solver.sigma if the spec has no sampling.control.",
         100},
        {"min_spacing_ratio", OUTCOME_NOT_CONVERGED, true,
         in->is_blue_noise && !(m->min_spacing_ratio >= (1 - PATTERN_TOLERANCE) * SOLVER_BLUE_NOISE_LEAST),
         m->min_spacing_ratio, SOLVER_BLUE_NOISE_LEAST,
         "min_spacing_ratio: two points are %.3g spacings from each other (pattern blue_noise: at least %.3g). Ask for "
         "more points.",
         1},
        {"relative_coverage", OUTCOME_NOT_CONVERGED, true,
         in->is_blue_noise && !(relative <= (1 + PATTERN_TOLERANCE) * SOLVER_BLUE_NOISE_COVERAGE), relative,
         SOLVER_BLUE_NOISE_COVERAGE,
         "relative_coverage: a place of the surface is %.4g times the least distance from its nearest point (pattern "
         "blue_noise: at most %.3g). Ask for more points.",
         1},
        {"count_error", OUTCOME_NOT_CONVERGED, false, EXCEEDS((double)in->count_error, 0),
         "count_error: the number of points differs from the requested count by %.0f. Use the method sized, "
         "which meets the count.",
         1},
        {"lost", OUTCOME_NOT_CONVERGED, false, EXCEEDS((double)in->lost, 0),
         "lost: the number of points that are not on the surface is %.0f, a fault of hexad. Report it with the "
         "spec and the input.",
         1},
        {"max_residual", OUTCOME_NOT_CONVERGED, false, !(in->residual <= OUTCOME_RESIDUAL), in->residual,
         OUTCOME_RESIDUAL,
         "max_residual: a point is %.3g spacings from the surface (at most %.3g), a fault of hexad. Report it "
         "with the spec and the input.",
         1},
        {"coverage", OUTCOME_UNRESOLVED, false, EXCEEDS(m->coverage, LARGEST_COVERAGE),
         "coverage: a place of the surface is %.3g spacings from its nearest point (at most %.3g). Ask for more "
         "points, or for smaller voxels if a mesh is sampled through a level set.",
         1},
        {"missing_share", OUTCOME_UNRESOLVED, true, EXCEEDS(m->missing_share, MISSING_SHARE),
         "missing_share: %.3g %% of the area has no point within 1.2 spacings on its side (at most %.3g %%): one "
         "wall of a thin part may have no points. Ask for more points.",
         100},
        {"close_share", OUTCOME_UNRESOLVED, true, EXCEEDS(m->close_share, CLOSE_SHARE),
         "close_share: %.3g %% of the points have another one within 0.25 spacings on their side (at most %.3g "
         "%%), as along the two rims of a thin wall. Ask for more points.",
         100},
        {"coincident", OUTCOME_UNRESOLVED, true, EXCEEDS((double)m->coincident, 0),
         "coincident: the number of points with another one within 0.001 spacings is %.0f, a fault of hexad. "
         "Report it with the spec and the input.",
         1},
        {"parts_without_points", OUTCOME_UNRESOLVED, false, EXCEEDS(m->empty_area_share, EMPTY_SHARE),
         "parts_without_points: connected components with %.3g %% of the area have no points (at most %.3g %%). "
         "Ask for more points.",
         100},
        {"unmeasured_share", OUTCOME_UNRESOLVED, false, EXCEEDS(m->unmeasured_share, UNMEASURED_SHARE),
         "unmeasured_share: %.3g %% of the points have fewer than three neighbours (at most %.3g %%), so the "
         "packing is not measured. Ask for more points.",
         100},
        {"lost_area", OUTCOME_UNRESOLVED, false, EXCEEDS(in->lost_area, LOST_SHARE),
         "lost_area: %.3g %% of the area is thinner than a voxel, or than the cells of a combination, and is not "
         "sampled (at most %.3g %%). Follow the warning that gives this share.",
         100},
        {"ringing", OUTCOME_UNRESOLVED, false, EXCEEDS(in->ringing, RINGING_SHARE),
         "ringing: %.3g %% of the cells of the surface are made or displaced by overshoot of the spline beside a jump of "
         "the samples (at most %.3g %%). If a value means that there are no data, give it as no_data; otherwise choose an "
         "isovalue in the middle of the jump, or set reconstruction to \"smoothing\".",
         100},
        {"lost_walls", OUTCOME_UNRESOLVED, false, EXCEEDS(in->lost_walls, THIN_WALLS_MOST_LOST),
         "lost_walls: about %.3g %% of the area is of walls that lie between the samples of the volume, and is not "
         "sampled (at most %.3g %%). Use a volume with smaller voxels, or choose another isovalue.",
         100},
    };
    enum { CRITERIA = sizeof criteria / sizeof *criteria };
    _Static_assert(CRITERIA + REQUIREMENTS <= OUTCOME_MOST_REASONS, "each criterion can be a reason");
    for (size_t k = 0; k < CRITERIA; k++) {
        const criterion *c = &criteria[k];
        outcome_reason reason = {
            .criterion = c->name, .value = c->value, .bound = c->bound, .of_thin_parts = c->of_thin_parts};
        if (!c->fails) continue;
        snprintf(reason.message, sizeof reason.message, c->message, c->unit * c->value, c->unit * c->bound);
        add_reason(v, c->otherwise, &reason);
    }
}

outcome_result outcome_evaluate(const outcome_input *in)
{
    outcome_result v = {.outcome = OUTCOME_CONVERGED};
    apply_criteria(in, &v);
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
