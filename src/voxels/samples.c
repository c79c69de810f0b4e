#include "voxels/samples.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"

#define SIDE GRID_VIEW_SIDE
#define VOXELS GRID_VIEW_VOXELS

enum { BLOCKS = 64, RUNS = 4 }; /* in a chunk of work */
/* Where fewer of the leaves are of use, as of fogs, those are copied and all go. */
static const double MOST_LEAVES = 0.75;
/* Of the continuation: as far as values are read for their own sake (PATH_LEVEL_SET in volume.c). Beyond, straight lines are
 * enough: of what is wrong there some 1e-5 arrives at the surface. */
enum { LAYERS = 8 };

/* Beyond this sums of floats overflow; nothing that is meant comes near it. */
static const float largest_value = 1e30f;

/* See along_line. A ball of 10 voxels comes within 4e-5 voxel of the one with all data at 0.25 to 1;
 * at 0, straight lines, it is 5e-4. */
static const double bend_limit = 0.5;

static const int stride_of[3] = {64, 8, 1};

/* Asks for the voxels of a block that comes next: blocks lie here and there, which a processor cannot foretell. */
ISA_INLINE void fetch_block(const float *f)
{
#pragma GCC unroll 8
    for (int k = 0; k < VOXELS; k += 16) __builtin_prefetch(f + k);
}

size_t samples_bytes(size_t count, bool settled)
{
    const size_t while_made = settled ? 0 : 2 * SIDE * sizeof(uint64_t) + 6 * sizeof(uint32_t);
    return count * (VOXELS * sizeof(float) + sizeof(float *) + while_made) + block_map_bytes(count);
}

void samples_settle(samples *s)
{
    free(s->known);
    free(s->inside);
    free(s->near);
    s->known = s->inside = NULL;
    s->near = NULL;
}

void samples_free(samples *s)
{
    block_map_free(&s->map);
    samples_settle(s);
    free(s->f);
    free(s->leaves.f);
    free(s->leaves.highest);
    free(s->others.f);
    free(s->others.highest);
    memset(s, 0, sizeof *s);
}

static bool is_usable(float value)
{
    return fabsf(value) <= largest_value; /* of NaN false */
}

static bool report_unusable(const samples *s, error *e)
{
    size_t bad = 0, first = 0, total = (size_t)s->map.count * VOXELS;
    for (size_t i = 0; i < total; i++)
        if (!is_usable(s->f[i / VOXELS][i % VOXELS]) && bad++ == 0) first = i;
    const int32_t *b = s->map.blocks[first / VOXELS];
    size_t v = first % VOXELS;
    return error_set(
        e, ERROR_INPUT_DAMAGED,
        "the volume has %zu voxels near its surface whose values are not finite or beyond %g, the first at (%d, %d, %d)",
        bad, (double)largest_value, b[0] * SIDE + (int)(v >> 6), b[1] * SIDE + (int)(v >> 3 & 7),
        b[2] * SIDE + (int)(v & 7));
}

typedef struct reading {
    const grid_view *from;
    samples *s;
    atomic_bool unusable;
} reading;

static void read_chunk(void *context, int worker, size_t begin, size_t end)
{
    reading *job = context;
    samples *s = job->s;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const int32_t *b = s->map.blocks[n];
        float *f = s->f[n];
        int good = 1;
        const grid_view_block from = grid_view_find(job->from, b[0], b[1], b[2]);
        grid_view_signs constant;
        const grid_view_signs *signs = grid_view_find_signs(job->from, from, &constant);
        if (from.leaf == BLOCK_MAP_NONE || !s->leaves.f || !job->from->plain)
            grid_view_read(job->from, from, f);
        memcpy(s->known + n * SIDE, signs->known, SIDE * sizeof *s->known);
        memcpy(s->inside + n * SIDE, signs->inside, SIDE * sizeof *s->inside);
        for (int i = 0; i < VOXELS; i++) good &= is_usable(f[i]);
        if (!good) atomic_store(&job->unusable, true);
        for (size_t k = 0; k < 6; k += 2) { /* each says to the one above it that it is there */
            const uint32_t above = block_map_find(&s->map, b[0] + (k == 0), b[1] + (k == 2), b[2] + (k == 4));
            s->near[6 * n + k + 1] = above;
            if (above != BLOCK_MAP_NONE) s->near[6 * (size_t)above + k] = (uint32_t)n;
        }
    }
}

