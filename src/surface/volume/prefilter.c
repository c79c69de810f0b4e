// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/prefilter.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/lanes.h"
#include "base/core/memory.h"
#include "surface/volume/block_lines.h"

#define SIDE GRID_VIEW_SIDE

enum { LINES = SIDE * SIDE, RUNS = 8 }; /* LINES: lines of a run; RUNS: runs in a chunk of work */

static const double POLE = -0.26794919243112270647; /* sqrt(3) - 2 */

/* A run of consecutive blocks along an axis: 64 lines. A row has the values of all lines at one position
 * along the run. */
typedef struct run {
    float **block;    /* voxels of each block */
    uint64_t *counts; /* per row: bits of the lines whose voxel counts; preceded and followed by two rows
                    * without bits */
    size_t length;    /* number of rows */
} run;

/* Offsets in the voxels of a block: from one row to the next, and between groups of eight lines of a row. */
typedef struct strides {
    int along, across;
} strides;
static const strides first_axis = {LINES, SIDE} /* also of what has been turned */,
                     second_axis = {SIDE, LINES};

ISA_INLINE float *row_at(const run *r, strides by, size_t k)
{
    return r->block[k / SIDE] + (int)(k % SIDE) * by.along;
}

ISA_INLINE lanes *lanes_at(const float *row, strides by, int eight)
{
    return (lanes *)(row + eight * by.across);
}

/* Address of lane group i of a row. */
ISA_INLINE float *line_at(float *row, strides by, int i)
{
    return row + i / SIDE * by.across + i % SIDE;
}

/* 6 times the sum over k >= 0 of POLE^k p(-k). p is the parabola through f0, f1, f2 at 0, 1, 2; a line
 * without `three`, a constant without `two`. */
ISA_INLINE double sum_beyond(double f0, double f1, double f2, bool two, bool three)
{
    const double s0 = 1 / (1 - POLE), s1 = POLE * s0 * s0, s2 = (1 + POLE) * s1 * s0;
    const double slope = two ? f0 - f1 : 0, bend = three ? block_line_bend(f0, f1, f2) : 0;
    return 6 * (f0 * s0 + (slope + bend / 2) * s1 + bend / 2 * s2);
}

/* Forward recursion for row k. It overwrites the row: `value` receives its previous values; `kept` has those
 * of the two rows below. */
ISA_INLINE void sum_upwards(const run *r, strides by, size_t k, float value[LINES], const float *kept[2])
{
    const size_t last = r->length - 1;
    const uint64_t *counts = r->counts + k, here = counts[0];
    uint64_t begins = here & ~counts[-1], ends = here & ~counts[1];
    float *row = row_at(r, by, k), *before = row_at(r, by, k > 0 ? k - 1 : 0),
          *next = row_at(r, by, k + 1 < last ? k + 1 : last),
          *after = row_at(r, by, k + 2 < last ? k + 2 : last);
    for (int i = 0; i < SIDE; i++) {
        lanes *at = lanes_at(row, by, i), own = *at;
        *lanes_at(value, first_axis, i) = own;
        *at = lanes_chosen(block_row(here, i), 6 * own + (float)POLE * *lanes_at(before, by, i), own);
    }
    for (; begins; begins &= begins - 1) { /* a line begins: its sum comes from the extrapolation */
        const int i = __builtin_ctzll(begins);
        const bool two = counts[1] >> i & 1, three = two && counts[2] >> i & 1;
        const double f1 = (double)*line_at(next, by, i), f2 = (double)*line_at(after, by, i);
        *line_at(row, by, i) = (float)sum_beyond((double)value[i], f1, f2, two, three);
    }
    for (; ends; ends &= ends - 1) { /* a line ends: the initial value of the backward recursion */
        const int i = __builtin_ctzll(ends);
        const bool two = counts[-1] >> i & 1, three = two && counts[-2] >> i & 1;
        const double other = sum_beyond((double)value[i], (double)kept[0][i], (double)kept[1][i], two, three);
        float *at = line_at(row, by, i);
        *at = (float)(((double)*at + other - 6 * (double)value[i]) * (-POLE / (1 - POLE * POLE)));
    }
}

ISA_INLINE void solve(const run *r, strides by)
{
    float value[3][LINES]; /* previous values of rows k, k - 1, k - 2, in a ring buffer */
    for (size_t k = 0; k < r->length; k++)
        if (r->counts[k])
            sum_upwards(r, by, k, value[k % 3], (const float *[]){value[(k + 2) % 3], value[(k + 1) % 3]});
    for (size_t k = r->length - 1; k-- > 0;) {
        const uint64_t goes_on = r->counts[k] & r->counts[k + 1];
        const float *row = row_at(r, by, k), *above = row_at(r, by, k + 1);
        if (goes_on == 0) continue;
        for (int i = 0; i < SIDE; i++) {
            lanes *at = lanes_at(row, by, i);
            *at = lanes_chosen(block_row(goes_on, i), (float)POLE * (*lanes_at(above, by, i) - *at), *at);
        }
    }
}

/* Permutes the axes of a block, so that the lines along the last axis become adjacent in memory; `back`
 * reverses this. */
