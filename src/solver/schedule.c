#include "solver/schedule.h"

#include <assert.h>
#include <math.h>

/* Estimate of progress. stage_share: the fraction of its sweeps that a solve by the paper's criterion has typically spent when a stage
 * begins. LEAST_SHARE: the least fraction that is used. EARLY_SWEEPS: typical sweeps of the first two stages of the default method. */
static const double stage_share[SCHEDULE_STAGES + 1] = {0, 0.07, 0.35, 1}, LEAST_SHARE = 0.01,
                                                  EARLY_SWEEPS = 50;
/* Initial log10 lambda, at which the damping is negligible. */
static const double LAMBDA_BEGINS = -3;

/* Values of all schedules. */
#define COMMON                                                                                       \
    .gain = {1e-4, 1e-6, 1e-8}, .patience_more = 50, .patience_last = 500, .coarsest_gain = 1e-5,    \
    .sweeps = 100, .sweeps_count = 1e4, .sweeps_fall = 1.5, .sweeps_least = 3, .sweeps_most = 120,   \
    .defects_sweeps = {2, 3.5}, .defects_count = 5e3, .defects_share = {{0.05, 0.25}, {0.02, 0.25}}, \
    .size_settled = 1e-3, .resizes_most = 10, .limited_share = 0.01, .limited_share_coarse = 0.04,   \
    .skin_wide = 0.6, .skin_narrow = 0.2, .skin_steps = 6, .divergent_share = 0.7,                   \
    .divergent_share_start = 0.9, .new_part_sweeps = 60

/* Over-relaxation: 1.8 takes three times the sweeps; 3.0 is slower near convergence. */
#define PAPER                                                                                  \
    COMMON, .omega = 2.6, .longest_step = INFINITY, .rest_lambda = 14 /* section 7, step 2 */, \
            .level_step = 5e-3, .level_sweeps = 30, .limited_wait = 4

const schedule schedule_paper = {PAPER, .patience = {80, 150, 400}};

/* The start is a packing: the longer patience of schedule_paper gives the same hex_fraction after twice the sweeps. */
const schedule schedule_packed = {PAPER, .patience = {80, 150, 100}};

/* Over-relaxation: with 3.0 a refined level loses its order. With a sizing field 2.7 makes particles oscillate by 0.1 h for thirty sweeps.
 * The longest step is ten times the rms step of a shaken level: longer ones belong to particles that do not converge, at edges and thin
 * parts. Twice the sweeps on all levels bring edge_cv at 100 000 points from .041 to .039 and take half as much time again. A sweep costs
 * less than new lists, so that lists may be older than by the paper's method. */
const schedule schedule_multilevel = {
    COMMON,
    .patience = {80, 150, 400},
    .is_paced = true,
    .omega = 2.2,
    .omega_shake = 2.7,
    .omega_shake_sized = 2.4,
    .omega_least = 1.2,
    .longest_step = 0.05,
    .shake_sweeps = 15,
    .stage_step = {0.03, 0.01, 0.001},
    .stage_sweeps_most = 400,
    .finest_rest = 3.5,
    .limited_wait = 12,
};

/* Points keep their positions as far as the new surface allows: short steps from the first sweep on. */
const schedule schedule_continued = {
    COMMON,
    .patience = {80, 150, 400},
    .omega = 1.2,
    .longest_step = 0.05,
    .stage_step = {0.03, 0.01, 0.001},
    .stage_sweeps_most = 400,
    .finest_rest = 1,
    .limited_wait = 12,
};

static bool is_early(const schedule_position *at)
{
    return at->level == 0 && !schedule_is_last_stage(at);
}

int schedule_level_sweeps(const schedule *s, const schedule_position *at)
{
    assert(at->level >= 0 && at->level < at->levels && at->stage < SCHEDULE_STAGES && at->count > 0);
    double sweeps = s->sweeps * pow(s->sweeps_count / (double)at->count, s->sweeps_fall);
    sweeps = fmin(fmax(sweeps, s->sweeps_least), s->sweeps_most);
    return (int)(at->has_many_defects ? s->defects_sweeps[schedule_is_last_level(at)] * sweeps : sweeps);
}

/* Whether the level may take more sweeps for its defects. Where most normals diverge, only the last level may. */
static bool can_have_many_defects(const schedule *s, const schedule_position *at)
{
    return s->is_paced && (double)at->count >= s->defects_count &&
           (!at->is_mostly_divergent || schedule_is_last_level(at));
}

bool schedule_judges_defects(const schedule *s, const schedule_position *at)
{
    return can_have_many_defects(s, at) && schedule_is_last_stage(at) &&
           at->sweeps == schedule_level_sweeps(s, at);
}

bool schedule_has_many_defects(const schedule *s, const schedule_position *at, double defect_fraction)
{
    const double *share = s->defects_share[at->has_patches];
    return defect_fraction > share[0] && defect_fraction < share[1];
}

