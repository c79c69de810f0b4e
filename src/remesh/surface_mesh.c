#include "remesh/surface_mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "remesh/geodesic_cells.h"

static const char what[] = "the mesh of the surface";

/* Sides of the pieces, in spacings: shorter ones make no better cells. */
static const double PIECES = 0.4;
/* An edge is flipped only if both triangles face what both faced before to this cosine. */
static const double FACING = 0.5;
/* Angles are the same where they differ by no more. */
static const double SAME_ANGLE = 1e-9;
/* Flips for each edge, at most: few need any. */
enum { MOST_FLIPS = 20 };

#define NONE SIZE_MAX

typedef struct flipping {
    const vec3 *at; /* of each name */
    uint32_t (*triangle)[3];
    size_t count;
    size_t *
        twin; /* of side 3 n + k, from corner k of triangle n to the next: the same side of its neighbour, or NONE */
    size_t *side_of; /* of each name a side that begins there */
    size_t *stack;
    bool *waits;
    size_t waiting;
    size_t *doubled; /* sides whose ends are joined by another edge, too */
    size_t doubled_count;
} flipping;

static size_t next(size_t side)
{
    return side % 3 == 2 ? side - 2 : side + 1;
}

static uint32_t start_of(const flipping *f, size_t side)
{
    return f->triangle[side / 3][side % 3];
}

/* ---- the dual ---- */

static size_t list_dual(const fine_mesh *f, const uint32_t *name, uint32_t (*out)[3])
{
    size_t count = 0;
    for (size_t n = 0; n < f->m.triangle_count; n++) {
        const uint32_t *t = f->m.triangle[n], a = name[t[0]], b = name[t[1]], c = name[t[2]];
        if (a == b || b == c || c == a || a == GEODESIC_CELLS_NONE || b == GEODESIC_CELLS_NONE ||
            c == GEODESIC_CELLS_NONE)
            continue;
        if (out) memcpy(out[count], (uint32_t[]){a, b, c}, sizeof out[count]);
        count++;
    }
    return count;
}

/* ---- flips ---- */

typedef struct directed {
    uint32_t from, to;
    size_t side;
} directed;

static int by_ends(const void *left, const void *right)
{
    const directed *a = left, *b = right;
    if (a->from != b->from) return a->from < b->from ? -1 : 1;
    if (a->to != b->to) return a->to < b->to ? -1 : 1;
    return a->side < b->side ? -1 : a->side > b->side;
}

/* How many sides lead from the first one's start to its end, in the order of by_ends. */
static size_t run_length(const directed *first, const directed *end)
{
    size_t count = 1;
    while (first + count < end && first[count].from == first->from && first[count].to == first->to) count++;
    return count;
}

