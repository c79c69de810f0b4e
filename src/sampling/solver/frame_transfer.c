// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/frame_transfer.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "surface/field/projection.h"
#include "geometry/space/morton.h"
#include "geometry/space/point_tree.h"
#include "sampling/packing/neighbours.h"
#include "geometry/space/packing.h"
#include "sampling/solver/curves/quota.h"
#include "sampling/solver/particles/particles.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/passes/relax.h"
#include "sampling/solver/schedule.h"

/* A point whose projection is farther outside of the surface's box than this, in spacings, is discarded. */
static const double FARTHEST = 1;
/* Two points, or a point and its projection, are on opposite walls if the cosine of their normals is below
 * this. */
static const double OPPOSITE_COSINE = 0.5;
/* The same on a surface that has not moved, where no point has to find its wall: that of the measures. Beside a fold,
 * a place that has points around it is no hole. */
static const double OPPOSITE_COSINE_STILL = -0.4;
/* Minimum distance, in spacings, of two points that are both kept. A relaxed packing has none below 0.8. */
static const double DENSE_DISTANCE = 0.6;
/* A position farther than this from every point, in spacings, is a hole. Corners of ideal cells are at 0.58,
 * the middle of a vacancy is at 1. An area filled at random with points at this minimum distance is as
 * dense as a packing. */
static const double HOLE = 0.78;
/* A curve sample continues a carried point within this distance, in spacings. */
static const double CONTINUED = 0.5;
/* A fixed point replaces a curve sample within this distance, in spacings: both would be too close. */
static const double REPLACED = 0.3;
/* Fixed points are a part of a packing if more than this fraction of them, without those on curves, is within
 * SAME_POINT spacings of its points. By chance that are 0.01; defect repair of their own solve leaves 0.5. */
static const double PART_SHARE = 0.25, SAME_POINT = 0.05;
/* If less than this fraction of the points can be carried, the surface is considered a different one. */
static const double SAME_SURFACE = 0.5;
/* Only the neighbours of a point are within this distance, in spacings. */
static const double NEAR = 1.3;
/* Number of candidate places for births, per point. */
static const size_t PLACES = 2;
/* Maximum number of draws for a candidate place. */
static const int DRAWS = 20;
/* Minimum distances of births, in spacings; the next one is used if no more places fit. */
static const double birth_distance[] = {1.3, 0.8, 0.4, -INFINITY};
enum { BIRTH_DISTANCES = sizeof birth_distance / sizeof birth_distance[0] };
/* Births and deaths are divided into portions of at most one in PORTION points. Sweeps between portions let
 * the packing converge: a birth beside the core of a dislocation moves the dislocation by a row, and the
 * next portion uses its new position. Changes of a portion keep SCATTER of the distance that they would have
 * if spread evenly, because points in excess must move to other places. On a torus with 2 % more points in
 * each frame, hex_fraction is 0.95, compared with 0.92 if all births are made at once. Portions and sweeps
 * also move the points: by 0.080 spacings (median) at hex_fraction 0.95, and by 0.068 at 0.94 with half as
 * many of both. */
static const double PORTION = 600, SCATTER = 0.56;
enum { PORTIONS_MOST = 8, PORTION_SWEEPS = 8 };
/* A component exchanges points with others if its number of points differs from the number for its area by
 * more than the fraction PART_SLACK and by more than PART_SLACK_POINTS. */
static const double PART_SLACK = 0.02, PART_SLACK_POINTS = 2;
/* Number of candidates for each change of a portion: several of the densest points, or emptiest places,
 * belong to the core of one dislocation. */
static const size_t CANDIDATES = 32;

/* Points of the new frame and candidates for them: first the carried points, then places for births. */
typedef struct candidates {
    const field *f;
    const surface *scan;
    const frame_transfer_params *params;
    threads *pool;
    registration motion;
    bbox box; /* projections outside of it are discarded */
    double h; /* spacing of an even packing */
    /* With patches: number of particles of each patch, and the curve samples. The particles of curve
     * samples, or the fixed points, are the first `fixed` candidates; they are taken and do not move. */
    quota allotted;
    size_t fixed;
    size_t wanted; /* number of particles: one for each point, and on curves one for each incident patch */
    size_t carried, count;
    vec3 *position, *normal;
    double *spacing;
    vec3 *landed;     /* position to which a point was carried */
    uint32_t *parent; /* index in the previous frame; FRAME_TRANSFER_NONE: born */
    uint32_t *row;    /* index of the curve sample, or PARTICLES_FREE */
    uint32_t *own;    /* for the first `fixed`: index of the fixed point, or FRAME_TRANSFER_NONE; NULL without
                     * fixed points */
    bool *taken;      /* the candidate is one of the points */
    uint32_t *part;   /* connected part of the surface, or patch; unused if there is only one */
    int64_t
        *missing; /* number of points that each part lacks (< 0: excess); NULL: points are exchanged between
                   * parts freely */
    /* with patches, while points are carried: samples of all patches, their patches, and a tree of the
     * samples */
    vec3 *place;
    uint32_t *place_patch;
    point_tree *tree;
    double *rank; /* priority: density of a point, or emptiness of a place */
    uint32_t *order;
    neighbours *near;
} candidates;

void frame_transfer_free(frame_transfer *c)
{
    if (!c) return;
    free(c->position);
    free(c->normal);
    free(c->landed);
    free(c->origin);
    free(c->parent);
    free(c->patch);
    free(c->place);
    free(c->fixed);
    *c = (frame_transfer){0};
}

