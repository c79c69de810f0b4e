// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/measures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "sampling/measures/pair_measures.h"
#include "sampling/measures/voronoi_cells.h"
#include "sampling/packing/energy.h"
#include "sampling/packing/point_flags.h"
#include "geometry/space/packing.h"

/* Sides shorter than this, in spacings, are ignored: they are rounding errors at a corner where four cells
 * meet. */
static const double LEAST_SIDE = 1e-6;
/* Tolerance, in spacings, for points on an edge or a vertex. */
static const double ON_EDGE = 1e-6;
/* Minimum ratio of the largest to the smallest requested spacing for which the slope of local against
 * requested spacing is computed. */
static const double EVEN_REQUEST = 1.05;
/* A point has an ideal degree if the angle of the surface, in units of 60 degrees, differs from an integer
 * by at most this. */
static const double NEAR_INTEGER = 0.2;
/* Pieces of unknown Euler characteristic are left out of the defects if they have at most this fraction of the points. */
static const double UNKNOWN_SHARE = 0.005;
/* A perfect packing whose spacing increases by g per unit of distance is the image of a lattice under the
 * exponential map. Its cells are larger than requested by the fraction GROWTH_CELL g^2, and its energies by
 * GROWTH_ENERGY g^2. Accurate to 3 % up to g = GROWTH_MOST. */
static const double GROWTH_CELL = 5.0 / 12, GROWTH_ENERGY = 0.668, GROWTH_MOST = 0.3;

static const char what[] = "the measures of the points";

/* Data of each point. */
typedef struct point_table {
    size_t count;
    const double *spacing; /* h at each; the input's, or `own_spacing` */
    double *own_spacing;
    /* Of each point, or NULL if all points are plain (planar_cells.h): */
    double *ideal; /* angle of the surface over 60 degrees, one more on a border; 2 k + 2 on an edge of k > 2
                    * faces; of a plain point 6 */
    double *share; /* angle of the surface over a full turn; of a plain point 1 */
    bool *border, *fork;
    uint32_t *degree;
    /* See sites.h. `piece` is NULL if there is one piece; `side`, `one_sided` and `patch` are NULL if each point has
     * one copy without patch and flags. */
    uint32_t *piece, *side, *patch;
    bool *one_sided;
    const vec3 *normal; /* of each copy; the input's, or `own_normal` */
    vec3 *own_normal;
    uint8_t *odd; /* flags; not 0: not plain (planar_cells.h) */
    pair_energies energy;
    bool has_odd; /* one of them is not 0 */
} point_table;

static void free_table(point_table *t)
{
    free(t->own_spacing);
    free(t->ideal);
    free(t->share);
    free(t->border);
    free(t->fork);
    free(t->degree);
    free(t->piece);
    free(t->side);
    free(t->own_normal);
    free(t->one_sided);
    free(t->patch);
    free(t->odd);
    free(t->energy.odd);
}

/* Whether each point has one copy, without patch and flags. */
static bool has_single_copies(const measures_input *in)
{
    return !in->copy_point && !in->copy_patch && !in->copy_flags;
}

static bool allocate_sides(const measures_input *in, point_table *t, error *e)
{
    if (has_single_copies(in)) return true;
    t->side = mem_array(in->count + 1, sizeof *t->side, what, e);
    t->one_sided = mem_array(in->copy_count, sizeof *t->one_sided, what, e);
    t->patch = mem_array(in->copy_count, sizeof *t->patch, what, e);
    return t->side && t->one_sided && t->patch;
}

static bool allocate_table(const measures_input *in, size_t pieces, point_table *t, error *e)
{
    const size_t n = in->count;
    *t = (point_table){.count = n, .spacing = in->spacing};
    t->degree = mem_array(n, sizeof *t->degree, what, e);
    if (pieces > 1) t->piece = mem_array(n, sizeof *t->piece, what, e);
    const bool given = in->copy_normal && !in->copy_point; /* in the order of the points */
    if (!given) t->own_normal = mem_array(in->copy_count, sizeof *t->own_normal, what, e);
    t->normal = given ? in->copy_normal : t->own_normal;
    t->odd = mem_array(n, sizeof *t->odd, what, e);
    t->energy.odd = mem_array(n, sizeof *t->energy.odd, what, e);
    return allocate_sides(in, t, e) && t->degree && (pieces == 1 || t->piece) && t->normal && t->odd &&
           t->energy.odd;
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
    const sites_copies copies = {in->copy_count, t->own_normal ? in->copy_normal : NULL, in->copy_point,
                                 in->copy_patch, in->copy_flags};
    if (t->side) sites_gather(&copies, t->count, t->side, t->own_normal, t->one_sided, t->patch);
}

