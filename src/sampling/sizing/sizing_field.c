// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/sizing_field.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/isa.h"
#include "base/core/memory.h"
#include "geometry/space/block_map.h"
#include "geometry/space/packing.h"
#include "sampling/sizing/spacing_request.h"

/* Edge of a cube of nodes: in cell sizes, so that every cube that the surface crosses contains samples; and
 * in mean spacings, below which the request is not resolved. */
static const double EDGE_CELLS = 1.25, EDGE_SPACING = 0.2;
/* Maximum of an unbounded spacing: this many mean spacings, or the surface's size. */
static const double WIDEST_EVEN = 10;
/* Relative tolerance of the count: first for the sum over nodes, then over cells. */
static const double NODES_TOLERANCE = 1e-6, CELLS_TOLERANCE = 1e-4;
static const int CELLS_STEPS = 4;
static const int SCALE_STEPS = 60;
/* Relative damping of the component of the gradient across the surface, which the nodes do not determine. */
static const double GRADIENT_DAMPING = 0.02;
/* Minimum fraction of a ratio after growth and smoothing; otherwise fine_share is reduced. */
static const double RATIO_LEFT = 0.8;
/* A node's linear model is limited to its neighbours, and to this relative change of the spacing. */
static const double MODEL_LIMIT = 0.5;
/* Maximum second derivative of the spacing, see smooth_chunk: the limit for a packing, for requests at
 * points; and the limit for few defects, for requests over a distance. */
static const double BEND_AT_POINTS = 0.08, BEND_OVER_DISTANCE = 0.02;
/* Difference of the mean over the neighbours and the node for a Laplacian of 1 per squared cube; and the
 * tolerance of smoothing. */
static const double AVERAGE_RISE = 1.0 / 3, SMOOTH_TOLERANCE = 1e-3;
static const int SMOOTH_PASSES = 400;

#define NO_NODE BLOCK_MAP_NONE
/* Cubes from the origin to either side: beyond, there is no node. */
static const double MOST_CUBES = INT32_MAX / 2;

typedef struct node {
    double area;
    vec3 position;  /* mean of the surface within the cube */
    double request; /* Spacing before the scale: mean of logarithms, at the mean position. */
    double cap;     /* minimum over the cube of the bounds by features, or INFINITY */
    double away;    /* distance of `position` from the nearest curve */
    double spacing; /* after scale, bounds and growth; without curves */
    vec3 gradient;  /* of the spacing */
} node;

/* Iterations for a request that depends on the spacing. */
enum { IMPLICIT_PASSES = 4 };

/* The cube of a node and those that touch it, by three coordinates from 0 to 2. */
enum { ROW = 3, AROUND = ROW * ROW * ROW };
typedef uint32_t node_links[AROUND]; /* NO_NODE: the surface does not pass there */

struct sizing_field {
    sizing_field_params params;
    vec3 origin;
    double edge;
    size_t count;
    node *node;
    block_map cubes;       /* with the numbers of their nodes */
    node_links *beside;    /* of each node */
    double *points_before; /* cells + 1 entries, cumulated like area_before */
    sizing_field_facts facts;
};

/* The spacing at a distance `away` from the nearest curve; `spacing` is that without curves. */
static double spacing_beside(const sizing_field_params *p, double away, double spacing)
{
    if (!p->curves) return spacing;
    return fmin(fmax(p->curve_share * spacing + p->gradation * away, p->min_spacing), spacing);
}

/* --- nodes --- */

typedef struct cube {
    int32_t at[3];
} cube;

/* The cube that contains a place, and the place's position in it, 0 .. 1. */
static cube cube_of(vec3 in_cubes, double t[3])
{
    cube out;
    for (int a = 0; a < 3; a++) {
        const double v = fmin(fmax(vec3_get(in_cubes, a), -MOST_CUBES), MOST_CUBES), low = floor(v);
        out.at[a] = (int32_t)low;
        t[a] = v - low;
    }
    return out;
}

static vec3 in_cubes(const sizing_field *g, vec3 x)
{
    return vec3_scale(vec3_sub(x, g->origin), 1 / g->edge);
}

static uint32_t node_at(const sizing_field *g, const int32_t from[3], int i, int j, int k)
{
    return block_map_find(&g->cubes, from[0] + i, from[1] + j, from[2] + k);
}

