// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/measures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "sampling/measures/pair_measures.h"
#include "sampling/measures/restricted_voronoi.h"
#include "sampling/packing/energy.h"
#include "sampling/packing/point_flags.h"
#include "geometry/space/packing.h"

/* Sides shorter than this, in spacings, are ignored: they are rounding errors at a corner where four cells
 * meet. */
static const double LEAST_SIDE = 1e-4;
/* Tolerance, in spacings, for points on an edge or a vertex. */
static const double ON_EDGE = 1e-6;
/* Minimum ratio of the largest to the smallest requested spacing for which the slope of local against
 * requested spacing is computed. */
static const double EVEN_REQUEST = 1.05;
/* A point has an ideal degree if the angle of the surface, in units of 60 degrees, differs from an integer
 * by at most this. */
static const double NEAR_INTEGER = 0.2;
/* A perfect packing whose spacing increases by g per unit of distance is the image of a lattice under the
 * exponential map. Its cells are larger than requested by the fraction GROWTH_CELL g^2, and its energies by
 * GROWTH_ENERGY g^2. Accurate to 3 % up to g = GROWTH_MOST. */
static const double GROWTH_CELL = 5.0 / 12, GROWTH_ENERGY = 0.668, GROWTH_MOST = 0.3;

static const char what[] = "the measures of the points";

/* Data of each point. */
typedef struct point_table {
    size_t count;
    double *spacing; /* requested spacing h */
    double *ideal;   /* ideal degree: angle of the surface over 60 degrees, plus 1 on a border; 2 k + 2 on an
                    * edge of k > 2 faces */
    double *share;   /* angle of the surface over 360 degrees */
    bool *border, *fork;
    uint32_t *degree;
    uint32_t *piece;
    uint32_t *side; /* see sites.h */
    vec3 *normal;
    bool *one_sided;
    uint32_t *patch; /* per normal */
    bool *at_wedge;
} point_table;

static void free_table(point_table *t)
{
    free(t->spacing);
    free(t->ideal);
    free(t->share);
    free(t->border);
    free(t->fork);
    free(t->degree);
    free(t->piece);
    free(t->side);
    free(t->normal);
    free(t->one_sided);
    free(t->patch);
    free(t->at_wedge);
}

static bool allocate_table(const measures_input *in, point_table *t, error *e)
{
    const size_t n = in->count;
    *t = (point_table){.count = n};
    t->spacing = mem_array(n, sizeof *t->spacing, what, e);
    t->ideal = mem_array(n, sizeof *t->ideal, what, e);
    t->share = mem_array(n, sizeof *t->share, what, e);
    t->border = mem_array(n, sizeof *t->border, what, e);
    t->fork = mem_array(n, sizeof *t->fork, what, e);
    t->degree = mem_array(n, sizeof *t->degree, what, e);
    t->piece = mem_array(n, sizeof *t->piece, what, e);
    t->side = mem_array(n + 1, sizeof *t->side, what, e);
    t->normal = mem_array(in->copy_count, sizeof *t->normal, what, e);
    t->one_sided = mem_array(in->copy_count, sizeof *t->one_sided, what, e);
    t->patch = mem_array(in->copy_count, sizeof *t->patch, what, e);
    t->at_wedge = mem_array(n, sizeof *t->at_wedge, what, e);
    return t->spacing && t->ideal && t->share && t->border && t->fork && t->degree && t->piece && t->side &&
           t->normal && t->one_sided && t->patch && t->at_wedge;
}

/* ---- the surface at the points */

static uint32_t point_of(const measures_input *in, size_t copy)
{
    return in->copy_point ? in->copy_point[copy] : (uint32_t)copy;
}

static bool has_flag(const measures_input *in, size_t copy, uint8_t flag)
{
    return in->copy_flags && in->copy_flags[copy] & flag;
}

/* Lists the normals of all points, grouped by point. */
static void gather_sides(const measures_input *in, point_table *t)
{
    const sites_copies copies = {in->copy_count, in->copy_normal, in->copy_point, in->copy_patch,
                                 in->copy_flags};
    sites_gather(&copies, t->count, t->side, t->normal, t->one_sided, t->patch);
    for (size_t k = 0; k < in->copy_count; k++)
        t->at_wedge[point_of(in, k)] |= has_flag(in, k, PACKING_AT_WEDGE);
}

typedef struct corner_job {
    const measures_input *in;
    const facets *f;
    point_table *t;
} corner_job;

