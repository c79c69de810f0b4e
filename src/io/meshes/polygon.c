// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/polygon.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/precision.h"
#include "geometry/space/vec3.h"

#define NONE UINT32_MAX

/* Maximum amount of work: tests of a corner against an ear, plus searched cells. */
static const uint64_t most_work = (uint64_t)1 << 30;
/* Maximum amount of work of searches that find no ear: a base, and per corner. Without crossings there is an ear, and
 * rounding lets a few searches fail. Beyond it the remaining corners are cut off as they come. */
static const uint64_t most_in_vain = (uint64_t)1 << 18, most_in_vain_per_corner = 256;
/* Relative tolerance for equal diagonals of a quadrangle: those of a rectangle differ by the rounding of
 * floats. */
static const double same_length = 1e-6;
/* Maximum area of flipped triangles, as a fraction of the polygon's area. Beyond it triangles overlap; below
 * it the corners are rounded. */
static const double crossed_area = 1e-6;

/* Maximum number of corners whose order is stored without allocation. */
enum { FEW_CORNERS = 64 };

/* The state of the cutting of a polygon. Corners are numbered around the polygon from 0. */
typedef struct cutting {
    const uint32_t *corner;
    size_t count;
    double (*at)[2]; /* per corner: its position in the plane, in which the polygon is counter-clockwise */
    uint32_t *next, *previous;
    bool *reflex;           /* per corner: it is not convex, and not clipped, so that it may lie in an ear */
    uint32_t *in_cell;      /* per corner: the next one in its cell */
    uint32_t *cell;         /* per cell: its first reflex corner */
    size_t side;            /* number of cells along each axis */
    double low[2], size[2]; /* lowest corner of the grid; size of a cell */
    const volatile sig_atomic_t *stop;
    uint64_t work, in_vain; /* in_vain: of searches that found no ear */
    size_t made;            /* number of triangles */
    double area, crossed;   /* twice the total area of the triangles, and that of the flipped ones */
} cutting;

/* ---- orientation */

/* Adds a number to an expansion: a sum of `count` doubles that do not overlap. Exact. */
static int add_exactly(double *sum, int count, double added)
{
    for (int k = 0; k < count; k++) {
        const double both = sum[k] + added, other = both - sum[k];
        sum[k] = (sum[k] - (both - other)) + (added - other);
        added = both;
    }
    sum[count] = added;
    return count + 1;
}

static int add_product(double *sum, int count, double a, double b)
{
    const double high = a * b;
    count = add_exactly(sum, count, fma(a, b, -high));
    return add_exactly(sum, count, high);
}

/* Exact sign of orient: the six products are expanded, and the largest component that is not zero has the
 * sign. */
static double orient_exactly(const double a[2], const double b[2], const double c[2])
{
    const double product[6][2] = {{a[0], b[1]},  {-a[0], c[1]}, {-c[0], b[1]},
                                  {-a[1], b[0]}, {a[1], c[0]},  {c[1], b[0]}};
    double sum[13];
    int count = 0;
    for (int k = 0; k < 6; k++) count = add_product(sum, count, product[k][0], product[k][1]);
    while (count > 0 && sum[count - 1] == 0) count--;
    return count > 0 ? sum[count - 1] : 0;
}

/* Twice the signed area of the triangle a, b, c: positive if it turns to the left. The sign is exact; the
 * error bound that decides whether exact arithmetic is needed is Shewchuk's. */
static double orient(const double a[2], const double b[2], const double c[2])
{
    static const double bound = 3.3306690738754716e-16;
    const double left = (a[0] - c[0]) * (b[1] - c[1]), right = (a[1] - c[1]) * (b[0] - c[0]),
                 turn = left - right;
    return fabs(turn) > bound * (fabs(left) + fabs(right)) ? turn : orient_exactly(a, b, c);
}

static double orient_corners(const cutting *c, uint32_t a, uint32_t b, uint32_t to)
{
    return orient(c->at[a], c->at[b], c->at[to]);
}

/* ---- normals */

static vec3 vector(const double at[3])
{
    return vec3_make(at[0], at[1], at[2]);
}

/* Normal of a triangle, as long as twice its area. */
static vec3 triangle_normal(const double a[3], const double b[3], const double c[3])
{
    return vec3_cross(vec3_sub(vector(b), vector(a)), vec3_sub(vector(c), vector(a)));
}

