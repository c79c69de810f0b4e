// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/restricted_voronoi.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "sampling/measures/coverage_search.h"

/* The hierarchy is divided into subtrees, the units of parallel work: at least this number, about one for
 * each POINTS_OF_TASK points but at most TASKS. It does not depend on the number of threads. */
enum { TASKS = 512, POINTS_OF_TASK = 1000 };
/* Tasks per thread whose records are in memory at the same time. */
enum { TASKS_OF_THREAD = 4 };
/* At one item for each POINTS_OF_PROBE points, distances are bounded from below before the tasks start. */
enum { POINTS_OF_PROBE = 4 };
/* A triangle with more candidates is divided at its longest edge before it is clipped: the cost of clipping
 * is quadratic in their number. */
enum { MOST_CANDIDATES = 12 };
/* Parts shorter than this, in spacings, are not divided further: their sides are too short to count. */
static const double LEAST_PART = 1e-6;
/* Candidates are collected for nodes of at most this radius in spacings, and for parts of triangles whose edges are at
 * most twice as long. Parts of a scan have their corners on the surface. With 2, areas of single cells are wrong by up to
 * half of their size where grid cells are larger than the spacing. */
static const double SMALL = 1;
/* The same for parts of triangles, as a fraction of the distance of the nearest point. Larger: more candidates. */
static const double SMALL_OF_DISTANCE = 0.5;
/* A large triangle of a mesh whose edges are longer than its shortest edge by this factor is divided across its
 * length. Smaller: triangles that are nearly equilateral get thin parts. */
static const double LEAST_ELONGATION = 3;
/* Candidates are the points within COLLECTED spacings beyond the nearest one. If these are on an opposite
 * wall, a triangle collects those within FARTHEST_SITE spacings; beyond, it belongs to no cell. */
static const double COLLECTED = 0.7, FARTHEST_SITE = 8;
/* Maximum corners of a clipped triangle: three, one for each bisector, and one for each face of a domain. */
enum { MOST_CORNERS = 3 + MOST_CANDIDATES + 6 };
/* Cells with less than this fraction of a triangle are rounding errors. */
static const double LEAST_AREA = 1e-13;
/* Distances are compared with this relative margin, so that rounding discards no candidate. */
static const double MARGIN = 1e-9;
/* No place of a certain cell is farther from its point than its farthest corner times this. A smaller value withdraws
 * cells where coarse triangles replace a smooth surface. */
static const double CERTAIN_MARGIN = 1.1;
/* Marks an edge of the triangle itself, instead of the index of the point beyond a bisector. */
#define NO_SITE UINT32_MAX

static const char what[] = "the measures of the surface";

/* ---- records of one task; they are summed in the order of the tasks */

typedef struct area_record {
    uint32_t site;
    double area;
} area_record;

/* A range of candidates on the stack. It contains all points that may be nearest to a place of the node,
 * provided that they are within `complete` of the node's centre. */
typedef struct candidates {
    size_t first, count;
    double complete;
} candidates;

typedef struct task {
    uint32_t node;
    area_record *area;
    size_t area_count, area_room;
    voronoi_side *side;
    size_t side_count, side_room;
    uint32_t *exceeded; /* certain cells, also more than once */
    size_t exceeded_count, exceeded_room;
    double missing;
    bool failed;
    error why;
} task;

typedef struct build_job {
    const facets *f;
    const sites *s;
    const voronoi_wanted *wanted;
    size_t cells; /* to be computed */
    task *task;
    double *farthest;    /* per worker and patch: maximum of the current task; behind them, the maximum of
                          * all its tasks */
    const double *known; /* per patch: a lower bound */
    bool *has_points;    /* per piece */
} build_job;

/* Squared distance of a site from each corner. */
typedef struct corner_distances {
    double of[3];
} corner_distances;

/* State of the descent of one task. */
typedef struct descent {
    const facets *f;
    const sites *s;
    const planar_cell *known; /* see voronoi_wanted */
    const voronoi_wanted *wanted;
    const bool *has_points;
    task *to;
    double *farthest; /* per patch */
    uint32_t *list;   /* stack of candidates */
    corner_distances
        *square; /* per candidate: squared distances from the corners of the part for which it was pushed */
    size_t top, room;
} descent;

static bool fail(task *t)
{
    t->failed = true;
    return false;
}

static bool reserve(descent *d, size_t count)
{
    if (d->top + count <= d->room) return true;
    size_t room = 2 * (d->top + count);
    uint32_t *list = mem_array(room, sizeof *list, what, &d->to->why);
    corner_distances *square = mem_array(room, sizeof *square, what, &d->to->why);
    if (!list || !square) {
        free(list);
        free(square);
        return fail(d->to);
    }
    if (d->top > 0) {
        memcpy(list, d->list, d->top * sizeof *list);
        memcpy(square, d->square, d->top * sizeof *square);
    }
    free(d->list);
    free(d->square);
    d->list = list;
    d->square = square;
    d->room = room;
    return true;
}

static bool add_area(descent *d, uint32_t site, double area)
{
    task *t = d->to;
    if (t->area_count > 0 && t->area[t->area_count - 1].site == site) {
        t->area[t->area_count - 1].area += area;
        return true;
    }
    if (!MEM_GROW(t->area, t->area_count, &t->area_room, what, &t->why)) return fail(t);
    t->area[t->area_count++] = (area_record){site, area};
    return true;
}

/* Whether a cell is not to be computed. */
static bool is_done(const planar_cell *known, uint32_t site)
{
    return known && (known[site].certain || known[site].measured);
}

/* The distance of a line from the middle of the straight line between a site and the one behind; see voronoi_side. The
 * ends of the line are relative to the site. */
static float distance_of_middle(const sites *s, uint32_t site, uint32_t behind, vec3 from, vec3 to)
{
    const vec3 half = vec3_scale(vec3_sub(s->position[behind], s->position[site]), 0.5),
               along = vec3_sub(to, from), towards = vec3_sub(half, from);
    const double mean = 0.5 * (s->spacing[site] + s->spacing[behind]), length2 = vec3_norm2(along);
    if (4 * vec3_norm2(half) <= VORONOI_FOLD_LINE * VORONOI_FOLD_LINE * mean * mean) return 0;
    const double t = length2 > 0 ? fmin(fmax(vec3_dot(towards, along) / length2, 0), 1) : 0;
    return (float)(vec3_norm(vec3_axpy(-t, along, towards)) / mean);
}

