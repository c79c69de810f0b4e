// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/hidden_crossing.h"

#include <endian.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/lanes.h"
#include "base/core/memory.h"
#include "surface/field/field.h"
#include "geometry/space/flood.h"
#include "surface/volume/coefficient_block.h"
#include "surface/volume/grid_view.h"

enum { FACES = 6, LATTICE = 8, GROUP = 4 /* cells along each axis */, BLOCKS = 16 /* per chunk of work */ };
/* Depth of a crossing, in units of the largest coefficient on which the face depends, below which it is
 * ignored as rounding or as insignificant. A face in a plane of voxels that contains the surface has only
 * such values. */
static const double LEAST_DEPTH = 1e-3;
/* Maximum fraction of bent cells; above it no cell of the volume is classified as gentle. The areas of gentle
 * cells are right in the mean over all positions. This is not so next to cells whose area is computed from
 * roots, which divide the surface in another way: the area of a torus with half of its cells bent would be
 * 6e-4 too small. */
static const double BENT_MOST = 0.01;
static const int step_along[3] = {COEFFICIENT_BLOCK_SLAB, COEFFICIENT_BLOCK_SIDE, 1};

typedef struct search {
    const block_map *map;
    const coefficient_blocks *coefficients;
    const int64_t *size;
    double aspect;
    uint8_t *crossed;
    uint8_t *pending; /* Likewise: cells to process, which have a crossed face or were found later. */
    atomic_size_t cells, bent; /* number of cells tested, and of those neither flat nor gentle */
    hidden_crossing *out;
} search;

void hidden_crossing_free(hidden_crossing *g)
{
    free(g->cell);
    free(g->passed);
    free(g->flat);
    free(g->gentle);
    *g = (hidden_crossing){0};
}

/* Converts the B-spline coefficients of a cubic to Bezier coefficients. */
static void to_bezier(double *c, int step)
{
    double a = c[0], b = c[step], d = c[2 * step], e = c[3 * step];
    c[0] = (a + 4 * b + d) / 6;
    c[step] = (2 * b + d) / 3;
    c[2 * step] = (b + 2 * d) / 3;
    c[3 * step] = (b + 4 * d + e) / 6;
}

static double bezier_at(const double *c, double t)
{
    double s = 1 - t;
    return s * s * (s * c[0] + 3 * t * c[1]) + t * t * (3 * s * c[2] + t * c[3]);
}

typedef struct range {
    double low, high;
} range;

static void widen(range *r, double value)
{
    r->low = value < r->low ? value : r->low;
    r->high = value > r->high ? value : r->high;
}

/* Whether the corners have one sign, within `depth`, and `all` has a value of the other sign. */
static bool is_passed(const range *corners, const range *all, double depth)
{
    return (corners->high < depth && all->high > depth) || (corners->low > -depth && all->low < -depth);
}

/* Whether the corners of the face have one sign and some place of it has the other. The bound by Bezier
 * coefficients avoids most evaluations. */
static bool dips(const double bezier[16], double depth)
{
    const range none = {INFINITY, -INFINITY};
    range corners = none, bound = none, places = none;
    for (int k = 0; k < 4; k++) widen(&corners, bezier[k / 2 * 12 + k % 2 * 3]);
    for (int k = 0; k < 16; k++) widen(&bound, bezier[k]);
    if (!is_passed(&corners, &bound, depth)) return false;
    for (int i = 0; i <= LATTICE; i++) {
        double row[4];
        for (int k = 0; k < 4; k++) row[k] = bezier_at(bezier + 4 * k, (double)i / LATTICE);
        for (int j = 0; j <= LATTICE; j++) widen(&places, bezier_at(row, (double)j / LATTICE));
    }
    return is_passed(&corners, &places, depth);
}

/* The minimum depth of a crossing of a face; its coefficients start at `first`, in two layers along
 * `across`. */
