// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/curves/curve_samples.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "sampling/solver/curves/near_curves.h"

/* Integration step of the arc length with a sizing field, in local spacings. Smaller: more accurate,
 * slower. */
static const double SIZING_STEP = 0.25;
/* Minimum length of a curve with distinct end samples, in spacings. A shorter curve has one sample for
 * both corners. */
static const double MIN_LENGTH = 0.5;
/* Factor on the spacing beyond the proportional correction if there are too many samples: covers the
 * rounding per curve. */
static const double SPACING_MARGIN = 1.02;
/* Maximum factor on the requested spacing if near samples are merged. Larger: gaps between the samples along
 * edges, and few points for the patches. */
static const double MAX_STRETCH = 1.5;
/* Maximum number of corrections of the spacing. */
enum { MAX_CORRECTIONS = 12 };
/* Offset from a curve at which the two normals of a patch that meets itself are taken, in spacings: near
 * enough to be the normals at the curve, large compared with rounding errors. */
static const double NORMAL_OFFSET = 0.05;
/* Newton steps that project a sample onto both surfaces of a curve. The start is close; convergence is
 * quadratic. */
enum { NEWTON_STEPS = 6 };

/* The object that messages about memory name. */
static const char *const WHAT = "the samples along curves";

/* One end of an open curve. */
typedef struct end {
    vec3 at;
    uint32_t curve, corner, merge_target; /* merge_target: merge_target[corner] of the layout */
} end;

typedef struct layout {
    const field_patches *patches;
    boundary_request request;
    double *length; /* per curve, in spacings */
    end *ends;      /* sorted by corner by measure_curves, by merge_target by find_merge_targets */
    size_t end_count;
    size_t corner_count;
    bool *merged; /* per corner: it has no sample of its own */
    /* Per corner: the corner whose sample represents it. A corner with a sample: itself. Otherwise: the far
     * end of its shortest curve among those that lead to a corner with a sample. */
    uint32_t *merge_target;
    uint32_t *corner[2]; /* per curve: the corners at its start and at its end */
    vec3 *point;         /* the current curve, subdivided */
    double *at;          /* per point of it: arc length up to there, in spacings */
    size_t point_capacity, arc_capacity, point_count;
    size_t capacity[6];      /* of the arrays of the result and of `half` */
    double *half;            /* per copy: its contribution to the border of its patch */
    uint32_t *corner_sample; /* per corner with a sample: that sample */
    size_t *first_sample;    /* per curve and one more: its first sample */
} layout;

static int compare_ends(const void *a, const void *b)
{
    const end *x = a, *y = b;
    int order = vec3_compare(x->at, y->at);
    return order ? order : (x->curve > y->curve) - (x->curve < y->curve);
}

/* Numbers the corners. Ends with bitwise equal positions are one corner. */
static bool find_corners(layout *l, error *e)
{
    const field_patches *p = l->patches;
    l->ends = mem_array(2 * p->curve_count, sizeof *l->ends, WHAT, e);
    for (int k = 0; k < 2; k++) l->corner[k] = mem_array(p->curve_count, sizeof *l->corner[k], WHAT, e);
    if (!l->ends || !l->corner[0] || !l->corner[1]) return false;
    for (uint32_t c = 0; c < p->curve_count; c++) {
        const field_curve *curve = &p->curve[c];
        if (curve->closed) continue;
        l->ends[l->end_count++] = (end){.at = p->vertex[curve->first], .curve = 2 * c};
        l->ends[l->end_count++] = (end){.at = p->vertex[curve->first + curve->count - 1], .curve = 2 * c + 1};
    }
    if (l->end_count > 0) qsort(l->ends, l->end_count, sizeof *l->ends, compare_ends);
    for (size_t k = 0; k < l->end_count; k++) {
        if (k == 0 || vec3_compare(l->ends[k].at, l->ends[k - 1].at) != 0) l->corner_count++;
        l->ends[k].corner = (uint32_t)(l->corner_count - 1);
        l->corner[l->ends[k].curve % 2][l->ends[k].curve / 2] = l->ends[k].corner;
        l->ends[k].curve /= 2;
    }
    l->merged = mem_array(l->corner_count, sizeof *l->merged, WHAT, e);
    l->merge_target = mem_array(l->corner_count, sizeof *l->merge_target, WHAT, e);
    return l->merged && l->merge_target;
}

