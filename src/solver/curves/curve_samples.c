#include "solver/curves/curve_samples.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sets.h"
#include "solver/curves/near_curves.h"

/* Of a spacing: with a grading sides are looked at in parts of this length. */
static const double PART = 0.25;
/* In spacings: a shorter curve has no places of its own, and one corner. */
static const double SHORTEST = 0.5;
/* When there are too many places all go farther apart, a little more than in proportion, so often at most. */
static const double WIDENING = 1.02;
enum { WIDENINGS = 12 };
/* Of a spacing: where a patch meets itself its normals on either side of a curve are looked at this far from it. */
static const double BESIDE = 0.05;
/* Newton steps that bring a place onto both surfaces of a curve, which the polyline follows closely. */
enum { ON_STEPS = 6 };

static const char *const WHAT = "the rows along curves";

/* An end of a curve that is not closed. */
typedef struct end {
    vec3 at;
    uint32_t curve, corner, lender;
} end;

typedef struct layout {
    const field_patches *patches;
    boundary_request request;
    double *length; /* of each curve, in spacings */
    end *ends;      /* by corner */
    size_t end_count;
    size_t corner_count;
    bool *left_out; /* of each corner */
    /* Of each corner the one whose place stands for it: its own, or where it is left out the one at the other end of its
     * shortest curve to one that is not. */
    uint32_t *lender;
    uint32_t *corner[2]; /* of each curve's ends */
    vec3 *point;         /* of the curve at hand, its parts */
    double *at;          /* of each, the length up to there */
    size_t point_capacity, at_capacity, point_count;
    size_t capacity[6];  /* of the arrays of the result, and of `half` */
    double *half;        /* of each stand what it adds to the border of its patch */
    uint32_t *place_of;  /* of each corner that has a place */
    size_t *first_place; /* of each curve, and one more */
} layout;

static int compare_ends(const void *a, const void *b)
{
    const end *x = a, *y = b;
    int order = vec3_compare(x->at, y->at);
    return order ? order : (x->curve > y->curve) - (x->curve < y->curve);
}

/* Numbers the corners: ends with the same doubles are one. */
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
    l->left_out = mem_array(l->corner_count, sizeof *l->left_out, WHAT, e);
    l->lender = mem_array(l->corner_count, sizeof *l->lender, WHAT, e);
    return l->left_out && l->lender;
}

static bool add_point(layout *l, vec3 x, double at, error *e)
{
    vec3 *point = mem_grow(l->point, l->point_count, &l->point_capacity, 64, sizeof *point, WHAT, e);
    if (!point) return false;
    l->point = point;
    double *length = mem_grow(l->at, l->point_count, &l->at_capacity, 64, sizeof *length, WHAT, e);
    if (!length) return false;
    l->at = length;
    l->point[l->point_count] = x;
    l->at[l->point_count++] = at;
    return true;
}

/* The points of a curve and the length up to each, in spacings. */
static bool follow(layout *l, const field_curve *c, error *e)
{
    const vec3 *vertex = l->patches->vertex + c->first;
    double at = 0;
    l->point_count = 0;
    if (!add_point(l, vertex[0], 0, e)) return false;
    for (size_t k = 1; k < c->count + c->closed; k++) {
        vec3 from = vertex[k - 1], side = vec3_sub(vertex[k % c->count], from);
        double length = vec3_norm(side), spacing = boundary_spacing(&l->request, from);
        size_t parts = l->request.sizing ? (size_t)fmin(1 + length / (PART * spacing), 1e6) : 1;
        for (size_t m = 1; m <= parts; m++) {
            vec3 middle = vec3_axpy(((double)m - 0.5) / (double)parts, side, from);
            at += length / (double)parts / boundary_spacing(&l->request, middle);
            if (!add_point(l, vec3_axpy((double)m / (double)parts, side, from), at, e)) return false;
        }
    }
    return true;
}

/* Steps that a curve takes. Not two where it is closed: its patches would meet twice along one edge. */
static double steps_of(const layout *l, size_t c)
{
    double steps = round(l->length[c]);
    if (l->patches->curve[c].closed) return steps == 2 ? (l->length[c] < 2 ? 1 : 3) : steps;
    return l->length[c] < SHORTEST ? steps : fmax(steps, 1);
}

static double places_of(const layout *l, size_t c)
{
    return l->patches->curve[c].closed ? steps_of(l, c) : fmax(steps_of(l, c) - 1, 0);
}

static bool is_short(const layout *l, size_t c)
{
    return !l->patches->curve[c].closed && l->length[c] < SHORTEST;
}