static double least_depth(const float *first, int across, const int along[2])
{
    float largest = 0;
    for (int k = 0; k < 48; k++) {
        const float size = fabsf(first[k / 16 * across + k / 4 % 4 * along[0] + k % 4 * along[1]]);
        largest = size > largest ? size : largest;
    }
    return LEAST_DEPTH * (double)largest;
}

/* `first`: the first coefficient of the cell. */
static bool face_is_passed(const float *first, int face)
{
    int axis = face >> 1, across = step_along[axis];
    const int along[2] = {step_along[(axis + 1) % 3], step_along[(axis + 2) % 3]};
    double c[16];
    int below = 0, inside = 0;
    for (int k = 0; k < 16; k++) {
        const float *p = first + (face & 1) * across + k / 4 * along[0] + k % 4 * along[1];
        c[k] = ((double)p[0] + 4 * (double)p[across] + (double)p[2 * across]) / 6;
        below += c[k] < 0;
    }
    if (below == 0 || below == 16) return false; /* the Bezier coefficients then have one sign, too */
    for (int k = 0; k < 4; k++) to_bezier(c + 4 * k, 1);
    for (int k = 0; k < 4; k++) to_bezier(c + k, 4);
    for (int k = 0; k < 16; k++) inside += c[k] < 0;
    return inside > 0 && inside < 16 && dips(c, least_depth(first + (face & 1) * across, across, along));
}

/* F at the corners of the cell whose coefficients start at `first`; one axis at a time. */
static void corner_values(const float *first, double out[8])
{
    double z[4][4][2], y[4][2][2];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 2; k++) {
                const float *p = first + i * COEFFICIENT_BLOCK_SLAB + j * COEFFICIENT_BLOCK_SIDE + k;
                z[i][j][k] = ((double)p[0] + 4 * (double)p[1] + (double)p[2]) / 6;
            }
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 2; j++)
            for (int k = 0; k < 2; k++) y[i][j][k] = (z[i][j][k] + 4 * z[i][j + 1][k] + z[i][j + 2][k]) / 6;
    for (int c = 0; c < 8; c++) {
        const int i = c & 1, j = c >> 1 & 1, k = c >> 2;
        out[c] = (y[i][j][k] + 4 * y[i + 1][j][k] + y[i + 2][j][k]) / 6;
    }
}

static bool append(hidden_crossing *g, const int32_t at[3], uint32_t block, const float *first, error *e)
{
    if (!MEM_GROW(g->cell, g->count, &g->capacity, "the cells with hidden crossings", e)) return false;
    double value[8];
    crossed_cell *c = &g->cell[g->count++];
    memcpy(c->at, at, sizeof c->at);
    c->block = block;
    corner_values(first, value);
    for (int k = 0; k < 8; k++) c->value[k] = (float)value[k];
    return true;
}

/* The byte with the row of cells that contains this one. */
static uint8_t *row_of(uint8_t *rows, uint32_t n, const int32_t at[3])
{
    return &rows[64 * (size_t)n + 8 * (size_t)(at[0] & 7) + (size_t)(at[1] & 7)];
}

static const float *cell_of(const search *s, uint32_t n, const int32_t at[3],
                            float buffer[COEFFICIENT_BLOCK_CELL])
{
    return coefficient_blocks_find_cell(s->coefficients, n, (const int[]){at[0] & 7, at[1] & 7, at[2] & 7},
                                        buffer);
}

/* Follows the surface from a cell of block n through its faces to new cells. */
static bool follow_faces(search *s, uint32_t n, const int32_t at[3], error *e)
{
    float buffer[COEFFICIENT_BLOCK_CELL], beyond[COEFFICIENT_BLOCK_CELL];
    const float *first = cell_of(s, n, at, buffer);
    for (int face = 0; face < FACES; face++) {
        int axis = face >> 1;
        int32_t to[3] = {at[0], at[1], at[2]};
        to[axis] += face & 1 ? 1 : -1;
        if (!face_is_passed(first, face)) continue;
        *row_of(s->out->passed, n, at) |= (uint8_t)(1u << (at[2] & 7));
        uint32_t there = block_map_find(s->map, to[0] >> 3, to[1] >> 3, to[2] >> 3);
        if (there == BLOCK_MAP_NONE || (s->size[axis] > 0 && (to[axis] < 0 || to[axis] > s->size[axis] - 2)))
            continue;
        uint8_t *row = row_of(s->crossed, there, to);
        unsigned bit = 1u << (to[2] & 7);
        if (*row & bit) continue;
        *row = (uint8_t)(*row | bit);
        *row_of(s->pending, there, to) |= (uint8_t)bit;
        if (!append(s->out, to, there, cell_of(s, there, to, beyond), e)) return false;
    }
    return true;
}

