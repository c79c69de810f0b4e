// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/level_plan.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/rng.h"
#include "geometry/space/packing.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/passes/refine.h"

/* Maximum spacing of the coarsest level times the typical curvature. Larger: strain remains on the finer
 * levels (0.006 of hex_fraction on the gyroid at 10 000 points if doubled). Smaller: less order (0.01 on
 * torus and quartic if halved). */
static const double MAX_SPACING_CURVATURE = 0.6;
/* Factor on that limit for the only coarser level. It is a better start than random positions: hex_fraction
 * 0.90 instead of 0.87 on a scan of a statue with 50 000 points. */
static const double SINGLE_LEVEL_FACTOR = 2;
/* Minimum number of particles of a level. */
enum { MIN_PARTICLES = 100 };
/* Number of curvature samples. */
enum { CURVATURE_SAMPLES = 400 };
/* Sampling step of the curves for curve_distance over the finest spacing. */
static const double CURVE_STEP = 0.25;
/* Minimum number of particles of a connected part on its first level. Refinement keeps the parts' fractions
 * of the particles, which are accurate to half a particle there. */
static const double MIN_IN_PART = 30;
/* Minimum fraction of all points in the parts that have particles on the coarsest level. */
static const double MIN_COARSEST_SHARE = 0.5;
/* Quantile of the curvature samples that is the typical curvature. Larger curvatures, such as edges and the
 * noise of a scan, are not resolved by any level. */
static const double CURVATURE_QUANTILE = 0.5;

/* Factor of the count by one refinement: each edge of a triangulation, about three for each particle, gets
 * a particle. */
static const double REFINEMENT = 4;
/* With given particles: a ratio above a power of four by less than this power of four takes no further level
 * (4.6 instead of 4). Some edges get two particles then. */
static const double RATIO_SLACK = 0.1;

/* Typical maximum of the larger principal curvature and the gradient of the spacing over h. Both are scaled
 * by the requested spacing over the spacing h of a uniform packing. 1 / length. */
static double typical_curvature(const field *f, const surface *scan, const sizing_field *sizing, double h,
                                uint64_t seed)
{
    rng r = rng_seed(seed, RANDOM_STREAM_CURVATURE);
    double curvature[CURVATURE_SAMPLES];
    size_t found = 0;
    for (int k = 0; k < CURVATURE_SAMPLES; k++) {
        field_sample sample;
        double kappa1, kappa2;
        vec3 x = sizing_field_draw(sizing, scan, (k + 0.5) / CURVATURE_SAMPLES, &r, NULL), growth = {0, 0, 0};
        double size = sizing ? sizing_field_spacing(sizing, x, &growth) / h : 1;
        if (!field_sample_at(f, x, FIELD_HESSIAN, &sample)) continue;
        field_curvature(&sample, &kappa1, &kappa2);
        curvature[found++] = fmax(size * fmax(fabs(kappa1), fabs(kappa2)), vec3_norm(growth) / h);
    }
    if (found == 0) return INFINITY;
    qsort(curvature, found, sizeof *curvature, compare_doubles);
    return curvature[(size_t)(CURVATURE_QUANTILE * (double)(found - 1))];
}

/* Fraction of all points in the parts that get at least MIN_IN_PART of `count` particles. `together` (all
 * parts start on one level): 1 if this holds for each part that has a particle among `all`; otherwise 0. */
static double started_share(const surface *scan, const double *weight, size_t count, bool together,
                            size_t all)
{
    double share = 0;
    if (!scan->parts.begin) return (double)count < MIN_IN_PART ? 0 : 1;
    for (size_t c = 0; c < scan->parts.count; c++) {
        double part = surface_part_share(scan, weight, c);
        if (part * (double)count >= MIN_IN_PART)
            share += part;
        else if (together && part * (double)all >= 1)
            return 0;
    }
    return together ? 1 : share;
}

/* The level on which a part gets its first particles. `whole`: particles of each level if all parts had
 * particles. */
static int level_of_part(double share, const size_t whole[], int count)
{
    int level = 0;
    while (level < count - 1 && share * (double)whole[level] < MIN_IN_PART) level++;
    return level;
}

