#include "sampler/sampler.h"

#include <assert.h>
#include <stdlib.h>

#include "base/memory.h"
#include "packing/energy.h"
#include "packing/packing.h"
#include "sampler/sampler_internal.h"

/* For the estimate of progress: a level that takes longer than expected is still to take this share of it. */
static const double LEFT_LEAST = 0.1;
/* Of the step that may be left: what is asked of points that did not rest as they would have been delivered. */
static const double PRESSED = 0.9;
/* With fewer sweeps than so many on a level no particle is left out of any. */
enum { IDLE_SWEEPS = 100 };

static schedule_position position(const sampler *s)
{
    return (schedule_position){s->state.level,
                               s->state.plan.count,
                               s->state.stage,
                               s->state.sweeps_in_round,
                               s->state.p->count,
                               s->setup.params.sizing != NULL,
                               s->state.is_rough,
                               s->state.p->patch != NULL,
                               relax_is_rough(s->scratch.relax),
                               relax_is_mostly_creased(s->scratch.relax)};
}

relax *sampler_new_relax(const sampler *s, size_t capacity, error *e)
{
    const fast_kernel *fast = s->state.evened > 0 ? NULL : s->setup.fast;
    return relax_new(capacity, s->setup.params.energy, fast, s->setup.params.list_limit, s->setup.pool, e);
}

sampler *sampler_new(const field *f, const surface *scan, const sampler_params *params, threads *pool,
                     error *e)
{
    sampler *s = mem_alloc(sizeof *s);
    s->setup.method = params->witkin_heckbert ? &sampler_witkin_heckbert : &sampler_meyer;
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
    bool plain = params->coarse_to_fine && s->setup.params.energy == &energy_cotangent && !params->graded &&
                 !params->gradient;
    s->setup.fast = plain ? fast_kernel_for(params->isa) : NULL;
    if (sampler_is_given(s))
        s->setup.schedule = plain ? &schedule_continued : &schedule_packed;
    else
        s->setup.schedule = plain ? &schedule_multilevel : &schedule_paper;
    s->setup.pool = pool;
    s->record.sweep =
        mem_array((size_t)params->max_sweeps, sizeof *s->record.sweep, "the record of sweeps", e);
    if (!s->record.sweep || !levels_plan(f, scan, params, &s->state.plan, e)) goto fail;
    size_t capacity = s->scratch.capacity = levels_capacity(&s->state.plan);
    s->state.p = particles_new_even(capacity, e);
    s->scratch.relax = sampler_new_relax(s, capacity, e);
    if (!s->state.p || !s->scratch.relax || !particles_label(s->state.p, f->patches, capacity, e) ||
        (params->graded && !particles_add_amplitudes(s->state.p, e)) ||
        (params->sizing && !particles_add_sizes(s->state.p, e)))
        goto fail;
    s->state.stage = sampler_is_given(s) ? SCHEDULE_STAGES - 1 : 0;
    /* a support that is given is meant for the whole count */
    double even = packing_spacing(scan->area, (double)params->count);
    if (!sampler_begin(s, params->sigma > 0 ? params->sigma / even : packing_support(1), e)) goto fail;
    return s;
fail:
    sampler_free(s);
    return NULL;
}

void sampler_free(sampler *s)
{
    if (!s) return;
    s->setup.method->release(s);
    levels_free(&s->state.plan);
    particles_free(s->state.p);
    relax_free(s->scratch.relax);
    refine_mesh_free(s->scratch.mesh);
    free(s->record.sweep);
    free(s->record.replaced);
    sampler_take_back(s);
    free(s);
}

