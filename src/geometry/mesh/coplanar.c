// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/coplanar.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/mesh/contacts.h"
#include "geometry/mesh/linked_mesh.h"

static const char what[] = "the coplanar faces of the mesh";

enum { DIRECTIONS = 3 };
/* Oblique, orthogonal directions: parts of different planes seldom have the same distance from the origin and the same slope
 * along the first one. The faces around an axis have one slope along the axis, and different slopes along the others. */
static const vec3 oblique[DIRECTIONS] = {
    {0.5377, 0.3183, 0.7809}, {-0.5094, 0.8605, 0}, {-0.6720, -0.3978, 0.6248}};
/* Overlaps of intervals per part along the first direction up to which no other direction is tried, and the ratio of the
 * overlaps from which on another direction is used. A sweep in the order of the parts takes less time per overlap. */
static const double few_overlaps = 32, fewer_overlaps = 0.25;

/* A set of triangles in one plane that are connected by sides. Parts of one plane have overlapping intervals
 * [low, high] along each direction (see widen). */
typedef struct part {
    double low[DIRECTIONS], high[DIRECTIONS],
        height; /* height: of the triangle with the largest height over its longest side */
    bbox box;
    uint32_t first, count; /* range of the part in `by_part` */
} part;

typedef struct cutting {
    linked_mesh l;
    const mesh *m;
    const rounding *r;
    threads *pool;     /* for its flag to stop */
    uint32_t *part_of; /* per triangle: the root of its set, which identifies the part */
    part *parts;
    size_t part_count;
    uint32_t *by_part;
    uint32_t (*pairs)[2]; /* stack of pairs of triangles that may overlap */
    size_t pair_count, pair_room;
    uint32_t (*children)[2]; /* per triangle: first piece, number of pieces; 0 pieces: not cut */
    size_t children_room, children_count;
    size_t part_room;
    vec3 *normal; /* per part, at the index of its root: the unit normal */
    bool
        *closed; /* per triangle of the input: its component is closed (contacts.h); read at roots of parts */
    bool *turned; /* per triangle: the normal of the input triangle that it was cut from is opposite to that
                   * of the part. Not computed from the piece, since rounding may reverse thin pieces */
    size_t turned_room;
    uint32_t (*meetings)[2]; /* pairs of congruent triangles of two parts */
    size_t meeting_count, meeting_room;
    bool unfinished;
} cutting;

/* ---- planes */

typedef struct plane {
    vec3 at, normal; /* unit */
    double height;   /* triangle's height over its longest side */
} plane;

static plane plane_of(const vec3 corner[3])
{
    double longest2 = 0;
    for (int k = 0; k < 3; k++)
        longest2 = fmax(longest2, vec3_norm2(vec3_sub(corner[(k + 1) % 3], corner[k])));
    const vec3 across = vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
    return (plane){corner[0], vec3_unit(across), longest2 > 0 ? vec3_norm(across) / sqrt(longest2) : 0};
}

static double reach_of(const cutting *c, const vec3 a[3], const vec3 b[3])
{
    return fmax(rounding_reach(c->r, a), rounding_reach(c->r, b));
}

/* Whether b lies in the plane of a, the triangle with the more accurate plane. The tolerance is the rounding
 * error at the corners of a; it increases beyond them. */
static bool lies_in(const plane *a, const vec3 b[3], double reach)
{
    for (int k = 0; k < 3; k++) {
        const vec3 off = vec3_sub(b[k], a->at);
        if (!(fabs(vec3_dot(off, a->normal)) <= reach * (1 + vec3_norm(off) / a->height))) return false;
    }
    return true;
}

static bool is_one_plane(const cutting *c, const vec3 a[3], const vec3 b[3])
{
    const plane of_a = plane_of(a), of_b = plane_of(b);
    const double reach = reach_of(c, a, b);
    const bool first = of_a.height >= of_b.height;
    return (first ? of_a : of_b).height > reach && lies_in(first ? &of_a : &of_b, first ? b : a, reach);
}

/* ---- sorting of all parts */

/* Items that qsort sorts at once, in less than 0.1 s. */
enum { SORTED_AT_ONCE = 1 << 16 };
/* A part of the items that is smaller than this fraction does not make the rest easier to sort. */
enum { LEAST_SHARE = 32 };

static void swap_items(char *a, char *b, size_t size)
{
    char kept[sizeof(part)];
    assert(size <= sizeof kept);
    memcpy(kept, a, size);
    memcpy(a, b, size);
    memcpy(b, kept, size);
}

static char *middle_of(char *a, char *b, char *c, int (*compare)(const void *, const void *))
{
    const bool up = compare(a, b) < 0;
    if ((compare(b, c) < 0) == up) return b;
    return (compare(a, c) < 0) == up ? c : a;
}

