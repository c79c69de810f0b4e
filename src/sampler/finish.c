/* finish: the end of a sampler's run, see sampler_finish. */
#include <stdlib.h>

#include "base/memory.h"
#include "sampler/project.h"
#include "sampler/state.h"

static const double ALPHA_EXPONENT = 0.18;
/* A finished particle is on the surface to this fraction of h, or it is replaced. */
static const double WORST_RESIDUAL = 1e-6;
static const int REPLACEMENT_DRAWS = 30;
static const int SETTLE_STEPS = 20;
static const double SETTLE_FARTHEST = 0.05;

/* What the grading asks for; or what (13) makes of an amplitude under a common support: the spacing goes as
 * alpha^0.18 (measured on the quartic: 0.181 with d = 1, 0.171 with d = 3; a mean-field estimate gives the
 * inverse of E_ideal's slope, 0.21). The scale keeps the sum of the ideal cells equal to the area. */
static void requested_spacing(sampler *s, double *spacing)
{
    double squares = 0;
    if (s->params.grading) {
        for (size_t i = 0; i < s->p->count; i++) spacing[i] = s->p->size[i] * s->spacing;
        return;
    }
    for (size_t i = 0; i < s->p->count; i++) {
        spacing[i] = s->params.graded ? pow(s->p->alpha[i], ALPHA_EXPONENT) : 1;
        squares += spacing[i] * spacing[i];
    }
    double scale = s->spacing / sqrt(squares / (double)s->p->count);
    for (size_t i = 0; i < s->p->count; i++) spacing[i] *= scale;
}

typedef struct finish_job {
    sampler *s;
    double *residual; /* over h; inf: not on the surface */
} finish_job;

/* To rounding: a Newton step from 1e-7 h leaves less than doubles resolve. A relaxed particle is within 0.01
 * h of the surface; one that would have to go much farther sits where Newton's method goes astray. */
static bool settle_on_surface(const sampler *s, double h, double farthest, vec3 *x, vec3 *normal)
{
    const project_limits limits = {SETTLE_STEPS, 1e-9 * h, 1e-7 * h, WORST_RESIDUAL * h};
    vec3 q = *x, n = *normal;
    if (project_point(s->field, &limits, &q, &n) && vec3_norm(vec3_sub(q, *x)) <= farthest) {
        *x = q;
        *normal = n;
        return true;
    }
    return project_bisect(s->field, *normal, farthest, x, normal);
}

static void finish_particle(const finish_job *job, size_t i)
{
    sampler *s = job->s;
    size_t n = s->p->count;
    vec3 x = s->p->position[i], normal = s->p->normal[i];
    field_sample sample;
    job->residual[i] = INFINITY;
    double h = s->spacing * s->p->size[i];
    if (!settle_on_surface(s, h, SETTLE_FARTHEST * h, &x, &normal) ||
        !field_sample_at(s->field, x, FIELD_HESSIAN, &sample))
        return;
    double length = vec3_norm(sample.gradient), residual = fabs(sample.value) / length / h;
    if (!(residual < WORST_RESIDUAL)) return;
    job->residual[i] = residual;
    s->p->position[i] = x;
    s->p->normal[i] = vec3_scale(sample.gradient, 1 / length);
    s->column[i] = field_curvature(&sample, &s->column[n + i], &s->column[2 * n + i]);
    if (s->params.graded) s->p->alpha[i] = sampler_amplitude(s, s->column[i]);
}

static void finish_chunk(void *context, int worker, size_t begin, size_t end)
{
    (void)worker;
    for (size_t i = begin; i < end; i++) finish_particle(context, i);
}

/* Takes away the particles that are not on the surface and puts each on a new place there: of several drawn
 * the one that is farthest from its nearest particle. */
static void replace_lost(finish_job *job)
{
    sampler *s = job->s;
    rng r = rng_seed(s->params.seed, 2);
    for (size_t i = 0; i < s->p->count && !threads_stopped(s->pool); i++) {
        if (job->residual[i] != INFINITY) continue;
        double best = -1;
        vec3 x = s->p->position[i], normal = s->p->normal[i];
        for (int draw = 0; draw < REPLACEMENT_DRAWS; draw++) {
            vec3 q = grading_draw(s->params.grading, s->scan, rng_uniform(&r), &r), n = {0, 0, 1};
            if (!settle_on_surface(s, s->spacing, s->field->cell_size, &q, &n)) continue;
            double nearest2 = INFINITY;
            for (size_t j = 0; j < s->p->count; j++)
                if (j != i) nearest2 = fmin(nearest2, vec3_norm2(vec3_sub(q, s->p->position[j])));
            if (nearest2 <= best) continue;
            best = nearest2;
            x = q;
            normal = n;
        }
        if (best < 0) continue;
        s->p->position[i] = x;
        s->p->normal[i] = normal;
        s->removed++;
        finish_particle(job, i);
    }
}

static void describe_result(sampler *s, const double *residual)
{
    size_t n = s->p->count;
    s->out = (sampler_points){
        .count = n,
        .position = s->p->position,
        .normal = s->p->normal,
        .kappa = s->column,
        .kappa1 = s->column + n,
        .kappa2 = s->column + 2 * n,
        .alpha = s->p->alpha,
        .energy = s->p->energy,
        .spacing = s->column + 3 * n,
        .sigma = s->sigma,
        .ideal_energy = s->params.energy->ideal,
    };
    for (size_t i = 0; i < n; i++) {
        if (residual[i] == INFINITY)
            s->out.lost++;
        else
            s->out.max_residual = fmax(s->out.max_residual, residual[i]);
    }
    s->out.mean_energy = relax_mean_energy(s->relax, s->p, s->sigma);
    s->out.mean_neighbours = relax_mean_neighbours(s->relax, s->p, s->sigma);
    requested_spacing(s, s->column + 3 * n);
}

bool sampler_finish(sampler *s, error *e)
{
    while (s->level < s->levels - 1) /* stopped early: the count is exact all the same */
        if (!sampler_refine(s, e)) return false;
    size_t n = s->p->count;
    finish_job job = {s, mem_array(n, sizeof *job.residual, "the result", e)};
    bool ok = false;
    if (!s->column) s->column = mem_array(4 * n, sizeof *s->column, "the result", e);
    if (!s->column || !job.residual) goto done;
    threads_run(s->pool, n, 256, finish_chunk, &job);
    replace_lost(&job);
    sampler_resize(s);
    if (!relax_build(s->relax, s->p, s->sigma, 0, e)) goto done;
    describe_result(s, job.residual);
    if (!s->method->describe(s, e)) goto done;
    if (s->outcome == SAMPLER_CONVERGED && (s->out.lost > 0 || !sampler_is_on_target(s, s->out.mean_energy)))
        s->outcome = SAMPLER_STALLED; /* what was put back or replaced is not at rest */
    ok = true;
done:
    free(job.residual);
    return ok;
}

const sampler_points *sampler_result_points(const sampler *s)
{
    return &s->out;
}