static bool add_point(layout *l, vec3 x, double at, error *e)
{
    if (!MEM_GROW(l->point, l->point_count, &l->point_capacity, WHAT, e)) return false;
    if (!MEM_GROW(l->at, l->point_count, &l->arc_capacity, WHAT, e)) return false;
    l->point[l->point_count] = x;
    l->at[l->point_count++] = at;
    return true;
}

/* Sets point, at and point_count to the points of a curve and the arc length up to each, in spacings. With a
 * sizing field, segments are subdivided. */
static bool trace_curve(layout *l, const field_curve *c, error *e)
{
    const vec3 *vertex = l->patches->vertex + c->first;
    double at = 0;
    l->point_count = 0;
    if (!add_point(l, vertex[0], 0, e)) return false;
    for (size_t k = 1; k < c->count + c->closed; k++) {
        vec3 from = vertex[k - 1], side = vec3_sub(vertex[k % c->count], from);
        double length = vec3_norm(side), spacing = boundary_spacing(&l->request, from);
        size_t parts = l->request.sizing ? (size_t)fmin(1 + length / (SIZING_STEP * spacing), 1e6) : 1;
        for (size_t m = 1; m <= parts; m++) {
            vec3 middle = vec3_axpy(((double)m - 0.5) / (double)parts, side, from);
            at += length / (double)parts / boundary_spacing(&l->request, middle);
            if (!add_point(l, vec3_axpy((double)m / (double)parts, side, from), at, e)) return false;
        }
    }
    return true;
}

/* Number of steps along curve c. A closed curve never has two: a patch would then have two edges between the
 * same two samples. */
static double step_count(const layout *l, size_t c)
{
    double steps = round(l->length[c]);
    if (l->patches->curve[c].closed) return steps == 2 ? (l->length[c] < 2 ? 1 : 3) : steps;
    return l->length[c] < MIN_LENGTH ? steps : fmax(steps, 1);
}

/* Number of samples of curve c without its corners. */
static double inner_samples(const layout *l, size_t c)
{
    return l->patches->curve[c].closed ? step_count(l, c) : fmax(step_count(l, c) - 1, 0);
}

static bool is_short(const layout *l, size_t c)
{
    return !l->patches->curve[c].closed && l->length[c] < MIN_LENGTH;
}

/* Merges each corner that a short curve connects to an unmerged corner of a lower number. */
static void merge_corners(layout *l)
{
    memset(l->merged, 0, l->corner_count * sizeof *l->merged);
    for (size_t k = 0; k < l->end_count; k++) { /* ascending by corner */
        const uint32_t own = l->ends[k].corner, c = l->ends[k].curve;
        const uint32_t other = l->corner[l->corner[0][c] == own][c];
        if (is_short(l, c) && other < own && !l->merged[other]) l->merged[own] = true;
    }
}

/* Computes the lengths of the curves and which corners are merged, and sorts the ends by corner. *places: the
 * resulting number of samples. */
static bool measure_curves(layout *l, double *places, error *e)
{
    const field_patches *p = l->patches;
    *places = 0;
    if (l->end_count > 0) qsort(l->ends, l->end_count, sizeof *l->ends, compare_ends);
    for (size_t c = 0; c < p->curve_count; c++) {
        if (!trace_curve(l, &p->curve[c], e)) return false;
        l->length[c] = l->at[l->point_count - 1];
        *places += inner_samples(l, c);
    }
    merge_corners(l);
    for (size_t k = 0; k < l->corner_count; k++) *places += !l->merged[k];
    return true;
}

static int compare_targets(const void *a, const void *b)
{
    const end *x = a, *y = b;
    if (x->merge_target != y->merge_target) return x->merge_target > y->merge_target ? 1 : -1;
    if (x->corner != y->corner)
        return x->corner == x->merge_target   ? -1
               : y->corner == y->merge_target ? 1
               : x->corner > y->corner        ? 1
                                              : -1;
    return (x->curve > y->curve) - (x->curve < y->curve);
}

