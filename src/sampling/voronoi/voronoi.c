// SPDX-License-Identifier: Apache-2.0
#include "sampling/voronoi/voronoi.h"

#include <assert.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/lanes.h"
#include "sampling/packing/point_flags.h"
#include "sampling/packing/pair.h"
#include "sampling/voronoi/triangle_filter.h"

/* Maximum displacement of points along their normals, in spacings. Points on a plane or a sphere have no
 * unique triangulation; the displacement makes it unique. Also the sine of an angle below which three points
 * are collinear, and a relative margin of distances for rounding errors, which are much smaller. */
static const double JITTER = 1e-5;

/* A displaced point with its normal turned to the side of the triangle. */
typedef struct site {
    uint32_t index, place; /* index in the sites; entry of the list */
    vec3 at, normal;
    double spacing;
} site;

/* A point and the points of its list, nearest first. */
typedef struct surroundings {
    uint32_t count;
    site own, near[VORONOI_STAR_MAX];
    /* copies of their positions and normals; the last one is repeated up to a multiple of LANES */
    double x[VORONOI_STAR_MAX], y[VORONOI_STAR_MAX], z[VORONOI_STAR_MAX];
    double nx[VORONOI_STAR_MAX], ny[VORONOI_STAR_MAX], nz[VORONOI_STAR_MAX], spacing[VORONOI_STAR_MAX];
    double square[VORONOI_STAR_MAX]; /* lower bound of the squared distance of it and of all later ones */
    triangle_filter sieve;
} surroundings;

/* Three points and their Voronoi line: the places with equal distances from them, with a parameter along
 * `across` from the circumcentre. Other points clip it to `low` .. `high`, an edge of the Voronoi diagram
 * in space. */
typedef struct triangle {
    const site
        *corner[3]; /* in ascending order of index, so that the result is the same to the last bit from each
                     * corner */
    vec3 centre, across, facing;
    double radius2;
    /* Points whose normal has a negative product with `facing`, the square of which is at least this, are
     * on an opposite wall. */
    double hidden2;
    double low, high;             /* in lengths of `across` */
    const site *low_by, *high_by; /* the points that clip the ends; NULL: none does */
    site kept[2];                 /* copies of these, if they are not in the surroundings of a corner */
    bool wide;                    /* the list of one corner may lack points that clip it */
} triangle;

/* The normal of a point; if its sign is arbitrary, turned to the side of `facing`. */
static vec3 normal_towards(const voronoi_sites *in, uint32_t i, vec3 facing)
{
    bool turn = in->flags && in->flags[i] & PACKING_ONE_SIDED && vec3_dot(in->normal[i], facing) < 0;
    return turn ? vec3_scale(in->normal[i], -1) : in->normal[i];
}

/* The site of a point, for a triangle with the normal `facing`. */
static site site_at(const voronoi_sites *in, uint32_t i, uint32_t place, vec3 facing)
{
    uint32_t name = in->index ? in->index[i] : i;
    double unit = (double)(name * 2654435761u) / 4294967296.0 - 0.5; /* Knuth's multiplicative hash */
    vec3 at = vec3_axpy(2 * JITTER * unit * in->spacing[i], in->normal[i], in->position[i]);
    return (site){i, place, at, normal_towards(in, i, facing), in->spacing[i]};
}

static void fill_sieve(surroundings *s)
{
    const triangle_filter_input around = {s->count, s->own.at, s->own.normal, s->own.spacing,
                                          s->x,     s->y,      s->z,          s->nx,
                                          s->ny,    s->nz,     s->spacing,    s->square};
    triangle_filter_fill(&around, &s->sieve);
}

/* False: the list is too long. */
static bool gather_sites(const voronoi_sites *in, uint32_t a, surroundings *out)
{
    const uint32_t *list = neighbours_list(in->near, a), listed = in->near->list_count[a];
    double square[VORONOI_STAR_MAX];
    uint32_t order[VORONOI_STAR_MAX];
    if (listed > VORONOI_STAR_MAX) return false;
    for (uint32_t k = 0; k < listed; k++) {
        double next = vec3_norm2(vec3_sub(in->position[list[k]], in->position[a]));
        uint32_t to = k;
        for (; to > 0 && square[to - 1] > next; to--) {
            square[to] = square[to - 1];
            order[to] = order[to - 1];
        }
        square[to] = next;
        order[to] = k;
    }
    out->own = site_at(in, a, 0, in->normal[a]);
    out->count = listed;
    for (uint32_t k = 0; k < listed; k++) out->near[k] = site_at(in, list[order[k]], order[k], in->normal[a]);
    for (uint32_t k = 0; listed > 0 && k < (listed + LANES - 1) / LANES * LANES; k++) {
        const site *of = &out->near[k < listed ? k : listed - 1];
        out->x[k] = of->at.x;
        out->y[k] = of->at.y;
        out->z[k] = of->at.z;
        out->nx[k] = of->normal.x;
        out->ny[k] = of->normal.y;
        out->nz[k] = of->normal.z;
        out->spacing[k] = of->spacing;
    }
    for (uint32_t k = listed; k-- > 0;) {
        double own = vec3_norm2(vec3_sub(out->near[k].at, out->own.at));
        out->square[k] = k + 1 < listed && out->square[k + 1] < own ? out->square[k + 1] : own;
    }
    fill_sieve(out);
    return true;
}

