// SPDX-License-Identifier: Apache-2.0
/* relax_guarded: guarded steps in sixteen SIMD lanes in single precision (relax_internal.h). The operations
 * are those of fast_kernel.h. */
#include <math.h>
#include <string.h>

#include "base/core/elementary.h"
#include "surface/field/projection.h"
#include "sampling/solver/passes/relax_internal.h"

/* Trials per sweep. If all fail, the particle starts with more damping in the next sweep. */
enum { TRIALS = 2 };
/* Maximum number of Newton steps that project a trial. */
enum { PROJECTION_STEPS = 3 };
/* Minimum relative decrease of the energy in single precision. It corresponds to a remaining step of about
 * 3e-4 spacings. */
static const double MIN_GAIN = 1e-6;

/* Particles in the lanes and their trials. */
typedef struct trial {
    fast_kernel_particles own;
    fast_kernel_forces forces;
    fast_kernel_params params;
    fast_kernel_step step;
    bool pending[FAST_KERNEL_LANES]; /* no trial was accepted yet */
    double lambda[FAST_KERNEL_LANES];
} trial;

static bool any_pending(const trial *t)
{
    bool any = false;
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) any |= t->pending[l];
    return any;
}

static fast_kernel_params kernel_params(const sweep_job *job)
{
    const relax_params *p = job->params;
    return (fast_kernel_params){.unit = job->r->near->unit,
                                .support = p->sigma,
                                .omega = p->omega,
                                .longest = INFINITY,
                                .farthest = RELAX_TRIAL_SHORTCUT * projection_scale(p->field, p->spacing),
                                .factors = job->r->factors,
                                .has_facing = !job->r->ignores_normals,
                                .has_amplitudes = job->r->has_amplitudes};
}

/* One Newton step towards the surface for the lanes in `left`. Sets is_valid of the lanes that are on the
 * surface; `left` receives the lanes that need another step. False: no lane does. */
static bool newton_step(const sweep_job *job, const trial *t, bool left[FAST_KERNEL_LANES],
                        fast_kernel_step *step)
{
    bool any = false;
    memcpy(step->is_valid, left, sizeof step->is_valid);
    field_sample_lanes(job->params->field, &step->end, step->is_valid, step->value, &step->gradient);
    memcpy(left, step->is_valid, sizeof step->is_valid); /* the field is undefined at the other lanes */
    job->r->fast->project(&t->own, &t->params, step);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        left[l] = left[l] && !step->is_valid[l];
        any |= left[l];
    }
    return any;
}

/* Projects the pending lanes onto the surface. Failed lanes have !is_valid. */
static void project_trials(const sweep_job *job, trial *t)
{
    fast_kernel_step *step = &t->step;
    bool left[FAST_KERNEL_LANES];
    memcpy(left, t->pending, sizeof left);
    bool again = newton_step(job, t, left, step);
    for (int k = 1; k < PROJECTION_STEPS && again; k++) {
        fast_kernel_step next = *step; /* projected lanes keep their values */
        bool moved[FAST_KERNEL_LANES];
        memcpy(moved, left, sizeof moved);
        again = newton_step(job, t, left, &next);
        for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
            if (!moved[l]) continue;
            vec3_lanes_put(&step->end, (int)l, vec3_lanes_get(&next.end, (int)l));
            vec3_lanes_put(&step->gradient, (int)l, vec3_lanes_get(&next.gradient, (int)l));
            step->length[l] = next.length[l];
            step->is_valid[l] = next.is_valid[l];
        }
    }
}

/* Copies the projected lane l of t to lane k of *out. */
static void move_lane(const sweep_job *job, const trial *t, size_t l, size_t k, fast_kernel_particles *out)
{
    const neighbours_place place =
        neighbours_place_of(job->r->near, vec3_lanes_get(&t->step.end, (int)l), t->own.size[l]);
    out->list[k] = t->own.list[l];
    out->count[k] = t->own.count[l];
    out->x[k] = place.x;
    out->y[k] = place.y;
    out->z[k] = place.z;
    out->size[k] = place.size;
    out->amplitude[k] = t->own.amplitude[l];
    vec3_lanes_put(&out->normal, (int)k, vec3_lanes_get(&t->step.gradient, (int)l));
}

/* Energies of the projected pending lanes, compacted: in the second trial they are few. */
static void evaluate_energies(const sweep_job *job, const trial *t, float energy[FAST_KERNEL_LANES])
{
    fast_kernel_particles there = t->own;
    size_t lane[FAST_KERNEL_LANES], count = 0;
    float found[FAST_KERNEL_LANES];
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->pending[l] || !t->step.is_valid[l]) continue;
        move_lane(job, t, l, count, &there);
        lane[count++] = l;
    }
    if (count == 0) return;
    for (size_t k = count; k < FAST_KERNEL_LANES; k++) there.count[k] = 0;
    job->r->fast->energy(job->r->near->place, &there, &t->params, count, found);
    for (size_t k = 0; k < count; k++) energy[lane[k]] = found[k];
}

/* Computes the steps of the pending lanes. A lane without sufficient gain has converged; a lane limited by
 * the lists waits. Neither is pending any longer. */
