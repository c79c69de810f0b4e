// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/scaled_curvature.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/sym3.h"
#include "sampling/packing/pair.h"
#include "sampling/sizing/elements.h"

/* Edge of a cube, in scales. */
static const double EDGE_SCALE = 0.75;
/* Weights are 0 beyond this number of scales: exp(-4). */
static const double REACH = 2;
/* Relative damping of the matrix: a neighbourhood that is nearly a line does not determine the curvature
 * across it. */
static const double DAMPING = 1e-3;

struct scaled_curvature {
    double scale;
    int reach; /* range of weights in cubes, to each side */
    elements elements;
    double *kappa1, *kappa2; /* per element */
};

/* Weighted sums over a neighbourhood. */
typedef struct sums {
    double weight, a, b, p, q, aa, ab, bb, pa, pb, qa, qb;
} sums;

/* Called for each element around a place; `squared` is the squared distance. */
typedef void visitor(void *context, uint32_t number, double squared);

/* Visits the elements of one patch, or of SCALED_CURVATURE_ALL. */
static void visit_around(const scaled_curvature *c, vec3 x, uint32_t patch, int reach, double farthest,
                         visitor *visit, void *context)
{
    const elements *s = &c->elements;
    const bool all = patch == SCALED_CURVATURE_ALL;
    const elements_cube at = elements_cube_of(s, x);
    for (int k = -reach; k <= reach; k++)
        for (int j = -reach; j <= reach; j++)
            for (int i = -reach; i <= reach; i++)
                for (uint32_t n = all ? elements_first(s, at, i, j, k)
                                      : elements_first_of(s, at, i, j, k, patch);
                     n != BLOCK_MAP_NONE; n = all ? s->element[n].next : s->element[n].next_of_patch) {
                    double squared = vec3_norm2(vec3_sub(s->element[n].position, x));
                    if (squared < farthest * farthest) visit(context, n, squared);
                }
}

typedef struct fit {
    const scaled_curvature *c;
    const element *middle;
    vec3 u, v;
    sums sums;
} fit;

static void add_to_fit(void *context, uint32_t number, double squared)
{
    fit *f = context;
    const element *m = f->middle, *other = &f->c->elements.element[number];
    double w = other->area * pair_facing(m->normal, other->normal) *
               elementary_exp(-squared / (f->c->scale * f->c->scale));
    vec3 x = vec3_sub(other->position, m->position), n = vec3_sub(other->normal, m->normal);
    double a = vec3_dot(x, f->u), b = vec3_dot(x, f->v), p = vec3_dot(n, f->u), q = vec3_dot(n, f->v);
    sums *s = &f->sums;
    s->weight += w;
    s->a += w * a;
    s->b += w * b;
    s->p += w * p;
    s->q += w * q;
    s->aa += w * a * a;
    s->ab += w * a * b;
    s->bb += w * b * b;
    s->pa += w * p * a;
    s->pb += w * p * b;
    s->qa += w * q * a;
    s->qb += w * q * b;
}

/* Solves (p, q) = S (a, b) for the symmetric S, after subtraction of the means; returns its eigenvalues. */
static void solve_fit(const sums *s, double *kappa1, double *kappa2)
{
    double over = 1 / s->weight;
    double aa = s->aa - s->a * s->a * over, ab = s->ab - s->a * s->b * over, bb = s->bb - s->b * s->b * over;
    double pa = s->pa - s->p * s->a * over, pb = s->pb - s->p * s->b * over;
    double qa = s->qa - s->q * s->a * over, qb = s->qb - s->q * s->b * over;
    double damping = DAMPING * (aa + bb);
    *kappa1 = *kappa2 = 0;
    if (!(damping > 0)) return;
    const sym3 m = {.xx = aa + damping, .yy = aa + bb + damping, .zz = bb + damping, .xy = ab, .yz = ab};
    vec3 r = sym3_solve(m, (vec3){pa, pb + qa, qb});
    sym2_eigenvalues(r.x, r.y, r.z, kappa1, kappa2);
}

static void fit_chunk(void *context, int worker, size_t begin, size_t end)
{
    scaled_curvature *c = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        fit f = {.c = c, .middle = &c->elements.element[k]};
        vec3_frame(f.middle->normal, &f.u, &f.v);
        visit_around(c, f.middle->position, f.middle->patch, c->reach, REACH * c->scale, add_to_fit, &f);
        solve_fit(&f.sums, &c->kappa1[k], &c->kappa2[k]);
    }
}

double scaled_curvature_least(const surface *scan)
{
    return scan->field->cell_size;
}

scaled_curvature *scaled_curvature_new(const surface *scan, const cell_samples *sample, double scale,
                                       threads *pool, error *e)
{
    const char *what = "the curvature at a scale";
    scaled_curvature *c = mem_alloc(sizeof *c);
    c->scale = fmax(scale, scaled_curvature_least(scan));
    double edge = fmax(EDGE_SCALE * c->scale, ELEMENTS_LEAST_EDGE * scan->field->cell_size);
    c->reach = (int)ceil(REACH * c->scale / edge);
    bool ok = elements_make(scan, sample, edge, &c->elements, e);
    if (ok) {
        c->kappa1 = mem_array(c->elements.count, sizeof *c->kappa1, what, e);
        c->kappa2 = mem_array(c->elements.count, sizeof *c->kappa2, what, e);
        ok = c->kappa1 && c->kappa2;
    }
    if (ok) threads_run(pool, c->elements.count, THREADS_GRAIN, fit_chunk, c);
    ok = ok && threads_may_go_on(pool, e);
    if (ok) return c;
    scaled_curvature_free(c);
    return NULL;
}

void scaled_curvature_free(scaled_curvature *c)
{
    if (!c) return;
    elements_free(&c->elements);
    free(c->kappa1);
    free(c->kappa2);
    free(c);
}

double scaled_curvature_scale(const scaled_curvature *c)
{
    return c->scale;
}

typedef struct blend {
    const scaled_curvature *c;
    vec3 normal;
    double over; /* 1 / width^2 of the weights */
    double weight, kappa1, kappa2;
} blend;

static void add_to_blend(void *context, uint32_t number, double squared)
{
    blend *b = context;
    const element *other = &b->c->elements.element[number];
    double w = other->area * pair_facing(b->normal, other->normal) * elementary_exp(-squared * b->over);
    b->weight += w;
    b->kappa1 += w * b->c->kappa1[number];
    b->kappa2 += w * b->c->kappa2[number];
}

double scaled_curvature_at(const scaled_curvature *c, vec3 x, vec3 normal, uint32_t patch, double *kappa1,
                           double *kappa2)
{
    double edge = c->elements.edge;
    blend b = {.c = c, .normal = normal, .over = 4 / (edge * edge)};
    visit_around(c, x, patch, 1, 2 * edge, add_to_blend, &b);
    *kappa1 = b.weight > 0 ? b.kappa1 / b.weight : 0;
    *kappa2 = b.weight > 0 ? b.kappa2 / b.weight : 0;
    return sqrt(*kappa1 * *kappa1 + *kappa2 * *kappa2);
}