/* The sum over the fan about the first corner: Newell's normal. */
static vec3 polygon_normal(const double (*place)[3], const uint32_t *corner, size_t count)
{
    vec3 sum = {0, 0, 0};
    for (size_t k = 1; k + 1 < count; k++)
        sum = vec3_add(sum, triangle_normal(place[corner[0]], place[corner[k]], place[corner[k + 1]]));
    return sum;
}

/* ---- spikes */

/* Maximum distance of a corner from the line through two others if the exact positions of all three are
 * collinear and each is rounded (geometry/mesh/rounding.h). */
static double reach_of(const double (*place)[3], const uint32_t *corner, size_t count)
{
    static const double of_double = 6 * 0x1p-53, of_float = 0x1p-24;
    double largest = 0;
    bool are_floats = true;
    for (size_t k = 0; k < count; k++)
        for (int axis = 0; axis < 3; axis++) {
            const double x = place[corner[k]][axis];
            largest = fmax(largest, fabs(x));
            are_floats &= precision_as_float(x) == x;
        }
    return 2 * sqrt(3) * largest * (of_double + (are_floats ? of_float : 0));
}

/* Whether the two sides at a tip coincide within rounding, so that the triangle there has no area. Whether
 * such sides cross depends on rounding alone. */
static bool is_spike(const double before[3], const double tip[3], const double after[3], double reach)
{
    const vec3 a = vec3_sub(vector(before), vector(tip)), b = vec3_sub(vector(after), vector(tip));
    return vec3_dot(a, b) > 0 &&
           vec3_norm(vec3_cross(a, b)) <= reach * sqrt(fmax(vec3_norm2(a), vec3_norm2(b)));
}

/* ---- fans */

/* Whether the normals of all triangles of the fan about corner `first` are on the side of `normal`. */
static bool is_fan(const double (*place)[3], const uint32_t *corner, size_t count, size_t first, vec3 normal)
{
    for (size_t k = 1; k + 1 < count; k++) {
        const vec3 n = triangle_normal(place[corner[first]], place[corner[(first + k) % count]],
                                       place[corner[(first + k + 1) % count]]);
        if (!(vec3_dot(n, normal) > 0)) return false;
    }
    return true;
}

static void make_fan(const uint32_t *corner, size_t count, size_t first, uint32_t (*out)[3])
{
    for (size_t k = 1; k + 1 < count; k++) {
        out[k - 1][0] = corner[first];
        out[k - 1][1] = corner[(first + k) % count];
        out[k - 1][2] = corner[(first + k + 1) % count];
    }
}