/* ---- fast tests for faces */

/* Four values along the remaining axis. */
typedef float row __attribute__((vector_size(16)));

/* Upper bound of the rounding errors of the following, in units of the largest coefficient. */
static const float ROUNDING = 1e-5f;

typedef int32_t row_mask __attribute__((vector_size(16)));

/* A loop that is not unrolled early compiles to a single instruction. */
ISA_INLINE row row_larger(row a, row b)
{
#pragma GCC unroll 1
    for (int k = 0; k < 4; k++) a[k] = a[k] > b[k] ? a[k] : b[k];
    return a;
}

ISA_INLINE bool mask_any(row_mask m)
{
    uint64_t half[2];
    memcpy(half, &m, sizeof half);
    return (half[0] | half[1]) != 0;
}

ISA_INLINE bool mask_all(row_mask m)
{
    return !mask_any(~m);
}

ISA_INLINE void transpose(row r[4])
{
    const row a = __builtin_shufflevector(r[0], r[1], 0, 4, 1, 5),
              b = __builtin_shufflevector(r[2], r[3], 0, 4, 1, 5),
              c = __builtin_shufflevector(r[0], r[1], 2, 6, 3, 7),
              d = __builtin_shufflevector(r[2], r[3], 2, 6, 3, 7);
    r[0] = __builtin_shufflevector(a, b, 0, 1, 4, 5);
    r[1] = __builtin_shufflevector(a, b, 2, 3, 6, 7);
    r[2] = __builtin_shufflevector(c, d, 0, 1, 4, 5);
    r[3] = __builtin_shufflevector(c, d, 2, 3, 6, 7);
}

/* to_bezier in each lane. */
ISA_INLINE void rows_to_bezier(row r[4])
{
    const row a = r[0], b = r[1], c = r[2], d = r[3];
    r[0] = (a + 4 * b + c) * (1.0f / 6);
    r[1] = (2 * b + c) * (1.0f / 3);
    r[2] = (b + 2 * c) * (1.0f / 3);
    r[3] = (b + 4 * c + d) * (1.0f / 6);
}

/* Whether face_is_passed may return true for a face with these four rows of coefficients. `largest`: an upper
 * bound of the coefficients of the cell. May return true for a face that is not crossed. */
ISA_INLINE bool may_be_passed(row face[4], float largest)
{
    const float off = ROUNDING * largest, depth = (float)LEAST_DEPTH * largest + off;
    rows_to_bezier(face);
    transpose(face);
    rows_to_bezier(face);
    const row corners = __builtin_shufflevector(face[0], face[3], 0, 3, 4, 7);
    const bool above = mask_any(corners >= depth), below = mask_any(corners <= -depth);
    const bool inside =
                   mask_all((face[0] <= -off) & (face[1] <= -off) & (face[2] <= -off) & (face[3] <= -off)),
               outside = mask_all((face[0] >= off) & (face[1] >= off) & (face[2] >= off) & (face[3] >= off));
    return !((above || inside) && (below || outside));
}

/* Bounds of the differences of the coefficients of a cell along the axes, and of their second differences. */
typedef struct slopes {
    row fall[3], rise[3], bend; /* maxima of -difference, of +difference, and of |second difference| */
} slopes;

ISA_INLINE void add_slope(slopes *s, int axis, row slope)
{
    s->fall[axis] = row_larger(s->fall[axis], -slope);
    s->rise[axis] = row_larger(s->rise[axis], slope);
}