/* Adds a side of the cell of `site`, unless it is added for the cell behind it. */
static bool add_side(descent *d, uint32_t site, uint32_t behind, double length, float middle)
{
    task *t = d->to;
    if (d->known && d->known[behind].measured) return true;
    if (behind < site && !is_done(d->known, behind)) return true;
    const uint32_t a = behind < site ? behind : site, b = behind < site ? site : behind;
    if (!MEM_GROW(t->side, t->side_count, &t->side_room, what, &t->why)) return fail(t);
    t->side[t->side_count++] = (voronoi_side){a, b, length, middle};
    return true;
}

/* Records a certain cell if it contains a place that is too far from its point, or that is on a side with a point
 * whose normal differs too much. `square`: of the distance; `behind`: the point of the side, or NO_SITE. */
static bool check_certain(descent *d, uint32_t site, double square, uint32_t behind)
{
    task *t = d->to;
    if (!d->known || !d->known[site].certain) return true;
    const double most = CERTAIN_MARGIN * (double)d->known[site].farthest;
    if (square <= most * most &&
        (behind == NO_SITE || sites_facing_pair(d->s, site, behind) >= PLANAR_CELLS_COSINE))
        return true;
    if (t->exceeded_count > 0 && t->exceeded[t->exceeded_count - 1] == site) return true;
    if (!MEM_GROW(t->exceeded, t->exceeded_count, &t->exceeded_room, what, &t->why)) return fail(t);
    t->exceeded[t->exceeded_count++] = site;
    return true;
}

/* Whether there are candidates from `base` on, and the cells of all of them are known. */
static bool is_known(const descent *d, size_t base, size_t count)
{
    bool known = d->known && count > 0;
    for (size_t k = base; known && k < base + count; k++) known = is_done(d->known, d->list[k]);
    return known;
}

/* ---- candidates of a node */

typedef enum facing { FACING_NONE, FACING_SOME, FACING_ALL } facing;

/* Thresholds for the cosine between a node's axis and a normal. */
typedef struct node_facing {
    vec3 axis;
    double none, all; /* below `none`: the normal faces no item; above `all`: it faces all items */
    uint32_t patch;
} node_facing;

static node_facing facing_of_node(const facets_node *n)
{
    const double limit = elementary_acos(SITES_OPPOSITE), wide = n->angle;
    return (node_facing){vec3_make(n->axis[0], n->axis[1], n->axis[2]),
                         limit + wide < M_PI ? elementary_cos(limit + wide) : -2,
                         limit - wide > 0 ? elementary_cos(limit - wide) : 2, n->patch};
}

static facing facing_at_node(const sites *s, const node_facing *n, uint32_t i)
{
    facing best = FACING_NONE;
    if (s->patch_labels && n->patch == FACETS_MIXED) return FACING_SOME;
    for (uint32_t k = sites_first(s, i); k < sites_end(s, i); k++) {
        if (sites_is_one_sided(s, k)) return FACING_ALL;
        const double c = sites_cosine(s, k, n->axis, n->patch == FACETS_MIXED ? sites_patch(s, k) : n->patch);
        if (c > n->all) return FACING_ALL;
        if (c >= n->none) best = FACING_SOME;
    }
    return best;
}

/* Pushes the candidates of a node, selected from those of its parent. *certain: each of them faces all
 * items. False: out of memory. */
static bool choose_candidates(descent *d, const facets_node *n, const candidates *from, vec3 from_centre,
                              candidates *out, bool *certain)
{
    const sites *s = d->s;
    const node_facing thresholds = facing_of_node(n);
    double facing_all = INFINITY, any = INFINITY;
    if (!reserve(d, from->count)) return false;
    uint32_t *list = d->list + d->top, *const given = d->list + from->first;
    size_t kept = 0;
    *certain = n->piece != FACETS_MIXED;
    for (size_t k = 0; k < from->count; k++) {
        const uint32_t i = given[k];
        if (n->piece != FACETS_MIXED && sites_piece(s, i) != n->piece) continue;
        const double distance = vec3_norm(vec3_sub(s->position[i], n->centre));
        if (distance > facing_all + 2 * n->radius) continue;
        const facing at = facing_at_node(s, &thresholds, i);
        if (at == FACING_NONE) continue;
        list[kept++] = i;
        *certain &= at == FACING_ALL;
        any = fmin(any, distance + COLLECTED * s->spacing[i]);
        if (at == FACING_ALL && n->piece != FACETS_MIXED) facing_all = fmin(facing_all, distance);
    }
    const double reach = (fmin(facing_all, any) + 2 * n->radius) * (1 + MARGIN), reach2 = reach * reach;
    *out = (candidates){d->top, 0, facing_all <= any ? INFINITY : reach};
    out->complete = fmin(out->complete, from->complete - vec3_norm(vec3_sub(n->centre, from_centre)));
    for (size_t k = 0; k < kept; k++)
        if (vec3_norm2(vec3_sub(s->position[list[k]], n->centre)) <= reach2) list[out->count++] = list[k];
    d->top += out->count;
    return true;
}

/* ---- polygons */

typedef struct polygon {
    int count;
    vec3 corner[MOST_CORNERS]; /* relative to the site */
    uint32_t
        behind[MOST_CORNERS]; /* behind[k]: the site beyond the bisector that contains the edge from corner
                               * k, or NO_SITE */
} polygon;

/* Keeps the part of the polygon with dot(normal, x) <= offset. */
static void clip(polygon *p, vec3 normal, double offset, uint32_t site)
{
    double height[MOST_CORNERS];
    bool cut = false;
    for (int k = 0; k < p->count; k++) {
        height[k] = vec3_dot(normal, p->corner[k]) - offset;
        cut |= height[k] > 0;
    }
    if (!cut) return;
    polygon out;
    out.count = 0;
    for (int k = 0; k < p->count; k++) {
        const int next = k + 1 < p->count ? k + 1 : 0;
        const bool in = height[k] <= 0, next_in = height[next] <= 0;
        if (in) {
            out.corner[out.count] = p->corner[k];
            out.behind[out.count++] = p->behind[k];
        }
        if (in == next_in) continue;
        const double t = height[k] / (height[k] - height[next]);
        out.corner[out.count] = vec3_axpy(t, vec3_sub(p->corner[next], p->corner[k]), p->corner[k]);
        out.behind[out.count++] = in ? site : p->behind[k];
    }
    p->count = out.count;
    memcpy(p->corner, out.corner, (size_t)out.count * sizeof *out.corner);
    memcpy(p->behind, out.behind, (size_t)out.count * sizeof *out.behind);
}