/* Sets the corner of a point on faces of the domain that cut a smooth surface: the angle between the faces
 * in the tangent plane. */
static void set_cut(const field *of, vec3 x, vec3 normal, facets_corner *out)
{
    const unsigned axes = projection_boundary_axes(of, x);
    vec3 inwards[3];
    int count = 0;
    double spread = 0;
    for (int axis = 0; axis < 3; axis++) {
        vec3 d = {0, 0, 0};
        if (!(axes >> axis & 1)) continue;
        vec3_set(&d, axis, vec3_get(x, axis) == vec3_get(of->boundary_box.min, axis) ? 1 : -1);
        inwards[count] = vec3_unit(vec3_axpy(-vec3_dot(d, normal), normal, d));
        for (int k = 0; k < count; k++)
            spread = fmax(spread, acos(fmin(fmax(vec3_dot(inwards[k], inwards[count]), -1), 1)));
        count++;
    }
    if (count > 0) *out = (facets_corner){.angle = M_PI - spread, .border = true};
}

static void set_corner(const measures_input *in, const facets *f, uint32_t i, point_table *t)
{
    facets_corner c = {.angle = 0};
    const bool mesh = in->surface.triangle_count > 0, on_curve = has_flag(in, i, PACKING_FIXED);
    if (on_curve) facets_corner_at(f, in->position[i], ON_EDGE * in->spacing[i], &c);
    /* triangles of a scan are inexact: a point on two patches may lie on triangles of only one of them */
    if (!mesh && c.border && t->side[i + 1] > t->side[i] + 1) c = (facets_corner){.angle = 0};
    if (!mesh) set_cut(in->surface.scan->field, in->position[i], t->normal[t->side[i]], &c);
    const double angle = c.angle > 0 ? c.angle : 2 * M_PI;
    t->share[i] = angle / (2 * M_PI);
    t->border[i] = c.border;
    t->fork[i] = c.fork;
    t->ideal[i] = c.fork ? 2 * angle / M_PI + 2 : angle / (M_PI / 3) + c.border;
}

/* Sets the piece of a point, and without given normals the normal of the nearest triangle. */
static void set_piece(const measures_input *in, const facets *f, uint32_t i, point_table *t)
{
    if (in->copy_normal) {
        if (f->piece_count == 1) return; /* the only piece has the number 0 */
        t->piece[i] = in->copy_patch && f->in.patch_piece ? f->in.patch_piece[in->copy_patch[i]]
                                                          : facets_nearest_piece(f, in->position[i]);
        return;
    }
    const size_t at = facets_nearest(f, in->position[i]);
    t->piece[i] = facets_piece(f, at);
    facet triangle[FIELD_CELL_TRIANGLES];
    facets_expand(f, at, false, triangle);
    t->normal[t->side[i]] = triangle[0].normal;
}

static void point_chunk(void *context, int worker, size_t begin, size_t end)
{
    const corner_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        set_piece(job->in, job->f, (uint32_t)i, job->t);
        set_corner(job->in, job->f, (uint32_t)i, job->t);
    }
}

/* ---- sums over cells and sides */

typedef struct moments {
    double n, sum, squares;
} moments;

static void count_value(moments *m, double value)
{
    m->n++;
    m->sum += value;
    m->squares += value * value;
}

/* Coefficient of variation. NAN: fewer than two values. */
static double variation(const moments *m)
{
    if (m->n < 2 || !(m->sum > 0)) return NAN;
    const double mean = m->sum / m->n;
    return sqrt(fmax(m->squares / m->n - mean * mean, 0)) / mean;
}

static bool is_side(const voronoi_side *s, const double *spacing)
{
    return s->length > LEAST_SIDE * 0.5 * (spacing[s->a] + spacing[s->b]);
}

static void count_degrees(const restricted_voronoi *v, point_table *t)
{
    memset(t->degree, 0, t->count * sizeof *t->degree);
    for (size_t k = 0; k < v->side_count; k++) {
        if (!is_side(&v->side[k], t->spacing)) continue;
        t->degree[v->side[k].a]++;
        t->degree[v->side[k].b]++;
    }
}

static double local_spacing(const restricted_voronoi *v, const point_table *t, size_t i)
{
    return v->area[i] > 0 ? packing_spacing(v->area[i] / t->share[i], 1) : t->spacing[i];
}