/* qsort for a total order. If the pool is stopped, it ends soon, and the items have any order. */
static void sort(char *items, size_t count, size_t size, int (*compare)(const void *, const void *),
                 const threads *pool)
{
    while (count > SORTED_AT_ONCE && !threads_stopped(pool)) {
        size_t below = 0; /* items less than the first one: the last of them is at items + below * size */
        const size_t quarter = count / 4 * size;
        swap_items(items, middle_of(items + quarter, items + 2 * quarter, items + 3 * quarter, compare),
                   size);
        for (size_t k = 1; k < count; k++) {
            if (k % SORTED_AT_ONCE == 0 && threads_stopped(pool)) return;
            if (compare(items + k * size, items) < 0 && ++below < k)
                swap_items(items + below * size, items + k * size, size);
        }
        swap_items(items, items + below * size, size);
        if (below < count / LEAST_SHARE || below > count - count / LEAST_SHARE) break;
        sort(items, below, size, compare, pool);
        items += (below + 1) * size;
        count -= below + 1;
    }
    if (!threads_stopped(pool)) qsort(items, count, size, compare);
}

/* ---- parts of planes */

/* Whether the opposite corners of the two triangles at an edge from v lie on the same side of the edge. */
static bool is_folded(const cutting *c, uint32_t v, const mesh_side *s)
{
    const vec3 at = c->m->vertex[v], way = vec3_sub(c->m->vertex[s->other], at);
    vec3 off[2];
    for (int k = 0; k < 2; k++) {
        const uint32_t *t = c->m->triangle[s[k].triangle];
        const uint32_t beyond = t[0] + t[1] + t[2] - v - s->other;
        off[k] = vec3_sub(c->m->vertex[beyond], at);
        off[k] = vec3_axpy(-vec3_dot(off[k], way) / vec3_norm2(way), way, off[k]);
    }
    return vec3_dot(off[0], off[1]) > 0;
}

static bool join_parts(cutting *c, const mesh_edges *edges, error *e)
{
    c->part_of = mem_array(c->m->triangle_count, sizeof *c->part_of, what, e);
    if (!c->part_of) return false;
    sets_reset(c->part_of, c->m->triangle_count);
    for (uint32_t v = 0; v < edges->vertex_count && !threads_stopped(c->pool); v++)
        for (size_t k = edges->first[v], n; k < edges->first[v + 1]; k += n) {
            const mesh_side *s = edges->sides + k;
            vec3 a[3], b[3];
            n = mesh_edges_width(edges, v, k);
            if (n != 2) continue;
            mesh_get_corners(c->m, s[0].triangle, a);
            mesh_get_corners(c->m, s[1].triangle, b);
            if (is_one_plane(c, a, b) && !is_folded(c, v, s))
                sets_join(c->part_of, s[0].triangle, s[1].triangle);
        }
    for (uint32_t t = 0; t < c->m->triangle_count; t++) c->part_of[t] = sets_root(c->part_of, t);
    return true;
}

/* Extends the part's box by triangle t. If t has the largest height of the part so far, sets the part's
 * normal and its intervals [low, high]. An interval is centred at d / scale + slope: d is the distance of
 * the plane from the origin, and the slope is the component of the normal along the direction. Its
 * half-width is the error by rounding. Parts of one plane have overlapping intervals. */
static void widen(const cutting *c, double scale, uint32_t t, part *p)
{
    vec3 corner[3];
    mesh_get_corners(c->m, t, corner);
    const double reach = rounding_reach(c->r, corner);
    for (int k = 0; k < 3; k++) p->box = bbox_unite(p->box, bbox_grow((bbox){corner[k], corner[k]}, reach));
    const plane f = plane_of(corner);
    if (!(f.height > p->height)) return;
    const double error_of = 8 * reach / f.height;
    p->height = f.height;
    c->normal[c->part_of[t]] = f.normal;
    for (int d = 0; d < DIRECTIONS; d++) {
        const double number = fabs(vec3_dot(f.at, f.normal) / scale + vec3_dot(f.normal, oblique[d]));
        p->low[d] = number - error_of;
        p->high[d] = number + error_of;
    }
}

static int by_low(const void *left, const void *right)
{
    const part *a = left, *b = right;
    if (a->low[0] != b->low[0]) return a->low[0] < b->low[0] ? -1 : 1;
    return (a->first > b->first) - (a->first < b->first);
}