static void swap_if_greater(const site **a, const site **b)
{
    if ((*a)->index < (*b)->index) return;
    const site *swap = *a;
    *a = *b;
    *b = swap;
}

static bool are_near(const site *a, const site *b, double square)
{
    double reach = VORONOI_REACH * 0.5 * (a->spacing + b->spacing);
    return square < reach * reach;
}

/* False: the corners are collinear, too far apart to be neighbours, or have too large a circumradius. */
static bool span_triangle(const site *a, const site *b, const site *c, triangle *out)
{
    swap_if_greater(&a, &b);
    swap_if_greater(&b, &c);
    swap_if_greater(&a, &b);
    vec3 u = vec3_sub(b->at, a->at), v = vec3_sub(c->at, a->at);
    double u2 = vec3_norm2(u), v2 = vec3_norm2(v), uv2 = vec3_norm2(vec3_sub(u, v));
    if (!are_near(b, c, uv2) || !are_near(a, c, v2) || !are_near(a, b, u2)) return false;
    vec3 w = vec3_cross(u, v);
    double w2 = vec3_norm2(w), widest = 2 * TRIANGLE_MAX_CIRCUMRADIUS *
                                        compare_larger(a->spacing, compare_larger(b->spacing, c->spacing));
    if (!(w2 > JITTER * JITTER * u2 * v2) || !(u2 * v2 * uv2 < widest * widest * w2)) return false;
    vec3 to =
        vec3_scale(vec3_add(vec3_scale(vec3_cross(w, u), v2), vec3_scale(vec3_cross(v, w), u2)), 0.5 / w2);
    double least = compare_smaller(a->spacing, compare_smaller(b->spacing, c->spacing)),
           listed = 0.5 * VORONOI_REACH * least;
    double deep2 = listed * listed - vec3_norm2(to);
    out->corner[0] = a;
    out->corner[1] = b;
    out->corner[2] = c;
    out->facing = vec3_add(a->normal, vec3_add(b->normal, c->normal));
    out->centre = vec3_add(a->at, to);
    out->across = vec3_scale(w, copysign(1, vec3_dot(w, out->facing)));
    out->radius2 = vec3_norm2(to);
    out->hidden2 = VORONOI_OPPOSITE_COSINE * VORONOI_OPPOSITE_COSINE * vec3_norm2(out->facing);
    out->wide = deep2 < TRIANGLE_MIN_DEPTH * TRIANGLE_MIN_DEPTH * least * least;
    out->high = out->wide ? INFINITY : sqrt(deep2 / w2);
    out->low = -out->high;
    out->low_by = out->high_by = NULL;
    return true;
}

/* Clips the line by point d. False: nothing is left. */
static inline bool cut_by(const site *d, triangle *t)
{
    double facing = vec3_dot(d->normal, t->facing);
    if (d->index == t->corner[0]->index || d->index == t->corner[1]->index ||
        d->index == t->corner[2]->index || (facing <= 0 && facing * facing >= t->hidden2))
        return true;
    vec3 q = vec3_sub(d->at, t->centre);
    double along = 2 * vec3_dot(t->across, q), rest = vec3_norm2(q) - t->radius2;
    /* the place at parameter t is nearer to d if t along > rest */
    if (along > 0 && rest < along * t->high) {
        t->high = rest / along;
        t->high_by = d;
    } else if (along < 0 && rest < along * t->low) {
        t->low = rest / along;
        t->low_by = d;
    } else if (along == 0 && rest < 0)
        return false; /* d lies inside the circumcircle */
    return t->low < t->high;
}

/* Sets may[l] for the sites from `first` on that may clip the line. The others cannot, whatever was
 * clipped before. */
