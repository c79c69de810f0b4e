// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/schedule.h"

#include <assert.h>
#include <math.h>

#include "base/core/elementary.h"

/* Estimate of progress. stage_share: typical fraction of the sweeps that a solve by the paper's criterion
 * has used when a stage begins. LEAST_SHARE: minimum of the fraction. EARLY_SWEEPS: typical sweeps of the
 * first two stages of the default method. */
static const double stage_share[SCHEDULE_STAGES + 1] = {0, 0.07, 0.35, 1}, LEAST_SHARE = 0.01,
                                                  EARLY_SWEEPS = 50;
/* Initial log10 lambda, at which the damping is negligible. */
static const double LAMBDA_BEGINS = -3;

/* Values of all schedules. */
#define COMMON EVERY, .sweeps_least = 3, .sweeps_most = 120
#define EVERY                                                                                         \
    .gain = 1e-8, .repeated_share = 0.25, .omega_shake = 2.6, .longest_step = 0.05,                   \
    .one_sweep_count = 2.15e5, .sweeps_fall = 1.5, .defects_count = 5e3, .defects_sweeps = 3,         \
    .defects_sweeps_most = 50, .graded_sweeps = 6, .defects_least = 0.03, .defects_most = 0.25,       \
    .limited_share = 0.01, .limited_wait = 12, .skin_wide = 0.3, .skin_narrow = 0.2, .skin_steps = 6, \
    .divergent_share = 0.9

/* omega: 1.8 takes three times the sweeps; 3.0 is slower near convergence. rest_lambda: section 7, step 2. */
#define PAPER COMMON, .omega = 2.6, .rest_lambda = 14, .renewal_share = 0.25

const schedule schedule_paper = {PAPER, .patience = 400};

/* The start is a packing: with the patience of schedule_paper, hex_fraction is the same after twice the
 * sweeps. */
const schedule schedule_packed = {PAPER, .patience = 100};

/* omega_shake: with 3.0 a refined level loses its order. longest_step: ten times the rms step of a shaken
 * level; longer steps belong to particles that do not converge, at edges and thin parts. With twice the
 * sweeps on all levels, edge_cv at 100 000 points is 0.039 instead of 0.041, and the time increases by
 * half. */
const schedule schedule_multilevel = {COMMON,       .patience = 400,    .is_paced = true,
                                      .omega = 2.2, .finest_rest = 3.5, .renewal_share = 0.5};

/* Points keep their positions as far as the new surface permits: steps are short from the first sweep. */
const schedule schedule_continued = {COMMON, .patience = 400, .omega = 1.2, .finest_rest = 1,
                                     .renewal_share = 0.5};

/* A motion strains the packing a little in each frame, so that a few sweeps in each frame keep its order. With 5
 * sweeps, hex_fraction of a bending torus falls to 0.935 in 60 frames, with 16 to 0.949. With 120 sweeps, one frame
 * moves its points by a fifth of a spacing (median). */
const schedule schedule_eased = {
    EVERY,        .patience = 400,    .is_paced = true,    .sweeps_least = 12, .sweeps_most = 12,
    .omega = 2.2, .finest_rest = 3.5, .renewal_share = 0.5};

/* Divisors of the patience: in earlier stages, and after the first multiplication of the gain. */
enum { EARLY_PATIENCE = 4, MORE_PATIENCE = 8 };
/* Ratios of gain and step tolerance of a stage to those of the next one. */
static const double GAIN_RATIO = 100, STEP_RATIO = 3;
/* Shaken sweeps of an earlier stage, as a fraction of sweeps_most. */
static const double EARLY_SHARE = 0.125;

static bool is_early(const schedule_position *at)
{
    return at->level == 0 && !schedule_is_last_stage(at);
}

double schedule_gain(const schedule *s, int stage)
{
    return s->gain * elementary_pow(GAIN_RATIO, SCHEDULE_STAGES - 1 - stage);
}

double schedule_coarsest_gain(const schedule *s)
{
    return 10 * GAIN_RATIO * s->gain;
}

/* The rms step over h at which a stage ends; in the last stage the tolerance. */
static double stage_step(const schedule_position *at, double step_tolerance)
{
    return step_tolerance * elementary_pow(STEP_RATIO, SCHEDULE_STAGES - 1 - at->stage);
}

/* Least sweeps of a level, without the extra sweeps for its defects that schedule_level_sweeps includes. */
static double plain_sweeps(const schedule *s, const schedule_position *at)
{
    assert(at->level >= 0 && at->level < at->levels && at->stage < SCHEDULE_STAGES && at->count > 0);
    const double sweeps = elementary_pow(s->one_sweep_count / (double)at->count, s->sweeps_fall);
    return fmin(fmax(sweeps, s->sweeps_least), s->sweeps_most);
}

/* The factor on the sweeps of a level with many defects. */
static double extra_sweeps(const schedule *s, const schedule_position *at)
{
    return at->has_amplitudes ? s->graded_sweeps : s->defects_sweeps;
}

int schedule_level_sweeps(const schedule *s, const schedule_position *at)
{
    const double sweeps = plain_sweeps(s, at), more = extra_sweeps(s, at) * sweeps;
    if (!at->has_many_defects) return (int)sweeps;
    return (int)(at->has_amplitudes ? more : fmin(more, sweeps + s->defects_sweeps_most));
}

