// SPDX-License-Identifier: Apache-2.0
/* driver: the order of a solve: rounds, sweeps, restarts, and when it is complete. It alone owns rounds,
 * sweeps, gains and restarts; every other file of the solver acts once and returns. See solver_state.h and
 * "The order of a solve" in doc/method.md. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "sampling/packing/energy.h"
#include "geometry/space/packing.h"
#include "sampling/solver/adaptation.h"
#include "sampling/solver/level.h"
#include "sampling/solver/passes/passes.h"

/* Minimum fraction of the expected sweeps of a level that the progress estimate assumes to be still to
 * come. */
static const double LEFT_LEAST = 0.1;
/* If steps exceeded the tolerance after projection, the steps before the next projection must be below this
 * fraction of the tolerance. */
static const double TIGHTENED = 0.9;
/* A level with fewer sweeps than this skips no particle. */
enum { SKIPPING_SWEEPS = 100 };

static schedule_position position(const solver *s)
{
    return (schedule_position){s->state.level,
                               s->state.plan.count,
                               s->state.stage,
                               s->state.sweeps_in_round,
                               s->state.p->count,
                               s->state.has_many_defects,
                               s->setup.params.graded,
                               relax_has_divergent_normals(s->scratch.relax),
                               relax_has_mostly_divergent_normals(s->scratch.relax)};
}

/* ---- rounds */

/* Begins a new round with the next sweep. */
static void begin_round(solver *s, const char *cause)
{
    s->state.round_cause = cause;
    s->state.round_defect_fraction = NAN;
    s->state.next = ACTION_SWEEP;
}

/* Begins a new round, with the schedule reset. */
static void begin_fresh_round(solver *s, const char *cause)
{
    s->state.sweeps_in_round = 0;
    s->state.size_renewals = 0;
    begin_round(s, cause);
}

/* Continues a converged solve after particles were changed: the schedule is not reset. */
static void continue_round(solver *s, const char *cause)
{
    s->state.control_rounds--;
    s->state.size_renewals = 0;
    s->state.lists_stale = true;
    begin_round(s, cause);
}

void solver_note_round(solver *s, const char *ended, double energy, double gain)
{
    const size_t n = s->record.round_count;
    const schedule *given = s->state.regime->schedule;
    const schedule_position at = position(s);
    s->record.round = mem_resize(s->record.round, (n + 1) * sizeof *s->record.round);
    s->record.round[n] = (solver_round){.regime = s->state.regime->name,
                                        .cause = s->state.round_cause,
                                        .ended = ended,
                                        .defect_fraction = s->state.round_defect_fraction,
                                        .extra_sweeps = s->state.has_many_defects,
                                        .level = at.level + 1,
                                        .stage = at.stage + 1,
                                        .least_sweeps = schedule_least_sweeps(given, &at),
                                        .sweeps = (int)(s->record.sweep_count - s->record.swept),
                                        .sigma = s->state.sigma,
                                        .count = solver_point_count(s),
                                        .energy = energy,
                                        .gain = gain};
    s->record.swept = s->record.sweep_count;
    s->record.round_count++;
}

static void end(solver *s, solver_outcome outcome)
{
    s->state.outcome = outcome;
    s->state.fraction = 1;
}

static void enter_stage(solver *s, int stage)
{
    assert(stage >= 0 && stage < SCHEDULE_STAGES);
    s->state.stage = stage;
    s->state.gain = schedule_gain(s->state.regime->schedule, stage);
    particles_reset_damping(s->state.p);
}

/* ---- starting and ending */