/* Computes `merge_target` and sorts the ends by it. */
static bool find_merge_targets(layout *l, error *e)
{
    double *shortest = mem_array(l->corner_count, sizeof *shortest, WHAT, e);
    if (!shortest) return false;
    for (uint32_t k = 0; k < l->corner_count; k++) {
        l->merge_target[k] = k;
        shortest[k] = INFINITY;
    }
    for (size_t c = 0; c < l->patches->curve_count; c++)
        for (int k = 0; k < 2 && is_short(l, c); k++) {
            const uint32_t own = l->corner[k][c], other = l->corner[1 - k][c];
            if (!l->merged[own] || l->merged[other] || !(l->length[c] < shortest[own])) continue;
            shortest[own] = l->length[c];
            l->merge_target[own] = other;
        }
    for (size_t k = 0; k < l->end_count; k++) l->ends[k].merge_target = l->merge_target[l->ends[k].corner];
    if (l->end_count > 0) qsort(l->ends, l->end_count, sizeof *l->ends, compare_targets);
    free(shortest);
    return true;
}

/* Projects x onto both zero sets of a curve by Newton steps of least norm. Returns the last iterate;
 * without surfaces: x. */
static vec3 project_on_both(const field_curve *c, vec3 x)
{
    if (!c->on[0] || !c->on[1]) return x;
    for (int k = 0; k < NEWTON_STEPS; k++) {
        field_sample f, g;
        if (!field_sample_at(c->on[0], x, FIELD_GRADIENT, &f) ||
            !field_sample_at(c->on[1], x, FIELD_GRADIENT, &g))
            return x;
        double ff = vec3_norm2(f.gradient), gg = vec3_norm2(g.gradient),
               fg = vec3_dot(f.gradient, g.gradient);
        double determinant = ff * gg - fg * fg;
        if (!(determinant > 0)) return x;
        double a = (f.value * gg - g.value * fg) / determinant,
               b = (g.value * ff - f.value * fg) / determinant;
        x = vec3_axpy(-a, f.gradient, vec3_axpy(-b, g.gradient, x));
    }
    return x;
}

/* Unit normal of a patch at x; (0, 0, 1) if the gradient vanishes or cannot be evaluated. */
static vec3 normal_at(const field *patch, vec3 x)
{
    field_sample s;
    if (!field_sample_at(patch, x, FIELD_GRADIENT, &s) || !(vec3_norm2(s.gradient) > 0))
        return (vec3){0, 0, 1};
    return vec3_unit(s.gradient);
}

/* Mean of a patch's normals on both sides of a curve along which it meets itself. `beside`: offset from
 * the curve. */
static vec3 mean_normal(const field *patch, vec3 x, vec3 along, double beside)
{
    vec3 n = normal_at(patch, x), across = vec3_cross(along, n);
    if (!(vec3_norm2(across) > 0)) return n;
    across = vec3_scale(vec3_unit(across), beside);
    vec3 sum = vec3_add(normal_at(patch, vec3_add(x, across)), normal_at(patch, vec3_sub(x, across)));
    return vec3_norm2(sum) > 0 ? vec3_unit(sum) : n;
}

/* Adds a copy of the last sample for a patch. If the sample has a copy for it already, only the
 * contribution `half` is added. */
static bool add_copy(layout *l, uint32_t patch, vec3 n, double half, curve_samples *out, error *e)
{
    uint32_t place = (uint32_t)(out->count - 1);
    for (size_t k = out->copies; k > 0 && out->place[k - 1] == place; k--)
        if (out->patch[k - 1] == patch) {
            l->half[k - 1] += half;
            return true;
        }
    if (!MEM_GROW(out->place, out->copies, &l->capacity[2], WHAT, e)) return false;
    if (!MEM_GROW(out->patch, out->copies, &l->capacity[3], WHAT, e)) return false;
    if (!MEM_GROW(out->normal, out->copies, &l->capacity[4], WHAT, e)) return false;
    if (!MEM_GROW(l->half, out->copies, &l->capacity[5], WHAT, e)) return false;
    l->half[out->copies] = half;
    out->place[out->copies] = place;
    out->patch[out->copies] = patch;
    out->normal[out->copies++] = n;
    return true;
}