static bool list_parts(cutting *c, error *e)
{
    const size_t all = c->m->triangle_count;
    uint32_t *number = mem_array(all, sizeof *number, what, e);
    const bbox box = mesh_box(c->m, NULL);
    const double scale = bbox_longest(bbox_include(box, (vec3){0, 0, 0}));
    c->parts = mem_array(all, sizeof *c->parts, what, e);
    c->normal = mem_array(all, sizeof *c->normal, what, e);
    c->by_part = mem_array(all, sizeof *c->by_part, what, e);
    const bool ok = number && c->parts && c->by_part && c->normal;
    if (ok) {
        for (uint32_t t = 0; t < all; t++)
            if (c->part_of[t] == t) number[t] = (uint32_t)c->part_count++;
        for (size_t k = 0; k < c->part_count && !threads_stopped(c->pool); k++)
            c->parts[k].box = bbox_empty();
        for (uint32_t t = 0; t < all; t++) c->parts[number[c->part_of[t]]].count++;
        for (size_t k = 1; k < c->part_count; k++)
            c->parts[k].first = c->parts[k - 1].first + c->parts[k - 1].count;
        for (size_t k = 0; k < c->part_count; k++) c->parts[k].count = 0;
        for (uint32_t t = 0; t < all && !threads_stopped(c->pool); t++) {
            part *p = &c->parts[number[c->part_of[t]]];
            c->by_part[p->first + p->count++] = t;
            widen(c, scale, t, p);
        }
        sort((char *)c->parts, c->part_count, sizeof *c->parts, by_low, c->pool);
    }
    free(number);
    return ok && threads_may_go_on(c->pool, e);
}

/* ---- pairs of triangles */

/* Largest distance, over the sides of triangle a, by which all corners of b lie beyond the side, in the
 * plane. Negative: b lies beyond no side. */
static double gap_beyond(const vec3 a[3], vec3 normal, const vec3 b[3])
{
    double most = -INFINITY;
    const bool turned = vec3_dot(vec3_cross(vec3_sub(a[1], a[0]), vec3_sub(a[2], a[0])), normal) < 0;
    for (int k = 0; k < 3; k++) {
        const vec3 side = vec3_sub(a[(k + 1) % 3], a[k]),
                   out = vec3_scale(vec3_unit(vec3_cross(side, normal)), turned ? -1 : 1);
        double least = INFINITY;
        for (int i = 0; i < 3; i++) least = fmin(least, vec3_dot(vec3_sub(b[i], a[k]), out));
        most = fmax(most, least);
    }
    return most;
}

/* Whether two triangles of one plane overlap by more than the rounding error. */
static bool overlap(const cutting *c, uint32_t s, uint32_t t)
{
    const vec3 normal = c->normal[c->part_of[s]];
    vec3 a[3], b[3];
    mesh_get_corners(c->l.m, s, a);
    mesh_get_corners(c->l.m, t, b);
    const double most = -COPLANAR_THIN * reach_of(c, a, b);
    return gap_beyond(a, normal, b) < most && gap_beyond(b, normal, a) < most;
}

/* Tests the planes of the input triangles: pieces that are cut from a triangle stay in its plane. */
static bool overlap_in_plane(const cutting *c, uint32_t s, uint32_t t)
{
    vec3 a[3], b[3];
    mesh_get_corners(c->m, s, a);
    mesh_get_corners(c->m, t, b);
    return is_one_plane(c, a, b) && overlap(c, s, t);
}

static bool push_pair(cutting *c, uint32_t s, uint32_t t, error *e)
{
    if (!MEM_GROW(c->pairs, c->pair_count, &c->pair_room, what, e)) return false;
    c->pairs[c->pair_count][0] = s;
    c->pairs[c->pair_count++][1] = t;
    return true;
}

static bbox box_of(const cutting *c, uint32_t t)
{
    vec3 corner[3];
    mesh_get_corners(c->m, t, corner);
    const bbox tight =
        bbox_include(bbox_include(bbox_include(bbox_empty(), corner[0]), corner[1]), corner[2]);
    return bbox_grow(tight, rounding_reach(c->r, corner));
}

typedef struct boxed {
    bbox box;
    uint32_t triangle;
} boxed;