solver *solver_new(const field *f, const surface *scan, const solver_params *params, threads *pool, error *e)
{
    solver *s = mem_alloc(sizeof *s);
    s->setup.method = params->witkin_heckbert ? &solver_witkin_heckbert
                      : params->blue_noise    ? &solver_blue_noise
                                              : &solver_meyer;
    if (params->witkin_heckbert && f->patches) {
        error_set(
            e, ERROR_NOT_SUPPORTED,
            "method witkin-heckbert takes no surface of patches that meet in curves: use another method");
        goto fail;
    }
    s->setup.field = f;
    s->setup.scan = scan;
    s->setup.params = *params;
    if (!params->energy) s->setup.params.energy = &energy_cotangent;
    s->setup.pool = pool;
    s->state.regime = regime_for(params);
    s->setup.fast = s->state.regime->fast_kernel ? fast_kernel_for(params->isa) : NULL;
    s->record.sweep =
        mem_array((size_t)params->max_sweeps, sizeof *s->record.sweep, "the record of sweeps", e);
    if (!s->record.sweep || !level_plan_make(f, scan, params, pool, &s->state.plan, e)) goto fail;
    if (!threads_may_go_on(pool, e)) goto fail;
    size_t capacity = s->scratch.capacity = level_plan_capacity(&s->state.plan);
    s->state.p = particles_new_even(capacity, e);
    s->scratch.relax = solver_new_relax(s, capacity, e);
    if (!s->state.p || !s->scratch.relax || !particles_set_patches(s->state.p, f->patches, capacity, e) ||
        (params->graded && !particles_add_amplitudes(s->state.p, e)) ||
        (params->sizing && !particles_add_sizes(s->state.p, e)) ||
        (params->given_place && !particles_add_places(s->state.p, e)))
        goto fail;
    s->state.stage = solver_is_continued(s) ? SCHEDULE_STAGES - 1 : 0;
    begin_round(s, "placed");
    /* a given support is the one for the whole count */
    double even = packing_spacing(scan->area, (double)params->count);
    if (!solver_place(s, params->sigma > 0 ? params->sigma / even : packing_support(1), e)) goto fail;
    return s;
fail:
    solver_free(s);
    return NULL;
}

void solver_free(solver *s)
{
    if (!s) return;
    s->setup.method->release(s);
    level_plan_free(&s->state.plan);
    particles_free(s->state.p);
    relax_free(s->scratch.relax);
    refine_mesh_free(s->scratch.mesh);
    free(s->record.sweep);
    free(s->record.round);
    free(s->record.replaced);
    solver_release_description(s);
    free(s);
}

/* ---- a sweep */

/* Estimates the progress: updates of particles so far over all that are expected, on this level and the
 * finer ones. */
static void estimate_fraction(solver *s, const schedule_evidence *seen)
{
    const schedule *given = s->state.regime->schedule;
    const schedule_position at = position(s);
    const size_t count = s->state.p->count;
    s->state.updates += (double)count;
    const double spent = (double)(s->record.sweep_count - s->state.level_first_sweep),
                 expected = schedule_expected_sweeps(given, &at, spent, seen);
    double left = fmax(expected - spent, LEFT_LEAST * expected) * (double)count;
    for (int level = s->state.level + 1; level < s->state.plan.count; level++) {
        const schedule_position then = {.level = level,
                                        .levels = s->state.plan.count,
                                        .stage = SCHEDULE_STAGES - 1,
                                        .count = s->state.plan.particles[level],
                                        .has_amplitudes = s->setup.params.graded};
        left += schedule_expected_sweeps(given, &then, 0, NULL) * (double)then.count;
    }
    s->state.fraction = fmax(s->state.fraction, s->state.updates / (s->state.updates + left));
}

/* Whether sizes and amplitudes, which were computed for earlier positions, differ negligibly from those of
 * the present positions. Also true if the next level renews them. */
static bool sizes_are_current(solver *s)
{
    if (s->state.level > 0 && s->state.level < s->state.plan.count - 1) return true;
    double change = fmax(solver_renew_sizes(s), solver_renew_amplitudes(s));
    if (change < s->setup.params.step_tolerance || s->state.size_renewals == SOLVER_CONTINUATIONS_MOST)
        return true;
    s->state.size_renewals++;
    s->state.lists_stale = true;
    particles_reset_damping(s->state.p);
    return false;
}

/* Whether the points have converged by their remaining Newton steps. The rms step of a sweep is not
 * sufficient, because it excludes particles that found no better position. Not tested for the gradient
 * minimiser, which has no Newton steps. */
static bool points_have_converged(const solver *s, const schedule_position *at)
{
    if (!schedule_is_last_level(at) || !schedule_is_last_stage(at) || s->setup.params.gradient ||
        s->state.regime->is_under_resolved)
        return true;
    const double most = s->setup.params.step_tolerance * (s->state.is_tightened ? TIGHTENED : 1);
    /* the steps of the least sweeps are long everywhere: they do not show which particles are on kinks */
    const bool watch = at->sweeps > schedule_least_sweeps(s->state.regime->schedule, at);
    return !(solver_steps_left(s, watch).without_kinks > most);
}