/* Sorts the parts by level and computes the numbers of particles. */
static bool assign_parts(level_plan *l, const surface *scan, const double *weight, error *e)
{
    const char *what = "the levels";
    size_t parts = scan->parts.count, whole[LEVEL_PLAN_MAX], next[LEVEL_PLAN_MAX] = {0};
    int *level = mem_array(parts, sizeof *level, what, e);
    l->part = mem_array(parts, sizeof *l->part, what, e);
    l->before = mem_array(parts + 1, sizeof *l->before, what, e);
    l->place = mem_array(parts, sizeof *l->place, what, e);
    bool ok = level && l->part && l->before && l->place;
    memcpy(whole, l->particles, sizeof whole);
    for (size_t c = 0; ok && c < parts; c++) {
        level[c] = level_of_part(surface_part_share(scan, weight, c), whole, l->count);
        l->first[level[c] + 1]++;
    }
    for (int k = 0; k < l->count; k++) {
        l->first[k + 1] += l->first[k];
        next[k] = l->first[k];
    }
    for (uint32_t c = 0; ok && c < parts; c++) l->part[next[level[c]]++] = c;
    for (size_t i = 0; ok && i < parts; i++) {
        l->before[i + 1] = l->before[i] + surface_part_share(scan, weight, l->part[i]);
        l->place[i] = weight[scan->parts.begin[l->part[i]]] / weight[scan->cells];
    }
    for (int k = 0; ok && k < l->count; k++) {
        double begin = l->before[l->first[k]], end = l->before[l->first[k + 1]];
        if (k < l->count - 1) l->particles[k] = (size_t)round(end * (double)whole[k]);
        l->new_parts[k] = k > 0 ? (size_t)round((end - begin) * (double)whole[k]) : 0;
    }
    free(level);
    return ok;
}

/* Levels from given particles on, in equal ratios. */
static void plan_from_given(const solver_params *params, level_plan *l)
{
    const double ratio = (double)params->count / (double)params->given_count,
                 steps = fmin(fmax(ceil(elementary_log(ratio) / elementary_log(REFINEMENT) - RATIO_SLACK), 1),
                              LEVEL_PLAN_MAX - 1);
    if (params->given_count >= params->count) return;
    l->count = (int)steps + 1;
    for (int k = 0; k < l->count - 1; k++)
        l->particles[k] = (size_t)round((double)params->given_count * elementary_pow(ratio, k / steps));
    l->particles[l->count - 1] = params->count;
}

/* Quotas of the levels from given particles on. The levels end before one with more curve samples than
 * free particles. */
static bool plan_patches_from_given(const quota_input *in, const solver_params *params, level_plan *l,
                                    quota *found, error *e)
{
    plan_from_given(params, l);
    const int levels = l->count;
    l->count = 1;
    for (int k = levels - 2; k >= 0; k--) {
        quota *next = &found[l->count];
        const bool ok = quota_for_count(in, l->particles[k], next, e);
        if (!ok || next->free_count < next->samples.count) {
            quota_free(next);
            return ok;
        }
        l->quotas[l->count++] = *next; /* ownership: level_plan_free */
    }
    return true;
}

/* With patches each coarser level has twice the spacing, so that its curves have half as many samples. A
 * level with more curve samples than free particles is not used. If the finest level omits the samples, which
 * are too many for it, there is no coarser level: it would have more samples than free particles. */
static bool plan_patches(const field *f, const surface *scan, const solver_params *params,
                         const threads *pool, level_plan *l, error *e)
{
    double even = packing_spacing(scan->area, (double)params->count), least = 1;
    const quota_input in = {f, scan, params->sizing, even, params->blue_noise, pool};
    quota found[LEVEL_PLAN_MAX] = {{0}}; /* finest first */
    if (params->sizing) least = sizing_field_describe(params->sizing).least / even;
    l->quotas = mem_array(LEVEL_PLAN_MAX, sizeof *l->quotas, "the levels", e);
    if (!l->quotas || !quota_for_count(&in, params->count, &l->quotas[0], e)) return false;
    found[0] = l->quotas[0];
    l->curves = curve_distance_new(f->patches, false, CURVE_STEP * least * found[0].spacing, pool, e);
    if (!l->curves) return false;
    double limit = MAX_SPACING_CURVATURE / typical_curvature(f, scan, params->sizing, even, params->seed);
    const bool is_given = params->start == SOLVER_START_COARSEST;
    bool coarser = params->coarse_to_fine && params->start != SOLVER_START_GIVEN && !is_given &&
                   !found[0].samples.omitted;
    if (is_given && !plan_patches_from_given(&in, params, l, found, e)) return false;
    while (coarser && l->count < LEVEL_PLAN_MAX) {
        quota *next = &found[l->count];
        double spacing = 2 * found[l->count - 1].spacing;
        if (spacing > (l->count == 1 ? SINGLE_LEVEL_FACTOR : 1) * limit) break;
        if (!quota_for_spacing(&in, spacing, params->count, next, e)) {
            quota_free(next);
            return false;
        }
        if (quota_points(next) < MIN_PARTICLES || next->free_count < next->samples.count) {
            quota_free(next);
            break;
        }
        l->quotas[l->count++] = *next; /* ownership: level_plan_free */
    }
    for (int k = 0; k < l->count; k++) {
        l->quotas[k] = found[l->count - 1 - k];
        l->particles[k] = quota_points(&l->quotas[k]);
    }
    return true;
}