static bool make_nodes(sizing_field *g, const spacing_request *r, const double *spacing, error *e)
{
    const surface *scan = r->scan;
    const vec3 *position = r->samples.position;
    g->node = mem_array(scan->cells, sizeof *g->node, "the grading", e);
    if (!g->node || !block_map_init(&g->cubes, 0, e)) return false;
    for (size_t k = 0; k < scan->cells; k++) {
        double area = surface_cell_area(scan, k);
        if (isnan(spacing[k]) || !(area > 0)) continue;
        double t[3];
        const cube at = cube_of(in_cubes(g, position[k]), t);
        uint32_t number;
        if (!block_map_find_or_add(&g->cubes, at.at[0], at.at[1], at.at[2], &number, e)) return false;
        node *n = &g->node[number];
        if (number == g->count) {
            *n = (node){.cap = INFINITY};
            g->count++;
        }
        n->area += area;
        n->position = vec3_axpy(area, position[k], n->position);
        n->request += area * elementary_log(spacing[k]);
        if (r->feature) n->cap = fmin(n->cap, spacing_request_cap(&g->params, r->feature[k]));
    }
    for (size_t k = 0; k < g->count; k++) {
        node *n = &g->node[k];
        n->position = vec3_scale(n->position, 1 / n->area);
        n->request = elementary_exp(n->request / n->area);
        if (g->params.curves) n->away = curve_distance_at(g->params.curves, 0, n->position);
    }
    return g->count > 0 || error_set(e, ERROR_NO_SURFACE, "the grading finds no place on the surface");
}

/* State during the construction. */
typedef struct field_build {
    sizing_field *g;
    threads *pool;
    uint32_t *heap; /* priority heap of nodes that may limit others, smallest spacing first */
    uint32_t *at;   /* index of node k in the heap plus 1; 0: not in it */
    size_t heap_count;
    double *from, *to; /* logarithms of spacings, before and after an averaging pass */
    double *change;    /* per node: change in the last pass */
} field_build;

static void making_free(field_build *m)
{
    free(m->heap);
    free(m->at);
    free(m->from);
    free(m->to);
    free(m->change);
}

static void link_chunk(void *context, int worker, size_t begin, size_t end)
{
    const sizing_field *g = context;
    (void)worker;
    for (size_t k = begin; k < end; k++)
        for (int i = 0; i < AROUND; i++)
            g->beside[k][i] =
                node_at(g, g->cubes.blocks[k], i % ROW - 1, i / ROW % ROW - 1, i / (ROW * ROW) - 1);
}

static bool making_begin(field_build *m, sizing_field *g, threads *pool, error *e)
{
    const char *what = "the grading";
    *m = (field_build){.g = g, .pool = pool};
    g->beside = mem_array(g->count, sizeof *g->beside, what, e);
    m->heap = mem_array(g->count, sizeof *m->heap, what, e);
    m->at = mem_array(g->count, sizeof *m->at, what, e);
    m->from = mem_array(g->count, sizeof *m->from, what, e);
    m->to = mem_array(g->count, sizeof *m->to, what, e);
    m->change = mem_array(g->count, sizeof *m->change, what, e);
    if (!g->beside || !m->heap || !m->at || !m->from || !m->to || !m->change) return false;
    threads_run(pool, g->count, THREADS_GRAIN, link_chunk, g);
    return true;
}

/* --- bounds, growth and the count --- */

static double heap_spacing(const field_build *m, size_t place)
{
    return m->g->node[m->heap[place]].spacing;
}

static void heap_put(field_build *m, size_t place, uint32_t k)
{
    assert(place < m->g->count && k < m->g->count);
    m->heap[place] = k;
    m->at[k] = (uint32_t)place + 1;
}

/* Adds a node, or moves it up after its spacing was reduced. */
static void heap_add(field_build *m, uint32_t k)
{
    size_t place = m->at[k] ? m->at[k] - 1 : m->heap_count++;
    for (; place > 0 && heap_spacing(m, (place - 1) / 2) > m->g->node[k].spacing; place = (place - 1) / 2)
        heap_put(m, place, m->heap[(place - 1) / 2]);
    heap_put(m, place, k);
}

