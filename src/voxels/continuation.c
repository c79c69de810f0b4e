#include "voxels/continuation.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"
#include "voxels/block_lines.h"

#define SIDE GRID_VIEW_SIDE

enum { BLOCKS = 64 }; /* in a chunk of work */
/* Of voxels; beyond, straight lines are enough. */
enum { LAYERS = 2 };
/* Nobody looks farther beyond blocks that have a known voxel than so many blocks. */
enum { ROUNDS = 2 };
/* Where lines lead a value may be so many times what it was; see bounded. */
enum { LINE_MOST = 3 * SIDE };

/* A block that is continued and those below and above it along each axis: which of their voxels are known, and these. Of a block
 * that is missing none is known. */
typedef struct surroundings {
    float *here;
    const float *beyond[6];
    uint64_t layers[SIDE + 6]; /* the layers along x from 3 below the block on */
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

/* Of the layer x of a block, bit by bit, whether the voxel `step` away is known: below (side 0) or above along an
 * axis; step <= 3. */
ISA_INLINE uint64_t known_beside(const surroundings *s, int x, int axis, int side, int step)
{
    if (axis == 0) return s->layers[x + 3 + (side ? step : -step)];
    const uint64_t here = s->layers[x + 3], there = s->known[2 * axis + side][x];
    const int by = axis == 1 ? SIDE * step : step, back = axis == 1 ? 64 - by : SIDE - step;
    if (axis == 1) return side ? here >> by | there << back : here << by | there >> back;
    const uint64_t low = 0x0101010101010101u * ((1u << step) - 1), high = low << back;
    return side ? (here >> by & ~high) | (there << back & high) : (here << by & ~low) | (there >> back & low);
}

/* The voxels of a layer that are not known but have a known one beside them, and in known[3 k + step - 1] which have
 * one that many steps away; k: below and above along each axis. */
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

/* What the line through voxels at distances 1, 2 (values a, b) and 3 (c, where `bent`) says of the voxel at 0. */
ISA_INLINE double along_line(double a, double b, double c, bool bent)
{
    return 2 * a - b + (bent ? block_line_bend(a, b, c) : 0);
}

/* Where the lines along one direction lead: its side (0: below) of an axis, and the voxels of the block and of the one
 * beyond, or of this one again where there is none. Which of both is looked up, since a processor cannot foretell it. */
typedef struct direction {
    int axis, side;
    const float *from[2];
} direction;

/* The value `step` voxels from a voxel of the layer x. */
ISA_INLINE double value_along(const direction *d, int x, int bit, int step)
{
    const int by = d->side ? step : -step, layer = 64 * x, y = bit & ~(SIDE - 1), z = bit & (SIDE - 1);
    const int to = d->axis == 0   ? x + by
                   : d->axis == 1 ? bit + SIDE * by
                                  : z + by,
              in_block = to & (d->axis == 1 ? 63 : SIDE - 1);
    const float *from = d->from[to != in_block];
    if (d->axis == 0) return (double)from[64 * in_block + bit];
    return (double)from[layer + in_block + (d->axis == 1 ? 0 : y)];
}

/* Of a layer's frontier what the lines from all directions say, summed, and how many these are. */
typedef struct gathered {
    double sum[64];
    uint8_t count[64];
} gathered;

ISA_INLINE void gather_lines(const direction *d, int x, uint64_t bits, bool bent, gathered *g)
{
    for (; bits; bits &= bits - 1) {
        const int bit = __builtin_ctzll(bits);
        const double a = value_along(d, x, bit, 1), b = value_along(d, x, bit, 2);
        g->sum[bit] += along_line(a, b, bent ? value_along(d, x, bit, 3) : 0, bent);
        g->count[bit]++;
    }
}

/* Where there are no lines, of two voxels and more: single voxels. */
ISA_INLINE void gather_flats(const direction *d, int x, uint64_t bits, gathered *g)
{
    for (; bits; bits &= bits - 1) {
        const int bit = __builtin_ctzll(bits);
        g->sum[bit] += value_along(d, x, bit, 1);
        g->count[bit]++;
    }
}

/* The clamped value `raw` that a voxel still has gives the side, and the least distance. The bounds hold off what
 * meeting fronts could build up; they are loose, so that the continuation has no edge at the clamp. */
ISA_INLINE float bounded(double value, double raw, int layer)
{
    const double size = fabs(raw), side = raw < 0 ? -1 : 1;
    double reach = side * value;
    if (reach < 0.5 * size) reach = 0.5 * size;
    if (reach > size * (1 + layer)) reach = size * (1 + layer);
    return (float)(side * reach);
}

/* Continues the frontier `bits` of the layer x of a block. */
ISA_INLINE void extend_row(const surroundings *s, int x, uint64_t bits, const uint64_t known[18], int layer)
{
    float *at = s->here + 64 * x;
    uint64_t lined = 0;
    gathered g;
    memset(g.count, 0, sizeof g.count);
#pragma GCC unroll 64
    for (int k = 0; k < 64; k++) g.sum[k] = 0;
#pragma GCC unroll 6
    for (int k = 0; k < 6; k++) { /* one after the other, so that a processor can foretell the branches */
        const direction d = {k / 2, k % 2, {s->here, s->beyond[k]}};
        const uint64_t two = bits & known[3 * k] & known[3 * k + 1];
        gather_lines(&d, x, two & known[3 * k + 2], true, &g);
        gather_lines(&d, x, two & ~known[3 * k + 2], false, &g);
        lined |= two;
    }
    for (int k = 0; lined != bits && k < 6; k++) {
        const direction d = {k / 2, k % 2, {s->here, s->beyond[k]}};
        gather_flats(&d, x, bits & ~lined & known[3 * k], &g);
    }
    for (; bits; bits &= bits - 1) {
        const int bit = __builtin_ctzll(bits);
        at[bit] = bounded(g.sum[bit] / g.count[bit], (double)at[bit], layer);
    }
}

/* One layer, or one round. */
typedef struct extension {
    samples *s;
    const uint32_t *open; /* blocks that have voxels that are not known */
    uint64_t *next;       /* of all blocks: voxels that have values after this layer */
    atomic_uchar
        *whole; /* of all blocks: 0, or since which round all voxels have values: 1 before the first */
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

/* The open blocks that are not whole; returns how many. */
static size_t keep_open(const atomic_uchar *whole, uint32_t *open, size_t count)
{
    size_t left = 0;
    for (size_t i = 0; i < count; i++)
        if (!atomic_load_explicit(&whole[open[i]], memory_order_relaxed)) open[left++] = open[i];
    return left;
}

/* The bits of a block's slice i, in which byte j is a line along the axis: the line (i, j) of the other two. */
ISA_INLINE uint64_t slice_bits(const uint64_t known[SIDE], int axis, int i)
{
    if (axis == 2) return known[i];
    return block_transposed(axis == 1 ? known[i] : block_turned(known, i));
}

ISA_INLINE void set_slice_bits(uint64_t known[SIDE], int axis, int i, uint64_t bits)
{
    if (axis != 2) bits = block_transposed(bits);
    if (axis != 0) known[i] |= bits;
    for (int x = 0; axis == 0 && x < SIDE; x++) known[x] |= (bits >> 8 * x & 0xff) << 8 * i;
}

/* Where a line ends with two known voxels it goes straight on, to the end of the block. Returns which are known then. */
static unsigned go_straight(float *line, int step, unsigned has)
{
    const int low = __builtin_ctz(has), high = 31 - __builtin_clz(has);
    for (int up = 0; up < 2; up++) {
        const int end = up ? high : low, by = up ? 1 : -1;
        if (low == high || !(has >> (end - by) & 1)) continue;
        const double beside = (double)line[end * step], slope = beside - (double)line[(end - by) * step];
        for (int k = end + by; k >= 0 && k < SIDE; k += by) {
            line[k * step] = bounded(beside + abs(k - end) * slope, (double)line[k * step], LINE_MOST);
            has |= 1u << k;
        }
    }
    return has;
}

static void straighten(float *f, uint64_t known[SIDE], int axis)
{
    const int a = axis == 0 ? 8 : 64, b = axis == 2 ? 8 : 1;
    for (int i = 0; i < SIDE; i++) {
        const uint64_t before = slice_bits(known, axis, i);
        uint64_t bits = before;
        if (before == 0 || before == ~(uint64_t)0) continue;
        for (int j = 0; j < SIDE; j++) {
            const unsigned has = before >> 8 * j & 0xff;
            if (has != 0 && has != 0xff)
                bits |= (uint64_t)go_straight(f + i * a + j * b, block_stride[axis], has) << 8 * j;
        }
        if (bits != before) set_slice_bits(known, axis, i, bits);
    }
}

/* The axes, that along which values change most first: lines across the surface know what comes, lines along it do not. Of each
 * layer one pair of known voxels is asked. */
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

/* A block's lines, once its last layer is there: the other blocks' layers ask for none of these voxels. */
static void go_straight_within(extension *job, size_t n)
{
    uint64_t *known = job->next + n * SIDE;
    int order[3];
    if (!block_has_any(known)) return;
    order_axes(job->s->f[n], known, order);
    for (int k = 0; k < 3; k++) straighten(job->s->f[n], known, order[k]);
    set_whole(job, n, is_whole(known));
}

/* What is known stays as it was until the layer is done, so that the order of blocks does not matter. */
static void extend_chunk(void *context, int worker, size_t begin, size_t end)
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
            if (bits) extend_row(&around, x, bits, known, job->layer);
        }
        if (job->layer < LAYERS)
            set_whole(job, n, is_whole(around.layers + 3));
        else
            go_straight_within(job, n);
    }
    if (changed) atomic_store(&job->changed, true);
}