int schedule_repeated_from(const schedule *s, const schedule_position *at)
{
    return s->is_paced ? (int)((1 - s->repeated_share) * schedule_level_sweeps(s, at)) : 0;
}

int schedule_least_sweeps(const schedule *s, const schedule_position *at)
{
    return s->is_paced && schedule_is_last_stage(at) ? schedule_level_sweeps(s, at) : 0;
}

/* Whether the level may take extra sweeps for its defects. If most normals diverge, only the last level
 * may. */
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

bool schedule_has_many_defects(const schedule *s, double defect_fraction)
{
    return defect_fraction > s->defects_least && defect_fraction < s->defects_most;
}

/* Sweeps of the round over the sweeps during which the level is shaken. */
static double paced_time(const schedule *s, const schedule_position *at)
{
    return at->sweeps / (is_early(at) ? EARLY_SHARE * s->sweeps_most : schedule_level_sweeps(s, at));
}

double schedule_omega(const schedule *s, const schedule_position *at)
{
    if (!s->is_paced || is_early(at)) return s->omega;
    const double t = paced_time(s, at);
    if (t < 1) return s->omega_shake + (s->omega - s->omega_shake) * t * t;
    return fmax(s->omega / t, s->omega / 2);
}

bool schedule_is_shaken(const schedule *s, const schedule_position *at)
{
    return s->is_paced && paced_time(s, at) < 1;
}

double schedule_longest_step(const schedule *s, const schedule_position *at)
{
    if (s->rest_lambda > 0) return INFINITY;
    if (!s->is_paced) return s->longest_step;
    const double t = paced_time(s, at);
    return t < 1 ? INFINITY : s->longest_step / (t * t);
}

/* End of a round by the rms step. A level ends after its least sweeps; the coarsest one when each stage has
 * converged; the last one at the tolerance of the job. A level that will be refined ends earlier if its steps
 * are shorter than the tolerance of a further stage would be: more sweeps do not change its packing. */
static schedule_end end_by_steps(const schedule *s, const schedule_position *at,
                                 const schedule_evidence *seen)
{
    const bool last_stage = schedule_is_last_stage(at), last_level = schedule_is_last_level(at);
    const double step = stage_step(at, seen->step_tolerance);
    if (last_stage && !last_level && seen->rms_step < step / STEP_RATIO) return SCHEDULE_CONVERGED;
    if (at->sweeps < schedule_least_sweeps(s, at)) return SCHEDULE_GOES_ON;
    if (last_level && last_stage)
        return seen->rms_step < s->finest_rest * seen->step_tolerance ? SCHEDULE_CONVERGED : SCHEDULE_GOES_ON;
    if (seen->rms_step < step) return SCHEDULE_CONVERGED;
    return at->level > 0 || at->sweeps >= s->patience ? SCHEDULE_SWEEPS_SPENT : SCHEDULE_GOES_ON;
}

/* By the paper's steady state. A refined level starts near it and is judged by its steps; a level that is
 * refined again may end before they are below the tolerance. */
schedule_end schedule_round_end(const schedule *s, const schedule_position *at, const schedule_evidence *seen)
{
    if (!(s->rest_lambda > 0)) return end_by_steps(s, at, seen);
    if (at->level > 0 && !schedule_is_last_level(at)) {
        if (seen->rms_step < stage_step(at, seen->step_tolerance)) return SCHEDULE_CONVERGED;
        return at->sweeps >= schedule_level_sweeps(s, at) ? SCHEDULE_SWEEPS_SPENT : SCHEDULE_GOES_ON;
    }
    bool ends = seen->rms_step < seen->step_tolerance;
    if (at->level == 0 && seen->has_lambda)
        ends = seen->mean_log10_lambda > s->rest_lambda && (!schedule_is_last_stage(at) || ends);
    return ends ? SCHEDULE_CONVERGED : SCHEDULE_GOES_ON;
}

bool schedule_is_impatient(const schedule *s, const schedule_position *at, double gain)
{
    bool fails = schedule_is_last_stage(at) && 10 * gain > 2 * schedule_coarsest_gain(s);
    const int owed = schedule_least_sweeps(s, at);
    const int patience = schedule_is_last_stage(at) ? s->patience : s->patience / EARLY_PATIENCE,
              over = at->sweeps - (owed > patience ? owed : patience);
    return over >= 0 && over % (fails ? s->patience : s->patience / MORE_PATIENCE) == 0;
}

bool schedule_wants_lists(const schedule *s, const schedule_position *at, size_t limited, int age)
{
    return (double)limited > s->limited_share * (double)at->count || (limited > 0 && age >= s->limited_wait);
}

double schedule_skin(const schedule *s, double rms_step)
{
    return fmin(s->skin_wide, fmax(s->skin_narrow, s->skin_steps * rms_step));
}

/* Estimate by the paper's criterion: lambda rises from its minimum to its maximum within a round; on a
 * refined level, the step decreases to the tolerance. */
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
    schedule_position with_defects = *at;
    with_defects.has_many_defects |= can_have_many_defects(s, at);
    const double sweeps = schedule_level_sweeps(s, &with_defects);
    if (s->rest_lambda > 0 && seen) return fmax(expected_by_criterion(s, at, spent, seen), 1);
    return at->level == 0 ? sweeps + EARLY_SWEEPS : sweeps;
}
