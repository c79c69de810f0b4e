/* current_level: the level of the solve at hand: where its particles start, what they need before a sweep (amplitudes, sizes,
 * neighbour lists), and the step to the next level. See sampler_internal.h. */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "field/projection.h"
#include "geometry/morton.h"
#include "packing/energy.h"
#include "packing/packing.h"
#include "particles/refine.h"
#include "sampler/sampler_internal.h"
#include "sampler/start.h"

/* (13) and (14), with curvature freed of scale by the surface's extent, and bounded. */
static double amplitude(const sampler *s, double kappa)
{
    double k = fmin(kappa * s->setup.field->extent, s->setup.params.kappa_max);
    return s->setup.params.gamma + 1 / (pow(k, s->setup.params.d) + s->setup.params.nu);
}

bool sampler_amplitude_at(const sampler *s, const field *f, uint32_t patch, vec3 x, vec3 normal,
                          double *alpha)
{
    double kappa1, kappa2;
    field_sample sample;
    if (s->setup.params.curvature) {
        *alpha =
            amplitude(s, scaled_curvature_at(s->setup.params.curvature, x, normal, patch, &kappa1, &kappa2));
        return true;
    }
    if (!field_sample_at(f, x, FIELD_HESSIAN, &sample)) return false;
    *alpha = amplitude(s, field_curvature(&sample, &kappa1, &kappa2));
    return true;
}

bool sampler_is_on_target(const sampler *s, double energy)
{
    return fabs(energy / s->setup.params.energy->ideal - 1) < s->setup.params.energy_tolerance;
}

/* Numbers that go with the particles' places and are constant between two renewals: amplitudes and sizes. Sums are made of at most so many parts, by the count alone. */
enum { PARTS = 256, BATCH = 64 };

typedef struct renewal {
    sampler *s;
    size_t grain;
    double squares[PARTS]; /* of relative changes, a chunk each */
} renewal;

static double renew(sampler *s, threads_work work)
{
    renewal job = {s, s->state.p->count / PARTS + 1, {0}};
    double squares = 0;
    threads_run(s->setup.pool, s->state.p->count, job.grain, work, &job);
    for (int k = 0; k < PARTS; k++) squares += job.squares[k];
    return sqrt(squares / (double)s->state.p->count);
}

static void amplitude_chunk(void *context, int worker, size_t begin, size_t end)
{
    renewal *job = context;
    const particles *p = job->s->state.p;
    double squares = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        double before = p->alpha[i];
        const field *f = particles_field(p, job->s->setup.field, i);
        if (!sampler_amplitude_at(job->s, f, particles_patch(p, i), p->position[i], p->normal[i],
                                  &p->alpha[i]))
            continue;
        double change = p->alpha[i] / before - 1;
        squares += change * change;
    }
    job->squares[begin / job->grain] = squares;
}

double sampler_renew_amplitudes(sampler *s)
{
    return s->setup.params.graded ? renew(s, amplitude_chunk) : 0;
}

/* Every sweep at first, when particles move far, and then after a quarter more sweeps each time. In between the energy is
 * a function of positions alone, which can only fall. */
bool sampler_amplitudes_are_due(const sampler *s)
{
    return s->setup.params.graded && s->record.sweep_count >= s->state.next_amplitudes;
}

static void size_chunk(void *context, int worker, size_t begin, size_t end)
{
    renewal *job = context;
    sampler *s = job->s;
    double over_h = 1 / packing_spacing(s->setup.scan->area, (double)s->setup.params.count), squares = 0,
           spacing[BATCH];
    (void)worker;
    for (size_t first = begin; first < end; first += BATCH) {
        size_t count = end - first < BATCH ? end - first : BATCH;
        sizing_field_spacings(s->setup.params.sizing, count, s->state.p->position + first, spacing);
        for (size_t k = 0; k < count; k++) {
            double *size = &s->state.p->size[first + k], change = *size / (spacing[k] * over_h) - 1;
            squares += change * change;
            *size = spacing[k] * over_h;
        }
    }
    job->squares[begin / job->grain] = squares;
}

double sampler_resize(sampler *s)
{
    return s->setup.params.sizing ? renew(s, size_chunk) : 0;
}

void sampler_tell_spacings(const sampler *s, double *out)
{
    for (size_t i = 0; i < s->state.p->count; i++) out[i] = particles_size(s->state.p, i) * s->state.spacing;
}

bool sampler_build_lists(sampler *s, error *e)
{
    if (sampler_amplitudes_are_due(s)) {
        sampler_renew_amplitudes(s);
        s->state.next_amplitudes = s->record.sweep_count + 1 + s->record.sweep_count / 4;
    }
    sampler_resize(s);
    particles_mark_boundary(s->state.p, s->setup.field, s->state.spacing);
    if (!relax_build(s->scratch.relax, s->state.p, s->state.sigma, s->state.skin, e)) return false;
    s->state.lists_stale = false;
    s->state.list_age = 0;
    return true;
}