ISA_INLINE bool may_cut(const surroundings *s, uint32_t first, const triangle *t, int64_t may[LANES])
{
    int64_t any = 0;
    for (uint32_t l = 0; l < LANES; l++) {
        const uint32_t k = first + l;
        double facing = s->nx[k] * t->facing.x + s->ny[k] * t->facing.y + s->nz[k] * t->facing.z;
        double x = s->x[k] - t->centre.x, y = s->y[k] - t->centre.y, z = s->z[k] - t->centre.z;
        double along = 2 * (t->across.x * x + t->across.y * y + t->across.z * z);
        double rest = x * x + y * y + z * z - t->radius2;
        double at_low = along * t->low, at_high = along * t->high;
        int64_t hidden = (facing <= 0) & (facing * facing >= t->hidden2);
        int64_t beyond = (rest >= at_low) & (rest >= at_high);
        may[l] = !hidden & !beyond;
        any |= may[l];
    }
    return any != 0;
}

/* Clips the line by all points of the surroundings. False: nothing is left. */
ISA_CLONES static bool cut_by_near(const surroundings *s, triangle *t)
{
    const double across2 = 4 * (1 + JITTER) * vec3_norm2(t->across), least2 = 4 * (1 + JITTER) * t->radius2;
    int64_t may[LANES];
    for (uint32_t first = 0; first < s->count; first += LANES) {
        /* a point that clips the line lies in a ball about one of its ends, whose sphere passes through
         * the own point */
        const double end = -t->low > t->high ? -t->low : t->high;
        if (s->square[first] > least2 + across2 * end * end) return true;
        if (!may_cut(s, first, t, may)) continue;
        uint32_t bits = 0; /* unpredictable: no branches */
        for (uint32_t l = 0; l < LANES; l++) bits |= (uint32_t)may[l] << l;
        if (s->count - first < LANES) bits &= (1u << (s->count - first)) - 1;
        for (; bits; bits &= bits - 1)
            if (!cut_by(&s->near[first + (uint32_t)__builtin_ctz(bits)], t)) return false;
    }
    return true;
}

/* Whether a point is too far to clip the line, whatever its displacement along its normal. */
static inline bool is_beyond(const voronoi_sites *in, uint32_t i, const triangle *t, double longest)
{
    vec3 q = vec3_sub(in->position[i], t->centre);
    double along = 2 * vec3_dot(t->across, q), square = vec3_norm2(q), spacing = in->spacing[i];
    double moved = JITTER * (2 * spacing * longest + 2 * spacing * spacing + square);
    double rest = square - t->radius2 - moved;
    return rest >= along * t->low && rest >= along * t->high;
}

/* `seen`: a table of points that have clipped the triangle's line already, by their lowest bits. Lists of
 * neighbours have nearly the same points. */
static bool cut_by_list(const voronoi_sites *in, uint32_t of, uint32_t seen[VORONOI_STAR_MAX], triangle *t)
{
    const uint32_t *list = neighbours_list(in->near, of);
    const double across = vec3_norm(t->across);
    for (uint32_t k = 0; k < in->near->list_count[of]; k++) {
        const double end = -t->low > t->high ? -t->low : t->high;
        if (seen[list[k] % VORONOI_STAR_MAX] == list[k]) continue;
        seen[list[k] % VORONOI_STAR_MAX] = list[k];
        if (is_beyond(in, list[k], t, across * end)) continue;
        site d = site_at(in, list[k], k, t->facing);
        if (!cut_by(&d, t)) return false;
        if (t->low_by == &d) t->low_by = memcpy(&t->kept[0], &d, sizeof d);
        if (t->high_by == &d) t->high_by = memcpy(&t->kept[1], &d, sizeof d);
    }
    return true;
}

/* Whether the circumcentre of four points is inside the solid, by the majority of their normals. */
static bool is_end_inside(const triangle *t, double end, const site *by)
{
    vec3 x = vec3_axpy(end, t->across, t->centre);
    int outside = 0;
    for (int k = 0; k < 4; k++) {
        const site *s = k < 3 ? t->corner[k] : by;
        double height = vec3_dot(vec3_sub(x, s->at), s->normal);
        outside += (height > 0) - (height < 0);
    }
    return outside < 0;
}

/* Whether the Voronoi edge crosses the surface. An end that no point clips is inside if it is the low one,
 * else outside. */