static double polygon_area(const polygon *p)
{
    vec3 sum = {0, 0, 0};
    for (int k = 2; k < p->count; k++)
        sum = vec3_add(
            sum, vec3_cross(vec3_sub(p->corner[k - 1], p->corner[0]), vec3_sub(p->corner[k], p->corner[0])));
    return 0.5 * vec3_norm(sum);
}

/* A triangle of the surface, or a part of one. */
typedef struct part {
    vec3 corner[3];
    const facet *of;
    double stretch; /* see facet; 1 if its corners were moved onto the surface */
} part;

/* Clips by the faces of the domain that cut the surface. */
static void clip_by_domain(const descent *d, const part *t, vec3 origin, polygon *p)
{
    const field *f = d->f->in.triangle_count == 0 ? d->f->in.scan->field : NULL;
    if (!f || !f->open) return;
    bool inside = true;
    for (int k = 0; k < 3; k++) inside &= bbox_contains(f->boundary_box, t->corner[k]);
    for (int axis = 0; !inside && axis < 3; axis++) {
        vec3 n = {0, 0, 0};
        vec3_set(&n, axis, 1);
        const double low = vec3_get(f->boundary_box.min, axis), high = vec3_get(f->boundary_box.max, axis),
                     at = vec3_get(origin, axis);
        if (isfinite(high)) clip(p, n, high - at, NO_SITE);
        if (isfinite(low)) clip(p, vec3_scale(n, -1), at - low, NO_SITE);
    }
}

static void whole_part(const descent *d, const part *t, vec3 origin, polygon *p)
{
    p->count = 3;
    for (int k = 0; k < 3; k++) {
        p->corner[k] = vec3_sub(t->corner[k], origin);
        p->behind[k] = NO_SITE;
    }
    clip_by_domain(d, t, origin, p);
}

/* ---- distances */

static double distance_at(const sites *s, vec3 x)
{
    double distance;
    const uint32_t nearest = cell_list_nearest(s->near, x, 0, &distance);
    return distance / s->spacing[nearest];
}

/* Raises *known to the distance of the surface place of x. It is computed only if the distance of x itself
 * exceeds *known: points lie on the surface, and x beside it, so that the surface place is not farther. */
static void raise_to_place(const descent *d, const facet *of, vec3 x, double *known)
{
    if (distance_at(d->s, x) > *known) *known = fmax(*known, distance_at(d->s, facets_onto(d->f, of, x)));
}

static void search_polygon(descent *d, const polygon *p, vec3 origin, const facet *of, double *farthest,
                           bool missing)
{
    for (int k = 2; k < p->count; k++) {
        const vec3 c[3] = {vec3_add(p->corner[0], origin), vec3_add(p->corner[k - 1], origin),
                           vec3_add(p->corner[k], origin)};
        *farthest = coverage_search_farthest(d->f, d->s, c, of, *farthest);
        if (missing) d->to->missing += coverage_search_missing(d->f, d->s, c, of);
    }
}

/* Updates the largest distance for a polygon of the cell of `site`. It is at a corner to which no other
 * point is nearer. */
static void measure_distances(descent *d, const polygon *p, uint32_t site, const facet *of)
{
    double *farthest = &d->farthest[of->patch];
    const vec3 origin = d->s->position[site];
    const double h = d->s->spacing[site];
    double most = 0;
    for (int k = 0; k < p->count; k++) {
        const double own = vec3_norm(p->corner[k]) / h;
        most = own > most ? own : most;
        if (own > *farthest) raise_to_place(d, of, vec3_add(p->corner[k], origin), farthest);
    }
    if (most * (1 - MARGIN) > *farthest || most > COVERAGE_MISSING)
        search_polygon(d, p, origin, of, farthest, most > COVERAGE_MISSING);
}

/* ---- triangles */

/* The number of corners that are nearer to one site than to the other. */
static int nearer_corners(const corner_distances *one, const corner_distances *other)
{
    return (one->of[0] < other->of[0]) + (one->of[1] < other->of[1]) + (one->of[2] < other->of[2]);
}

/* Whether two sites have equal distances from all corners, and thus from every place of the triangle: the
 * first of them then gets the places. */
static bool is_same(const corner_distances *a, const corner_distances *b)
{
    return a->of[0] == b->of[0] && a->of[1] == b->of[1] && a->of[2] == b->of[2];
}

/* Computes the part of the triangle in the cell of candidate `own` (of `count`, from `base`). False: it is
 * empty. */
static bool cell_part(const descent *d, const part *t, size_t base, size_t count, size_t own, polygon *p)
{
    const uint32_t *list = d->list + base, site = list[own];
    const corner_distances *square = d->square + base;
    const vec3 origin = d->s->position[site];
    for (size_t k = 0; k < count; k++)
        if (nearer_corners(&square[k], &square[own]) == 3 ||
            (list[k] < site && is_same(&square[k], &square[own])))
            return false;
    whole_part(d, t, origin, p);
    for (size_t k = 0; k < count && p->count > 0; k++) {
        const vec3 to = vec3_sub(d->s->position[list[k]], origin);
        if (k != own && nearer_corners(&square[k], &square[own]) > 0)
            clip(p, to, 0.5 * vec3_norm2(to), list[k]);
    }
    return p->count > 0;
}

static bool is_equally_far(const corner_distances *a, const corner_distances *b, int c)
{
    return fabs(a->of[c] - b->of[c]) <= MARGIN * (a->of[c] + b->of[c]);
}

/* The number of corners at equal distances from two sites. */
static int equal_corners(const corner_distances *a, const corner_distances *b)
{
    int count = 0;
    for (int c = 0; c < 3; c++) count += is_equally_far(a, b, c);
    return count;
}

static bool has_own_edge(const polygon *p)
{
    bool found = false;
    for (int c = 0; c < p->count; c++) found |= p->behind[c] == NO_SITE;
    return found;
}

/* Marks the sides of a cell on edges of the triangle or part that lie in a bisector, where clipping cut
 * nothing off. */
