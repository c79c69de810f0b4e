// SPDX-License-Identifier: Apache-2.0
/* relax_fast: fast steps in SIMD lanes, without an energy test (relax_internal.h). */
#include "sampling/solver/passes/relax_internal.h"

#include <math.h>

/* Maximum distance from the surface before the Newton step that ends a fast step, over h. The error of a
 * Newton step is about the square of this distance times the curvature. */
static const double FAST_STEP_DISTANCE = 0.05;
/* The same over grid cells, divided by FAST_STEP_DISTANCE: 1.5 cells. A level set has distances for three
 * voxels on either side. */
static const double FAST_STEP_CELLS = 30;

/* Parameters of the fast kernel for a sweep. */
static fast_kernel_params fast_step_params(const relax *r, const relax_params *params)
{
    return (fast_kernel_params){.unit = r->near->unit,
                                .support = params->sigma,
                                .omega = params->omega,
                                .longest = params->fast_step * params->spacing,
                                .farthest = FAST_STEP_DISTANCE *
                                            fmin(params->spacing, FAST_STEP_CELLS * params->field->cell_size),
                                .factors = r->factors,
                                .has_amplitudes = r->has_amplitudes};
}

/* Samples the fields of particles of patches in lanes. If the gradient is opposite to a particle's normal,
 * the hint is outdated and has led to the opposite wall: samples again without a hint. */
static void sample_patch_lanes(const sweep_job *job, const uint32_t *items, size_t count,
                               fast_kernel_step *step)
{
    const field *f = job->params->field;
    uint32_t patch[VEC3_LANES] = {0}, hint[VEC3_LANES] = {0};
    for (size_t l = 0; l < count; l++) {
        patch[l] = job->p->patch[items[l]];
        hint[l] = job->p->hint[items[l]];
    }
    f->ops->sample_patch_lanes(f, patch, &step->end, step->is_valid, hint, step->value, &step->gradient);
    bool again[VEC3_LANES] = {false}, any = false;
    for (size_t l = 0; l < count; l++) {
        const vec3 gradient = {step->gradient.x[l], step->gradient.y[l], step->gradient.z[l]};
        if (!step->is_valid[l] || !(vec3_dot(gradient, job->p->normal[items[l]]) < 0)) continue;
        hint[l] = FIELD_NO_HINT;
        again[l] = any = true;
    }
    if (any) f->ops->sample_patch_lanes(f, patch, &step->end, again, hint, step->value, &step->gradient);
    for (size_t l = 0; l < count; l++) job->p->hint[items[l]] = hint[l];
}

/* Samples the field at the targets of the particles, with patches that of each particle's patch. */
static void sample_lanes(const sweep_job *job, const uint32_t *items, size_t count, fast_kernel_step *step)
{
    const field *f = job->params->field;
    if (!job->p->patch) {
        field_sample_lanes(f, &step->end, step->is_valid, step->value, &step->gradient);
        return;
    }
    if (f->ops->sample_patch_lanes) {
        sample_patch_lanes(job, items, count, step);
        return;
    }
    for (size_t l = 0; l < count; l++) {
        field_sample s = {0};
        vec3 x = {step->end.x[l], step->end.y[l], step->end.z[l]};
        step->is_valid[l] =
            step->is_valid[l] && field_sample_at(particles_field(job->p, f, items[l]), x, FIELD_GRADIENT, &s);
        step->value[l] = s.value;
        step->gradient.x[l] = s.gradient.x;
        step->gradient.y[l] = s.gradient.y;
        step->gradient.z[l] = s.gradient.z;
    }
}

/* Clears is_valid of the steps of particles near curves that leave their patch. */
static void stay_on_patches(const sweep_job *job, const uint32_t *items, size_t first, size_t count,
                            fast_kernel_step *step)
{
    particles *p = job->p;
    for (size_t l = first; p->patch && l < count; l++) {
        const uint32_t i = items[l];
        if (!p->near_boundary[i] || !step->is_valid[l]) continue;
        const field *patch = particles_field(p, job->params->field, i);
        step->is_valid[l] = field_is_within_near(patch, vec3_lanes_get(&step->end, (int)l), &p->hint[i]);
    }
}

void relax_fast_steps(const sweep_job *job, const uint32_t *items, size_t first, size_t count,
                      const fast_kernel_particles *own, const fast_kernel_forces *forces,
                      bool stays[FAST_KERNEL_LANES], block_sums *sums)
{
    const fast_kernel *k = job->r->fast;
    const fast_kernel_params params = fast_step_params(job->r, job->params);
    fast_kernel_step step;
    block_sums more = *sums; /* a local copy stays in registers */
    k->tangent_step(own, forces, &params, &step);
    for (size_t l = 0; l < first; l++) step.is_valid[l] = false;
    for (size_t l = count; l < FAST_KERNEL_LANES; l++) step.is_valid[l] = false;
    sample_lanes(job, items, count, &step);
    k->project(own, &params, &step);
    stay_on_patches(job, items, first, count, &step);
    for (size_t l = first; l < count; l++) {
        stays[l] = !step.is_valid[l];
        if (stays[l]) continue;
        relax_add_energy(job, items[l], (double)forces->energy[l], &more);
        more.lambda += RELAX_LAMBDA_FLOOR;
        relax_take_step(job, items[l], vec3_lanes_get(&step.end, (int)l),
                        vec3_lanes_get(&step.gradient, (int)l), step.length[l], (double)own->allowed_step[l],
                        &more);
    }
    *sums = more;
}

size_t relax_fast_step(const sweep_job *job, uint32_t *items, size_t count, bool has_divergent,
                       block_sums *sums)
{
    fast_kernel_params params = fast_step_params(job->r, job->params);
    fast_kernel_particles own;
    fast_kernel_forces forces;
    bool stays[FAST_KERNEL_LANES];
    params.has_facing = has_divergent && !job->r->ignores_normals;
    relax_fill_lanes(job->r, job->p, items, count, &own);
    job->r->fast->forces(job->r->near->place, &own, &params, &forces);
    relax_fast_steps(job, items, 0, count, &own, &forces, stays, sums);
    size_t left = 0;
    for (size_t l = 0; l < count; l++)
        if (stays[l]) items[left++] = items[l];
    return left;
}