static bool is_across_surface(const triangle *t)
{
    bool low_inside = !t->low_by || is_end_inside(t, t->low, t->low_by);
    bool high_inside = t->high_by && is_end_inside(t, t->high, t->high_by);
    return low_inside != high_inside;
}

/* Whether a point is in the list of one of the first `corners` corners. */
static bool is_listed(const voronoi_sites *in, const triangle *t, int corners, uint32_t point)
{
    for (int corner = 0; corner < corners; corner++) {
        const uint32_t i = t->corner[corner]->index, *list = neighbours_list(in->near, i);
        for (uint32_t k = 0; k < in->near->list_count[i]; k++)
            if (list[k] == point) return true;
    }
    return false;
}

/* is_across_surface after clipping by all points that are near enough: those of the lists of all corners, and
 * of the lists of these points. The list of `at_hand` has been used already. */
static bool is_across_surface_wide(const voronoi_sites *in, uint32_t at_hand, triangle *t)
{
    uint32_t seen[VORONOI_STAR_MAX];
    memset(seen, UINT8_MAX, sizeof seen); /* no point */
    for (int corner = 0; corner < 3; corner++) {
        const uint32_t i = t->corner[corner]->index;
        if ((i != at_hand || in->flags) && !cut_by_list(in, i, seen, t)) return false;
    }
    if (!is_across_surface(t)) return false;
    for (int corner = 0; corner < 3; corner++) {
        uint32_t i = t->corner[corner]->index;
        const uint32_t *list = neighbours_list(in->near, i);
        for (uint32_t k = 0; k < in->near->list_count[i]; k++)
            if (!is_listed(in, t, corner, list[k]) && !cut_by_list(in, list[k], seen, t)) return false;
    }
    return is_across_surface(t);
}

/* Whether the own point and two of its surroundings form a triangle of the surface: a Delaunay triangle
 * between a tetrahedron whose circumcentre is inside and one whose circumcentre is outside. `by`:
 * neighbours that clip the line first; -1: none. */
static bool is_on_surface(const voronoi_sites *in, const surroundings *s, const site *b, const site *c,
                          const int32_t by[2])
{
    triangle t;
    if (!span_triangle(&s->own, b, c, &t)) return false;
    for (int side = 0; side < 2; side++)
        if (by[side] >= 0 && !cut_by(&s->near[by[side]], &t)) return false;
    if (!cut_by_near(s, &t)) return false;
    return t.wide ? is_across_surface_wide(in, s->own.index, &t) : is_across_surface(&t);
}

/* The cotangent of the angle at p under which a and b are seen. */
static double cotangent_at(vec3 p, vec3 a, vec3 b)
{
    vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return vec3_dot(u, v) / vec3_norm(vec3_cross(u, v));
}

static bool is_opposite(const site *a, const site *b)
{
    return vec3_dot(a->normal, b->normal) <= VORONOI_OPPOSITE_COSINE;
}

/* ---- planar stars
 *
 * A planar star is computed from the polygon that the bisectors bound in the tangent plane of the point.
 * Distances are those in space.
 * On a sphere the edges of the polygon are therefore those of the diagram in space. On other surfaces they
 * differ by terms of second order in the bend of the surface, which the bound of the cosine limits. The
 * neighbours equal those of voronoi_star_triangles if every edge of the polygon is longer than the bound, and
 * every other point would have to come nearer by as much to get an edge. Otherwise the planar star is not
 * used.
 * The height of a point over the tangent plane, divided by its distance, is at most the sine of half the angle
 * between the normals. Points whose normals have a cosine of at most PAIR_FACING_NONE are on opposite walls,
 * whatever the other normals of the list are: it is below VORONOI_OPPOSITE_COSINE by more than half of the
 * strict angle. */

/* The bounds of voronoi_star_planar. With these no planar star of the tests' sets differs from the star by
 * triangles. */
static const voronoi_planar_bounds STRICT = {.cosine = 0.9, .edge = 0.225};

#define RING_MAX VORONOI_PLANAR_MAX

/* Points around the own point: coordinates in its tangent frame, squared distances in space. */
typedef struct ring {
    int count;
    uint32_t place[RING_MAX + 1];                             /* in the list; the last is scratch */
    double x[RING_MAX + 1], y[RING_MAX + 1], z[RING_MAX + 1]; /* z: along the normal */
    double square[RING_MAX + 1];
    double beyond; /* lower bound of the squared distance of the other points */
    double widest; /* largest spacing of the listed points */
} ring;

typedef struct listed_normals {
    double x[VORONOI_STAR_MAX], y[VORONOI_STAR_MAX], z[VORONOI_STAR_MAX];
} listed_normals;

