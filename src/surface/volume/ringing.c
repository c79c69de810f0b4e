// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/ringing.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

#define SIDE GRID_VIEW_SIDE

static const char what[] = "the samples beside a jump";

/* Distance from a cell within which coefficients are examined, voxels: over it, the overshoot decreases to 1e-4 of the
 * jump. */
enum { REACH = 6 };
/* Ratio of the coefficients around a cell and its own samples, above which the cell rings. For distances it is at most 24:
 * they change by up to 12 sqrt(3) within REACH, and the corners of a cell with samples of one sign have one of 0.87. */
static const double RATIO = 30;
/* Above it, one cell suffices: the surface is displaced everywhere beside the jump. */
static const double CERTAIN_RATIO = 1000;
/* Fraction of the cells that ring, and of those whose own samples would be limited, that is ignored: single cells of noise. */
static const double IGNORED = 0.01;
/* The surface passes through the jump itself, so that limits would move it, if more than this fraction of its cells has a
 * sample beyond the bound. */
static const double WITHIN_JUMP = 0.1;
/* The surface follows the samples beside a jump, not the object, if in more than the fraction ONE_SIDED of the cells the samples
 * on one side are RATIO times as large as on the other, and F bends there by more than BEND times the larger ones, as where a
 * ramp ends. The fraction is at least 0.4 at the edges of clipped ramps of up to two voxels, at most 0.31 for boxes with faces on
 * layers of samples and for distances as whole numbers, and 0.02 for other bodies. */
static const double ONE_SIDED = 0.35, BEND = 1.25;
/* Maximum number of cells that are examined for ONE_SIDED, and the minimum: on fewer cells the share depends on the symmetry of
 * a small body. */
enum { EXAMINED = 65536, ENOUGH = 1000 };
/* Ratio of a sample and its bound, above which it counts as limited: smaller changes do not affect curvature much. */
static const float JUMP = 2;
/* Bound of the samples, in units of the mean, over the cells nearby, of the smaller one of their largest samples on both
 * sides. For distances the mean is .6 voxels, and the bound 3.6. A lower one bends the surface, a higher one leaves more
 * of the overshoot. */
static const double BOUND = 6;

/* The coefficients of a block, the first of its lowest voxel, and their strides. */
typedef struct block_view {
    const float *first;
    size_t slab, row;
} block_view;

/* False: there is no such block. */
static bool view_block(const coefficient_blocks *b, int32_t x, int32_t y, int32_t z, block_view *out)
{
    const bool later = b->place != NULL;
    const uint32_t n = block_map_find(later ? &b->source.map : b->map, x, y, z);
    if (n == BLOCK_MAP_NONE) return false;
    if (later)
        *out = (block_view){b->source.f[n], SIDE * SIDE, SIDE};
    else
        *out = (block_view){coefficient_block_cell(b->memory + (size_t)n * COEFFICIENT_BLOCK_SIZE, 1, 1, 1),
                            COEFFICIENT_BLOCK_SLAB, COEFFICIENT_BLOCK_SIDE};
    return true;
}

/* The voxels of a block within REACH of a cell along one axis: the first one, and the last one plus 1. */
typedef struct extent {
    int32_t first, end;
} extent;

static extent extent_in(int32_t cell, int32_t block)
{
    const int32_t low = cell - REACH - SIDE * block, high = cell + REACH + 2 - SIDE * block;
    return (extent){low > 0 ? low : 0, high < SIDE ? high : SIDE};
}

/* The difference of the highest and lowest coefficient within REACH of a cell; 0 counts as one. */
static double range_around(const coefficient_blocks *b, const int32_t cell[3])
{
    float low = 0, high = 0;
    int32_t block[3];
    for (block[0] = (cell[0] - REACH) >> 3; block[0] <= (cell[0] + 1 + REACH) >> 3; block[0]++)
        for (block[1] = (cell[1] - REACH) >> 3; block[1] <= (cell[1] + 1 + REACH) >> 3; block[1]++)
            for (block[2] = (cell[2] - REACH) >> 3; block[2] <= (cell[2] + 1 + REACH) >> 3; block[2]++) {
                block_view v;
                if (!view_block(b, block[0], block[1], block[2], &v)) continue;
                const extent x = extent_in(cell[0], block[0]), y = extent_in(cell[1], block[1]),
                             z = extent_in(cell[2], block[2]);
                for (int32_t i = x.first; i < x.end; i++)
                    for (int32_t j = y.first; j < y.end; j++)
                        for (int32_t k = z.first; k < z.end; k++) {
                            const float f = v.first[(size_t)i * v.slab + (size_t)j * v.row + (size_t)k];
                            low = f < low ? f : low;
                            high = f > high ? f : high;
                        }
            }
    return (double)high - (double)low;
}