/* Records a sweep. */
static void note_sweep(solver *s, const relax_sums *sums)
{
    double alpha = s->state.p->alpha ? 0 : (double)s->state.p->count;
    for (size_t i = 0; s->state.p->alpha && i < s->state.p->count; i++) alpha += s->state.p->alpha[i];
    alpha /= (double)s->state.p->count;
    s->record.sweep[s->record.sweep_count++] = (solver_sweep){.energy = sums->energy / alpha,
                                                              .mean_log10_lambda = sums->mean_log10_lambda,
                                                              .rms_step = sums->rms_step,
                                                              .count = solver_point_count(s),
                                                              .sigma = s->state.sigma,
                                                              .rejected = sums->rejected};
}

/* Whether converged particles may be skipped: in the extra sweeps of the last level. If the spacing varies,
 * or between feature curves, skipping is not used, since it reduces hex_fraction by 0.005 and 0.007. */
static bool may_skip(const solver *s, const schedule_position *at)
{
    const int sweeps = schedule_level_sweeps(s->state.regime->schedule, at);
    return s->state.has_many_defects && !s->setup.params.sizing && !s->state.p->patch &&
           schedule_is_last_level(at) && !s->state.regime->is_under_resolved && sweeps >= SKIPPING_SWEEPS &&
           at->sweeps + 1 < sweeps;
}

/* After the least sweeps of a level: decides from its defect fraction whether it takes extra sweeps. */
static void judge_defects(solver *s, schedule_position *at)
{
    const schedule *given = s->state.regime->schedule;
    if (s->state.had_extra_sweeps || !schedule_judges_defects(given, at)) return;
    /* the number of repairs depends on all defects */
    const bool is_repaired = s->setup.params.repair_defects && s->setup.params.sizing,
               smooth = at->is_divergent && at->level > 0 && !is_repaired;
    const double share = relax_defect_fraction(s->scratch.relax, s->state.p, s->state.spacing, smooth);
    s->state.has_many_defects |= schedule_has_many_defects(given, share);
    at->has_many_defects = s->state.has_many_defects;
    s->state.defect_fraction = s->state.round_defect_fraction = share;
}

/* Changes to the regime `under_resolved` if the particles show that the spacing does not resolve the
 * surface. */
static bool judge_regime(solver *s, error *e)
{
    bool is_under_resolved = false;
    if (!solver_is_under_resolved(s, &is_under_resolved, e)) return false;
    if (!is_under_resolved) return true;
    s->state.regime = s->state.regime->under_resolved;
    relax_ignore_normals(s->scratch.relax);
    return true;
}

static bool sweep(solver *s, error *e)
{
    if (s->state.lists_stale && !solver_build_lists(s, e)) return false;
    if (solver_is_continued(s) && s->record.sweep_count == 0 && !judge_regime(s, e)) return false;
    const schedule *given = s->state.regime->schedule;
    schedule_position at = position(s);
    const relax_params params = {.field = s->setup.field,
                                 .minimiser =
                                     s->setup.params.gradient ? RELAX_GRADIENT : RELAX_LEVENBERG_MARQUARDT,
                                 .step = s->setup.params.step,
                                 .sigma = s->state.sigma,
                                 .spacing = s->state.spacing,
                                 .omega = schedule_omega(given, &at),
                                 .fast_step = schedule_longest_step(given, &at),
                                 .shaken = schedule_is_shaken(given, &at),
                                 .gain = s->state.gain,
                                 .may_skip = may_skip(s, &at)};
    relax_sums sums;
    if (params.may_skip && !relax_allow_skipping(s->scratch.relax, e)) return false;
    s->state.is_projected = false;
    relax_sweep(s->scratch.relax, s->state.p, &params, &sums);
    at.sweeps = ++s->state.sweeps_in_round;
    note_sweep(s, &sums);
    judge_defects(s, &at);
    const schedule_evidence seen = {fmax(sums.rms_step, sums.displaced_step), sums.mean_log10_lambda,
                                    !s->setup.params.gradient, s->setup.params.step_tolerance};
    estimate_fraction(s, &seen);
    s->state.lists_stale = schedule_wants_lists(given, &at, sums.limited, ++s->state.list_age) ||
                           solver_amplitudes_are_due(s) || sums.displaced_limited > 0;
    s->state.skin = schedule_skin(given, sums.rms_step) * s->state.spacing;
    const schedule_end end = schedule_round_end(given, &at, &seen);
    if (sums.displaced_limited == 0 && end != SCHEDULE_GOES_ON && points_have_converged(s, &at) &&
        sizes_are_current(s)) {
        s->state.round_ended = end == SCHEDULE_CONVERGED ? "converged" : "sweeps_spent";
        s->state.next = ACTION_CONTROL;
    } else if (schedule_is_impatient(given, &at, s->state.gain)) {
        s->state.gain *= 10;
    }
    return true;
}