static bool make_store(samples_store *store, size_t blocks, error *e)
{
    store->parts = (blocks + SAMPLES_RELEASED - 1) / SAMPLES_RELEASED;
    store->highest = mem_array(store->parts, sizeof *store->highest, "the voxels around the surface", e);
    for (size_t k = 0; store->highest && k < store->parts; k++) store->highest[k] = INT32_MIN;
    return store->highest;
}

static float *take_place(samples_store *store, size_t at, int32_t x)
{
    int32_t *highest = &store->highest[at / SAMPLES_RELEASED];
    if (x > *highest) *highest = x;
    return store->f + at * VOXELS;
}

samples_leaves samples_look(const grid_view *l, const block_map *map)
{
    const size_t leaf = VOXELS * sizeof(float), all = l->grid->leaf_count;
    size_t used = 0;
    for (uint32_t n = 0; n < map->count; n++) {
        const int32_t *b = map->blocks[n];
        used += block_map_find(&l->leaves, b[0], b[1], b[2]) != BLOCK_MAP_NONE;
    }
    if ((double)used < MOST_LEAVES * (double)all) return (samples_leaves){0, 0};
    return (samples_leaves){used * leaf, (all - used) * leaf};
}

/* Says where each block's voxels lie: in the grid's leaf, where these are taken over, or in a place of their own. */
static bool place_blocks(samples *s, const grid_view *l, samples_leaves taken, error *e)
{
    const bool shared = taken.used > 0;
    const size_t leaves = l->grid->leaf_count, own = s->map.count - taken.used / (VOXELS * sizeof(float));
    size_t others = 0;
    s->spare = taken.spare;
    s->leaves.f = shared ? l->grid->leaf_values : NULL;
    s->others.f = mem_array(own * VOXELS, sizeof(float), "the voxels around the surface", e);
    if (!s->others.f || !make_store(&s->leaves, shared ? leaves : 0, e) || !make_store(&s->others, own, e))
        return false;
    for (uint32_t n = 0; n < s->map.count; n++) {
        const int32_t *b = s->map.blocks[n];
        const uint32_t leaf = shared ? block_map_find(&l->leaves, b[0], b[1], b[2]) : BLOCK_MAP_NONE;
        const bool is_leaf = leaf != BLOCK_MAP_NONE;
        s->f[n] = take_place(is_leaf ? &s->leaves : &s->others, is_leaf ? leaf : others++, b[0]);
    }
    return true;
}

bool samples_read(const grid_view *l, vdb_grid *grid, samples_leaves taken, block_map *map, threads *pool,
                  samples *out, error *e)
{
    samples s = {.map = *map};
    memset(map, 0, sizeof *map);
    size_t n = s.map.count;
    s.f = mem_array(n, sizeof *s.f, "the voxels around the surface", e);
    s.known = mem_array(n * SIDE, sizeof *s.known, "the voxels around the surface", e);
    s.inside = mem_array(n * SIDE, sizeof *s.inside, "the voxels around the surface", e);
    s.near = mem_array(n * 6, sizeof *s.near, "the voxels around the surface", e);
    bool ok = s.f && s.known && s.inside && s.near && place_blocks(&s, l, taken, e);
    if (ok) {
        memset(s.near, 0xFF, n * 6 * sizeof *s.near); /* BLOCK_MAP_NONE */
        reading job = {l, &s, false};
        threads_run(pool, n, BLOCKS, read_chunk, &job);
        ok = !atomic_load(&job.unusable) || report_unusable(&s, e);
    }
    if (s.leaves.f) grid->leaf_values = NULL;
    if (ok)
        *out = s;
    else
        samples_free(&s);
    return ok;
}