static bool is_same(const double a[3], const double b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* Lexicographic order of coordinates. */
static bool is_before(const double a[3], const double b[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (a[axis] != b[axis]) return a[axis] < b[axis];
    return false;
}

/* The corner whose position is lexicographically the lowest. */
static size_t first_corner(const double (*place)[3], const uint32_t *corner, size_t count)
{
    size_t first = 0;
    for (size_t k = 1; k < count; k++)
        if (is_before(place[corner[k]], place[corner[first]])) first = k;
    return first;
}

/* The corner of a quadrangle after the tip of a spike; 4: there is no spike. */
static size_t after_spike(const double (*place)[3], const uint32_t *corner)
{
    const double reach = reach_of(place, corner, 4);
    for (size_t k = 0; k < 4; k++)
        if (is_spike(place[corner[(k + 3) % 4]], place[corner[k]], place[corner[(k + 1) % 4]], reach))
            return (k + 1) % 4;
    return 4;
}

/* Cuts a quadrangle along its shorter diagonal that lies inside. If neither does, it has a spike, which is
 * cut off, or it crosses itself or has no area. */
static polygon_result cut_quadrangle(const double (*place)[3], const uint32_t *corner, vec3 normal,
                                     uint32_t (*out)[3])
{
    double length2[2];
    bool inside[2];
    for (size_t k = 0; k < 2; k++) {
        length2[k] = vec3_norm2(vec3_sub(vector(place[corner[k + 2]]), vector(place[corner[k]])));
        inside[k] = is_fan(place, corner, 4, k, normal);
    }
    const bool are_equal = fabs(length2[1] - length2[0]) <= same_length * fmax(length2[0], length2[1]);
    const size_t shorter = are_equal ? first_corner(place, corner, 4) % 2 : length2[1] < length2[0];
    if (inside[0] || inside[1]) {
        make_fan(corner, 4, inside[0] && inside[1] ? shorter : inside[1], out);
        return POLYGON_CUT;
    }
    const size_t first = after_spike(place, corner);
    make_fan(corner, 4, first < 4 ? first : shorter, out);
    return first < 4 || !(vec3_norm2(normal) > 0) ? POLYGON_CUT : POLYGON_CROSSED;
}

/* ---- ears */

static size_t cell_along(const cutting *c, int axis, double x)
{
    const double k = (x - c->low[axis]) / c->size[axis];
    return k > 0 ? k < (double)(c->side - 1) ? (size_t)k : c->side - 1 : 0;
}

static bool is_at(const cutting *c, uint32_t a, uint32_t b)
{
    return c->at[a][0] == c->at[b][0] && c->at[a][1] == c->at[b][1];
}

/* Whether an edge of corner q enters the ear. Corner q is at the position of corner k of the ear. */
static bool goes_into(const cutting *c, const uint32_t ear[3], int k, uint32_t q)
{
    const uint32_t ends[2] = {c->next[q], c->previous[q]};
    for (int n = 0; n < 2; n++)
        if (orient_corners(c, ear[k], ear[(k + 1) % 3], ends[n]) > 0 &&
            orient_corners(c, ear[(k + 2) % 3], ear[k], ends[n]) > 0)
            return true;
    return false;
}

/* Whether corner q obstructs the ear: q is in the closed triangle and is not one of its corners. A corner at
 * the position of one of the ear's corners obstructs if an edge of it enters the ear. */
static bool hinders(const cutting *c, const uint32_t ear[3], uint32_t q)
{
    if (q == ear[0] || q == ear[1] || q == ear[2]) return false;
    for (int k = 0; k < 3; k++)
        if (is_at(c, q, ear[k])) return goes_into(c, ear, k, q);
    for (int k = 0; k < 3; k++)
        if (orient_corners(c, ear[k], ear[(k + 1) % 3], q) < 0) return false;
    return true;
}

static bool is_free(cutting *c, const uint32_t ear[3])
{
    size_t from[2], to[2];
    for (int axis = 0; axis < 2; axis++) {
        const double a = c->at[ear[0]][axis], b = c->at[ear[1]][axis], d = c->at[ear[2]][axis];
        from[axis] = cell_along(c, axis, fmin(a, fmin(b, d)));
        to[axis] = cell_along(c, axis, fmax(a, fmax(b, d)));
    }
    for (size_t x = from[0]; x <= to[0]; x++)
        for (size_t y = from[1]; y <= to[1]; y++) {
            c->work++;
            for (uint32_t q = c->cell[x * c->side + y]; q != NONE; q = c->in_cell[q], c->work++)
                if (c->reflex[q] && hinders(c, ear, q)) return false;
        }
    return true;
}

static void ear_of(const cutting *c, uint32_t tip, uint32_t ear[3])
{
    ear[0] = c->previous[tip];
    ear[1] = tip;
    ear[2] = c->next[tip];
}

static double turn_at(const cutting *c, uint32_t tip)
{
    return orient_corners(c, c->previous[tip], tip, c->next[tip]);
}

static bool is_stopped(const cutting *c)
{
    return c->stop && __atomic_load_n(c->stop, __ATOMIC_RELAXED);
}

/* Finds the next ear, from corner `from`. If there is none, the polygon crosses itself or the remainder has
 * no area: returns the first corner that does not turn to the right, or `from`; without a search after too many in
 * vain. */
static uint32_t find_ear(cutting *c, uint32_t from, size_t left)
{
    const uint64_t before = c->work;
    uint32_t flat = NONE, tip = from;
    if (c->in_vain > most_in_vain + most_in_vain_per_corner * c->count) return from;
    for (size_t k = 0; k < left; k++, tip = c->next[tip]) {
        const double turn = turn_at(c, tip);
        uint32_t ear[3];
        ear_of(c, tip, ear);
        if (turn > 0 && is_free(c, ear)) return tip;
        if (turn >= 0 && flat == NONE) flat = tip;
        if (++c->work > most_work || is_stopped(c)) break;
    }
    c->in_vain += c->work - before;
    return flat != NONE ? flat : from;
}

/* Cuts off the ear at `tip`. Returns the next corner. */
static uint32_t clip(cutting *c, uint32_t tip, uint32_t (*out)[3])
{
    uint32_t ear[3];
    ear_of(c, tip, ear);
    const double twice = turn_at(c, tip);
    c->area += twice;
    c->crossed += fmax(-twice, 0);
    for (int k = 0; k < 3; k++) out[c->made][k] = c->corner[ear[k]];
    c->made++;
    c->reflex[tip] = false;
    c->next[ear[0]] = ear[2];
    c->previous[ear[2]] = ear[0];
    for (int k = 0; k < 3; k += 2) c->reflex[ear[k]] = turn_at(c, ear[k]) <= 0;
    return ear[2];
}

static bool is_spike_at(const cutting *c, const double (*place)[3], double reach, uint32_t tip)
{
    uint32_t ear[3];
    ear_of(c, tip, ear);
    const double *before = place[c->corner[ear[0]]], *at = place[c->corner[tip]],
                 *after = place[c->corner[ear[2]]];
    return is_same(before, at) || is_same(at, after) || is_spike(before, at, after, reach);
}

/* Cuts off spikes, before ears are clipped: an ear may contain a spike whose sides cross by rounding, and
 * cutting makes corners reflex. A spike, or a side without length, may appear behind another one. Returns one of the remaining
 * corners. */
static uint32_t clip_spikes(cutting *c, const double (*place)[3], uint32_t (*out)[3])
{
    const double reach = reach_of(place, c->corner, c->count);
    uint32_t tip = 0;
    for (size_t ahead = c->count; ahead > 0 && c->count - c->made >= 3; ahead--) {
        if (is_spike_at(c, place, reach, tip)) {
            tip = c->previous[clip(c, tip, out)];
            ahead++;
        } else {
            tip = c->next[tip];
        }
    }
    return tip;
}

static polygon_result clip_ears(cutting *c, uint32_t tip, uint32_t (*out)[3])
{
    while (c->count - c->made >= 3) {
        tip = find_ear(c, tip, c->count - c->made);
        if (is_stopped(c)) return POLYGON_STOPPED;
        if (c->work > most_work) return POLYGON_TOO_LARGE;
        tip = c->next[clip(c, tip, out)]; /* skip a corner: avoids many triangles at one corner */
    }
    return c->crossed > crossed_area * c->area ? POLYGON_CROSSED : POLYGON_CUT;
}

/* Projects the corners along the axis of the longest component of the normal. */
static void project(cutting *c, const double (*place)[3], vec3 normal)
{
    int along = 0;
    for (int k = 1; k < 3; k++)
        if (fabs(vec3_get(normal, k)) > fabs(vec3_get(normal, along))) along = k;
    const bool turned = vec3_get(normal, along) < 0;
    for (size_t k = 0; k < c->count; k++) {
        const double *p = place[c->corner[k]];
        c->at[k][turned] = p[(along + 1) % 3];
        c->at[k][!turned] = p[(along + 2) % 3];
    }
}

static void link_corners(cutting *c)
{
    for (uint32_t k = 0; k < c->count; k++) {
        c->next[k] = k + 1 < c->count ? k + 1 : 0;
        c->previous[k] = k > 0 ? k - 1 : (uint32_t)c->count - 1;
    }
}

/* Makes a grid with about as many cells as there are reflex corners. `tip` is one of the remaining
 * corners. */
static bool make_grid(cutting *c, uint32_t tip)
{
    const size_t left = c->count - c->made;
    double high[2] = {-INFINITY, -INFINITY};
    size_t reflex = 0;
    c->low[0] = c->low[1] = INFINITY;
    for (size_t n = 0, k = tip; n < left; n++, k = c->next[k]) {
        for (int axis = 0; axis < 2; axis++) {
            c->low[axis] = fmin(c->low[axis], c->at[k][axis]);
            high[axis] = fmax(high[axis], c->at[k][axis]);
        }
    }
    for (size_t n = 0; n < left; n++, tip = c->next[tip]) reflex += c->reflex[tip] = turn_at(c, tip) <= 0;
    c->side = (size_t)sqrt((double)reflex) + 1;
    for (int axis = 0; axis < 2; axis++) {
        const double length = high[axis] - c->low[axis];
        c->size[axis] = length > 0 ? length / (double)c->side : 1;
    }
    c->cell = malloc(c->side * c->side * sizeof *c->cell);
    if (!c->cell) return false;
    memset(c->cell, 0xFF, c->side * c->side * sizeof *c->cell);
    for (size_t n = 0; n < left; n++, tip = c->next[tip]) {
        if (!c->reflex[tip]) continue;
        const double *at = c->at[tip];
        uint32_t *first = &c->cell[cell_along(c, 0, at[0]) * c->side + cell_along(c, 1, at[1])];
        c->in_cell[tip] = *first;
        *first = tip;
    }
    return true;
}

static polygon_result cut_by_ears(const double (*place)[3], const uint32_t *corner, size_t count, vec3 normal,
                                  const volatile sig_atomic_t *stop, uint32_t (*out)[3])
{
    cutting c = {.corner = corner, .count = count, .stop = stop};
    c.at = malloc(count * sizeof *c.at);
    c.next = malloc(3 * count * sizeof *c.next);
    c.reflex = malloc(count * sizeof *c.reflex);
    polygon_result result = POLYGON_NO_MEMORY;
    if (c.at && c.next && c.reflex) {
        c.previous = c.next + count;
        c.in_cell = c.previous + count;
        project(&c, place, normal);
        link_corners(&c);
        const uint32_t tip = clip_spikes(&c, place, out);
        if (make_grid(&c, tip)) result = clip_ears(&c, tip, out);
    }
    free(c.at);
    free(c.next);
    free(c.reflex);
    free(c.cell);
    return result;
}

/* Cuts a polygon of more than four corners, given from its first corner. */
static polygon_result cut_in_order(const double (*place)[3], const uint32_t *corner, size_t count,
                                   const volatile sig_atomic_t *stop, uint32_t (*out)[3])
{
    const vec3 normal = polygon_normal(place, corner, count);
    if (!is_fan(place, corner, count, 0, normal)) return cut_by_ears(place, corner, count, normal, stop, out);
    make_fan(corner, count, 0, out);
    return POLYGON_CUT;
}

/* Orders the corners: from the lexicographically lowest one, towards the lower one of its two neighbours.
 * Thus copies of a polygon are cut alike. Returns whether this reverses the orientation. */
static bool put_in_order(const double (*place)[3], const uint32_t *corner, size_t count, uint32_t *out)
{
    const size_t first = first_corner(place, corner, count);
    const bool is_turned =
        is_before(place[corner[(first + count - 1) % count]], place[corner[(first + 1) % count]]);
    for (size_t k = 0; k < count; k++) out[k] = corner[(first + (is_turned ? count - k : k)) % count];
    return is_turned;
}

static void swap(uint32_t *a, uint32_t *b)
{
    const uint32_t kept = *a;
    *a = *b;
    *b = kept;
}

/* Restores the orientation and the order of triangles of a polygon that put_in_order reversed. */
static void turn_back(uint32_t (*out)[3], size_t count)
{
    for (size_t t = 0; t < count; t++) swap(&out[t][1], &out[t][2]);
    for (size_t t = 0; t < count / 2; t++)
        for (int k = 0; k < 3; k++) swap(&out[t][k], &out[count - 1 - t][k]);
}

polygon_result polygon_cut(const double (*place)[3], const uint32_t *corner, size_t count,
                           const volatile sig_atomic_t *stop, uint32_t (*out)[3])
{
    if (count == 3) {
        make_fan(corner, 3, 0, out);
        return POLYGON_CUT;
    }
    if (count == 4) return cut_quadrangle(place, corner, polygon_normal(place, corner, 4), out);
    uint32_t few[FEW_CORNERS], *ordered = count <= FEW_CORNERS ? few : malloc(count * sizeof *ordered);
    if (!ordered) return POLYGON_NO_MEMORY;
    const bool is_turned = put_in_order(place, corner, count, ordered);
    const polygon_result result = cut_in_order(place, ordered, count, stop, out);
    if (is_turned) turn_back(out, count - 2);
    if (ordered != few) free(ordered);
    return result;
}
