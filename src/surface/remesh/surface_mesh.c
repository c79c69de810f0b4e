// SPDX-License-Identifier: Apache-2.0
#include "surface/remesh/surface_mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/sets.h"
#include "surface/remesh/geodesic_cells.h"

static const char what[] = "the mesh of the surface";

/* Maximum side, in spacings, of the pieces of the mesh on which cells are grown. Smaller pieces do not give
 * better cells. */
static const double PIECES = 0.4;
/* Minimum cosine between the normals of the triangles after a flip and the mean normal before it. */
static const double FACING = 0.5;
/* Tolerance for equal angles, radians. */
static const double SAME_ANGLE = 1e-9;
/* Maximum number of flips per edge; few are needed. */
enum { MOST_FLIPS = 20 };
/* Maximum passes over edges that are present twice: a flip can make another flip possible. */
enum { MOST_PARTINGS = 10 };

#define NONE SIZE_MAX

typedef struct edge_flips {
    const vec3 *at; /* position of each name */
    uint32_t (*triangle)[3];
    size_t count;
    size_t *twin; /* per side: the adjacent triangle's side at the same edge, or NONE. Side 3 n + k goes from
                   * corner k of triangle n to the next corner */
    bool *kept;   /* per side: it is along a curve and not flipped */
    double *off;  /* per side: distance between the edge of the two cells and the midpoint of their points */
    size_t *side_of; /* per name: a side that begins there, or NONE */
    size_t *stack;
    bool *waits;
    size_t waiting;
    uint32_t (*doubled)[2]; /* pairs of points that are joined by several edges */
    size_t doubled_count;
} edge_flips;

static size_t next(size_t side)
{
    return side % 3 == 2 ? side - 2 : side + 1;
}

static uint32_t start_of(const edge_flips *f, size_t side)
{
    return f->triangle[side / 3][side % 3];
}

/* ---- the dual ---- */

/* Lists the dual: one triangle for each piece whose three corners belong to different cells. of[n]: the
 * index of the triangle of piece n, or NONE. Returns the number of triangles. */
static size_t list_dual(const fine_mesh *f, const uint32_t *name, uint32_t (*out)[3], size_t *of)
{
    size_t count = 0;
    for (size_t n = 0; n < f->m.triangle_count; n++) {
        const uint32_t *t = f->m.triangle[n], a = name[t[0]], b = name[t[1]], c = name[t[2]];
        if (of) of[n] = NONE;
        if (a == b || b == c || c == a || a == GEODESIC_CELLS_NONE || b == GEODESIC_CELLS_NONE ||
            c == GEODESIC_CELLS_NONE)
            continue;
        if (out) memcpy(out[count], (uint32_t[]){a, b, c}, sizeof out[count]);
        if (of) of[n] = count;
        count++;
    }
    return count;
}

/* The piece adjacent to the piece `from` at its edge (u, v), and the index of u in it. NONE: the mesh ends
 * there, several pieces meet, or the orientations differ. */
static size_t piece_across(const fine_mesh *f, size_t from, uint32_t u, uint32_t v, uint32_t *corner)
{
    size_t found = NONE;
    for (size_t k = f->first[u]; k < f->first[u + 1]; k++) {
        const size_t n = f->around[k];
        const uint32_t *t = f->m.triangle[n];
        const int at = t[0] == u ? 0 : t[1] == u ? 1 : 2;
        if (n == from || (t[(at + 1) % 3] != v && t[(at + 2) % 3] != v)) continue;
        if (found != NONE || t[(at + 2) % 3] != v) return NONE;
        found = n;
        *corner = t[(at + 1) % 3];
    }
    return found;
}

/* Finds the twin of each side of the dual: follows the edge between two cells from the piece where a
 * third cell ends it to the next such piece. Cells that meet along several edges are thus joined by as
 * many sides. */
