// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/band_extension.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/lanes.h"
#include "base/core/memory.h"
#include "surface/volume/block_lines.h"

#define SIDE GRID_VIEW_SIDE

enum { BLOCKS = 64 }; /* blocks in a chunk of work */
/* Number of layers of voxels that are extrapolated one by one; straight lines are sufficient beyond. */
enum { LAYERS = 2 };
/* Number of blocks by which the band is extended beyond blocks that have a known voxel: no caller reads
 * farther. */
enum { ROUNDS = 2 };
/* Maximum factor by which extrapolation may increase a value; see bounded. */
enum { LINE_MOST = 3 * SIDE };

/* A block that is extended, and the adjacent blocks below and above it along each axis: their voxels and the
 * bits of the known ones. A missing block has no known voxels. */
typedef struct surroundings {
    float *here;
    const float *beyond[6];
    uint64_t layers[SIDE + 6]; /* known bits of layers x = -3 .. SIDE + 2 relative to the block */
    const uint64_t *known[6];
} surroundings;

ISA_INLINE void find_surroundings(const samples *s, uint32_t block, surroundings *out)
{
    static const uint64_t none[SIDE] = {0};
    out->here = s->f[block];
    for (int k = 0; k < 6; k++) {
        const uint32_t n = s->near[6 * (size_t)block + (size_t)k];
        const bool is_there = n != BLOCK_MAP_NONE;
        out->beyond[k] = s->f[is_there ? n : block];
        out->known[k] = is_there ? s->known + (size_t)n * SIDE : none;
    }
    memcpy(out->layers, out->known[0] + SIDE - 3, 3 * sizeof *out->layers);
    memcpy(out->layers + 3, s->known + (size_t)block * SIDE, SIDE * sizeof *out->layers);
    memcpy(out->layers + 3 + SIDE, out->known[1], 3 * sizeof *out->layers);
}

/* For each voxel of the layer x of a block, as bits: whether the voxel at distance `step` (at most 3), below
 * it (side 0) or above it (side 1) along an axis, is known. */
ISA_INLINE uint64_t known_beside(const surroundings *s, int x, int axis, int side, int step)
{
    if (axis == 0) return s->layers[x + 3 + (side ? step : -step)];
    const uint64_t here = s->layers[x + 3], there = s->known[2 * axis + side][x];
    const int by = axis == 1 ? SIDE * step : step, back = axis == 1 ? 64 - by : SIDE - step;
    if (axis == 1) return side ? here >> by | there << back : here << by | there >> back;
    const uint64_t low = 0x0101010101010101u * ((1u << step) - 1), high = low << back;
    return side ? (here >> by & ~high) | (there << back & high) : (here << by & ~low) | (there >> back & low);
}

/* Bits of the unknown voxels of a layer that have a known neighbour. known[3 k + step - 1]: which voxels
 * have a known voxel at distance `step` in direction k (below and above along each axis). */
ISA_INLINE uint64_t frontier(const surroundings *s, int x, uint64_t known[18])
{
    const uint64_t here = s->layers[x + 3];
    uint64_t any = 0;
    if (here == ~(uint64_t)0) return 0;
#pragma GCC unroll 6
    for (int k = 0; k < 6; k++) any |= known[3 * k] = known_beside(s, x, k / 2, k % 2, 1);
    any &= ~here;
    if (any == 0) return 0;
#pragma GCC unroll 6
    for (int k = 0; k < 6; k++) {
        known[3 * k + 1] = known_beside(s, x, k / 2, k % 2, 2);
        known[3 * k + 2] = known_beside(s, x, k / 2, k % 2, 3);
    }
    return any;
}

/* Bit 8 y is set if row y of a layer has a bit. */
ISA_INLINE uint64_t rows_with_any(uint64_t bits)
{
    bits |= bits >> 4;
    bits |= bits >> 2;
    return (bits | bits >> 1) & 0x0101010101010101u;
}

ISA_INLINE int lowest_row(uint64_t rows)
{
    return __builtin_ctzll(rows) / SIDE;
}

ISA_INLINE lanes row_of(const float *block, int x, int y)
{
    return *(const lanes *)(block + 64 * x + SIDE * y);
}