static void candidates_free(candidates *c)
{
    quota_free(&c->allotted);
    free(c->position);
    free(c->normal);
    free(c->spacing);
    free(c->row);
    free(c->own);
    free(c->landed);
    free(c->parent);
    free(c->taken);
    free(c->part);
    free(c->missing);
    free(c->place);
    free(c->place_patch);
    point_tree_free(c->tree);
    free(c->rank);
    free(c->order);
    neighbours_free(c->near);
}

static bool candidates_make(candidates *c, error *e)
{
    const char *what = "carried points";
    size_t most = c->params->count > c->params->previous_count ? c->params->count : c->params->previous_count;
    size_t room = most + PLACES * c->params->count + c->allotted.samples.copies + c->params->fixed_count;
    return (c->position = mem_array(room, sizeof *c->position, what, e)) &&
           (c->normal = mem_array(room, sizeof *c->normal, what, e)) &&
           (c->spacing = mem_array(room, sizeof *c->spacing, what, e)) &&
           (c->landed = mem_array(room, sizeof *c->landed, what, e)) &&
           (c->parent = mem_array(room, sizeof *c->parent, what, e)) &&
           (c->row = mem_array(room, sizeof *c->row, what, e)) &&
           (c->params->fixed_count == 0 || (c->own = mem_array(room, sizeof *c->own, what, e))) &&
           (c->taken = mem_array(room, sizeof *c->taken, what, e)) &&
           (c->part = mem_array(room, sizeof *c->part, what, e)) &&
           (c->rank = mem_array(room, sizeof *c->rank, what, e)) &&
           (c->order = mem_array(room, sizeof *c->order, what, e)) &&
           (c->near = neighbours_new(room, SIZE_MAX, e));
}

/* Projects *x onto the surface, or onto a patch, from any distance. */
static bool land(const candidates *c, uint32_t patch, vec3 *x, vec3 *normal)
{
    const projection_limits limits = projection_draft(c->h);
    const field *f = field_of_patch(c->f, patch);
    return projection_find(f, &limits, x, normal) && bbox_contains(c->box, *x) &&
           (!c->f->patches || field_is_within(f, *x));
}

/* Keeps a point in the faces of the domain in which it was. The tolerance allows for positions in single
 * precision. */
static vec3 keep_in_faces(const field *f, vec3 before, vec3 x)
{
    for (int axis = 0; f->open && axis < 3; axis++) {
        float v = (float)vec3_get(before, axis);
        double low = vec3_get(f->boundary_box.min, axis), high = vec3_get(f->boundary_box.max, axis);
        if (v == (float)low) vec3_set(&x, axis, low);
        if (v == (float)high) vec3_set(&x, axis, high);
    }
    return x;
}

/* Whether two normals are on the same wall of a patch. */
static bool faces(const candidates *c, uint32_t patch, vec3 one, vec3 other)
{
    const bool one_sided = c->f->patches && c->f->patches->patch[patch].one_sided;
    const double cosine = vec3_dot(one, other);
    return (one_sided ? fabs(cosine) : cosine) >
           (c->params->is_still ? OPPOSITE_COSINE_STILL : OPPOSITE_COSINE);
}

static void carry_chunk(void *context, int worker, size_t begin, size_t end)
{
    candidates *c = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const size_t i = c->fixed + k;
        vec3 before = c->params->position[k],
             x = keep_in_faces(c->f, before, registration_apply(&c->motion, before));
        vec3 faced = registration_turn(&c->motion, c->params->normal[k]);
        bool left = c->f->open && projection_boundary_axes(c->f, x) == 0 && !bbox_contains(c->f->domain, x);
        double distance;
        if (c->params->patch)
            c->part[i] = c->params->patch[k];
        else if (c->tree)
            c->part[i] = c->place_patch[point_tree_nearest(c->tree, x, 0, &distance)];
        c->taken[i] =
            !left && land(c, c->part[i], &x, &c->normal[i]) && faces(c, c->part[i], faced, c->normal[i]);
        c->position[i] = c->landed[i] = x;
        c->parent[i] = (uint32_t)k;
        c->row[i] = PARTICLES_FREE;
    }
}

/* Adds the particles of curve samples; none continues a carried point yet. */
static void place_curve_samples(candidates *c)
{
    const curve_samples *rows = &c->allotted.samples;
    c->fixed = rows->copies;
    for (size_t i = 0; i < c->fixed; i++) {
        c->position[i] = c->landed[i] = rows->position[rows->place[i]];
        c->normal[i] = rows->normal[i];
        c->part[i] = rows->patch[i];
        c->row[i] = rows->place[i];
        c->parent[i] = FRAME_TRANSFER_NONE;
        c->taken[i] = true;
    }
}

/* Replaces a curve sample, with all its copies, by a fixed point. */
static void replace_sample(candidates *c, uint32_t i, uint32_t fixed)
{
    const uint32_t row = c->row[i];
    while (i > 0 && c->row[i - 1] == row) i--;
    for (; i < c->allotted.samples.copies && c->row[i] == row; i++) {
        c->position[i] = c->landed[i] = c->params->fixed[fixed];
        c->own[i] = fixed;
    }
}

/* Adds a fixed point that replaces no curve sample. */
static void pin_fixed(candidates *c, uint32_t fixed)
{
    const frame_transfer_params *p = c->params;
    const size_t i = c->fixed++;
    c->position[i] = c->landed[i] = p->fixed[fixed];
    c->normal[i] = p->fixed_normal[fixed];
    if (p->fixed_patch) c->part[i] = p->fixed_patch[fixed];
    c->row[i] = PARTICLES_PINNED;
    c->own[i] = fixed;
    c->parent[i] = FRAME_TRANSFER_NONE;
    c->taken[i] = true;
}

