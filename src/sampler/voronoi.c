#include "sampler/voronoi.h"

/* A Voronoi edge is cut off this far from its middle, in units of the spacing: nothing bounds it there. */
static const double EDGE_LIMIT = 1.5;
/* Voronoi edges shorter than this fraction of that limit belong to four points nearly on a circle, whose
 * two diagonals are judged in slightly different planes: they are settled by one rule for both. */
static const double EDGE_DOUBT = 0.1;

/* A ridge between two points is taken to be no higher than this, of their distance; 0.5 is that of a right
 * angle. */
static const double RIDGE_HIGHEST = 0.75, RIDGE_STEEPEST = 0.2;

/* The angle at p under which a and b are seen. */
static double angle_at(vec3 p, vec3 a, vec3 b)
{
    vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return atan2(vec3_norm(vec3_cross(u, v)), vec3_dot(u, v));
}

/* The cotangent of the angle at p under which a and b are seen. */
static double cotangent_at(vec3 p, vec3 a, vec3 b)
{
    vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return vec3_dot(u, v) / vec3_norm(vec3_cross(u, v));
}

/* Between the circumcentres of the triangles a b c and a b d, unfolded about their edge. */
static double dual_length(vec3 a, vec3 b, vec3 c, vec3 d)
{
    double length = 0.5 * vec3_norm(vec3_sub(b, a)) * (cotangent_at(c, a, b) + cotangent_at(d, a, b));
    return isfinite(length) ? fmax(length, 0) : 0;
}

/* Of a quadrilateral a c b d that nearly lies on a circle: is ab its Delaunay diagonal, rather than cd?
 * The same answer for either diagonal. */
static bool is_diagonal(const vec3 *x, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    double opposite = angle_at(x[c], x[a], x[b]) + angle_at(x[d], x[a], x[b]);
    double own = angle_at(x[a], x[c], x[d]) + angle_at(x[b], x[c], x[d]);
    if (opposite != own) return opposite < own;
    return (a < b ? a : b) < (c < d ? c : d);
}

/* How far above the middle of r the tangent planes of its ends meet: on a crease that is where the surface
 * is, and its points there have the say whether the two are neighbours. */
static double ridge_rise(vec3 r, vec3 normal_a, vec3 normal_b, vec3 up)
{
    double a = -vec3_dot(normal_a, r), b = vec3_dot(normal_b, r);
    double rise = 0.25 * (a / fmax(vec3_dot(normal_a, up), RIDGE_STEEPEST) +
                          b / fmax(vec3_dot(normal_b, up), RIDGE_STEEPEST));
    double most = RIDGE_HIGHEST * vec3_norm(r);
    return fmin(fmax(rise, -most), most);
}

/* The bisector of two points, m + t d for t from low to high: what others have left of it. */
typedef struct bisector {
    uint32_t a, b; /* a < b */
    vec3 m, d;
    double quarter; /* squared distance from m to either end */
    vec3 n;         /* sum of their normals */
    double hidden;  /* points whose normals' product with n is no more than this are on another sheet */
    double low, high, doubt;
    uint32_t low_by, high_by; /* a: nobody */
} bisector;

static bisector bisector_of(const voronoi_sites *in, uint32_t a, uint32_t b, vec3 r)
{
    vec3 n = vec3_add(in->normal[a], in->normal[b]);
    vec3 d = vec3_unit(vec3_cross(n, r));
    vec3 up = vec3_unit(vec3_cross(r, d));
    double rise = ridge_rise(r, in->normal[a], in->normal[b], up);
    double limit = EDGE_LIMIT * fmax(in->spacing[a], in->spacing[b]);
    return (bisector){.a = a,
                      .b = b,
                      .m = vec3_axpy(rise, up, vec3_axpy(0.5, r, in->position[a])),
                      .d = d,
                      .quarter = 0.25 * vec3_norm2(r) + rise * rise,
                      .n = n,
                      .hidden = VORONOI_OTHER_SIDE * vec3_norm(n),
                      .low = -limit,
                      .high = limit,
                      .doubt = EDGE_DOUBT * limit,
                      .low_by = a,
                      .high_by = a};
}

