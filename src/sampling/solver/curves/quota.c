// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/curves/quota.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/cell_list.h"
#include "geometry/space/packing.h"
#include "sampling/solver/particles/population.h"

/* Fixed-point iterations for the spacing: curve samples cover area, so that h grows and the samples become
 * fewer. */
enum { PASSES = 4 };
/* Maximum number of passes that remove patches without free cells from the distribution; each pass removes
 * at least one. */
enum { MAX_REMOVAL_PASSES = 20 };
/* Maximum fraction of the points that are curve samples. The other points are left for the patches. */
static const double MAX_SAMPLES = 0.9;
/* A patch of fewer cells than this gets no more free cells than its area, even if its border term is
 * negative. */
static const double MIN_CELLS = 0.5;
/* Maximum fraction of the points that small patches get. Beyond it, all patches are served in proportion
 * to their area. */
static const double MAX_SMALL_PATCHES = 0.25;
/* A small patch within this distance of a point gets no point of its own, in spacings. Smaller: over-dense
 * points. */
static const double COVERED_DISTANCE = 0.6;

/* The object that messages about memory name. */
static const char *const WHAT = "the particles of each patch";

/* Fraction of the points that a patch gets by its area, weighted by the sizing field. */
static double share_of(const quota_input *in, size_t patch)
{
    return surface_part_share(in->scan, sizing_field_weight(in->sizing, in->scan), patch);
}

static bool make_samples(const quota_input *in, double spacing, size_t most, curve_samples *out, error *e)
{
    const boundary_request request = {spacing, in->sizing, in->even, most};
    curve_samples_free(out);
    return threads_may_go_on(in->pool, e) && curve_samples_make(in->field, &request, out, e);
}

/* Voronoi cells of a patch that its curve samples do not cover, if the surface has `cells` cells. Negative:
 * the samples cover more than the patch. */
static double free_cells(const quota_input *in, const curve_samples *samples, size_t patch, double cells)
{
    const double all = share_of(in, patch) * cells, border = samples->border[patch];
    return all - (all < MIN_CELLS ? fmax(border, 0) : border);
}

/* Sum of the positive free cells of all patches. */
static double sum_of_free_cells(const quota_input *in, const curve_samples *samples, double cells)
{
    double sum = 0;
    for (size_t k = 0; k < in->field->patches->count; k++) sum += fmax(free_cells(in, samples, k, cells), 0);
    return sum;
}

/* How the free particles of a patch are determined: in proportion to its free cells, or as a small patch. */
enum { PROPORTIONAL, ONE_POINT, NO_POINT };

/* Number of cells of the surface for which the free cells of the proportional patches sum to `count`. The
 * excess of a patch whose samples cover more than its area is not transferred to other patches. */
static double cells_for(const quota_input *in, const curve_samples *samples, const unsigned char *rule,
                        double count)
{
    double cells = INFINITY, share = 0, border = 0;
    for (size_t k = 0; k < in->field->patches->count; k++) {
        if (rule[k] != PROPORTIONAL) continue;
        share += share_of(in, k);
        border += fmax(samples->border[k], 0); /* an upper bound, since `cells` only decreases */
    }
    if (!(share > 0)) return count;
    for (int pass = 0; pass < MAX_REMOVAL_PASSES && share > 0 && count + fmax(border, 0) < cells * share;
         pass++) {
        cells = (count + fmax(border, 0)) / share;
        share = border = 0;
        for (size_t k = 0; k < in->field->patches->count; k++) {
            const double own = free_cells(in, samples, k, cells), part = share_of(in, k);
            if (rule[k] != PROPORTIONAL || !(own > 0)) continue;
            share += part;
            border += part * cells - own;
        }
    }
    return cells;
}

/* A small patch: it has no curve sample and less than one free cell. */
typedef struct small_patch {
    double cells;
    double reach; /* a point within this distance of its position covers it */
    uint32_t patch;
} small_patch;

static int compare_small_patches(const void *left, const void *right)
{
    const small_patch *a = left, *b = right;
    if (a->cells != b->cells) return a->cells < b->cells ? 1 : -1;
    return (a->patch > b->patch) - (a->patch < b->patch);
}