ISA_INLINE void add_bend(slopes *s, row bend)
{
    s->bend = row_larger(s->bend, row_larger(bend, -bend));
}

/* From one lane to the next; the last is like that before it. */
ISA_INLINE row along_lanes(row r)
{
    return __builtin_shufflevector(r, r, 1, 2, 3, 3) - __builtin_shufflevector(r, r, 0, 1, 2, 2);
}

ISA_INLINE slopes slopes_of(row c[4][4])
{
    const row zero = {0}, none = zero - INFINITY;
    slopes s = {{none, none, none}, {none, none, none}, zero};
    row x[4][4], y[4][4];
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
#pragma GCC unroll 4
        for (int j = 0; j < 4; j++) {
            const row z = along_lanes(c[i][j]);
            add_slope(&s, 2, z);
            add_bend(&s, along_lanes(z));
            if (i > 0) add_slope(&s, 0, x[i][j] = c[i][j] - c[i - 1][j]);
            if (i > 0) add_bend(&s, along_lanes(x[i][j]));
            if (i > 0 && j > 0) add_bend(&s, x[i][j] - x[i][j - 1]);
            if (i > 1) add_bend(&s, x[i][j] - x[i - 1][j]);
            if (j > 0) add_slope(&s, 1, y[i][j] = c[i][j] - c[i][j - 1]);
            if (j > 0) add_bend(&s, along_lanes(y[i][j]));
            if (j > 1) add_bend(&s, y[i][j] - y[i][j - 1]);
        }
    }
    return s;
}

ISA_INLINE float largest_of(row r)
{
    const row pairs = row_larger(r, __builtin_shufflevector(r, r, 2, 3, 0, 1));
    return pairs[0] > pairs[1] ? pairs[0] : pairs[1];
}

/* Whether the spline is monotone along each axis; then no face with corners of one sign is crossed. *bends:
 * the class of curvature in the world. For voxels with this `aspect`, second differences relative to the
 * slope are up to `aspect` times as large as in index space. */
ISA_INLINE bool is_monotone(const slopes *s, double aspect, field_bend *bends)
{
    const double bend = (double)largest_of(s->bend) * aspect;
    double slope2 = 0; /* squares of floats may exceed the range of float */
    int steep = 0;
    for (int axis = 0; axis < 3; axis++) {
        const float low = -largest_of(s->fall[axis]), high = largest_of(s->rise[axis]),
                    least = low > 0    ? low
                            : high < 0 ? -high
                                       : 0;
        slope2 += (double)least * (double)least;
        steep += least > 0;
    }
    const double bend2 = bend * bend;
    *bends = bend2 <= FIELD_FLAT_MOST * FIELD_FLAT_MOST * slope2       ? FIELD_FLAT
             : bend2 <= FIELD_GENTLE_MOST * FIELD_GENTLE_MOST * slope2 ? FIELD_GENTLE
                                                                       : FIELD_BENT;
    return steep == 3;
}

/* slopes for rows of eight along the last axis; a group of cells depends on seven. */
typedef struct long_slopes {
    lanes fall[3], rise[3], bend;
} long_slopes;

/* slopes_of over all cells of a group: bounds of the slopes and second differences of each cell. */
ISA_INLINE void add_long_slope(long_slopes *s, int axis, lanes slope)
{
    s->fall[axis] = lanes_larger(s->fall[axis], -slope);
    s->rise[axis] = lanes_larger(s->rise[axis], slope);
}

ISA_INLINE void add_long_bend(long_slopes *s, lanes bend)
{
    s->bend = lanes_larger(s->bend, (lanes)((lanes_mask)bend & INT32_MAX));
}

/* From one lane to the next; the last is like that before it. */
ISA_INLINE lanes along_long(lanes r)
{
    return __builtin_shufflevector(r, r, 1, 2, 3, 4, 5, 6, 7, 7) -
           __builtin_shufflevector(r, r, 0, 1, 2, 3, 4, 5, 6, 6);
}