/* The sweeps of the round over the sweeps during which it is shaken. */
static double paced_time(const schedule *s, const schedule_position *at)
{
    return at->sweeps / (double)(is_early(at) ? s->shake_sweeps : schedule_level_sweeps(s, at));
}

double schedule_omega(const schedule *s, const schedule_position *at)
{
    if (!s->is_paced || is_early(at)) return s->omega;
    const double t = paced_time(s, at);
    double shake = at->is_sized ? s->omega_shake_sized : s->omega_shake;
    if (t < 1) return shake + (s->omega - shake) * t * t;
    return fmax(s->omega / t, s->omega_least);
}

bool schedule_is_shaken(const schedule *s, const schedule_position *at)
{
    return s->is_paced && paced_time(s, at) < 1;
}

double schedule_longest_step(const schedule *s, const schedule_position *at)
{
    if (!s->is_paced) return s->longest_step;
    const double t = paced_time(s, at);
    return t < 1 ? INFINITY : s->longest_step / (t * t);
}

/* By steps: a level ends after its least sweeps, the coarsest after each stage has converged, the last one at the tolerance of the job. */
static schedule_end end_by_steps(const schedule *s, const schedule_position *at,
                                 const schedule_evidence *seen)
{
    bool last_stage = schedule_is_last_stage(at);
    if (s->is_paced && last_stage && at->sweeps < schedule_level_sweeps(s, at)) return SCHEDULE_GOES_ON;
    if (schedule_is_last_level(at) && last_stage)
        return seen->rms_step < s->finest_rest * seen->step_tolerance ? SCHEDULE_CONVERGED : SCHEDULE_GOES_ON;
    if (seen->rms_step < s->stage_step[at->stage]) return SCHEDULE_CONVERGED;
    return at->level > 0 || at->sweeps >= s->stage_sweeps_most ? SCHEDULE_SWEEPS_SPENT : SCHEDULE_GOES_ON;
}

/* By the paper's steady state. A refined level starts near it and is judged by its steps; a level that is refined again may end
 * before they are below the tolerance. */
schedule_end schedule_round_end(const schedule *s, const schedule_position *at, const schedule_evidence *seen)
{
    if (!(s->rest_lambda > 0)) return end_by_steps(s, at, seen);
    if (at->level > 0 && !schedule_is_last_level(at)) {
        if (seen->rms_step < s->level_step) return SCHEDULE_CONVERGED;
        return at->sweeps >= s->level_sweeps ? SCHEDULE_SWEEPS_SPENT : SCHEDULE_GOES_ON;
    }
    bool ends = seen->rms_step < seen->step_tolerance;
    if (at->level == 0 && seen->has_lambda)
        ends = seen->mean_log10_lambda > s->rest_lambda && (!schedule_is_last_stage(at) || ends);
    return ends ? SCHEDULE_CONVERGED : SCHEDULE_GOES_ON;
}

bool schedule_is_impatient(const schedule *s, const schedule_position *at, double gain)
{
    bool fails = schedule_is_last_stage(at) && 10 * gain > 2 * s->coarsest_gain;
    int owed = s->is_paced && schedule_is_last_stage(at) ? schedule_level_sweeps(s, at) : 0;
    int over = at->sweeps - (owed > s->patience[at->stage] ? owed : s->patience[at->stage]);
    return over >= 0 && over % (fails ? s->patience_last : s->patience_more) == 0;
}

bool schedule_wants_lists(const schedule *s, const schedule_position *at, size_t limited, int age)
{
    double share = schedule_is_last_level(at) ? s->limited_share : s->limited_share_coarse;
    return (double)limited > share * (double)at->count || (limited > 0 && age >= s->limited_wait);
}

double schedule_skin(const schedule *s, double rms_step)
{
    return fmin(s->skin_wide, fmax(s->skin_narrow, s->skin_steps * rms_step));
}

/* By the paper's criterion lambda rises from its floor to its cap within a round; on a refined level the step falls to the tolerance. */
static double expected_by_criterion(const schedule *s, const schedule_position *at, double spent,
                                    const schedule_evidence *seen)
{
    const double climbed = (seen->mean_log10_lambda - LAMBDA_BEGINS) / (s->rest_lambda - LAMBDA_BEGINS);
    const double share =
        at->level > 0 ? seen->step_tolerance / fmax(seen->rms_step, 1e-300)
                      : stage_share[at->stage] +
                            (stage_share[at->stage + 1] - stage_share[at->stage]) * fmin(fmax(climbed, 0), 1);
    return spent / fmin(fmax(share, LEAST_SHARE), 1);
}

double schedule_expected_sweeps(const schedule *s, const schedule_position *at, double spent,
                                const schedule_evidence *seen)
{
    double sweeps = schedule_level_sweeps(s, at);
    if (s->rest_lambda > 0 && seen) return fmax(expected_by_criterion(s, at, spent, seen), 1);
    if (can_have_many_defects(s, at) && !at->has_many_defects)
        sweeps *= s->defects_sweeps[schedule_is_last_level(at)];
    return at->level == 0 ? sweeps + EARLY_SWEEPS : sweeps;
}