/* Small patches, descending by free cells; NULL on failure. */
static small_patch *list_small_patches(const quota_input *in, const curve_samples *samples, double cells,
                                       size_t *count, error *e)
{
    const size_t patches = in->field->patches->count;
    small_patch *list = mem_array(patches, sizeof *list, WHAT, e);
    bool *has_sample = mem_array(patches, sizeof *has_sample, WHAT, e);
    *count = 0;
    for (size_t k = 0; has_sample && k < samples->copies; k++) has_sample[samples->patch[k]] = true;
    for (uint32_t k = 0; list && has_sample && k < patches; k++) {
        const double own = free_cells(in, samples, k, cells);
        if (!has_sample[k] && own > 0 && own < 1) list[(*count)++] = (small_patch){own, 0, k};
    }
    if (!has_sample) {
        free(list);
        list = NULL;
    }
    free(has_sample);
    if (list && *count > 0) qsort(list, *count, sizeof *list, compare_small_patches);
    return list;
}

/* A position on a patch: the middle of its first grid cell. */
static vec3 position_on(const quota_input *in, uint32_t patch)
{
    field_cell cell;
    vec3 sum = {0, 0, 0};
    surface_cell(in->scan, in->scan->parts.begin[patch], &cell);
    for (int k = 0; k < FIELD_CELL_CORNERS; k++) sum = vec3_axpy(0.125, cell.corner[k], sum);
    return sum;
}

/* A small patch that gets a point, and the others. */
typedef struct covering {
    const small_patch *list;
    const vec3 *position; /* per small patch */
    vec3 point;
    unsigned char *rule;
} covering;

/* A small patch without a point gets none if the new point covers it. */
static void cover(void *context, uint32_t k)
{
    const covering *c = context;
    const small_patch *other = &c->list[k];
    if (c->rule[other->patch] == PROPORTIONAL &&
        vec3_norm2(vec3_sub(c->position[k], c->point)) <= other->reach * other->reach)
        c->rule[other->patch] = NO_POINT;
}

/* Sets the rule of the small patches in their order until `most` have a point; returns the number of these. The work is
 * bounded by it, however many of the patches lie within a spacing. */
static size_t serve(covering *c, size_t found, const cell_list *samples, const cell_list *patches,
                    size_t most)
{
    double longest = 0, distance;
    size_t served = 0;
    for (size_t k = 0; k < found; k++) longest = fmax(longest, c->list[k].reach);
    for (size_t k = 0; k < found && served <= most; k++) {
        const small_patch *own = &c->list[k];
        if (c->rule[own->patch] == NO_POINT) continue;
        c->point = c->position[k];
        if (samples) cell_list_nearest(samples, c->point, own->reach, &distance);
        c->rule[own->patch] = samples && distance <= own->reach ? NO_POINT : ONE_POINT;
        if (c->rule[own->patch] == NO_POINT) continue;
        served++;
        cell_list_within(patches, c->point, longest, cover, c);
    }
    return served;
}

/* Sets `rule` of each patch. A small patch gets one point, unless a curve sample or a larger small patch is
 * near. If these points exceed MAX_SMALL_PATCHES of `count`, all patches are proportional. *served: the
 * number of patches with one point. */
static bool assign_small_patches(const quota_input *in, const curve_samples *samples, double spacing,
                                 double cells, size_t count, unsigned char *rule, size_t *served, error *e)
{
    const boundary_request request = {spacing, in->sizing, in->even, 0};
    const size_t most = (size_t)(MAX_SMALL_PATCHES * (double)count);
    size_t found;
    small_patch *list = list_small_patches(in, samples, cells, &found, e);
    vec3 *position = mem_array(found, sizeof *position, WHAT, e);
    cell_list *of_samples = NULL, *of_patches = NULL;
    *served = 0;
    memset(rule, PROPORTIONAL, in->field->patches->count);
    bool ok = list && position;
    if (ok && found > 0) {
        for (size_t k = 0; k < found; k++) {
            position[k] = position_on(in, list[k].patch);
            list[k].reach = COVERED_DISTANCE * boundary_spacing(&request, position[k]);
        }
        if (samples->count > 0) of_samples = cell_list_new(samples->position, samples->count, NULL, e);
        of_patches = cell_list_new(position, found, NULL, e);
        ok = of_patches && (samples->count == 0 || of_samples);
    }
    if (ok && found > 0)
        *served = serve(&(covering){list, position, {0, 0, 0}, rule}, found, of_samples, of_patches, most);
    if (*served > most) {
        memset(rule, PROPORTIONAL, in->field->patches->count);
        *served = 0;
    }
    cell_list_free(of_samples);
    cell_list_free(of_patches);
    free(position);
    free(list);
    return ok;
}