/* `out` has the points' positions in space, which are replaced. */
ISA_CLONES static void compute_listed(vec3 x, vec3 normal, const listed_normals *restrict of,
                                      voronoi_listed *restrict out)
{
    vec3 u, v;
    vec3_frame(normal, &u, &v);
    for (size_t first = 0; first < out->count; first += LANES)
        for (size_t l = 0; l < LANES; l++) {
            const size_t k = first + l;
            const vec3 r = vec3_sub((vec3){out->x[k], out->y[k], out->z[k]}, x);
            out->facing[k] = vec3_dot(normal, (vec3){of->x[k], of->y[k], of->z[k]});
            out->square[k] = vec3_norm2(r);
            out->x[k] = vec3_dot(u, r);
            out->y[k] = vec3_dot(v, r);
            out->z[k] = vec3_dot(normal, r);
        }
}

void voronoi_gather_listed(const voronoi_sites *in, uint32_t a, uint32_t first, voronoi_listed *out)
{
    const uint32_t *list = neighbours_list(in->near, a) + first, left = in->near->list_count[a] - first,
                   count = left < VORONOI_STAR_MAX ? left : VORONOI_STAR_MAX;
    listed_normals of;
    out->first = first;
    out->count = count;
    out->complete = count == in->near->list_count[a];
    if (count == 0) return;
    for (uint32_t k = 0; k < (count + LANES - 1) / LANES * LANES; k++) {
        const uint32_t i = list[k < count ? k : 0];
        const vec3 x = in->position[i], n = in->normal[i];
        out->x[k] = x.x;
        out->y[k] = x.y;
        out->z[k] = x.z;
        of.x[k] = n.x;
        of.y[k] = n.y;
        of.z[k] = n.z;
        out->spacing[k] = in->spacing[i];
    }
    compute_listed(in->position[a], in->normal[a], &of, out);
    for (uint32_t k = 0; in->flags && k < count; k++)
        if (in->flags[list[k]] & PACKING_ONE_SIDED) out->facing[k] = fabs(out->facing[k]);
}

/* Whether the surface bends too much for the bounds. The last entry may be followed by copies of the first. */
ISA_CLONES static bool is_bent(const voronoi_listed *in, double reach2, const voronoi_planar_bounds *bounds)
{
    const double cosine = bounds->cosine, slope2 = 1 - cosine, near2 = bounds->near_only ? reach2 : INFINITY;
    int64_t bent[LANES] = {0}, any = 0;
    for (size_t first = 0; first < in->count; first += LANES)
        for (uint32_t l = 0; l < LANES; l++) {
            const double facing = in->facing[first + l], height = in->z[first + l],
                         square = in->square[first + l];
            bent[l] |= (facing > PAIR_FACING_NONE) & (square < near2) &
                       ((facing < cosine) | (2 * height * height > slope2 * square) | (square == 0));
        }
    for (uint32_t l = 0; l < LANES; l++) any |= bent[l];
    return any != 0;
}

/* Sets within[k] for the points within a squared distance, and `beyond` and `widest` of the ring. */
ISA_CLONES static void survey_ring(const voronoi_listed *in, double reach2, double own, int64_t *within,
                                   ring *out)
{
    double least[LANES], widest[LANES], beyond[LANES];
    for (uint32_t l = 0; l < LANES; l++) {
        least[l] = widest[l] = own;
        beyond[l] = INFINITY;
    }
    for (size_t first = 0; first < in->count; first += LANES)
#pragma GCC unroll 1
        for (uint32_t l = 0; l < LANES; l++) {
            const double square = in->square[first + l], spacing = in->spacing[first + l],
                         facing = in->facing[first + l];
            const int64_t seen = facing > PAIR_FACING_NONE, near = square < reach2;
            const double used = facing > PAIR_FACING_NONE ? spacing : own;
            const double outside = facing > PAIR_FACING_NONE ? square : INFINITY,
                         farther = square < reach2 ? INFINITY : outside;
            least[l] = used < least[l] ? used : least[l];
            widest[l] = used > widest[l] ? used : widest[l];
            beyond[l] = farther < beyond[l] ? farther : beyond[l];
            within[first + l] = seen & near;
        }
    for (uint32_t l = 1; l < LANES; l++) {
        least[0] = compare_smaller(least[0], least[l]);
        widest[0] = compare_larger(widest[0], widest[l]);
        beyond[0] = compare_smaller(beyond[0], beyond[l]);
    }
    const double unlisted = VORONOI_REACH * 0.5 * (own + least[0]);
    out->beyond = compare_smaller(beyond[0], unlisted * unlisted);
    out->widest = widest[0];
}