static int by_left(const void *left, const void *right)
{
    const boxed *a = left, *b = right;
    if (a->box.min.x != b->box.min.x) return a->box.min.x < b->box.min.x ? -1 : 1;
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

/* Lists the triangles of a part whose boxes overlap `box`, in ascending order of x. */
static size_t list_within(const cutting *c, const part *p, bbox box, boxed *out)
{
    size_t count = 0;
    for (uint32_t k = 0; k < p->count; k++) {
        const uint32_t t = c->by_part[p->first + k];
        const bbox own = box_of(c, t);
        if (bbox_overlap(own, box)) out[count++] = (boxed){own, t};
    }
    qsort(out, count, sizeof *out, by_left);
    return count;
}

static bool pair_parts(cutting *c, const part *a, const part *b, error *e)
{
    boxed *of_a = mem_array(a->count, sizeof *of_a, what, e);
    boxed *of_b = of_a ? mem_array(b->count, sizeof *of_b, what, e) : NULL;
    bool ok = of_b;
    if (ok) {
        const size_t count_a = list_within(c, a, b->box, of_a), count_b = list_within(c, b, a->box, of_b);
        double widest = 0;
        for (size_t k = 0; k < count_b; k++) widest = fmax(widest, of_b[k].box.max.x - of_b[k].box.min.x);
        for (size_t i = 0, first = 0; ok && i < count_a; i++) {
            while (first < count_b && of_b[first].box.min.x < of_a[i].box.min.x - widest) first++;
            for (size_t j = first; ok && j < count_b && of_b[j].box.min.x <= of_a[i].box.max.x; j++)
                if (bbox_overlap(of_a[i].box, of_b[j].box) &&
                    overlap_in_plane(c, of_a[i].triangle, of_b[j].triangle))
                    ok = push_pair(c, of_a[i].triangle, of_b[j].triangle, e);
        }
    }
    free(of_a);
    free(of_b);
    return ok;
}

/* ---- pairs of parts */

/* The intervals of all parts along a direction, ascending by `low`. */
typedef struct interval {
    double low, high;
    double highest; /* of the subtree whose root is this interval: the middle of its range (see walk) */
    uint32_t part;
} interval;

static int by_low_end(const void *left, const void *right)
{
    const interval *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    return (a->part > b->part) - (a->part < b->part);
}

static void list_intervals(const cutting *c, int direction, interval *list)
{
    for (size_t k = 0; k < c->part_count; k++) {
        const part *p = &c->parts[k];
        list[k] = (interval){p->low[direction], p->high[direction], 0, (uint32_t)k};
    }
    sort((char *)list, c->part_count, sizeof *list, by_low_end, c->pool);
}

/* Number of pairs of overlapping intervals. */
static double count_overlaps(const interval *list, size_t count, const threads *pool)
{
    double sum = 0;
    for (size_t k = 0; k < count && !threads_stopped(pool); k++) {
        size_t low = k, high = count; /* the intervals up to `low` begin at or below the end */
        while (high - low > 1) {
            const size_t middle = (low + high) / 2;
            if (list[middle].low <= list[k].high)
                low = middle;
            else
                high = middle;
        }
        sum += (double)(low - k);
    }
    return sum;
}

static double set_highest(interval *list, size_t begin, size_t end)
{
    if (begin == end) return -INFINITY;
    const size_t middle = begin + (end - begin) / 2;
    const double below = set_highest(list, begin, middle), above = set_highest(list, middle + 1, end);
    return list[middle].highest = fmax(list[middle].high, fmax(below, above));
}

/* A search for the later parts whose intervals overlap those of part i and whose boxes do. */
typedef struct part_search {
    const cutting *c;
    const interval *list;
    uint32_t i;
    double low, high;
    uint32_t *found;
    size_t count;
} part_search;

static void walk(part_search *s, size_t begin, size_t end)
{
    if (begin == end) return;
    const size_t middle = begin + (end - begin) / 2;
    const interval *at = &s->list[middle];
    const part *parts = s->c->parts;
    if (at->highest < s->low) return;
    walk(s, begin, middle);
    if (at->low > s->high) return;
    if (at->high >= s->low && at->part > s->i && parts[at->part].low[0] <= parts[s->i].high[0] &&
        bbox_overlap(parts[s->i].box, parts[at->part].box))
        s->found[s->count++] = at->part;
    walk(s, middle + 1, end);
}

/* Pairs the parts in ascending order of both, as pair_in_order does. */
static bool pair_by_intervals(cutting *c, int direction, interval *list, error *e)
{
    list_intervals(c, direction, list);
    set_highest(list, 0, c->part_count);
    part_search s = {.c = c, .list = list, .found = mem_array(c->part_count, sizeof *s.found, what, e)};
    bool ok = s.found;
    for (; ok && s.i < c->part_count && !threads_stopped(c->pool); s.i++) {
        const part *own = &c->parts[s.i];
        s.low = own->low[direction];
        s.high = own->high[direction];
        s.count = 0;
        walk(&s, 0, c->part_count);
        qsort(s.found, s.count, sizeof *s.found, compare_uint32);
        for (size_t k = 0; ok && k < s.count; k++) ok = pair_parts(c, own, &c->parts[s.found[k]], e);
    }
    free(s.found);
    return ok;
}

static bool pair_in_order(cutting *c, error *e)
{
    for (size_t i = 0; i < c->part_count && !threads_stopped(c->pool); i++)
        for (size_t j = i + 1; j < c->part_count && c->parts[j].low[0] <= c->parts[i].high[0]; j++)
            if (bbox_overlap(c->parts[i].box, c->parts[j].box) &&
                !pair_parts(c, &c->parts[i], &c->parts[j], e))
                return false;
    return true;
}

static bool find_pairs(cutting *c, error *e)
{
    interval *list = mem_array(c->part_count, sizeof *list, what, e);
    if (!list) return false;
    list_intervals(c, 0, list);
    const double first = count_overlaps(list, c->part_count, c->pool);
    double fewest = fewer_overlaps * first;
    int best = 0;
    for (int d = 1;
         d < DIRECTIONS && first > few_overlaps * (double)c->part_count && !threads_stopped(c->pool); d++) {
        list_intervals(c, d, list);
        const double overlaps = count_overlaps(list, c->part_count, c->pool);
        if (overlaps >= fewest) continue;
        fewest = overlaps;
        best = d;
    }
    const bool ok = best > 0 ? pair_by_intervals(c, best, list, e) : pair_in_order(c, e);
    free(list);
    return ok;
}

/* ---- cutting */

/* Enlarges the tables with an entry for each triangle to the current number of triangles. */
static bool extend_tables(cutting *c, error *e)
{
    for (; c->children_count < c->l.m->triangle_count; c->children_count++) {
        const size_t n = c->children_count;
        if (!MEM_GROW(c->children, n, &c->children_room, what, e)) return false;
        if (!MEM_GROW(c->part_of, n, &c->part_room, what, e)) return false;
        if (!MEM_GROW(c->turned, n, &c->turned_room, what, e)) return false;
        c->children[n][0] = c->children[n][1] = 0;
    }
    return true;
}

static bool note_children(cutting *c, uint32_t t, uint32_t first, uint32_t count, error *e)
{
    if (!extend_tables(c, e)) return false;
    c->children[t][0] = first;
    c->children[t][1] = count;
    for (uint32_t k = 0; k < count; k++) {
        c->part_of[first + k] = c->part_of[t];
        c->turned[first + k] = c->turned[t];
    }
    return true;
}

/* Cuts all triangles at the side from a to b at vertex v. */
static bool cut_side(cutting *c, uint32_t a, uint32_t b, uint32_t v, error *e)
{
    for (uint32_t k = c->l.head[a], next; k != LINKED_MESH_NONE; k = next) {
        const uint32_t t = k / 3;
        uint32_t corner[3], first, second;
        next = c->l.next[k];
        memcpy(corner, c->l.m->triangle[t], sizeof corner);
        const int of_a = linked_mesh_corner(corner, a), of_b = linked_mesh_corner(corner, b);
        if (of_b < 0) continue;
        linked_mesh_drop(&c->l, t);
        /* v is a corner of the triangle already: no area is left */
        if (linked_mesh_corner(corner, v) >= 0) continue;
        corner[of_b] = v;
        if (!linked_mesh_add(&c->l, corner, &first, e)) return false;
        corner[of_b] = b;
        corner[of_a] = v;
        if (!linked_mesh_add(&c->l, corner, &second, e) || !note_children(c, t, first, 2, e)) return false;
    }
    return true;
}

static bool cut_face(cutting *c, uint32_t t, uint32_t v, error *e)
{
    uint32_t whole[3], added[3];
    memcpy(whole, c->l.m->triangle[t], sizeof whole);
    linked_mesh_drop(&c->l, t);
    for (int k = 0; k < 3; k++) {
        const uint32_t corner[3] = {whole[k], whole[(k + 1) % 3], v};
        if (!linked_mesh_add(&c->l, corner, &added[k], e)) return false;
    }
    return note_children(c, t, added[0], 3, e);
}

/* Replaces vertex `from` by vertex `to`, whose position is equal within the rounding error. */
static void join(cutting *c, uint32_t to, uint32_t from)
{
    while (c->l.head[from] != LINKED_MESH_NONE) {
        const uint32_t k = c->l.head[from];
        if (linked_mesh_corner(c->l.m->triangle[k / 3], to) >= 0)
            linked_mesh_drop(&c->l, k / 3);
        else
            linked_mesh_move(&c->l, k, to);
    }
}

static double distance_from_side(vec3 a, vec3 b, vec3 x)
{
    const vec3 way = vec3_sub(b, a), off = vec3_sub(x, a);
    const double at = fmax(0, fmin(1, vec3_dot(off, way) / vec3_norm2(way)));
    return vec3_norm(vec3_axpy(-at, way, off));
}

/* Whether the side from a to b, of a triangle of the part `number`, is on the outline of the part: exactly
 * one triangle of the part has it. */
static bool is_outline(const cutting *c, uint32_t a, uint32_t b, uint32_t number)
{
    int count = 0;
    for (uint32_t k = c->l.head[a]; k != LINKED_MESH_NONE; k = c->l.next[k])
        count += c->part_of[k / 3] == number && linked_mesh_corner(c->l.m->triangle[k / 3], b) >= 0;
    return count == 1;
}

/* Whether the side of triangle t that begins at corner k is on the outline of its part. */
static bool ends_at(const cutting *c, uint32_t t, int k)
{
    const uint32_t *corner = c->l.m->triangle[t];
    return is_outline(c, corner[k % 3], corner[(k + 1) % 3], c->part_of[t]);
}

typedef enum step { STEP_NONE, STEP_DONE, STEP_FAILED } step;

static step outcome(bool ok)
{
    return ok ? STEP_DONE : STEP_FAILED;
}

/* Twice the signed area of the triangle (a, b, x), seen along the normal. */
static double turn(vec3 normal, vec3 a, vec3 b, vec3 x)
{
    return vec3_dot(vec3_cross(vec3_sub(b, a), vec3_sub(x, a)), normal);
}

/* Whether cutting the triangle at x, near its side from corner k, gives two pieces whose areas are at least
 * half of what the division of the side requires. Otherwise x is within the rounding error of another side,
 * and cuts could recreate the triangle without end. */
static bool is_cut_by(vec3 normal, const vec3 corner[3], int k, vec3 x)
{
    const vec3 a = corner[k], b = corner[(k + 1) % 3], top = corner[(k + 2) % 3];
    const double half = 0.5 * turn(normal, a, b, top) / vec3_norm(vec3_sub(b, a));
    return turn(normal, a, x, top) / half >= vec3_norm(vec3_sub(x, a)) &&
           turn(normal, x, b, top) / half >= vec3_norm(vec3_sub(b, x));
}

/* Cuts t at a corner of s inside t or on a side of t. The corner must be on the outline of its own part, or
 * the side of t on the outline of t's part. A corner of t within the tolerance is joined with the corner of
 * s instead. */
static step meet_corner(cutting *c, uint32_t s, uint32_t t, double reach, error *e)
{
    for (int k = 0; k < 3; k++) {
        const uint32_t v = c->l.m->triangle[s][k], *corner = c->l.m->triangle[t];
        const vec3 x = c->l.m->vertex[v];
        vec3 place[3];
        if (linked_mesh_corner(corner, v) >= 0) continue;
        mesh_get_corners(c->l.m, t, place);
        for (int i = 0; i < 3; i++)
            if (vec3_norm(vec3_sub(place[i], x)) <= COPLANAR_THIN * reach) {
                join(c, corner[i], v);
                return STEP_DONE;
            }
        const bool at_end = ends_at(c, s, k) || ends_at(c, s, k + 2);
        for (int i = 0; i < 3; i++)
            if (distance_from_side(place[i], place[(i + 1) % 3], x) <= reach &&
                (at_end || ends_at(c, t, i)) && is_cut_by(c->normal[c->part_of[t]], place, i, x))
                return outcome(cut_side(c, corner[i], corner[(i + 1) % 3], v, e));
        const vec3 one[3] = {x, x, x};
        if (at_end && gap_beyond(place, c->normal[c->part_of[t]], one) < -reach)
            return outcome(cut_face(c, t, v, e));
    }
    return STEP_NONE;
}

/* Cuts two sides of s and t at their intersection, if one of them is on the outline of its part. */
static step cross_sides(cutting *c, uint32_t s, uint32_t t, double reach, error *e)
{
    const vec3 normal = c->normal[c->part_of[s]];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const uint32_t a = c->l.m->triangle[s][i], b = c->l.m->triangle[s][(i + 1) % 3],
                           d = c->l.m->triangle[t][k], f = c->l.m->triangle[t][(k + 1) % 3];
            if (a == d || a == f || b == d || b == f) continue;
            const vec3 *v = c->l.m->vertex;
            const double of_a = turn(normal, v[d], v[f], v[a]), of_b = turn(normal, v[d], v[f], v[b]),
                         of_d = turn(normal, v[a], v[b], v[d]), of_f = turn(normal, v[a], v[b], v[f]);
            const double near_df = reach * vec3_norm(vec3_sub(v[f], v[d])),
                         near_ab = reach * vec3_norm(vec3_sub(v[b], v[a]));
            /* ends within `reach` of the other side are treated by meet_corner */
            if (!(of_a * of_b < 0 && of_d * of_f < 0) || fmin(fabs(of_a), fabs(of_b)) <= near_df ||
                fmin(fabs(of_d), fabs(of_f)) <= near_ab || !(ends_at(c, s, i) || ends_at(c, t, k)))
                continue;
            uint32_t x;
            const vec3 place = vec3_axpy(of_a / (of_a - of_b), vec3_sub(v[b], v[a]), v[a]);
            return outcome(linked_mesh_add_vertex(&c->l, place, &x, e) && cut_side(c, a, b, x, e) &&
                           cut_side(c, d, f, x, e));
        }
    return STEP_NONE;
}