static void begin_trial(const sweep_job *job, const uint32_t *items, double gain, trial *t, block_sums *sums)
{
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++)
        t->own.damping[l] = t->pending[l] ? (float)elementary_exp(M_LN10 * t->lambda[l]) : 0;
    job->r->fast->tangent_step(&t->own, &t->forces, &t->params, &t->step);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->pending[l]) continue;
        const double allowed = (double)t->own.allowed_step[l], size = (double)t->own.size[l];
        const double nearest = sqrt((double)t->forces.nearest2[l]) * t->params.unit;
        if (!(t->step.gain[l] > gain * (double)t->forces.energy[l]) || t->lambda[l] > RELAX_LAMBDA_CAP) {
            job->p->lambda[items[l]] = (float)RELAX_LAMBDA_CAP;
            t->pending[l] = false;
        } else if (allowed < nearest &&
                   FAST_KERNEL_BOUND_SHARE * allowed < RELAX_STEP_FLOOR * job->params->spacing * size) {
            relax_count_limited(job, items[l], sums);
            t->pending[l] = false;
        }
    }
}

/* Projects and evaluates the pending lanes. Accepts steps that decrease the energy; increases the damping
 * of the other lanes. */
static void end_trial(const sweep_job *job, const uint32_t *items, double gain, bool first, trial *t,
                      block_sums *sums)
{
    float energy[FAST_KERNEL_LANES]; /* of projected lanes */
    project_trials(job, t);
    evaluate_energies(job, t, energy);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->pending[l]) continue;
        if (!t->step.is_valid[l] || !((double)energy[l] < (double)t->forces.energy[l] * (1 - gain))) {
            sums->rejected++;
            t->lambda[l] += 1;
            continue;
        }
        t->pending[l] = false;
        if (first) t->lambda[l] = fmax(t->lambda[l] - 1, RELAX_LAMBDA_FLOOR);
        job->p->lambda[items[l]] = (float)t->lambda[l];
        relax_take_step(job, items[l], vec3_lanes_get(&t->step.end, (int)l),
                        vec3_lanes_get(&t->step.gradient, (int)l), t->step.length[l],
                        (double)t->own.allowed_step[l], sums);
    }
}

/* Adds the forces by the turning of the particles' own normals, through the weights. Along an axis of the
 * frame the normal turns by the shape operator times the axis. */
static void add_turning(const sweep_job *job, trial *t)
{
    fast_kernel_forces *f = &t->forces;
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->pending[l]) continue;
        const vec3 pull = {(double)f->turning[0][l], (double)f->turning[1][l], (double)f->turning[2][l]};
        const vec3 x = {t->own.position.x[l], t->own.position.y[l], t->own.position.z[l]};
        const vec3 axis1 = {(double)f->axis1[0][l], (double)f->axis1[1][l], (double)f->axis1[2][l]};
        const vec3 axis2 = {(double)f->axis2[0][l], (double)f->axis2[1][l], (double)f->axis2[2][l]};
        field_sample s;
        if (vec3_norm2(pull) == 0 || !field_sample_at(job->params->field, x, FIELD_HESSIAN, &s)) continue;
        const double length = vec3_norm(s.gradient), scale = t->params.unit / length;
        const vec3 n = vec3_scale(s.gradient, 1 / length), along = vec3_axpy(-vec3_dot(pull, n), n, pull);
        f->d1[l] += (float)(scale * vec3_dot(sym3_apply(s.hessian, axis1), along));
        f->d2[l] += (float)(scale * vec3_dot(sym3_apply(s.hessian, axis2), along));
    }
}

void relax_guarded_steps(const sweep_job *job, const uint32_t *items, size_t divergent, size_t count,
                         block_sums *sums)
{
    const double gain = fmax(job->params->gain, MIN_GAIN);
    bool guarded[FAST_KERNEL_LANES];
    trial t;
    t.params = kernel_params(job);
    relax_fill_lanes(job->r, job->p, items, count, &t.own);
    job->r->fast->forces(job->r->near->place, &t.own, &t.params, &t.forces);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) guarded[l] = l < divergent;
    if (divergent < count) relax_fast_steps(job, items, divergent, count, &t.own, &t.forces, guarded, sums);
    memcpy(t.pending, guarded, sizeof t.pending);
    if (t.params.has_facing) add_turning(job, &t);
    for (size_t l = 0; l < count; l++) {
        const double lambda = (double)job->p->lambda[items[l]];
        t.lambda[l] = lambda >= RELAX_LAMBDA_CAP ? 0 : lambda;
    }
    for (int k = 0; k < TRIALS && any_pending(&t); k++) {
        begin_trial(job, items, gain, &t, sums);
        if (any_pending(&t)) end_trial(job, items, gain, k == 0, &t, sums);
    }
    for (size_t l = 0; l < count; l++) {
        if (!guarded[l]) continue;
        if (t.pending[l]) job->p->lambda[items[l]] = (float)t.lambda[l];
        relax_add_energy(job, items[l], (double)t.forces.energy[l], sums);
        sums->lambda += (double)job->p->lambda[items[l]];
    }
}