/* The curve sample nearest to a fixed point, of those on its patch that no other one replaces. */
typedef struct sample_search {
    const candidates *c;
    const vec3 *position;    /* of each copy, before any sample is replaced */
    uint32_t fixed, nearest; /* nearest: a copy of it, or NO_SAMPLE */
    double distance;
} sample_search;

#define NO_SAMPLE UINT32_MAX

static void compare_sample(void *context, uint32_t i)
{
    sample_search *s = context;
    const frame_transfer_params *p = s->c->params;
    const double distance = vec3_norm(vec3_sub(s->position[i], p->fixed[s->fixed]));
    if (s->c->own[i] != FRAME_TRANSFER_NONE || p->fixed_patch[s->fixed] != s->c->part[i]) return;
    if (distance > s->distance || (distance == s->distance && i > s->nearest)) return;
    s->distance = distance;
    s->nearest = i;
}

/* The curve sample that a fixed point replaces; NO_SAMPLE: none. `tree`: of the positions of the copies; or NULL. */
static uint32_t sample_to_replace(const candidates *c, const point_tree *tree, const vec3 *position,
                                  uint32_t fixed)
{
    const frame_transfer_params *p = c->params;
    const double h = p->sizing ? sizing_field_spacing(p->sizing, p->fixed[fixed], NULL) : c->h;
    sample_search s = {c, position, fixed, NO_SAMPLE, INFINITY};
    if (tree) point_tree_within(tree, p->fixed[fixed], REPLACED * h, compare_sample, &s);
    return s.nearest;
}

/* Adds the fixed points. */
static bool place_fixed(candidates *c, error *e)
{
    const size_t copies = c->fixed, count = c->params->fixed_count;
    vec3 *sample = count > 0 ? mem_array(copies + 1, sizeof *sample, "fixed points", e) : NULL;
    point_tree *tree = NULL;
    bool ok = count == 0 || sample;
    for (size_t i = 0; sample && i < copies; i++) {
        sample[i] = c->position[i];
        c->own[i] = FRAME_TRANSFER_NONE;
    }
    if (sample && copies > 0) ok = (tree = point_tree_new(sample, copies, e)) != NULL;
    for (uint32_t k = 0; ok && k < count; k++) {
        const uint32_t i = sample_to_replace(c, tree, sample, k);
        if (i != NO_SAMPLE)
            replace_sample(c, i, k);
        else
            pin_fixed(c, k);
    }
    point_tree_free(tree);
    free(sample);
    return ok;
}

/* Each curve sample continues the nearest carried point, if that is near and not continued by another
 * sample. */
static bool match_curve_samples(candidates *c, error *e)
{
    const size_t carried = c->params->previous_count;
    if (c->allotted.samples.copies == 0) return true;
    point_tree *tree = point_tree_new(c->position + c->fixed, carried, e);
    bool *assigned = tree ? mem_array(carried, sizeof *assigned, "points on curves", e) : NULL;
    for (size_t i = 0; assigned && i < c->allotted.samples.copies; i++) {
        double distance;
        const bool again = i > 0 && c->row[i] == c->row[i - 1];
        const uint32_t nearest = again ? 0 : point_tree_nearest(tree, c->position[i], 0, &distance);
        if (again) c->parent[i] = c->parent[i - 1];
        if (again || assigned[nearest] || !(distance < CONTINUED * c->spacing[i])) continue;
        c->parent[i] = nearest;
        c->taken[c->fixed + nearest] = false;
        assigned[nearest] = true;
    }
    point_tree_free(tree);
    const bool ok = assigned != NULL;
    free(assigned);
    return ok;
}

/* Sets the requested spacing of the candidates from `first` on. */
static void set_spacings(candidates *c, size_t first)
{
    for (size_t i = first; i < c->count; i++)
        c->spacing[i] =
            c->params->sizing ? sizing_field_spacing(c->params->sizing, c->position[i], NULL) : c->h;
}

/* Removes the candidates that are not taken. */
static void close_gaps(candidates *c)
{
    size_t kept = 0;
    for (size_t i = 0; i < c->count; i++) {
        if (!c->taken[i]) continue;
        c->position[kept] = c->position[i];
        c->normal[kept] = c->normal[i];
        c->spacing[kept] = c->spacing[i];
        c->landed[kept] = c->landed[i];
        c->parent[kept] = c->parent[i];
        c->part[kept] = c->part[i];
        c->row[kept] = c->row[i];
        c->taken[kept++] = true;
    }
    for (size_t i = kept; i < c->count; i++) c->taken[i] = false;
    c->carried = c->count = kept;
}

/* Builds neighbour lists. A stopped pool is an error also if there are no points. */
static bool build_lists(candidates *c, double reach, error *e)
{
    if (c->count > 0 && !neighbours_build(c->near, c->count, c->position, c->spacing, reach, c->pool, e))
        return false;
    return threads_may_go_on(c->pool, e);
}

/* The distance of two candidates in spacings. INFINITY: they are on opposite walls or different patches. */
static double distance(const candidates *c, size_t i, size_t j)
{
    if (c->f->patches && c->part[i] != c->part[j]) return INFINITY;
    if (!faces(c, c->part[i], c->normal[i], c->normal[j])) return INFINITY;
    return vec3_norm(vec3_sub(c->position[i], c->position[j])) / (0.5 * (c->spacing[i] + c->spacing[j]));
}