/* Pushes all pairs of a piece of triangle s and a piece of triangle t. */
static bool push_children(cutting *c, uint32_t s, uint32_t t, error *e)
{
    const uint32_t alone_s[2] = {s, 1}, alone_t[2] = {t, 1}, *of_s = c->l.dead[s] ? c->children[s] : alone_s,
                   *of_t = c->l.dead[t] ? c->children[t] : alone_t;
    const uint32_t first_s = of_s[0], end_s = of_s[0] + of_s[1], first_t = of_t[0], end_t = of_t[0] + of_t[1];
    for (uint32_t i = first_s; i < end_s; i++)
        for (uint32_t k = first_t; k < end_t; k++)
            if (!push_pair(c, i, k, e)) return false;
    return true;
}

static bool note_meeting(cutting *c, uint32_t s, uint32_t t, error *e)
{
    if (!MEM_GROW(c->meetings, c->meeting_count, &c->meeting_room, what, e)) return false;
    c->meetings[c->meeting_count][0] = s;
    c->meetings[c->meeting_count++][1] = t;
    return true;
}

/* Makes one cut of a pair and puts the remaining pairs back on the stack. A pair that no outline crosses
 * coincides. */
static bool treat_pair(cutting *c, uint32_t s, uint32_t t, error *e)
{
    if (c->l.dead[s] || c->l.dead[t]) return push_children(c, s, t, e);
    if (!overlap(c, s, t)) return true;
    vec3 a[3], b[3];
    mesh_get_corners(c->l.m, s, a);
    mesh_get_corners(c->l.m, t, b);
    const double reach = reach_of(c, a, b);
    step did = meet_corner(c, s, t, reach, e);
    if (did == STEP_NONE) did = meet_corner(c, t, s, reach, e);
    if (did == STEP_NONE) did = cross_sides(c, s, t, reach, e);
    if (did == STEP_NONE) return note_meeting(c, s, t, e);
    return did == STEP_DONE && push_pair(c, s, t, e);
}