/* Updates of particles so far, of all that are expected: those of the level at hand, and of the finer ones. */
static void estimate_fraction(sampler *s, const schedule_evidence *seen)
{
    const schedule_position at = position(s);
    const size_t count = s->state.p->count;
    s->state.updates += (double)count;
    const double spent = (double)(s->record.sweep_count - s->state.level_began),
                 expected = schedule_expected_sweeps(s->setup.schedule, &at, spent, seen);
    double left = fmax(expected - spent, LEFT_LEAST * expected) * (double)count;
    for (int level = s->state.level + 1; level < s->state.plan.count; level++) {
        const schedule_position then = {.level = level,
                                        .levels = s->state.plan.count,
                                        .stage = SCHEDULE_STAGES - 1,
                                        .count = s->state.plan.particles[level],
                                        .is_sized = at.is_sized,
                                        .has_curves = at.has_curves};
        left += schedule_expected_sweeps(s->setup.schedule, &then, 0, NULL) * (double)then.count;
    }
    s->state.fraction = fmax(s->state.fraction, s->state.updates / (s->state.updates + left));
}

/* The particles rest under the sizes and amplitudes of an earlier place. With those of now there may be more to do,
 * unless the next level does it. */
static bool sizes_are_settled(sampler *s)
{
    if (s->state.level > 0 && s->state.level < s->state.plan.count - 1) return true;
    double change = fmax(sampler_resize(s), sampler_renew_amplitudes(s));
    if (change < s->setup.schedule->size_settled || s->state.resizes == s->setup.schedule->resizes_most)
        return true;
    s->state.resizes++;
    s->state.lists_stale = true;
    particles_undamp(s->state.p);
    return false;
}

/* The points would rest as they are delivered: a sweep does not count who wants to move and finds no better place. The
 * gradient minimiser is at rest when its steps are small, whatever Newton's would be. */
static bool points_rest(const sampler *s, const schedule_position *at)
{
    if (!schedule_is_last_level(at) || !schedule_is_last_stage(at) || s->setup.params.gradient ||
        s->state.coarse)
        return true;
    const double most = s->setup.params.step_tolerance * (s->state.pressed ? PRESSED : 1);
    return !(sampler_steps_left(s, true).to_rest > most);
}

/* On a mesh, and after defect repair: whether the solve has still converged once the points are projected to rounding and have the sizes of
 * their final positions. */
static bool rests_settled(sampler *s, bool *rests, error *e)
{
    relax_steps left;
    *rests = true;
    const bool may_not = s->state.mends > 0 || sampler_merges_rows(s);
    if (!may_not || s->setup.params.gradient || s->state.coarse) return true;
    if (!sampler_steps_settled(s, &left, e)) return false;
    *rests = !(left.to_rest > s->setup.params.step_tolerance);
    return true;
}

/* Of a surface of many parts no place stays bare, even where particles may move no more. */
static bool cover_at_last(sampler *s, error *e)
{
    const field_patches *p = s->setup.field->patches;
    bool changed = false;
    return !p || !p->has_many_parts ||
           (sampler_cover_patches(s, &changed, e) && (!changed || sampler_settle(s, e)));
}

bool sampler_go_on(sampler *s)
{
    s->state.outcome = SAMPLER_RUNNING;
    s->state.sweeps_in_round = s->record.round[--s->record.round_count].sweeps;
    s->state.lists_stale = true;
    return true;
}

/* Whether defect repair may run: on patches of even size unless near curve samples were merged; elsewhere, where sizes vary, after extra
 * sweeps of a level with a high defect fraction. Enough sweeps must be left to converge again. */
static bool may_be_mended(const sampler *s)
{
    const bool is_sized = s->setup.params.sizing != NULL;
    const bool may = s->state.p->patch ? !is_sized && !sampler_merges_rows(s) : is_sized && s->state.is_rough;
    return may && s->setup.params.mend && s->setup.fast && !s->state.coarse && !sampler_is_given(s) &&
           2 * s->record.sweep_count < (size_t)s->setup.params.max_sweeps;
}

/* Whether a solve from given points rests with too much disorder, and has not gone on for that yet. */
static bool is_too_disordered(const sampler *s)
{
    const double most = s->setup.params.excess_most;
    return most > 0 && s->setup.fast && sampler_is_given(s) && !s->state.coarse && !s->state.loosened &&
           relax_mean_energy(s->scratch.relax, s->state.p, s->state.sigma) >
               (1 + most) * s->setup.params.energy->ideal;
}