/* Lines that go on from one block into the next. */
typedef struct crossing_lines {
    const float *from; /* the first line's last voxel there */
    int first, by; /* the first line's first voxel here, and the way to the next along it, there and here */
    int a, b;      /* a line's place by 8 and by 1 */
} crossing_lines;

/* From the block below (side 0) along an axis, or that above. */
static crossing_lines cross(const float *from, int axis, int side)
{
    const int along = block_stride[axis], end = (SIDE - 1) * along;
    return (crossing_lines){from + (side ? 0 : end), side ? end : 0, side ? -along : along,
                            axis == 0 ? 8 : 64, axis == 2 ? 8 : 1};
}

/* How much values grow where the lines cross, which is the more the straighter they lead away from the surface. Four are asked. */
static double growth(const crossing_lines *l)
{
    double sum = 0;
    for (int k = 0; k < 4; k++) {
        const float *at = l->from + (k & 1 ? 6 : 1) * l->a + (k >> 1 ? 6 : 1) * l->b;
        sum += fabs((double)at[0]) - fabs((double)at[-l->by]);
    }
    return sum;
}

/* Fills what is not known. */
static void lengthen(const crossing_lines *l, float *f, const uint64_t known[SIDE])
{
    for (int line = 0; line < SIDE * SIDE; line++) {
        const int place = line / SIDE * l->a + line % SIDE * l->b;
        const double last = (double)l->from[place], slope = last - (double)l->from[place - l->by];
        for (int k = 0; k < SIDE; k++) {
            const int to = l->first + place + k * l->by;
            if (known[to >> 6] >> (to & 63) & 1) continue;
            f[to] = bounded(last + (k + 1) * slope, (double)f[to], LINE_MOST);
        }
    }
}