/* ---- the end of a round */

static bool is_last_stage(const solver *s)
{
    return s->state.stage == SCHEDULE_STAGES - 1;
}

static bool is_last_level(const solver *s)
{
    return s->state.level == s->state.plan.count - 1;
}

/* Ends the relaxation. Converged particles continue with the actions that complete a result. On patches this
 * does not require the ideal energy, because no support may give it, as where most patches have one
 * particle. Otherwise the solve ends here. */
static void complete(solver *s, bool is_on_target)
{
    s->state.is_on_target = is_on_target;
    if (s->state.gain <= schedule_coarsest_gain(s->state.regime->schedule) &&
        (is_on_target || s->state.p->patch))
        s->state.next = ACTION_REPAIR;
    else
        end(s, SOLVER_STALLED);
}

static bool refine(solver *s, error *e)
{
    if (!solver_refine(s, e)) return false;
    const bool has_parts = !s->state.plan.quotas && is_last_level(s);
    bool changed = false;
    return (!has_parts || solver_fill_parts(s, &changed, e)) && solver_enter_refined(s, e);
}

/* For a solve on one level, before its last stage: particles are near their final positions, and most sweeps
 * are still to come. */
static bool judge_single_level(solver *s, error *e)
{
    if (!judge_regime(s, e)) return false;
    if (!s->setup.fast || s->state.p->patch || s->state.regime->is_under_resolved || solver_is_continued(s))
        return true;
    if (!solver_fill_parts(s, &s->state.lists_stale, e)) return false;
    return !s->state.lists_stale || solver_build_lists(s, e);
}

/* Whether changing the support may bring the energy nearer to the ideal one. On patches only if the last
 * change did: where few particles have neighbours, their energy is not meaningful. */
static bool may_approach_target(const solver *s, double energy, double sigma)
{
    const double ideal = s->setup.params.energy->ideal;
    return s->state.sigma != sigma &&
           (!s->state.p->patch ||
            fabs(elementary_log(energy / ideal)) < fabs(elementary_log(s->state.last_energy / ideal)));
}

/* Global control of section 6.1: adapts the support, or the count if the support is bounded. */
static bool adapt(solver *s, bool is_on_target, double energy, error *e)
{
    const double before = s->state.sigma;
    bool changed = false;
    if (!solver_find_support(s, e) || (s->setup.params.max_sigma > 0 && !solver_adapt_count(s, &changed, e)))
        return false;
    if (changed) {
        enter_stage(s, 0);
        begin_fresh_round(s, "count_adapted");
    } else if (is_on_target || (is_last_stage(s) && !may_approach_target(s, energy, before))) {
        if (!is_on_target) s->state.sigma = before;
        complete(s, is_on_target);
    } else {
        s->state.had_extra_sweeps = is_last_stage(s) && s->state.p->patch;
        if (s->state.had_extra_sweeps) s->state.has_many_defects = false;
        if (is_last_stage(s)) s->state.last_energy = energy;
        const bool is_repeated = is_last_stage(s);
        enter_stage(s, is_repeated ? s->state.stage : s->state.stage + 1);
        begin_fresh_round(s, "support_adapted");
        const schedule_position at = position(s);
        if (is_repeated && s->state.p->patch)
            s->state.sweeps_in_round = schedule_repeated_from(s->state.regime->schedule, &at);
    }
    return solver_apply_support(s, changed, e);
}

