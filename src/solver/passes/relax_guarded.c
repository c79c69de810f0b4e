/* relax_guarded: guarded steps sixteen at a time, in single precision. See relax.h, and fast_kernel.h for the parts. */
#include <math.h>
#include <string.h>

#include "field/projection.h"
#include "solver/passes/relax_internal.h"

/* Trials in a sweep: a particle that has found no better place by then begins with more damping in the next. */
enum { TRIALS = 2 };
/* Newton steps that bring a trial onto the surface. */
enum { LANDINGS = 3 };
/* Single precision does not tell less of an energy apart. Then the step that is left is some 3e-4 of the spacing. */
static const double LEAST_GAIN = 1e-6;

/* 10^lambda, which goes by ones from RELAX_LAMBDA_FLOOR on. */
static float damping_of(double lambda)
{
    static const float power[] = {1e-3f, 1e-2f, 1e-1f, 1e0f,  1e1f,  1e2f,  1e3f,  1e4f,  1e5f,  1e6f,
                                  1e7f,  1e8f,  1e9f,  1e10f, 1e11f, 1e12f, 1e13f, 1e14f, 1e15f, 1e16f};
    const double at = lambda - RELAX_LAMBDA_FLOOR;
    const int whole = at >= 0 && at < (double)(sizeof power / sizeof *power) ? (int)at : -1;
    return whole >= 0 && (double)whole == at ? power[whole] : (float)pow(10, lambda);
}

/* Particles on their way. */
typedef struct trial {
    fast_kernel_particles own;
    fast_kernel_forces forces;
    fast_kernel_params params;
    fast_kernel_way way;
    bool open[FAST_KERNEL_LANES]; /* who has not found a place yet */
    double lambda[FAST_KERNEL_LANES];
} trial;

static bool any_open(const trial *t)
{
    bool any = false;
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) any |= t->open[l];
    return any;
}

static fast_kernel_params params_of(const sweep_job *job)
{
    const relax_params *p = job->params;
    return (fast_kernel_params){.unit = job->r->near->unit,
                                .support = p->sigma,
                                .omega = p->omega,
                                .longest = INFINITY,
                                .farthest = RELAX_TRIAL_SHORTCUT * projection_scale(p->field, p->spacing),
                                .normal = job->r->ignores_normals ? NULL : job->r->normal};
}

/* A Newton step of the lanes that are `left`, towards the surface. Those that are there end well; left are those that may get there.
 * False: none. */
static bool land_once(const sweep_job *job, const trial *t, bool left[FAST_KERNEL_LANES],
                      fast_kernel_way *way)
{
    bool any = false;
    memcpy(way->ends_well, left, sizeof way->ends_well);
    field_sample_lanes(job->params->field, &way->to, way->ends_well, way->value, &way->gradient);
    memcpy(left, way->ends_well, sizeof way->ends_well); /* the others are where the field is not */
    job->r->fast->land(&t->own, &t->params, way);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        left[l] = left[l] && !way->ends_well[l];
        any |= left[l];
    }
    return any;
}

/* Brings the open lanes onto the surface. Who is not there in the end does not end well. */
static void land(const sweep_job *job, trial *t)
{
    fast_kernel_way *way = &t->way;
    bool left[FAST_KERNEL_LANES];
    memcpy(left, t->open, sizeof left);
    bool again = land_once(job, t, left, way);
    for (int k = 1; k < LANDINGS && again; k++) {
        fast_kernel_way next = *way; /* where those stay that have landed */
        bool moved[FAST_KERNEL_LANES];
        memcpy(moved, left, sizeof moved);
        again = land_once(job, t, left, &next);
        for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
            if (!moved[l]) continue;
            vec3_lanes_put(&way->to, (int)l, vec3_lanes_get(&next.to, (int)l));
            vec3_lanes_put(&way->gradient, (int)l, vec3_lanes_get(&next.gradient, (int)l));
            way->length[l] = next.length[l];
            way->ends_well[l] = next.ends_well[l];
        }
    }
}

/* Lane l of t, where it has landed, as lane k. */
static void move_lane(const sweep_job *job, const trial *t, size_t l, size_t k, fast_kernel_particles *out)
{
    const neighbours_place place =
        neighbours_place_of(job->r->near, vec3_lanes_get(&t->way.to, (int)l), t->own.size[l]);
    out->list[k] = t->own.list[l];
    out->count[k] = t->own.count[l];
    out->x[k] = place.x;
    out->y[k] = place.y;
    out->z[k] = place.z;
    out->size[k] = place.size;
    vec3_lanes_put(&out->normal, (int)k, vec3_lanes_get(&t->way.gradient, (int)l));
}