static void trace_sides(const fine_mesh *fine, const uint32_t *name, const size_t *triangle_of, edge_flips *f)
{
    const vec3 *x = fine->m.vertex;
    for (size_t s = 0; s < 3 * f->count; s++) f->twin[s] = NONE;
    for (size_t n = 0; n < fine->m.triangle_count; n++) {
        if (triangle_of[n] == NONE) continue;
        for (size_t k = 0; k < 3; k++) {
            const size_t side = 3 * triangle_of[n] + k;
            uint32_t u = fine->m.triangle[n][k], v = fine->m.triangle[n][(k + 1) % 3], w = 0;
            const uint32_t a = name[u], b = name[v];
            const vec3 middle = vec3_scale(vec3_add(f->at[a], f->at[b]), 0.5);
            double off = INFINITY;
            size_t piece = n, steps = 0;
            do {
                off = fmin(off, vec3_norm(vec3_sub(vec3_scale(vec3_add(x[u], x[v]), 0.5), middle)));
                piece = piece_across(fine, piece, u, v, &w);
                if (piece == NONE || triangle_of[piece] != NONE || (name[w] != a && name[w] != b)) break;
                *(name[w] == a ? &u : &v) = w;
            } while (++steps < fine->m.triangle_count);
            f->off[side] = off;
            if (piece == NONE || triangle_of[piece] == NONE) continue;
            const uint32_t *t = fine->m.triangle[piece];
            f->twin[side] = 3 * triangle_of[piece] + (t[0] == v ? 0 : t[1] == v ? 1 : 2);
        }
    }
}

/* ---- flips ---- */

typedef struct half_edge {
    uint32_t from, to;
    size_t side;
} half_edge;

static int by_ends(const void *left, const void *right)
{
    const half_edge *a = left, *b = right;
    if (a->from != b->from) return a->from < b->from ? -1 : 1;
    if (a->to != b->to) return a->to < b->to ? -1 : 1;
    return a->side < b->side ? -1 : a->side > b->side;
}

/* The number of sides with the same start and end as `first`, in the order of by_ends. */
static size_t run_length(const half_edge *first, const half_edge *end)
{
    size_t count = 1;
    while (first + count < end && first[count].from == first->from && first[count].to == first->to) count++;
    return count;
}