/* ---- continuing a clamped band */

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

/* What the line through voxels at distances 1, 2 (values a, b) and 3 (c, where `bent`) says of the voxel
 * at 0. The parabola of a curved surface is followed where it is gentle: a bend of more than
 * `bend_limit` of the slope is an edge or noise, which a parabola would throw far off. */
ISA_INLINE double along_line(double a, double b, double c, bool bent)
{
    const double most = bend_limit * fabs(a - b);
    double bend = bent ? a - 2 * b + c : 0;
    bend = bend > most ? most : bend;
    bend = bend < -most ? -most : bend;
    return 2 * a - b + bend;
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

/* One layer. */
typedef struct extension {
    samples *s;
    const uint32_t *open; /* blocks that have voxels that are not known */
    uint64_t *next;       /* of all blocks: voxels that are known after this layer */
    uint8_t *whole;       /* of all blocks: whether all voxels were known before it */
    int layer;
    atomic_bool changed;
} extension;

/* What is known stays as it was until the layer is done, so that the order of blocks does not matter. */
static void extend_chunk(void *context, int worker, size_t begin, size_t end)
{
    extension *job = context;
    surroundings around;
    uint64_t changed = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        if (i + 1 < end) fetch_block(job->s->f[job->open[i + 1]]);
        const size_t n = job->open[i];
        uint64_t all = ~(uint64_t)0;
        find_surroundings(job->s, job->open[i], &around);
        for (int x = 0; x < SIDE; x++) {
            uint64_t known[18], bits = frontier(&around, x, known);
            job->next[n * SIDE + (size_t)x] = around.layers[x + 3] | bits;
            all &= around.layers[x + 3];
            changed |= bits;
            if (bits) extend_row(&around, x, bits, known, job->layer);
        }
        job->whole[n] = all == ~(uint64_t)0;
    }
    if (changed) atomic_store(&job->changed, true);
}

/* Bit 8 j + i goes to 8 i + j. Source: Warren, Hacker's Delight, section 7-3. */
ISA_INLINE uint64_t transposed(uint64_t m)
{
    uint64_t t = (m ^ m >> 7) & 0x00aa00aa00aa00aau;
    m ^= t ^ t << 7;
    t = (m ^ m >> 14) & 0x0000cccc0000ccccu;
    m ^= t ^ t << 14;
    t = (m ^ m >> 28) & 0x00000000f0f0f0f0u;
    return m ^ t ^ t << 28;
}

/* The bits of a block's slice i, in which byte j is a line along the axis: the line (i, j) of the other two. */
ISA_INLINE uint64_t slice_bits(const uint64_t known[SIDE], int axis, int i)
{
    uint64_t bits = 0;
    if (axis != 0) return axis == 2 ? known[i] : transposed(known[i]);
    for (int x = 0; x < SIDE; x++) bits |= (known[x] >> 8 * i & 0xff) << 8 * x;
    return transposed(bits);
}

ISA_INLINE void set_slice_bits(uint64_t known[SIDE], int axis, int i, uint64_t bits)
{
    if (axis != 2) bits = transposed(bits);
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
            line[k * step] = bounded(beside + abs(k - end) * slope, (double)line[k * step], LAYERS + SIDE);
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
                bits |= (uint64_t)go_straight(f + i * a + j * b, stride_of[axis], has) << 8 * j;
        }
        if (bits != before) set_slice_bits(known, axis, i, bits);
    }
}

static void straight_chunk(void *context, int worker, size_t begin, size_t end)
{
    const extension *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const size_t n = job->open[i];
        if (i + 1 < end) fetch_block(job->s->f[job->open[i + 1]]);
        for (int axis = 2; axis >= 0; axis--) straighten(job->s->f[n], job->s->known + n * SIDE, axis);
    }
}