/* Whether a taken candidate with an index of at least `first` lies within `reach` of i. */
static bool has_near(const candidates *c, size_t i, double reach, size_t first)
{
    const uint32_t *list = neighbours_list(c->near, i);
    for (uint32_t k = 0; k < c->near->list_count[i]; k++)
        if (list[k] >= first && c->taken[list[k]] && distance(c, i, list[k]) < reach) return true;
    return false;
}

/* Draws place k of `places` near the surface, and finds its part. */
static vec3 draw_place(const candidates *c, size_t k, size_t places, rng *r, surface_last_cell *last,
                       uint32_t *part)
{
    const double where = ((double)k + rng_uniform(r)) / (double)places;
    const vec3 x = sizing_field_draw(c->params->sizing, c->scan, where, r, last);
    const size_t *begin = c->scan->parts.begin;
    /* a repeated draw may lie before the first one */
    while (begin && last->cell < begin[*part]) --*part;
    while (begin && last->cell >= begin[*part + 1]) ++*part;
    return x;
}

/* Samples all patches, for the search of the nearest patch. */
static bool spread_places(candidates *c, error *e)
{
    const char *what = "places on patches";
    const size_t places = PLACES * c->params->count;
    rng r = rng_seed(c->params->seed, RANDOM_STREAM_FRAME_TRANSFER);
    uint32_t part = 0;
    surface_last_cell last = {.known = false};
    if (!c->f->patches) return true;
    if (!(c->place = mem_array(places, sizeof *c->place, what, e)) ||
        !(c->place_patch = mem_array(places, sizeof *c->place_patch, what, e)))
        return false;
    for (size_t k = 0; k < places; k++) {
        c->place[k] = draw_place(c, k, places, &r, &last, &part);
        c->place_patch[k] = part;
    }
    return (c->tree = point_tree_new(c->place, places, e)) != NULL;
}

/* Whether all points within NEAR spacings of i are fixed, and too close for another point. */
static bool is_trapped(const candidates *c, size_t i)
{
    const uint32_t *list = neighbours_list(c->near, i);
    double nearest = INFINITY;
    for (uint32_t k = 0; k < c->near->list_count[i]; k++) {
        const double d = c->taken[list[k]] ? distance(c, i, list[k]) : INFINITY;
        if (list[k] >= c->fixed && d < NEAR) return false;
        nearest = fmin(nearest, d);
    }
    return nearest < HOLE;
}

/* Projects the points. Discards those that miss the surface or are over-dense. */
static bool carry_all(candidates *c, error *e)
{
    const frame_transfer_params *p = c->params;
    if (!spread_places(c, e)) return false;
    place_curve_samples(c);
    c->count = c->fixed;
    set_spacings(c, 0);
    if (!place_fixed(c, e)) return false;
    if (c->fixed > c->wanted) {
        const size_t least = p->count + c->fixed - c->wanted;
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/sampling/points: %zu points are given, and curves, such as borders and sharp edges, need "
            "%zu others, more than the count of %zu: ask for at least %zu points",
            p->fixed_count, least - p->fixed_count, p->count, least);
    }
    c->count = c->fixed;
    set_spacings(c, 0);
    if (!p->is_still) c->motion = registration_find(c->f, p->position, p->previous_count, c->h, c->pool);
    threads_run(c->pool, p->previous_count, 256, carry_chunk, c);
    if (!threads_may_go_on(c->pool, e)) return false;
    if (!match_curve_samples(c, e)) return false;
    c->count = c->fixed + p->previous_count;
    close_gaps(c);
    set_spacings(c, 0);
    if (!build_lists(c, p->fixed_count > 0 ? NEAR : DENSE_DISTANCE, e)) return false;
    size_t same = 0; /* points at fixed ones */
    for (size_t i = c->fixed; i < c->count; i++) c->taken[i] = false;
    for (size_t i = c->fixed; i < c->count; i++) same += has_near(c, i, SAME_POINT, 0);
    for (int inner = 0; inner <= 1; inner++) /* points on boundaries first: boundaries must stay closed */
        for (size_t i = c->fixed; i < c->count; i++)
            if (inner == (projection_boundary_axes(c->f, c->position[i]) == 0))
                c->taken[i] = !has_near(c, i, DENSE_DISTANCE, 0);
    /* given points that are a part of this packing lack just the trapped ones */
    const bool is_part = (double)same > PART_SHARE * (double)(c->fixed - c->allotted.samples.copies);
    for (size_t i = c->fixed; p->fixed_count > 0 && !is_part && i < c->count; i++)
        c->taken[i] = c->taken[i] && !is_trapped(c, i);
    close_gaps(c);
    return true;
}

/* The three points nearest to a place. False: there are fewer. */
static bool find_corners(const candidates *c, size_t place, uint32_t corner[3])
{
    const uint32_t *list = neighbours_list(c->near, place);
    double least[3] = {INFINITY, INFINITY, INFINITY};
    for (uint32_t k = 0; k < c->near->list_count[place]; k++) {
        if (!c->taken[list[k]]) continue;
        double d = distance(c, place, list[k]);
        if (!(d < least[2])) continue;
        int at = 2;
        for (; at > 0 && d < least[at - 1]; at--) {
            least[at] = least[at - 1];
            corner[at] = corner[at - 1];
        }
        least[at] = d;
        corner[at] = list[k];
    }
    return least[2] < INFINITY;
}