static const directed *find_run(const directed *all, size_t sides, uint32_t from, uint32_t to)
{
    const directed wanted = {from, to, 0};
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

static uint32_t apex_of(const flipping *f, size_t side)
{
    return start_of(f, next(next(side)));
}

static void join_sides(flipping *f, size_t side, size_t twin)
{
    f->twin[side] = twin;
    if (twin != NONE) f->twin[twin] = side;
}

/* The triangles on either side of the edges between two points are no twins. */
static void part_along(flipping *f, const directed *all, uint32_t a, uint32_t b)
{
    const directed *end = all + 3 * f->count,
                   *side[2] = {find_run(all, 3 * f->count, a, b), find_run(all, 3 * f->count, b, a)};
    for (int way = 0; way < 2; way++)
        for (size_t k = 0; side[way] && k < run_length(side[way], end); k++)
            f->twin[side[way][k].side] = NONE;
}

/* Sides that stand once each way round are twins. Two that stand twice meet in two places, most often round a point that
 * has no other neighbours, whose triangles are no twins then. */
static bool find_twins(const surface_mesh_input *in, flipping *f, error *e)
{
    const size_t sides = 3 * f->count;
    directed *all = mem_array(sides, sizeof *all, what, e);
    if (!all) return false;
    for (size_t s = 0; s < sides; s++) {
        all[s] = (directed){start_of(f, s), start_of(f, next(s)), s};
        f->twin[s] = NONE;
        f->side_of[all[s].from] = s;
    }
    qsort(all, sides, sizeof *all, by_ends);
    for (size_t k = 0, n; k < sides; k += n) {
        const directed *one = &all[k], *other = find_run(all, sides, one->to, one->from);
        n = run_length(one, all + sides);
        if (one->from > one->to || !other || n > 2 || run_length(other, all + sides) != n) continue;
        const bool crossed = n == 2 && (apex_of(f, one[0].side) == apex_of(f, other[0].side) ||
                                        apex_of(f, one[1].side) == apex_of(f, other[1].side));
        for (size_t i = 0; i < n; i++) join_sides(f, one[i].side, other[crossed ? n - 1 - i : i].side);
        for (size_t i = 0; n == 2 && i < n; i++) f->doubled[f->doubled_count++] = one[i].side;
    }
    for (size_t k = 0; k < in->side_count; k++)
        part_along(f, all, in->name[in->side[k][0]], in->name[in->side[k][1]]);
    free(all);
    return true;
}

static double angle_at(vec3 p, vec3 a, vec3 b)
{
    const vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return atan2(vec3_norm(vec3_cross(u, v)), vec3_dot(u, v));
}

static vec3 facing_of(vec3 a, vec3 b, vec3 c)
{
    const vec3 across = vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
    return vec3_norm2(across) > 0 ? vec3_unit(across) : (vec3){0, 0, 0};
}

/* Whether an edge leads from a to b already; of a vertex that is no disc, true. */
static bool are_joined(const flipping *f, uint32_t a, uint32_t b)
{
    size_t s = f->side_of[a];
    const size_t begin = s;
    for (size_t steps = 0; steps < f->count; steps++) {
        if (start_of(f, next(s)) == b || start_of(f, next(next(s))) == b) return true;
        s = f->twin[next(next(s))];
        if (s == NONE) return true;
        if (s == begin) return false;
    }
    return true;
}

/* Whether there is room for an edge between c and d, as the triangles around one of them say. */
static bool may_join(const flipping *f, uint32_t c, uint32_t d)
{
    return c != d && (!are_joined(f, c, d) || !are_joined(f, d, c));
}

/* Whether the edge between a and b, with c and d opposite, is better between c and d. */
static bool is_better_flipped(const flipping *f, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    const vec3 *x = f->at;
    if (angle_at(x[c], x[a], x[b]) + angle_at(x[d], x[a], x[b]) <= M_PI + SAME_ANGLE) return false;
    const vec3 both = vec3_add(facing_of(x[a], x[b], x[c]), facing_of(x[b], x[a], x[d])),
               one = facing_of(x[c], x[d], x[b]), other = facing_of(x[d], x[c], x[a]);
    const double least = FACING * vec3_norm(both);
    return vec3_dot(both, one) > least && vec3_dot(both, other) > least && may_join(f, c, d);
}

static void wait_for(flipping *f, size_t side)
{
    if (f->twin[side] == NONE) return;
    const size_t s = side < f->twin[side] ? side : f->twin[side];
    if (f->waits[s]) return;
    f->waits[s] = true;
    f->stack[f->waiting++] = s;
}

/* Triangles a b c and b a d become c d b and d c a. */
static void flip(flipping *f, size_t s)
{
    const size_t t = f->twin[s], bc = f->twin[next(s)], ca = f->twin[next(next(s))], ad = f->twin[next(t)],
                 db = f->twin[next(next(t))];
    const uint32_t a = start_of(f, s), b = start_of(f, t), c = apex_of(f, s), d = apex_of(f, t);
    const size_t one = 3 * (s / 3), other = 3 * (t / 3);
    memcpy(f->triangle[s / 3], (uint32_t[]){c, d, b}, sizeof f->triangle[0]);
    memcpy(f->triangle[t / 3], (uint32_t[]){d, c, a}, sizeof f->triangle[0]);
    join_sides(f, one, other);
    join_sides(f, one + 1, db);
    join_sides(f, one + 2, bc);
    join_sides(f, other + 1, ca);
    join_sides(f, other + 2, ad);
    f->side_of[a] = other + 2;
    f->side_of[b] = one + 2;
    f->side_of[c] = one;
    f->side_of[d] = other;
    for (int k = 1; k < 3; k++) {
        wait_for(f, one + k);
        wait_for(f, other + k);
    }
}

/* Of two edges between the same points one goes, as far as others leave room for it. */
static void part_doubled(flipping *f)
{
    for (size_t k = 0; k < f->doubled_count; k++) {
        const size_t s = f->doubled[k], t = f->twin[s];
        const uint32_t c = apex_of(f, s), d = t == NONE ? c : apex_of(f, t);
        const bool is_left = k % 2 == 1 && start_of(f, s) == start_of(f, f->doubled[k - 1]) &&
                             start_of(f, next(s)) == start_of(f, next(f->doubled[k - 1]));
        if ((k % 2 == 0 || is_left) && may_join(f, c, d)) flip(f, s);
    }
}

static bool flip_edges(const surface_mesh_input *in, flipping *f, error *e)
{
    const size_t sides = 3 * f->count;
    f->twin = mem_array(sides, sizeof *f->twin, what, e);
    f->side_of = mem_array(in->names, sizeof *f->side_of, what, e);
    f->stack = mem_array(sides, sizeof *f->stack, what, e);
    f->waits = mem_array(sides, sizeof *f->waits, what, e);
    f->doubled = mem_array(sides, sizeof *f->doubled, what, e);
    bool ok = f->twin && f->side_of && f->stack && f->waits && f->doubled && find_twins(in, f, e);
    if (ok) part_doubled(f);
    for (size_t s = 0; ok && s < sides; s++) wait_for(f, s);
    for (size_t flips = 0; ok && f->waiting > 0 && flips < MOST_FLIPS * f->count;) {
        const size_t s = f->stack[--f->waiting], t = f->twin[s];
        f->waits[s] = false;
        if (t == NONE) continue;
        if (!is_better_flipped(f, start_of(f, s), start_of(f, t), apex_of(f, s), apex_of(f, t))) continue;
        flip(f, s);
        flips++;
    }
    free(f->twin);
    free(f->side_of);
    free(f->stack);
    free(f->waits);
    free(f->doubled);
    return ok;
}

/* ---- the whole ---- */

bool surface_mesh_make(const surface_mesh_input *in, uint32_t (**triangle)[3], size_t *count, error *e)
{
    fine_mesh fine = {0};
    uint32_t *name = NULL;
    flipping f = {0};
    vec3 *at = mem_array(in->names, sizeof *at, what, e);
    bool ok = at && fine_mesh_make(in->m, in->count, in->position, in->spacing, PIECES, &fine, e) &&
              geodesic_cells_grow(&fine, in->count, in->position, in->name, &name, e);
    for (size_t i = 0; ok && i < in->count; i++) at[in->name[i]] = in->position[i];
    if (ok) {
        f.at = at;
        f.count = list_dual(&fine, name, NULL);
        f.triangle = mem_array(f.count, sizeof *f.triangle, what, e);
        ok = f.triangle != NULL;
    }
    if (ok) list_dual(&fine, name, f.triangle);
    free(name);
    fine_mesh_free(&fine);
    ok = ok && flip_edges(in, &f, e);
    free(at);
    if (ok) {
        *triangle = f.triangle;
        *count = f.count;
    } else
        free(f.triangle);
    return ok;
}

/* The sides opposite of a vertex lead from one to the next: each begins where another ends, and all are passed on the way round. */
static bool is_closed_fan(const directed *side, size_t count)
{
    size_t at = 0, passed = 0;
    do {
        size_t k = 0, found = 0;
        for (size_t other = 0; other < count; other++)
            if (side[other].from == side[at].to) {
                k = other;
                found++;
            }
        if (found != 1) return false;
        at = k;
        passed++;
    } while (at != 0 && passed < count);
    return at == 0 && passed == count;
}

bool surface_mesh_find_discs(const uint32_t (*triangle)[3], size_t count, size_t names, bool *disc, error *e)
{
    size_t *first = mem_array(names + 2, sizeof *first, what, e);
    directed *side = mem_array(3 * count, sizeof *side, what, e);
    const bool ok = first && side;
    for (size_t c = 0; ok && c < 3 * count; c++) first[triangle[c / 3][c % 3] + 2]++;
    for (size_t v = 2; ok && v < names + 2; v++) first[v] += first[v - 1];
    for (size_t c = 0; ok && c < 3 * count; c++) {
        const uint32_t *t = triangle[c / 3];
        side[first[t[c % 3] + 1]++] = (directed){t[(c + 1) % 3], t[(c + 2) % 3], c};
    }
    for (size_t v = 0; ok && v < names; v++)
        disc[v] = first[v + 1] > first[v] && is_closed_fan(side + first[v], first[v + 1] - first[v]);
    free(first);
    free(side);
    return ok;
}