static uint32_t heap_take(field_build *m)
{
    uint32_t first = m->heap[0], last = m->heap[--m->heap_count];
    m->at[first] = 0;
    size_t place = 0;
    for (size_t child; (child = 2 * place + 1) < m->heap_count; place = child) {
        if (child + 1 < m->heap_count && heap_spacing(m, child + 1) < heap_spacing(m, child)) child++;
        if (heap_spacing(m, child) >= m->g->node[last].spacing) break;
        heap_put(m, place, m->heap[child]);
    }
    if (m->heap_count > 0) heap_put(m, place, last);
    return first;
}

/* Reduces adjacent spacings that exceed that of node k by more than `gradation` times the distance. Returns
 * whether there were any. `only_test`: nothing is changed. */
static bool limit_neighbours(field_build *m, uint32_t k, bool only_test)
{
    const node *n = &m->g->node[k];
    for (int i = 0; i < AROUND; i++) {
        uint32_t other = m->g->beside[k][i];
        if (other == NO_NODE) continue;
        node *o = &m->g->node[other];
        double most = n->spacing + m->g->params.gradation * vec3_norm(vec3_sub(o->position, n->position));
        if (o->spacing <= most) continue;
        if (only_test) return true;
        o->spacing = most;
        heap_add(m, other);
    }
    return false;
}

/* Reduces spacings until none exceeds that of an adjacent node by more than `gradation` times their
 * distance. */
static void limit_growth(field_build *m)
{
    if (isinf(m->g->params.gradation)) return;
    for (uint32_t k = 0; k < m->g->count; k++)
        if (limit_neighbours(m, k, true)) heap_add(m, k);
    while (m->heap_count > 0 && !threads_stopped(m->pool)) limit_neighbours(m, heap_take(m), false);
}

/* Sets the spacings for a scale, and returns the number of points. `widest`: replaces a missing upper
 * bound. */
static double points_under(field_build *m, double scale, double widest)
{
    sizing_field *g = m->g;
    double low = g->params.min_spacing, high = g->params.max_spacing > 0 ? g->params.max_spacing : widest;
    for (size_t k = 0; k < g->count; k++)
        g->node[k].spacing = fmin(fmin(fmax(scale * g->node[k].request, low), high), g->node[k].cap);
    limit_growth(m);
    double points = 0;
    for (const node *n = g->node; n < g->node + g->count; n++)
        points += n->area / packing_cell_area(spacing_beside(&g->params, n->away, n->spacing));
    return points;
}

static bool count_impossible(field_build *m, const surface *scan, size_t count, double widest, error *e)
{
    const sizing_field_params *p = &m->g->params;
    double most = packing_count(scan->area, p->min_spacing);
    if (p->min_spacing > 0 && (double)count > 0.99 * most)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/sampling/count: %zu points do not fit on the area of %g, since /sampling/min_spacing %g allows at most "
            "%.0f: lower the count, or min_spacing to at most %.3g",
            count, scan->area, p->min_spacing, most, 0.99 * packing_spacing(scan->area, (double)count));
    if (p->feature_ratio > 0)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/sampling/count: %zu points are too few for the thin parts, narrow gaps and the gradation: set it to at least "
            "%.0f",
            count, ceil(1.01 * points_under(m, INFINITY, widest)));
    if (p->max_spacing > 0)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/sampling/count: %zu points are too few for the area of %g, since /sampling/max_spacing %g requires at least "
            "%.0f: raise the count, or max_spacing",
            count, scan->area, p->max_spacing, packing_count(scan->area, p->max_spacing));
    return error_set(
        e, ERROR_SPEC_INVALID,
        "/sampling/count: %zu points are too few for the grading, whose spacing may grow by %g per unit of distance "
        "(/sampling/gradation): raise the count",
        count, p->gradation);
}

/* Finds the scale for `want` points. Without bounds the number of points is proportional to its inverse
 * square; bounds and growth weaken that. Half a point of error is sufficient. */
