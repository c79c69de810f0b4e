#include "voxels/prefilter.h"

#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"
#include "voxels/block_lines.h"

#define SIDE GRID_VIEW_SIDE

enum { LINES = SIDE * SIDE, RUNS = 4 }; /* of a block along an axis; in a chunk of work */

static const double POLE = -0.26794919243112270647; /* sqrt(3) - 2 */

/* A run of blocks along an axis, row by row: the values of 64 lines, and which of them count. Two rows more on either
 * side, where none does. */
typedef struct rows {
    float *value;
    uint64_t *counts;
    size_t length;
} rows;

/* 6 times the sum over k >= 0 of POLE^k p(-k), p the parabola through f0, f1, f2 at 0, 1, 2; the line where there is no third
 * value, and the constant where there is no second. */
ISA_INLINE double sum_beyond(double f0, double f1, double f2, bool two, bool three)
{
    const double s0 = 1 / (1 - POLE), s1 = POLE * s0 * s0, s2 = (1 + POLE) * s1 * s0;
    const double slope = two ? f0 - f1 : 0, bend = three ? block_line_bend(f0, f1, f2) : 0;
    return 6 * (f0 * s0 + (slope + bend / 2) * s1 + bend / 2 * s2);
}

/* 1 where a bit is set, else 0. */
ISA_INLINE void spread_bits(uint64_t bits, float out[LINES])
{
    for (int half = 0; half < 2; half++) {
        const uint32_t these = (uint32_t)(bits >> 32 * half);
        for (uint32_t i = 0; i < 32; i++) out[32 * half + i] = these >> i & 1 ? 1.0f : 0.0f;
    }
}

/* Row k of the sums from below. What a row had is gone then: `value` receives it, `kept` is that of the two below. */
ISA_INLINE void sum_upwards(const rows *r, size_t k, float *value, const float *kept[2])
{
    float *row = r->value + LINES * k;
    const float *next = row + LINES, *after = next + LINES, *sum = row - LINES;
    const uint64_t *counts = r->counts + k, here = counts[0];
    uint64_t begins = here & ~counts[-1], ends = here & ~counts[1];
    float chosen[LINES];
    spread_bits(here, chosen);
    for (int i = 0; i < LINES; i++) {
        const float own = row[i];
        value[i] = own;
        row[i] = chosen[i] > 0 ? 6 * own + (float)POLE * sum[i] : own;
    }
    for (; begins; begins &= begins - 1) {
        const int i = __builtin_ctzll(begins);
        const bool two = counts[1] >> i & 1, three = two && counts[2] >> i & 1;
        row[i] = (float)sum_beyond((double)value[i], (double)next[i], (double)after[i], two, three);
    }
    for (; ends; ends &= ends - 1) { /* both sums meet */
        const int i = __builtin_ctzll(ends);
        const bool two = counts[-1] >> i & 1, three = two && counts[-2] >> i & 1;
        const double other = sum_beyond((double)value[i], (double)kept[0][i], (double)kept[1][i], two, three);
        row[i] = (float)(((double)row[i] + other - 6 * (double)value[i]) * (-POLE / (1 - POLE * POLE)));
    }
}

ISA_INLINE void solve(const rows *r)
{
    float value[3][LINES]; /* of rows k, k - 1 and k - 2, by turns */
    for (size_t k = 0; k < r->length; k++)
        if (r->counts[k])
            sum_upwards(r, k, value[k % 3], (const float *[]){value[(k + 2) % 3], value[(k + 1) % 3]});
    for (size_t k = r->length - 1; k-- > 0;) {
        float *row = r->value + LINES * k, chosen[LINES];
        const float *above = row + LINES;
        const uint64_t goes_on = r->counts[k] & r->counts[k + 1];
        if (goes_on == 0) continue;
        spread_bits(goes_on, chosen);
        for (int i = 0; i < LINES; i++) row[i] = chosen[i] > 0 ? (float)POLE * (above[i] - row[i]) : row[i];
    }
}

/* The voxels of a block as rows, or these back; strides `along` the lines, and of a line's place by 8 and by 1. */
ISA_INLINE void copy_strided(float *f, float *row, bool back, int along, int a, int b)
{
    for (int k = 0; k < SIDE; k++, row += LINES)
        for (int i = 0; i < SIDE; i++)
            for (int j = 0; j < SIDE; j++) {
                if (back)
                    f[k * along + i * a + j * b] = row[SIDE * i + j];
                else
                    row[SIDE * i + j] = f[k * along + i * a + j * b];
            }
}

ISA_INLINE void copy_block(float *f, int axis, float *row, bool back)
{
    if (axis == 0) copy_strided(f, row, back, 64, 8, 1);
    if (axis == 1) copy_strided(f, row, back, 8, 64, 1);
    if (axis == 2) copy_strided(f, row, back, 1, 64, 8);
}

