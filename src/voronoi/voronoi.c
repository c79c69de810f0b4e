#include "voronoi/voronoi.h"

#include <assert.h>
#include <string.h>

#include "base/compare.h"
#include "base/isa.h"
#include "packing/packing.h"
#include "voronoi/star_lanes.h"
#include "voronoi/star_sieve.h"

/* Points are moved by this much at most, in spacings, along their normals: those that lie on a plane or a
 * sphere have no unique triangulation, and so they have. */
static const double JITTER = 1e-5;
/* Of three points nearly in a line: the sine of their angle at the first. */
static const double FLATTEST = 1e-6;

/* A point as its triangles see it. */
typedef struct site {
    uint32_t index, place; /* among all; in the list */
    vec3 at, normal;
    double spacing;
} site;

/* As many as are looked at side by side. */
enum { SIDE_BY_SIDE = 8 };
/* A little more than nothing: distances that are told in two ways differ by less, relatively. */
static const double HAIR = 1e-9;

/* A point and those of its list, nearest first. */
typedef struct surroundings {
    uint32_t count;
    site own, near[VORONOI_STAR_MAX];
    /* their places and normals again; behind the last one it is repeated */
    double x[VORONOI_STAR_MAX], y[VORONOI_STAR_MAX], z[VORONOI_STAR_MAX];
    double nx[VORONOI_STAR_MAX], ny[VORONOI_STAR_MAX], nz[VORONOI_STAR_MAX], spacing[VORONOI_STAR_MAX];
    double square[VORONOI_STAR_MAX]; /* how far it and all behind it are at least, squared */
    star_sieve sieve;
} surroundings;

/* Three points, and of the line of places that are as far from each, counted along `across` from their
 * circumcentre, what others leave from `low` to `high`: an edge of the Voronoi diagram in space. */
typedef struct triangle {
    const site *corner[3]; /* by their indices, so that each of them sees the same to the last bit */
    vec3 centre, across, facing;
    double radius2;
    double
        hidden2; /* points whose normals' product with `facing` is negative, and its square this, are on another sheet */
    double low, high;             /* in lengths of `across` */
    const site *low_by, *high_by; /* NULL: nobody */
    site kept[2];                 /* what they point at, where that is in nobody's surroundings */
    bool wide;                    /* the list of one corner may lack what cuts it */
} triangle;

/* A normal that may as well point the other way, on the side of `facing`. */
static vec3 normal_towards(const voronoi_sites *in, uint32_t i, vec3 facing)
{
    bool turn = in->flags && in->flags[i] & PACKING_ONE_SIDED && vec3_dot(in->normal[i], facing) < 0;
    return turn ? vec3_scale(in->normal[i], -1) : in->normal[i];
}

/* As one sees it who looks from where the normal is `facing`. */
static site site_at(const voronoi_sites *in, uint32_t i, uint32_t place, vec3 facing)
{
    uint32_t name = in->index ? in->index[i] : i;
    double unit = (double)(name * 2654435761u) / 4294967296.0 - 0.5; /* Knuth's multiplicative hash */
    vec3 at = vec3_axpy(2 * JITTER * unit * in->spacing[i], in->normal[i], in->position[i]);
    return (site){i, place, at, normal_towards(in, i, facing), in->spacing[i]};
}

static void fill_sieve(surroundings *s)
{
    const star_around around = {s->count, s->own.at, s->own.normal, s->own.spacing, s->x,       s->y,
                                s->z,     s->nx,     s->ny,         s->nz,          s->spacing, s->square};
    star_sieve_fill(&around, &s->sieve);
}