static void mark_sides_on_edges(const descent *d, size_t base, size_t count, size_t own, polygon *p)
{
    const uint32_t *list = d->list + base;
    const corner_distances *square = d->square + base;
    if (!has_own_edge(p)) return;
    for (size_t k = 0; k < count; k++) {
        if (k == own || equal_corners(&square[k], &square[own]) != 2) continue;
        const vec3 to = vec3_sub(d->s->position[list[k]], d->s->position[list[own]]);
        const double half = 0.5 * vec3_norm2(to), least = half * (1 - MARGIN);
        for (int c = 0; c < p->count; c++)
            if (p->behind[c] == NO_SITE && vec3_dot(to, p->corner[c]) >= least &&
                vec3_dot(to, p->corner[c + 1 < p->count ? c + 1 : 0]) >= least)
                p->behind[c] = list[k];
    }
}

static bool clip_cell(descent *d, const part *t, size_t base, size_t count, size_t own)
{
    const uint32_t site = d->list[base + own];
    polygon p;
    if (is_done(d->known, site)) return true;
    if (!cell_part(d, t, base, count, own, &p)) return true;
    mark_sides_on_edges(d, base, count, own, &p);
    const double area = polygon_area(&p), stretch = t->stretch;
    if (area <= LEAST_AREA * t->of->area)
        return true; /* the edge lies in a bisector: the adjacent triangle has the side */
    if (!add_area(d, site, stretch * stretch * area)) return false;
    for (int k = 0; k < p.count; k++) {
        if (p.behind[k] == NO_SITE) continue;
        const vec3 from = p.corner[k], to = p.corner[k + 1 < p.count ? k + 1 : 0];
        if (!add_side(d, site, p.behind[k], stretch * vec3_norm(vec3_sub(to, from)),
                      distance_of_middle(d->s, site, p.behind[k], from, to)) ||
            !check_certain(d, p.behind[k], fmax(vec3_norm2(from), vec3_norm2(to)), site))
            return false;
    }
    measure_distances(d, &p, site, t->of);
    return true;
}

static void measure_uncovered(descent *d, const part *t)
{
    polygon p;
    whole_part(d, t, (vec3){0, 0, 0}, &p);
    search_polygon(d, &p, (vec3){0, 0, 0}, t->of, &d->farthest[t->of->patch], !d->wanted->again);
}

/* Half k of a triangle that is divided at the midpoint of its longest edge. */
static part half_of(const part *t, int longest, int k)
{
    part out = *t;
    const int a = longest, b = (longest + 1) % 3;
    out.corner[k == 0 ? b : a] = vec3_scale(vec3_add(t->corner[a], t->corner[b]), 0.5);
    return out;
}

static int longest_edge(const part *t, double *length)
{
    int longest = 0;
    double most2 = -1;
    for (int k = 0; k < 3; k++) {
        const double length2 = vec3_norm2(vec3_sub(t->corner[(k + 1) % 3], t->corner[k]));
        if (length2 <= most2) continue;
        most2 = length2;
        longest = k;
    }
    *length = sqrt(most2);
    return longest;
}

/* Whether a site is farther from all corners than another site. It is then farther from every place of the
 * triangle, since the difference of the squared distances is linear. */
static bool is_dominated(const corner_distances *d, const corner_distances *by)
{
    return d->of[0] > by->of[0] * (1 + MARGIN) && d->of[1] > by->of[1] * (1 + MARGIN) &&
           d->of[2] > by->of[2] * (1 + MARGIN);
}

/* The site that is nearest to a corner, or nearest to all corners in the worst case. */
typedef struct nearest_site {
    uint32_t site;
    double least;
    corner_distances at;
} nearest_site;

/* Whether a site coincides with an earlier one. Coincident sites do not dominate each other and no division
 * separates them, so that only the first is kept. */
static bool is_repeated(uint32_t site, const corner_distances *at, const nearest_site *by)
{
    return by->site < site && is_equally_far(at, &by->at, 0) && is_equally_far(at, &by->at, 1) &&
           is_equally_far(at, &by->at, 2);
}

/* Value of `changed` for a part whose distances from the candidates are unknown at all corners; otherwise it
 * is the new corner of a half. */
enum { ALL_CORNERS = 3 };

/* Pushes the candidates, of `count` from `from`, that are not dominated by the sites nearest to each corner
 * and to all three. False: out of memory. */
static bool push_undominated(descent *d, const part *t, int changed, size_t from, size_t count)
{
    enum { NEAREST_SITES = 4 };
    nearest_site nearest[NEAREST_SITES] = {
        {.least = INFINITY}, {.least = INFINITY}, {.least = INFINITY}, {.least = INFINITY}};
    const size_t base = d->top;
    for (size_t k = 0; k < count; k++) {
        corner_distances distances = d->square[from + k];
        for (int c = 0; c < 3; c++)
            if (changed == c || changed == ALL_CORNERS)
                distances.of[c] = vec3_norm2(vec3_sub(d->s->position[d->list[from + k]], t->corner[c]));
        const double value[NEAREST_SITES] = {distances.of[0], distances.of[1], distances.of[2],
                                             distances.of[0] + distances.of[1] + distances.of[2]};
        for (int j = 0; j < NEAREST_SITES; j++) {
            const uint32_t site = d->list[from + k];
            if (value[j] < nearest[j].least || (value[j] == nearest[j].least && site < nearest[j].site))
                nearest[j] = (nearest_site){site, value[j], distances};
        }
        d->list[base + k] = d->list[from + k];
        d->square[base + k] = distances;
    }
    for (size_t k = 0; k < count; k++) {
        const corner_distances distances = d->square[base + k];
        const uint32_t site = d->list[base + k];
        bool discarded = false;
        for (int j = 0; j < NEAREST_SITES && !discarded; j++)
            discarded = is_dominated(&distances, &nearest[j].at) ||
                        (count > MOST_CANDIDATES && is_repeated(site, &distances, &nearest[j]));
        if (discarded) continue;
        d->list[d->top] = site;
        d->square[d->top++] = distances;
    }
    bool ok = true;
    for (int c = 0; ok && c < 3; c++) ok = check_certain(d, nearest[c].site, nearest[c].least, NO_SITE);
    return ok;
}

/* Processes a part with the candidates `from` .. `from` + `count` - 1. All belong to the triangle's piece,
 * and none is on an opposite wall. */