bool samples_fill_unknown(samples *s, threads *pool, error *e)
{
    const char *what = "the voxels around the surface";
    size_t count = s->map.count;
    uint64_t *next = mem_array(count * SIDE, sizeof *next, what, e);
    uint32_t *open = mem_array(count, sizeof *open, what, e);
    uint8_t *whole = mem_array(count, sizeof *whole, what, e);
    const bool ok = next && open && whole;
    for (uint32_t n = 0; ok && n < count; n++) open[n] = n;
    for (int layer = 1; ok && layer <= LAYERS; layer++) {
        extension job = {s, open, next, whole, layer, false};
        threads_run(pool, count, BLOCKS, extend_chunk, &job);
        if (!atomic_load(&job.changed) || threads_stopped(pool)) break;
        next = s->known;
        s->known = job.next;
        size_t left = 0;
        for (size_t i = 0; i < count; i++)
            if (!whole[open[i]]) open[left++] = open[i];
        count = left;
    }
    extension rest = {.s = s, .open = open};
    if (ok) threads_run(pool, count, BLOCKS, straight_chunk, &rest);
    free(next);
    free(open);
    free(whole);
    return ok;
}

/* ---- the interpolating spline's coefficients */

/* The voxels of a block as rows of 64 lines, or these back; strides `along` the lines, and of a line's place by 8 and by 1. */
ISA_INLINE void copy_block(float *f, double *rows, bool back, int along, int a, int b)
{
    for (int k = 0; k < SIDE; k++, rows += 64)
        for (int i = 0; i < SIDE; i++)
            for (int j = 0; j < SIDE; j++) {
                if (back)
                    f[k * along + i * a + j * b] = (float)rows[8 * i + j];
                else
                    rows[8 * i + j] = (double)f[k * along + i * a + j * b];
            }
}

/* A run of blocks along an axis as rows of 64 lines: rows[64 k + line], k along the axis. */
ISA_INLINE void copy_run(samples *s, int axis, uint32_t first, double *rows, bool back)
{
    for (uint32_t n = first; n != BLOCK_MAP_NONE; n = s->near[6 * (size_t)n + (size_t)(2 * axis + 1)]) {
        float *f = s->f[n];
        const uint32_t next = s->near[6 * (size_t)n + (size_t)(2 * axis + 1)];
        if (!back && next != BLOCK_MAP_NONE) fetch_block(s->f[next]);
        if (axis == 0) copy_block(f, rows, back, 64, 8, 1);
        if (axis == 1) copy_block(f, rows, back, 8, 64, 1);
        if (axis == 2) copy_block(f, rows, back, 1, 64, 8);
        rows += 64 * SIDE;
    }
}

/* c[k-1] + 4 c[k] + c[k+1] = 6 s[k] within, c = s at both ends. */
ISA_INLINE void solve_run(double *rows, double *ratio, size_t length)
{
    ratio[0] = 0;
    for (size_t k = 1; k + 1 < length; k++) {
        ratio[k] = 1 / (4 - ratio[k - 1]);
        double *row = rows + 64 * k;
        for (int i = 0; i < 64; i++) row[i] = (6 * row[i] - row[i - 64]) * ratio[k];
    }
    for (size_t k = length - 2; k > 0; k--) {
        double *row = rows + 64 * k;
        for (int i = 0; i < 64; i++) row[i] -= ratio[k] * row[i + 64];
    }
}

static size_t run_length(const samples *s, int axis, uint32_t first)
{
    size_t length = 0;
    for (uint32_t n = first; n != BLOCK_MAP_NONE; n = s->near[6 * (size_t)n + (size_t)(2 * axis + 1)])
        length += SIDE;
    return length;
}

static bool starts_run(const samples *s, int axis, uint32_t n)
{
    return s->near[6 * (size_t)n + (size_t)(2 * axis)] == BLOCK_MAP_NONE;
}