/* The energies where the open lanes have landed, which are few the second time: they move up. */
static void look(const sweep_job *job, const trial *t, float energy[FAST_KERNEL_LANES])
{
    fast_kernel_particles there = t->own;
    size_t lane[FAST_KERNEL_LANES], count = 0;
    float found[FAST_KERNEL_LANES];
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->open[l] || !t->way.ends_well[l]) continue;
        move_lane(job, t, l, count, &there);
        lane[count++] = l;
    }
    if (count == 0) return;
    for (size_t k = count; k < FAST_KERNEL_LANES; k++) there.count[k] = 0;
    job->r->fast->energy(job->r->near->place, &there, &t->params, count, found);
    for (size_t k = 0; k < count; k++) energy[lane[k]] = found[k];
}

/* The lanes that have something to gain and may move; the others are done with. */
static void begin_trial(const sweep_job *job, const uint32_t *items, double gain, trial *t, block_sums *sums)
{
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++)
        t->own.damping[l] = t->open[l] ? damping_of(t->lambda[l]) : 0;
    job->r->fast->step(&t->own, &t->forces, &t->params, &t->way);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->open[l]) continue;
        const double allowed = (double)t->own.allowed_step[l], size = (double)t->own.size[l];
        const double nearest = sqrt((double)t->forces.nearest2[l]) * t->params.unit;
        if (!(t->way.gain[l] > gain * (double)t->forces.energy[l]) || t->lambda[l] > RELAX_LAMBDA_CAP) {
            job->p->lambda[items[l]] = (float)RELAX_LAMBDA_CAP;
            t->open[l] = false;
        } else if (allowed < nearest &&
                   FAST_KERNEL_BOUND_SHARE * allowed < RELAX_STEP_FLOOR * job->params->spacing * size) {
            relax_count_limited(job, items[l], sums);
            t->open[l] = false;
        }
    }
}

static void end_trial(const sweep_job *job, const uint32_t *items, double gain, bool first, trial *t,
                      block_sums *sums)
{
    float energy[FAST_KERNEL_LANES]; /* of lanes that have landed */
    land(job, t);
    look(job, t, energy);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->open[l]) continue;
        if (!t->way.ends_well[l] || !((double)energy[l] < (double)t->forces.energy[l] * (1 - gain))) {
            sums->rejected++;
            t->lambda[l] += 1;
            continue;
        }
        t->open[l] = false;
        if (first) t->lambda[l] = fmax(t->lambda[l] - 1, RELAX_LAMBDA_FLOOR);
        job->p->lambda[items[l]] = (float)t->lambda[l];
        relax_take_step(job, items[l], vec3_lanes_get(&t->way.to, (int)l),
                        vec3_lanes_get(&t->way.gradient, (int)l), t->way.length[l],
                        (double)t->own.allowed_step[l], sums);
    }
}

/* What the turning of the particles' own normals adds to their forces, ignores_normals the weights: along an axis of the frame the
 * normal turns by the shape operator times it. */
static void add_turning(const sweep_job *job, trial *t)
{
    fast_kernel_forces *f = &t->forces;
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) {
        if (!t->open[l]) continue;
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
    const double gain = fmax(job->params->gain, LEAST_GAIN);
    bool guarded[FAST_KERNEL_LANES];
    trial t;
    t.params = params_of(job);
    relax_fill_lanes(job->r, job->p, items, count, &t.own);
    job->r->fast->forces(job->r->near->place, &t.own, &t.params, &t.forces);
    for (size_t l = 0; l < FAST_KERNEL_LANES; l++) guarded[l] = l < divergent;
    if (divergent < count) relax_fast_steps(job, items, divergent, count, &t.own, &t.forces, guarded, sums);
    memcpy(t.open, guarded, sizeof t.open);
    if (t.params.normal) add_turning(job, &t);
    for (size_t l = 0; l < count; l++) {
        const double lambda = (double)job->p->lambda[items[l]];
        t.lambda[l] = lambda >= RELAX_LAMBDA_CAP ? 0 : lambda;
    }
    for (int k = 0; k < TRIALS && any_open(&t); k++) {
        begin_trial(job, items, gain, &t, sums);
        if (any_open(&t)) end_trial(job, items, gain, k == 0, &t, sums);
    }
    for (size_t l = 0; l < count; l++) {
        if (!guarded[l]) continue;
        if (t.open[l]) job->p->lambda[items[l]] = (float)t.lambda[l];
        relax_note_energy(job, items[l], (double)t.forces.energy[l], sums);
        sums->lambda += (double)job->p->lambda[items[l]];
    }
}