bool level_plan_make(const field *f, const surface *scan, const solver_params *params, const threads *pool,
                     level_plan *out, error *e)
{
    const double *weight = sizing_field_weight(params->sizing, scan);
    bool together = params->start != SOLVER_START_SURFACE || f->open;
    *out = (level_plan){.count = 1, .particles = {params->count}};
    if (f->patches) return plan_patches(f, scan, params, pool, out, e);
    if (!params->coarse_to_fine || params->start == SOLVER_START_GIVEN) return true;
    if (params->start == SOLVER_START_COARSEST) {
        plan_from_given(params, out);
        return true;
    }
    double even = packing_spacing(scan->area, (double)params->count);
    double coarsest = MAX_SPACING_CURVATURE / typical_curvature(f, scan, params->sizing, even, params->seed);
    size_t finest_first[LEVEL_PLAN_MAX] = {params->count};
    while (out->count < LEVEL_PLAN_MAX) {
        size_t next = refine_coarser(finest_first[out->count - 1]);
        double limit = out->count == 1 ? SINGLE_LEVEL_FACTOR * coarsest : coarsest;
        if (next < MIN_PARTICLES || packing_spacing(scan->area, (double)next) > limit) break;
        if (started_share(scan, weight, next, together, params->count) < MIN_COARSEST_SHARE) break;
        finest_first[out->count++] = next;
    }
    for (int k = 0; k < out->count; k++) out->particles[k] = finest_first[out->count - 1 - k];
    return together || !scan->parts.begin || out->count == 1 || assign_parts(out, scan, weight, e);
}

void level_plan_free(level_plan *l)
{
    free(l->part);
    free(l->before);
    free(l->place);
    for (int k = 0; l->quotas && k < LEVEL_PLAN_MAX; k++) quota_free(&l->quotas[k]);
    free(l->quotas);
    curve_distance_free(l->curves);
}

size_t level_plan_capacity(const level_plan *l)
{
    size_t most = level_plan_particles(l, 0);
    for (int k = 1; k < l->count; k++) { /* refinement starts with the curve samples of the coarser level */
        size_t count = level_plan_particles(l, k),
               before = l->quotas ? l->quotas[k].free_count + l->quotas[k - 1].samples.copies : 0;
        most = count > most ? count : most;
        most = before > most ? before : most;
    }
    return most;
}

void level_plan_correct(level_plan *l, size_t edges, size_t on_boundary)
{
    const double coarsest = (double)l->particles[0],
                 missing = 3 * coarsest - (double)edges - (double)on_boundary;
    for (int k = l->count - 2; k >= 0; k--) {
        double finer = (double)(l->particles[k + 1] - l->new_parts[k + 1]), count = finer / REFINEMENT;
        /* fixed point: the number of boundary particles depends on the count */
        for (int step = 0; step < 3; step++)
            count = (finer + missing + (double)on_boundary * sqrt(fmax(count, 1) / coarsest)) / REFINEMENT;
        count = ceil(count);
        /* bounds: the number of edges is meaningless if the packing does not resolve the surface */
        l->particles[k] = (size_t)fmin(fmax(count, finer / (REFINEMENT + 1)), finer / (REFINEMENT - 1));
    }
}

void level_plan_drop_coarsest(level_plan *l)
{
    assert(l->count > 1);
    l->count--;
    memmove(l->particles, l->particles + 1, (size_t)l->count * sizeof *l->particles);
    memmove(l->new_parts, l->new_parts + 1, (size_t)l->count * sizeof *l->new_parts);
    memmove(l->first + 1, l->first + 2, (size_t)l->count * sizeof *l->first);
    l->new_parts[0] = 0;
    if (!l->quotas) return;
    quota_free(&l->quotas[0]);
    memmove(l->quotas, l->quotas + 1, (size_t)l->count * sizeof *l->quotas);
    l->quotas[l->count] = (quota){0};
}

double level_plan_share(const level_plan *l, int level)
{
    return l->part ? l->before[l->first[level + 1]] : 1;
}

double level_plan_place(const level_plan *l, int level, double where)
{
    if (!l->part) return where;
    size_t low = l->first[level], high = l->first[level + 1];
    double at = l->before[low] + where * (l->before[high] - l->before[low]);
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (l->before[middle] <= at)
            low = middle;
        else
            high = middle;
    }
    return l->place[low] + (at - l->before[low]);
}