/* Leaves out each corner that a short curve joins to one of a lower number that is not left out. */
static void leave_out(layout *l)
{
    memset(l->left_out, 0, l->corner_count * sizeof *l->left_out);
    for (size_t k = 0; k < l->end_count; k++) { /* by corner */
        const uint32_t own = l->ends[k].corner, c = l->ends[k].curve;
        const uint32_t other = l->corner[l->corner[0][c] == own][c];
        if (is_short(l, c) && other < own && !l->left_out[other]) l->left_out[own] = true;
    }
}

/* Lengths, and which corners are left out. Returns how many places there will be. */
static bool measure(layout *l, double *places, error *e)
{
    const field_patches *p = l->patches;
    *places = 0;
    for (size_t c = 0; c < p->curve_count; c++) {
        if (!follow(l, &p->curve[c], e)) return false;
        l->length[c] = l->at[l->point_count - 1];
        *places += places_of(l, c);
    }
    leave_out(l);
    for (size_t k = 0; k < l->corner_count; k++) *places += !l->left_out[k];
    return true;
}

static int compare_lenders(const void *a, const void *b)
{
    const end *x = a, *y = b;
    if (x->lender != y->lender) return x->lender > y->lender ? 1 : -1;
    if (x->corner != y->corner)
        return x->corner == x->lender ? -1 : y->corner == y->lender ? 1 : x->corner > y->corner ? 1 : -1;
    return (x->curve > y->curve) - (x->curve < y->curve);
}

/* Puts the ends into the order of the places that stand for them. */
static bool lend_places(layout *l, error *e)
{
    double *shortest = mem_array(l->corner_count, sizeof *shortest, WHAT, e);
    if (!shortest) return false;
    for (uint32_t k = 0; k < l->corner_count; k++) {
        l->lender[k] = k;
        shortest[k] = INFINITY;
    }
    for (size_t c = 0; c < l->patches->curve_count; c++)
        for (int k = 0; k < 2 && is_short(l, c); k++) {
            const uint32_t own = l->corner[k][c], other = l->corner[1 - k][c];
            if (!l->left_out[own] || l->left_out[other] || !(l->length[c] < shortest[own])) continue;
            shortest[own] = l->length[c];
            l->lender[own] = other;
        }
    for (size_t k = 0; k < l->end_count; k++) l->ends[k].lender = l->lender[l->ends[k].corner];
    if (l->end_count > 0) qsort(l->ends, l->end_count, sizeof *l->ends, compare_lenders);
    free(shortest);
    return true;
}

