// SPDX-License-Identifier: Apache-2.0
/* relax_damped: guarded steps of single particles in double precision, by Levenberg-Marquardt or steepest
 * descent (relax_internal.h). */
#include "base/core/elementary.h"
#include "sampling/solver/passes/relax_internal.h"

#include <math.h>

#include "surface/field/projection.h"

/* log10 of the damping of a step from which a particle with a smooth energy is projected more exactly: the
 * error of its position misleads the step. At edges and boundaries such damping is normal. */
static const double MISLED_LAMBDA = 2;
/* Minimum distance over sigma at which the potential is evaluated for the turning of normals; it is
 * singular at 0. */
static const double MIN_TURNING_DISTANCE = 0.05;
/* Maximum difference of the cosines of a pair's normals, with the particle's stored normal and with the one at its
 * position. */
static const double TURNING_MARGIN = 0.1;
/* Maximum distance of a trial from the surface over h. */
static const double TRIAL_REJECT = 0.01;
/* Projection tolerance of a trial over h. */
static const double TRIAL_ACCEPT = 1e-4;
/* Projection tolerance of particles with misled steps over h: well below the resolution of `gain`. */
static const double EXACT_ACCEPT = 1e-7;
/* Maximum number of projection steps of a trial. */
static const int TRIAL_STEPS = 3;

/* The particle whose step is computed. */
typedef struct step_input {
    const relax_params *params;
    const field *field; /* of the particle */
    uint32_t *hint;     /* location on that field: `sample_near` of field_ops */
    bool bounded;       /* the patch may end nearby */
    const energy_function *potential;
    pair_list *near;
    bool flat; /* all weights are 1 */
    /* The surface may have facets with interpolated normals. A step in the tangent plane ends off the facet.
     * The forces, which are computed in the plane, do not give the change of energy on the facet. */
    bool faceted;
    /* fast steps exist: of particles with weights of 1 only those whose fast step failed come here */
    bool has_fast;
    vec3 x, normal, axis1, axis2;
    double sigma, spacing; /* times the particle's size */
    double bound;          /* maximum step in the tangent plane */
    double limit;          /* maximum displacement */
    double energy;
    unsigned boundary_axes; /* normal axes of the domain faces that the particle lies in and never leaves */
} step_input;

/* Whether a weight may change when the particle's own normal turns: that of a pair between the limits of
 * PAIR_FACING_RANGE, or near them. */
static bool may_turn(const pair_list *g, vec3 n)
{
    const double least = PAIR_FACING_NONE - TURNING_MARGIN,
                 most = PAIR_FACING_NONE + PAIR_FACING_RANGE + TURNING_MARGIN;
    bool any = false;
    for (size_t k = 0; k < g->blocks * PAIR_LANES; k++) {
        const double cosine = n.x * g->nx[k] + n.y * g->ny[k] + n.z * g->nz[k];
        any |= cosine > least && cosine < most;
    }
    return any;
}

/* Adds the forces by the turning of the particle's own normal, through the weights. Along axis e of the frame
 * the normal turns by S e, where S is the shape operator. */
static void add_turning(const step_input *a, pair_forces *f)
{
    field_sample s;
    if (!may_turn(a->near, a->normal) || !field_sample_near(a->field, a->x, FIELD_HESSIAN, a->hint, &s))
        return;
    double length = vec3_norm(s.gradient);
    vec3 n = vec3_scale(s.gradient, 1 / length);
    vec3 turn1 = vec3_scale(sym3_apply(s.hessian, a->axis1), 1 / length);
    vec3 turn2 = vec3_scale(sym3_apply(s.hessian, a->axis2), 1 / length);
    turn1 = vec3_axpy(-vec3_dot(turn1, n), n, turn1);
    turn2 = vec3_axpy(-vec3_dot(turn2, n), n, turn2);
    const pair_list *g = a->near;
    for (size_t k = 0; k < g->blocks * PAIR_LANES; k++) {
        vec3 nj = {g->nx[k], g->ny[k], g->nz[k]};
        double t = (vec3_dot(n, nj) - PAIR_FACING_NONE) / PAIR_FACING_RANGE;
        double r = vec3_norm(vec3_sub(a->x, (vec3){g->x[k], g->y[k], g->z[k]}));
        double support = sqrt(g->size2[k]) * a->sigma;
        if (t <= 0 || t >= 1 || r >= support) continue;
        double slope = g->amplitude[k] * g->size2[k] * 6 * t * (1 - t) / PAIR_FACING_RANGE *
                       a->potential->value(fmax(r / support, MIN_TURNING_DISTANCE));
        f->d1 += slope * vec3_dot(turn1, nj);
        f->d2 += slope * vec3_dot(turn2, nj);
    }
}