/* Eight consecutive values of two adjacent rows, from position `from` (1 to 3 or 5 to 7). */
ISA_INLINE lanes across(lanes a, lanes b, int from)
{
#define FROM(n) \
    case n:     \
        return __builtin_shufflevector(a, b, n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7)
    switch (from) {
        FROM(1);
        FROM(2);
        FROM(3);
        FROM(5);
        FROM(6);
        FROM(7);
    }
#undef FROM
    return a;
}

/* The values at distance `step` (1 to 3) from those of a row, below (side 0) or above along an axis.
 * Undefined for a missing block. */
ISA_INLINE lanes row_beside(const surroundings *s, int x, int y, int axis, int side, int step)
{
    const float *there = s->beyond[2 * axis + side];
    const int to = (axis == 0 ? x : y) + (side ? step : -step), within = to & (SIDE - 1);
    if (axis == 0) return row_of(to == within ? s->here : there, within, y);
    if (axis == 1) return row_of(to == within ? s->here : there, x, within);
    const lanes here = row_of(s->here, x, y), beyond = row_of(there, x, y);
    return side ? across(here, beyond, step) : across(beyond, here, SIDE - step);
}

/* block_line_bend in each lane. */
ISA_INLINE lanes line_bend(lanes a, lanes b, lanes c)
{
    const lanes change = a - b, most = 0.5f * lanes_larger(change, -change);
    return lanes_larger(lanes_smaller(a - 2 * b + c, most), -most);
}

/* Clamps an extrapolated value. The previous value of the voxel, `raw`, is clamped to the band: it gives the
 * side and the minimum distance. The bounds prevent growth where fronts meet; they are wide, so that there
 * is no kink where the band ends. */
ISA_INLINE lanes bounded(lanes value, lanes raw, int layer)
{
    const lanes_mask side = (lanes_mask)raw & INT32_MIN;
    const lanes size = (lanes)((lanes_mask)raw & INT32_MAX), reach = (lanes)((lanes_mask)value ^ side);
    return (lanes)((lanes_mask)lanes_smaller(lanes_larger(reach, 0.5f * size), (float)(1 + layer) * size) ^
                   side);
}

/* Per row of a layer: the sums of the extrapolated values over all lines, and the number of lines. */
typedef struct line_sums {
    lanes sum[SIDE], count[SIDE];
} line_sums;

/* Adds the values of the lines in direction k: linear for voxels in `two`, as a parabola for those also in
 * `bent`. */
ISA_INLINE void gather_lines(const surroundings *s, int x, int k, uint64_t two, uint64_t bent, line_sums *g)
{
    const lanes one = (lanes){0} + 1;
    for (uint64_t rows = rows_with_any(two); rows; rows &= rows - 1) {
        const int y = lowest_row(rows);
        const lanes a = row_beside(s, x, y, k / 2, k % 2, 1), b = row_beside(s, x, y, k / 2, k % 2, 2),
                    c = row_beside(s, x, y, k / 2, k % 2, 3);
        const lanes_mask of = block_row(two, y);
        g->sum[y] += lanes_only(of, 2 * a - b + lanes_only(block_row(bent, y), line_bend(a, b, c)));
        g->count[y] += lanes_only(of, one);
    }
}

/* Adds the values of single known voxels, for voxels without a line. */
ISA_INLINE void gather_flats(const surroundings *s, int x, int k, uint64_t of, line_sums *g)
{
    const lanes one = (lanes){0} + 1;
    for (uint64_t rows = rows_with_any(of); rows; rows &= rows - 1) {
        const int y = lowest_row(rows);
        g->sum[y] += lanes_only(block_row(of, y), row_beside(s, x, y, k / 2, k % 2, 1));
        g->count[y] += lanes_only(block_row(of, y), one);
    }
}