static uint32_t first_side(const point_table *t, uint32_t i)
{
    return t->side ? t->side[i] : i;
}

static bool has_several_sides(const point_table *t, size_t i)
{
    return t->side && t->side[i + 1] != t->side[i] + 1;
}

static uint32_t piece_of(const point_table *t, size_t i)
{
    return t->piece ? t->piece[i] : 0;
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
            spread = fmax(spread, elementary_acos(fmin(fmax(vec3_dot(inwards[k], inwards[count]), -1), 1)));
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
    if (!mesh && c.border && has_several_sides(t, i)) c = (facets_corner){.angle = 0};
    if (!mesh) set_cut(in->surface.scan->field, in->position[i], t->normal[first_side(t, i)], &c);
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
        if (t->piece)
            t->piece[i] = in->copy_patch && f->in.patch_piece
                              ? f->in.patch_piece[in->copy_patch[i]]
                              : facets_piece(f, facets_nearest(f, in->position[i]));
        return;
    }
    const size_t at = facets_nearest(f, in->position[i]);
    if (t->piece) t->piece[i] = facets_piece(f, at);
    facet triangle[FIELD_CELL_TRIANGLES];
    facets_expand(f, at, triangle);
    t->own_normal[first_side(t, i)] = triangle[0].normal;
}

static void piece_chunk(void *context, int worker, size_t begin, size_t end)
{
    const corner_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) set_piece(job->in, job->f, (uint32_t)i, job->t);
}

static void corner_chunk(void *context, int worker, size_t begin, size_t end)
{
    const corner_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) set_corner(job->in, job->f, (uint32_t)i, job->t);
}

/* Marks a point with several copies, or near a face of the domain; other bits are flags. */
enum { NOT_PLAIN = 128 };

/* Finds the points whose cells a border, a curve or another patch can bound, and allocates what differs at
 * them. */
static bool find_odd(const measures_input *in, point_table *t, error *e)
{
    const field *of = in->surface.triangle_count == 0 ? in->surface.scan->field : NULL;
    for (size_t k = 0; in->copy_flags && k < in->copy_count; k++)
        t->odd[point_of(in, k)] |= in->copy_flags[k];
    for (size_t i = 0; i < in->count; i++)
        if (has_several_sides(t, i) ||
            (of && of->open && packing_is_near_boundary(of->boundary_box, in->position[i], in->spacing[i])))
            t->odd[i] |= NOT_PLAIN;
    for (size_t i = 0; i < in->count; i++) t->has_odd |= t->odd[i] != 0;
    if (!t->has_odd) return true;
    t->ideal = mem_array(in->count, sizeof *t->ideal, what, e);
    t->share = mem_array(in->count, sizeof *t->share, what, e);
    t->border = mem_array(in->count, sizeof *t->border, what, e);
    t->fork = mem_array(in->count, sizeof *t->fork, what, e);
    return t->ideal && t->share && t->border && t->fork;
}

static double ideal_of(const point_table *t, size_t i)
{
    return t->ideal ? t->ideal[i] : 6;
}

static double share_of(const point_table *t, size_t i)
{
    return t->share ? t->share[i] : 1;
}

static bool is_on_border(const point_table *t, size_t i)
{
    return t->border && t->border[i];
}

/* ---- sums over cells and sides */

typedef struct moments {
    double n, sum, squares;
} moments;

static void count_value(moments *m, double weight, double value)
{
    m->n += weight;
    m->sum += weight * value;
    m->squares += weight * value * value;
}

/* Coefficient of variation of values from which `shift` was subtracted. NAN: fewer than two values. */
static double variation(const moments *m, double shift)
{
    const double mean = m->sum / m->n;
    if (m->n < 2 || !(mean + shift > 0)) return NAN;
    return sqrt(fmax(m->squares / m->n - mean * mean, 0)) / (mean + shift);
}