double relax_damped_step(const pair_forces *f, double lambda, double *s1, double *s2)
{
    double floor = FAST_KERNEL_HESSIAN_FLOOR * (f->h11 + f->h22);
    double a = f->h11 * (1 + lambda) + floor, c = f->h22 * (1 + lambda) + floor, b = f->h12;
    double determinant = a * c - b * b, over = 1 / determinant;
    if (!(determinant > 0)) {
        *s1 = *s2 = 0;
        return 0;
    }
    *s1 = (b * f->d2 - c * f->d1) * over;
    *s2 = (b * f->d1 - a * f->d2) * over;
    return -0.5 * (*s1 * f->d1 + *s2 * f->d2);
}

/* A step in the tangent plane (8), to *beside, and the projection onto the surface (9), to *x. False: the
 * projection failed, left the patch or exceeded the limit. */
static bool step_and_project(const step_input *a, double s1, double s2, vec3 *beside, vec3 *x, vec3 *normal)
{
    double h = projection_scale(a->field, a->spacing);
    const projection_limits limits = {TRIAL_STEPS, TRIAL_ACCEPT * h, RELAX_TRIAL_SHORTCUT * h,
                                      TRIAL_REJECT * h};
    double length = sqrt(s1 * s1 + s2 * s2), scale = length > a->bound ? a->bound / length : 1;
    vec3 q = vec3_axpy(scale * s1, a->axis1, vec3_axpy(scale * s2, a->axis2, a->x)), n;
    for (int axis = 0; axis < 3; axis++)
        if (a->boundary_axes >> axis & 1) vec3_set(&q, axis, vec3_get(a->x, axis));
    *beside = q;
    if (!projection_find_near(a->field, &limits, a->hint, &q, &n)) return false;
    if (a->bounded && !field_is_within_near(a->field, q, a->hint)) return false;
    /* projection included, the particle must neither pass its nearest neighbour nor leave the validity of
     * the lists */
    if (vec3_norm(vec3_sub(q, a->x)) > a->limit) return false;
    *x = q;
    *normal = n;
    return true;
}

/* One trial: whether the energy decreases. On facets it must decrease in the tangent plane. After the early
 * sweeps of a level it must also decrease on the facet; otherwise particles would cycle across edges of
 * facets. Without fast steps this second test applies to divergent neighbour normals only. */
static bool try_step(const step_input *a, double s1, double s2, vec3 *x, vec3 *normal)
{
    vec3 beside, q, n;
    if (!step_and_project(a, a->params->omega * s1, a->params->omega * s2, &beside, &q, &n)) return false;
    if (!a->flat) pair_weigh(a->near, n);
    const double limit = a->energy * (1 - a->params->gain);
    const bool in_plane_only = a->faceted && (a->params->shaken || (a->flat && !a->has_fast));
    if (a->faceted && !(pair_energy_at(a->near, a->potential, beside, a->sigma) < limit)) return false;
    if (!in_plane_only && !(pair_energy_at(a->near, a->potential, q, a->sigma) < limit)) return false;
    *x = q;
    *normal = n;
    return true;
}

/* Projects a particle to EXACT_ACCEPT. If a step does not reach its expected decrease of energy, the error of
 * the last projection misleads it; the particle would never converge. */
static void project_exactly(const step_input *a, vec3 *x, vec3 *normal)
{
    double h = projection_scale(a->field, a->spacing);
    const projection_limits limits = {TRIAL_STEPS, EXACT_ACCEPT * h, 0, TRIAL_REJECT * h};
    projection_find_near(a->field, &limits, a->hint, x, normal);
}