/* Adds the coefficients of a group with one first index; `more` first indices follow. */
ISA_INLINE void add_slab(long_slopes *s, const float *slab, int more)
{
    lanes c = {0}, x = c, y = c;
#pragma GCC unroll 7
    for (int j = 0; j < GROUP + 3; j++) {
        const float *from = slab + j * COEFFICIENT_BLOCK_SIDE;
        const lanes c0 = c, x0 = x, y0 = y;
        c = *(const lanes *)from;
        const lanes z = along_long(c);
        add_long_slope(s, 2, z);
        add_long_bend(s, along_long(z));
        if (j > 0) add_long_slope(s, 1, y = c - c0);
        if (j > 0) add_long_bend(s, along_long(y));
        if (j > 1) add_long_bend(s, y - y0);
        if (more == 0) continue;
        const lanes beside = *(const lanes *)(from + COEFFICIENT_BLOCK_SLAB);
        add_long_slope(s, 0, x = beside - c);
        add_long_bend(s, along_long(x));
        if (j > 0) add_long_bend(s, x - x0);
        if (more > 1) add_long_bend(s, (*(const lanes *)(from + 2 * COEFFICIENT_BLOCK_SLAB) - beside) - x);
    }
}

ISA_INLINE row folded(lanes r)
{
    return row_larger(__builtin_shufflevector(r, r, 0, 1, 2, 3), __builtin_shufflevector(r, r, 4, 5, 6, 7));
}

/* Whether doubtful_faces would find no face in any cell of a group, and all cells would be flat. The group
 * has `length` cells along the first axis and GROUP along the others; its coefficients are rows of eight from
 * `first`. Rounding is monotone: a comparison that holds for the group's bounds holds for each cell, to
 * the last bit. */
ISA_CLONES static bool group_is_flat(const float *first, int length, double aspect)
{
    const lanes zero = {0}, none = zero - INFINITY;
    long_slopes s = {{none, none, none}, {none, none, none}, zero};
    field_bend bend;
    for (int i = 0; i < length + 3; i++) add_slab(&s, first + i * COEFFICIENT_BLOCK_SLAB, length + 2 - i);
    const slopes all = {{folded(s.fall[0]), folded(s.fall[1]), folded(s.fall[2])},
                        {folded(s.rise[0]), folded(s.rise[1]), folded(s.rise[2])},
                        folded(s.bend)};
    return is_monotone(&all, aspect, &bend) && bend == FIELD_FLAT;
}

/* The faces of a cell that may be crossed although their corners have one sign, as bits. */
ISA_CLONES_OF_128 static unsigned doubtful_faces(const float *first, double aspect, field_bend *bend)
{
    row c[4][4], turned[4][4], face[4], size = {0};
    unsigned faces = 0;
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
#pragma GCC unroll 4
        for (int j = 0; j < 4; j++)
            memcpy(&c[i][j], first + i * COEFFICIENT_BLOCK_SLAB + j * COEFFICIENT_BLOCK_SIDE, sizeof c[i][j]);
    }
    const slopes s = slopes_of(c);
    if (is_monotone(&s, aspect, bend)) return 0;
#pragma GCC unroll 4
    for (int i = 0; i < 4; i++) {
#pragma GCC unroll 4
        for (int j = 0; j < 4; j++) {
            turned[i][j] = c[i][j];
            size = row_larger(size, row_larger(c[i][j], -c[i][j]));
        }
        transpose(turned[i]);
    }
    float largest = 0;
    for (int k = 0; k < 4; k++) largest = size[k] > largest ? size[k] : largest;
#pragma GCC unroll 6
    for (int k = 0; k < FACES; k++) {
        const int axis = k >> 1, at = k & 1;
#pragma GCC unroll 4
        for (int i = 0; i < 4; i++) {
            const row *r = axis == 0 ? &c[at][i] : axis == 1 ? &c[i][at] : &turned[i][at];
            const int step = axis == 0 ? 4 : 1;
            face[i] = (r[0] + 4 * r[step] + r[2 * step]) * (1.0f / 6);
        }
        faces |= (unsigned)may_be_passed(face, largest) << k;
    }
    return faces;
}