/* Onto both zero sets, by the shortest step to where both would be linear. */
static vec3 settle(const field_curve *c, vec3 x)
{
    if (!c->on[0] || !c->on[1]) return x;
    for (int k = 0; k < ON_STEPS; k++) {
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

static vec3 normal_at(const field *patch, vec3 x)
{
    field_sample s;
    if (!field_sample_at(patch, x, FIELD_GRADIENT, &s) || !(vec3_norm2(s.gradient) > 0))
        return (vec3){0, 0, 1};
    return vec3_unit(s.gradient);
}

/* The mean of a patch's normals on either side of a curve along which it meets itself. */
static vec3 mean_normal(const field *patch, vec3 x, vec3 along, double beside)
{
    vec3 n = normal_at(patch, x), across = vec3_cross(along, n);
    if (!(vec3_norm2(across) > 0)) return n;
    across = vec3_scale(vec3_unit(across), beside);
    vec3 sum = vec3_add(normal_at(patch, vec3_add(x, across)), normal_at(patch, vec3_sub(x, across)));
    return vec3_norm2(sum) > 0 ? vec3_unit(sum) : n;
}

/* A stand of the last place for a patch, unless it has one. */
static bool add_stand(layout *l, uint32_t patch, vec3 n, double half, curve_samples *out, error *e)
{
    uint32_t place = (uint32_t)(out->count - 1);
    for (size_t k = out->copies; k > 0 && out->place[k - 1] == place; k--)
        if (out->patch[k - 1] == patch) {
            l->half[k - 1] += half;
            return true;
        }
    uint32_t *places = mem_grow(out->place, out->copies, &l->capacity[2], 256, sizeof *places, WHAT, e);
    if (!places) return false;
    out->place = places;
    uint32_t *patches = mem_grow(out->patch, out->copies, &l->capacity[3], 256, sizeof *patches, WHAT, e);
    if (!patches) return false;
    out->patch = patches;
    vec3 *normal = mem_grow(out->normal, out->copies, &l->capacity[4], 256, sizeof *normal, WHAT, e);
    if (!normal) return false;
    out->normal = normal;
    double *halves = mem_grow(l->half, out->copies, &l->capacity[5], 256, sizeof *halves, WHAT, e);
    if (!halves) return false;
    l->half = halves;
    l->half[out->copies] = half;
    out->place[out->copies] = place;
    out->patch[out->copies] = patch;
    out->normal[out->copies++] = n;
    return true;
}

static bool add_place(layout *l, vec3 x, uint32_t curve, curve_samples *out, error *e)
{
    vec3 *position = mem_grow(out->position, out->count, &l->capacity[0], 256, sizeof *position, WHAT, e);
    if (!position) return false;
    out->position = position;
    uint32_t *curves = mem_grow(out->curve, out->count, &l->capacity[1], 256, sizeof *curves, WHAT, e);
    if (!curves) return false;
    out->curve = curves;
    out->position[out->count] = x;
    out->curve[out->count++] = curve;
    return true;
}

/* The last place stands for the patches of a curve, which goes `along` there; `share` of a cell's half behind it is that of
 * each. */
static bool add_stands(layout *l, const field *f, const field_curve *c, vec3 along, double share,
                       curve_samples *out, error *e)
{
    const uint32_t *patches = l->patches->curve_patch + c->patch_first;
    vec3 x = out->position[out->count - 1];
    for (size_t k = 0; k < c->patch_count; k++) {
        const field *patch = field_of_patch(f, patches[k]);
        bool twice = false;
        for (size_t m = 0; m < c->patch_count; m++) twice |= m != k && patches[m] == patches[k];
        vec3 n = twice ? mean_normal(patch, x, along, BESIDE * boundary_spacing(&l->request, x))
                       : normal_at(patch, x);
        out->border[patches[k]] += 0.5 * share;
        if (!add_stand(l, patches[k], n, 0.5 * share, out, e)) return false;
    }
    return true;
}

/* The direction of a curve at an end of it, whichever way. */
static vec3 direction_at_end(const field_patches *p, const field_curve *c, vec3 corner)
{
    const vec3 *vertex = p->vertex + c->first;
    bool first = vec3_compare(vertex[0], corner) == 0;
    return first ? vec3_sub(vertex[1], vertex[0]) : vec3_sub(vertex[c->count - 1], vertex[c->count - 2]);
}

static bool place_corners(layout *l, const field *f, curve_samples *out, error *e)
{
    for (size_t k = 0; k < l->end_count && out->count < l->request.most;) {
        const uint32_t corner = l->ends[k].lender;
        if (!add_place(l, l->ends[k].at, l->ends[k].curve, out, e)) return false;
        l->place_of[corner] = (uint32_t)(out->count - 1);
        for (; k < l->end_count && l->ends[k].lender == corner; k++) { /* two ends a patch */
            const field_curve *c = &l->patches->curve[l->ends[k].curve];
            const uint32_t curve = l->ends[k].curve;
            const bool within = l->ends[k].corner != corner && /* it starts here, too */
                                l->lender[l->corner[0][curve]] == l->lender[l->corner[1][curve]];
            vec3 along = direction_at_end(l->patches, c, l->ends[k].at);
            if (!add_stands(l, f, c, along, within ? 0 : 0.5, out, e)) return false;
        }
    }
    out->corners = out->count;
    return true;
}

static bool place_row(layout *l, const field *f, uint32_t curve, curve_samples *out, error *e)
{
    const field_curve *c = &l->patches->curve[curve];
    double steps = steps_of(l, curve), step = l->length[curve] / steps;
    size_t side = 0;
    if (!(places_of(l, curve) > 0)) return true;
    if (!follow(l, c, e)) return false;
    for (double k = c->closed ? 0 : 1; k < steps && out->count < l->request.most; k++) {
        while (side + 2 < l->point_count && l->at[side + 1] < k * step) side++;
        double length = l->at[side + 1] - l->at[side],
               share = length > 0 ? (k * step - l->at[side]) / length : 0;
        vec3 along = vec3_sub(l->point[side + 1], l->point[side]);
        vec3 x = vec3_axpy(share, along, l->point[side]);
        if (!add_place(l, settle(c, x), curve, out, e) || !add_stands(l, f, c, along, 1, out, e))
            return false;
    }
    return true;
}

/* Joins the sides of two curves, or of one, that are of one patch. */
static void join_shared(const field_patches *p, const field_curve *a, const field_curve *b, uint32_t *parent)
{
    for (size_t m = a->patch_first; m < a->patch_first + a->patch_count; m++)
        for (size_t n = b->patch_first; n < b->patch_first + b->patch_count; n++)
            if (p->curve_patch[m] == p->curve_patch[n]) sets_join(parent, (uint32_t)m, (uint32_t)n);
}

/* Joins what shares a corner and a patch into loops. */
static void join_loops(const layout *l, uint32_t *parent)
{
    const field_patches *p = l->patches;
    for (size_t k = 0; k < l->end_count; k++)
        for (size_t other = k + 1; other > 0 && l->ends[other - 1].corner == l->ends[k].corner; other--)
            join_shared(p, &p->curve[l->ends[k].curve], &p->curve[l->ends[other - 1].curve], parent);
}

/* How many places each loop has, at its root. `last`: one for each, any. */
static void count_places(const layout *l, uint32_t *parent, uint32_t *last, double *places)
{
    const field_patches *p = l->patches;
    for (size_t c = 0; c < p->curve_count; c++)
        for (size_t m = 0; m < p->curve[c].patch_count; m++) {
            const uint32_t side = (uint32_t)(p->curve[c].patch_first + m);
            places[sets_root(parent, side)] += places_of(l, c);
            last[side] = UINT32_MAX;
        }
    for (size_t k = 0; k < l->end_count; k++) { /* by lender */
        const field_curve *c = &p->curve[l->ends[k].curve];
        for (size_t m = 0; m < c->patch_count; m++) {
            const uint32_t root = sets_root(parent, (uint32_t)(c->patch_first + m));
            places[root] += last[root] != l->ends[k].lender;
            last[root] = l->ends[k].lender;
        }
    }
}

/* Takes the Euler characteristic of each patch off its border: 2 less the number of its loops, handles left out. Particles see
 * no loop that has no place, and half of one that has one; a patch that ends anywhere has one at least. */
static bool count_loops(const layout *l, curve_samples *out, error *e)
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
        count_places(l, parent, last, places);
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

/* Rows that come nearer to each other than points can lie become one, where the surface asks for that. */
static bool merge_near(layout *l, curve_samples *out, error *e)
{
    const field_patches *p = l->patches;
    bool *closed = mem_array(p->curve_count, sizeof *closed, WHAT, e);
    uint32_t(*ends)[2] = mem_array(p->curve_count, sizeof *ends, WHAT, e);
    double *spacing = mem_array(out->count, sizeof *spacing, WHAT, e);
    const near_curves_input in = {p->count,       p->curve_count, closed,  ends,
                                  l->first_place, spacing,        l->half, p->has_rough_curves};
    bool ok = closed && ends && spacing;
    for (size_t c = 0; ok && c < p->curve_count; c++) {
        closed[c] = p->curve[c].closed;
        for (int k = 0; k < 2 && !closed[c]; k++) ends[c][k] = l->place_of[l->lender[l->corner[k][c]]];
    }
    for (size_t k = 0; ok && k < out->count; k++)
        spacing[k] = boundary_spacing(&l->request, out->position[k]);
    ok = ok && near_curves_merge(&in, out, e);
    free(closed);
    free(ends);
    free(spacing);
    return ok;
}

static bool lay_out(layout *l, const field *f, curve_samples *out, error *e)
{
    double places, most = (double)l->request.most;
    l->length = mem_array(l->patches->curve_count, sizeof *l->length, WHAT, e);
    out->border = mem_array(l->patches->count, sizeof *out->border, WHAT, e);
    if (!l->length || !out->border || !find_corners(l, e) || !measure(l, &places, e)) return false;
    for (int k = 0; k < WIDENINGS && places > most; k++) {
        l->request.spacing *= WIDENING * places / most;
        if (!measure(l, &places, e)) return false;
    }
    l->place_of = mem_array(l->corner_count, sizeof *l->place_of, WHAT, e);
    l->first_place = mem_array(l->patches->curve_count + 1, sizeof *l->first_place, WHAT, e);
    bool ok = l->place_of && l->first_place && lend_places(l, e) && place_corners(l, f, out, e);
    for (uint32_t c = 0; ok && c < l->patches->curve_count; c++) {
        l->first_place[c] = out->count;
        ok = place_row(l, f, c, out, e);
        l->first_place[c + 1] = out->count;
    }
    return ok && (!l->patches->merges_near_rows || merge_near(l, out, e)) && count_loops(l, out, e);
}

bool curve_samples_make(const field *f, const boundary_request *request, curve_samples *out, error *e)
{
    layout l = {.patches = f->patches, .request = *request};
    *out = (curve_samples){0};
    bool ok = lay_out(&l, f, out, e);
    free(l.length);
    free(l.ends);
    free(l.left_out);
    free(l.half);
    free(l.place_of);
    free(l.first_place);
    free(l.lender);
    free(l.corner[0]);
    free(l.corner[1]);
    free(l.point);
    free(l.at);
    return ok;
}