/* Steps 1 to 4 of section 5. */
static void descend_damped(const sweep_job *job, const step_input *a, const pair_forces *f, size_t i,
                           double allowed_step, block_sums *sums)
{
    const relax_params *params = a->params;
    particles *p = job->p;
    double lambda = p->lambda[i] >= (float)RELAX_LAMBDA_CAP ? 0 : (double)p->lambda[i];
    for (bool first = true;; first = false) {
        double s1, s2, expected = relax_damped_step(f, elementary_exp(M_LN10 * lambda), &s1, &s2);
        if (!(expected > params->gain * f->energy) || lambda > RELAX_LAMBDA_CAP) {
            p->lambda[i] = (float)RELAX_LAMBDA_CAP;
            if (!first) project_exactly(a, &p->position[i], &p->normal[i]);
            return;
        }
        if (a->bound < RELAX_STEP_FLOOR * a->spacing && allowed_step < sqrt(f->nearest2)) {
            relax_count_limited(job, i, sums);
            return;
        }
        vec3 x, normal;
        if (try_step(a, s1, s2, &x, &normal)) {
            if (lambda >= MISLED_LAMBDA && a->flat && !p->near_boundary[i]) project_exactly(a, &x, &normal);
            relax_take_step(job, i, x, normal, vec3_norm(vec3_sub(x, a->x)), allowed_step, sums);
            p->lambda[i] = (float)(first ? fmax(lambda - 1, RELAX_LAMBDA_FLOOR) : lambda);
            return;
        }
        sums->rejected++;
        lambda += 1;
    }
}

/* (5), as used for Table 1. */
static void descend_gradient(const sweep_job *job, const step_input *a, const pair_forces *f, size_t i,
                             double allowed_step, block_sums *sums)
{
    double scale = -a->params->step * a->sigma * a->sigma;
    vec3 beside, x, normal;
    if (step_and_project(a, scale * f->d1, scale * f->d2, &beside, &x, &normal))
        relax_take_step(job, i, x, normal, vec3_norm(vec3_sub(x, a->x)), allowed_step, sums);
    else
        sums->rejected++;
}

void relax_update_particle(const sweep_job *job, int worker, size_t i, block_sums *sums)
{
    particles *p = job->p;
    const relax_params *params = job->params;
    uint32_t none = FIELD_NO_HINT;
    step_input a = {.params = params,
                    .hint = p->patch ? &p->hint[i] : &none,
                    .field = particles_field(p, params->field, i),
                    .bounded = p->patch && p->near_boundary[i],
                    .potential = job->r->energy,
                    .near = relax_gather_list(job->r, p, worker, i),
                    .flat = job->r->flat[i] || job->r->ignores_normals,
                    .faceted = p->patch != NULL,
                    .has_fast = job->r->fast != NULL,
                    .x = p->position[i],
                    .normal = p->normal[i],
                    .sigma = params->sigma * particles_size(p, i),
                    .spacing = params->spacing * particles_size(p, i),
                    .boundary_axes = projection_boundary_axes(params->field, p->position[i])};
    pair_forces f;
    vec3_frame(p->normal[i], &a.axis1, &a.axis2);
    pair_forces_at(a.near, a.potential, a.x, a.axis1, a.axis2, a.sigma, &f);
    if (!a.flat) add_turning(&a, &f);
    relax_add_energy(job, i, a.energy = f.energy, sums);
    /* the neighbour penalty of section 5 as a bound, and the validity of the lists */
    double allowed_step = relax_allowed_step(job->r, p, i);
    a.limit = fmin(sqrt(f.nearest2), allowed_step);
    a.bound = FAST_KERNEL_BOUND_SHARE * a.limit;
    if (params->minimiser == RELAX_GRADIENT)
        descend_gradient(job, &a, &f, i, allowed_step, sums);
    else
        descend_damped(job, &a, &f, i, allowed_step, sums);
    relax_copy_normal(job->r, p, i); /* project_exactly may have changed it */
    sums->lambda += (double)p->lambda[i];
}