/* False when they are too many. */
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
    for (uint32_t k = 0; listed > 0 && k < (listed + SIDE_BY_SIDE - 1) / SIDE_BY_SIDE * SIDE_BY_SIDE; k++) {
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

/* False when the corners are in a line or farther apart than neighbours are. */
static bool span_triangle(const site *a, const site *b, const site *c, triangle *out)
{
    swap_if_greater(&a, &b);
    swap_if_greater(&b, &c);
    swap_if_greater(&a, &b);
    vec3 u = vec3_sub(b->at, a->at), v = vec3_sub(c->at, a->at);
    double u2 = vec3_norm2(u), v2 = vec3_norm2(v), uv2 = vec3_norm2(vec3_sub(u, v));
    if (!are_near(b, c, uv2) || !are_near(a, c, v2) || !are_near(a, b, u2)) return false;
    vec3 w = vec3_cross(u, v);
    double w2 = vec3_norm2(w),
           widest = 2 * STAR_WIDEST * compare_larger(a->spacing, compare_larger(b->spacing, c->spacing));
    if (!(w2 > FLATTEST * FLATTEST * u2 * v2) || !(u2 * v2 * uv2 < widest * widest * w2)) return false;
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
    out->hidden2 = VORONOI_OTHER_SIDE * VORONOI_OTHER_SIDE * vec3_norm2(out->facing);
    out->wide = deep2 < STAR_DEEP * STAR_DEEP * least * least;
    out->high = out->wide ? INFINITY : sqrt(deep2 / w2);
    out->low = -out->high;
    out->low_by = out->high_by = NULL;
    return true;
}

/* Takes away what is nearer to d. False when nothing is left. */
static inline bool cut_by(const site *d, triangle *t)
{
    double facing = vec3_dot(d->normal, t->facing);
    if (d->index == t->corner[0]->index || d->index == t->corner[1]->index ||
        d->index == t->corner[2]->index || (facing <= 0 && facing * facing >= t->hidden2))
        return true;
    vec3 q = vec3_sub(d->at, t->centre);
    double along = 2 * vec3_dot(t->across, q), rest = vec3_norm2(q) - t->radius2;
    /* places at t across the circumcentre are nearer to d where t along > rest */
    if (along > 0 && rest < along * t->high) {
        t->high = rest / along;
        t->high_by = d;
    } else if (along < 0 && rest < along * t->low) {
        t->low = rest / along;
        t->low_by = d;
    } else if (along == 0 && rest < 0)
        return false; /* d lies within */
    return t->low < t->high;
}

/* Which of the sites from `first` on cut_by may find to take something away: others cannot, however many go before. */
ISA_INLINE bool may_cut(const surroundings *s, uint32_t first, const triangle *t, int64_t may[SIDE_BY_SIDE])
{
    int64_t any = 0;
    for (uint32_t l = 0; l < SIDE_BY_SIDE; l++) {
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

/* Cuts by all that are near, or until nothing is left: false then. */
ISA_CLONES static bool cut_by_near(const surroundings *s, triangle *t)
{
    const double across2 = 4 * (1 + HAIR) * vec3_norm2(t->across), least2 = 4 * (1 + HAIR) * t->radius2;
    int64_t may[SIDE_BY_SIDE];
    for (uint32_t first = 0; first < s->count; first += SIDE_BY_SIDE) {
        /* what takes something away is in a ball about either end, and the point at hand is on both */
        const double end = -t->low > t->high ? -t->low : t->high;
        if (s->square[first] > least2 + across2 * end * end) return true;
        if (!may_cut(s, first, t, may)) continue;
        uint32_t bits = 0; /* which of them do is as good as random */
        for (uint32_t l = 0; l < SIDE_BY_SIDE; l++) bits |= (uint32_t)may[l] << l;
        if (s->count - first < SIDE_BY_SIDE) bits &= (1u << (s->count - first)) - 1;
        for (; bits; bits &= bits - 1)
            if (!cut_by(&s->near[first + (uint32_t)__builtin_ctz(bits)], t)) return false;
    }
    return true;
}

/* Whether a point is too far to take anything away, wherever it is moved along its normal. */
static inline bool is_beyond(const voronoi_sites *in, uint32_t i, const triangle *t, double longest)
{
    vec3 q = vec3_sub(in->position[i], t->centre);
    double along = 2 * vec3_dot(t->across, q), square = vec3_norm2(q), spacing = in->spacing[i];
    double moved = JITTER * (2 * spacing * longest + 2 * spacing * spacing + square);
    double rest = square - t->radius2 - moved;
    return rest >= along * t->low && rest >= along * t->high;
}

/* Points that a triangle was held against lately, by their lowest bits: what such a one takes away is gone. Lists of neighbours have
 * nearly the same points. */
enum { SEEN = 256 };

static bool cut_by_list(const voronoi_sites *in, uint32_t of, uint32_t seen[SEEN], triangle *t)
{
    const uint32_t *list = neighbours_list(in->near, of);
    const double across = vec3_norm(t->across);
    for (uint32_t k = 0; k < in->near->list_count[of]; k++) {
        const double end = -t->low > t->high ? -t->low : t->high;
        if (seen[list[k] % SEEN] == list[k]) continue;
        seen[list[k] % SEEN] = list[k];
        if (is_beyond(in, list[k], t, across * end)) continue;
        site d = site_at(in, list[k], k, t->facing);
        if (!cut_by(&d, t)) return false;
        if (t->low_by == &d) t->low_by = memcpy(&t->kept[0], &d, sizeof d);
        if (t->high_by == &d) t->high_by = memcpy(&t->kept[1], &d, sizeof d);
    }
    return true;
}

/* Whether the place as far from four points is inside, by the most of their normals. */
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

static bool is_across_surface(const triangle *t)
{
    bool low_inside = !t->low_by || is_end_inside(t, t->low, t->low_by);
    bool high_inside = t->high_by && is_end_inside(t, t->high, t->high_by);
    return low_inside != high_inside;
}

/* Whether a point is in the list of one of the first corners. */
static bool is_listed(const voronoi_sites *in, const triangle *t, int corners, uint32_t point)
{
    for (int corner = 0; corner < corners; corner++) {
        const uint32_t i = t->corner[corner]->index, *list = neighbours_list(in->near, i);
        for (uint32_t k = 0; k < in->near->list_count[i]; k++)
            if (list[k] == point) return true;
    }
    return false;
}

/* The same when all have their say that are near enough: what is not in the list of one corner is in another's, or in the lists of
 * those listed. The list of the point at hand has been looked at. */
static bool is_across_surface_wide(const voronoi_sites *in, uint32_t at_hand, triangle *t)
{
    uint32_t seen[SEEN];
    memset(seen, 0xff, sizeof seen); /* nobody */
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

/* Whether the point at hand and two of those around are a triangle of the surface: of the Delaunay
 * triangulation in space, between a tetrahedron whose circumcentre is inside and one whose is not. */
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

static bool is_other_side(const site *a, const site *b)
{
    return vec3_dot(a->normal, b->normal) <= VORONOI_OTHER_SIDE;
}

/* The clear star (star_lanes.h) of one point. */
#define RING_MAX 32

/* Points around the one at hand, by their angle in its tangent plane: places there, squared distances in
 * space. */
typedef struct ring {
    int count;
    uint32_t place[RING_MAX + 1];                             /* in the list; the last is scratch */
    double x[RING_MAX + 1], y[RING_MAX + 1], z[RING_MAX + 1]; /* z: along the normal */
    double square[RING_MAX + 1];
    double beyond; /* squared distance that the others have at least */
    double widest; /* largest spacing of those listed */
} ring;

/* Those within a squared distance. False when the surface bends, or they are too many. Which are within is as
 * good as random, so nothing branches on it. */
static bool gather_ring(const voronoi_sites *in, uint32_t a, double reach2, ring *out)
{
    const uint32_t *list = neighbours_list(in->near, a), listed = in->near->list_count[a];
    vec3 x = in->position[a], n = in->normal[a], u, v;
    double least = in->spacing[a], beyond = INFINITY, widest = least;
    int count = 0, bent = 0;
    vec3_frame(n, &u, &v);
    for (uint32_t k = 0; k < listed; k++) {
        uint32_t c = list[k];
        double facing = vec3_dot(n, normal_towards(in, c, n));
        if (facing <= STAR_OTHER_SIDE) continue;
        vec3 r = vec3_sub(in->position[c], x);
        double square = vec3_norm2(r), height = vec3_dot(n, r), spacing = in->spacing[c];
        bent |= (facing < STAR_FLAT_FACING) |
                (height * height > STAR_FLAT_HEIGHT * STAR_FLAT_HEIGHT * square) | (square == 0);
        least = spacing < least ? spacing : least;
        widest = spacing > widest ? spacing : widest;
        int within = square < reach2;
        double outside = within ? INFINITY : square;
        beyond = outside < beyond ? outside : beyond;
        out->place[count] = k;
        out->x[count] = vec3_dot(u, r);
        out->y[count] = vec3_dot(v, r);
        out->z[count] = height;
        out->square[count] = square;
        count += within;
        if (count > RING_MAX || bent) return false;
    }
    double unlisted = VORONOI_REACH * 0.5 * (in->spacing[a] + least);
    out->count = count;
    out->beyond = fmin(beyond, unlisted * unlisted);
    out->widest = widest;
    return true;
}

/* Numbers the ring's points by their angle, `order[0]` being the nearest. */
static void order_ring(const ring *r, int order[RING_MAX])
{
    double angle[RING_MAX];
    int rank[RING_MAX] = {0}, nearest = 0;
    for (int k = 0; k < r->count; k++) /* grows with the angle, from -2 to 2 */
        angle[k] = copysign(1 - r->x[k] / (fabs(r->x[k]) + fabs(r->y[k])), r->y[k]);
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

typedef enum verdict { CUT, KEPT, DOUBTFUL } verdict;

/* Whether the bisector of q keeps an edge between those of p and r, its neighbours clockwise and counter-
 * clockwise, that is longer than `clear`; or is cut away by as much. */
static verdict judge_edge(const ring *g, int p, int q, int r, double clear)
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

/* The cell's neighbours out of the ring, counterclockwise, in `hull`: the bisectors bound a polygon as the
 * points at 2 / distance span a convex hull (Graham's scan of it). Their number, 0: not clear. */
static int scan_hull(const ring *g, const int order[RING_MAX], double clear, int hull[RING_MAX + 1])
{
    int top = 0;
    hull[0] = order[0];
    for (int k = 1; k <= g->count; k++) {
        int next = order[k < g->count ? k : 0];
        while (top > 0) {
            verdict v = judge_edge(g, hull[top - 1], hull[top], next, clear);
            if (v == DOUBTFUL) return 0;
            if (v == KEPT) break;
            top--;
        }
        hull[++top] = next;
    }
    return top > 2 && judge_edge(g, hull[top - 1], hull[0], hull[1], clear) == KEPT ? top : 0;
}

/* Whether those beyond the ring are too far to come near the polygon's corners, which are those of angles of
 * 90 degrees at most: a bisector that misses such a corner by d lacks 2 d of an edge. */
static bool is_closed(const ring *g, int count, const int hull[RING_MAX + 1], double clear)
{
    double corner = sqrt(g->beyond) - clear; /* twice the farthest that a corner may lie */
    if (!(corner > 0)) return false;
    for (int k = 0; k < count; k++) {
        int q = hull[k], r = hull[k + 1];
        double plane = g->x[q] * g->x[q] + g->y[q] * g->y[q], dot = g->x[q] * g->x[r] + g->y[q] * g->y[r];
        double cross = g->x[q] * g->y[r] - g->y[q] * g->x[r];
        double rest = g->square[r] * plane - g->square[q] * dot;
        if (dot < 0 || rest * rest + g->square[q] * g->square[q] * cross * cross >
                           corner * corner * plane * cross * cross)
            return false;
    }
    return true;
}

/* Of each triangle of the star the cotangents of its outer angles, which halve the edges' lengths. */
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

bool voronoi_star_clear(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    ring g;
    int order[RING_MAX], hull[RING_MAX + 1];
    const double reach[2] = {STAR_RING_FIRST * in->spacing[a], INFINITY};
    for (int k = 0; k < 2; k++) {
        if (!gather_ring(in, a, reach[k] * reach[k], &g)) return false;
        if (g.count < 3) continue;
        order_ring(&g, order);
        double clear = STAR_CLEAR * g.widest;
        int count = scan_hull(&g, order, clear, hull);
        if (count == 0 || !is_closed(&g, count, hull, clear)) continue;
        measure_star(&g, neighbours_list(in->near, a), count, hull, out);
        return true;
    }
    return false;
}

/* Adds the triangle of a, b and c to the star of a, as seen along the edge between a and b. Returns the place
 * of b. */
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

/* Whom one has met on the way around a point: places in its surroundings. */
typedef struct tour {
    uint32_t count, met[VORONOI_STAR_MAX];
    bool done[VORONOI_STAR_MAX]; /* all triangles with it are in the star */
} tour;

/* Who may be in a triangle with b that is not done: who is near and not on another sheet. */
ISA_CLONES static uint32_t find_thirds(const surroundings *s, const site *b, const tour *t,
                                       uint32_t third[VORONOI_STAR_MAX])
{
    int64_t may[VORONOI_STAR_MAX];
    for (uint32_t k = 0; k < s->count; k++) {
        double x = s->x[k] - b->at.x, y = s->y[k] - b->at.y, z = s->z[k] - b->at.z;
        double reach = VORONOI_REACH * 0.5 * (b->spacing + s->spacing[k]);
        double facing = b->normal.x * s->nx[k] + b->normal.y * s->ny[k] + b->normal.z * s->nz[k];
        may[k] = (x * x + y * y + z * z <= (1 + HAIR) * (reach * reach)) & (facing > VORONOI_OTHER_SIDE);
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
    const uint32_t thirds = star_sieve_thirds(&s->sieve, at, find_thirds(s, b, t, third), third, by);
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

/* Goes around the point, from one neighbour over the triangles that the two are in to the next; and again
 * from another, where that does not lead around. */
void voronoi_star_triangles(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    surroundings s;
    tour t = {.count = 0};
    out->count = out->triangle_count = 0;
    out->pinched = !gather_sites(in, a, &s);
    if (out->pinched) return;
    for (uint32_t k = 0; k < s.count; k++) t.done[k] = is_other_side(&s.own, &s.near[k]); /* in none */
    for (uint32_t first = 0, next = 0; first < s.count && !is_closed_star(out); first++) {
        if (!t.done[first]) join_triangles(in, &s, first, &t, out);
        for (; next < t.count; next++)
            if (!t.done[t.met[next]]) join_triangles(in, &s, t.met[next], &t, out);
    }
}

void voronoi_star_at(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    if (!voronoi_star_clear(in, a, out)) voronoi_star_triangles(in, a, out);
}

double voronoi_star_area(const voronoi_star *star)
{
    double area = 0;
    for (uint32_t k = 0; k < star->count; k++) area += 0.25 * star->distance[k] * star->edge[k];
    return isfinite(area) ? area : 0;
}