/* Without requested spacings: sets the spacing of a point to the mean local spacing of it and its
 * neighbours. */
static bool take_achieved(const restricted_voronoi *v, point_table *t, error *e)
{
    double *sum = mem_array(t->count, sizeof *sum, what, e);
    if (!sum) return false;
    for (size_t i = 0; i < t->count; i++) sum[i] = local_spacing(v, t, i);
    count_degrees(v, t);
    double *out = mem_array(t->count, sizeof *out, what, e);
    for (size_t i = 0; out && i < t->count; i++) out[i] = sum[i];
    for (size_t k = 0; out && k < v->side_count; k++) {
        if (!is_side(&v->side[k], t->spacing)) continue;
        out[v->side[k].a] += sum[v->side[k].b];
        out[v->side[k].b] += sum[v->side[k].a];
    }
    for (size_t i = 0; out && i < t->count; i++) t->spacing[i] = out[i] / (1 + t->degree[i]);
    free(sum);
    free(out);
    return out != NULL;
}

static bool is_regular(const point_table *t, size_t i)
{
    const double degree = t->degree[i];
    if (t->fork[i]) return degree >= 6;
    return degree >= floor(t->ideal[i] + NEAR_INTEGER) && degree <= ceil(t->ideal[i] - NEAR_INTEGER);
}

/* Ideal minus actual degree. Its sum over all points of a surface is 6 times the Euler characteristic. */
static double missing_degree(const point_table *t, size_t i)
{
    return (t->border[i] ? 4 : 6) - (double)t->degree[i];
}

/* Counts, for each piece, the points that do not have the ideal degree, minus the number that the topology
 * of the piece requires. */
static bool count_defects(const point_table *t, const bool *regular, size_t pieces, double *share, error *e)
{
    double *irregular = mem_array(pieces, sizeof *irregular, what, e),
           *missing = mem_array(pieces, sizeof *missing, what, e);
    const bool ok = irregular && missing;
    double sum = 0;
    for (size_t i = 0; ok && i < t->count; i++) {
        irregular[t->piece[i]] += !regular[i];
        missing[t->piece[i]] += missing_degree(t, i);
    }
    for (size_t p = 0; ok && p < pieces; p++) sum += fmax(irregular[p] - fabs(missing[p]), 0);
    *share = sum / (double)t->count;
    free(irregular);
    free(missing);
    return ok;
}

/* Sums for the regression of the logarithm of the local spacing on that of the requested spacing. */
typedef struct slope {
    double n, x, y, xx, xy, finest, coarsest;
} slope;

static void count_grading(slope *s, double requested, double local)
{
    const double x = log(requested), y = log(local);
    s->n++;
    s->x += x;
    s->y += y;
    s->xx += x * x;
    s->xy += x * y;
    s->finest = fmin(s->finest, requested);
    s->coarsest = fmax(s->coarsest, requested);
}

/* Sums over the Voronoi cells. */
typedef struct cell_sums {
    moments edge, area, ratio;
    slope grading;
    double regular, degrees, turn, unmeasured;
    double straight; /* areas of the cells with straight sides, over h^2 and the share of the angle */
} cell_sums;

static void sum_cells(const measures_input *in, const restricted_voronoi *v, const point_table *t,
                      const double *local, bool *regular, cell_sums *out)
{
    *out = (cell_sums){.grading = {.finest = INFINITY}};
    for (size_t i = 0; i < t->count; i++) {
        const double h = t->spacing[i];
        regular[i] = is_regular(t, i);
        out->regular += regular[i];
        out->degrees += missing_degree(t, i);
        out->turn += (t->ideal[i] - (double)t->degree[i]) / 6;
        out->unmeasured += t->degree[i] < (t->border[i] ? 2u : 3u);
        count_value(&out->area, v->area[i] / (h * h * t->share[i]));
        count_value(&out->ratio, local[i] / in->spacing[i]);
        count_grading(&out->grading, in->spacing[i], local[i]);
    }
    for (size_t k = 0; k < v->side_count; k++) {
        const voronoi_side *s = &v->side[k];
        if (!is_side(s, t->spacing)) continue;
        const double distance = vec3_norm(vec3_sub(in->position[s->a], in->position[s->b]));
        count_value(&out->edge, distance / (0.5 * (t->spacing[s->a] + t->spacing[s->b])));
        out->straight += 0.25 * distance * s->length / (t->spacing[s->a] * t->spacing[s->a] * t->share[s->a]);
        out->straight += 0.25 * distance * s->length / (t->spacing[s->b] * t->spacing[s->b] * t->share[s->b]);
    }
}