/* The largest values of a cell on both sides. */
static void largest_of(const float value[8], double *below, double *above)
{
    *below = *above = 0;
    for (int k = 0; k < 8; k++) {
        *below = fmax(*below, -(double)value[k]);
        *above = fmax(*above, (double)value[k]);
    }
}

/* Whether the spline has both signs at the centres of the eighths of a cell. `first`: its first coefficient. */
static bool is_crossed_within(const float *first)
{
    enum { LOW = 0, HIGH = 1 };
    static const double weight[2][4] = {[LOW] = {27. / 384, 235. / 384, 121. / 384, 1. / 384},
                                        [HIGH] = {1. / 384, 121. / 384, 235. / 384, 27. / 384}};
    int inside = 0;
    for (int place = 0; place < 8; place++) {
        const double *x = weight[place & 1], *y = weight[place >> 1 & 1], *z = weight[place >> 2];
        double f = 0;
        for (int k = 0; k < 64; k++)
            f += x[k >> 4] * y[k >> 2 & 3] * z[k & 3] *
                 (double)first[k / 16 * COEFFICIENT_BLOCK_SLAB + k / 4 % 4 * COEFFICIENT_BLOCK_SIDE + k % 4];
        inside += f < 0;
    }
    return inside > 0 && inside < 8;
}

/* Whether F bends at the corners of one side, by the mean of the sum of its second differences. Distances bend by 2 over the
 * radius, planes do not, wherever they lie between the samples. */
static bool bends(const coefficient_blocks *b, const crossed_cell *c, bool inside, double large)
{
    enum { SLAB = COEFFICIENT_BLOCK_SLAB, ROW = COEFFICIENT_BLOCK_SIDE };
    const int at[3] = {c->at[0] & 7, c->at[1] & 7, c->at[2] & 7};
    float buffer[COEFFICIENT_BLOCK_CELL];
    const float *first = coefficient_blocks_find_cell(b, c->block, at, buffer);
    double sum = 0;
    int count = 0;
    for (int k = 0; k < 8; k++) {
        const float *f = first + (1 + (k & 1)) * SLAB + (1 + (k >> 1 & 1)) * ROW + 1 + (k >> 2);
        if ((c->value[k] < 0) != inside) continue;
        sum += (double)(f[SLAB] + f[-SLAB] + f[ROW] + f[-ROW] + f[1] + f[-1] - 6 * f[0]);
        count++;
    }
    return fabs(sum) > BEND * large * count;
}

double ringing_one_sided(const coefficient_blocks *b, const crossed_cells *cells)
{
    const size_t step = cells->count / EXAMINED + 1;
    size_t found = 0, all = 0;
    for (size_t k = 0; k < cells->count; k += step) {
        crossed_cell c;
        double below, above;
        crossed_cells_get(cells, k, &c);
        largest_of(c.value, &below, &above);
        const double large = fmax(below, above), small = fmin(below, above);
        found += small > 0 && large > RATIO * small && bends(b, &c, below < above, large);
        all++;
    }
    const double share = all < ENOUGH ? 0 : (double)found / (double)all;
    return share > ONE_SIDED ? share : 0;
}

/* The search for late cells that ring. */
typedef struct share_job {
    const coefficient_blocks *coefficients;
    const crossed_cell *late;
    atomic_size_t found;
    atomic_bool certain;
} share_job;

static void share_chunk(void *context, int worker, size_t begin, size_t end)
{
    share_job *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const crossed_cell *c = &job->late[k];
        const int at[3] = {c->at[0] & 7, c->at[1] & 7, c->at[2] & 7};
        double below, above;
        float buffer[COEFFICIENT_BLOCK_CELL];
        largest_of(c->value, &below, &above);
        const double range = range_around(job->coefficients, c->at), own = fmax(below, above);
        if (own > 0 && range > CERTAIN_RATIO * own) job->certain = true;
        if (range > RATIO * own &&
            is_crossed_within(coefficient_blocks_find_cell(job->coefficients, c->block, at, buffer)))
            job->found++;
    }
}

double ringing_share(const coefficient_blocks *b, const crossed_cells *cells, threads *pool, bool *certain)
{
    share_job job = {.coefficients = b, .late = cells->late};
    threads_run(pool, cells->count - crossed_cells_in_blocks(cells), THREADS_GRAIN, share_chunk, &job);
    *certain = job.certain;
    const double found = (double)job.found, all = (double)cells->count;
    return found > IGNORED * all ? found / all : 0;
}

/* Sums over the cells of a block: see BOUND. */
typedef struct scale {
    double sum, count;
} scale;

/* Adds up the scales of each block of the samples. */
static void add_cells(const crossed_cells *cells, const samples *s, scale *of)
{
    for (size_t k = 0; k < cells->count; k++) {
        crossed_cell c;
        double below, above;
        crossed_cells_get(cells, k, &c);
        const uint32_t n = block_map_find(&s->map, c.at[0] >> 3, c.at[1] >> 3, c.at[2] >> 3);
        if (n == BLOCK_MAP_NONE) continue;
        largest_of(c.value, &below, &above);
        of[n].sum += fmin(below, above);
        of[n].count++;
    }
}