/* Whether one of `faces` is crossed. A face with corners of both signs, all farther from 0 than the maximum
 * depth, is not. `bound`: upper bound of its coefficients. */
static bool has_crossed_face(const float *first, unsigned faces, double bound)
{
    const double depth = LEAST_DEPTH * bound;
    double value[8];
    corner_values(first, value);
    for (int face = 0; face < FACES; face++) {
        range corners = {INFINITY, -INFINITY};
        if (!(faces >> face & 1)) continue;
        for (int k = 0; k < 8; k++)
            if ((k >> (face >> 1) & 1) == (face & 1)) widen(&corners, value[k]);
        if (corners.low < -depth && corners.high > depth) continue;
        if (face_is_passed(first, face)) return true;
    }
    return false;
}

/* An upper bound of the coefficients of a coefficient block. */
static double coefficient_bound(const float *coefficients)
{
    float bound = 0;
    for (size_t k = 0; k < COEFFICIENT_BLOCK_SIZE; k++) {
        const float size = fabsf(coefficients[k]);
        bound = size > bound ? size : bound;
    }
    return (double)bound;
}

/* The scan of a block. */
typedef struct block_scan {
    const search *s;
    const float *coefficients;
    double bound;  /* bound of the coefficient block's coefficients; < 0: unknown */
    bool was_flat; /* the previous group was flat: the next one probably is, too */
} block_scan;

/* Records the class of cells of a row. */
static void note_bend(const block_scan *l, size_t at, unsigned bits, field_bend bend)
{
    if (bend == FIELD_FLAT) l->s->out->flat[at] |= (uint8_t)bits;
    if (bend == FIELD_GENTLE) l->s->out->gentle[at] |= (uint8_t)bits;
}

/* `at`: index of the cell's row among the rows of all blocks. */
static void scan_cell(block_scan *l, size_t at, int z)
{
    const float *first = coefficient_block_cell(l->coefficients, at >> 3 & 7, at & 7, z);
    field_bend bend;
    const unsigned faces = doubtful_faces(first, l->s->aspect, &bend);
    note_bend(l, at, 1u << z, bend);
    l->was_flat = bend == FIELD_FLAT && faces == 0;
    if (faces == 0) return;
    if (l->bound < 0) l->bound = coefficient_bound(l->coefficients);
    if (has_crossed_face(first, faces, l->bound)) l->s->pending[at] |= (uint8_t)(1u << z);
}

/* Scans the crossed cells of a group of block n: together if possible, otherwise one by one. */
static void scan_group(block_scan *l, size_t n, int x, int y, int z)
{
    const uint64_t group = htole64(UINT64_C(0x0f0f0f0f) << (8 * y + z));
    uint64_t layer[8];
    int end = x + GROUP;
    memcpy(layer, l->s->crossed + 64 * n, sizeof layer);
    while (x < end && !(layer[x] & group)) x++;
    while (x < end && !(layer[end - 1] & group)) end--;
    if (x == end) return;
    if (l->was_flat)
        l->was_flat = group_is_flat(coefficient_block_cell(l->coefficients, x, y, z > 0 ? z - 1 : 0), end - x,
                                    l->s->aspect);
    const bool together = l->was_flat;
    for (int k = GROUP * x; k < GROUP * end; k++) {
        const size_t at = 64 * n + (size_t)(8 * (k / GROUP) + y + k % GROUP);
        unsigned bits = l->s->crossed[at] & 0xfu << z;
        if (together) note_bend(l, at, bits, FIELD_FLAT);
        for (; bits && !together; bits &= bits - 1) scan_cell(l, at, __builtin_ctz(bits));
    }
}