typedef struct filtering {
    samples *s;
    int axis;
    const uint32_t *first; /* blocks that start runs */
    double *rows;          /* of each worker */
    size_t longest;
} filtering;

ISA_CLONES static void filter_chunk(void *context, int worker, size_t begin, size_t end)
{
    const filtering *job = context;
    double *rows = job->rows + 65 * job->longest * (size_t)worker;
    for (size_t i = begin; i < end; i++) {
        copy_run(job->s, job->axis, job->first[i], rows, false);
        solve_run(rows, rows + 64 * job->longest, run_length(job->s, job->axis, job->first[i]));
        copy_run(job->s, job->axis, job->first[i], rows, true);
    }
}

bool samples_prefilter(samples *s, threads *pool, error *e)
{
    uint32_t *first = mem_array(s->map.count, sizeof *first, "the runs of voxels", e);
    bool ok = first;
    for (int axis = 0; ok && axis < 3; axis++) {
        size_t count = 0, longest = 0;
        for (uint32_t n = 0; n < s->map.count; n++) {
            if (!starts_run(s, axis, n)) continue;
            size_t length = run_length(s, axis, n);
            if (length > longest) longest = length;
            first[count++] = n;
        }
        double *rows =
            mem_array((size_t)threads_count(pool) * 65 * longest, sizeof *rows, "a run of voxels", e);
        ok = rows;
        filtering job = {s, axis, first, rows, longest};
        if (ok) threads_run(pool, count, RUNS, filter_chunk, &job);
        free(rows);
    }
    free(first);
    return ok;
}

/* ---- taking cubes out */

/* What lies in a block that is missing: the nearest voxel of the block f. Its side of the surface is what counts there. */
static float nearest(const float *f, int x, int y, int z)
{
    const int at[3] = {x, y, z};
    int offset = 0;
    for (int axis = 0; axis < 3; axis++)
        offset += stride_of[axis] * (at[axis] < 0 ? 0 : at[axis] < SIDE ? at[axis] : SIDE - 1);
    return f[offset];
}

/* The part from `low` on, of so many voxels along an axis, that lies in the block `at`: whence and how many. */
typedef struct extent {
    int from, count;
} extent;

ISA_INLINE extent part_of(int low, int side, int at)
{
    const int from = low > SIDE * at ? low : SIDE * at,
              end = low + side < SIDE * (at + 1) ? low + side : SIDE * (at + 1);
    return (extent){from, end - from};
}

/* Rows of the lengths that most have, of those of a block and beside it, are copied at once. */
ISA_INLINE void copy_row(float *to, const float *from, int count)
{
    if (count == SIDE)
        memcpy(to, from, SIDE * sizeof *to);
    else if (count == 1)
        *to = *from;
    else if (count == 2)
        memcpy(to, from, 2 * sizeof *to);
    else
        for (int k = 0; k < count; k++) to[k] = from[k];
}

void samples_window(const samples *s, const int32_t block[3], const int low[3], int side, float *out)
{
    const float *own = s->f[block_map_find(&s->map, block[0], block[1], block[2])], *near[3][3][3];
    extent part[3][3]; /* of each axis: in the block below, in this one and in that above */
    for (int k = 0; k < 9; k++) part[k / 3][k % 3] = part_of(low[k / 3], side, k % 3 - 1);
    for (int k = 0; k < 27; k++) { /* all at first, so that they are waited for together */
        const int at[3] = {k / 9, k / 3 % 3, k % 3};
        if (part[0][at[0]].count <= 0 || part[1][at[1]].count <= 0 || part[2][at[2]].count <= 0) continue;
        const uint32_t n =
            block_map_find(&s->map, block[0] + at[0] - 1, block[1] + at[1] - 1, block[2] + at[2] - 1);
        near[at[0]][at[1]][at[2]] = n == BLOCK_MAP_NONE ? NULL : s->f[n];
        if (n != BLOCK_MAP_NONE && (at[0] == 1) + (at[1] == 1) + (at[2] == 1) == 2) fetch_block(s->f[n]);
    }
    for (int x = low[0]; x < low[0] + side; x++)
        for (int y = low[1]; y < low[1] + side; y++) {
            const float *const *blocks = near[(x >> 3) + 1][(y >> 3) + 1];
#pragma GCC unroll 3
            for (int k = 0; k < 3; k++) {
                const extent z = part[2][k];
                if (z.count <= 0) continue;
                if (blocks[k])
                    copy_row(out, blocks[k] + 64 * (x & 7) + 8 * (y & 7) + (z.from & 7), z.count);
                else
                    for (int i = 0; i < z.count; i++) out[i] = nearest(own, x, y, z.from + i);
                out += z.count;
            }
        }
}