static bool find_scale(field_build *m, double want, double first, double widest)
{
    double scale = first, low = 0, high = INFINITY,
           near = fmax(NODES_TOLERANCE * want, fmin(0.5, 1e-3 * want));
    for (int k = 0; k < SCALE_STEPS && !threads_stopped(m->pool); k++) {
        double points = points_under(m, scale, widest);
        m->g->facts.scale = scale;
        if (fabs(points - want) < near || high < low * (1 + NODES_TOLERANCE)) return true;
        if (points > want)
            low = scale;
        else
            high = scale;
        bool bracketed = low > 0 && high < INFINITY;
        double guess = scale * elementary_pow(points / want, bracketed ? 0.5 : 1);
        if (bracketed && (!(guess > low && guess < high) || k % 4 == 3)) guess = sqrt(low * high);
        scale = guess;
    }
    return false;
}

/* --- noise --- */

/* A packing cannot follow a spacing whose second derivative is large. The growth limit bounds the first
 * derivative; this bounds the second: averages over adjacent nodes until the Laplacian of the logarithm of
 * the spacing is at most `bend` / spacing^2 everywhere. Nodes below that do not change. */
static void smooth_chunk(void *context, int worker, size_t begin, size_t end)
{
    const field_build *m = context;
    const node *nodes = m->g->node;
    const double bend = spacing_request_is_at_points(&m->g->params) ? BEND_AT_POINTS : BEND_OVER_DISTANCE;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        double sum = 0, weights = 0, spacing = elementary_exp(m->from[k]) / m->g->edge;
        for (int i = 0; i < AROUND; i++) {
            uint32_t other = m->g->beside[k][i];
            if (other == NO_NODE) continue;
            sum += nodes[other].area * m->from[other];
            weights += nodes[other].area;
        }
        double rise = sum / weights - m->from[k], most = bend * AVERAGE_RISE / (spacing * spacing);
        m->change[k] = fabs(rise) - most;
        m->to[k] = m->from[k] + (m->change[k] > 0 ? copysign(m->change[k], rise) : 0);
    }
}

/* Smooths the logarithms in m->from. */
static void smooth(field_build *m)
{
    double worst = INFINITY;
    for (int pass = 0; pass < SMOOTH_PASSES && worst > SMOOTH_TOLERANCE && !threads_stopped(m->pool);
         pass++) {
        threads_run(m->pool, m->g->count, THREADS_GRAIN, smooth_chunk, m);
        worst = 0;
        for (size_t k = 0; k < m->g->count; k++) worst = fmax(worst, m->change[k]);
        double *swap = m->from;
        m->from = m->to;
        m->to = swap;
    }
}

/* --- models --- */

/* The gradient that fits the adjacent nodes' spacings best, by least squares. */
static void model_node(const field_build *links, size_t index)
{
    const sizing_field *g = links->g;
    node *n = &g->node[index];
    sym3 m = {0};
    vec3 b = {0, 0, 0};
    for (int k = 0; k < AROUND; k++) {
        uint32_t other = g->beside[index][k];
        if (other == NO_NODE || other == index) continue;
        vec3 d = vec3_sub(g->node[other].position, n->position);
        double weight = g->node[other].area / vec3_norm2(d);
        double rise = g->node[other].spacing - n->spacing;
        m.xx += weight * d.x * d.x;
        m.yy += weight * d.y * d.y;
        m.zz += weight * d.z * d.z;
        m.xy += weight * d.x * d.y;
        m.xz += weight * d.x * d.z;
        m.yz += weight * d.y * d.z;
        b = vec3_axpy(weight * rise, d, b);
    }
    double damping = GRADIENT_DAMPING * (m.xx + m.yy + m.zz);
    n->gradient = (vec3){0, 0, 0};
    if (!(damping > 0)) return;
    m.xx += damping;
    m.yy += damping;
    m.zz += damping;
    n->gradient = sym3_solve(m, b);
    double slope = vec3_norm(n->gradient);
    if (slope > g->params.gradation) n->gradient = vec3_scale(n->gradient, g->params.gradation / slope);
}

static void model_chunk(void *context, int worker, size_t begin, size_t end)
{
    (void)worker;
    for (size_t k = begin; k < end; k++) model_node(context, k);
}

/* The nearest node, for points outside the sampled cubes. */
static const node *nearest_node(const sizing_field *g, vec3 x)
{
    const node *nearest = g->node;
    double nearest2 = INFINITY;
    for (size_t k = 0; k < g->count; k++) {
        double distance2 = vec3_norm2(vec3_sub(g->node[k].position, x));
        if (distance2 >= nearest2) continue;
        nearest2 = distance2;
        nearest = &g->node[k];
    }
    return nearest;
}