/* Gathers the points within a squared distance. False: there are too many. Which points are within is
 * unpredictable: there are no branches on it. */
static bool gather_ring(const voronoi_listed *in, double reach2, double own, ring *out)
{
    int64_t within[VORONOI_STAR_MAX];
    int count = 0;
    survey_ring(in, reach2, own, within, out);
    for (uint32_t k = 0; k < in->count; k++) {
        out->place[count] = k;
        count += (int)within[k];
        if (count > RING_MAX) return false;
    }
    out->count = count;
    for (int t = 0; t < count; t++) {
        const uint32_t k = out->place[t];
        out->x[t] = in->x[k];
        out->y[t] = in->y[k];
        out->z[t] = in->z[k];
        out->square[t] = in->square[k];
    }
    return true;
}

/* Orders the points of the ring by angle, starting with the nearest. */
static void order_ring(const ring *r, int order[RING_MAX])
{
    double angle[RING_MAX];
    int rank[RING_MAX], nearest = 0;
    for (int k = 0; k < r->count; k++) { /* grows with the angle, from -2 to 2 */
        rank[k] = 0;
        angle[k] = copysign(1 - r->x[k] / (fabs(r->x[k]) + fabs(r->y[k])), r->y[k]);
    }
    for (int k = 1; k < r->count; k++) {
        nearest = r->square[k] < r->square[nearest] ? k : nearest;
        for (int l = 0; l < k; l++) {
            int later = angle[k] >= angle[l];
            rank[k] += later;
            rank[l] += !later;
        }
    }
    int first = rank[nearest];
    for (int k = 0; k < r->count; k++)
        order[rank[k] < first ? rank[k] - first + r->count : rank[k] - first] = k;
}

typedef enum edge_test { CUT, KEPT, DOUBTFUL } edge_test;

/* KEPT: the bisector of q has an edge longer than `clear` between those of p and r, its clockwise and
 * counterclockwise neighbours. CUT: it misses the polygon by as much. */
static edge_test test_edge(const ring *g, int p, int q, int r, double clear)
{
    double x = g->x[q], y = g->y[q], plane = x * x + y * y;
    double before = g->x[p] * y - g->y[p] * x, after = x * g->y[r] - y * g->x[r];
    if (!(before > 0 && after > 0)) return DOUBTFUL;
    /* ends at rest / (2 sqrt(plane) cross) along the bisector, from its middle */
    double rest_p = g->square[p] * plane - g->square[q] * (x * g->x[p] + y * g->y[p]);
    double rest_r = g->square[r] * plane - g->square[q] * (x * g->x[r] + y * g->y[r]);
    double length = rest_r * before + rest_p * after, least = 2 * clear * sqrt(plane) * before * after;
    return length > least ? KEPT : length < -least ? CUT : DOUBTFUL;
}

/* Selects the neighbours from the ring, counterclockwise, to `hull`. The polygon that the bisectors bound is
 * dual to the convex hull of the points inverted to 2 / distance (Graham scan). Returns their number; 0:
 * undecided. */
static int scan_hull(const ring *g, const int order[RING_MAX], double clear, int hull[RING_MAX + 1])
{
    int top = 0;
    hull[0] = order[0];
    for (int k = 1; k <= g->count; k++) {
        int next = order[k < g->count ? k : 0];
        while (top > 0) {
            edge_test v = test_edge(g, hull[top - 1], hull[top], next, clear);
            if (v == DOUBTFUL) return 0;
            if (v == KEPT) break;
            top--;
        }
        hull[++top] = next;
    }
    return top > 2 && test_edge(g, hull[top - 1], hull[0], hull[1], clear) == KEPT ? top : 0;
}

/* Whether the points beyond the ring are too far to clip the corners of the polygon. Where the angle between two
 * neighbours is at most 90 degrees, a bisector that misses their corner by d would need to move by d to get an edge of
 * length 2 d; at a larger angle, which must be permitted (`wide`), by d times the tangent of half of it. */