/* Moves places to the circumcentre of the points around them, where the distance from the points is largest.
 * At the core of a dislocation it is larger than elsewhere. Places with fewer than three points around, or
 * with a distant circumcentre, do not move. */
static void centre_chunk(void *context, int worker, size_t begin, size_t end)
{
    candidates *c = context;
    (void)worker;
    for (size_t i = begin + c->carried; i < end + c->carried; i++) {
        uint32_t corner[3];
        if (!find_corners(c, i, corner)) continue;
        vec3 a = c->position[corner[0]], ab = vec3_sub(c->position[corner[1]], a),
             ac = vec3_sub(c->position[corner[2]], a), n = vec3_cross(ab, ac), normal;
        vec3 to = vec3_add(vec3_scale(vec3_cross(n, ab), vec3_norm2(ac)),
                           vec3_scale(vec3_cross(ac, n), vec3_norm2(ab)));
        vec3 x = vec3_axpy(1 / (2 * vec3_norm2(n)), to, a);
        if (!(vec3_norm(vec3_sub(x, c->position[i])) < c->spacing[i]) || !land(c, c->part[i], &x, &normal))
            continue;
        c->position[i] = x;
        c->normal[i] = normal;
    }
}

/* Computes the priority: for a place its distance from the nearest point, for a point the density around it.
 * A place among fixed points has a priority below 0 unless it is a hole, because these points cannot make
 * room. Of such places the emptiest ones come first: they are where points of the same packing are missing. */
static void rank_chunk(void *context, int worker, size_t begin, size_t end)
{
    candidates *c = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const uint32_t *list = neighbours_list(c->near, i);
        double nearest = NEAR, crowding = 0;
        for (uint32_t k = 0; k < c->near->list_count[i]; k++) {
            if (!c->taken[list[k]]) continue;
            double d = fmin(distance(c, i, list[k]), NEAR);
            nearest = fmin(nearest, d);
            crowding += (NEAR - d) * (NEAR - d);
        }
        if (c->params->fixed_count > 0 && i >= c->carried && is_trapped(c, i)) nearest -= NEAR;
        c->rank[i] = i < c->carried ? crowding : nearest;
    }
}

static int compare_rank(const void *a, const void *b, void *ranks)
{
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const double *rank = ranks;
    if (rank[i] != rank[j]) return rank[i] > rank[j] ? -1 : 1;
    return (i > j) - (i < j);
}

/* Computes priorities, and sorts the candidates `first` .. `end` - 1 by decreasing priority. */
static void rank_all(candidates *c, size_t first, size_t end)
{
    threads_run(c->pool, c->count, 256, rank_chunk, c);
    for (size_t i = first; i < end; i++) c->order[i] = (uint32_t)i;
    qsort_r(c->order + first, end - first, sizeof *c->order, compare_rank, c->rank);
}

/* Moves the places to the emptiest positions nearby, and sorts them. */
static bool centre_places(candidates *c, error *e)
{
    set_spacings(c, c->carried);
    if (!build_lists(c, NEAR, e)) return false;
    threads_run(c->pool, c->count - c->carried, 256, centre_chunk, c);
    if (!build_lists(c, NEAR, e)) return false;
    rank_all(c, c->carried, c->count);
    return true;
}

/* Draws PLACES candidate places per requested point. */
static bool draw_places(candidates *c, error *e)
{
    rng r = rng_seed(c->params->seed, RANDOM_STREAM_FRAME_TRANSFER);
    size_t places = PLACES * c->params->count;
    uint32_t part = 0;
    surface_last_cell last = {.known = false};
    for (size_t k = 0; k < places; k++) {
        if (!threads_may_go_on(c->pool, e)) return false;
        for (int draw = 0; draw < DRAWS; draw++) {
            vec3 x = draw_place(c, k, places, &r, &last, &part), n;
            if (!land(c, part, &x, &n)) continue;
            assert(c->count < c->near->capacity);
            c->position[c->count] = c->landed[c->count] = x;
            c->parent[c->count] = FRAME_TRANSFER_NONE;
            c->row[c->count] = PARTICLES_FREE;
            c->part[c->count] = part;
            c->normal[c->count++] = n;
            break;
        }
    }
    return centre_places(c, e);
}

/* Whether the part of candidate i lacks points (`lives`), or has too many. */
static bool may_change(const candidates *c, size_t i, bool lives)
{
    return !c->missing || (lives ? c->missing[c->part[i]] > 0 : c->missing[c->part[i]] < 0);
}

static void change(candidates *c, size_t i, bool lives)
{
    c->taken[i] = lives;
    if (c->missing) c->missing[c->part[i]] += lives ? -1 : 1;
}

/* Takes at most `most` places, emptiest first, at a distance of at least `gap` from carried points and
 * `apart` from each other. Returns their number. */
static size_t give_birth(candidates *c, double gap, double apart, size_t most)
{
    size_t born = 0;
    for (size_t k = c->carried; k < c->count && born < most; k++) {
        uint32_t i = c->order[k];
        if (c->rank[i] < gap) break;
        if (c->taken[i] || !may_change(c, i, true) || has_near(c, i, apart, c->carried)) continue;
        change(c, i, true);
        born++;
    }
    return born;
}

/* Whether a neighbour of i was deleted in this portion. */
static bool has_lost(const candidates *c, size_t i)
{
    const uint32_t *list = neighbours_list(c->near, i);
    for (uint32_t k = 0; k < c->near->list_count[i]; k++)
        if (list[k] < c->carried && !c->taken[list[k]]) return true;
    return false;
}