static bool add_sample(layout *l, vec3 x, uint32_t curve, curve_samples *out, error *e)
{
    if (!MEM_GROW(out->position, out->count, &l->capacity[0], WHAT, e)) return false;
    if (!MEM_GROW(out->curve, out->count, &l->capacity[1], WHAT, e)) return false;
    out->position[out->count] = x;
    out->curve[out->count++] = curve;
    return true;
}

/* Adds copies of the last sample for all patches of a curve with direction `along`. `share`: the part of half
 * a Voronoi cell that the sample covers on each patch. */
static bool add_copies(layout *l, const field *f, const field_curve *c, vec3 along, double share,
                       curve_samples *out, error *e)
{
    const uint32_t *patches = l->patches->curve_patch + c->patch_first;
    vec3 x = out->position[out->count - 1];
    for (size_t k = 0; k < c->patch_count; k++) {
        const field *patch = field_of_patch(f, patches[k]);
        bool twice = false;
        for (size_t m = 0; m < c->patch_count; m++) twice |= m != k && patches[m] == patches[k];
        vec3 n = twice ? mean_normal(patch, x, along, NORMAL_OFFSET * boundary_spacing(&l->request, x))
                       : normal_at(patch, x);
        out->border[patches[k]] += 0.5 * share;
        if (!add_copy(l, patches[k], n, 0.5 * share, out, e)) return false;
    }
    return true;
}

/* Direction of a curve at one of its ends; the sign is arbitrary. */
static vec3 direction_at_end(const field_patches *p, const field_curve *c, vec3 corner)
{
    const vec3 *vertex = p->vertex + c->first;
    bool first = vec3_compare(vertex[0], corner) == 0;
    return first ? vec3_sub(vertex[1], vertex[0]) : vec3_sub(vertex[c->count - 1], vertex[c->count - 2]);
}

static bool sample_corners(layout *l, const field *f, curve_samples *out, error *e)
{
    for (size_t k = 0; k < l->end_count && out->count < l->request.most;) {
        const uint32_t corner = l->ends[k].merge_target;
        if (!add_sample(l, l->ends[k].at, l->ends[k].curve, out, e)) return false;
        l->corner_sample[corner] = (uint32_t)(out->count - 1);
        /* each patch has two ends here */
        for (; k < l->end_count && l->ends[k].merge_target == corner; k++) {
            const field_curve *c = &l->patches->curve[l->ends[k].curve];
            const uint32_t curve = l->ends[k].curve;
            const bool within = l->ends[k].corner != corner && /* both ends of the curve have this sample */
                                l->merge_target[l->corner[0][curve]] == l->merge_target[l->corner[1][curve]];
            vec3 along = direction_at_end(l->patches, c, l->ends[k].at);
            if (!add_copies(l, f, c, along, within ? 0 : 0.5, out, e)) return false;
        }
    }
    out->corners = out->count;
    return true;
}

static bool sample_curve(layout *l, const field *f, uint32_t curve, curve_samples *out, error *e)
{
    const field_curve *c = &l->patches->curve[curve];
    double steps = step_count(l, curve), step = l->length[curve] / steps;
    size_t side = 0;
    if (!(inner_samples(l, curve) > 0)) return true;
    if (!trace_curve(l, c, e)) return false;
    for (double k = c->closed ? 0 : 1; k < steps && out->count < l->request.most; k++) {
        while (side + 2 < l->point_count && l->at[side + 1] < k * step) side++;
        double length = l->at[side + 1] - l->at[side],
               share = length > 0 ? (k * step - l->at[side]) / length : 0;
        vec3 along = vec3_sub(l->point[side + 1], l->point[side]);
        vec3 x = vec3_axpy(share, along, l->point[side]);
        if (!add_sample(l, project_on_both(c, x), curve, out, e) || !add_copies(l, f, c, along, 1, out, e))
            return false;
    }
    return true;
}

