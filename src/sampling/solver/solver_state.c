// SPDX-License-Identifier: Apache-2.0
/* solver_state: queries of the state of a solve, and memory for it. See solver_state.h. */
#include "sampling/solver/solver.h"

#include <string.h>

#include "base/core/memory.h"
#include "sampling/packing/energy.h"
#include "geometry/space/packing.h"
#include "sampling/solver/solver_state.h"

relax *solver_new_relax(const solver *s, size_t capacity, error *e)
{
    return relax_new(capacity, s->setup.params.energy, s->setup.fast, s->setup.params.list_limit,
                     s->setup.pool, e);
}

bool solver_reserve(solver *s, size_t capacity, error *e)
{
    if (capacity <= s->scratch.capacity) return true;
    if (s->setup.params.count_limit > 0 && capacity > s->setup.params.count_limit)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "more than %zu particles are needed, which is what memory holds: raise "
                         "limits.memory_mb, or ask for a larger sigma or spacing",
                         s->setup.params.count_limit);
    relax *bigger = solver_new_relax(s, capacity, e);
    if (!bigger || !particles_grow(s->state.p, capacity, e)) {
        relax_free(bigger);
        return false;
    }
    relax_free(s->scratch.relax);
    s->scratch.relax = bigger;
    s->scratch.capacity = capacity;
    return true;
}

bool solver_is_continued(const solver *s)
{
    return s->state.regime->is_continued;
}

bool solver_merges_near_curves(const solver *s)
{
    return s->setup.field->patches && s->setup.field->patches->merges_near_curves;
}

void solver_mark_displaced(solver *s, size_t i)
{
    if (!s->state.p->patch || solver_merges_near_curves(s))
        relax_mark_displaced(s->scratch.relax, s->state.p, i);
}

bool solver_ends_smoothly(const solver *s)
{
    return !s->state.p->patch && !s->setup.params.graded && !s->setup.field->sharp;
}

size_t solver_point_count(const solver *s)
{
    const quota *a = s->state.plan.quotas;
    if (!a) return s->state.p->count;
    const curve_samples *rows = &a[s->state.level].samples;
    return s->state.p->count - rows->copies + rows->count;
}

bool solver_ended(const solver *s)
{
    return s->state.outcome != SOLVER_RUNNING;
}

solver_outcome solver_result(const solver *s)
{
    return s->state.outcome;
}

const solver_sweep *solver_sweeps(const solver *s, size_t *count)
{
    *count = s->record.sweep_count;
    return s->record.sweep;
}

const solver_round *solver_rounds(const solver *s, size_t *count)
{
    *count = s->record.round_count;
    return s->record.round;
}

double solver_fraction(const solver *s)
{
    return s->state.fraction;
}

double solver_excess(const solver *s, const solver_sweep *sweep)
{
    return sweep->energy / s->setup.params.energy->ideal - 1;
}

double solver_gain(const solver *s)
{
    size_t k = s->record.round_count;
    while (k > 0 && strcmp(s->record.round[k - 1].ended, ROUND_AT_MAX_SWEEPS) == 0) k--;
    return k > 0 ? s->record.round[k - 1].gain : 0;
}

bool solver_took_longer_steps(const solver *s)
{
    return s->state.regime->schedule == &schedule_eased;
}

double solver_coarsest_gain(const solver *s)
{
    return schedule_coarsest_gain(s->state.regime->schedule);
}

solver_particles solver_current_particles(const solver *s)
{
    const particles *p = s->state.p;
    return (solver_particles){p->count, p->position, p->normal, s->state.spacing, p->size};
}

double solver_spacing(const solver *s)
{
    return s->state.spacing;
}

size_t solver_removed_offsurface(const solver *s)
{
    return s->record.removed;
}
