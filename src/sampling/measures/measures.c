// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/measures.h"

#include <math.h>
#include <stdlib.h>
#include <stdio.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/projection.h"
#include "sampling/measures/pair_measures.h"
#include "sampling/measures/planar_cells.h"
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

/* A place may belong to the cell of a point that is farther than the nearest one by this, in the largest
 * spacing: the nearest one may be of an opposite wall. */
static const double NEEDED_BEYOND = 0.7;
/* Relative difference between the area of a piece and that of its cells which the bend of the surface between
 * the points explains. */
static const double AREA_TOLERANCE = 1e-3;

static void dbg(const char *w)
{
    if (!getenv("HEXAD_MEASURE_DEBUG")) return;
    FILE *f = fopen("/proc/self/status", "r");
    char line[200];
    while (fgets(line, sizeof line, f))
        if (!strncmp(line, "VmHWM", 5) || !strncmp(line, "VmRSS", 5)) fprintf(stderr, "certain %s %s", w, line);
    fclose(f);
}
static const char what[] = "the measures of the points";

/* Data of each point. */
typedef struct point_table {
    size_t count;
    double *spacing; /* h at each */
    float *ideal; /* angle of the surface over 60 degrees, one more on a border; 2 k + 2 on an edge of k > 2
                   * faces */
    float *share; /* angle of the surface over a full turn */
    bool *border, *fork;
    uint32_t *degree;
    uint32_t *piece;
    uint32_t *side; /* see sites.h */
    const vec3 *normal; /* of each copy; the input's, or `own_normal` */
    vec3 *own_normal;
    bool *one_sided;
    uint32_t *patch; /* per normal */
    bool *at_wedge;
    uint8_t *odd;   /* not 0: not plain (planar_cells.h) */
    float *energy;  /* over that of a point in an ideal packing */
    bool is_odd;    /* of one of the points */
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
    free(t->own_normal);
    free(t->one_sided);
    free(t->patch);
    free(t->at_wedge);
    free(t->odd);
    free(t->energy);
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
    const bool given = in->copy_normal && !in->copy_point; /* in the order of the points */
    if (!given) t->own_normal = mem_array(in->copy_count, sizeof *t->own_normal, what, e);
    t->normal = given ? in->copy_normal : t->own_normal;
    t->one_sided = mem_array(in->copy_count, sizeof *t->one_sided, what, e);
    t->patch = mem_array(in->copy_count, sizeof *t->patch, what, e);
    t->at_wedge = mem_array(n, sizeof *t->at_wedge, what, e);
    t->odd = mem_array(n, sizeof *t->odd, what, e);
    t->energy = mem_array(n, sizeof *t->energy, what, e);
    return t->spacing && t->ideal && t->share && t->border && t->fork && t->degree && t->piece && t->side &&
           t->normal && t->one_sided && t->patch && t->at_wedge && t->odd && t->energy;
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
    sites_gather(&copies, t->count, t->side, t->own_normal, t->one_sided, t->patch);
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
    t->share[i] = (float)(angle / (2 * M_PI));
    t->border[i] = c.border;
    t->fork[i] = c.fork;
    t->ideal[i] = (float)(c.fork ? 2 * angle / M_PI + 2 : angle / (M_PI / 3) + c.border);
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
    t->own_normal[t->side[i]] = triangle[0].normal;
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

/* Points whose cells a border, a curve or another patch can bound. */
static void find_odd(const measures_input *in, point_table *t)
{
    const field *of = in->surface.triangle_count == 0 ? in->surface.scan->field : NULL;
    for (size_t k = 0; k < in->copy_count; k++)
        t->odd[point_of(in, k)] |= has_flag(in, k, PACKING_FIXED | PACKING_ONE_SIDED | PACKING_AT_WEDGE);
    for (size_t i = 0; i < in->count; i++)
        t->odd[i] |= t->side[i + 1] != t->side[i] + 1 ||
                     (of && of->open &&
                      packing_is_near_boundary(of->boundary_box, in->position[i], in->spacing[i]));
    for (size_t i = 0; i < in->count; i++) t->is_odd |= t->odd[i] != 0;
}

/* The Voronoi diagram: the certain cells, and the others. */
typedef struct diagram {
    planar_cells cells;
    restricted_voronoi others;
    const voronoi_side *side; /* of all cells, once they are gathered */
    size_t side_count;
    size_t certain;    /* number of certain cells */
    bool whole;        /* the hierarchy contains the whole surface */
    vec3 *uncertain;   /* the points whose cells are not certain */
    cell_list *wanted; /* of these; NULL if they are all points, or none */
} diagram;

static void free_diagram(diagram *d)
{
    restricted_voronoi_free(&d->others);
    planar_cells_free(&d->cells);
    cell_list_free(d->wanted);
    free(d->uncertain);
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

static void count_degrees(const diagram *d, point_table *t)
{
    memset(t->degree, 0, t->count * sizeof *t->degree);
    for (size_t k = 0; k < d->side_count; k++) {
        if (!is_side(&d->side[k], t->spacing)) continue;
        t->degree[d->side[k].a]++;
        t->degree[d->side[k].b]++;
    }
}

static double local_spacing(const diagram *d, const point_table *t, size_t i)
{
    return d->others.area[i] > 0 ? packing_spacing(d->others.area[i] / t->share[i], 1) : t->spacing[i];
}

/* Without a request: the mean local spacing of each point and its neighbours. */
static bool take_achieved(const diagram *d, point_table *t, error *e)
{
    double *sum = mem_array(t->count, sizeof *sum, what, e);
    if (!sum) return false;
    for (size_t i = 0; i < t->count; i++) sum[i] = local_spacing(d, t, i);
    count_degrees(d, t);
    double *out = mem_array(t->count, sizeof *out, what, e);
    for (size_t i = 0; out && i < t->count; i++) out[i] = sum[i];
    for (size_t k = 0; out && k < d->side_count; k++) {
        if (!is_side(&d->side[k], t->spacing)) continue;
        out[d->side[k].a] += sum[d->side[k].b];
        out[d->side[k].b] += sum[d->side[k].a];
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

static void sum_cells(const measures_input *in, const diagram *d, const point_table *t,
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
        count_value(&out->area, d->others.area[i] / (h * h * t->share[i]));
        count_value(&out->ratio, local[i] / in->spacing[i]);
        count_grading(&out->grading, in->spacing[i], local[i]);
    }
    for (size_t k = 0; k < d->side_count; k++) {
        const voronoi_side *s = &d->side[k];
        if (!is_side(s, t->spacing)) continue;
        const double distance = vec3_norm(vec3_sub(in->position[s->a], in->position[s->b]));
        count_value(&out->edge, distance / (0.5 * (t->spacing[s->a] + t->spacing[s->b])));
        out->straight += 0.25 * distance * s->length / (t->spacing[s->a] * t->spacing[s->a] * t->share[s->a]);
        out->straight += 0.25 * distance * s->length / (t->spacing[s->b] * t->spacing[s->b] * t->share[s->b]);
    }
}

/* The mean of the square of how much the requested spacing grows per distance: half of it along one
 * direction. */
static bool mean_growth2(const measures_input *in, const diagram *d, const point_table *t,
                         double *out, error *e)
{
    double *sum = mem_array(t->count, sizeof *sum, what, e), total = 0;
    for (size_t k = 0; sum && k < d->side_count; k++) {
        const voronoi_side *s = &d->side[k];
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

static bool conclude_cells(const measures_input *in, const diagram *d, const point_table *t,
                           const double *local, size_t pieces, measures *out, error *e)
{
    bool *regular = mem_array(t->count, sizeof *regular, what, e);
    cell_sums c;
    double growth2 = 0;
    if (!regular) return false;
    sum_cells(in, d, t, local, regular, &c);
    const double n = (double)t->count;
    const bool graded = !in->achieved && c.grading.coarsest > EVEN_REQUEST * c.grading.finest;
    const bool ok = count_defects(t, regular, pieces, &out->defect_share, e) &&
                    (!graded || mean_growth2(in, d, t, &growth2, e));
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
    for (size_t k = 0; k < facets_total(f); k++) {
        uint32_t piece;
        const facets_item item = facets_any_item(f, k, &piece);
        if (has[piece]) continue;
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

/* The cells that are to be computed, and the points by which they are bounded. */
typedef struct needed {
    voronoi_wanted wanted;
    const cell_list *near;
} needed;

static bool is_needed(const void *context, vec3 centre, double radius)
{
    const needed *n = context;
    return voronoi_reaches(&n->wanted, n->near, centre, radius);
}

/* Lists the points whose cells are not certain. */
static bool list_uncertain(const measures_input *in, threads *pool, diagram *d, error *e)
{
    const planar_cells *c = &d->cells;
    d->certain = 0;
    for (size_t i = 0; i < c->count; i++) d->certain += c->certain[i];
    cell_list_free(d->wanted);
    free(d->uncertain);
    d->wanted = NULL;
    d->uncertain = NULL;
    if (d->certain == 0 || d->certain == c->count) return true;
    d->uncertain = mem_array(c->count - d->certain, sizeof *d->uncertain, what, e);
    if (!d->uncertain) return false;
    for (size_t i = 0, k = 0; i < c->count; i++)
        if (!c->certain[i]) d->uncertain[k++] = in->position[i];
    d->wanted = cell_list_new(d->uncertain, c->count - d->certain, pool, e);
    return d->wanted != NULL;
}

static voronoi_wanted wanted_of(const diagram *d, const sites *s)
{
    return (voronoi_wanted){d->certain > 0 ? d->cells.certain : NULL, d->wanted, NEEDED_BEYOND * s->largest_spacing};
}

/* Computes the cells that are not certain, and adds the certain ones to the result. */
static bool build_others(const measures_input *in, facets *f, const cell_list *near, threads *pool,
                         const point_table *t, diagram *d, error *e)
{
    const sites s = sites_of(in, t, near);
    const planar_cells *c = &d->cells;
    const voronoi_wanted wanted = wanted_of(d, &s);
    restricted_voronoi_free(&d->others);
    if (!restricted_voronoi_build(f, &s, &wanted, pool, &d->others, e)) return false;
    for (size_t i = 0; i < c->count; i++) {
        if (!c->certain[i]) continue;
        double *farthest = &d->others.farthest[t->patch[t->side[i]]];
        d->others.area[i] = c->area[i];
        *farthest = fmax(*farthest, c->farthest[i] / t->spacing[i]);
    }
    return true;
}

/* Withdraws the certain cells of pieces whose cells do not add up to their area: parts of these have no points,
 * or bend between the points. Returns whether there are any. */
static double debug_ratio;
static bool find_lost_area(const facets *f, const point_table *t, diagram *d, double *sum)
{
    bool lost = false;
    for (size_t i = 0; i < t->count; i++) sum[t->piece[i]] += d->others.area[i];
    debug_ratio = sum[0] / f->piece_area[0];
    for (size_t i = 0; i < t->count; i++) {
        const double area = f->piece_area[t->piece[i]];
        if (!d->cells.certain[i] || fabs(sum[t->piece[i]] - area) <= (getenv("XTOL") ? atof(getenv("XTOL")) : AREA_TOLERANCE) * area) continue;
        d->cells.certain[i] = false;
        lost = true;
    }
    return lost;
}

/* Computes the hierarchy that the cells need which are not certain, what the surface is like at the points, and
 * these cells. */
static bool complete_diagram(const measures_input *in, facets *f, const cell_list *near, threads *pool,
                             point_table *t, diagram *d, error *e)
{
    const sites s = sites_of(in, t, near);
    if (!list_uncertain(in, pool, d, e)) return false;
    const needed need = {wanted_of(d, &s), near};
    if (!d->whole && d->certain < in->count && !facets_build(f, d->wanted ? is_needed : NULL, &need, pool, e))
        return false;
    d->whole |= d->certain == 0;
    threads_run(pool, in->count, 256, corner_chunk, &(corner_job){in, f, t});
    return build_others(in, f, near, pool, t, d, e);
}

static pair_measures_input pairs_of(const measures_input *in, const facets *f, const point_table *t, const sites *s)
{
    return (pair_measures_input){s, in->h, in->sized || in->achieved, t->at_wedge, in->kept, t->is_odd ? t->odd : NULL,
                                 f->piece_count > 1};
}

/* The cells, and with them the measures of pairs, from the same neighbour lists. Without a request the spacing
 * by which distances are divided follows from the cells. */
static bool build_diagram(const measures_input *in, facets *f, const cell_list *near, threads *pool,
                          point_table *t, diagram *d, measures *out, error *e)
{
    const sites s = sites_of(in, t, near);
    double *sum = mem_array(f->piece_count, sizeof *sum, what, e);
    find_odd(in, t);
    const pair_measures_input pairs = pairs_of(in, f, t, &s);
    dbg("table");
    bool ok = sum && planar_cells_new(in->count, &d->cells, e) &&
              pair_measures_take(&pairs, pool, in->exact || getenv("XEXACT") ? NULL : &d->cells, t->energy, in->achieved ? NULL : out, e) &&
              complete_diagram(in, f, near, pool, t, d, e);
    dbg("cells");
    if (ok && find_lost_area(f, t, d, sum)) ok = complete_diagram(in, f, near, pool, t, d, e);
    free(sum);
    return ok;
}

/* The sides of all cells. Sides of certain cells are followed by those of others, in the same array. */
static bool gather_voronoi_sides(diagram *d, error *e)
{
    planar_cells *c = &d->cells;
    d->side = d->others.side;
    d->side_count = d->others.side_count;
    if (d->certain == 0) return true;
    planar_cells_keep_certain(c);
    if (!planar_cells_reserve(c, d->others.side_count, e)) return false;
    memcpy(c->side + c->side_count, d->others.side, d->others.side_count * sizeof *c->side);
    d->side = c->side;
    d->side_count += c->side_count;
    return true;
}

static bool take(const measures_input *in, facets *f, const cell_list *near, threads *pool, point_table *t,
                 diagram *d, double *local, double *degree, double *farthest, measures *out, error *e)
{
    dbg("begin");
    memcpy(t->spacing, in->spacing, in->count * sizeof *t->spacing);
    gather_sides(in, t);
    d->whole = in->exact || getenv("XEXACT") || !in->copy_normal || (f->piece_count > 1 && !f->in.patch_piece);
    if (d->whole && !facets_build(f, NULL, NULL, pool, e)) return false;
    threads_run(pool, in->count, 256, piece_chunk, &(corner_job){in, f, t});
    if (!build_diagram(in, f, near, pool, t, d, out, e) || !gather_voronoi_sides(d, e)) return false;
    dbg("built");
    if (in->achieved) {
        if (!take_achieved(d, t, e)) return false;
        const sites s = sites_of(in, t, near);
        const pair_measures_input pairs = pairs_of(in, f, t, &s);
        if (!build_others(in, f, near, pool, t, d, e) || !gather_voronoi_sides(d, e) ||
            !pair_measures_take(&pairs, pool, NULL, t->energy, out, e))
            return false;
    }
    out->certain_share = (double)d->certain / (double)in->count;
    if (getenv("HEXAD_MEASURE_DEBUG")) fprintf(stderr, "certain %.5f items %zu of %zu area sum/area %.7f\n", out->certain_share, f->item_count, facets_total(f), debug_ratio);
    count_degrees(d, t);
    for (size_t i = 0; i < in->count; i++) local[i] = local_spacing(d, t, i);
    if (in->out_piece) memcpy(in->out_piece, t->piece, in->count * sizeof *t->piece);
    if (in->out_spacing) memcpy(in->out_spacing, t->spacing, in->count * sizeof *t->spacing);
    for (size_t i = 0; degree && i < in->count; i++) degree[i] = t->degree[i];
    out->coverage = 0;
    for (size_t p = 0; p < in->surface.patch_count; p++) {
        farthest[p] = d->others.farthest[p];
        out->coverage = fmax(out->coverage, d->others.farthest[p]);
    }
    for (size_t k = 0; k < in->lost_places; k++) {
        double distance;
        const uint32_t nearest = cell_list_nearest(near, in->lost_place[k], 0, &distance);
        out->coverage = fmax(out->coverage, distance / t->spacing[nearest]);
    }
    out->missing_share = d->others.missing / f->area;
    double energy = 0;
    for (size_t i = 0; i < in->count; i++) energy += t->energy[i] / (t->ideal[i] / 6);
    out->energy_excess = energy / (double)in->count - 1;
    return conclude_pieces(in, f, t, out, e) && conclude_cells(in, d, t, local, f->piece_count, out, e);
}

bool measures_take(const measures_input *in, threads *pool, double *local, double *degree, double *farthest,
                   measures *out, error *e)
{
    facets f = {0};
    point_table t = {0};
    diagram d = {0};
    measures made = {0};
    cell_list *near = cell_list_new(in->position, in->count, pool, e);
    const bool ok = near && facets_open(&in->surface, &f, e) && allocate_table(in, &t, e) &&
                    take(in, &f, near, pool, &t, &d, local, degree, farthest, &made, e);
    free_diagram(&d);
    free_table(&t);
    facets_free(&f);
    cell_list_free(near);
    if (ok) *out = made;
    return ok && (!threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped"));
}