/* The round goes on as that of a last level does which was refined from a coarser one. */
static bool loosen(sampler *s)
{
    s->setup.schedule = &schedule_multilevel;
    s->state.loosened = true;
    particles_undamp(s->state.p);
    sampler_go_on(s);
    s->state.sweeps_in_round = 0;
    return true;
}

/* The solve has ended at rest. Particles that are not on the surface get new places, and so do some that crowd where a patch is
 * bare; they have to find theirs among the others, so that the last round goes on. In a coarse answer nobody has a place of its own, and
 * those that crowd are moved to where places are bare; in a sequence they stay with their own. */
static bool deliver(sampler *s, error *e)
{
    const size_t before = s->record.removed;
    relax_calm(s->scratch.relax);
    if (is_too_disordered(s)) return loosen(s);
    const bool is_given = sampler_is_given(s);
    const bool may_go_on = s->state.recalls < SAMPLER_RECALLS && (!s->state.coarse || is_given);
    if (may_be_mended(s)) {
        bool changed = false;
        if (!sampler_mend(s, &changed, e) ||
            (!changed && s->setup.params.sizing && !sampler_even_out(s, &changed, e)))
            return false;
        if (changed) return sampler_go_on(s);
    }
    if (!sampler_settle(s, e)) return false;
    bool goes_on = s->record.removed != before;
    if (may_go_on && !is_given && !sampler_cover_patches(s, &goes_on, e)) return false;
    if (!may_go_on && !is_given && !cover_at_last(s, e)) return false;
    if (may_go_on && !goes_on) {
        bool rests;
        if (!rests_settled(s, &rests, e)) return false;
        goes_on = s->state.pressed = !rests;
    }
    if (!may_go_on || !goes_on) return !s->state.coarse || is_given || sampler_relocate(s, e);
    s->state.recalls++;
    return sampler_go_on(s);
}

/* A line of the record. */
static void note_sweep(sampler *s, const relax_sums *sums)
{
    double alpha = s->state.p->alpha ? 0 : (double)s->state.p->count;
    for (size_t i = 0; s->state.p->alpha && i < s->state.p->count; i++) alpha += s->state.p->alpha[i];
    alpha /= (double)s->state.p->count;
    s->record.sweep[s->record.sweep_count++] = (sampler_sweep){.energy = sums->energy / alpha,
                                                               .mean_log10_lambda = sums->mean_log10_lambda,
                                                               .rms_step = sums->rms_step,
                                                               .count = sampler_point_count(s),
                                                               .sigma = s->state.sigma,
                                                               .rejected = sums->rejected};
}

/* In the sweeps that the last level has for its disorder, if they are many, most are in order. Whether it is at rest all have to
 * say in the end. Packings that vary are mended, and between curves order comes slowly: left-out particles cost the former .005 of
 * their hex_fraction, the latter .007. */
static bool may_idle(const sampler *s, const schedule_position *at)
{
    const int sweeps = schedule_level_sweeps(s->setup.schedule, at);
    return s->state.is_rough && !s->setup.params.sizing && !at->has_curves && schedule_is_last_level(at) &&
           !s->state.coarse && sweeps >= IDLE_SWEEPS && at->sweeps + 1 < sweeps;
}