/* Deletes at most `most` carried points, densest first. `spread`: no two neighbours. Returns their number. */
static size_t delete_dense(candidates *c, bool spread, size_t most)
{
    size_t died = 0;
    for (size_t k = c->fixed; k < c->carried && died < most; k++) {
        uint32_t i = c->order[k];
        if (!c->taken[i] || !may_change(c, i, false) || (spread && has_lost(c, i))) continue;
        change(c, i, false);
        died++;
    }
    return died;
}

/* Takes (`lives`) or deletes at most `most` of the `among` candidates from order[first] on, in decreasing
 * priority. They keep a large distance from each other. *there: number of taken candidates. */
static bool scatter(candidates *c, size_t first, size_t among, size_t most, bool lives, size_t *there,
                    error *e)
{
    const char *what = "births and deaths";
    const uint32_t *order = c->order + first;
    vec3 *place = mem_array(among, sizeof *place, what, e);
    double *spacing = mem_array(among, sizeof *spacing, what, e);
    bool *chosen = mem_array(among, sizeof *chosen, what, e);
    neighbours *near = neighbours_new(among, SIZE_MAX, e);
    double apart = SCATTER * sqrt((double)c->params->count / (double)most);
    bool ok = place && spacing && chosen && near;
    for (size_t k = 0; ok && k < among; k++) {
        place[k] = c->position[order[k]];
        spacing[k] = c->spacing[order[k]];
    }
    ok = ok && neighbours_build(near, among, place, spacing, apart, c->pool, e);
    for (size_t k = 0; ok && k < among && most > 0; k++) {
        const uint32_t *list = neighbours_list(near, k);
        bool free_to = c->taken[order[k]] != lives && may_change(c, order[k], lives) &&
                       !(lives && has_near(c, order[k], NEAR, c->carried));
        for (uint32_t n = 0; free_to && n < near->list_count[k]; n++) free_to = !chosen[list[n]];
        if (!free_to) continue;
        chosen[k] = true;
        change(c, order[k], lives);
        *there = lives ? *there + 1 : *there - 1;
        most--;
    }
    free(place);
    free(spacing);
    free(chosen);
    neighbours_free(near);
    return ok;
}

/* Inserts `most` points at places far from each other. `last`: inserts all of them, also at smaller
 * distances. */
static bool insert_portion(candidates *c, size_t most, bool last, size_t *there, error *e)
{
    size_t wanted = *there + most, places = c->count - c->carried;
    size_t among = places < CANDIDATES * most ? places : CANDIDATES * most;
    if (!scatter(c, c->carried, among, most, true, there, e)) return false;
    for (int k = 0; last && k < BIRTH_DISTANCES && *there < wanted; k++)
        *there += give_birth(c, 0, birth_distance[k], wanted - *there);
    return true;
}

static bool thin_out(candidates *c, size_t most, bool last, size_t *there, error *e)
{
    const size_t wanted = *there - most, free_count = c->carried - c->fixed,
                 among = free_count < CANDIDATES * most ? free_count : CANDIDATES * most;
    rank_all(c, c->fixed, c->carried);
    if (!scatter(c, c->fixed, among, most, false, there, e)) return false;
    for (int spread = 1; last && spread >= 0; spread--) *there -= delete_dense(c, spread, *there - wanted);
    return true;
}

static void swap_entries(candidates *c, size_t i, size_t j)
{
    const vec3 position = c->position[i], normal = c->normal[i];
    const uint32_t parent = c->parent[i];
    const bool taken = c->taken[i];
    const uint32_t part = c->part[i];
    c->position[i] = c->position[j];
    c->normal[i] = c->normal[j];
    c->parent[i] = c->parent[j];
    c->taken[i] = c->taken[j];
    c->part[i] = c->part[j];
    c->part[j] = part;
    c->position[j] = position;
    c->normal[j] = normal;
    c->parent[j] = parent;
    c->taken[j] = taken;
}

/* Moves the taken places to the carried points; the other places are kept. */
static void settle_born(candidates *c)
{
    for (size_t i = c->carried; i < c->count; i++)
        if (c->taken[i]) swap_entries(c, i, c->carried++);
    set_spacings(c, 0);
}

/* Relaxes the carried points by a few sweeps, as the solve that follows does (schedule_continued). If the
 * pool was stopped, does nothing; the next list build reports it. */
static bool relax_carried(candidates *c, error *e)
{
    size_t n = c->carried;
    particles *p = particles_new(n, e);
    relax *r = relax_new(n, &energy_cotangent, fast_kernel_for(c->params->isa), SIZE_MAX, c->pool, e);
    relax_params params = {.field = c->f,
                           .sigma = packing_support(c->h),
                           .spacing = c->h,
                           .omega = schedule_continued.omega,
                           .fast_step = schedule_continued.longest_step,
                           .gain = schedule_continued.gain};
    bool ok = p && r;
    ok = ok && particles_set_patches(p, c->f->patches, n, e) &&
         (c->params->fixed_count == 0 || particles_add_places(p, e));
    for (size_t i = 0; ok && i < n; i++) {
        if (p->patch) p->patch[i] = c->part[i];
        if (p->place) p->place[i] = c->row[i];
        p->position[i] = c->position[i];
        p->normal[i] = c->normal[i];
        p->size[i] = c->spacing[i] / c->h;
        p->lambda[i] = 0;
    }
    if (ok) particles_mark_boundary(p, c->f, c->h);
    ok = ok && relax_build(r, p, params.sigma, schedule_continued.skin_wide * c->h, e);
    for (int k = 0; ok && k < PORTION_SWEEPS && !threads_stopped(c->pool); k++) {
        relax_sums sums;
        relax_sweep(r, p, &params, &sums);
    }
    for (size_t i = 0; ok && i < n; i++) {
        c->position[i] = p->position[i];
        c->normal[i] = p->normal[i];
    }
    if (ok) set_spacings(c, 0);
    particles_free(p);
    relax_free(r);
    return ok;
}