/* The eight cubes whose centres surround a place. */
typedef struct surrounding_cubes {
    cube low, own; /* the lowest of the eight, and the one that contains the place */
    double t[3];   /* position between the centres of the lowest and the highest cube, 0 .. 1 */
    int beside;    /* index of the lowest cube among those around `own` */
    uint32_t around[FIELD_CELL_CORNERS]; /* nodes of the eight cubes, or NO_NODE */
} surrounding_cubes;

static void find_cubes(const sizing_field *g, vec3 x, surrounding_cubes *s)
{
    s->low = s->own = cube_of(vec3_sub(in_cubes(g, x), vec3_make(0.5, 0.5, 0.5)), s->t);
    s->beside = 0;
    for (int a = 2; a >= 0; a--) {
        const int high = s->t[a] >= 0.5; /* the place is in the higher cube */
        s->own.at[a] += high;
        s->beside = ROW * s->beside + 1 - high;
    }
}

/* Finds the nodes of the eight cubes, through the links of the place's own node if it exists. */
static void find_nodes(const sizing_field *g, surrounding_cubes *s)
{
    const uint32_t own = node_at(g, s->own.at, 0, 0, 0),
                   *row = own == NO_NODE ? NULL : g->beside[own] + s->beside;
    for (int c = 0; c < FIELD_CELL_CORNERS; c++)
        s->around[c] = row ? row[(c & 1) + ROW * (c >> 1 & 1) + ROW * ROW * (c >> 2)]
                           : node_at(g, s->low.at, c & 1, c >> 1 & 1, c >> 2);
}

/* The interpolated value of the models at a place. */
typedef struct blend {
    double spacing, weights;
    vec3 gradient;
} blend;

ISA_INLINE void add_model(const node *n, double weight, vec3 x, bool steep, blend *b)
{
    double rise = vec3_dot(n->gradient, vec3_sub(x, n->position)), most = MODEL_LIMIT * n->spacing;
    rise = rise > most ? most : rise;
    b->spacing += weight * (n->spacing + (rise < -most ? -most : rise));
    if (steep) b->gradient = vec3_axpy(weight, n->gradient, b->gradient);
    b->weights += weight;
}

/* The spacing at x with curves. `gradient` (or NULL): in: that of `spacing`; out: that of the result. */
static double refine_beside(const sizing_field *g, vec3 x, double spacing, vec3 *gradient)
{
    const sizing_field_params *p = &g->params;
    vec3 nearest = x;
    double away = curve_distance_nearest(p->curves, 0, x, &nearest);
    double found = spacing_beside(p, away, spacing);
    if (gradient && found < spacing) {
        *gradient = vec3_scale(*gradient, p->curve_share);
        if (away > 0) *gradient = vec3_axpy(p->gradation / away, vec3_sub(x, nearest), *gradient);
    }
    return found;
}

/* Interpolates the models of the eight cubes. A missing node is replaced by any node with weight 0: half of
 * them are missing on a surface, and a branch would often be mispredicted. */
ISA_INLINE double blend_models(const sizing_field *g, vec3 x, const surrounding_cubes *s, vec3 *gradient)
{
    blend b = {0};
    for (int c = 0; c < FIELD_CELL_CORNERS; c++) {
        double weight = (c & 1 ? s->t[0] : 1 - s->t[0]) * (c & 2 ? s->t[1] : 1 - s->t[1]) *
                        (c & 4 ? s->t[2] : 1 - s->t[2]);
        bool missing = s->around[c] == NO_NODE;
        add_model(&g->node[missing ? 0 : s->around[c]], missing ? 0 : weight, x, gradient != NULL, &b);
    }
    if (!(b.weights > 0)) add_model(nearest_node(g, x), 1, x, true, &b);
    if (gradient) *gradient = vec3_scale(b.gradient, 1 / b.weights);
    double least = g->params.min_spacing, most = g->params.max_spacing, spacing = b.spacing / b.weights;
    spacing = spacing < least ? least : spacing;
    spacing = most > 0 && spacing > most ? most : spacing;
    return g->params.curves ? refine_beside(g, x, spacing, gradient) : spacing;
}