/* Extrapolates the values of the voxels `bits` of layer x of a block. */
ISA_INLINE void extend_layer(const surroundings *s, int x, uint64_t bits, const uint64_t known[18], int layer)
{
    uint64_t lined = 0;
    line_sums g;
#pragma GCC unroll 8
    for (int y = 0; y < SIDE; y++) g.sum[y] = g.count[y] = (lanes){0};
#pragma GCC unroll 6
    for (int k = 0; k < 6; k++) {
        const uint64_t two = bits & known[3 * k] & known[3 * k + 1];
        gather_lines(s, x, k, two, two & known[3 * k + 2], &g);
        lined |= two;
    }
    if (lined != bits)
#pragma GCC unroll 6
        for (int k = 0; k < 6; k++) gather_flats(s, x, k, bits & ~lined & known[3 * k], &g);
    for (uint64_t rows = rows_with_any(bits); rows; rows &= rows - 1) {
        const int y = lowest_row(rows);
        lanes *at = (lanes *)(s->here + 64 * x + SIDE * y);
        *at = lanes_chosen(block_row(bits, y), bounded(g.sum[y] / g.count[y], *at, layer), *at);
    }
}

/* The job of one layer or one round. */
typedef struct extension {
    samples *s;
    const uint32_t *open; /* blocks that have unknown voxels */
    uint64_t *next;       /* per block: voxels that are known after this layer */
    uint64_t *first;      /* per block: voxels that are known after the first layer; these count as known in
                           * the result */
    atomic_uchar
        *whole; /* per block: 0, or the round after which all voxels have values; 1: before the first round */
    int layer;
    atomic_bool changed;
} extension;

static bool is_whole(const uint64_t known[SIDE])
{
    uint64_t all = ~(uint64_t)0;
    for (int x = 0; x < SIDE; x++) all &= known[x];
    return all == ~(uint64_t)0;
}

static void set_whole(extension *job, size_t block, int since)
{
    atomic_store_explicit(&job->whole[block], (unsigned char)since, memory_order_relaxed);
}

/* Keeps the open blocks that still have unknown voxels. Returns their number. */
static size_t keep_open(const atomic_uchar *whole, uint32_t *open, size_t count)
{
    size_t left = 0;
    for (size_t i = 0; i < count; i++)
        if (!atomic_load_explicit(&whole[open[i]], memory_order_relaxed)) open[left++] = open[i];
    return left;
}

/* Extends eight lines in SIMD lanes; line[i] has the voxels number i, and byte i of `known` their bits. A
 * line that ends with two known voxels is extrapolated linearly, up or down to the end of the block. Returns
 * the known bits afterwards. */
ISA_INLINE uint64_t go_straight(lanes line[SIDE], uint64_t known, bool up)
{
    const int by = up ? 1 : -1;
    uint64_t beyond = known; /* known voxels, and all voxels before a known one in this direction */
    for (int shift = SIDE; shift < 64; shift *= 2) beyond |= up ? beyond >> shift : beyond << shift;
    const uint64_t one = up ? known << SIDE : known >> SIDE, two = up ? one << SIDE : one >> SIDE;
    uint64_t begins = one & two & ~beyond, fill = begins;
    for (int shift = SIDE; shift < 64; shift *= 2) fill |= up ? fill << shift : fill >> shift;
    if (fill == 0) return known;
    lanes value = {0}, slope = value;
    for (int i = up ? 2 : SIDE - 3; i >= 0 && i < SIDE; i += by) {
        const lanes_mask at_end = block_row(begins, i);
        slope = lanes_chosen(at_end, line[i - by] - line[i - 2 * by], slope);
        value = lanes_chosen(at_end, line[i - by], value) + slope;
        line[i] = lanes_chosen(block_row(fill, i), bounded(value, line[i], LINE_MOST), line[i]);
    }
    return known | fill;
}

/* Extends all lines of a block along an axis. */
ISA_INLINE void straighten(float *f, uint64_t known[SIDE], int axis)
{
    for (int i = 0; i < SIDE; i++) { /* slices: along the first axis the layers, otherwise row i of each
                                      * layer */
        lanes line[SIDE];
        uint64_t before = axis == 0   ? block_turned(known, i)
                          : axis == 1 ? known[i]
                                      : block_transposed(known[i]);
        if (before == 0 || before == ~(uint64_t)0) continue;
        lanes *row[SIDE];
        for (int k = 0; k < SIDE; k++) {
            row[k] = (lanes *)(f + (axis == 0 ? 64 * k + SIDE * i : 64 * i + SIDE * k));
            line[k] = *row[k];
        }
        if (axis == 2) lanes_transpose(line);
        const uint64_t bits = go_straight(line, before, true) | go_straight(line, before, false);
        if (bits == before) continue;
        if (axis == 2) lanes_transpose(line);
        for (int k = 0; k < SIDE; k++) {
            *row[k] = line[k];
            if (axis == 0) known[k] |= (bits >> SIDE * k & 0xff) << SIDE * i;
        }
        if (axis != 0) known[i] = axis == 1 ? bits : block_transposed(bits);
    }
}