/* Takes away what is nearer to the points of the list of `of`. False when nothing is left for sure. */
static bool cut_by_list(const voronoi_sites *in, uint32_t of, bisector *s)
{
    const uint32_t *list = neighbours_list(in->near, of);
    for (uint32_t k = 0; k < in->near->list_count[of]; k++) {
        uint32_t c = list[k];
        if (c == s->a || c == s->b || vec3_dot(in->normal[c], s->n) <= s->hidden) continue;
        vec3 q = vec3_sub(in->position[c], s->m);
        double along = 2 * vec3_dot(s->d, q), rest = vec3_norm2(q) - s->quarter;
        /* points m + t d of the bisector are nearer to c where 2 t d.q > |q|^2 - |r|^2 / 4 */
        if (along > 0 && rest < along * s->high) {
            s->high = rest / along;
            s->high_by = c;
        } else if (along < 0 && rest < along * s->low) {
            s->low = rest / along;
            s->low_by = c;
        } else if (along == 0 && rest < 0)
            return false; /* c lies between the two */
        if (s->high - s->low < -s->doubt) return false;
    }
    return true;
}

/* An edge reaching into a hole may be cut from beyond the lists: by points in the lists of those listed. */
static bool cut_across_hole(const voronoi_sites *in, bisector *s)
{
    double listed = 0.5 * VORONOI_REACH * in->spacing[s->a], end = fmax(s->high, -s->low);
    if (end * end + s->quarter < listed * listed) return true;
    const uint32_t *list = neighbours_list(in->near, s->a);
    for (uint32_t k = 0; k < in->near->list_count[s->a]; k++)
        if (!cut_by_list(in, list[k], s)) return false;
    return true;
}

bool voronoi_edge(const voronoi_sites *in, uint32_t a, uint32_t b, double *length)
{
    if (a > b) { /* one view of each pair */
        uint32_t swap = a;
        a = b;
        b = swap;
    }
    vec3 r = vec3_sub(in->position[b], in->position[a]);
    double farthest = VORONOI_REACH * 0.5 * (in->spacing[a] + in->spacing[b]);
    if (vec3_norm2(r) > farthest * farthest) return false;
    bisector s = bisector_of(in, a, b, r);
    if (!cut_by_list(in, a, &s) || !cut_across_hole(in, &s)) return false;
    bool open = s.low_by == a || s.high_by == a;
    *length =
        open ? fmax(s.high - s.low, 0)
             : dual_length(in->position[a], in->position[b], in->position[s.low_by], in->position[s.high_by]);
    if (open || s.high - s.low > s.doubt) return s.high > s.low;
    return is_diagonal(in->position, a, b, s.low_by, s.high_by);
}

static bool is_joined(const voronoi_sites *in, uint32_t a, uint32_t b, double *edge)
{
    return vec3_dot(in->normal[a], in->normal[b]) > VORONOI_OTHER_SIDE && voronoi_edge(in, a, b, edge);
}

/* The clear star: a point's cell in its tangent plane. Distances there are those in space, so that on a
 * sphere the cell's edges are the very bisectors of voronoi_edge; elsewhere these lie off the plane by
 * terms of second order in how far the surface bends within the lists, which FLAT_FACING and FLAT_HEIGHT
 * bound. A cell whose every edge is CLEAR times as long as what voronoi_edge doubts, and whose other
 * points would have to come as much nearer to have one, has the edges that voronoi_edge finds. */