static bool relax_step(sampler *s, error *e)
{
    if (s->state.lists_stale && !sampler_build_lists(s, e)) return false;
    if (sampler_is_given(s) && s->record.sweep_count == 0 && !sampler_judge_coarse(s, e)) return false;
    schedule_position at = position(s);
    const relax_params params = {.field = s->setup.field,
                                 .minimiser =
                                     s->setup.params.gradient ? RELAX_GRADIENT : RELAX_LEVENBERG_MARQUARDT,
                                 .step = s->setup.params.step,
                                 .sigma = s->state.sigma,
                                 .spacing = s->state.spacing,
                                 .omega = schedule_omega(s->setup.schedule, &at),
                                 .fast_step = schedule_longest_step(s->setup.schedule, &at),
                                 .shaken = schedule_is_shaken(s->setup.schedule, &at),
                                 .gain = s->state.gain,
                                 .may_idle = may_idle(s, &at)};
    relax_sums sums;
    if (params.may_idle && !relax_let_idle(s->scratch.relax, e)) return false;
    s->state.settled = false;
    relax_sweep(s->scratch.relax, s->state.p, &params, &sums);
    at.sweeps = ++s->state.sweeps_in_round;
    note_sweep(s, &sums);
    if (!s->state.calmed && schedule_may_be_rough(s->setup.schedule, &at)) {
        /* how often a packing is mended goes by all of its disorder */
        const bool is_mended = s->setup.params.mend && s->setup.params.sizing,
                   smooth = at.is_creased && at.level > 0 && !is_mended;
        double share = relax_disordered_share(s->scratch.relax, s->state.p, s->state.spacing, smooth);
        s->state.is_rough |= schedule_is_rough(s->setup.schedule, &at, share);
        at.is_rough = s->state.is_rough;
        s->state.disordered_share = share;
    }
    const schedule_evidence seen = {fmax(sums.rms_step, sums.stirred_step), sums.mean_log10_lambda,
                                    !s->setup.params.gradient, s->setup.params.step_tolerance};
    estimate_fraction(s, &seen);
    if (schedule_is_impatient(s->setup.schedule, &at, s->state.gain)) s->state.gain *= 10;
    s->state.lists_stale = schedule_wants_lists(s->setup.schedule, &at, sums.cramped, ++s->state.list_age) ||
                           sampler_amplitudes_are_due(s) || sums.stirred_cramped > 0;
    s->state.skin = schedule_skin(s->setup.schedule, sums.rms_step) * s->state.spacing;
    if (sums.stirred_cramped == 0 && schedule_is_at_rest(s->setup.schedule, &at, &seen) &&
        points_rest(s, &at) && sizes_are_settled(s) && !sampler_control(s, e))
        return false;
    if (s->state.outcome == SAMPLER_CONVERGED && !deliver(s, e)) return false;
    if (s->state.outcome == SAMPLER_RUNNING && s->record.sweep_count == (size_t)s->setup.params.max_sweeps)
        s->state.outcome = SAMPLER_OUT_OF_SWEEPS;
    if (sampler_ended(s)) s->state.fraction = 1;
    return true;
}

/* What a result holds by this method is what every result holds. */
static bool describe_nothing(sampler *s, error *e)
{
    (void)s;
    (void)e;
    return true;
}

static void release_nothing(sampler *s)
{
    (void)s;
}

const sampler_method sampler_meyer = {sampler_build_lists, relax_step, describe_nothing, release_nothing};

bool sampler_step(sampler *s, error *e)
{
    assert(!sampler_ended(s) && s->record.sweep_count < (size_t)s->setup.params.max_sweeps);
    threads_narrow(s->setup.pool, s->state.p->count < SAMPLER_THREADS_FROM);
    return s->setup.method->step(s, e);
}

bool sampler_ended(const sampler *s)
{
    return s->state.outcome != SAMPLER_RUNNING;
}

sampler_outcome sampler_result(const sampler *s)
{
    return s->state.outcome;
}

const sampler_sweep *sampler_sweeps(const sampler *s, size_t *count)
{
    *count = s->record.sweep_count;
    return s->record.sweep;
}

const sampler_round *sampler_rounds(const sampler *s, size_t *count)
{
    *count = s->record.round_count;
    return s->record.round;
}

double sampler_fraction(const sampler *s)
{
    return s->state.fraction;
}

double sampler_excess(const sampler *s, const sampler_sweep *sweep)
{
    return sweep->energy / s->setup.params.energy->ideal - 1;
}

double sampler_coarsest_gain(const sampler *s)
{
    return s->setup.schedule->coarsest_gain;
}

sampler_particles sampler_current_particles(const sampler *s)
{
    const particles *p = s->state.p;
    return (sampler_particles){p->count, p->position, p->normal, s->state.spacing, p->size};
}

double sampler_spacing(const sampler *s)
{
    return s->state.spacing;
}

size_t sampler_removed_offsurface(const sampler *s)
{
    return s->record.removed;
}