ISA_INLINE void turn_block(const float *from, float *to, bool back)
{
    for (int x = 0; x < SIDE; x++) {
        lanes row[SIDE];
        for (int k = 0; k < SIDE; k++)
            row[k] = *(const lanes *)(from + (back ? 64 * k + SIDE * x : 64 * x + SIDE * k));
        lanes_transpose(row);
        for (int k = 0; k < SIDE; k++)
            *(lanes *)(to + (back ? 64 * x + SIDE * k : 64 * k + SIDE * x)) = row[k];
    }
}

/* Copies the bits of the voxels, permuted likewise. */
ISA_INLINE void copy_bits(const uint64_t bits[SIDE], int axis, uint64_t row[SIDE])
{
    uint64_t layer[SIDE];
    for (int x = 0; x < SIDE; x++) layer[x] = axis == 2 ? block_transposed(bits[x]) : bits[x];
    for (int k = 0; k < SIDE; k++) row[k] = axis == 0 ? layer[k] : block_turned(layer, k);
}

typedef struct prefilter_job {
    samples *s;
    bool known;
    const uint8_t *counts; /* per block: it has a voxel that counts */
    uint32_t *first;       /* the first block of each run */
    run *runs;             /* per worker */
    float *turned;         /* per worker: the permuted voxels of a run along the last axis */
    size_t longest;        /* length of the longest run, in rows */
    int axis;
} prefilter_job;

/* The adjacent block below (side 0) or above in the run, or BLOCK_MAP_NONE. */
static uint32_t beside(const prefilter_job *job, uint32_t n, int side)
{
    const uint32_t next = job->s->near[6 * (size_t)n + (size_t)(2 * job->axis + side)];
    return next != BLOCK_MAP_NONE && job->counts[next] ? next : BLOCK_MAP_NONE;
}

ISA_CLONES static void filter_chunk(void *context, int worker, size_t begin, size_t end)
{
    const prefilter_job *job = context;
    const samples *s = job->s;
    run *r = &job->runs[worker];
    float *turned = job->turned + (size_t)worker * job->longest * SIDE * SIDE;
    for (size_t i = begin; i < end; i++) {
        r->length = 0;
        for (uint32_t n = job->first[i], next; n != BLOCK_MAP_NONE; n = next, r->length += SIDE) {
            uint64_t *counts = r->counts + r->length;
            float **block = &r->block[r->length / SIDE];
            if ((next = beside(job, n, 1)) != BLOCK_MAP_NONE) block_fetch(s->f[next]);
            *block = job->axis < 2 ? s->f[n] : turned + r->length * SIDE * SIDE;
            if (job->axis == 2) turn_block(s->f[n], *block, false);
            if (job->known)
                copy_bits(s->known + (size_t)n * SIDE, job->axis, counts);
            else
                memset(counts, 0xff, SIDE * sizeof *counts);
        }
        r->counts[r->length] = r->counts[r->length + 1] = 0;
        if (job->axis == 1) /* separate calls, so that strides are compile-time constants */
            solve(r, second_axis);
        else
            solve(r, first_axis);
        if (job->axis < 2) continue;
        const float *const *block = (const float *const *)r->block;
        for (uint32_t n = job->first[i]; n != BLOCK_MAP_NONE; n = beside(job, n, 1))
            turn_block(*block++, s->f[n], true);
    }
}

/* Finds the runs along the axis and the length of the longest one. Returns their number. */
static size_t find_runs(prefilter_job *job)
{
    size_t count = 0;
    job->longest = 0;
    for (uint32_t n = 0; n < job->s->map.count; n++) {
        if (!job->counts[n] || beside(job, n, 0) != BLOCK_MAP_NONE) continue;
        size_t length = 0;
        for (uint32_t k = n; k != BLOCK_MAP_NONE; k = beside(job, k, 1)) length += SIDE;
        if (length > job->longest) job->longest = length;
        job->first[count++] = n;
    }
    return count;
}

static bool filter_axis(prefilter_job *job, threads *pool, error *e)
{
    const char *what = "a run of voxels";
    const size_t runs = find_runs(job), workers = (size_t)threads_count(pool), blocks = job->longest / SIDE,
                 rows = job->longest + 4, voxels = job->axis == 2 ? blocks * GRID_VIEW_VOXELS : 0;
    float **block = mem_array(workers * blocks, sizeof *block, what, e);
    uint64_t *counts = mem_array(workers * rows, sizeof *counts, what, e);
    job->turned = mem_array(workers * voxels, sizeof *job->turned, what, e);
    const bool ok = block && counts && job->turned;
    for (size_t k = 0; ok && k < workers; k++)
        job->runs[k] = (run){block + k * blocks, counts + k * rows + 2, 0};
    if (ok) threads_run(pool, runs, RUNS, filter_chunk, job);
    free(block);
    free(counts);
    free(job->turned);
    return ok;
}

bool prefilter_run(samples *s, bool known, threads *pool, error *e)
{
    uint8_t *counts = mem_array(s->map.count, sizeof *counts, "the runs of voxels", e);
    uint32_t *first = mem_array(s->map.count, sizeof *first, "the runs of voxels", e);
    run *r = mem_array((size_t)threads_count(pool), sizeof *r, "the runs of voxels", e);
    bool ok = counts && first && r;
    for (size_t n = 0; ok && n < s->map.count; n++) counts[n] = !known || block_has_any(s->known + n * SIDE);
    prefilter_job job = {.s = s, .known = known, .counts = counts, .first = first, .runs = r};
    for (; ok && job.axis < 3; job.axis++) ok = filter_axis(&job, pool, e);
    free(counts);
    free(first);
    free(r);
    return ok;
}