static bool is_closed(const ring *g, int count, const int hull[RING_MAX + 1], double clear, bool wide)
{
    const double beyond = sqrt(g->beyond);
    for (int k = 0; k < count; k++) {
        int q = hull[k], r = hull[k + 1];
        double plane = g->x[q] * g->x[q] + g->y[q] * g->y[q], dot = g->x[q] * g->x[r] + g->y[q] * g->y[r];
        double cross = g->x[q] * g->y[r] - g->y[q] * g->x[r];
        double rest = g->square[r] * plane - g->square[q] * dot, corner = beyond - clear;
        if (dot < 0) corner = beyond - clear * (sqrt(dot * dot + cross * cross) - dot) / cross;
        if (!(corner > 0) || (dot < 0 && !wide) ||
            rest * rest + g->square[q] * g->square[q] * cross * cross >
                corner * corner * plane * cross * cross)
            return false;
    }
    return true;
}

/* Fills in the star. The length of a Voronoi edge follows from the cotangents of the outer angles of its
 * two triangles. */
static void measure_star(const ring *g, const uint32_t *list, int count, const int hull[RING_MAX + 1],
                         voronoi_star *out)
{
    out->count = out->triangle_count = (uint32_t)count;
    out->pinched = false;
    for (int k = 0; k < count; k++) {
        out->place[k] = g->place[hull[k]];
        out->point[k] = list[out->place[k]];
        out->distance[k] = sqrt(g->square[hull[k]]);
        out->edge[k] = 0;
        out->triangles[k] = 2;
    }
    for (int k = 0; k < count; k++) {
        int q = hull[k], r = hull[k + 1], next = k + 1 < count ? k + 1 : 0;
        double dot = g->x[q] * g->x[r] + g->y[q] * g->y[r] + g->z[q] * g->z[r];
        double half = 0.5 / sqrt(g->square[q] * g->square[r] - dot * dot);
        out->edge[k] += half * out->distance[k] * (g->square[r] - dot);
        out->edge[next] += half * out->distance[next] * (g->square[q] - dot);
        out->corner[k][0] = (uint8_t)k;
        out->corner[k][1] = (uint8_t)next;
    }
}

/* The largest bend between the own point and those of the ring: 1 minus the cosine between the normals, or what the
 * height over the tangent plane shows of it. */
static double bend_of(const voronoi_listed *in, const ring *g)
{
    double bend = 0;
    for (int k = 0; k < g->count; k++) {
        bend = compare_larger(bend, 1 - in->facing[g->place[k]]);
        bend = compare_larger(bend, 2 * g->z[k] * g->z[k] / g->square[k]);
    }
    return bend;
}

/* Finds the ring and the neighbours in it, to `hull`. Returns their number; 0: undecided. */
static int find_polygon(const voronoi_listed *listed, double own, const voronoi_planar_bounds *bounds,
                        ring *g, int hull[RING_MAX + 1])
{
    int order[RING_MAX];
    const double reach[2] = {VORONOI_FIRST_RING * own, INFINITY};
    if (!listed->complete) return 0;
    for (int k = 0; k < 2; k++) {
        const double reach2 = reach[k] * reach[k];
        if (is_bent(listed, reach2, bounds) || !gather_ring(listed, reach2, own, g)) return 0;
        if (g->count < 3) continue;
        order_ring(g, order);
        const double edge =
            bounds->near_only ? compare_larger(bounds->edge, bend_of(listed, g)) : bounds->edge;
        const double clear = edge * g->widest;
        const int sides = scan_hull(g, order, clear, hull);
        if (sides > 0 && is_closed(g, sides, hull, clear, bounds->wide)) return sides;
    }
    return 0;
}

bool voronoi_star_planar(const voronoi_sites *in, uint32_t a, const voronoi_listed *listed, voronoi_star *out)
{
    ring g;
    int hull[RING_MAX + 1];
    const int sides = find_polygon(listed, in->spacing[a], &STRICT, &g, hull);
    if (sides > 0) measure_star(&g, neighbours_list(in->near, a), sides, hull, out);
    return sides > 0;
}

uint32_t voronoi_planar_neighbours(const voronoi_listed *listed, double spacing,
                                   const voronoi_planar_bounds *bounds, uint32_t place[VORONOI_PLANAR_MAX])
{
    ring g;
    int hull[RING_MAX + 1];
    const int sides = find_polygon(listed, spacing, bounds, &g, hull);
    for (int k = 0; k < sides; k++) place[k] = g.place[hull[k]];
    return (uint32_t)sides;
}

/* Adds the contribution of the triangle a, b, c to the edge between a and b of the star of a. Returns the
 * index of b in the star. */