/* Coincident pairs are treated again if one triangle was cut since. `most` bounds the steps if rounding
 * causes cycles; an assembly whose parts touch over many small triangles takes 70 steps per pair. */
static bool treat_pairs(cutting *c, error *e)
{
    size_t most = ((size_t)1 << 16) + 256 * c->pair_count;
    while (c->pair_count > 0) {
        while (c->pair_count > 0 && most > 0) {
            const uint32_t *pair = c->pairs[--c->pair_count];
            most--;
            if (!treat_pair(c, pair[0], pair[1], e)) return false;
        }
        c->unfinished |= c->pair_count > 0;
        c->pair_count = 0;
        const size_t met = c->meeting_count;
        c->meeting_count = 0;
        for (size_t k = 0; k < met; k++) {
            const uint32_t s = c->meetings[k][0], t = c->meetings[k][1];
            if (c->l.dead[s] || c->l.dead[t]) {
                if (!push_children(c, s, t, e)) return false;
            } else {
                c->meetings[c->meeting_count][0] = s;
                c->meetings[c->meeting_count++][1] = t;
            }
        }
    }
    return true;
}

/* ---- removal of overlaps */

/* A triangle that lies in another part. `turned`: the triangle and the part have opposite orientations. */
typedef struct cover {
    uint32_t triangle, part;
    bool turned;
} cover;