/* Sets the mean scale of each block, from itself and its neighbours; blocks without cells have it from those beside them. */
static void spread(const samples *s, const scale *from, scale *to)
{
    for (uint32_t n = 0; n < s->map.count; n++) {
        uint32_t around[27];
        scale sum = {0, 0};
        block_map_around(&s->map, s->map.blocks[n], around);
        for (int k = 0; k < 27; k++) {
            if (around[k] == BLOCK_MAP_NONE) continue;
            sum.sum += from[around[k]].sum;
            sum.count += from[around[k]].count;
        }
        to[n] = sum;
    }
}

/* Limits the samples of block n. */
static void limit_block(samples *s, uint32_t n, float bound, const block_map *map, ringing_limits *out)
{
    const int32_t *b = s->map.blocks[n];
    const uint32_t own = block_map_find(map, b[0], b[1], b[2]);
    for (int k = 0; k < GRID_VIEW_VOXELS; k++) {
        float *f = &s->f[n][k];
        if (fabsf(*f) <= bound) continue;
        const bool is_known = s->known[SIDE * (size_t)n + (size_t)(k >> 6)] >> (k & 63) & 1,
                   jumps = fabsf(*f) > JUMP * bound;
        out->count += is_known && jumps;
        if (is_known && jumps && out->count == 1) {
            memcpy(
                out->first,
                (const int32_t[]){SIDE * b[0] + (k >> 6), SIDE * b[1] + (k >> 3 & 7), SIDE * b[2] + (k & 7)},
                sizeof out->first);
            out->was = *f;
        }
        *f = *f < 0 ? -bound : bound;
        if (jumps && own != BLOCK_MAP_NONE)
            out->limited[SIDE * (size_t)own + (size_t)(k >> 6)] |= (uint64_t)1 << (k & 63);
    }
}

/* The bound of the samples of block n; infinite: none. */
static double bound_of(const scale *of, uint32_t n)
{
    return of[n].sum > 0 ? BOUND * of[n].sum / of[n].count : (double)INFINITY;
}

/* Whether the surface passes through the jump itself: bounds apply to samples of too many of its cells. */
static bool is_within_jump(const crossed_cells *cells, const samples *s, const scale *of)
{
    size_t within = 0;
    for (size_t k = 0; k < cells->count; k++) {
        crossed_cell c;
        double below, above;
        crossed_cells_get(cells, k, &c);
        const uint32_t n = block_map_find(&s->map, c.at[0] >> 3, c.at[1] >> 3, c.at[2] >> 3);
        largest_of(c.value, &below, &above);
        within += n != BLOCK_MAP_NONE && fmax(below, above) > bound_of(of, n);
    }
    return (double)within > WITHIN_JUMP * (double)cells->count;
}

bool ringing_limit(const crossed_cells *cells, samples *s, ringing_limits *out, error *e)
{
    enum { ROUNDS = 2 /* samples are read up to 13 voxels from the cells */ };
    scale *of = mem_array(s->map.count, sizeof *of, what, e),
          *mean = mem_array(s->map.count, sizeof *mean, what, e);
    uint64_t *limited = mem_array((size_t)cells->map->count * SIDE, sizeof *limited, what, e);
    const bool ok = of && mean && limited;
    if (ok) add_cells(cells, s, of);
    for (int round = 0; ok && round < ROUNDS; round++) {
        spread(s, of, mean);
        memcpy(of, mean, s->map.count * sizeof *of);
    }
    if (ok && !is_within_jump(cells, s, of)) {
        out->limited = limited;
        limited = NULL;
        for (uint32_t n = 0; n < s->map.count; n++)
            limit_block(s, n, (float)bound_of(of, n), cells->map, out);
    }
    free(of);
    free(mean);
    free(limited);
    return ok;
}

bool ringing_is_limited(const ringing_limits *r, const block_map *map, const int32_t cell[3])
{
    for (int k = 0; r->limited && k < 64; k++) {
        const int32_t x = cell[0] - 1 + (k >> 4), y = cell[1] - 1 + (k >> 2 & 3), z = cell[2] - 1 + (k & 3);
        const uint32_t n = block_map_find(map, x >> 3, y >> 3, z >> 3);
        if (n != BLOCK_MAP_NONE &&
            r->limited[SIDE * (size_t)n + (size_t)(x & 7)] >> (8 * (y & 7) + (z & 7)) & 1)
            return true;
    }
    return false;
}

void ringing_free(ringing_limits *r)
{
    free(r->limited);
    *r = (ringing_limits){0};
}