static uint32_t join_edge(const vec3 *x, uint32_t a, const site *b, uint32_t c, voronoi_star *out)
{
    uint32_t k = 0;
    while (k < out->count && out->point[k] != b->index) k++;
    if (k == out->count) {
        assert(k < VORONOI_STAR_MAX);
        out->count++;
        out->point[k] = b->index;
        out->place[k] = b->place;
        out->distance[k] = vec3_norm(vec3_sub(x[b->index], x[a]));
        out->edge[k] = 0;
        out->triangles[k] = 0;
    }
    out->edge[k] += 0.5 * out->distance[k] * cotangent_at(x[c], x[a], x[b->index]);
    out->pinched |= ++out->triangles[k] > 2;
    return k;
}

static bool is_closed_star(const voronoi_star *s)
{
    for (uint32_t k = 0; k < s->count; k++)
        if (s->triangles[k] < 2) return false;
    return s->count > 0;
}

/* State of the search around a point, in indices of its surroundings. */
typedef struct tour {
    uint32_t count, met[VORONOI_STAR_MAX]; /* the neighbours found so far */
    bool done[VORONOI_STAR_MAX];           /* all triangles with it are in the star */
} tour;

/* Collects the points that may form a new triangle with b: near it, and not on an opposite wall. */
ISA_CLONES static uint32_t find_thirds(const surroundings *s, const site *b, const tour *t,
                                       uint32_t third[VORONOI_STAR_MAX])
{
    int64_t may[VORONOI_STAR_MAX];
    for (uint32_t k = 0; k < s->count; k++) {
        double x = s->x[k] - b->at.x, y = s->y[k] - b->at.y, z = s->z[k] - b->at.z;
        double reach = VORONOI_REACH * 0.5 * (b->spacing + s->spacing[k]);
        double facing = b->normal.x * s->nx[k] + b->normal.y * s->ny[k] + b->normal.z * s->nz[k];
        may[k] =
            (x * x + y * y + z * z <= (1 + JITTER) * (reach * reach)) & (facing > VORONOI_OPPOSITE_COSINE);
    }
    uint32_t count = 0;
    for (uint32_t k = 0; k < s->count; k++) {
        third[count] = k;
        count += (uint32_t)may[k] & !t->done[k];
    }
    return count;
}

static void join_triangles(const voronoi_sites *in, surroundings *s, uint32_t at, tour *t, voronoi_star *out)
{
    const site *a = &s->own, *b = &s->near[at];
    uint32_t third[VORONOI_STAR_MAX];
    int32_t by[VORONOI_STAR_MAX][2];
    t->done[at] = true;
    const uint32_t thirds =
        triangle_filter_third_corners(&s->sieve, at, find_thirds(s, b, t, third), third, by);
    for (uint32_t k = 0; k < thirds; k++) {
        const site *c = &s->near[third[k]];
        if (!is_on_surface(in, s, b, c, by[k])) continue;
        uint32_t at_b = join_edge(in->position, a->index, b, c->index, out), met = out->count;
        uint32_t at_c = join_edge(in->position, a->index, c, b->index, out);
        if (out->count > met) t->met[t->count++] = third[k];
        out->pinched |= out->triangle_count == VORONOI_STAR_MAX;
        if (out->triangle_count == VORONOI_STAR_MAX) continue;
        out->corner[out->triangle_count][0] = (uint8_t)at_b;
        out->corner[out->triangle_count++][1] = (uint8_t)at_c;
    }
}

/* Walks around the point from neighbour to neighbour over the triangles with both. Starts again from another
 * point if the walk does not close. */
void voronoi_star_triangles(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    surroundings s;
    tour t = {.count = 0};
    out->count = out->triangle_count = 0;
    out->pinched = !gather_sites(in, a, &s);
    if (out->pinched) return;
    for (uint32_t k = 0; k < s.count; k++) t.done[k] = is_opposite(&s.own, &s.near[k]); /* in none */
    for (uint32_t first = 0, next = 0; first < s.count && !is_closed_star(out); first++) {
        if (!t.done[first]) join_triangles(in, &s, first, &t, out);
        for (; next < t.count; next++)
            if (!t.done[t.met[next]]) join_triangles(in, &s, t.met[next], &t, out);
    }
}

void voronoi_star_at(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    voronoi_listed listed;
    voronoi_gather_listed(in, a, 0, &listed);
    if (!voronoi_star_planar(in, a, &listed, out)) voronoi_star_triangles(in, a, out);
}

double voronoi_star_area(const voronoi_star *star)
{
    double area = 0;
    for (uint32_t k = 0; k < star->count; k++) area += 0.25 * star->distance[k] * star->edge[k];
    return isfinite(area) ? area : 0;
}