/* Unites the sides of curves a and b (or of one curve) that belong to the same patch. */
static void join_shared(const field_patches *p, const field_curve *a, const field_curve *b, uint32_t *parent)
{
    for (size_t m = a->patch_first; m < a->patch_first + a->patch_count; m++)
        for (size_t n = b->patch_first; n < b->patch_first + b->patch_count; n++)
            if (p->curve_patch[m] == p->curve_patch[n]) sets_join(parent, (uint32_t)m, (uint32_t)n);
}

/* Unites curve sides of one patch that share a corner: the sets are the boundary loops of the patches. */
static void join_loops(const layout *l, uint32_t *parent)
{
    const field_patches *p = l->patches;
    for (size_t k = 0; k < l->end_count; k++)
        for (size_t other = k + 1; other > 0 && l->ends[other - 1].corner == l->ends[k].corner; other--)
            join_shared(p, &p->curve[l->ends[k].curve], &p->curve[l->ends[other - 1].curve], parent);
}

/* Counts the samples of each loop, stored at its root. `last`: scratch, one entry per curve side. */
static void count_samples(const layout *l, uint32_t *parent, uint32_t *last, double *places)
{
    const field_patches *p = l->patches;
    for (size_t c = 0; c < p->curve_count; c++)
        for (size_t m = 0; m < p->curve[c].patch_count; m++) {
            const uint32_t side = (uint32_t)(p->curve[c].patch_first + m);
            places[sets_root(parent, side)] += inner_samples(l, c);
            last[side] = UINT32_MAX;
        }
    for (size_t k = 0; k < l->end_count; k++) { /* ascending by merge_target */
        const field_curve *c = &p->curve[l->ends[k].curve];
        for (size_t m = 0; m < c->patch_count; m++) {
            const uint32_t root = sets_root(parent, (uint32_t)(c->patch_first + m));
            places[root] += last[root] != l->ends[k].merge_target;
            last[root] = l->ends[k].merge_target;
        }
    }
}

/* Subtracts the Euler characteristic of each patch from its border: 2 less the number of its boundary loops.
 * Handles are ignored. A loop without samples does not exist for the particles and counts 0; a loop of one
 * sample counts 1/2. A patch with a boundary has at least one loop. */
static bool subtract_euler(const layout *l, curve_samples *out, error *e)
{
    const field_patches *p = l->patches;
    size_t ends = 0;
    for (size_t c = 0; c < p->curve_count; c++) ends += p->curve[c].patch_count;
    uint32_t *parent = mem_array(ends, sizeof *parent, WHAT, e),
             *last = mem_array(ends, sizeof *last, WHAT, e);
    double *places = mem_array(ends, sizeof *places, WHAT, e),
           *loops = mem_array(p->count, sizeof *loops, WHAT, e);
    bool *ended = mem_array(p->count, sizeof *ended, WHAT, e),
         ok = parent && last && places && loops && ended;
    if (ok) {
        sets_reset(parent, ends);
        join_loops(l, parent);
        count_samples(l, parent, last, places);
        for (uint32_t k = 0; k < ends; k++) {
            const uint32_t patch = p->curve_patch[k];
            if (sets_root(parent, k) != k) continue;
            loops[patch] += 0.5 * fmin(places[k], 2);
            ended[patch] = true;
        }
        for (size_t k = 0; k < p->count; k++)
            if (ended[k]) out->border[k] -= 2 - fmax(loops[k], 1);
    }
    free(parent);
    free(last);
    free(places);
    free(loops);
    free(ended);
    return ok;
}

/* Merges samples of curves that are closer to each other than the packing allows, or at the same place
 * (near_curves). */
