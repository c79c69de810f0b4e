#include "surface/scaled_curvature.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geometry/block_map.h"
#include "geometry/sym3.h"

/* Edge of a cube, over the scale, and at least this many of the surface's cells, so that no cube is passed over. */
static const double EDGE_SCALE = 0.75, EDGE_CELLS = 1.25;
/* Weights end at this many scales: exp(-4). */
static const double REACH = 2;
/* Normals whose cosine is below the first do not count, above the second they count in full: as the pairs of the energy. */
static const double FACING_NONE = -0.8, FACING_WHOLE = -0.5;
/* A neighbourhood that is nearly a line says nothing across it: there the matrix is damped by this share. */
static const double DAMPING = 1e-3;
enum { GRAIN = 256 };

typedef struct element {
    double area;
    vec3 position,
        normal; /* sums over the area while elements are made, means afterwards; the normal is a unit vector */
    double kappa1, kappa2;
    int direction;
    uint32_t next; /* of the same cube, or BLOCK_MAP_NONE */
} element;

struct scaled_curvature {
    double scale, edge;
    vec3 origin;
    int reach;       /* cubes that weights reach to either side */
    block_map map;   /* of the cubes that the surface passes */
    uint32_t *first; /* the first element of each */
    element *element;
    uint32_t count;
};

/* The axis that a normal follows most: 0 to 2 along it, 3 to 5 against it. */
static int direction_of(vec3 n)
{
    int axis = fabs(n.x) >= fabs(n.y) && fabs(n.x) >= fabs(n.z) ? 0 : fabs(n.y) >= fabs(n.z) ? 1 : 2;
    return vec3_get(n, axis) >= 0 ? axis : axis + 3;
}

typedef struct cube {
    int32_t at[3];
} cube;

static cube cube_of(const scaled_curvature *c, vec3 x)
{
    vec3 u = vec3_scale(vec3_sub(x, c->origin), 1 / c->edge);
    return (cube){{(int32_t)floor(u.x), (int32_t)floor(u.y), (int32_t)floor(u.z)}};
}

/* The element of a cube and a direction, new if there is none. */
static element *element_of(scaled_curvature *c, vec3 position, vec3 normal, error *e)
{
    cube at = cube_of(c, position);
    uint32_t before = c->map.count, number;
    int direction = direction_of(normal);
    if (!block_map_find_or_add(&c->map, at.at[0], at.at[1], at.at[2], &number, e)) return NULL;
    if (number == before) c->first[number] = BLOCK_MAP_NONE;
    for (uint32_t k = c->first[number]; k != BLOCK_MAP_NONE; k = c->element[k].next)
        if (c->element[k].direction == direction) return &c->element[k];
    element *n = &c->element[c->count];
    n->direction = direction;
    n->next = c->first[number];
    c->first[number] = c->count++;
    return n;
}

/* Adds the samples to the elements, in the order of the cells. */
static bool make_elements(scaled_curvature *c, const surface *scan, const cell_samples *sample, error *e)
{
    const char *what = "the curvature at a scale";
    if (!block_map_init(&c->map, scan->cells / 2, e)) return false;
    c->element = mem_array(scan->cells, sizeof *c->element, what, e);
    c->first = mem_array(scan->cells, sizeof *c->first, what, e);
    if (!c->element || !c->first) return false;
    for (size_t k = 0; k < scan->cells; k++) {
        double area = surface_cell_area(scan, k);
        if (!sample->found[k] || !(area > 0)) continue;
        element *n = element_of(c, sample->position[k], sample->normal[k], e);
        if (!n) return false;
        n->area += area;
        n->position = vec3_axpy(area, sample->position[k], n->position);
        n->normal = vec3_axpy(area, sample->normal[k], n->normal);
    }
    for (uint32_t k = 0; k < c->count; k++) {
        element *n = &c->element[k];
        n->position = vec3_scale(n->position, 1 / n->area);
        n->normal = vec3_unit(n->normal);
    }
    return true;
}

static double facing_weight(vec3 a, vec3 b)
{
    return fmin(fmax((vec3_dot(a, b) - FACING_NONE) / (FACING_WHOLE - FACING_NONE), 0), 1);
}