static bool is_side(const voronoi_side *s, const double *spacing)
{
    return s->length > LEAST_SIDE * 0.5 * (spacing[s->a] + spacing[s->b]);
}

/* The degree of a point whose cell is not certain: the sides that the triangles of the surface give. */
static void count_degrees(const voronoi_cells *c, point_table *t)
{
    for (size_t i = 0; i < t->count; i++) t->degree[i] = c->planar[i].degree;
    for (size_t k = 0; k < c->exact.side_count; k++) {
        const voronoi_side *s = &c->exact.side[k];
        if (!is_side(s, t->spacing)) continue;
        t->degree[s->a] += !c->planar[s->a].certain;
        t->degree[s->b] += !c->planar[s->b].certain;
    }
}

static double local_spacing(const voronoi_cells *c, const point_table *t, size_t i)
{
    const double area = c->area[i];
    return area > 0 ? packing_spacing(area / share_of(t, i), 1) : t->spacing[i];
}

/* Without a request: the mean local spacing of each point and its neighbours. */
static bool take_achieved(const pair_measures_input *pairs, const voronoi_cells *c, threads *pool,
                          point_table *t, error *e)
{
    double *local = mem_array(t->count, sizeof *local, what, e), *mean = t->own_spacing;
    bool ok = local != NULL;
    for (size_t i = 0; ok && i < t->count; i++) mean[i] = local[i] = local_spacing(c, t, i);
    if (ok) count_degrees(c, t);
    for (size_t k = 0; ok && k < c->exact.side_count; k++) {
        const voronoi_side *s = &c->exact.side[k];
        if (!is_side(s, t->spacing)) continue;
        mean[s->a] += local[s->b];
        mean[s->b] += local[s->a];
    }
    for (size_t i = 0; ok && i < t->count; i++) mean[i] /= 1 + t->degree[i];
    ok = ok && pair_measures_means(pairs, c->planar, local, pool, mean, e);
    t->spacing = mean;
    free(local);
    return ok;
}

static bool is_regular(const point_table *t, size_t i)
{
    const double degree = t->degree[i];
    if (t->fork && t->fork[i]) return degree >= 6;
    return degree >= floor(ideal_of(t, i) + NEAR_INTEGER) && degree <= ceil(ideal_of(t, i) - NEAR_INTEGER);
}

/* Ideal minus actual degree. Its sum over all points of a surface is 6 times the Euler characteristic. */
static double missing_degree(const point_table *t, size_t i)
{
    return (is_on_border(t, i) ? 4 : 6) - (double)t->degree[i];
}

/* The share of points without the ideal degree beyond those that the topology of each piece requires. NAN: the Euler
 * characteristic is unknown for pieces with more than UNKNOWN_SHARE of the points. */
static bool count_defects(const point_table *t, const bool *regular, const double *euler, size_t pieces,
                          double *share, error *e)
{
    double *irregular = mem_array(pieces, sizeof *irregular, what, e), beyond = 0, unknown = 0;
    for (size_t i = 0; irregular && i < t->count; i++) {
        const uint32_t p = piece_of(t, i);
        irregular[p] += !regular[i];
        unknown += !euler || isnan(euler[p]);
    }
    for (size_t p = 0; irregular && euler && p < pieces; p++)
        if (!isnan(euler[p])) beyond += fmax(irregular[p] - 6 * fabs(euler[p]), 0);
    *share = unknown <= UNKNOWN_SHARE * (double)t->count ? beyond / (double)t->count : NAN;
    const bool ok = irregular != NULL;
    free(irregular);
    return ok;
}

/* Sums for the regression of the logarithm of the local spacing on that of the requested spacing. */
typedef struct slope {
    bool graded; /* see EVEN_REQUEST; if not, the sums are 0 */
    double n, x, y, xx, xy;
} slope;

static bool is_graded(const double *requested, size_t count)
{
    double finest = INFINITY, coarsest = 0;
    for (size_t i = 0; i < count; i++) {
        finest = compare_smaller(finest, requested[i]);
        coarsest = compare_larger(coarsest, requested[i]);
    }
    return coarsest > EVEN_REQUEST * finest;
}