static bool visit_part(descent *d, const part *t, int changed, size_t from, size_t count)
{
    const size_t base = d->top;
    if (!reserve(d, count) || !push_undominated(d, t, changed, from, count)) return false;
    const size_t chosen = d->top - base;
    if (is_known(d, base, chosen)) {
        d->top = base;
        return true;
    }
    bool ok = true;
    double length;
    const int longest = longest_edge(t, &length);
    if (chosen > MOST_CANDIDATES && length > LEAST_PART * d->s->spacing[d->list[base]]) {
        for (int k = 0; ok && k < 2; k++) {
            const part half = half_of(t, longest, k);
            ok = visit_part(d, &half, k == 0 ? (longest + 1) % 3 : longest, base, chosen);
        }
    } else { /* the part is too small to divide: uses the first candidates only */
        const size_t used = chosen < MOST_CANDIDATES ? chosen : MOST_CANDIDATES;
        for (size_t k = 0; ok && k < used; k++) ok = clip_cell(d, t, base, used, k);
    }
    d->top = base;
    return ok;
}

static bool is_candidate(const sites *s, uint32_t i, const facet *t)
{
    return sites_piece(s, i) == t->piece && sites_facing(s, i, t->normal, t->patch) > SITES_OPPOSITE;
}

typedef struct collection {
    descent *d;
    const facet *of; /* the triangle whose candidates are collected; NULL: all points are */
    bool ok;
} collection;

static void collect(void *context, uint32_t i)
{
    collection *c = context;
    if (!c->ok || (c->of && !is_candidate(c->d->s, i, c->of))) return;
    c->ok = reserve(c->d, 1);
    if (c->ok) c->d->list[c->d->top++] = i;
}

/* Pushes the points within `reach` of x: all, or those that are candidates of a triangle. */
static bool collect_within(descent *d, vec3 x, double reach, const facet *of)
{
    collection c = {d, of, true};
    cell_list_within(d->s->near, x, reach, collect, &c);
    return c.ok;
}

/* The smallest distance of the candidates from `base` on from the centroid. */
static double nearest_candidate(const descent *d, size_t base, vec3 centroid)
{
    double nearest2 = INFINITY;
    for (size_t k = base; k < d->top; k++)
        nearest2 = fmin(nearest2, vec3_norm2(vec3_sub(d->s->position[d->list[k]], centroid)));
    return sqrt(nearest2);
}

/* Removes the candidates from `base` on that are farther than `reach` from the centroid. */
static void remove_far_candidates(descent *d, size_t base, vec3 centroid, double reach)
{
    const double reach2 = reach * reach * (1 + MARGIN);
    const size_t end = d->top;
    d->top = base;
    for (size_t k = base; k < end; k++)
        if (vec3_norm2(vec3_sub(d->s->position[d->list[k]], centroid)) <= reach2)
            d->list[d->top++] = d->list[k];
}

/* Radius of a sphere around a part of the surface; distance and spacing of the point nearest to its
 * centre. */
typedef struct surroundings {
    double radius, nearest, spacing;
    uint32_t point;
} surroundings;

static surroundings surroundings_at(const descent *d, vec3 centre, double radius)
{
    surroundings out = {.radius = radius};
    out.point = cell_list_nearest(d->s->near, centre, 0, &out.nearest);
    out.spacing = d->s->spacing[out.point];
    return out;
}

/* Whether a part is small beside the distance of the nearest point, so that its candidates are collected. This bounds the
 * division where that point has a spacing much smaller than the part and no cell there. */
static bool is_small_of_distance(const surroundings *at)
{
    return at->radius <= SMALL_OF_DISTANCE * at->nearest;
}

static double part_radius(const part *t, vec3 centroid)
{
    double radius = 0;
    for (int k = 0; k < 3; k++) radius = fmax(radius, vec3_norm(vec3_sub(t->corner[k], centroid)));
    return radius;
}

/* Processes a part whose candidates, from `base` on, are complete within `complete` of its centroid. */
static bool visit_candidates(descent *d, const part *t, size_t base, vec3 centroid, double radius,
                             double complete)
{
    bool ok = true;
    const double reach = nearest_candidate(d, base, centroid) + 2 * radius;
    if (reach <= complete)
        remove_far_candidates(d, base, centroid, reach);
    else {
        d->top = base;
        if (d->has_points[t->of->piece])
            ok = collect_within(d, centroid, FARTHEST_SITE * d->s->largest_spacing + 2 * radius, t->of);
    }
    if (ok && d->top == base)
        measure_uncovered(d, t);
    else if (ok)
        ok = visit_part(d, t, ALL_CORNERS, base, d->top - base);
    d->top = base;
    return ok;
}

static bool visit_part_nearby(descent *d, const part *t, vec3 centroid, const surroundings *at)
{
    const double reach = at->nearest + 2 * at->radius + COLLECTED * at->spacing;
    const size_t base = d->top;
    return collect_within(d, centroid, reach, t->of) &&
           visit_candidates(d, t, base, centroid, at->radius, reach);
}

/* Processes a part without candidates. A large part is divided first. */
static bool visit_large_part(descent *d, const part *t)
{
    const vec3 centroid = field_triangle_middle(t->corner);
    const surroundings at = surroundings_at(d, centroid, part_radius(t, centroid));
    if (!voronoi_reaches(d->wanted, centroid, at.radius, at.nearest) && is_candidate(d->s, at.point, t->of))
        return true;
    double length;
    const int longest = longest_edge(t, &length);
    /* The length of the edge decides: two triangles with a common edge divide it both, or neither does. */
    if (length <= 2 * SMALL * at.spacing || is_small_of_distance(&at))
        return visit_part_nearby(d, t, centroid, &at);
    part one = half_of(t, longest, 0), other = half_of(t, longest, 1);
    one.corner[(longest + 1) % 3] = other.corner[longest] =
        facets_middle(d->f, t->of->patch, t->corner[longest], t->corner[(longest + 1) % 3]);
    one.stretch = other.stretch = 1;
    return visit_large_part(d, &one) && visit_large_part(d, &other);
}

/* A quadrilateral of the surface between two ends; an end of a triangle may be one corner. */
typedef struct strip {
    vec3 first[2], last[2]; /* the corners of each end; the edges first[k] last[k] are its sides */
} strip;

static double strip_width(const strip *s)
{
    return fmax(vec3_norm(vec3_sub(s->first[1], s->first[0])), vec3_norm(vec3_sub(s->last[1], s->last[0])));
}

static double strip_length(const strip *s)
{
    return fmin(vec3_norm(vec3_sub(s->last[0], s->first[0])), vec3_norm(vec3_sub(s->last[1], s->first[1])));
}

static bool visit_triangles_of_strip(descent *d, const strip *s, const facet *of)
{
    const part one = {{s->first[0], s->last[0], s->last[1]}, of, of->stretch},
               other = {{s->first[0], s->last[1], s->first[1]}, of, of->stretch};
    const bool has_other = vec3_norm2(vec3_sub(s->first[1], s->first[0])) > 0;
    return visit_large_part(d, &one) && (!has_other || visit_large_part(d, &other));
}

