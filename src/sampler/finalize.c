/* finish: the end of a sampler's run, see sampler_finalize. */
#include <stdlib.h>

#include "base/memory.h"
#include "sampler/random_streams.h"
#include "sampler/sampler_internal.h"
#include "surface/project.h"

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
    if (s->params.sizing) {
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

/* Until energies are known their place holds residuals: over h, inf for what is not on the surface. */
static void finalize_particle(sampler *s, size_t i)
{
    vec3 x = s->p->position[i], normal = s->p->normal[i];
    field_sample sample;
    s->p->energy[i] = INFINITY;
    double h = s->spacing * s->p->size[i], kappa1, kappa2;
    field_order order = s->params.graded ? FIELD_HESSIAN : FIELD_GRADIENT;
    if (!settle_on_surface(s, h, SETTLE_FARTHEST * h, &x, &normal) ||
        !field_sample_at(s->field, x, order, &sample))
        return;
    double length = vec3_norm(sample.gradient), residual = fabs(sample.value) / length / h;
    if (!(residual < WORST_RESIDUAL)) return;
    s->p->energy[i] = residual;
    s->p->position[i] = x;
    s->p->normal[i] = vec3_scale(sample.gradient, 1 / length);
    if (s->params.graded) s->p->alpha[i] = sampler_amplitude(s, field_curvature(&sample, &kappa1, &kappa2));
}

static void finalize_chunk(void *context, int worker, size_t begin, size_t end)
{
    (void)worker;
    for (size_t i = begin; i < end; i++) finalize_particle(context, i);
}

/* Takes away the particles that are not on the surface and puts each on a new place there: of several drawn
 * the one that is farthest from its nearest particle. */
static void replace_lost(sampler *s)
{
    rng r = rng_seed(s->params.seed, RANDOM_STREAM_REPLACEMENT);
    for (size_t i = 0; i < s->p->count && !threads_stopped(s->pool); i++) {
        if (s->p->energy[i] != INFINITY) continue;
        double best = -1;
        vec3 x = s->p->position[i], normal = s->p->normal[i];
        for (int draw = 0; draw < REPLACEMENT_DRAWS; draw++) {
            vec3 q = sizing_field_draw(s->params.sizing, s->scan, rng_uniform(&r), &r), n = {0, 0, 1};
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
        s->replaced[i] = true;
        finalize_particle(s, i);
    }
}

static void count_lost(sampler *s)
{
    for (size_t i = 0; i < s->p->count; i++) {
        if (s->p->energy[i] == INFINITY)
            s->out.lost++;
        else
            s->out.max_residual = fmax(s->out.max_residual, s->p->energy[i]);
    }
}

static void curvature_chunk(void *context, int worker, size_t begin, size_t end)
{
    sampler *s = context;
    size_t n = s->p->count;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        field_sample sample;
        if (!field_sample_at(s->field, s->p->position[i], FIELD_HESSIAN, &sample)) continue;
        s->column[i] = field_curvature(&sample, &s->column[n + i], &s->column[2 * n + i]);
    }
}

/* Energies need the lists, which are given up before there is anything else: together they would be the most
 * memory that a job takes. */
static bool describe_energies(sampler *s, error *e)
{
    if (!relax_refresh(s->relax, s->p, s->sigma) && !relax_build(s->relax, s->p, s->sigma, 0, e))
        return false;
    s->out.mean_energy = relax_mean_energy(s->relax, s->p, s->sigma);
    s->out.mean_neighbours = relax_mean_neighbours(s->relax, s->p, s->sigma);
    relax_free(s->relax);
    s->relax = NULL;
    return true;
}

static bool describe_points(sampler *s, error *e)
{
    size_t n = s->p->count;
    s->column = mem_array(4 * n, sizeof *s->column, "the result", e);
    if (!s->column) return false;
    threads_run(s->pool, n, 256, curvature_chunk, s);
    requested_spacing(s, s->column + 3 * n);
    s->out.count = n;
    s->out.position = s->p->position;
    s->out.normal = s->p->normal;
    s->out.replaced = s->replaced;
    s->out.kappa = s->column;
    s->out.kappa1 = s->column + n;
    s->out.kappa2 = s->column + 2 * n;
    s->out.alpha = s->p->alpha;
    s->out.energy = s->p->energy;
    s->out.spacing = s->column + 3 * n;
    s->out.sigma = s->sigma;
    s->out.ideal_energy = s->params.energy->ideal;
    return true;
}

bool sampler_finalize(sampler *s, error *e)
{
    while (s->level < s->levels - 1) /* stopped early: the count is exact all the same */
        if (!sampler_refine(s, e)) return false;
    s->replaced = mem_array(s->p->count, sizeof *s->replaced, "the result", e);
    if (!s->replaced) return false;
    threads_run(s->pool, s->p->count, 256, finalize_chunk, s);
    replace_lost(s);
    count_lost(s);
    sampler_resize(s);
    if (!describe_energies(s, e) || !describe_points(s, e) || !s->method->describe(s, e)) return false;
    if (s->outcome == SAMPLER_CONVERGED && (s->out.lost > 0 || !sampler_is_on_target(s, s->out.mean_energy)))
        s->outcome = SAMPLER_STALLED; /* what was put back or replaced is not at rest */
    return true;
}

const sampler_points *sampler_result_points(const sampler *s)
{
    return &s->out;
}