static const half_edge *find_run(const half_edge *all, size_t sides, uint32_t from, uint32_t to)
{
    const half_edge wanted = {from, to, 0};
    size_t low = 0, high = sides;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (by_ends(&all[middle], &wanted) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low < sides && all[low].from == from && all[low].to == to ? &all[low] : NULL;
}

static uint32_t apex_of(const edge_flips *f, size_t side)
{
    return start_of(f, next(next(side)));
}

static void join_sides(edge_flips *f, size_t side, size_t twin)
{
    f->twin[side] = twin;
    if (twin != NONE) f->twin[twin] = side;
}

/* Marks the edge between two points of a curve as kept: of several, the one nearest to the curve. */
static void keep_along(edge_flips *f, const half_edge *all, uint32_t a, uint32_t b)
{
    const half_edge *first = find_run(all, 3 * f->count, a, b), *best = first;
    if (!first) first = best = find_run(all, 3 * f->count, b, a);
    if (!first) return;
    for (size_t k = 1; k < run_length(first, all + 3 * f->count); k++)
        if (f->off[first[k].side] < f->off[best->side]) best = &first[k];
    f->kept[best->side] = true;
    if (f->twin[best->side] != NONE) f->kept[f->twin[best->side]] = true;
}

/* Sets `kept` from the curves, and lists the pairs of points that are joined by several edges. */
static bool list_sides(const surface_mesh_input *in, edge_flips *f, error *e)
{
    const size_t sides = 3 * f->count;
    half_edge *all = mem_array(sides, sizeof *all, what, e);
    if (!all) return false;
    for (size_t s = 0; s < sides; s++) all[s] = (half_edge){start_of(f, s), start_of(f, next(s)), s};
    qsort(all, sides, sizeof *all, by_ends);
    for (size_t k = 0, n; k < sides; k += n) {
        n = run_length(&all[k], all + sides);
        if (n == 1 || all[k].from > all[k].to) continue;
        f->doubled[f->doubled_count][0] = all[k].from;
        f->doubled[f->doubled_count++][1] = all[k].to;
    }
    for (size_t k = 0; k < in->side_count; k++)
        keep_along(f, all, in->name[in->side[k][0]], in->name[in->side[k][1]]);
    free(all);
    return true;
}

static double angle_at(vec3 p, vec3 a, vec3 b)
{
    const vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return elementary_atan2(vec3_norm(vec3_cross(u, v)), vec3_dot(u, v));
}

static vec3 facing_of(vec3 a, vec3 b, vec3 c)
{
    const vec3 across = vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
    return vec3_norm2(across) > 0 ? vec3_unit(across) : (vec3){0, 0, 0};
}

/* Whether an edge joins a and b, found by walking around a. True also if the triangles around a are not a
 * disc. */
static bool are_joined(const edge_flips *f, uint32_t a, uint32_t b)
{
    size_t s = f->side_of[a];
    const size_t begin = s;
    if (s == NONE) return true;
    for (size_t steps = 0; steps < f->count; steps++) {
        if (start_of(f, next(s)) == b || start_of(f, next(next(s))) == b) return true;
        s = f->twin[next(next(s))];
        if (s == NONE) return true;
        if (s == begin) return false;
    }
    return true;
}

/* Whether an edge between c and d may be added. It is refused only if the walks around both c and d report
 * an edge. */
static bool may_join(const edge_flips *f, uint32_t c, uint32_t d)
{
    return c != d && (!are_joined(f, c, d) || !are_joined(f, d, c));
}

/* Whether replacing the edge (a, b), with the opposite corners c and d, by (c, d) is an improvement. */
static bool is_better_flipped(const edge_flips *f, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    const vec3 *x = f->at;
    if (angle_at(x[c], x[a], x[b]) + angle_at(x[d], x[a], x[b]) <= M_PI + SAME_ANGLE) return false;
    const vec3 both = vec3_add(facing_of(x[a], x[b], x[c]), facing_of(x[b], x[a], x[d])),
               one = facing_of(x[c], x[d], x[b]), other = facing_of(x[d], x[c], x[a]);
    const double least = FACING * vec3_norm(both);
    return vec3_dot(both, one) > least && vec3_dot(both, other) > least && may_join(f, c, d);
}

static void wait_for(edge_flips *f, size_t side)
{
    if (f->twin[side] == NONE || f->kept[side]) return;
    const size_t s = side < f->twin[side] ? side : f->twin[side];
    if (f->waits[s]) return;
    f->waits[s] = true;
    f->stack[f->waiting++] = s;
}

/* Replaces the triangles (a, b, c) and (b, a, d) by (c, d, b) and (d, c, a). */
static void flip(edge_flips *f, size_t s)
{
    const size_t t = f->twin[s], bc = f->twin[next(s)], ca = f->twin[next(next(s))], ad = f->twin[next(t)],
                 db = f->twin[next(next(t))];
    const uint32_t a = start_of(f, s), b = start_of(f, t), c = apex_of(f, s), d = apex_of(f, t);
    const size_t one = 3 * (s / 3), other = 3 * (t / 3);
    const bool keep_bc = f->kept[next(s)], keep_ca = f->kept[next(next(s))], keep_ad = f->kept[next(t)],
               keep_db = f->kept[next(next(t))];
    memcpy(f->triangle[s / 3], (uint32_t[]){c, d, b}, sizeof f->triangle[0]);
    memcpy(f->triangle[t / 3], (uint32_t[]){d, c, a}, sizeof f->triangle[0]);
    join_sides(f, one, other);
    join_sides(f, one + 1, db);
    join_sides(f, one + 2, bc);
    join_sides(f, other + 1, ca);
    join_sides(f, other + 2, ad);
    f->kept[one] = f->kept[other] = false;
    f->kept[one + 1] = keep_db;
    f->kept[one + 2] = keep_bc;
    f->kept[other + 1] = keep_ca;
    f->kept[other + 2] = keep_ad;
    f->side_of[a] = other + 2;
    f->side_of[b] = one + 2;
    f->side_of[c] = one;
    f->side_of[d] = other;
    for (int k = 1; k < 3; k++) {
        wait_for(f, one + k);
        wait_for(f, other + k);
    }
}

/* Among the edges between two points that may be flipped, the one with the largest sum of opposite angles.
 * *edges: the number of all edges between them. */
static size_t worst_edge(const edge_flips *f, uint32_t a, uint32_t b, size_t *edges)
{
    const size_t begin = f->side_of[a];
    size_t worst = NONE;
    double widest = 0;
    *edges = 0;
    for (size_t s = begin, steps = 0; s != NONE && steps < f->count; steps++) {
        const size_t t = f->twin[s];
        if (start_of(f, next(s)) == b) {
            const uint32_t c = apex_of(f, s), d = t == NONE ? c : apex_of(f, t);
            const double wide =
                angle_at(f->at[c], f->at[a], f->at[b]) + angle_at(f->at[d], f->at[a], f->at[b]);
            ++*edges;
            if (t != NONE && !f->kept[s] && wide > widest && may_join(f, c, d)) {
                worst = s;
                widest = wide;
            }
        }
        s = f->twin[next(next(s))];
        if (s == begin) break;
    }
    return worst;
}

/* Flips all but one of several edges between the same points, where flips are permitted. */
static void part_doubled(edge_flips *f)
{
    for (int pass = 0; pass < MOST_PARTINGS; pass++) {
        size_t flips = 0, edges;
        for (size_t k = 0; k < f->doubled_count; k++) {
            const uint32_t *end = f->doubled[k];
            for (size_t s; (s = worst_edge(f, end[0], end[1], &edges)) != NONE && edges > 1; flips++)
                flip(f, s);
        }
        if (flips == 0) break;
    }
}

static void flip_edges(edge_flips *f)
{
    for (size_t s = 0; s < 3 * f->count; s++) wait_for(f, s);
    for (size_t flips = 0; f->waiting > 0 && flips < MOST_FLIPS * f->count;) {
        const size_t s = f->stack[--f->waiting], t = f->twin[s];
        f->waits[s] = false;
        if (t == NONE || f->kept[s]) continue;
        if (!is_better_flipped(f, start_of(f, s), start_of(f, t), apex_of(f, s), apex_of(f, t))) continue;
        flip(f, s);
        flips++;
    }
}

/* ---- points whose cell is surrounded by one other cell ---- */

/* The triangle at point a whose centroid is nearest to x. */
static size_t nearest_around(const edge_flips *f, uint32_t a, vec3 x)
{
    size_t nearest = NONE;
    double least = INFINITY;
    for (size_t s = f->side_of[a], steps = 0; s != NONE && steps < f->count; steps++) {
        const uint32_t *t = f->triangle[s / 3];
        const vec3 middle = vec3_scale(vec3_add(f->at[t[0]], vec3_add(f->at[t[1]], f->at[t[2]])), 1.0 / 3);
        const double away = vec3_norm(vec3_sub(middle, x));
        if (away < least) {
            least = away;
            nearest = s / 3;
        }
        s = f->twin[next(next(s))];
        if (s == f->side_of[a]) break;
    }
    return nearest;
}

/* Replaces triangle n = (p, q, r) by (p, q, v), and stores (q, r, v) and (r, p, v) at two free indices. */
static void cut_triangle(edge_flips *f, size_t n, uint32_t v, size_t second, size_t third)
{
    const uint32_t p = f->triangle[n][0], q = f->triangle[n][1], r = f->triangle[n][2];
    const size_t one = 3 * n, two = 3 * second, three = 3 * third, qr = f->twin[one + 1],
                 rp = f->twin[one + 2];
    memcpy(f->triangle[n], (uint32_t[]){p, q, v}, sizeof f->triangle[0]);
    memcpy(f->triangle[second], (uint32_t[]){q, r, v}, sizeof f->triangle[0]);
    memcpy(f->triangle[third], (uint32_t[]){r, p, v}, sizeof f->triangle[0]);
    f->off[two] = f->off[one + 1];
    f->off[three] = f->off[one + 2];
    f->off[one + 1] = f->off[one + 2] = f->off[two + 1] = f->off[two + 2] = f->off[three + 1] =
        f->off[three + 2] = INFINITY;
    join_sides(f, two, qr);
    join_sides(f, three, rp);
    join_sides(f, one + 1, two + 2);
    join_sides(f, two + 1, three + 2);
    join_sides(f, three + 1, one + 2);
    f->side_of[v] = one + 2;
    f->side_of[r] = three;
}

static void insert_point(edge_flips *f, size_t n, uint32_t v)
{
    cut_triangle(f, n, v, f->count, f->count + 1);
    f->count += 2;
}

/* Values of by[v]. IN_TRIANGLE: v is a corner of a triangle. NO_CELL: v has no cell. SEVERAL: several cells
 * touch that of v. v itself: its cell ends at a boundary of the mesh. Otherwise: the only point whose cell
 * touches that of v. */
#define NO_CELL GEODESIC_CELLS_NONE
#define IN_TRIANGLE (GEODESIC_CELLS_NONE - 1)
#define SEVERAL (GEODESIC_CELLS_NONE - 2)

static bool is_surrounded(const uint32_t *by, uint32_t v)
{
    return by[v] != NO_CELL && by[v] != IN_TRIANGLE && by[v] != v;
}

/* Whether the cell of v is a ring around a thin part (a spike or a bar): it touches two cells, but no three
 * cells meet at it. */
static bool is_ring(const uint32_t *by, const edge_flips *f, uint32_t v)
{
    return by[v] == SEVERAL && f->side_of[v] == NONE;
}

static void list_surrounded(const fine_mesh *fine, const uint32_t *name, const size_t *triangle_of,
                            size_t names, uint32_t *by)
{
    for (size_t v = 0; v < names; v++) by[v] = NO_CELL;
    for (size_t n = 0; n < fine->m.triangle_count; n++)
        for (int k = 0; triangle_of[n] != NONE && k < 3; k++) by[name[fine->m.triangle[n][k]]] = IN_TRIANGLE;
    for (size_t n = 0; n < fine->m.triangle_count; n++)
        for (int k = 0; k < 6; k++) {
            const uint32_t *t = fine->m.triangle[n], a = name[t[k / 2]], b = name[t[(k / 2 + 1 + k % 2) % 3]];
            if (a == b || a == GEODESIC_CELLS_NONE || b == GEODESIC_CELLS_NONE || by[a] == IN_TRIANGLE)
                continue;
            by[a] = by[a] == NO_CELL || by[a] == b ? b : SEVERAL;
        }
    for (size_t n = 0; n < fine->m.triangle_count; n++)
        for (int k = 0; k < 3; k++) {
            const uint32_t *t = fine->m.triangle[n], u = t[k], v = t[(k + 1) % 3];
            const uint32_t a = name[u], b = name[v];
            uint32_t beyond;
            const bool asks_a = a != GEODESIC_CELLS_NONE && is_surrounded(by, a),
                       asks_b = b != GEODESIC_CELLS_NONE && is_surrounded(by, b);
            if (!(asks_a || asks_b) || piece_across(fine, n, u, v, &beyond) != NONE) continue;
            if (asks_a) by[a] = a;
            if (asks_b) by[b] = b;
        }
}

/* Inserts surrounded points. A ring is inserted into a triangle at the adjacent cell that has triangles; the
 * next ring can be inserted then, and finally the point at the tip. */
static void insert_surrounded(const fine_mesh *fine, const uint32_t *name, const uint32_t *by, size_t names,
                              edge_flips *f)
{
    const size_t sides = 6 * fine->m.triangle_count;
    size_t rings = 0, left = SIZE_MAX;
    for (uint32_t v = 0; v < names; v++) rings += is_ring(by, f, v);
    /* alternate the direction: rings may be inserted in either order */
    for (bool back = false; rings > 0 && rings < left; back = !back) {
        left = rings;
        for (size_t k = 0; k < sides; k++) {
            const size_t s = back ? sides - 1 - k : k;
            const uint32_t *t = fine->m.triangle[s / 6], a = name[t[s / 2 % 3]],
                           b = name[t[(s / 2 + 1 + s % 2) % 3]];
            if (a == b || a == GEODESIC_CELLS_NONE || b == GEODESIC_CELLS_NONE || !is_ring(by, f, a))
                continue;
            const size_t n = nearest_around(f, b, f->at[a]);
            if (n == NONE) continue;
            insert_point(f, n, a);
            rings--;
        }
    }
    for (uint32_t v = 0; v < names; v++) {
        const size_t n = is_surrounded(by, v) && by[v] != SEVERAL ? nearest_around(f, by[v], f->at[v]) : NONE;
        if (n != NONE) insert_point(f, n, v);
    }
}

/* ---- points whose cell extends around a neck ---- */

/* The triangles at such a point form two fans, one at each end of its cell. One fan and one triangle of the
 * other fan are replaced by a band of triangles between their outlines: the neck. MOST_IN_RING: maximum
 * number of points of a fan. */
enum { MOST_IN_RING = 64 };

typedef struct ring {
    size_t count;
    size_t side[MOST_IN_RING]; /* sides between consecutive points; they belong to the triangles that are
                             * removed */
    uint32_t point[MOST_IN_RING];
} ring;

/* Lists the points around the point at which side `begin` starts. False: the fan is not closed, or has more
 * than MOST_IN_RING points. */
static bool walk_fan(const edge_flips *f, size_t begin, ring *out)
{
    out->count = 0;
    for (size_t s = begin;;) {
        if (out->count == MOST_IN_RING) return false;
        out->side[out->count] = next(s);
        out->point[out->count++] = start_of(f, next(s));
        s = f->twin[next(next(s))];
        if (s == NONE) return false;
        if (s == begin) return true;
    }
}

static bool has_triangle(const ring *r, size_t n)
{
    for (size_t k = 0; k < r->count; k++)
        if (r->side[k] / 3 == n) return true;
    return false;
}

static bool has_point(const ring *r, uint32_t v)
{
    for (size_t k = 0; k < r->count; k++)
        if (r->point[k] == v) return true;
    return false;
}

/* The outline of one triangle. */
static ring ring_of(const edge_flips *f, size_t side)
{
    ring r = {.count = 3};
    for (size_t k = 0; k < 3; k++, side = next(side)) {
        r.side[k] = side;
        r.point[k] = start_of(f, side);
    }
    return r;
}

/* Whether a fan and a triangle of another fan can be replaced by a band. */
static bool may_make_way(const edge_flips *f, const ring *fan, const ring *triangle)
{
    for (size_t k = 0; k < 3; k++) /* at a handle, both fans may have a common point */
        if (has_point(fan, triangle->point[k]) || f->twin[triangle->side[k]] == NONE ||
            has_triangle(fan, f->twin[triangle->side[k]] / 3))
            return false;
    for (size_t k = 0; k < fan->count; k++) {
        const size_t beyond = f->twin[fan->side[k]];
        if (beyond == NONE || has_triangle(fan, beyond / 3) || beyond / 3 == triangle->side[0] / 3)
            return false;
    }
    return true;
}

/* Finds the triangle of `fan` that is nearest to the points of `to`, among those that can be replaced. *out:
 * its outline. */
static bool find_triangle(const edge_flips *f, const ring *fan, const ring *to, ring *out)
{
    double least = INFINITY;
    for (size_t k = 0; k < fan->count; k++) {
        const uint32_t from = fan->point[k], opposite = apex_of(f, next(next(fan->side[k])));
        const ring r = ring_of(f, fan->side[k]);
        double away = 0;
        for (size_t i = 0; i < to->count; i++)
            away += vec3_norm(vec3_sub(f->at[from], f->at[to->point[i]])) +
                    vec3_norm(vec3_sub(f->at[opposite], f->at[to->point[i]]));
        if (!(away < least) || !may_make_way(f, to, &r)) continue;
        least = away;
        *out = r;
    }
    return isfinite(least);
}

static double apart(const edge_flips *f, const ring *a, size_t i, const ring *b, size_t j)
{
    return vec3_norm(vec3_sub(f->at[a->point[i % a->count]], f->at[b->point[j % b->count]]));
}

/* Fills the band between two outlines with triangles, in the slots of the removed triangles and in new ones:
 * two, or four if both outlines are triangles. One outline is followed forwards, the other one backwards. */
static void make_band(edge_flips *f, const ring *a, const ring *b)
{
    size_t outer[2][MOST_IN_RING], place[MOST_IN_RING + 3], i = 0, j = 0, first = NONE, last = NONE,
                                                            taken = 0;
    for (size_t k = 0; k < a->count; k++) {
        outer[0][k] = f->twin[a->side[k]];
        if (k == 0 || a->side[k] / 3 != a->side[0] / 3) place[taken++] = a->side[k] / 3;
    }
    for (size_t k = 0; k < 3; k++) outer[1][k] = f->twin[b->side[k]];
    place[taken++] = b->side[0] / 3;
    while (taken < a->count + 3) place[taken++] = f->count++;
    for (size_t n = 0; n < a->count * 3; n++)
        if (apart(f, a, n / 3, b, n % 3) < apart(f, a, i, b, j)) {
            i = n / 3;
            j = n % 3;
        }
    const size_t end_i = i + a->count, end_j = j; /* start of the next turn around b */
    j += 3;
    for (size_t n = 0; n < taken; n++) {
        const bool along = j == end_j || (i < end_i && apart(f, a, i + 1, b, j) <= apart(f, a, i, b, j - 1));
        const uint32_t from = a->point[i % a->count], to = a->point[(i + 1) % a->count], x = b->point[j % 3],
                       before = b->point[(j + 2) % 3];
        const size_t one = 3 * place[n], back = along ? one + 2 : one + 1, on = along ? one + 1 : one + 2,
                     beyond = along ? outer[0][i % a->count] : outer[1][(j + 2) % 3];
        memcpy(f->triangle[place[n]], along ? (uint32_t[]){from, to, x} : (uint32_t[]){before, x, from},
               sizeof f->triangle[0]);
        f->off[one] = f->off[beyond];
        f->off[one + 1] = f->off[one + 2] = INFINITY;
        join_sides(f, one, beyond);
        f->side_of[along ? from : before] = one;
        if (n > 0)
            join_sides(f, back, last);
        else
            first = back;
        last = on;
        if (along)
            i++;
        else
            j--;
    }
    join_sides(f, first, last);
}

/* Two points that meet only the point v and each other form two coincident triangles of opposite
 * orientation: inserts both points into another fan of v. */
static bool move_pair(edge_flips *f, const ring *pair, const ring *fan, size_t of_fan)
{
    const uint32_t v = start_of(f, of_fan), a = pair->point[0], b = pair->point[1];
    if (pair->count != 2 || f->twin[pair->side[0]] != pair->side[1] || has_point(fan, a) || has_point(fan, b))
        return false;
    f->side_of[v] = of_fan;
    cut_triangle(f, nearest_around(f, v, f->at[a]), a, pair->side[0] / 3, pair->side[1] / 3);
    insert_point(f, nearest_around(f, v, f->at[b]), b);
    return true;
}

/* Joins two fans of a point by a band. `one`, `other`: a side of each fan that begins at the point. */
static void join_fans(edge_flips *f, size_t one, size_t other)
{
    ring fan[2], triangle;
    if (start_of(f, one) != start_of(f, other) || !walk_fan(f, one, &fan[0]) || !walk_fan(f, other, &fan[1]))
        return;
    if (has_triangle(&fan[0], other / 3)) return;
    for (int k = 0; k < 2; k++)
        if (find_triangle(f, &fan[1 - k], &fan[k], &triangle)) {
            make_band(f, &fan[k], &triangle);
            return;
        }
    if (!move_pair(f, &fan[0], &fan[1], other)) move_pair(f, &fan[1], &fan[0], one);
}

/* Lists one side of each fan of a point, except of its first fan. */
static size_t list_fans(const edge_flips *f, size_t names, size_t *first, bool *seen, size_t *found)
{
    size_t count = 0;
    for (size_t v = 0; v < names; v++) first[v] = NONE;
    for (size_t s = 0; s < 3 * f->count; s++) {
        const uint32_t v = start_of(f, s);
        if (seen[s]) continue;
        for (size_t t = s; t != NONE && !seen[t]; t = f->twin[next(next(t))]) seen[t] = true;
        if (first[v] == NONE)
            first[v] = s;
        else
            found[count++] = s;
    }
    return count;
}

static bool make_room(edge_flips *f, size_t triangles, error *e)
{
    uint32_t(*triangle)[3] = mem_array(triangles, sizeof *triangle, what, e);
    size_t *twin = mem_array(3 * triangles, sizeof *twin, what, e);
    double *off = mem_array(3 * triangles, sizeof *off, what, e);
    const bool ok = triangle && twin && off;
    if (ok) {
        memcpy(triangle, f->triangle, f->count * sizeof *triangle);
        memcpy(twin, f->twin, 3 * f->count * sizeof *twin);
        memcpy(off, f->off, 3 * f->count * sizeof *off);
    }
    free(ok ? (void *)f->triangle : (void *)triangle);
    free(ok ? f->twin : twin);
    free(ok ? f->off : off);
    if (!ok) return false;
    f->triangle = triangle;
    f->twin = twin;
    f->off = off;
    return true;
}

static bool join_necks(edge_flips *f, size_t names, error *e)
{
    size_t *first = mem_array(names, sizeof *first, what, e),
           *found = mem_array(3 * f->count, sizeof *found, what, e);
    bool *seen = mem_array(3 * f->count, sizeof *seen, what, e);
    bool ok = first && found && seen;
    if (ok) {
        const size_t count = list_fans(f, names, first, seen, found);
        ok = count == 0 || make_room(f, f->count + 2 * count, e);
        for (size_t k = 0; ok && k < count; k++) join_fans(f, found[k], first[start_of(f, found[k])]);
    }
    free(first);
    free(found);
    free(seen);
    return ok;
}

static bool touches_end(const edge_flips *f, const ring *r)
{
    bool found = false;
    for (size_t k = 0; k < r->count; k++) found |= f->twin[r->side[k]] == NONE;
    return found;
}

/* Joins the parts of the dual. If two cells meet around a bar and no third cell does, the dual has two
 * parts: a band between a triangle of each joins them. If there are several bars between the same parts,
 * only one gets a band. */
static bool join_parts(const fine_mesh *fine, const uint32_t *name, edge_flips *f, size_t names, error *e)
{
    uint32_t *parent = mem_array(names, sizeof *parent, what, e);
    size_t parts = 0;
    bool ok = parent != NULL;
    if (ok) sets_reset(parent, names);
    for (size_t n = 0; ok && n < f->count; n++)
        for (int k = 0; k < 2; k++) sets_join(parent, f->triangle[n][k], f->triangle[n][k + 1]);
    for (uint32_t v = 0; ok && v < names; v++) parts += f->side_of[v] != NONE && sets_root(parent, v) == v;
    ok = ok && (parts < 2 || make_room(f, f->count + 4 * (parts - 1), e));
    for (size_t s = 0; ok && parts > 1 && s < 3 * fine->m.triangle_count; s++) {
        const uint32_t a = name[fine->m.triangle[s / 3][s % 3]],
                       b = name[fine->m.triangle[s / 3][next(s) % 3]];
        if (a == b || a == GEODESIC_CELLS_NONE || b == GEODESIC_CELLS_NONE || f->side_of[a] == NONE ||
            f->side_of[b] == NONE || sets_root(parent, a) == sets_root(parent, b))
            continue;
        const ring one = ring_of(f, 3 * nearest_around(f, a, f->at[b])),
                   other = ring_of(f, 3 * nearest_around(f, b, f->at[a]));
        if (touches_end(f, &one) || touches_end(f, &other)) continue;
        sets_join(parent, a, b);
        parts--;
        make_band(f, &one, &other);
    }
    free(parent);
    return ok;
}

/* ---- public functions ---- */

/* Makes the dual of the cells, with the twin of each side. */
static bool make_dual(const surface_mesh_input *in, const fine_mesh *fine, const uint32_t *name,
                      edge_flips *f, error *e)
{
    size_t *triangle_of = mem_array(fine->m.triangle_count, sizeof *triangle_of, what, e), lost = 0;
    uint32_t *by = mem_array(in->names, sizeof *by, what, e);
    f->side_of = mem_array(in->names, sizeof *f->side_of, what, e);
    bool ok = triangle_of && by && f->side_of;
    if (ok) {
        f->count = list_dual(fine, name, NULL, triangle_of);
        list_surrounded(fine, name, triangle_of, in->names, by);
        for (uint32_t v = 0; v < in->names; v++) lost += is_surrounded(by, v);
        const size_t most = f->count + 2 * lost;
        f->triangle = mem_array(most, sizeof *f->triangle, what, e);
        f->twin = mem_array(3 * most, sizeof *f->twin, what, e);
        f->off = mem_array(3 * most, sizeof *f->off, what, e);
        ok = f->triangle && f->twin && f->off;
    }
    if (ok) {
        list_dual(fine, name, f->triangle, NULL);
        for (size_t v = 0; v < in->names; v++) f->side_of[v] = NONE;
        for (size_t s = 0; s < 3 * f->count; s++) f->side_of[start_of(f, s)] = s;
        trace_sides(fine, name, triangle_of, f);
        insert_surrounded(fine, name, by, in->names, f);
        ok = join_necks(f, in->names, e) && join_parts(fine, name, f, in->names, e);
    }
    free(triangle_of);
    free(by);
    return ok;
}

static bool improve(const surface_mesh_input *in, edge_flips *f, error *e)
{
    const size_t sides = 3 * f->count;
    f->kept = mem_array(sides, sizeof *f->kept, what, e);
    f->stack = mem_array(sides, sizeof *f->stack, what, e);
    f->waits = mem_array(sides, sizeof *f->waits, what, e);
    f->doubled = mem_array(sides, sizeof *f->doubled, what, e);
    if (!f->kept || !f->stack || !f->waits || !f->doubled || !list_sides(in, f, e)) return false;
    part_doubled(f);
    flip_edges(f);
    part_doubled(f);
    return true;
}

bool surface_mesh_make(const surface_mesh_input *in, uint32_t (**triangle)[3], size_t *count, error *e)
{
    fine_mesh fine = {0};
    uint32_t *name = NULL;
    edge_flips f = {0};
    vec3 *at = mem_array(in->names, sizeof *at, what, e);
    bool ok = at && fine_mesh_make(in->m, in->part, in->count, in->position, in->spacing, PIECES, &fine, e) &&
              geodesic_cells_grow(&fine, in->count, in->position, in->name, &name, e);
    for (size_t i = 0; ok && i < in->count; i++) at[in->name[i]] = in->position[i];
    f.at = at;
    ok = ok && make_dual(in, &fine, name, &f, e);
    free(name);
    fine_mesh_free(&fine);
    ok = ok && improve(in, &f, e);
    free(at);
    free(f.twin);
    free(f.off);
    free(f.kept);
    free(f.side_of);
    free(f.stack);
    free(f.waits);
    free(f.doubled);
    if (ok) {
        *triangle = f.triangle;
        *count = f.count;
    } else
        free(f.triangle);
    return ok;
}