/* One action of global control at the end of a round. */
static bool control(solver *s, error *e)
{
    const bool last_stage = is_last_stage(s), is_bounded = s->setup.params.max_sigma > 0;
    double energy = relax_packing_energy(s->scratch.relax, s->state.p, s->state.sigma);
    solver_note_round(s, s->state.round_ended, energy, s->state.gain);
    s->state.control_rounds++;
    if (last_stage &&
        s->state.regime->is_under_resolved) { /* the ideal energy is that of one surface; computed for the
                                               * report only */
        if (!solver_find_support(s, e)) return false;
        energy = relax_packing_energy(s->scratch.relax, s->state.p, s->state.sigma);
    }
    bool again = false;
    if (s->state.level == 0 && s->state.plan.count > 1 && !solver_replan(s, &again, e)) return false;
    if (again) {
        begin_fresh_round(s, "started_again");
        return true;
    }
    if (last_stage && !is_last_level(s)) { /* the next level then starts near the ideal support */
        if (energy > 0) s->state.sigma = solver_nearer_support(s, s->state.sigma, energy);
        begin_fresh_round(s, "refined");
        return refine(s, e);
    }
    const bool is_on_target = last_stage && solver_is_on_target(s, energy);
    if (s->state.control_rounds == SOLVER_MAX_ROUNDS || (is_on_target && !is_bounded)) {
        complete(s, is_on_target);
        return true;
    }
    if (s->state.plan.count == 1 && s->state.stage == SCHEDULE_STAGES - 2 && !judge_single_level(s, e))
        return false;
    return adapt(s, is_on_target, energy, e);
}

/* ---- completion of a converged result */

/* Whether defect repair may run: on patches of even size unless near curve samples were merged; elsewhere,
 * where sizes vary, after extra sweeps of a level with a high defect fraction. Enough sweeps must be left
 * to converge again. */
static bool may_repair_defects(const solver *s)
{
    const bool is_sized = s->setup.params.sizing != NULL;
    const bool may = s->state.p->patch ? !is_sized && !solver_merges_near_curves(s)
                                       : is_sized && s->state.has_many_defects;
    return may && s->setup.params.repair_defects && s->state.regime->repairs_defects &&
           2 * s->record.sweep_count < (size_t)s->setup.params.max_sweeps;
}

/* Whether the energy of a solve from given points is so high that longer steps can decrease it. */
static bool needs_longer_steps(const solver *s)
{
    const double most = s->setup.params.max_excess;
    return most > 0 && s->state.regime->with_longer_steps &&
           relax_mean_energy(s->scratch.relax, s->state.p, s->state.sigma) >
               (1 + most) * s->setup.params.energy->ideal;
}

static bool repair(solver *s, error *e)
{
    relax_clear_displaced(s->scratch.relax);
    if (needs_longer_steps(s)) {
        s->state.regime = s->state.regime->with_longer_steps;
        particles_reset_damping(s->state.p);
        continue_round(s, "longer_steps");
        s->state.sweeps_in_round = 0;
        return true;
    }
    s->state.next = ACTION_PROJECT;
    if (!may_repair_defects(s)) return true;
    bool changed = false;
    if (!solver_repair_defects(s, &changed, e)) return false;
    if (changed) {
        continue_round(s, "defects_repaired");
        return true;
    }
    if (s->setup.params.sizing && !solver_equalise_cells(s, &changed, e)) return false;
    if (changed) continue_round(s, "cells_equalised");
    return true;
}

/* Whether a solve may continue after particles were relocated. */
static bool may_go_on(const solver *s)
{
    return s->state.continuations < SOLVER_CONTINUATIONS_MOST && s->state.regime->goes_on_after_projection;
}

static void go_on(solver *s, const char *cause)
{
    s->state.continuations++;
    continue_round(s, cause);
}

/* Covers a surface of many connected parts, also if no round follows in which the particles could converge
 * again. */
static bool fill_last_gaps(solver *s, error *e)
{
    const field_patches *p = s->setup.field->patches;
    bool changed = false;
    if (!s->state.regime->fills_gaps || !p || !p->has_many_parts) return true;
    return solver_fill_gaps(s, &changed, e) && (!changed || solver_project(s, &changed, e));
}

/* Projects the particles. Relocated particles, and those that fill gaps, must converge again. */
static bool project(solver *s, error *e)
{
    bool changed = false;
    if (!solver_project(s, &changed, e)) return false;
    s->state.next = ACTION_VERIFY;
    if (!may_go_on(s)) return fill_last_gaps(s, e) && solver_separate_patches(s, &changed, e);
    if (s->state.regime->fills_gaps && !solver_fill_gaps(s, &changed, e)) return false;
    /* last, because relaxation after other changes may bring particles close to each other again */
    if (!changed && !solver_separate_patches(s, &changed, e)) return false;
    if (changed) go_on(s, "points_relocated");
    return true;
}