/* Weighted sums over a neighbourhood. */
typedef struct sums {
    double weight, a, b, p, q, aa, ab, bb, pa, pb, qa, qb;
} sums;

/* What a visit to the elements around a place does with each; `squared` is the distance. */
typedef void visitor(void *context, const element *other, double squared);

static void visit_cube(const scaled_curvature *c, uint32_t number, vec3 x, double farthest, visitor *visit,
                       void *context)
{
    for (uint32_t k = c->first[number]; k != BLOCK_MAP_NONE; k = c->element[k].next) {
        double squared = vec3_norm2(vec3_sub(c->element[k].position, x));
        if (squared < farthest * farthest) visit(context, &c->element[k], squared);
    }
}

static void visit_around(const scaled_curvature *c, vec3 x, int reach, double farthest, visitor *visit,
                         void *context)
{
    cube at = cube_of(c, x);
    for (int k = -reach; k <= reach; k++)
        for (int j = -reach; j <= reach; j++)
            for (int i = -reach; i <= reach; i++) {
                uint32_t number = block_map_find(&c->map, at.at[0] + i, at.at[1] + j, at.at[2] + k);
                if (number != BLOCK_MAP_NONE) visit_cube(c, number, x, farthest, visit, context);
            }
}

typedef struct fit {
    const scaled_curvature *c;
    const element *middle;
    vec3 u, v;
    sums sums;
} fit;

static void add_to_fit(void *context, const element *other, double squared)
{
    fit *f = context;
    const element *m = f->middle;
    double w =
        other->area * facing_weight(m->normal, other->normal) * exp(-squared / (f->c->scale * f->c->scale));
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

/* The symmetric S of (p, q) = S (a, b), from sums without their means; its eigenvalues. */
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
        fit f = {.c = c, .middle = &c->element[k]};
        vec3_frame(f.middle->normal, &f.u, &f.v);
        visit_around(c, f.middle->position, c->reach, REACH * c->scale, add_to_fit, &f);
        solve_fit(&f.sums, &c->element[k].kappa1, &c->element[k].kappa2);
    }
}

scaled_curvature *scaled_curvature_new(const surface *scan, const cell_samples *sample, double scale,
                                       threads *pool, error *e)
{
    scaled_curvature *c = mem_alloc(sizeof *c);
    c->scale = fmax(scale, scan->field->cell_size);
    c->edge = fmax(EDGE_SCALE * c->scale, EDGE_CELLS * scan->field->cell_size);
    c->reach = (int)ceil(REACH * c->scale / c->edge);
    c->origin = scan->box.min;
    bool ok = make_elements(c, scan, sample, e);
    if (ok) threads_run(pool, c->count, GRAIN, fit_chunk, c);
    if (ok && threads_stopped(pool)) ok = error_set(e, ERROR_CANCELLED, "stopped");
    if (ok) return c;
    scaled_curvature_free(c);
    return NULL;
}

void scaled_curvature_free(scaled_curvature *c)
{
    if (!c) return;
    block_map_free(&c->map);
    free(c->element);
    free(c->first);
    free(c);
}

double scaled_curvature_scale(const scaled_curvature *c)
{
    return c->scale;
}

typedef struct blend {
    vec3 normal;
    double over; /* 1 / width^2 of the weights */
    double weight, kappa1, kappa2;
} blend;

static void add_to_blend(void *context, const element *other, double squared)
{
    blend *b = context;
    double w = other->area * facing_weight(b->normal, other->normal) * exp(-squared * b->over);
    b->weight += w;
    b->kappa1 += w * other->kappa1;
    b->kappa2 += w * other->kappa2;
}

double scaled_curvature_at(const scaled_curvature *c, vec3 x, vec3 normal, double *kappa1, double *kappa2)
{
    blend b = {.normal = normal, .over = 4 / (c->edge * c->edge)};
    visit_around(c, x, 1, 2 * c->edge, add_to_blend, &b);
    *kappa1 = b.weight > 0 ? b.kappa1 / b.weight : 0;
    *kappa2 = b.weight > 0 ? b.kappa2 / b.weight : 0;
    return sqrt(*kappa1 * *kappa1 + *kappa2 * *kappa2);
}