/* The number of portions from `there` points to `wanted` points. */
static size_t count_portions(const candidates *c, size_t there, size_t wanted)
{
    const double changes = fabs((double)there - (double)wanted);
    const double portions = ceil(changes * PORTION / (double)c->params->count);
    return c->params->eased ? (size_t)fmin(fmax(portions, 1), PORTIONS_MOST) : 1;
}

/* Sets the part of each carried point to that of the nearest place; the number of parts if no place is
 * near. */
static void part_chunk(void *context, int worker, size_t begin, size_t end)
{
    candidates *c = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const uint32_t *list = neighbours_list(c->near, i);
        double least = INFINITY;
        c->part[i] = (uint32_t)c->scan->parts.count;
        for (uint32_t k = 0; k < c->near->list_count[i]; k++) {
            const double d = list[k] >= c->carried ? distance(c, i, list[k]) : INFINITY;
            if (!(d < least)) continue;
            least = d;
            c->part[i] = c->part[list[k]];
        }
    }
}

/* Computes how many points each connected part lacks or has in excess, after its fraction of the area has
 * changed. *take, *give: the sums. The number of places on a part determines the number of its points. */
static bool find_missing(candidates *c, size_t *take, size_t *give, error *e)
{
    const size_t parts = c->scan->parts.count;
    *take = *give = 0;
    if (parts < 2) return true;
    size_t *places = mem_array(parts + 1, sizeof *places, "parts", e),
           *fixed = mem_array(parts + 1, sizeof *fixed, "parts", e);
    c->missing = mem_array(parts + 1, sizeof *c->missing, "parts", e);
    if (!places || !fixed || !c->missing) {
        free(places);
        free(fixed);
        return false;
    }
    if (!c->f->patches) threads_run(c->pool, c->carried, 256, part_chunk, c);
    for (size_t i = c->carried; i < c->count; i++) places[c->part[i]]++;
    for (size_t i = 0; i < c->allotted.samples.copies; i++) fixed[c->part[i]]++;
    for (size_t i = 0; i < c->count; i++) c->missing[c->part[i]] -= c->taken[i];
    for (size_t k = 0; k <= parts; k++) {
        const double should = c->f->patches && k < parts ? (double)c->allotted.free[k] + (double)fixed[k]
                                                         : (double)places[k] / (double)PLACES,
                     off = should + (double)c->missing[k];
        const bool is_off = k < parts && fabs(off) > fmax(PART_SLACK_POINTS, PART_SLACK * should);
        c->missing[k] = is_off ? llround(off) : 0;
        *(c->missing[k] > 0 ? take : give) += (size_t)llabs(c->missing[k]);
    }
    free(places);
    free(fixed);
    return true;
}

/* Inserts or deletes points in portions until there are `wanted`, or until the parts permit no more changes.
 * `ends`: no further change follows. */
static bool approach(candidates *c, size_t wanted, bool ends, size_t *there, error *e)
{
    for (size_t left = count_portions(c, *there, wanted); left > 0 && *there != wanted; left--) {
        const bool last = left == 1, missing = *there < wanted;
        const size_t most = ((missing ? wanted - *there : *there - wanted) + left - 1) / left;
        if (!(missing ? insert_portion : thin_out)(c, most, last, there, e)) return false;
        if ((last || *there == wanted) && ends) break;
        (missing ? settle_born : close_gaps)(c);
        if (!relax_carried(c, e) || !(missing ? centre_places(c, e) : build_lists(c, NEAR, e))) return false;
    }
    return true;
}

/* Fills holes and reaches the exact count in each connected part and in total. Deaths come last, because
 * they discard the places. */
static bool populate(candidates *c, error *e)
{
    enum { STEPS = 4 };
    const size_t count = c->wanted;
    size_t take, give;
    if (!draw_places(c, e)) return false;
    /* carried points can make room for births, fixed points cannot */
    size_t there = c->carried + give_birth(c, HOLE, HOLE, count - c->fixed);
    if (!find_missing(c, &take, &give, e)) return false;
    const size_t taken = there + take, most = taken > count + give ? taken : count + give;
    const size_t wanted[STEPS] = {taken, most, most - give, count};
    int64_t *const missing = c->missing;
    bool ok = true;
    for (int k = 0; ok && k < STEPS; k++) {
        bool ends = true;
        for (int later = k + 1; later < STEPS; later++) ends = ends && wanted[later] == wanted[k];
        c->missing = k % 2 == 0 ? missing : NULL;
        ok = approach(c, wanted[k], ends, &there, e);
    }
    c->missing = missing;
    if (!ok || there == count) return ok;
    if (c->params->is_still)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/sampling/points: the given points leave no place for %zu of the %zu other points: ask for "
            "more points, or give fewer",
            count > there ? count - there : there - count, count - c->fixed);
    return error_set(e, ERROR_NO_SURFACE,
                     "point %zu of %zu was not projected onto the surface in %d attempts: reduce the "
                     "motion between frames, or ask for fewer points",
                     there + 1, count, DRAWS);
}