/* The mean square of the gradient of the requested spacing. The neighbours of a point are in all directions,
 * so that the differences have half of it. */
static bool mean_growth2(const measures_input *in, const restricted_voronoi *v, const point_table *t,
                         double *out, error *e)
{
    double *sum = mem_array(t->count, sizeof *sum, what, e), total = 0;
    for (size_t k = 0; sum && k < v->side_count; k++) {
        const voronoi_side *s = &v->side[k];
        const double more = t->spacing[s->b] - t->spacing[s->a],
                     distance2 = vec3_norm2(vec3_sub(in->position[s->a], in->position[s->b]));
        if (!is_side(s, t->spacing) || !(distance2 > 0)) continue;
        sum[s->a] += more * more / distance2;
        sum[s->b] += more * more / distance2;
    }
    for (size_t i = 0; sum && i < t->count; i++)
        if (t->degree[i] > 0) total += fmin(2 * sum[i] / t->degree[i], GROWTH_MOST * GROWTH_MOST);
    free(sum);
    *out = total / (double)t->count;
    return sum != NULL;
}

/* Energy over that of a perfect packing with cells of the same area, the same number of neighbours and the
 * same grading. A cell with n neighbours (n = 6 times the angle of the surface over 360 degrees, by Gauss
 * and Bonnet) consists of n / 3 triangles with sides proportional to sqrt(6 / n). Energies depend on
 * straight distances, which are shorter than distances along a curved surface: `straight` accounts for this
 * in one of two directions, `flat` in both. */
static double disorder_of(const cell_sums *c, double energy_excess, double growth2)
{
    const double n = c->area.n, turn = 1 - c->turn / n;
    if (!(c->straight > 0 && turn > 0)) return energy_excess;
    const double ordered = packing_cell_area(1) * (1 + GROWTH_CELL * growth2) * turn,
                 flat = c->straight * c->straight / c->area.sum,
                 denser = pow(ordered * n / flat, 0.5 * energy_cotangent.ideal_slope);
    return (1 + energy_excess) / (turn * denser * (1 + GROWTH_ENERGY * growth2)) - 1;
}

static void conclude_grading(const cell_sums *c, measures *out)
{
    const slope *s = &c->grading;
    out->grading_cv = variation(&c->ratio);
    out->grading_exponent = s->coarsest > EVEN_REQUEST * s->finest
                                ? (s->xy - s->x * s->y / s->n) / (s->xx - s->x * s->x / s->n)
                                : 1;
}

static bool conclude_cells(const measures_input *in, const restricted_voronoi *v, const point_table *t,
                           const double *local, size_t pieces, measures *out, error *e)
{
    bool *regular = mem_array(t->count, sizeof *regular, what, e);
    cell_sums c;
    double growth2 = 0;
    if (!regular) return false;
    sum_cells(in, v, t, local, regular, &c);
    const double n = (double)t->count;
    const bool graded = !in->achieved && c.grading.coarsest > EVEN_REQUEST * c.grading.finest;
    const bool ok = count_defects(t, regular, pieces, &out->defect_share, e) &&
                    (!graded || mean_growth2(in, v, t, &growth2, e));
    free(regular);
    out->hex_fraction = c.regular / n;
    out->edge_cv = variation(&c.edge);
    out->area_cv = variation(&c.area);
    out->euler = c.degrees / 6;
    out->unmeasured_share = c.unmeasured / n;
    out->disorder = disorder_of(&c, out->energy_excess, growth2);
    conclude_grading(&c, out);
    return ok;
}

/* ---- coverage and pieces */

/* Counts the points that each piece without points should have. */
static void count_requested(const measures_input *in, const facets *f, const bool *has, double *requested)
{
    if (!in->spacing_at) {
        for (size_t p = 0; p < f->piece_count; p++)
            requested[p] = has[p] ? 0 : f->piece_area[p] / packing_cell_area(in->h);
        return;
    }
    for (size_t k = 0; k < f->item_count; k++) {
        const uint32_t piece = facets_piece(f, k);
        if (has[piece]) continue;
        const facets_item item = facets_item_at(f, k);
        requested[piece] += item.area / packing_cell_area(in->spacing_at(in->spacing_context, item.centre));
    }
}