/* The scales of the level at hand. */
static void enter_level(sampler *s, size_t count, double support)
{
    const allotment *allotments = s->state.plan.allotments;
    double share = levels_share(&s->state.plan, s->state.level);
    const schedule_position at = {.level = s->state.level,
                                  .levels = s->state.plan.count,
                                  .stage = s->state.stage,
                                  .count = count,
                                  .is_sized = s->setup.params.sizing != NULL,
                                  .has_curves = s->state.p->patch != NULL};
    s->state.spacing = allotments ? allotments[s->state.level].spacing
                                  : packing_spacing(s->setup.scan->area, (double)count / share);
    s->state.sigma = support * s->state.spacing;
    s->state.skin = schedule_first_skin(s->setup.schedule, &at) * s->state.spacing;
    s->state.gain = s->setup.schedule->gain[s->state.stage];
    s->state.is_rough = false;
    s->state.calmed = false;
}

/* Into an order in which neighbours are near each other in memory too. */
static bool arrange(sampler *s, error *e)
{
    uint32_t *order = mem_array(s->state.p->count, sizeof *order, "the order of particles", e);
    bool ok = order && morton_order(s->state.p->position, s->state.p->count, s->setup.pool, order, e) &&
              particles_arrange(s->state.p, order, s->setup.pool, e);
    free(order);
    return ok;
}

bool sampler_is_given(const sampler *s)
{
    return s->setup.params.start == SAMPLER_START_GIVEN;
}

/* Places the particles, in an order for sweeps. */
static bool place(sampler *s, error *e)
{
    size_t removed;
    if (sampler_is_given(s)) {
        memcpy(s->state.p->position, s->setup.params.given, s->state.p->count * sizeof *s->state.p->position);
        memcpy(s->state.p->normal, s->setup.params.given_normal,
               s->state.p->count * sizeof *s->state.p->normal);
        if (!s->state.p->patch) return true;
        assert(s->setup.params.given_patch && s->setup.params.given_place);
        memcpy(s->state.p->patch, s->setup.params.given_patch, s->state.p->count * sizeof *s->state.p->patch);
        memcpy(s->state.p->place, s->setup.params.given_place, s->state.p->count * sizeof *s->state.p->place);
        return true;
    }
    if (!start_place(s->setup.field, s->setup.scan, &s->setup.params, &s->state.plan, s->state.level,
                     s->state.spacing, s->setup.pool, s->state.p, &removed, e))
        return false;
    s->record.removed += removed;
    return arrange(s, e);
}

/* Whether the coarsest level does not see the surface for its edges. Where it begins more particles see others turned from them than at
 * rest, since lists reach farther: of a large one those count that are within the reach of lists at rest. */
static bool is_too_creased(const sampler *s, bool begins)
{
    const schedule *given = s->setup.schedule;
    const double share = relax_creased_share(s->scratch.relax, s->state.p),
                 reach = s->state.sigma + given->skin_narrow * s->state.spacing;
    if (!begins || share <= given->creased_share) return share > given->creased_share;
    return share > given->creased_share_first ||
           (schedule_is_large(given, s->state.p->count) &&
            relax_creased_share_within(s->scratch.relax, s->state.p, reach) > given->creased_share);
}

/* Then the next finer one takes its place. */
static bool drop_coarsest(sampler *s, bool begins, bool *again, error *e)
{
    *again = is_too_creased(s, begins);
    if (!*again) return true;
    levels_drop_coarsest(&s->state.plan);
    return sampler_begin(s, s->state.sigma / s->state.spacing, e);
}

/* Particles on the coarsest level, where they start. */
bool sampler_begin(sampler *s, double support, error *e)
{
    s->state.p->count = levels_particles(&s->state.plan, 0);
    enter_level(s, s->state.p->count, support);
    if (s->setup.params.max_sigma > 0) s->state.sigma = fmin(s->state.sigma, s->setup.params.max_sigma);
    if (!place(s, e)) return false;
    particles_undamp(s->state.p);
    if (!s->setup.method->begin(s, e)) return false;
    bool again;
    return s->state.plan.count == 1 || s->state.stage > 0 || drop_coarsest(s, true, &again, e);
}

static size_t count_on_boundary(const sampler *s)
{
    size_t count = 0;
    for (size_t i = 0; i < s->state.p->count; i++)
        count += projection_boundary_axes(s->setup.field, s->state.p->position[i]) != 0;
    return count;
}

static bool find_mesh(sampler *s, error *e)
{
    if (!s->scratch.mesh) s->scratch.mesh = refine_mesh_new(s->state.p, s->state.spacing, s->setup.pool, e);
    return s->scratch.mesh != NULL;
}

static void forget_mesh(sampler *s)
{
    refine_mesh_free(s->scratch.mesh);
    s->scratch.mesh = NULL;
}