/* Sorts the axes by decreasing change of the values: extrapolation across the surface is more accurate than
 * along it. One pair of known voxels of each layer is compared. */
static void order_axes(const float *f, const uint64_t known[SIDE], int order[3])
{
    static const uint64_t below_last = 0x7f7f7f7f7f7f7f7fu;
    double change[3] = {0};
    int pairs[3] = {0};
    for (int x = 0; x < SIDE; x++) {
        const uint64_t here = known[x], both[3] = {x + 1 < SIDE ? here & known[x + 1] : 0, here & here >> 8,
                                                   here & here >> 1 & below_last};
        for (int axis = 0; axis < 3; axis++) {
            if (both[axis] == 0) continue;
            const float *at = f + 64 * x + __builtin_ctzll(both[axis]);
            change[axis] += fabs((double)at[block_stride[axis]] - (double)at[0]);
            pairs[axis]++;
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        int place = axis;
        if (pairs[axis] > 0) change[axis] /= pairs[axis];
        for (; place > 0 && change[order[place - 1]] < change[axis]; place--) order[place] = order[place - 1];
        order[place] = axis;
    }
}

/* Extends the lines of a block after its last layer: no layer of another block reads these voxels. */
ISA_INLINE void go_straight_within(extension *job, size_t n)
{
    uint64_t *known = job->next + n * SIDE;
    int order[3];
    if (!block_has_any(known)) return;
    order_axes(job->s->f[n], known, order);
    for (int k = 0; k < 3 && !is_whole(known); k++) { /* separate code for each axis */
        if (order[k] == 0) straighten(job->s->f[n], known, 0);
        if (order[k] == 1) straighten(job->s->f[n], known, 1);
        if (order[k] == 2) straighten(job->s->f[n], known, 2);
    }
    set_whole(job, n, is_whole(known));
}

/* Extends the frontier of each block by one layer. `known` is not changed until the layer is done, so that
 * the result does not depend on the order of blocks. A row may be read while another thread writes it: known
 * voxels are overwritten with the same bits, and other voxels are not used. */
ISA_CLONES static void extend_chunk(void *context, int worker, size_t begin, size_t end)
{
    extension *job = context;
    surroundings around;
    uint64_t changed = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        if (i + 1 < end) block_fetch(job->s->f[job->open[i + 1]]);
        const size_t n = job->open[i];
        find_surroundings(job->s, job->open[i], &around);
        for (int x = 0; x < SIDE; x++) {
            uint64_t known[18], bits = frontier(&around, x, known);
            job->next[n * SIDE + (size_t)x] = around.layers[x + 3] | bits;
            changed |= bits;
            if (bits) extend_layer(&around, x, bits, known, job->layer);
        }
        if (job->layer < LAYERS)
            set_whole(job, n, is_whole(around.layers + 3));
        else
            go_straight_within(job, n);
    }
    if (changed) atomic_store(&job->changed, true);
}

/* Lines that continue from the block below (side 0) or above along an axis. */
typedef struct crossing_lines {
    const float *from;
    int axis, side;
} crossing_lines;

/* How much values increase along the lines where they cross the face, summed over four lines. It is largest
 * for lines perpendicular to the surface. */
static double growth(const crossing_lines *l)
{
    const int along = block_stride[l->axis], end = l->side ? 0 : (SIDE - 1) * along,
              back = l->side ? along : -along;
    const int a = l->axis == 0 ? 8 : 64, b = l->axis == 2 ? 8 : 1;
    double sum = 0;
    for (int k = 0; k < 4; k++) {
        const float *at = l->from + end + (k & 1 ? 6 : 1) * a + (k >> 1 ? 6 : 1) * b;
        sum += fabs((double)at[0]) - fabs((double)at[back]);
    }
    return sum;
}

