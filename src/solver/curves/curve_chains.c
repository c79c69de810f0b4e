#include "solver/curves/curve_chains.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "packing/packing.h"

double curve_chains_length(const field_patches *patches, const field_curve *curve)
{
    double length = 0;
    for (size_t k = 1; k < curve->count + curve->closed; k++)
        length += vec3_norm(vec3_sub(patches->vertex[curve->first + k % curve->count],
                                     patches->vertex[curve->first + k - 1]));
    return length;
}

/* ---- corners */

/* A corner, by its place; `length`: of the shortest curve to another one that lends it its point. */
typedef struct corner {
    vec3 at;
    uint32_t point; /* or NONE */
    double length;
} corner;

static const uint32_t NONE = UINT32_MAX;

static int compare_corners(const void *a, const void *b)
{
    const corner *x = a, *y = b;
    int order = vec3_compare(x->at, y->at);
    return order ? order : (x->point > y->point) - (x->point < y->point);
}

typedef struct corners {
    corner *list; /* ascending */
    size_t count;
} corners;

static corner *find_corner(const corners *all, vec3 at)
{
    size_t low = 0, high = all->count;
    while (low < high) { /* the first that is not before it */
        size_t middle = (low + high) / 2;
        if (vec3_compare(all->list[middle].at, at) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return &all->list[low];
}

static vec3 end_of(const field_patches *p, const field_curve *c, int which)
{
    return p->vertex[c->first + (which == 0 ? 0 : c->count - 1)];
}

/* In spacings: where rows have become one, no corner's point is farther from it. */
static const double NEAR = 0.65;

static bool is_near(const solver_points *solved, uint32_t point, vec3 at)
{
    return vec3_norm(vec3_sub(solved->position[point], at)) <= NEAR * solved->spacing[point];
}

/* Those without a point borrow one. */
static void lend_points(const field_patches *p, const solver_points *solved, corners *all)
{
    for (size_t c = 0; c < p->curve_count; c++)
        for (int k = 0; k < 2 && !p->curve[c].closed; k++) {
            corner *own = find_corner(all, end_of(p, &p->curve[c], k));
            const corner *other = find_corner(all, end_of(p, &p->curve[c], 1 - k));
            const double length = curve_chains_length(p, &p->curve[c]);
            if (own->length == 0 || other->length != 0 || !(length < own->length)) continue;
            if (p->merges_near_rows && !is_near(solved, other->point, own->at)) continue;
            own->length = length;
            own->point = other->point;
        }
}

/* `place`: the points by place, those on corners first. */
static void find_corners(const field_patches *p, const solver_points *solved, const uint32_t *place,
                         const curve_chains *chains, corners *out)
{
    out->list = mem_alloc((chains->corners + 2 * p->curve_count) * sizeof *out->list);
    for (size_t k = 0; k < chains->corners; k++)
        out->list[out->count++] = (corner){solved->position[place[k]], place[k], 0};
    for (size_t c = 0; c < p->curve_count; c++)
        for (int k = 0; k < 2 && !p->curve[c].closed; k++)
            out->list[out->count++] = (corner){end_of(p, &p->curve[c], k), NONE, INFINITY};
    qsort(out->list, out->count, sizeof *out->list, compare_corners);
    size_t kept = 0;
    for (size_t k = 0; k < out->count; k++)
        if (kept == 0 || vec3_compare(out->list[kept - 1].at, out->list[k].at) != 0)
            out->list[kept++] = out->list[k];
    out->count = kept;
    lend_points(p, solved, out);
}

/* ---- chains */

/* Points by place: those on corners come first, then curve after curve, each from its start to its end. */
static uint32_t *find_places(const solver_points *solved, curve_chains *out)
{
    const solver_patch_points *stands = &solved->patch_points;
    for (size_t k = 0; k < solved->count; k++) {
        out->points += solved->feature[k] != SOLVER_ON_PATCH;
        out->corners += solved->feature[k] == SOLVER_ON_CORNER;
    }
    uint32_t *place = mem_alloc(out->points * sizeof *place);
    for (size_t k = 0; k < stands->count; k++)
        if (solved->feature[stands->point[k]] != SOLVER_ON_PATCH) place[stands->place[k]] = stands->point[k];
    return place;
}

static void add_point(curve_chains *out, size_t begin, size_t *count, uint32_t point)
{
    if (point != NONE && (*count == begin || out->point[*count - 1] != point)) out->point[(*count)++] = point;
}

void curve_chains_make(const field_patches *patches, const solver_points *solved, curve_chains *out)
{
    corners all = {0};
    *out = (curve_chains){0};
    uint32_t *place = find_places(solved, out);
    size_t count = 0, k = out->corners;
    out->first = mem_alloc((patches->curve_count + 1) * sizeof *out->first);
    out->point = mem_alloc((out->points + 2 * patches->curve_count) * sizeof *out->point);
    find_corners(patches, solved, place, out, &all);
    for (size_t c = 0; c < patches->curve_count; c++) {
        const field_curve *curve = &patches->curve[c];
        const size_t begin = out->first[c] = count;
        if (!curve->closed)
            add_point(out, begin, &count, find_corner(&all, end_of(patches, curve, 0))->point);
        for (; k < out->points && solved->curve[k] == c; k++) add_point(out, begin, &count, place[k]);
        if (!curve->closed)
            add_point(out, begin, &count, find_corner(&all, end_of(patches, curve, 1))->point);
    }
    out->first[patches->curve_count] = count;
    free(all.list);
    free(place);
}

void curve_chains_free(curve_chains *c)
{
    free(c->first);
    free(c->point);
    *c = (curve_chains){0};
}

/* ---- sides */

/* A stand on a curve. */
typedef struct stand {
    uint32_t point, patch, index;
} stand;

static int compare_stands(const void *a, const void *b)
{
    const stand *x = a, *y = b;
    if (x->point != y->point) return x->point > y->point ? 1 : -1;
    return (x->patch > y->patch) - (x->patch < y->patch);
}

static stand *list_stands(const solver_patch_points *s, size_t *count)
{
    stand *list = mem_alloc(s->count * sizeof *list);
    *count = 0;
    for (size_t k = 0; k < s->count; k++)
        if (s->flags[k] & PACKING_FIXED) list[(*count)++] = (stand){s->point[k], s->patch[k], (uint32_t)k};
    qsort(list, *count, sizeof *list, compare_stands);
    return list;
}

/* In spacings: a step that is longer passes places that stand in another row. */
static const double JUMP = 2;

bool curve_chains_jumps(const field_patches *patches, double step, double one, double other)
{
    return patches->merges_near_rows && step > JUMP * fmax(one, other);
}

static bool is_jump(const field_patches *p, const solver_patch_points *s, uint32_t a, uint32_t b)
{
    const double step = vec3_norm(vec3_sub(s->position[a], s->position[b]));
    return curve_chains_jumps(p, step, s->spacing[a], s->spacing[b]);
}

uint32_t (*curve_chains_sides(const curve_chains *c, const field_patches *patches,
                              const solver_patch_points *stands, size_t *count))[2]
{
    size_t most = 0, known;
    for (size_t k = 0; k < patches->curve_count; k++)
        most += (c->first[k + 1] - c->first[k]) * patches->curve[k].patch_count;
    uint32_t(*side)[2] = mem_alloc((most + 1) * sizeof *side);
    stand *list = list_stands(stands, &known);
    *count = 0;
    for (size_t k = 0; k < patches->curve_count; k++) {
        const field_curve *curve = &patches->curve[k];
        const uint32_t *point = c->point + c->first[k], *patch = patches->curve_patch + curve->patch_first;
        const size_t points = c->first[k + 1] - c->first[k];
        for (size_t i = 0; i < (points - !curve->closed) * curve->patch_count && points > 1; i++) {
            const size_t at = i / curve->patch_count;
            const stand from = {point[at], patch[i % curve->patch_count], 0},
                        to = {point[(at + 1) % points], from.patch, 0}, *a, *b;
            a = bsearch(&from, list, known, sizeof *list, compare_stands);
            b = bsearch(&to, list, known, sizeof *list, compare_stands);
            if (!a || !b || is_jump(patches, stands, a->index, b->index)) continue;
            side[*count][0] = a->index;
            side[(*count)++][1] = b->index;
        }
    }
    free(list);
    return side;
}

uint32_t (*curve_chains_steps(const field_patches *patches, const solver_points *solved, size_t *count))[2]
{
    curve_chains chains;
    curve_chains_make(patches, solved, &chains);
    uint32_t(*side)[2] = curve_chains_sides(&chains, patches, &solved->patch_points, count);
    curve_chains_free(&chains);
    return side;
}