/* Blocks that no line of their own fills: from that beside them, whole since an earlier round, from which values grow most. */
static void lengthen_chunk(void *context, int worker, size_t begin, size_t end)
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
            const crossing_lines lines = cross(s->f[other], k / 2, k % 2);
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

/* Continues layer by layer, of which the first counts as known in the end, and the last goes straight on. Returns how many blocks
 * are still open. */
static size_t extend(samples *s, extension *job, uint32_t *open, uint64_t *first, threads *pool)
{
    const size_t bytes = s->map.count * SIDE * sizeof *s->known;
    size_t count = s->map.count;
    for (uint32_t n = 0; n < count; n++) open[n] = n;
    for (job->layer = 1; job->layer <= LAYERS; job->layer++) {
        uint64_t *before = s->known;
        atomic_store(&job->changed, false);
        threads_run(pool, count, BLOCKS, extend_chunk, job);
        if (threads_stopped(pool)) break;
        s->known = job->next;
        job->next = before;
        if (job->layer == 1) memcpy(first, s->known, bytes);
        if (!atomic_load(&job->changed)) break;
        count = keep_open(job->whole, open, count);
    }
    return count;
}

bool continuation_fill(samples *s, threads *pool, error *e)
{
    const char *what = "the voxels around the surface";
    const size_t count = s->map.count;
    uint32_t *open = mem_array(count, sizeof *open, what, e);
    uint64_t *first = mem_array(count * SIDE, sizeof *first, what, e);
    extension job = {.s = s,
                     .open = open,
                     .next = mem_array(count * SIDE, sizeof *job.next, what, e),
                     .whole = mem_array(count, sizeof *job.whole, what, e)};
    const bool ok = open && first && job.next && job.whole;
    if (ok) {
        size_t left = extend(s, &job, open, first, pool);
        for (job.layer = 1; job.layer <= ROUNDS; job.layer++) {
            left = keep_open(job.whole, open, left);
            threads_run(pool, left, BLOCKS, lengthen_chunk, &job);
        }
        free(s->known);
        s->known = first;
        first = NULL;
    }
    free(first);
    free(open);
    free(job.next);
    free(job.whole);
    return ok;
}