static void count_grading(slope *s, double requested, double local)
{
    const double x = elementary_log(requested), y = elementary_log(local);
    s->n++;
    s->x += x;
    s->y += y;
    s->xx += x * x;
    s->xy += x * y;
}

/* Sums over the Voronoi cells. */
typedef struct cell_sums {
    moments edge;   /* minus 1 */
    double skipped; /* number of pairs that `edge` leaves out */
    moments area, ratio;
    slope grading;
    double regular, degrees, turn, unmeasured;
    double straight; /* areas of the cells with straight sides, over h^2 and the share of the angle */
} cell_sums;

static bool is_across_fold(const measures_input *in, const facets *f, const voronoi_side *s, double mean)
{
    const vec3 middle = vec3_scale(vec3_add(in->position[s->a], in->position[s->b]), 0.5);
    return s->middle > VORONOI_FOLD && facets_distance(f, middle) > VORONOI_FOLD * mean;
}

/* Adds a side for each of its points whose cell is not certain: certain cells have their own sums, to which each
 * side adds half. */
static void add_side(const measures_input *in, const facets *f, const voronoi_side *s, const voronoi_cells *c,
                     const point_table *t, cell_sums *out)
{
    const double distance = vec3_norm(vec3_sub(in->position[s->a], in->position[s->b])),
                 mean = 0.5 * (t->spacing[s->a] + t->spacing[s->b]);
    const bool skipped = is_across_fold(in, f, s, mean);
    const uint32_t end[2] = {s->a, s->b};
    for (int k = 0; k < 2; k++) {
        const uint32_t i = end[k];
        if (c->planar[i].certain) continue;
        if (skipped)
            out->skipped += 0.5;
        else
            count_value(&out->edge, 0.5, distance / mean - 1);
        out->straight += 0.25 * distance * s->length / (t->spacing[i] * t->spacing[i] * share_of(t, i));
    }
}

/* Replaces the areas in `local` by local spacings. */
static void sum_cells(const measures_input *in, const facets *f, const voronoi_cells *c, const point_table *t,
                      double *local, bool *regular, cell_sums *out)
{
    *out = (cell_sums){.grading = {.graded = is_graded(in->spacing, t->count)}};
    for (size_t i = 0; i < t->count; i++) {
        const double h = t->spacing[i];
        const planar_cell *own = &c->planar[i];
        regular[i] = is_regular(t, i);
        out->regular += regular[i];
        out->degrees += missing_degree(t, i);
        out->turn += (ideal_of(t, i) - (double)t->degree[i]) / 6;
        out->unmeasured += t->degree[i] < (is_on_border(t, i) ? 2u : 3u);
        count_value(&out->area, 1, c->area[i] / (h * h * share_of(t, i)));
        local[i] = local_spacing(c, t, i);
        count_value(&out->ratio, 1, local[i] / in->spacing[i]);
        if (out->grading.graded) count_grading(&out->grading, in->spacing[i], local[i]);
        out->edge.n += 0.5 * own->degree;
        out->edge.sum += 0.5 * own->edge;
        out->edge.squares += 0.5 * own->edge2;
        if (own->certain) out->straight += PLANAR_STRAIGHT + own->straight;
    }
    for (size_t k = 0; k < c->exact.side_count; k++)
        if (is_side(&c->exact.side[k], t->spacing)) add_side(in, f, &c->exact.side[k], c, t, out);
}

/* The mean of the square of how much the requested spacing grows per distance: half of it along one
 * direction. */
static bool mean_growth2(const measures_input *in, const voronoi_cells *c, const point_table *t, double *out,
                         error *e)
{
    double *sum = mem_array(t->count, sizeof *sum, what, e), total = 0;
    for (size_t k = 0; sum && k < c->exact.side_count; k++) {
        const voronoi_side *s = &c->exact.side[k];
        const double more = t->spacing[s->b] - t->spacing[s->a],
                     distance2 = vec3_norm2(vec3_sub(in->position[s->a], in->position[s->b]));
        if (!is_side(s, t->spacing) || !(distance2 > 0)) continue;
        sum[s->a] += more * more / distance2;
        sum[s->b] += more * more / distance2;
    }
    for (size_t i = 0; sum && i < t->count; i++) {
        const double growth2 = c->planar[i].certain ? c->planar[i].growth2 : sum[i];
        if (t->degree[i] > 0) total += fmin(2 * growth2 / t->degree[i], GROWTH_MOST * GROWTH_MOST);
    }
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
                 denser = elementary_pow(ordered * n / flat, 0.5 * energy_cotangent.ideal_slope);
    return (1 + energy_excess) / (turn * denser * (1 + GROWTH_ENERGY * growth2)) - 1;
}

