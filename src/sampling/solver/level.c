// SPDX-License-Identifier: Apache-2.0
/* level: initial positions of the particles of a level and refinement to the next level (level.h). */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "geometry/space/morton.h"
#include "geometry/space/packing.h"
#include "sampling/solver/passes/refine.h"
#include "sampling/solver/level.h"
#include "sampling/solver/start.h"

/* Sets spacing, support (`support` over the spacing), skin and gain for the current level. */
static void enter_level(solver *s, size_t count, double support)
{
    const quota *quotas = s->state.plan.quotas;
    double share = level_plan_share(&s->state.plan, s->state.level);
    s->state.spacing =
        quotas ? quotas[s->state.level].spacing : packing_spacing(s->setup.scan->area, (double)count / share);
    s->state.sigma = support * s->state.spacing;
    s->state.skin = s->state.regime->schedule->skin_wide * s->state.spacing;
    s->state.gain = schedule_gain(s->state.regime->schedule, s->state.stage);
    s->state.has_many_defects = false;
    s->state.had_extra_sweeps = false;
}

/* Sorts the particles along a space-filling curve, so that neighbours are near each other in memory. */
static bool arrange(solver *s, error *e)
{
    uint32_t *order = mem_array(s->state.p->count, sizeof *order, "the order of particles", e);
    bool ok = order && morton_order(s->state.p->position, s->state.p->count, s->setup.pool, order, e) &&
              particles_arrange(s->state.p, order, s->setup.pool, e);
    free(order);
    return ok;
}

/* Whether the coarsest level has given particles, so that it is neither dropped nor changed in count. */
static bool has_given_level(const solver *s)
{
    return s->setup.params.start == SOLVER_START_COARSEST;
}

static void copy_given(solver *s)
{
    particles *p = s->state.p;
    memcpy(p->position, s->setup.params.given, p->count * sizeof *p->position);
    memcpy(p->normal, s->setup.params.given_normal, p->count * sizeof *p->normal);
}

/* Initial positions of the particles, in memory order. */
static bool place(solver *s, error *e)
{
    size_t removed;
    if (solver_is_continued(s)) {
        copy_given(s);
        if (s->setup.params.given_place)
            memcpy(s->state.p->place, s->setup.params.given_place,
                   s->state.p->count * sizeof *s->state.p->place);
        if (!s->state.p->patch) return true;
        assert(s->setup.params.given_patch && s->setup.params.given_place);
        memcpy(s->state.p->patch, s->setup.params.given_patch, s->state.p->count * sizeof *s->state.p->patch);
        return true;
    }
    if (has_given_level(s) && !s->state.p->patch) {
        copy_given(s);
        return arrange(s, e);
    }
    if (!start_place(s->setup.field, s->setup.scan, &s->setup.params, &s->state.plan, s->state.level,
                     s->state.spacing, s->setup.pool, s->state.p, &removed, e))
        return false;
    s->record.removed += removed;
    return arrange(s, e);
}

/* Drops the coarsest level if it does not resolve the surface: the next finer one takes its place. */
static bool drop_coarsest(solver *s, bool *again, error *e)
{
    *again = relax_divergent_share(s->scratch.relax, s->state.p) > s->state.regime->schedule->divergent_share;
    if (!*again) return true;
    level_plan_drop_coarsest(&s->state.plan);
    return solver_place(s, s->state.sigma / s->state.spacing, e);
}

bool solver_place(solver *s, double support, error *e)
{
    s->state.p->count = level_plan_particles(&s->state.plan, 0);
    enter_level(s, s->state.p->count, support);
    if (s->setup.params.max_sigma > 0) s->state.sigma = fmin(s->state.sigma, s->setup.params.max_sigma);
    if (!place(s, e)) return false;
    particles_reset_damping(s->state.p);
    if (!s->setup.method->begin(s, e)) return false;
    bool again;
    return s->state.plan.count == 1 || s->state.stage > 0 || has_given_level(s) ||
           drop_coarsest(s, &again, e);
}

static size_t count_on_boundary(const solver *s)
{
    size_t count = 0;
    for (size_t i = 0; i < s->state.p->count; i++)
        count += projection_boundary_axes(s->setup.field, s->state.p->position[i]) != 0;
    return count;
}

static bool require_mesh(solver *s, error *e)
{
    if (!s->scratch.mesh) s->scratch.mesh = refine_mesh_new(s->state.p, s->state.spacing, s->setup.pool, e);
    return s->scratch.mesh != NULL;
}

static void release_mesh(solver *s)
{
    refine_mesh_free(s->scratch.mesh);
    s->scratch.mesh = NULL;
}

/* The level starts again at most once: boundaries fill up gradually, so that later stages correct the
 * intermediate levels only. */
