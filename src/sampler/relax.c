#include "sampler/relax.h"

#include <stdlib.h>

#include "base/memory.h"
#include "sampler/neighbours.h"
#include "sampler/pair.h"
#include "sampler/project.h"

static const double LAMBDA_FLOOR = -3; /* log10; below it the damping is nothing */
/* Pairs count in full while their normals agree to within a right angle, and not at all when they
 * differ by more than 114 degrees: the other side of a thin sheet. */
static const double FACING_RANGE = 0.4;
/* A trial ends on the surface to within this fraction of h, or is refused. */
static const double TRIAL_REJECT = 0.01;
/* A Newton step from this fraction of h leaves an error of about its square times kappa h. */
static const double TRIAL_SHORTCUT = 0.02;
static const double TRIAL_ACCEPT = 1e-4;
static const int TRIAL_STEPS = 3;
static const double STRAIGHT_ACCEPT = 1e-7;
/* Keeps the 2x2 system solvable when all neighbours lie on one line. */
static const double HESSIAN_FLOOR = 1e-9;
/* A particle whose lists allow less than this fraction of h waits for new ones. */
static const double STEP_FLOOR = 1e-3;

typedef struct gather {
    double *memory;
    pair_list list;
} gather;

struct relax {
    threads *pool;
    neighbours *near;
    double *weight; /* of each list entry */
    size_t weight_entries;
    double sigma, skin; /* of the lists */
    gather *scratch;    /* one per worker */
    size_t scratch_entries;
};

relax *relax_new(size_t capacity, threads *pool, error *e)
{
    relax *r = mem_alloc(sizeof *r);
    r->pool = pool;
    r->scratch = mem_alloc((size_t)threads_count(pool) * sizeof *r->scratch);
    if (!(r->near = neighbours_new(capacity, e))) {
        relax_free(r);
        return NULL;
    }
    return r;
}

static void free_scratch(relax *r)
{
    for (int k = 0; k < threads_count(r->pool); k++) free(r->scratch[k].memory);
}

void relax_free(relax *r)
{
    if (!r) return;
    free_scratch(r);
    free(r->scratch);
    free(r->weight);
    neighbours_free(r->near);
    free(r);
}

/* Room for the weights and for a gathered list, as long as the longest the lists may hold. */
static bool grow(relax *r, error *e)
{
    size_t entries = r->near->capacity * r->near->stride;
    if (entries > r->weight_entries) {
        double *weight = mem_array(entries, sizeof *weight, "pair weights", e);
        if (!weight) return false;
        free(r->weight);
        r->weight = weight;
        r->weight_entries = entries;
    }
    size_t length = (r->near->stride + PAIR_LANES - 1) / PAIR_LANES * PAIR_LANES;
    if (length <= r->scratch_entries) return true;
    for (int k = 0; k < threads_count(r->pool); k++) {
        double *memory = mem_array(4 * length, sizeof *memory, "a gathered list", e);
        if (!memory) return false;
        free(r->scratch[k].memory);
        r->scratch[k].memory = memory;
        r->scratch[k].list = (pair_list){0, memory, memory + length, memory + 2 * length,
                                         memory + 3 * length};
    }
    r->scratch_entries = length;
    return true;
}

typedef struct sweep_job {
    relax *r;
    particles *p;
    const relax_params *params;
    const uint32_t *bins;
    double sigma;
    double *energy;
} sweep_job;

static double facing_weight(vec3 a, vec3 b)
{
    double w = (vec3_dot(a, b) + FACING_RANGE) / FACING_RANGE;
    return w < 0 ? 0 : w > 1 ? 1 : w;
}

/* Drops the pairs without weight and notes the weights of the rest. */
static void weigh_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const particles *p = job->p;
    neighbours *near = job->r->near;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        uint32_t *list = near->list + i * near->stride, kept = 0;
        double *weight = job->r->weight + i * near->stride;
        for (uint32_t k = 0; k < near->list_count[i]; k++) {
            uint32_t j = list[k];
            double w = facing_weight(p->normal[i], p->normal[j]);
            if (w == 0) continue;
            list[kept] = j;
            weight[kept++] = w * 0.5 * (p->alpha[i] + p->alpha[j]);
        }
        near->list_count[i] = kept;
        p->anchor[i] = p->position[i];
    }
}