static void count_bent(search *s, size_t begin, size_t end)
{
    size_t cells = 0, bent = 0;
    for (size_t at = 64 * begin; at < 64 * end; at += 8) {
        uint64_t crossed, flat, gentle;
        memcpy(&crossed, s->crossed + at, sizeof crossed);
        if (crossed == 0) continue;
        memcpy(&flat, s->out->flat + at, sizeof flat);
        memcpy(&gentle, s->out->gentle + at, sizeof gentle);
        cells += (size_t)__builtin_popcountll(crossed);
        bent += (size_t)__builtin_popcountll(crossed & ~(flat | gentle));
    }
    atomic_fetch_add(&s->cells, cells);
    atomic_fetch_add(&s->bent, bent);
}

static void leak_chunk(void *context, int worker, size_t begin, size_t end)
{
    search *s = context;
    block_scan l = {.s = s, .was_flat = true};
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        static const uint8_t none[64] = {0};
        float buffer[COEFFICIENT_BLOCK_SIZE];
        if (memcmp(s->crossed + 64 * n, none, sizeof none) == 0) continue;
        l.coefficients = coefficient_blocks_read_once(s->coefficients, (uint32_t)n, buffer);
        l.bound = -1;
        for (int k = 0; k < 8; k++)
            scan_group(&l, n, GROUP * (k >> 2), GROUP * (k >> 1 & 1), GROUP * (k & 1));
    }
    count_bent(s, begin, end);
}

/* In the order of blocks and cells, so that the order of the result is fixed. */
static bool follow(search *s, error *e)
{
    for (size_t k = 0; k < 64 * (size_t)s->map->count; k++) {
        static const uint8_t none[8] = {0};
        if (k % 8 == 0 && memcmp(s->pending + k, none, sizeof none) == 0) k += 7;
        for (int z = 0; s->pending[k] >> z; z++) { /* the loop may add cells */
            const uint32_t n = (uint32_t)(k >> 6);
            const int32_t *b = s->map->blocks[n];
            const int32_t at[3] = {8 * b[0] + (int)(k >> 3 & 7), 8 * b[1] + (int)(k & 7), 8 * b[2] + z};
            if (s->pending[k] >> z & 1 && !follow_faces(s, n, at, e)) return false;
        }
    }
    for (size_t k = 0; k < s->out->count; k++) {
        const crossed_cell c = s->out->cell[k]; /* the list may be reallocated */
        if (!follow_faces(s, c.block, c.at, e)) return false;
    }
    return true;
}

/* Flood fill over the cells, without those that were found. */
typedef struct flood_job {
    const search *search;
    bool ok;
    error *e;
} flood_job;

static void flood_cells(void *context)
{
    flood_job *f = context;
    f->ok = flood_reaches_all(f->search->map, f->search->crossed, &f->search->out->joined, f->e);
}

bool hidden_crossing_find(const coefficient_blocks *b, const int64_t size[3], double aspect, threads *pool,
                          uint8_t *crossed, hidden_crossing *out, error *e)
{
    const char *what = "the cells with hidden crossings";
    const block_map *map = b->map;
    const size_t bytes = (size_t)map->count * 64;
    search s = {.map = map,
                .coefficients = b,
                .size = size,
                .aspect = aspect,
                .crossed = crossed,
                .pending = mem_array(bytes, 1, what, e),
                .out = out};
    out->passed = mem_array(bytes, 1, what, e);
    out->flat = mem_array(bytes, 1, what, e);
    out->gentle = mem_array(bytes, 1, what, e);
    bool ok = s.pending && out->passed && out->flat && out->gentle;
    flood_job all = {&s, true, e};
    if (ok) {
        threads_run_beside(pool, flood_cells, &all, map->count, BLOCKS, leak_chunk, &s);
        if ((double)s.bent > BENT_MOST * (double)s.cells) memset(out->gentle, 0, bytes);
    }
    ok = ok && all.ok && follow(&s, e);
    /* found cells are adjacent to others: they can only connect components */
    if (ok && !out->joined && out->count > 0) {
        flood_cells(&all);
        ok = all.ok;
    }
    free(s.pending);
    return ok;
}