static int by_triangle(const void *left, const void *right)
{
    const cover *a = left, *b = right;
    if (a->triangle != b->triangle) return a->triangle < b->triangle ? -1 : 1;
    return (a->part > b->part) - (a->part < b->part);
}

/* A triangle with all parts that contain it. Congruent triangles of different parts list the same parts. */
typedef struct place {
    uint32_t triangle, same, turned; /* first part with the orientation of the triangle, first part with the
                                      * opposite one */
    int balance;                     /* number of parts with the orientation of the triangle, minus parts
                                      * with the opposite one */
    unsigned char face;              /* state of the triangle, see contacts.h */
} place;

static place place_of(const cutting *c, const cover *own, size_t count)
{
    place p = {own->triangle, c->part_of[own->triangle], UINT32_MAX, 1, CONTACTS_REMAINS};
    for (size_t k = 0; k < count; k++) {
        p.balance += own[k].turned ? -1 : 1;
        uint32_t *first = own[k].turned ? &p.turned : &p.same;
        if (own[k].part < *first) *first = own[k].part;
    }
    return p;
}

/* Whether the triangle is the one to keep. With consistent orientations (`oriented`) it is the triangle of
 * the first part that has the orientation of the majority. Without, or if both orientations are equally
 * frequent, it is the triangle of the first part. */
static bool is_first(const cutting *c, const place *p, bool oriented)
{
    const uint32_t own = c->part_of[p->triangle];
    if (oriented && p->balance != 0) return p->balance > 0 && own == p->same;
    return own == (p->same < p->turned ? p->same : p->turned);
}

/* Lists the covers without duplicates, sorted by triangle. */
static size_t list_covers(const cutting *c, cover *list)
{
    size_t count = 0, kept = 0;
    for (size_t k = 0; k < c->meeting_count; k++) {
        const uint32_t s = c->meetings[k][0], t = c->meetings[k][1];
        const bool against = vec3_dot(c->normal[c->part_of[s]], c->normal[c->part_of[t]]) < 0,
                   turned = (c->turned[s] != c->turned[t]) != against;
        list[count++] = (cover){s, c->part_of[t], turned};
        list[count++] = (cover){t, c->part_of[s], turned};
    }
    qsort(list, count, sizeof *list, by_triangle);
    for (size_t k = 0; k < count; k++)
        if (k == 0 || by_triangle(&list[k], &list[kept - 1]) != 0) list[kept++] = list[k];
    return kept;
}