static void conclude_grading(const cell_sums *c, measures *out)
{
    const slope *s = &c->grading;
    out->grading_cv = variation(&c->ratio, 0);
    out->grading_exponent = s->graded ? (s->xy - s->x * s->y / s->n) / (s->xx - s->x * s->x / s->n) : 1;
}

static bool conclude_cells(const measures_input *in, const facets *f, const voronoi_cells *v,
                           const point_table *t, double *local, measures *out, error *e)
{
    bool *regular = mem_array(t->count, sizeof *regular, what, e);
    cell_sums c;
    double growth2 = 0;
    if (!regular) return false;
    sum_cells(in, f, v, t, local, regular, &c);
    const double n = (double)t->count;
    const bool graded = !in->achieved && c.grading.graded;
    const bool ok = count_defects(t, regular, in->piece_euler, f->piece_count, &out->defect_share, e) &&
                    (!graded || mean_growth2(in, v, t, &growth2, e));
    free(regular);
    out->hex_fraction = c.regular / n;
    out->edge_cv = variation(&c.edge, 1);
    out->edge_skipped_share = c.skipped / (c.edge.n + c.skipped);
    out->area_cv = variation(&c.area, 0);
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
    for (size_t k = 0; k < facets_total(f); k++) {
        const facets_item item = facets_any_item(f, k);
        if (has[item.piece]) continue;
        requested[item.piece] +=
            item.area / packing_cell_area(in->spacing_at(in->spacing_context, item.centre));
    }
}