/* Fills the unknown voxels of a block along the lines. */
ISA_INLINE void lengthen(const crossing_lines *l, float *f, const uint64_t known[SIDE])
{
    const lanes zero = {0}, ahead = {1, 2, 3, 4, 5, 6, 7, 8}, behind = {8, 7, 6, 5, 4, 3, 2, 1};
    const int end = l->side ? 0 : SIDE - 1, back = l->side ? 1 : SIDE - 2;
    for (int row = 0; row < SIDE * SIDE; row++) {
        const int x = row / SIDE, y = row % SIDE, along = l->axis == 0 ? x : y;
        const float *last_z = l->from + SIDE * row;
        const lanes_mask is_known = block_row(known[x], y);
        lanes last, before, steps, *at = (lanes *)(f + SIDE * row);
        if (l->axis == 2) {
            last = zero + last_z[end];
            before = zero + last_z[back];
            steps = l->side ? behind : ahead;
        } else {
            last = l->axis == 0 ? row_of(l->from, end, y) : row_of(l->from, x, end);
            before = l->axis == 0 ? row_of(l->from, back, y) : row_of(l->from, x, back);
            steps = zero + (float)(l->side ? SIDE - along : along + 1);
        }
        *at = lanes_chosen(is_known, *at, bounded(last + steps * (last - before), *at, LINE_MOST));
    }
}

/* Fills blocks that none of their own lines fills: from the adjacent block that has been complete since an
 * earlier round and whose values increase most. */
ISA_CLONES static void lengthen_chunk(void *context, int worker, size_t begin, size_t end)
{
    extension *job = context;
    const samples *s = job->s;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = job->open[i];
        crossing_lines best = {0};
        double most = 0;
        for (int k = 0; k < 6; k++) {
            const uint32_t other = s->near[6 * n + (size_t)k];
            const int since =
                other == BLOCK_MAP_NONE ? 0 : atomic_load_explicit(&job->whole[other], memory_order_relaxed);
            if (since == 0 || since > job->layer) continue;
            const crossing_lines lines = {s->f[other], k / 2, k % 2};
            const double by = growth(&lines);
            if (!(by > most)) continue;
            most = by;
            best = lines;
        }
        if (most == 0) continue;
        lengthen(&best, s->f[n], s->known + n * SIDE);
        set_whole(job, n, job->layer + 1);
    }
}

_Static_assert(LAYERS <= 2, "a third layer would be written over the first, which stays");

/* Extrapolates layer by layer, then along lines within blocks. Returns the number of blocks with unknown
 * voxels. */
static size_t extend(samples *s, extension *job, uint32_t *open, threads *pool)
{
    size_t count = s->map.count;
    for (uint32_t n = 0; n < count; n++) open[n] = n;
    for (job->layer = 1; job->layer <= LAYERS; job->layer++) {
        uint64_t *before = s->known;
        atomic_store(&job->changed, false);
        threads_run(pool, count, BLOCKS, extend_chunk, job);
        if (threads_stopped(pool)) break;
        s->known = job->next;
        job->next = before;
        if (job->layer == 1) job->first = s->known;
        if (!atomic_load(&job->changed)) break;
        count = keep_open(job->whole, open, count);
    }
    return count;
}

bool band_extension_fill(samples *s, threads *pool, error *e)
{
    const char *what = "the voxels around the surface";
    const size_t count = s->map.count;
    uint32_t *open = mem_array(count, sizeof *open, what, e);
    extension job = {.s = s,
                     .open = open,
                     .next = mem_array(count * SIDE, sizeof *job.next, what, e),
                     .whole = mem_array(count, sizeof *job.whole, what, e)};
    const bool ok = open && job.next && job.whole;
    if (ok) {
        size_t left = extend(s, &job, open, pool);
        for (job.layer = 1; job.layer <= ROUNDS; job.layer++) {
            left = keep_open(job.whole, open, left);
            threads_run(pool, left, BLOCKS, lengthen_chunk, &job);
        }
        if (job.next == job.first) {
            job.next = s->known;
            s->known = job.first;
        }
    }
    free(open);
    free(job.next);
    free(job.whole);
    return ok;
}