bool relax_build(relax *r, particles *p, double sigma, double skin, error *e)
{
    if (!neighbours_build(r->near, p->count, p->position, sigma + skin, r->pool, e) || !grow(r, e))
        return false;
    r->sigma = sigma;
    r->skin = skin;
    sweep_job job = {.r = r, .p = p};
    threads_run(r->pool, p->count, 512, weigh_chunk, &job);
    return true;
}

static const pair_list *gather_list(const relax *r, const particles *p, int worker, size_t i)
{
    pair_list *g = &r->scratch[worker].list;
    const uint32_t *list = neighbours_list(r->near, i);
    const double *weight = r->weight + i * r->near->stride;
    size_t count = r->near->list_count[i], padded = (count + PAIR_LANES - 1) / PAIR_LANES * PAIR_LANES;
    for (size_t k = 0; k < count; k++) {
        vec3 x = p->position[list[k]];
        g->x[k] = x.x;
        g->y[k] = x.y;
        g->z[k] = x.z;
        g->weight[k] = weight[k];
    }
    for (size_t k = count; k < padded; k++) {
        g->x[k] = p->position[i].x + r->sigma;
        g->y[k] = p->position[i].y;
        g->z[k] = p->position[i].z;
        g->weight[k] = 0;
    }
    g->blocks = padded / PAIR_LANES;
    return g;
}

/* (11)(12) in the tangent frame: the step along the two axes, and the decrease of energy that the
 * quadratic model expects of it. */
static double damped_step(const pair_forces *f, double lambda, double *s1, double *s2)
{
    double floor = HESSIAN_FLOOR * (f->h11 + f->h22);
    double a = f->h11 * (1 + lambda) + floor, c = f->h22 * (1 + lambda) + floor, b = f->h12;
    double determinant = a * c - b * b;
    if (!(determinant > 0)) {
        *s1 = *s2 = 0;
        return 0;
    }
    *s1 = (b * f->d2 - c * f->d1) / determinant;
    *s2 = (b * f->d1 - a * f->d2) / determinant;
    return -0.5 * (*s1 * f->d1 + *s2 * f->d2);
}

typedef struct attempt {
    const relax_params *params;
    const pair_list *list;
    vec3 x, axis1, axis2;
    double bound; /* longest step */
    double energy;
} attempt;

/* Moves along the tangent plane (8), back onto the surface (9), and looks at the energy there. */
static bool try_step(const attempt *a, double s1, double s2, vec3 *x, vec3 *normal, double *energy)
{
    double h = a->params->spacing;
    const project_limits limits = {TRIAL_STEPS, TRIAL_ACCEPT * h, TRIAL_SHORTCUT * h, TRIAL_REJECT * h};
    double length = sqrt(s1 * s1 + s2 * s2), scale = a->params->omega;
    if (length * scale > a->bound) scale = a->bound / length;
    vec3 q = vec3_axpy(scale * s1, a->axis1, vec3_axpy(scale * s2, a->axis2, a->x)), n;
    if (!project_point(a->params->field, &limits, &q, &n)) return false;
    /* a projection that is longer than the step was pulled to another sheet */
    if (vec3_norm2(vec3_sub(q, a->x)) > 2 * a->bound * a->bound) return false;
    double trial = pair_energy_at(a->list, q, a->params->sigma);
    if (!(trial < a->energy * (1 - a->params->gain))) return false;
    *x = q;
    *normal = n;
    *energy = trial;
    return true;
}

/* A particle whose expected gain never comes is misled by a normal that is off by the last Newton step:
 * put it on the surface to well below what `gain` can see. */
static void straighten(const relax_params *params, vec3 *x, vec3 *normal)
{
    double h = params->spacing;
    const project_limits limits = {TRIAL_STEPS, STRAIGHT_ACCEPT * h, 0, TRIAL_REJECT * h};
    project_point(params->field, &limits, x, normal);
}