/* Distributes `count` free particles: one for each patch with ONE_POINT. The proportional patches get the
 * others in proportion to their free cells, rounded to within one. */
static bool distribute(const quota_input *in, double cells, const unsigned char *rule, size_t count,
                       quota *out, error *e)
{
    size_t patches = in->field->patches->count;
    out->free = mem_array(patches, sizeof *out->free, WHAT, e);
    double *weight = mem_array(patches, sizeof *weight, WHAT, e), sum = 0, partial_sum = 0;
    bool ok = out->free && weight;
    for (size_t k = 0; ok && k < patches; k++) {
        weight[k] = rule[k] == PROPORTIONAL ? fmax(free_cells(in, &out->samples, k, cells), 0) : 0;
        out->free[k] = rule[k] == ONE_POINT;
        count -= rule[k] == ONE_POINT;
        sum += weight[k];
    }
    for (size_t k = 0; ok && !(sum > 0) && k < patches; k++) weight[k] = share_of(in, k);
    if (!(sum > 0)) sum = 1;
    for (size_t k = 0; ok && k < patches; k++) { /* differences of rounded partial sums: the total is exact */
        double before = round(partial_sum);
        partial_sum = k + 1 < patches ? partial_sum + weight[k] * ((double)count / sum) : (double)count;
        out->free[k] += (uint32_t)fmax(round(partial_sum) - before, 0);
        out->free_count += out->free[k];
    }
    free(weight);
    return ok;
}

bool quota_for_count(const quota_input *in, size_t count, quota *out, error *e)
{
    double cells = (double)count;
    size_t most = (size_t)(MAX_SAMPLES * (double)count), served = 0;
    unsigned char *rule = mem_array(in->field->patches->count, 1, WHAT, e);
    *out = (quota){0};
    bool ok = rule != NULL;
    if (ok && in->without_samples) {
        out->spacing = packing_spacing(in->scan->area, cells);
        out->samples.border = mem_array(in->field->patches->count, sizeof *out->samples.border, WHAT, e);
        ok = out->samples.border != NULL;
    }
    for (int pass = 0; ok && !in->without_samples && pass < PASSES; pass++) {
        const double spacing = packing_spacing(in->scan->area, cells);
        if (pass > 0 && spacing == out->spacing) break; /* the fixed point */
        out->spacing = spacing;
        ok = make_samples(in, out->spacing, most, &out->samples, e) &&
             assign_small_patches(in, &out->samples, out->spacing, cells, count - out->samples.count, rule,
                                  &served, e);
        if (ok) cells = cells_for(in, &out->samples, rule, (double)(count - out->samples.count - served));
    }
    ok = ok && distribute(in, cells, rule, count - out->samples.count, out, e);
    free(rule);
    return ok;
}

bool quota_for_spacing(const quota_input *in, double spacing, size_t most, quota *out, error *e)
{
    double cells = packing_count(in->scan->area, spacing);
    size_t served = 0, count;
    unsigned char *rule = mem_array(in->field->patches->count, 1, WHAT, e);
    *out = (quota){.spacing = spacing};
    bool ok = rule && make_samples(in, spacing, most, &out->samples, e);
    if (ok) {
        count = (size_t)round(sum_of_free_cells(in, &out->samples, cells));
        ok = assign_small_patches(in, &out->samples, spacing, cells, count, rule, &served, e) &&
             distribute(in, cells, rule, count + served, out, e);
    }
    free(rule);
    return ok;
}

void quota_free(quota *q)
{
    curve_samples_free(&q->samples);
    free(q->free);
    *q = (quota){0};
}

void quota_add_samples(const quota *q, particles *p)
{
    const curve_samples *r = &q->samples;
    for (size_t k = 0; k < r->copies; k++) {
        size_t i = p->count++;
        p->position[i] = r->position[r->place[k]];
        p->normal[i] = r->normal[k];
        p->patch[i] = r->patch[k];
        p->place[i] = r->place[k];
        p->hint[i] = FIELD_NO_HINT;
        p->lambda[i] = 0;
    }
}

bool quota_replace_samples(const quota *q, particles *p, error *e)
{
    bool *removed = mem_array(p->count, sizeof *removed, WHAT, e);
    if (!removed) return false;
    for (size_t i = 0; i < p->count; i++) removed[i] = particles_is_fixed(p, i);
    population_remove(p, removed);
    free(removed);
    quota_add_samples(q, p);
    return true;
}