/* Of the voxels' bits, likewise. */
ISA_INLINE void copy_bits(const uint64_t bits[SIDE], int axis, uint64_t row[SIDE])
{
    uint64_t layer[SIDE];
    for (int x = 0; x < SIDE; x++) layer[x] = axis == 2 ? block_transposed(bits[x]) : bits[x];
    for (int k = 0; k < SIDE; k++) row[k] = axis == 0 ? layer[k] : block_turned(layer, k);
}

typedef struct filtering {
    samples *s;
    bool known;
    const uint8_t *counts; /* of each block, whether any of its voxels does */
    uint32_t *first;       /* blocks that begin runs */
    rows *rows;            /* of each worker */
    int axis;
} filtering;

/* The block below (side 0) or above in the run, or BLOCK_MAP_NONE. */
static uint32_t beside(const filtering *job, uint32_t n, int side)
{
    const uint32_t next = job->s->near[6 * (size_t)n + (size_t)(2 * job->axis + side)];
    return next != BLOCK_MAP_NONE && job->counts[next] ? next : BLOCK_MAP_NONE;
}

ISA_CLONES static void filter_chunk(void *context, int worker, size_t begin, size_t end)
{
    const filtering *job = context;
    const samples *s = job->s;
    rows *r = &job->rows[worker];
    for (size_t i = begin; i < end; i++) {
        r->length = 0;
        for (uint32_t n = job->first[i], next; n != BLOCK_MAP_NONE; n = next, r->length += SIDE) {
            uint64_t *counts = r->counts + r->length;
            if ((next = beside(job, n, 1)) != BLOCK_MAP_NONE) block_fetch(s->f[next]);
            copy_block(s->f[n], job->axis, r->value + LINES * r->length, false);
            if (job->known)
                copy_bits(s->known + (size_t)n * SIDE, job->axis, counts);
            else
                memset(counts, 0xff, SIDE * sizeof *counts);
        }
        r->counts[r->length] = r->counts[r->length + 1] = 0;
        solve(r);
        float *row = r->value;
        for (uint32_t n = job->first[i]; n != BLOCK_MAP_NONE; n = beside(job, n, 1), row += LINES * SIDE)
            copy_block(s->f[n], job->axis, row, true);
    }
}

/* Where runs along the axis begin; *longest receives the voxels of the longest. Returns how many there are. */
static size_t find_runs(const filtering *job, size_t *longest)
{
    size_t count = 0;
    *longest = 0;
    for (uint32_t n = 0; n < job->s->map.count; n++) {
        if (!job->counts[n] || beside(job, n, 0) != BLOCK_MAP_NONE) continue;
        size_t length = 0;
        for (uint32_t k = n; k != BLOCK_MAP_NONE; k = beside(job, k, 1)) length += SIDE;
        if (length > *longest) *longest = length;
        job->first[count++] = n;
    }
    return count;
}

static bool filter_axis(filtering *job, threads *pool, error *e)
{
    size_t longest;
    const size_t count = find_runs(job, &longest), workers = (size_t)threads_count(pool),
                 length = longest + 4;
    float *value = mem_array(workers * length, LINES * sizeof *value, "a run of voxels", e);
    uint64_t *counts = mem_array(workers * length, sizeof *counts, "a run of voxels", e);
    const bool ok = value && counts;
    for (size_t k = 0; ok && k < workers; k++) {
        job->rows[k] = (rows){value + LINES * (k * length + 2), counts + k * length + 2, 0};
        memset(job->rows[k].value - 2 * LINES, 0, 2 * LINES * sizeof *value);
        memset(job->rows[k].counts - 2, 0, 2 * sizeof *counts);
    }
    if (ok) threads_run(pool, count, RUNS, filter_chunk, job);
    free(value);
    free(counts);
    return ok;
}

bool prefilter_run(samples *s, bool known, threads *pool, error *e)
{
    uint8_t *counts = mem_array(s->map.count, sizeof *counts, "the runs of voxels", e);
    uint32_t *first = mem_array(s->map.count, sizeof *first, "the runs of voxels", e);
    rows *r = mem_array((size_t)threads_count(pool), sizeof *r, "the runs of voxels", e);
    bool ok = counts && first && r;
    for (size_t n = 0; ok && n < s->map.count; n++) counts[n] = !known || block_has_any(s->known + n * SIDE);
    filtering job = {s, known, counts, first, r, 0};
    for (; ok && job.axis < 3; job.axis++) ok = filter_axis(&job, pool, e);
    free(counts);
    free(first);
    free(r);
    return ok;
}