static bool merge_near_samples(layout *l, curve_samples *out, error *e)
{
    const field_patches *p = l->patches;
    bool *closed = mem_array(p->curve_count, sizeof *closed, WHAT, e);
    uint32_t(*ends)[2] = mem_array(p->curve_count, sizeof *ends, WHAT, e);
    double *spacing = mem_array(out->count, sizeof *spacing, WHAT, e);
    const near_curves_input in = {p->count, p->curve_count,      closed,
                                  ends,     l->first_sample,     spacing,
                                  l->half,  p->has_rough_curves, !p->merges_near_curves};
    bool ok = closed && ends && spacing;
    for (size_t c = 0; ok && c < p->curve_count; c++) {
        closed[c] = p->curve[c].closed;
        for (int k = 0; k < 2 && !closed[c]; k++)
            ends[c][k] = l->corner_sample[l->merge_target[l->corner[k][c]]];
    }
    for (size_t k = 0; ok && k < out->count; k++)
        spacing[k] = boundary_spacing(&l->request, out->position[k]);
    ok = ok && near_curves_merge(&in, out, e);
    free(closed);
    free(ends);
    free(spacing);
    return ok;
}

/* Samples all curves at the present spacing, without a limit if near samples are merged. */
static bool sample_all(layout *l, const field *f, curve_samples *out, error *e)
{
    const field_patches *p = l->patches;
    memset(l->capacity, 0, sizeof l->capacity);
    free(l->half);
    l->half = NULL;
    curve_samples_free(out);
    out->border = mem_array(p->count, sizeof *out->border, WHAT, e);
    bool ok = out->border && find_merge_targets(l, e) && sample_corners(l, f, out, e);
    for (uint32_t c = 0; ok && c < p->curve_count; c++) {
        l->first_sample[c] = out->count;
        ok = sample_curve(l, f, c, out, e);
        l->first_sample[c + 1] = out->count;
    }
    return ok && merge_near_samples(l, out, e);
}

/* Samples all curves, and increases the spacing while there are more than `most` samples. */
static bool sample_at_most(layout *l, const field *f, size_t most, curve_samples *out, error *e)
{
    double places;
    if (!measure_curves(l, &places, e)) return false;
    for (int k = 0; k < MAX_CORRECTIONS && places > (double)most; k++) {
        l->request.spacing *= SPACING_MARGIN * places / (double)most;
        if (!measure_curves(l, &places, e)) return false;
    }
    return sample_all(l, f, out, e);
}

/* sample_all, and merges near samples: only remaining samples are counted. If they need a spacing above
 * MAX_STRETCH, the samples are omitted. */
static bool sample_and_merge(layout *l, const field *f, size_t most, curve_samples *out, error *e)
{
    const double longest = MAX_STRETCH * l->request.spacing;
    double places;
    l->request.most = SIZE_MAX;
    while (l->request.spacing <= longest) {
        if (!measure_curves(l, &places, e) || !sample_all(l, f, out, e)) return false;
        if (out->count <= most) return true;
        l->request.spacing *= SPACING_MARGIN * (double)out->count / (double)most;
    }
    curve_samples_free(out);
    *out = (curve_samples){.border = mem_array(l->patches->count, sizeof *out->border, WHAT, e),
                           .omitted = true};
    return out->border != NULL;
}

static bool make_layout(layout *l, const field *f, curve_samples *out, error *e)
{
    const size_t most = l->request.most;
    l->length = mem_array(l->patches->curve_count, sizeof *l->length, WHAT, e);
    l->first_sample = mem_array(l->patches->curve_count + 1, sizeof *l->first_sample, WHAT, e);
    if (!l->length || !l->first_sample || !find_corners(l, e)) return false;
    l->corner_sample = mem_array(l->corner_count, sizeof *l->corner_sample, WHAT, e);
    if (!l->corner_sample) return false;
    return (l->patches->merges_near_curves ? sample_and_merge(l, f, most, out, e)
                                           : sample_at_most(l, f, most, out, e)) &&
           (out->count == 0 || subtract_euler(l, out, e));
}

bool curve_samples_make(const field *f, const boundary_request *request, curve_samples *out, error *e)
{
    layout l = {.patches = f->patches, .request = *request};
    *out = (curve_samples){0};
    bool ok = make_layout(&l, f, out, e);
    free(l.length);
    free(l.ends);
    free(l.merged);
    free(l.half);
    free(l.corner_sample);
    free(l.first_sample);
    free(l.merge_target);
    free(l.corner[0]);
    free(l.corner[1]);
    free(l.point);
    free(l.at);
    return ok;
}