static bool conclude_pieces(const measures_input *in, const facets *f, const point_table *t, measures *out,
                            error *e)
{
    bool *has = mem_array(f->piece_count, sizeof *has, what, e);
    double *requested = has ? mem_array(f->piece_count, sizeof *requested, what, e) : NULL, empty = 0;
    for (size_t i = 0; requested && i < t->count; i++) has[t->piece[i]] = true;
    if (requested) count_requested(in, f, has, requested);
    for (size_t p = 0; requested && p < f->piece_count; p++) {
        if (!(requested[p] > 1)) continue;
        out->parts_without_points++;
        empty += f->piece_area[p];
    }
    const bool ok = requested != NULL;
    free(has);
    free(requested);
    out->empty_area_share = empty / f->area;
    return ok;
}

static sites sites_of(const measures_input *in, const point_table *t, const cell_list *near)
{
    sites s = {.count = t->count,
               .position = in->position,
               .spacing = t->spacing,
               .piece = t->piece,
               .side = t->side,
               .normal = t->normal,
               .one_sided = t->one_sided,
               .patch = t->patch,
               .patch_labels = in->patch_labels,
               .near = near};
    for (size_t i = 0; i < t->count; i++) s.largest_spacing = fmax(s.largest_spacing, t->spacing[i]);
    return s;
}

/* Without requested spacings the diagram is built twice: the cells of the first one determine the spacings
 * that divide the distances of the second one. */
static bool build_diagram(const measures_input *in, const facets *f, const cell_list *near, threads *pool,
                          point_table *t, restricted_voronoi *v, error *e)
{
    sites s = sites_of(in, t, near);
    if (!restricted_voronoi_build(f, &s, pool, v, e)) return false;
    if (!in->achieved) return true;
    if (!take_achieved(v, t, e)) return false;
    restricted_voronoi_free(v);
    s = sites_of(in, t, near);
    return restricted_voronoi_build(f, &s, pool, v, e);
}

static bool take(const measures_input *in, const facets *f, const cell_list *near, threads *pool,
                 point_table *t, restricted_voronoi *v, double *local, double *degree, double *farthest,
                 measures *out, error *e)
{
    memcpy(t->spacing, in->spacing, in->count * sizeof *t->spacing);
    gather_sides(in, t);
    threads_run(pool, in->count, 256, point_chunk, &(corner_job){in, f, t});
    if (!build_diagram(in, f, near, pool, t, v, e)) return false;
    count_degrees(v, t);
    for (size_t i = 0; i < in->count; i++) local[i] = local_spacing(v, t, i);
    if (in->out_piece) memcpy(in->out_piece, t->piece, in->count * sizeof *t->piece);
    if (in->out_spacing) memcpy(in->out_spacing, t->spacing, in->count * sizeof *t->spacing);
    for (size_t i = 0; degree && i < in->count; i++) degree[i] = t->degree[i];
    out->coverage = 0;
    for (size_t p = 0; p < in->surface.patch_count; p++) {
        farthest[p] = v->farthest[p];
        out->coverage = fmax(out->coverage, v->farthest[p]);
    }
    for (size_t k = 0; k < in->lost_places; k++) {
        double distance;
        const uint32_t nearest = cell_list_nearest(near, in->lost_place[k], 0, &distance);
        out->coverage = fmax(out->coverage, distance / t->spacing[nearest]);
    }
    out->missing_share = v->missing / f->area;
    const sites s = sites_of(in, t, near);
    const pair_measures_input pairs = {&s, in->h, in->sized || in->achieved, t->ideal, t->at_wedge, in->kept};
    return pair_measures_take(&pairs, pool, out, e) && conclude_pieces(in, f, t, out, e) &&
           conclude_cells(in, v, t, local, f->piece_count, out, e);
}

bool measures_take(const measures_input *in, threads *pool, double *local, double *degree, double *farthest,
                   measures *out, error *e)
{
    facets f = {0};
    point_table t = {0};
    restricted_voronoi v = {0};
    measures made = {0};
    cell_list *near = cell_list_new(in->position, in->count, pool, e);
    const bool ok = near && facets_build(&in->surface, pool, &f, e) && allocate_table(in, &t, e) &&
                    take(in, &f, near, pool, &t, &v, local, degree, farthest, &made, e);
    restricted_voronoi_free(&v);
    free_table(&t);
    facets_free(&f);
    cell_list_free(near);
    if (ok) *out = made;
    return ok && (!threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped"));
}