/* Processes a strip without candidates. Halving both of its sides gives parts in proportion to its length.
 * Halving the longest edge of a triangle instead gives three triangles of half the length. */
static bool visit_strip(descent *d, const strip *s, const facet *of)
{
    const vec3 middle[2] = {vec3_scale(vec3_add(s->first[0], s->last[0]), 0.5),
                            vec3_scale(vec3_add(s->first[1], s->last[1]), 0.5)};
    const vec3 centre = vec3_scale(vec3_add(middle[0], middle[1]), 0.5);
    double radius = 0;
    for (int k = 0; k < 2; k++)
        radius = fmax(
            radius, fmax(vec3_norm(vec3_sub(s->first[k], centre)), vec3_norm(vec3_sub(s->last[k], centre))));
    const surroundings at = surroundings_at(d, centre, radius);
    if (!voronoi_reaches(d->wanted, centre, at.radius, at.nearest) && is_candidate(d->s, at.point, of))
        return true;
    if (at.radius <= SMALL * at.spacing || is_small_of_distance(&at) ||
        strip_length(s) < LEAST_ELONGATION * strip_width(s))
        return visit_triangles_of_strip(d, s, of);
    const strip one = {{s->first[0], s->first[1]}, {middle[0], middle[1]}},
                other = {{middle[0], middle[1]}, {s->last[0], s->last[1]}};
    return visit_strip(d, &one, of) && visit_strip(d, &other, of);
}

/* The strip of a triangle from the corner opposite to its shortest edge to this edge. */
static strip strip_of_triangle(const facet *t)
{
    int shortest = 0;
    for (int k = 1; k < 3; k++)
        if (vec3_norm2(vec3_sub(t->corner[(k + 1) % 3], t->corner[k])) <
            vec3_norm2(vec3_sub(t->corner[(shortest + 1) % 3], t->corner[shortest])))
            shortest = k;
    const vec3 apex = t->corner[(shortest + 2) % 3];
    return (strip){{apex, apex}, {t->corner[shortest], t->corner[(shortest + 1) % 3]}};
}

/* Processes a triangle. `certain`: all candidates are of its piece and not on an opposite wall. */
static bool visit_triangle(descent *d, const facet *t, const candidates *from, vec3 from_centre, bool certain)
{
    const part whole = {{t->corner[0], t->corner[1], t->corner[2]}, t, t->stretch};
    const vec3 centroid = field_triangle_middle(t->corner);
    const size_t base = d->top;
    if (!reserve(d, from->count)) return false;
    for (size_t k = from->first; k < from->first + from->count; k++)
        if (certain || is_candidate(d->s, d->list[k], t)) d->list[d->top++] = d->list[k];
    const double complete = from->complete - vec3_norm(vec3_sub(centroid, from_centre));
    return visit_candidates(d, &whole, base, centroid, part_radius(&whole, centroid), complete);
}

static bool visit_large_triangle(descent *d, const facet *t)
{
    const strip s = strip_of_triangle(t);
    if (d->f->in.triangle_count > 0 && strip_length(&s) >= LEAST_ELONGATION * strip_width(&s))
        return visit_strip(d, &s, t);
    return visit_large_part(d, &(part){{t->corner[0], t->corner[1], t->corner[2]}, t, t->stretch});
}

/* ---- nodes */

/* Whether every place of a sphere is so near to a point that its distance cannot raise the maximum. */
static bool is_covered(const descent *d, uint32_t patch, vec3 centre, double radius, uint32_t site)
{
    const double most = (vec3_norm(vec3_sub(d->s->position[site], centre)) + radius) / d->s->spacing[site];
    return most <= COVERAGE_MISSING && patch != FACETS_MIXED && most <= d->farthest[patch];
}

/* Whether an item lies in one cell, that of *site, according to the candidates that face all of it. */
static bool is_in_one_cell(const descent *d, const candidates *from, const facets_item *item, uint32_t *site)
{
    double nearest2 = INFINITY, second2 = INFINITY;
    for (size_t k = 0; k < from->count; k++) {
        const uint32_t i = d->list[from->first + k];
        const double distance2 = vec3_norm2(vec3_sub(d->s->position[i], item->centre));
        if (distance2 < nearest2) {
            second2 = nearest2;
            nearest2 = distance2;
            *site = i;
        } else
            second2 = fmin(second2, distance2);
    }
    return sqrt(second2) > (sqrt(nearest2) + 2 * item->radius) * (1 + MARGIN) && isfinite(nearest2);
}

/* Whether every place of a sphere is so near to a candidate that it can belong to a certain cell. */
static bool is_within_cells(const descent *d, const candidates *from, vec3 centre, double radius)
{
    bool within = false;
    for (size_t k = from->first; !within && k < from->first + from->count; k++) {
        const uint32_t i = d->list[k];
        const double most = PLANAR_CELLS_FARTHEST * d->s->spacing[i] - radius;
        within = most > 0 && vec3_norm2(vec3_sub(d->s->position[i], centre)) <= most * most;
    }
    return within;
}

/* Processes the triangles of an item with candidates. */
static bool visit_triangles(descent *d, size_t k, const facets_item *item, const candidates *from,
                            vec3 from_centre)
{
    facet t[FIELD_CELL_TRIANGLES];
    const int triangles = facets_expand(d->f, k, t);
    if (triangles == 0) return true;
    const size_t base = d->top;
    const facets_node around = facets_bound_triangles(item, triangles, t);
    candidates own;
    bool certain;
    if (!choose_candidates(d, &around, from, from_centre, &own, &certain)) return false;
    bool ok = true;
    for (int i = 0; ok && i < triangles; i++) ok = visit_triangle(d, &t[i], &own, item->centre, certain);
    d->top = base;
    return ok;
}

static bool visit_item(descent *d, size_t k, const candidates *from, vec3 from_centre, bool certain)
{
    const facets_item item = facets_item_at(d->f, k);
    uint32_t site = 0;
    if (certain && is_known(d, from->first, from->count) &&
        is_within_cells(d, from, item.centre, item.radius))
        return true;
    if (certain && is_in_one_cell(d, from, &item, &site) &&
        is_covered(d, item.patch, item.centre, item.radius, site))
        return is_done(d->known, site) || add_area(d, site, item.area);
    return visit_triangles(d, k, &item, from, from_centre);
}

