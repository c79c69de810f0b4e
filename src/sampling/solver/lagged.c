// SPDX-License-Identifier: Apache-2.0
/* lagged: amplitudes, sizes and neighbour lists, which are constant between renewals. See solver_state.h. */
#include "base/core/elementary.h"
#include "sampling/packing/energy.h"
#include "geometry/space/packing.h"
#include "sampling/solver/solver_state.h"

/* The amplitude of (13) and (14), clamped. The curvature is made dimensionless by the extent of the
 * surface. */
static double amplitude(const solver *s, double kappa)
{
    double k = fmin(kappa * s->setup.field->extent, s->setup.params.kappa_max);
    return s->setup.params.gamma + 1 / (elementary_pow(k, s->setup.params.d) + s->setup.params.nu);
}

bool solver_amplitude_at(const solver *s, const field *f, uint32_t patch, vec3 x, vec3 normal, double *alpha)
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

bool solver_is_on_target(const solver *s, double energy)
{
    return fabs(energy / s->setup.params.energy->ideal - 1) < s->setup.params.energy_tolerance;
}

typedef struct renewal {
    solver *s;
    size_t grain;
    double squares[THREADS_SUM_PARTS]; /* per part of the sum: sums of squared relative changes */
} renewal;

static double renew(solver *s, threads_work work)
{
    renewal job = {s, s->state.p->count / THREADS_SUM_PARTS + 1, {0}};
    double squares = 0;
    threads_run(s->setup.pool, s->state.p->count, job.grain, work, &job);
    for (int k = 0; k < THREADS_SUM_PARTS; k++) squares += job.squares[k];
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
        if (!solver_amplitude_at(job->s, f, particles_patch(p, i), p->position[i], p->normal[i],
                                 &p->alpha[i]))
            continue;
        double change = p->alpha[i] / before - 1;
        squares += change * change;
    }
    job->squares[begin / job->grain] = squares;
}

double solver_renew_amplitudes(solver *s)
{
    return s->setup.params.graded ? renew(s, amplitude_chunk) : 0;
}

/* Amplitudes are renewed every sweep at first, while steps are long; then the intervals grow with the sweeps
 * of the level (schedule.renewal_share). Between renewals the energy is a function of the positions only and cannot increase. */
bool solver_amplitudes_are_due(const solver *s)
{
    return s->setup.params.graded && s->record.sweep_count >= s->state.next_amplitudes;
}

static void size_chunk(void *context, int worker, size_t begin, size_t end)
{
    renewal *job = context;
    solver *s = job->s;
    double over_h = 1 / packing_spacing(s->setup.scan->area, (double)s->setup.params.count), squares = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const double size =
                         over_h * sizing_field_spacing(s->setup.params.sizing, s->state.p->position[i], NULL),
                     change = s->state.p->size[i] / size - 1;
        squares += change * change;
        s->state.p->size[i] = size;
    }
    job->squares[begin / job->grain] = squares;
}

double solver_renew_sizes(solver *s)
{
    return s->setup.params.sizing ? renew(s, size_chunk) : 0;
}

void solver_spacings(const solver *s, double *out)
{
    for (size_t i = 0; i < s->state.p->count; i++) out[i] = particles_size(s->state.p, i) * s->state.spacing;
}

bool solver_build_lists(solver *s, error *e)
{
    if (solver_amplitudes_are_due(s)) {
        solver_renew_amplitudes(s);
        const double swept = (double)(s->record.sweep_count - s->state.level_first_sweep);
        s->state.next_amplitudes =
            s->record.sweep_count + 1 + (size_t)(s->state.regime->schedule->renewal_share * swept);
    }
    solver_renew_sizes(s);
    particles_mark_boundary(s->state.p, s->setup.field, s->state.spacing);
    if (!relax_build(s->scratch.relax, s->state.p, s->state.sigma, s->state.skin, e)) return false;
    s->state.lists_stale = false;
    s->state.list_age = 0;
    return true;
}

/* Not for the Gaussian: its second derivative is negative near the centre, so that Newton's step is not
 * meaningful. */
relax_steps solver_steps_left(const solver *s, bool watch)
{
    if (s->setup.params.energy == &energy_gaussian) return (relax_steps){NAN, NAN};
    return relax_rms_steps_left(s->scratch.relax, s->state.p, s->state.sigma, s->state.spacing, watch);
}

/* Builds lists for the present positions. */
bool solver_refresh_lists(solver *s, error *e)
{
    return relax_refresh(s->scratch.relax, s->state.p, s->state.sigma) ||
           relax_build(s->scratch.relax, s->state.p, s->state.sigma, 0, e);
}

bool solver_steps_after_projection(solver *s, relax_steps *left, error *e)
{
    solver_renew_sizes(s);
    if (!solver_refresh_lists(s, e)) return false;
    *left = solver_steps_left(s, false);
    return true;
}