/* The nearest carried point. FRAME_TRANSFER_NONE: none is near. */
static uint32_t nearest_carried(const candidates *c, size_t i)
{
    const uint32_t *list = neighbours_list(c->near, i);
    uint32_t nearest = FRAME_TRANSFER_NONE;
    double least = INFINITY;
    for (uint32_t k = 0; k < c->near->list_count[i]; k++) {
        double d = c->parent[list[k]] != FRAME_TRANSFER_NONE ? distance(c, i, list[k]) : INFINITY;
        if (d > least || d == INFINITY || (d == least && list[k] > nearest)) continue;
        least = d;
        nearest = list[k];
    }
    return nearest;
}

/* Position of a point in the previous frame. For a born point: moved back as the nearest carried point, or
 * else by the motion of the whole surface. */
static vec3 origin_of(const candidates *c, size_t i)
{
    uint32_t guide = c->parent[i] == FRAME_TRANSFER_NONE ? nearest_carried(c, i) : (uint32_t)i;
    vec3 x = c->position[i];
    if (guide == FRAME_TRANSFER_NONE) return vec3_sub(vec3_scale(x, 2), registration_apply(&c->motion, x));
    vec3 origin = c->params->position[c->parent[guide]];
    return guide == i ? origin : vec3_sub(x, vec3_sub(c->position[guide], origin));
}

/* Copies the taken candidates to the result, in Morton order. */
static bool hand_over(candidates *c, frame_transfer *out, error *e)
{
    const char *what = "carried points";
    close_gaps(c);
    size_t n = c->count;
    uint32_t *order = mem_array(n, sizeof *order, what, e);
    bool *seen = mem_array(c->allotted.samples.count + 1, sizeof *seen, what, e);
    bool ok = order && seen && (out->position = mem_array(n, sizeof *out->position, what, e)) &&
              (out->normal = mem_array(n, sizeof *out->normal, what, e)) &&
              (out->landed = mem_array(n, sizeof *out->landed, what, e)) &&
              (out->origin = mem_array(n, sizeof *out->origin, what, e)) &&
              (out->parent = mem_array(n, sizeof *out->parent, what, e)) &&
              morton_order(c->position, n, c->pool, order, e) && build_lists(c, NEAR, e);
    if (ok && c->f->patches) ok = (out->patch = mem_array(n, sizeof *out->patch, what, e)) != NULL;
    if (ok && (c->f->patches || c->params->fixed_count > 0))
        ok = (out->place = mem_array(n, sizeof *out->place, what, e)) != NULL;
    if (ok && c->params->fixed_count > 0)
        ok = (out->fixed = mem_array(n, sizeof *out->fixed, what, e)) != NULL;
    for (size_t k = 0; ok && k < n; k++) {
        uint32_t i = order[k];
        const bool is_on_curve = c->row[i] < c->allotted.samples.count;
        out->position[k] = c->position[i];
        out->normal[k] = c->normal[i];
        if (out->patch) out->patch[k] = c->part[i];
        if (out->place) out->place[k] = c->row[i];
        if (is_on_curve && seen[c->row[i]]) continue;
        if (is_on_curve) seen[c->row[i]] = true;
        const size_t point = out->count++;
        if (out->fixed) out->fixed[point] = i < c->fixed ? c->own[i] : FRAME_TRANSFER_NONE;
        out->landed[point] = c->landed[i];
        out->parent[point] = c->parent[i];
        out->origin[point] = origin_of(c, i);
        out->born += c->parent[i] == FRAME_TRANSFER_NONE;
    }
    free(order);
    free(seen);
    if (!ok) return false;
    out->particles = n;
    out->motion = c->motion;
    out->died = c->params->previous_count - (out->count - out->born);
    return true;
}

/* Distributes the points among patches and curves, by the same quota as the solve. */
static bool allot(candidates *c, error *e)
{
    const quota_input in = {c->f, c->scan, c->params->sizing, c->h, false, c->pool};
    if (!c->f->patches) return true;
    if (!quota_for_count(&in, c->params->count, &c->allotted, e)) return false;
    c->wanted = quota_particles(&c->allotted);
    c->h = c->allotted.spacing;
    return true;
}

/* Number of carried points that are still taken. Points on curves may count several times. */
static size_t count_survivors(const candidates *c)
{
    size_t count = c->carried - c->fixed;
    for (size_t i = 0; i < c->fixed; i++) count += c->parent[i] != FRAME_TRANSFER_NONE;
    return count;
}

bool frame_transfer_points(const field *f, const surface *scan, const frame_transfer_params *params,
                           threads *pool, frame_transfer *out, error *e)
{
    candidates c = {.f = f, .scan = scan, .params = params, .pool = pool};
    c.h = packing_spacing(scan->area, (double)params->count);
    c.wanted = params->count;
    c.box = bbox_grow(scan->box, FARTHEST * fmax(c.h, f->cell_size));
    *out = (frame_transfer){0};
    bool ok = allot(&c, e) && candidates_make(&c, e) && carry_all(&c, e);
    if (ok && !params->is_still &&
        (double)count_survivors(&c) < SAME_SURFACE * (double)params->previous_count)
        out->died = params->previous_count;
    else
        ok = ok && populate(&c, e) && hand_over(&c, out, e);
    candidates_free(&c);
    return ok;
}