/* Processes an item without candidates. */
static bool visit_single_item(descent *d, size_t k)
{
    const facets_item item = facets_item_at(d->f, k);
    const surroundings at = surroundings_at(d, item.centre, item.radius);
    if (!voronoi_reaches(d->wanted, item.centre, item.radius, at.nearest) &&
        !voronoi_is_apart(d->s, at.point, &item))
        return true;
    bool ok = true;
    if (at.radius <= SMALL * at.spacing) {
        const size_t base = d->top;
        const double reach = at.nearest + 2 * at.radius + COLLECTED * at.spacing;
        ok = collect_within(d, item.centre, reach, NULL) &&
             visit_triangles(d, k, &item, &(candidates){base, d->top - base, reach}, item.centre);
        d->top = base;
        return ok;
    }
    facet t[FIELD_CELL_TRIANGLES];
    const int triangles = facets_expand(d->f, k, t);
    for (int i = 0; ok && i < triangles; i++) ok = visit_large_triangle(d, &t[i]);
    return ok;
}

static bool visit_small_node(descent *d, uint32_t node, const candidates *from, vec3 from_centre)
{
    const facets_node *n = &d->f->node[node];
    const size_t base = d->top;
    candidates own;
    bool certain;
    if (!choose_candidates(d, n, from, from_centre, &own, &certain)) return false;
    bool ok = true;
    if (certain && is_known(d, base, own.count) && is_within_cells(d, &own, n->centre, n->radius)) {
        d->top = base;
        return true;
    }
    if (certain && own.count == 1 && is_covered(d, n->patch, n->centre, n->radius, d->list[base]))
        ok = add_area(d, d->list[base], n->area);
    else if (n->right > 0)
        ok = visit_small_node(d, node + 1, &own, n->centre) && visit_small_node(d, n->right, &own, n->centre);
    else
        for (size_t k = n->begin; ok && k < n->end; k++) ok = visit_item(d, k, &own, n->centre, certain);
    d->top = base;
    return ok;
}

/* Whether voronoi_is_apart may hold for an item of a node and the point nearest to the node. */
static bool may_be_apart(const descent *d, const facets_node *n, uint32_t point)
{
    const node_facing thresholds = facing_of_node(n);
    return n->piece != sites_piece(d->s, point) ||
           (d->f->in.triangle_count > 0 && facing_at_node(d->s, &thresholds, point) != FACING_ALL);
}

/* Processes a node without candidates. */
static bool visit_node(descent *d, uint32_t node)
{
    const facets_node *n = &d->f->node[node];
    const surroundings at = surroundings_at(d, n->centre, n->radius);
    bool ok = true;
    if (!voronoi_reaches(d->wanted, n->centre, n->radius, at.nearest) && !may_be_apart(d, n, at.point))
        return true;
    if (at.radius <= SMALL * at.spacing) {
        const size_t base = d->top;
        const double reach = at.nearest + 2 * at.radius + COLLECTED * at.spacing;
        ok = collect_within(d, n->centre, reach, NULL) &&
             visit_small_node(d, node, &(candidates){base, d->top - base, reach}, n->centre);
        d->top = base;
    } else if (n->right > 0)
        ok = visit_node(d, node + 1) && visit_node(d, n->right);
    else
        for (size_t k = n->begin; ok && k < n->end; k++) ok = visit_single_item(d, k);
    return ok;
}

/* ---- lower bounds of the largest distances */

/* Whether a place is part of the surface (clip_by_domain). */
static bool is_in_domain(const facets *f, vec3 x)
{
    const field *of = f->in.triangle_count == 0 ? f->in.scan->field : NULL;
    return !of || !of->open || bbox_contains(of->boundary_box, x);
}

/* Raises the bound of an item's patch by the distance of one of its places. */
static void probe_item(const build_job *job, size_t k, double *known)
{
    facet t[FIELD_CELL_TRIANGLES];
    if (facets_expand(job->f, k, t) == 0) return;
    const vec3 middle = field_triangle_middle(t[0].corner);
    double *most = &known[t[0].patch];
    if (!(distance_at(job->s, middle) > *most) || !is_in_domain(job->f, middle)) return;
    const vec3 place = facets_onto(job->f, &t[0], middle);
    *most = fmax(*most, fmin(distance_at(job->s, place), distance_at(job->s, middle)));
}

static size_t probe_count(const build_job *job)
{
    const size_t most = job->cells / POINTS_OF_PROBE + 1;
    return job->f->item_count < most ? job->f->item_count : most;
}

static void probe_chunk(void *context, int worker, size_t begin, size_t end)
{
    const build_job *job = context;
    const size_t count = probe_count(job);
    double *known = job->farthest + 2 * job->f->in.patch_count * (size_t)worker;
    for (size_t k = begin; k < end; k++) probe_item(job, k * job->f->item_count / count, known);
}

/* Computes the largest distance at places of some items. With this lower bound, tasks discard most searches
 * at once. */
static void probe(const build_job *job, size_t workers, threads *pool, double *known)
{
    const size_t patches = job->f->in.patch_count;
    threads_run(pool, probe_count(job), 256, probe_chunk, (void *)job);
    for (size_t w = 0; w < workers; w++)
        for (size_t p = 0; p < patches; p++) known[p] = fmax(known[p], job->farthest[2 * w * patches + p]);
}

/* ---- tasks */

/* Each task begins with the same known distances, so that its result does not depend on the tasks that the
 * thread did before. */
static void run_tasks(void *context, int worker, size_t begin, size_t end)
{
    const build_job *job = context;
    const size_t patches = job->f->in.patch_count;
    double *own = job->farthest + 2 * patches * (size_t)worker, *all = own + patches;
    for (size_t k = begin; k < end; k++) {
        task *t = &job->task[k];
        descent d = {.f = job->f,
                     .s = job->s,
                     .known = job->wanted->known,
                     .wanted = job->wanted,
                     .has_points = job->has_points,
                     .to = t,
                     .farthest = own};
        memcpy(own, job->known, patches * sizeof *own);
        visit_node(&d, t->node);
        for (size_t p = 0; p < patches; p++) all[p] = fmax(all[p], own[p]);
        free(d.list);
        free(d.square);
    }
}

/* ---- sums */

/* Hash table with open addressing, at most three quarters full: pairs of sites, and the length of their
 * sides. */
typedef struct side_table {
    voronoi_side *entry; /* b == 0: the entry is free */
    size_t room, count;  /* room: a power of two */
} side_table;