static const double FLAT_FACING = 0.9, FLAT_HEIGHT = 0.22; /* the cosine of an angle, the sine of its half */
/* Half of FLAT_FACING's angle away from VORONOI_OTHER_SIDE: on another sheet for every pair. */
static const double FLAT_OTHER_SIDE = -0.77;
/* On the tests' sets stars differ from pairs at 0.1, and no more at 0.5. */
static const double CLEAR = 1.5;
/* Points that are looked at first, as far away as this in spacings: mostly the cell's neighbours alone. */
static const double RING_FIRST = 1.45;

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
        double facing = vec3_dot(n, in->normal[c]);
        if (facing <= FLAT_OTHER_SIDE) continue;
        vec3 r = vec3_sub(in->position[c], x);
        double square = vec3_norm2(r), height = vec3_dot(n, r), spacing = in->spacing[c];
        bent |=
            (facing < FLAT_FACING) | (height * height > FLAT_HEIGHT * FLAT_HEIGHT * square) | (square == 0);
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
    out->count = (uint32_t)count;
    for (int k = 0; k < count; k++) {
        out->place[k] = g->place[hull[k]];
        out->point[k] = list[out->place[k]];
        out->distance[k] = sqrt(g->square[hull[k]]);
        out->edge[k] = 0;
    }
    for (int k = 0; k < count; k++) {
        int q = hull[k], r = hull[k + 1], next = k + 1 < count ? k + 1 : 0;
        double dot = g->x[q] * g->x[r] + g->y[q] * g->y[r] + g->z[q] * g->z[r];
        double half = 0.5 / sqrt(g->square[q] * g->square[r] - dot * dot);
        out->edge[k] += half * out->distance[k] * (g->square[r] - dot);
        out->edge[next] += half * out->distance[next] * (g->square[q] - dot);
    }
    for (int k = 0; k < count; k++) out->edge[k] = fmax(out->edge[k], 0);
}

bool voronoi_star_clear(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    ring g;
    int order[RING_MAX], hull[RING_MAX + 1];
    const double reach[2] = {RING_FIRST * in->spacing[a], INFINITY};
    for (int k = 0; k < 2; k++) {
        if (!gather_ring(in, a, reach[k] * reach[k], &g)) return false;
        if (g.count < 3) continue;
        order_ring(&g, order);
        double clear = CLEAR * EDGE_DOUBT * EDGE_LIMIT * g.widest;
        int count = scan_hull(&g, order, clear, hull);
        if (count == 0 || !is_closed(&g, count, hull, clear)) continue;
        measure_star(&g, neighbours_list(in->near, a), count, hull, out);
        return true;
    }
    return false;
}

/* Beside a corner a bisector may be cut by a point that is joined to one of its ends alone. The triangles at
 * an edge are those with the points that both its ends are joined to, where these are two: then all triangles
 * around a point make up its cell. */
static void measure_triangles(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    bool joined[RING_MAX][RING_MAX] = {{false}};
    uint32_t count = out->count;
    if (count > RING_MAX) return; /* a crowd has no such order */
    for (uint32_t k = 0; k < count; k++)
        for (uint32_t l = 0; l < k; l++)
            joined[k][l] = joined[l][k] = is_joined(in, out->point[k], out->point[l], &(double){0});
    for (uint32_t k = 0; k < count; k++) {
        uint32_t third[RING_MAX], thirds = 0;
        for (uint32_t l = 0; l < count; l++)
            if (joined[k][l]) third[thirds++] = out->point[l];
        if (thirds == 2)
            out->edge[k] = dual_length(in->position[a], in->position[out->point[k]], in->position[third[0]],
                                       in->position[third[1]]);
    }
}

void voronoi_star_at(const voronoi_sites *in, uint32_t a, voronoi_star *out)
{
    if (voronoi_star_clear(in, a, out)) return;
    const uint32_t *list = neighbours_list(in->near, a);
    out->count = 0;
    for (uint32_t k = 0; k < in->near->list_count[a]; k++) {
        uint32_t b = list[k];
        double edge;
        if (!is_joined(in, a, b, &edge)) continue;
        if (out->count < VORONOI_STAR_MAX) {
            out->point[out->count] = b;
            out->place[out->count] = k;
            out->distance[out->count] = vec3_norm(vec3_sub(in->position[b], in->position[a]));
            out->edge[out->count] = edge;
        }
        out->count++;
    }
    measure_triangles(in, a, out);
}
