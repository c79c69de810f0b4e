#include "sampler/levels.h"

#include <math.h>
#include <stdlib.h>

#include "base/rng.h"
#include "packing/packing.h"
#include "sampler/random_streams.h"
#include "sampler/refine.h"

/* The coarsest packing sets the order of the finest, at a cost that does not show, unless its spacing is
 * coarser than this fraction of the radius of curvature, where strain is locked in. Measured at 10 000
 * points: half of the fraction costs 0.01 of hex_fraction on torus and quartic, twice as much 0.006 on the
 * gyroid. */
static const double COARSEST_BEND = 0.6;
enum { FEWEST_PARTICLES = 100, BEND_SAMPLES = 400 };
/* Of each connected part that is to have any: refining keeps the parts' shares as they are on the coarsest
 * level, where they are off by half a particle, and gives nothing to a part that has none. */
static const double FEWEST_IN_PART = 30;
/* Of those samples, the one that counts: what is bent more, such as the creases and the noise of a scan, is
 * bent for any packing. */
static const double BEND_QUANTILE = 0.5;

static int compare_double(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* What must be small times the spacing h of an even packing: the larger principal curvature and the growth of
 * the spacing, both for the spacing at the place, as half of the particles have it. */
static double typical_bend(const field *f, const surface *scan, const sizing_field *sizing, double h,
                           uint64_t seed)
{
    rng r = rng_seed(seed, RANDOM_STREAM_BEND);
    double bend[BEND_SAMPLES];
    size_t found = 0;
    for (int k = 0; k < BEND_SAMPLES; k++) {
        field_sample sample;
        double kappa1, kappa2;
        vec3 x = sizing_field_draw(sizing, scan, (k + 0.5) / BEND_SAMPLES, &r), growth = {0, 0, 0};
        double size = sizing ? sizing_field_spacing(sizing, x, &growth) / h : 1;
        if (!field_sample_at(f, x, FIELD_HESSIAN, &sample)) continue;
        field_curvature(&sample, &kappa1, &kappa2);
        bend[found++] = fmax(size * fmax(fabs(kappa1), fabs(kappa2)), vec3_norm(growth) / h);
    }
    if (found == 0) return INFINITY;
    qsort(bend, found, sizeof *bend, compare_double);
    return bend[(size_t)(BEND_QUANTILE * (double)(found - 1))];
}

/* The share of the smallest part that is to have a particle at all. */
static double smallest_part(const surface *scan, const double *weight, size_t count)
{
    const components *parts = &scan->parts;
    double whole = weight[scan->cells], smallest = whole;
    for (size_t c = 0; parts->order && c < parts->count; c++) {
        double part = weight[parts->begin[c + 1]] - weight[parts->begin[c]];
        if (part * (double)count >= whole) smallest = fmin(smallest, part);
    }
    return smallest / whole;
}

int levels_plan(const field *f, const surface *scan, const sizing_field *sizing, size_t count, uint64_t seed,
                size_t out[LEVELS_MAX])
{
    size_t finest_first[LEVELS_MAX] = {count};
    double coarsest =
        COARSEST_BEND / typical_bend(f, scan, sizing, packing_spacing(scan->area, (double)count), seed);
    double smallest = smallest_part(scan, sizing_field_weight(sizing, scan), count);
    int levels = 1;
    while (levels < LEVELS_MAX) {
        size_t next = refine_coarser(finest_first[levels - 1]);
        if (next < FEWEST_PARTICLES || packing_spacing(scan->area, (double)next) > coarsest) break;
        if ((double)next * smallest < FEWEST_IN_PART) break;
        finest_first[levels++] = next;
    }
    for (int k = 0; k < levels; k++) out[k] = finest_first[levels - 1 - k];
    return levels;
}

void levels_correct(size_t plan[LEVELS_MAX], int levels, size_t edges, size_t on_boundary)
{
    const double coarsest = (double)plan[0], missing = 3 * coarsest - (double)edges - (double)on_boundary;
    for (int k = levels - 2; k >= 0; k--) {
        double finer = (double)plan[k + 1], count = finer / 4;
        for (int step = 0; step < 3; step++) /* the boundary's share depends a little on the count */
            count = (finer + missing + (double)on_boundary * sqrt(fmax(count, 1) / coarsest)) / 4;
        count = ceil(count);
        /* a packing that does not resolve its surface has no count of edges to go by */
        plan[k] = (size_t)fmin(fmax(count, finer / 5), finer / 3);
    }
}