/* Whether the particles are still converged after projection to rounding, with the sizes of their final
 * positions. */
static bool has_converged_after_projection(solver *s, bool *rests, error *e)
{
    relax_steps left;
    *rests = true;
    if (s->setup.params.gradient || s->state.regime->is_under_resolved) return true;
    if (!solver_steps_after_projection(s, &left, e)) return false;
    *rests = !(left.without_kinks > s->setup.params.step_tolerance);
    return true;
}

static bool verify(solver *s, error *e)
{
    bool rests = true;
    if (may_go_on(s)) {
        if (!has_converged_after_projection(s, &rests, e)) return false;
        s->state.is_tightened = !rests;
    }
    if (!rests) {
        go_on(s, "steps_left");
        return true;
    }
    end(s, s->state.is_on_target ? SOLVER_CONVERGED : SOLVER_STALLED);
    bool changed = false;
    return !s->state.regime->spreads_points ||
           (solver_spread_points(s, &changed, e) && solver_project(s, &changed, e));
}

/* ---- interface of solver_method */

/* This method adds nothing to the common description. */
static bool describe_nothing(solver *s, error *e)
{
    (void)s;
    (void)e;
    return true;
}

static void release_nothing(solver *s)
{
    (void)s;
}

const solver_method solver_meyer = {solver_build_lists, sweep, describe_nothing, release_nothing};

static bool act(solver *s, error *e)
{
    switch (s->state.next) {
    case ACTION_SWEEP:
        return s->setup.method->step(s, e);
    case ACTION_CONTROL:
        return control(s, e);
    case ACTION_REPAIR:
        return repair(s, e);
    case ACTION_PROJECT:
        return project(s, e);
    case ACTION_VERIFY:
        return verify(s, e);
    }
    return false;
}

bool solver_step(solver *s, error *e)
{
    assert(!solver_ended(s));
    threads_narrow(s->setup.pool, s->state.p->count < SOLVER_MIN_PARALLEL_COUNT);
    if (!act(s, e)) return false;
    const bool is_out = s->record.sweep_count == (size_t)s->setup.params.max_sweeps;
    if (!solver_ended(s) && s->state.next == ACTION_SWEEP && is_out) {
        const double energy = s->record.sweep[s->record.sweep_count - 1].energy;
        if (s->record.sweep_count > s->record.swept)
            solver_note_round(s, ROUND_AT_MAX_SWEEPS, energy, s->state.gain);
        end(s, SOLVER_OUT_OF_SWEEPS);
    }
    return true;
}

bool solver_finalize(solver *s, error *e)
{
    while (!is_last_level(s)) /* after an early stop: refines to the exact count */
        if (!refine(s, e)) return false;
    bool changed = false;
    return (s->state.is_projected || solver_project(s, &changed, e)) && solver_describe(s, e);
}

bool solver_pin(solver *s, const vec3 *place, size_t count, bool *goes_on, error *e)
{
    size_t pinned;
    *goes_on = false;
    if (s->state.outcome != SOLVER_CONVERGED || !s->state.p->place || solver_is_continued(s) ||
        s->state.regime->is_under_resolved || 2 * s->record.sweep_count >= (size_t)s->setup.params.max_sweeps)
        return true;
    if (!solver_pin_near(s, place, count, &pinned, e)) return false;
    if (pinned == 0) return true;
    solver_release_description(s);
    s->scratch.relax = solver_new_relax(s, s->scratch.capacity, e);
    if (!s->scratch.relax) return false;
    *goes_on = true;
    s->state.outcome = SOLVER_RUNNING;
    continue_round(s, "points_pinned");
    if (!solver_build_lists(s, e)) return false;
    for (size_t i = 0; i < s->state.p->count; i++)
        if (s->state.p->place[i] == PARTICLES_PINNED) solver_mark_displaced(s, i);
    s->state.sweeps_in_round = 0; /* patience counts from here: earlier sweeps of the round are not related
                                   * to these particles */
    s->state.gain = schedule_gain(s->state.regime->schedule, s->state.stage);
    s->state.continuations = 0;
    return true;
}