void samples_fetch(const samples *s, const int32_t block[3])
{
    const uint32_t n = block_map_find(&s->map, block[0], block[1], block[2]);
    if (n != BLOCK_MAP_NONE) fetch_block(s->f[n]);
}

static void release_below(samples_store *store, int32_t x)
{
    const size_t bytes = SAMPLES_RELEASED * VOXELS * sizeof *store->f;
    for (; store->released + 1 < store->parts && store->highest[store->released] < x; store->released++)
        mem_release((char *)store->f + store->released * bytes, bytes);
}

void samples_release_below(samples *s, int32_t x)
{
    release_below(&s->leaves, x);
    release_below(&s->others, x);
}

void samples_corners(const samples *s, const int32_t block[3], bool smooth, float corners[729])
{
    if (!smooth) {
        samples_window(s, block, (const int[]){0, 0, 0}, 9, corners);
        return;
    }
    float c[11 * 11 * 11];
    samples_window(s, block, (const int[]){-1, -1, -1}, 11, c);
    static const int step_of[3] = {121, 11, 1};
    for (int axis = 0; axis < 3; axis++) { /* in place: what is read behind is kept in `before` */
        int d = step_of[axis], a = step_of[axis == 0 ? 1 : 0], b = step_of[axis == 2 ? 1 : 2];
        for (int i = 0; i < 11; i++)
            for (int j = 0; j < 11; j++) {
                float *line = c + i * a + j * b, before = line[0];
                for (int k = 1; k < 10; k++) {
                    float here = line[k * d];
                    line[k * d] =
                        (float)(((double)before + 4 * (double)here + (double)line[(k + 1) * d]) / 6);
                    before = here;
                }
            }
    }
    for (int x = 0; x < 9; x++)
        for (int y = 0; y < 9; y++)
            for (int z = 0; z < 9; z++) *corners++ = c[((x + 1) * 11 + y + 1) * 11 + z + 1];
}

void samples_signs(const samples *s, const int32_t block[3], bool smooth, corner_signs *out)
{
    enum { CORNERS = SIDE + 1 };
    float f[CORNERS * CORNERS * CORNERS];
    samples_corners(s, block, smooth, f);
    memset(out, 0, sizeof *out);
    for (int k = 0; k < CORNERS * CORNERS * CORNERS; k++) {
        const int x = k / (CORNERS * CORNERS), y = k / CORNERS % CORNERS, z = k % CORNERS,
                  part = (y == SIDE) + 2 * (z == SIDE), bit = 8 * (y & 7) + (z & 7);
        out->inside.at[part][x] |= (uint64_t)(f[k] < 0) << bit;
        out->outside.at[part][x] |= (uint64_t)(f[k] > 0) << bit;
    }
    for (int k = 0; k < 8; k++) {
        const uint32_t n =
            block_map_find(&s->map, block[0] + (k & 1), block[1] + (k >> 1 & 1), block[2] + (k >> 2));
        for (int x = 0; n != BLOCK_MAP_NONE && x < (k & 1 ? 1 : SIDE); x++)
            out->known.at[k >> 1][x + (k & 1 ? SIDE : 0)] = s->known[(size_t)n * SIDE + (size_t)x];
    }
}