static bool table_init(side_table *t, size_t expected, error *e)
{
    *t = (side_table){.room = 64};
    while (3 * t->room < 4 * expected) t->room *= 2;
    t->entry = mem_array(t->room, sizeof *t->entry, what, e);
    return t->entry != NULL;
}

static voronoi_side *table_find(const side_table *t, uint32_t a, uint32_t b)
{
    const uint64_t key = ((uint64_t)a << 32 | b) * UINT64_C(0x9E3779B97F4A7C15);
    size_t at = (size_t)(key >> 20) & (t->room - 1);
    while (t->entry[at].b != 0 && (t->entry[at].a != a || t->entry[at].b != b)) at = (at + 1) & (t->room - 1);
    return &t->entry[at];
}

static bool table_add(side_table *t, const voronoi_side *s, error *e)
{
    if (4 * t->count >= 3 * t->room) {
        side_table larger;
        if (!table_init(&larger, 2 * t->count, e)) return false;
        for (size_t k = 0; k < t->room; k++)
            if (t->entry[k].b != 0) *table_find(&larger, t->entry[k].a, t->entry[k].b) = t->entry[k];
        larger.count = t->count;
        free(t->entry);
        *t = larger;
    }
    voronoi_side *to = table_find(t, s->a, s->b);
    if (to->b == 0) {
        *to = (voronoi_side){s->a, s->b, 0, INFINITY};
        t->count++;
    }
    to->length += s->length;
    to->middle = s->middle < to->middle ? s->middle : to->middle;
    return true;
}

static bool add_exceeded(restricted_voronoi *out, uint32_t site, error *e)
{
    if (!MEM_GROW(out->exceeded, out->exceeded_count, &out->exceeded_room, what, e)) return false;
    out->exceeded[out->exceeded_count++] = site;
    return true;
}

static bool settle_task(task *t, double *area, restricted_voronoi *out, side_table *table, error *e)
{
    bool ok = !t->failed;
    if (!ok && e) *e = t->why;
    for (size_t k = 0; ok && k < t->area_count; k++) area[t->area[k].site] += t->area[k].area;
    for (size_t k = 0; ok && k < t->side_count; k++) ok = table_add(table, &t->side[k], e);
    for (size_t k = 0; ok && k < t->exceeded_count; k++) ok = add_exceeded(out, t->exceeded[k], e);
    out->missing += t->missing;
    free(t->area);
    free(t->side);
    free(t->exceeded);
    t->area = NULL;
    t->side = NULL;
    t->exceeded = NULL;
    return ok;
}

/* ---- the division into tasks */

/* Divides the hierarchy at nodes of at most `most` items. Returns the number of tasks. */
static size_t divide(const facets *f, uint32_t node, size_t most, task *out)
{
    const facets_node *n = &f->node[node];
    if (n->right == 0 || n->end - n->begin <= most) {
        *out = (task){.node = node};
        return 1;
    }
    const size_t count = divide(f, node + 1, most, out);
    return count + divide(f, n->right, most, out + count);
}

/* Counts the cells to be computed, and sets their areas to 0. */
static size_t begin_areas(const sites *s, const planar_cell *known, double *area)
{
    size_t wanted = 0;
    for (size_t i = 0; i < s->count; i++) {
        if (is_done(known, (uint32_t)i)) continue;
        area[i] = 0;
        wanted++;
    }
    return wanted;
}

static void find_point(void *found, uint32_t point)
{
    (void)point;
    *(bool *)found = true;
}

bool voronoi_reaches(const voronoi_wanted *w, vec3 centre, double radius, double nearest)
{
    bool found = !w->list;
    if (!found) cell_list_within(w->list, centre, nearest + 2 * radius + w->beyond, find_point, &found);
    return found;
}

bool voronoi_is_apart(const sites *s, uint32_t i, const facets_item *item)
{
    return item->piece != sites_piece(s, i) ||
           (vec3_norm2(item->normal) > 0 && sites_facing(s, i, item->normal, item->patch) <= SITES_OPPOSITE);
}

bool restricted_voronoi_build(const facets *f, const sites *s, const voronoi_wanted *wanted, threads *pool,
                              double *area, restricted_voronoi *out, error *e)
{
    const size_t workers = (size_t)threads_count(pool), patches = f->in.patch_count;
    const size_t cells = begin_areas(s, wanted->known, area), parts = cells / POINTS_OF_TASK + 1,
                 most = f->item_count / (parts < TASKS ? parts : TASKS) + 1;
    side_table table = {0};
    double *farthest = mem_array(2 * workers * patches, sizeof *farthest, what, e);
    task *all = mem_array(4 * TASKS, sizeof *all, what, e);
    *out = (restricted_voronoi){0};
    out->farthest = mem_array(patches, sizeof *out->farthest, what, e);
    bool *has_points = mem_array(f->piece_count, sizeof *has_points, what, e);
    bool ok = farthest && out->farthest && all && has_points && table_init(&table, 3 * cells, e);
    const size_t tasks = ok && f->item_count > 0 ? divide(f, 0, most, all) : 0;
    build_job job = {f, s, wanted, cells, all, farthest, out->farthest, has_points};
    for (size_t i = 0; tasks > 0 && i < s->count; i++) has_points[sites_piece(s, (uint32_t)i)] = true;
    const size_t at_once = TASKS_OF_THREAD * workers;
    if (tasks > 0) probe(&job, workers, pool, out->farthest);
    for (size_t k = 0; k < tasks; k += at_once) {
        const size_t count = tasks - k < at_once ? tasks - k : at_once;
        job.task = all + k;
        if (ok) threads_run(pool, count, 1, run_tasks, &job);
        for (size_t i = 0; i < count; i++)
            ok = settle_task(&all[k + i], area, out, &table, ok ? e : NULL) && ok;
    }
    for (size_t w = 0; ok && w < workers; w++)
        for (size_t p = 0; p < patches; p++)
            out->farthest[p] = fmax(out->farthest[p], farthest[(2 * w + 1) * patches + p]);
    for (size_t k = 0; ok && k < table.room; k++)
        if (table.entry[k].b != 0) table.entry[out->side_count++] = table.entry[k];
    out->side = table.entry;
    free(all);
    free(farthest);
    free(has_points);
    return ok && threads_may_go_on(pool, e);
}

void restricted_voronoi_free(restricted_voronoi *v)
{
    free(v->side);
    free(v->farthest);
    free(v->exceeded);
    *v = (restricted_voronoi){0};
}