double sizing_field_spacing(const sizing_field *g, vec3 x, vec3 *gradient)
{
    surrounding_cubes s;
    find_cubes(g, x, &s);
    find_nodes(g, &s);
    return blend_models(g, x, &s, gradient);
}

/* The number of points for the models, summed over the cells. */
static double sum_points(sizing_field *g, const surface *scan, const vec3 *position)
{
    for (size_t k = 0; k < scan->cells; k++) {
        double area = surface_cell_area(scan, k);
        double points = area > 0 ? area / packing_cell_area(sizing_field_spacing(g, position[k], NULL)) : 0;
        g->points_before[k + 1] = g->points_before[k] + points;
    }
    return g->points_before[scan->cells];
}

/* Smooths after the growth limit, so that a crease takes effect before it is averaged, and the fine end of
 * noise remains. Painted maps are not smoothed. */
static void smooth_spacing(field_build *m)
{
    sizing_field *g = m->g;
    if (spacing_request_is_map(&g->params)) return;
    for (size_t k = 0; k < g->count; k++) m->from[k] = elementary_log(g->node[k].spacing);
    smooth(m);
    for (size_t k = 0; k < g->count; k++)
        g->node[k].spacing = fmin(elementary_exp(m->from[k]), g->node[k].cap);
    limit_growth(m);
}

/* Multiplies all spacings by a factor, within their bounds. */
static void rescale(sizing_field *g, double factor)
{
    double low = g->params.min_spacing, high = g->params.max_spacing > 0 ? g->params.max_spacing : INFINITY;
    g->facts.scale *= factor;
    for (size_t k = 0; k < g->count; k++)
        g->node[k].spacing = fmin(fmax(factor * g->node[k].spacing, low), high);
}

/* Scales the spacings to `count` points, first by the nodes, then corrected by a few percent by the cells.
 * `is_rough`: only the spacings are used; no correction, no smoothing. */
static bool meet_count(sizing_field *g, const surface *scan, const vec3 *position, size_t count,
                       bool is_rough, threads *pool, error *e)
{
    double area = 0, asked = 0, even = packing_spacing(scan->area, (double)count);
    double widest = fmax(bbox_longest(scan->box), WIDEST_EVEN * even);
    for (size_t k = 0; k < g->count; k++) {
        area += g->node[k].area;
        asked += g->node[k].area / (g->node[k].request * g->node[k].request);
    }
    double want = (double)count * area / scan->area; /* cells without a sample count like the others */
    field_build m;
    g->points_before = mem_array(scan->cells + 1, sizeof *g->points_before, "the grading", e);
    bool ok = making_begin(&m, g, pool, e) && g->points_before;
    if (ok && !find_scale(&m, want, even * sqrt(asked / area), widest))
        ok = count_impossible(&m, scan, count, widest, e);
    if (ok && !is_rough) smooth_spacing(&m);
    for (int k = 0; ok && k < (is_rough ? 1 : CELLS_STEPS); k++) {
        threads_run(pool, g->count, THREADS_GRAIN, model_chunk, &m);
        double ratio = sum_points(g, scan, position) / (double)count;
        if (fabs(ratio - 1) < CELLS_TOLERANCE) break;
        rescale(g, sqrt(ratio));
    }
    making_free(&m);
    if (!threads_may_go_on(pool, e)) return false;
    return ok;
}

/* Makes the field with a scale of 1, for as many points as it needs. */
static bool take_points(sizing_field *g, const surface *scan, const vec3 *position, threads *pool, error *e)
{
    field_build m;
    g->points_before = mem_array(scan->cells + 1, sizeof *g->points_before, "the grading", e);
    bool ok = making_begin(&m, g, pool, e) && g->points_before;
    if (ok) {
        double widest = bbox_longest(scan->box);
        g->facts.scale = g->params.kind == SIZING_FIELD_EVEN ? widest : 1;
        points_under(&m, g->facts.scale, widest);
        smooth_spacing(&m);
        threads_run(pool, g->count, THREADS_GRAIN, model_chunk, &m);
        sum_points(g, scan, position);
    }
    making_free(&m);
    if (!threads_may_go_on(pool, e)) return false;
    return ok;
}