static bool conclude_pieces(const measures_input *in, const facets *f, const point_table *t, measures *out,
                            error *e)
{
    bool *has = mem_array(f->piece_count, sizeof *has, what, e);
    double *requested = has ? mem_array(f->piece_count, sizeof *requested, what, e) : NULL, empty = 0;
    for (size_t i = 0; requested && i < t->count; i++) has[piece_of(t, i)] = true;
    if (requested) count_requested(in, f, has, requested);
    for (size_t p = 0; requested && p < f->piece_count; p++) {
        if (!has[p]) out->area_without_points += f->piece_area[p];
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

/* Sets out_weight. A piece whose cells have no area gives each of its points the same weight. */
static bool set_weights(const measures_input *in, const facets *f, const voronoi_cells *c,
                        const point_table *t, error *e)
{
    double *cells = mem_array(f->piece_count, sizeof *cells, what, e);
    size_t *points = cells ? mem_array(f->piece_count, sizeof *points, what, e) : NULL;
    for (size_t i = 0; points && i < t->count; i++) {
        cells[piece_of(t, i)] += c->area[i];
        points[piece_of(t, i)]++;
    }
    for (size_t i = 0; points && i < t->count; i++) {
        const uint32_t p = piece_of(t, i);
        in->out_weight[i] =
            cells[p] > 0 ? c->area[i] * (f->piece_area[p] / cells[p]) : f->piece_area[p] / (double)points[p];
    }
    const bool ok = points != NULL;
    free(cells);
    free(points);
    return ok;
}

static sites sites_of(const measures_input *in, const point_table *t)
{
    sites s = {.count = t->count,
               .position = in->position,
               .spacing = t->spacing,
               .piece = t->piece,
               .side = t->side,
               .normal = t->normal,
               .one_sided = t->one_sided,
               .patch = t->patch,
               .patch_labels = in->patch_labels};
    for (size_t i = 0; i < t->count; i++) s.largest_spacing = fmax(s.largest_spacing, t->spacing[i]);
    return s;
}

/* Computes the cells, their areas, and with them the measures of pairs. Without a request this is done twice: the
 * cells give the spacing by which distances are then divided. */
static bool build_cells(const measures_input *in, facets *f, threads *pool, point_table *t, double *area,
                        voronoi_cells *c, measures *out, error *e)
{
    const bool by_scan = in->copy_normal && in->surface.triangle_count == 0 && !f->in.patch_piece,
               whole =
                   in->exact || !in->copy_normal || (!by_scan && f->piece_count > 1 && !f->in.patch_piece);
    if (whole && !facets_build(f, NULL, NULL, pool, e)) return false;
    if (in->achieved && !(t->own_spacing = mem_array(in->count, sizeof *t->own_spacing, what, e)))
        return false;
    if (!by_scan)
        threads_run(pool, in->count, 256, piece_chunk, &(corner_job){in, f, t});
    else if (t->piece && !facets_find_pieces(f, in->position, in->count, pool, t->piece, e))
        return false;
    for (int round = in->achieved ? 0 : 1; round < 2; round++) {
        const sites s = sites_of(in, t);
        const pair_measures_input pairs = {&s,
                                           in->h,
                                           in->sized || in->achieved,
                                           in->surface.triangle_count > 0,
                                           in->kept,
                                           t->has_odd ? t->odd : NULL};
        voronoi_cells_free(c);
        if (!voronoi_cells_build(&(voronoi_cells_input){f, whole, in->exact, area, &pairs}, pool, &t->energy,
                                 round == 1 ? out : NULL, c, e))
            return false;
        if (t->has_odd) threads_run(pool, in->count, 256, corner_chunk, &(corner_job){in, f, t});
        if (round == 0 && !take_achieved(&pairs, c, pool, t, e)) return false;
    }
    out->certain_share = (double)c->certain_count / (double)in->count;
    return true;
}

/* The largest distance of a place of each patch, and of the lost places. */
static void take_coverage(const measures_input *in, const voronoi_cells *c, const point_table *t,
                          double *farthest, measures *out)
{
    out->coverage = 0;
    for (size_t p = 0; p < in->surface.patch_count; p++) {
        farthest[p] = c->exact.farthest[p];
        out->coverage = fmax(out->coverage, farthest[p]);
    }
    for (size_t k = 0; k < in->lost_places; k++) {
        double distance;
        const uint32_t nearest = cell_list_nearest(c->near, in->lost_place[k], 0, &distance);
        out->coverage = fmax(out->coverage, distance / t->spacing[nearest]);
    }
}

static bool take(const measures_input *in, facets *f, threads *pool, point_table *t, voronoi_cells *c,
                 double *local, double *degree, double *farthest, measures *out, error *e)
{
    gather_sides(in, t);
    if (!find_odd(in, t, e) || !build_cells(in, f, pool, t, local, c, out, e)) return false;
    count_degrees(c, t);
    for (size_t i = 0; i < in->count; i++) out->cell_area += c->area[i];
    for (size_t i = 0; in->out_piece && i < in->count; i++) in->out_piece[i] = piece_of(t, i);
    if (in->out_spacing) memcpy(in->out_spacing, t->spacing, in->count * sizeof *t->spacing);
    for (size_t i = 0; degree && i < in->count; i++) degree[i] = t->degree[i];
    take_coverage(in, c, t, farthest, out);
    out->missing_share = c->exact.missing / f->area;
    double energy = t->energy.plain;
    for (size_t i = 0; t->has_odd && i < in->count; i++) energy += t->energy.odd[i] / (t->ideal[i] / 6);
    out->energy_excess = energy / (double)in->count - 1;
    if (in->out_weight && !set_weights(in, f, c, t, e)) return false;
    return conclude_pieces(in, f, t, out, e) && conclude_cells(in, f, c, t, local, out, e);
}

bool measures_take(const measures_input *in, threads *pool, double *local, double *degree, double *farthest,
                   measures *out, error *e)
{
    facets f = {0};
    point_table t = {0};
    voronoi_cells c = {0};
    measures made = {0};
    const bool ok = facets_open(&in->surface, &f, e) && allocate_table(in, f.piece_count, &t, e) &&
                    take(in, &f, pool, &t, &c, local, degree, farthest, &made, e);
    voronoi_cells_free(&c);
    free_table(&t);
    facets_free(&f);
    if (ok) *out = made;
    return ok && threads_may_go_on(pool, e);
}