/* Begins again with a better count once: the boundaries fill up only with time, so the last word is left to the
 * levels between. */
bool sampler_replan(sampler *s, bool *again, error *e)
{
    const size_t count = s->state.p->count;
    if (s->state.stage == 0) return drop_coarsest(s, false, again, e);
    if (s->state.plan.allotments) return true; /* which know their counts */
    /* what is not resolved tells no count to begin again with */
    s->state.planned |= relax_is_mostly_creased(s->scratch.relax);
    if (s->state.planned && s->state.stage < SCHEDULE_STAGES - 1) return true; /* there is a later word */
    if (!find_mesh(s, e)) return false;
    levels_correct(&s->state.plan, refine_mesh_edges(s->scratch.mesh), count_on_boundary(s));
    *again = !s->state.planned && schedule_begins_anew(s->setup.schedule, count, s->state.plan.particles[0]);
    s->state.planned = true;
    if (*again || s->state.stage < SCHEDULE_STAGES - 1) forget_mesh(s);
    if (*again) return sampler_begin(s, s->state.sigma / s->state.spacing, e);
    s->state.plan.particles[0] = count;
    return true;
}

/* Particles in the parts of the surface that had none. Alone, in lists of their own, they take the sweeps with which the
 * coarsest level begins: the level's own are too few for a random start. */
static bool settle_newcomers(sampler *s, error *e)
{
    for (int sweep = 0; sweep < s->setup.schedule->newcomer_sweeps; sweep++) {
        const schedule_position at = {
            .levels = s->state.plan.count, .sweeps = sweep, .count = s->state.p->count};
        const relax_params params = {.field = s->setup.field,
                                     .sigma = s->state.sigma,
                                     .spacing = s->state.spacing,
                                     .omega = schedule_omega(s->setup.schedule, &at),
                                     .fast_step = schedule_longest_step(s->setup.schedule, &at),
                                     .shaken = schedule_is_shaken(s->setup.schedule, &at),
                                     .gain = s->setup.schedule->gain[0]};
        relax_sums sums;
        if (s->state.lists_stale && !sampler_build_lists(s, e)) return false;
        relax_sweep(s->scratch.relax, s->state.p, &params, &sums);
        s->state.lists_stale =
            schedule_wants_lists(s->setup.schedule, &at, sums.cramped, ++s->state.list_age);
        s->state.skin = schedule_skin(s->setup.schedule, sums.rms_step) * s->state.spacing;
        if (threads_stopped(s->setup.pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    }
    return true;
}

static bool add_newcomers(sampler *s, error *e)
{
    size_t count = s->state.plan.newcomers[s->state.level], removed = 0;
    if (count == 0) return true;
    particles *others = s->state.p;
    relax *lists = s->scratch.relax;
    s->state.p = particles_new(count, e);
    s->scratch.relax = sampler_new_relax(s, count, e);
    s->state.lists_stale = true;
    bool ok = s->state.p && s->scratch.relax &&
              start_place(s->setup.field, s->setup.scan, &s->setup.params, &s->state.plan, s->state.level,
                          s->state.spacing, s->setup.pool, s->state.p, &removed, e) &&
              arrange(s, e) && settle_newcomers(s, e);
    if (ok) {
        memcpy(others->position + others->count, s->state.p->position, count * sizeof *others->position);
        memcpy(others->normal + others->count, s->state.p->normal, count * sizeof *others->normal);
        others->count += count;
        s->record.removed += removed;
    }
    particles_free(s->state.p);
    relax_free(s->scratch.relax);
    s->state.p = others;
    s->scratch.relax = lists;
    return ok;
}

/* A level has come to rest: four times as many particles, with the support that it needed. */
bool sampler_refine(sampler *s, error *e)
{
    const levels *plan = &s->state.plan;
    assert(s->state.level + 1 < plan->count);
    double support = s->state.sigma / s->state.spacing;
    size_t count = plan->particles[++s->state.level];
    s->state.level_began = s->record.sweep_count;
    const refine_patches patches = {plan->allotments ? &plan->allotments[s->state.level] : NULL,
                                    plan->curves};
    const bool ok =
        find_mesh(s, e) && refine_particles(s->setup.field, s->setup.scan, s->setup.params.sizing,
                                            plan->allotments ? &patches : NULL, s->scratch.mesh, s->state.p,
                                            count - plan->newcomers[s->state.level], s->state.spacing,
                                            s->setup.params.seed, s->setup.pool, e);
    forget_mesh(s);
    if (!ok) return false;
    enter_level(s, count, support);
    if (!add_newcomers(s, e)) return false;
    if (!plan->allotments && s->state.level == plan->count - 1 && !sampler_cover_parts(s, e)) return false;
    if (!arrange(s, e)) return false;
    enter_level(s, count, support);
    particles_undamp(s->state.p);
    return sampler_build_lists(s, e);
}