/* Every node has at least one cell. */
static bool fits_memory(const sizing_field *g, size_t cells, error *e)
{
    /* spacings before and after an iteration, points before a cell, three arrays of smoothing; two of the
     * heap */
    const size_t node_bytes = sizeof(node) + sizeof(node_links) + sizeof(double[6]) + sizeof(uint32_t[2]);
    const double bytes = (double)(cells * (SPACING_REQUEST_CELL_BYTES + node_bytes) + block_map_bytes(cells));
    if (g->params.memory_limit == 0 || bytes <= (double)g->params.memory_limit) return true;
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "the grading of %zu cells of the surface needs about %.0f MiB, the limit leaves %.0f MiB: raise "
        "limits.memory_mb",
        cells, bytes / (1 << 20), (double)g->params.memory_limit / (1 << 20));
}

static void empty_field(sizing_field *g)
{
    free(g->node);
    block_map_free(&g->cubes);
    free(g->beside);
    free(g->points_before);
    g->node = NULL;
    g->beside = NULL;
    g->points_before = NULL;
    g->count = 0;
}

static void describe(sizing_field *g, size_t cells)
{
    g->facts.least = INFINITY;
    g->facts.largest = 0;
    for (size_t k = 0; k < g->count; k++) {
        double away = fmax(g->node[k].away - g->edge, 0); /* a curve may be closer elsewhere in the cube */
        g->facts.least = fmin(g->facts.least, spacing_beside(&g->params, away, g->node[k].spacing));
        g->facts.largest = fmax(g->facts.largest, g->node[k].spacing);
    }
    g->facts.points = g->points_before[cells];
}

/* Measures where `gradation` reduces the spacings of a map. A place at which the map requests no points has none. */
static void measure_cuts(sizing_field *g, const spacing_request *r, const double *spacing)
{
    const sizing_field_params *p = &g->params;
    const double high = p->max_spacing > 0 ? p->max_spacing : INFINITY;
    double points = 0;
    g->facts.largest_cut = 0;
    for (size_t k = 0; k < r->scan->cells; k++) {
        const double area = surface_cell_area(r->scan, k);
        const vec3 x = r->samples.position[k];
        if (isnan(spacing[k]) || !(area > 0) || !spacing_request_is_painted(r, k)) continue;
        double asked = fmin(fmax(g->facts.scale * spacing[k], p->min_spacing), high);
        if (r->feature) asked = fmin(asked, spacing_request_cap(p, r->feature[k]));
        if (p->curves) asked = spacing_beside(p, curve_distance_at(p->curves, 0, x), asked);
        const double found = sizing_field_spacing(g, x, NULL), cut = 1 - found / asked;
        g->facts.largest_cut = fmax(g->facts.largest_cut, cut);
        if (cut > SIZING_FIELD_CUT) points += area / packing_cell_area(found);
    }
    g->facts.cut_share = points / g->facts.points;
}

/* Makes the field of a request. If that depends on the spacing, makes rough fields first: the curvature of
 * each iteration is over the geometric mean of the spacings of the last two. */
static bool fill_field(sizing_field *g, spacing_request *r, size_t count, threads *pool, error *e)
{
    size_t cells = r->scan->cells;
    double *over = mem_array(cells, sizeof *over, "the grading", e);
    double *spacing = mem_array(cells, sizeof *spacing, "the grading", e);
    bool ok = over && spacing;
    for (size_t k = 0; ok && k < cells; k++) over[k] = r->even;
    int passes = spacing_request_is_implicit(&g->params) ? IMPLICIT_PASSES : 1;
    for (int pass = 0; ok && pass < passes; pass++) {
        for (size_t k = 0; pass > 0 && k < cells; k++)
            over[k] = sqrt(over[k] * sizing_field_spacing(g, r->samples.position[k], NULL));
        empty_field(g);
        ok = spacing_request_find(r, over, spacing, e) && make_nodes(g, r, spacing, e) &&
             (count > 0 ? meet_count(g, r->scan, r->samples.position, count, pass < passes - 1, pool, e)
                        : take_points(g, r->scan, r->samples.position, pool, e));
    }
    if (ok) describe(g, cells);
    if (ok && spacing_request_is_map(&g->params)) measure_cuts(g, r, spacing);
    free(over);
    free(spacing);
    return ok;
}

static double ratio_of(const sizing_field *g)
{
    return g->facts.largest / g->facts.least;
}