bool solver_replan(solver *s, bool *again, error *e)
{
    const size_t count = s->state.p->count;
    if (has_given_level(s)) return true;
    if (s->state.stage == 0) return drop_coarsest(s, again, e);
    if (s->state.plan.quotas) return true; /* quotas determine the counts */
    /* the number of edges is meaningless if the level does not resolve the surface */
    s->state.counts_corrected |= relax_has_mostly_divergent_normals(s->scratch.relax);
    if (s->state.counts_corrected && s->state.stage < SCHEDULE_STAGES - 1)
        return true; /* the last stage corrects the counts */
    if (!require_mesh(s, e)) return false;
    level_plan_correct(&s->state.plan, refine_mesh_edges(s->scratch.mesh), count_on_boundary(s));
    *again = !s->state.counts_corrected && s->state.plan.particles[0] != count;
    s->state.counts_corrected = true;
    if (*again || s->state.stage < SCHEDULE_STAGES - 1) release_mesh(s);
    if (*again) return solver_place(s, s->state.sigma / s->state.spacing, e);
    s->state.plan.particles[0] = count;
    return true;
}

/* Relaxes the particles of parts that had none before, separately from the others, by the first sweeps of the
 * coarsest level. The sweeps of the current level are too few for a random start. */
static bool relax_new_parts(solver *s, error *e)
{
    schedule_position at = {.levels = s->state.plan.count, .count = s->state.p->count};
    const int sweeps = schedule_level_sweeps(s->state.regime->schedule, &at);
    for (at.sweeps = 0; at.sweeps < sweeps; at.sweeps++) {
        const relax_params params = {.field = s->setup.field,
                                     .sigma = s->state.sigma,
                                     .spacing = s->state.spacing,
                                     .omega = schedule_omega(s->state.regime->schedule, &at),
                                     .fast_step = schedule_longest_step(s->state.regime->schedule, &at),
                                     .shaken = schedule_is_shaken(s->state.regime->schedule, &at),
                                     .gain = schedule_gain(s->state.regime->schedule, 0)};
        relax_sums sums;
        if (s->state.lists_stale && !solver_build_lists(s, e)) return false;
        relax_sweep(s->scratch.relax, s->state.p, &params, &sums);
        s->state.lists_stale =
            schedule_wants_lists(s->state.regime->schedule, &at, sums.limited, ++s->state.list_age);
        s->state.skin = schedule_skin(s->state.regime->schedule, sums.rms_step) * s->state.spacing;
        if (!threads_may_go_on(s->setup.pool, e)) return false;
    }
    return true;
}

/* Adds the particles of the parts that get their first particles on the current level. */
static bool add_new_parts(solver *s, error *e)
{
    size_t count = s->state.plan.new_parts[s->state.level], removed = 0;
    if (count == 0) return true;
    particles *others = s->state.p;
    relax *lists = s->scratch.relax;
    s->state.p = particles_new(count, e);
    s->state.next_amplitudes = s->record.sweep_count;
    s->scratch.relax = solver_new_relax(s, count, e);
    s->state.lists_stale = true;
    bool ok = s->state.p && s->scratch.relax &&
              start_place(s->setup.field, s->setup.scan, &s->setup.params, &s->state.plan, s->state.level,
                          s->state.spacing, s->setup.pool, s->state.p, &removed, e) &&
              arrange(s, e) && relax_new_parts(s, e);
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

/* The support over the spacing is that of the coarser level. */
bool solver_refine(solver *s, error *e)
{
    const level_plan *plan = &s->state.plan;
    assert(s->state.level + 1 < plan->count);
    double support = s->state.sigma / s->state.spacing;
    size_t count = plan->particles[++s->state.level];
    s->state.level_first_sweep = s->record.sweep_count;
    const refine_patches patches = {plan->quotas ? &plan->quotas[s->state.level] : NULL, plan->curves};
    const bool ok =
        require_mesh(s, e) && refine_particles(s->setup.field, s->setup.scan, s->setup.params.sizing,
                                               plan->quotas ? &patches : NULL, s->scratch.mesh, s->state.p,
                                               count - plan->new_parts[s->state.level], s->state.spacing,
                                               s->setup.params.seed, s->setup.pool, e);
    release_mesh(s);
    if (!ok) return false;
    enter_level(s, count, support);
    return add_new_parts(s, e);
}

bool solver_enter_refined(solver *s, error *e)
{
    if (!arrange(s, e)) return false;
    s->state.skin = s->state.regime->schedule->skin_wide * s->state.spacing;
    s->state.next_amplitudes = s->record.sweep_count; /* inserted particles have none yet */
    particles_reset_damping(s->state.p);
    return solver_build_lists(s, e);
}