static void update_particle(const sweep_job *job, int worker, size_t i)
{
    particles *p = job->p;
    const relax_params *params = job->params;
    attempt a = {.params = params, .list = gather_list(job->r, p, worker, i), .x = p->position[i]};
    pair_forces f;
    vec3_frame(p->normal[i], &a.axis1, &a.axis2);
    pair_forces_at(a.list, a.x, a.axis1, a.axis2, params->sigma, &f);
    p->energy[i] = a.energy = f.energy;
    p->step[i] = 0;
    p->cramped[i] = false;
    p->rejected[i] = 0;
    /* the neighbour penalty of section 5, as a bound; and the lists' validity */
    double room = 0.5 * job->r->skin - vec3_norm(vec3_sub(a.x, p->anchor[i]));
    double nearest = sqrt(f.nearest2);
    a.bound = fmin(nearest, 0.9 * room);
    double lambda = p->lambda[i] >= RELAX_LAMBDA_CAP ? 0 : p->lambda[i];
    for (bool first = true;; first = false) {
        double s1, s2, expected = damped_step(&f, pow(10, lambda), &s1, &s2);
        if (!(expected > params->gain * f.energy) || lambda > RELAX_LAMBDA_CAP) {
            p->lambda[i] = RELAX_LAMBDA_CAP;
            if (!first) straighten(params, &p->position[i], &p->normal[i]);
            return;
        }
        if (a.bound < STEP_FLOOR * params->spacing && room < nearest) {
            p->cramped[i] = true;
            return;
        }
        vec3 x, normal;
        if (try_step(&a, s1, s2, &x, &normal, &p->energy[i])) {
            double step = p->step[i] = vec3_norm(vec3_sub(x, a.x));
            p->cramped[i] = step >= 0.8 * room;
            p->position[i] = x;
            p->normal[i] = normal;
            p->lambda[i] = first ? fmax(lambda - 1, LAMBDA_FLOOR) : lambda;
            return;
        }
        p->rejected[i]++;
        lambda += 1;
    }
}

static void sweep_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    const neighbours *near = job->r->near;
    for (size_t b = begin; b < end; b++)
        for (uint32_t k = near->bin_begin[job->bins[b]]; k < near->bin_begin[job->bins[b] + 1]; k++)
            update_particle(job, worker, near->bin_item[k]);
}

void relax_sweep(relax *r, particles *p, const relax_params *params, relax_sums *out)
{
    sweep_job job = {.r = r, .p = p, .params = params};
    const uint32_t *colour = r->near->colour_begin;
    for (int c = 0; c < NEIGHBOURS_COLOURS; c++) {
        job.bins = r->near->colour_bin + colour[c];
        threads_run(r->pool, colour[c + 1] - colour[c], 16, sweep_chunk, &job);
    }
    relax_sums sums = {0};
    double squares = 0;
    for (size_t i = 0; i < p->count; i++) {
        double step = p->step[i] / params->spacing;
        sums.cramped |= p->cramped[i];
        sums.energy += p->energy[i];
        sums.mean_log10_lambda += p->lambda[i];
        sums.rejected += p->rejected[i];
        squares += step * step;
        sums.max_step = fmax(sums.max_step, step);
    }
    double count = (double)p->count;
    sums.energy /= count;
    sums.mean_log10_lambda /= count;
    sums.rms_step = sqrt(squares / count);
    *out = sums;
}

static void energy_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sweep_job *job = context;
    for (size_t i = begin; i < end; i++)
        job->energy[i] = pair_energy_at(gather_list(job->r, job->p, worker, i), job->p->position[i],
                                        job->sigma);
}

double relax_mean_energy(relax *r, const particles *p, double sigma, double *energy)
{
    /* without a place of their own the values go where the next sweep writes them anyway */
    sweep_job job = {.r = r, .p = (particles *)p, .sigma = sigma, .energy = energy ? energy : p->energy};
    threads_run(r->pool, p->count, 512, energy_chunk, &job);
    double sum = 0, alpha = 0;
    for (size_t i = 0; i < p->count; i++) {
        sum += job.energy[i];
        alpha += p->alpha[i];
    }
    return sum / alpha;
}

double relax_max_support(const relax *r)
{
    return r->sigma + 0.5 * r->skin;
}

double relax_mean_neighbours(const relax *r, const particles *p, double sigma)
{
    size_t pairs = 0;
    for (size_t i = 0; i < p->count; i++)
        for (uint32_t k = 0; k < r->near->list_count[i]; k++)
            if (vec3_norm2(vec3_sub(p->position[i], p->position[neighbours_list(r->near, i)[k]])) <
                sigma * sigma)
                pairs++;
    return (double)pairs / (double)p->count;
}