/* Makes the field. While growth and smoothing (not a bound) reduce a ratio too much, halves fine_share, as
 * long as that helps. */
static bool find_field(sizing_field *g, spacing_request *r, size_t count, threads *pool, error *e)
{
    const sizing_field_params *p = &g->params;
    const bool bounded = p->min_spacing > 0 || p->max_spacing > 0 || p->feature_ratio > 0;
    bool ok = fill_field(g, r, count, pool, e);
    while (ok && !bounded && ratio_of(g) < RATIO_LEFT * p->ratio) {
        const double before = ratio_of(g), share = r->fine_share;
        if (!spacing_request_refine(r)) break;
        ok = fill_field(g, r, count, pool, e);
        if (!ok || ratio_of(g) > before) continue;
        r->fine_share = share;
        return fill_field(g, r, count, pool, e);
    }
    return ok;
}

sizing_field *sizing_field_new(const field *f, const surface *scan, const sizing_field_params *params,
                               size_t count, threads *pool, error *e)
{
    sizing_field *g = mem_alloc(sizeof *g);
    double even = packing_spacing(scan->area, (double)count);
    spacing_request r = {0};
    g->params = *params;
    bool ok = fits_memory(g, scan->cells, e) && spacing_request_begin(&r, scan, &g->params, even, pool, e);
    if (ok && r.feature) ok = spacing_request_describe_features(&r, &g->facts.features, e);
    if (ok) {
        if (count == 0)
            even = fmin(packing_spacing(scan->area, g->facts.features.points), bbox_longest(scan->box));
        g->edge = fmax(EDGE_CELLS * f->cell_size, EDGE_SPACING * even);
        g->edge = fmax(g->edge, bbox_longest(f->domain) / MOST_CUBES);
        g->origin = bbox_of_points(r.samples.position, scan->cells, pool).min;
        ok = find_field(g, &r, count, pool, e);
    }
    if (ok && params->kind == SIZING_FIELD_RATIO) g->facts.permitted_ratio = r.widest_ratio;
    spacing_request_free(&r);
    if (ok) return g;
    sizing_field_free(g);
    return NULL;
}

static void *copy_array(const void *from, size_t count, size_t size, error *e)
{
    void *to = mem_array(count, size, "the grading", e);
    return to ? memcpy(to, from, count * size) : NULL;
}

sizing_field *sizing_field_rescale(const sizing_field *g, size_t cells, size_t count, error *e)
{
    sizing_field *copy = mem_alloc(sizeof *copy);
    double factor = sqrt(g->facts.points / (double)count);
    *copy = *g;
    copy->node = copy_array(g->node, g->count, sizeof *g->node, e);
    copy->cubes = (block_map){0};
    copy->beside = copy_array(g->beside, g->count, sizeof *g->beside, e);
    copy->points_before = copy_array(g->points_before, cells + 1, sizeof *g->points_before, e);
    if (!copy->node || !block_map_copy(&g->cubes, &copy->cubes, e) || !copy->beside || !copy->points_before) {
        sizing_field_free(copy);
        return NULL;
    }
    for (size_t k = 0; k < g->count; k++) {
        copy->node[k].spacing *= factor;
        copy->node[k].gradient = vec3_scale(copy->node[k].gradient, factor);
    }
    for (size_t k = 0; k <= cells; k++) copy->points_before[k] /= factor * factor;
    copy->params.min_spacing *= factor;
    copy->params.max_spacing *= factor;
    copy->params.gradation *= factor;
    copy->facts.scale *= factor;
    copy->facts.points = copy->points_before[cells];
    copy->facts.least *= factor;
    copy->facts.largest *= factor;
    return copy;
}

void sizing_field_free(sizing_field *g)
{
    if (!g) return;
    empty_field(g);
    free(g);
}

sizing_field_facts sizing_field_describe(const sizing_field *g)
{
    return g->facts;
}

const double *sizing_field_weight(const sizing_field *g, const surface *scan)
{
    return g ? g->points_before : scan->area_before;
}

vec3 sizing_field_draw(const sizing_field *g, const surface *scan, double where, rng *r,
                       surface_last_cell *last)
{
    const double *before = sizing_field_weight(g, scan);
    return surface_point(scan, before, where * before[scan->cells], r, last);
}