/* Whether all parts that contain the place are in closed components. */
static bool is_in_closed(const cutting *c, const place *p)
{
    return c->closed[c->part_of[p->triangle]] && (p->same == UINT32_MAX || c->closed[p->same]) &&
           (p->turned == UINT32_MAX || c->closed[p->turned]);
}

/* Sets the state of each place (contacts.h). */
static bool find_contacts(const cutting *c, place *places, size_t count, error *e)
{
    const size_t all = c->l.m->triangle_count;
    unsigned char *face = mem_array(all, sizeof *face, what, e);
    if (!face) return false;
    for (size_t t = 0; t < all; t++) face[t] = c->l.dead[t] ? CONTACTS_REMOVED : CONTACTS_REMAINS;
    for (size_t k = 0; k < count; k++) {
        const bool closed = is_in_closed(c, &places[k]);
        face[places[k].triangle] = closed && places[k].balance == 0  ? CONTACTS_CANCELS
                                   : is_first(c, &places[k], closed) ? CONTACTS_REMAINS
                                                                     : CONTACTS_REMOVED;
    }
    const bool ok = contacts_find_needed(c->l.m, face, e);
    for (size_t k = 0; k < count; k++) places[k].face = face[places[k].triangle];
    free(face);
    return ok;
}

/* Drops the triangle if it is redundant, and adds its area. Both faces of a contact are dropped, so each
 * adds half. */
static void drop_place(cutting *c, const place *p, coplanar_overlap *out)
{
    const double area = 0.5 * vec3_norm(mesh_across(c->l.m, p->triangle));
    if (p->face == CONTACTS_REMAINS || (p->face == CONTACTS_NEEDED && is_first(c, p, true))) return;
    if (p->face == CONTACTS_CANCELS)
        out->contact += area / 2;
    else
        *(p->turned != UINT32_MAX ? &out->opposite : &out->same) += area;
    linked_mesh_drop(&c->l, p->triangle);
}

static bool drop_covered(cutting *c, coplanar_overlap *out, error *e)
{
    cover *list = mem_array(2 * c->meeting_count, sizeof *list, what, e);
    place *places = list ? mem_array(2 * c->meeting_count, sizeof *places, what, e) : NULL;
    bool ok = places;
    if (ok) {
        const size_t covers = list_covers(c, list);
        size_t count = 0;
        for (size_t k = 0, n; k < covers; k += n) {
            for (n = 1; k + n < covers && list[k + n].triangle == list[k].triangle; n++) {
            }
            places[count++] = place_of(c, list + k, n);
        }
        ok = find_contacts(c, places, count, e);
        for (size_t k = 0; ok && k < count; k++) drop_place(c, &places[k], out);
    }
    free(list);
    free(places);
    return ok;
}

/* ---- public functions */

static bool cut_all(cutting *c, mesh *m, coplanar_overlap *out, error *e)
{
    if (!linked_mesh_begin(m, &c->l, e)) return false;
    m->welded = false;
    c->part_room = c->turned_room = m->triangle_count;
    c->turned = mem_array(m->triangle_count, sizeof *c->turned, what, e);
    for (uint32_t t = 0; c->turned && t < m->triangle_count; t++)
        c->turned[t] = vec3_dot(mesh_across(m, t), c->normal[c->part_of[t]]) < 0;
    c->children = mem_array(m->triangle_count, sizeof *c->children, what, e);
    c->children_room = c->children_count = m->triangle_count;
    return c->turned && c->children && treat_pairs(c, e) && (c->unfinished || drop_covered(c, out, e));
}

bool coplanar_cut(mesh *m, const mesh_edges *edges, const rounding *r, threads *pool, coplanar_overlap *out,
                  error *e)
{
    cutting c = {.m = m, .r = r, .pool = pool};
    c.l.m = m;
    *out = (coplanar_overlap){0};
    mesh before = {0};
    bool ok = join_parts(&c, edges, e) && threads_may_go_on(c.pool, e) && list_parts(&c, e) &&
              find_pairs(&c, e) && threads_may_go_on(c.pool, e);
    if (ok && c.pair_count > 0) {
        c.closed = mem_array(m->triangle_count, sizeof *c.closed, what, e);
        ok = c.closed && contacts_find_closed(m, edges, c.closed, e) && mesh_copy(m, NULL, &before, e) &&
             cut_all(&c, m, out, e);
    }
    linked_mesh_end(&c.l);
    if (ok && c.unfinished) {
        const mesh cut = *m;
        *m = before;
        before = cut;
        *out = (coplanar_overlap){.unfinished = true};
    }
    mesh_free(&before);
    free(c.part_of);
    free(c.parts);
    free(c.by_part);
    free(c.normal);
    free(c.closed);
    free(c.turned);
    free(c.pairs);
    free(c.meetings);
    free(c.children);
    return ok;
}
