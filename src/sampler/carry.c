#include "sampler/carry.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "geometry/morton.h"
#include "sampler/levels.h"
#include "sampler/neighbours.h"
#include "sampler/project.h"

/* On the surface to this fraction of the spacing; the relaxation does the rest. */
static const double LANDED = 1e-3;
static const int LANDING_STEPS = 20;
/* A point that lands farther outside of the surface's box than this, in spacings, ran off. */
static const double FARTHEST = 1;
/* Cosine of the angle from which on two points, or a point and where it landed, are of different sheets. */
static const double OTHER_SHEET = 0.5;
/* Points closer than this, of the spacing, cannot both stay: a packing that is relaxed has none below 0.8. */
static const double CROWDED = 0.6;
/* A place so far from every point, of the spacing, is a hole. Corners of ideal cells are at 0.58, the middle
 * of a vacancy is at 1. What is filled with points so far from each other, at random, is as dense as a
 * packing. */
static const double HOLE = 0.78;
/* When fewer than this share can be carried the surface is another one. */
static const double SAME_SURFACE = 0.5;
/* Within this, of the spacing, lie the neighbours of a point and no others. */
static const double NEAR = 1.3;
/* Places that are looked at for births, of the count. */
static const size_t PLACES = 2;
/* Draws for one of them. */
static const int DRAWS = 20;
/* Distances, of the spacing, that births of one frame keep, the next one when there is no more room. */
static const double birth_distance[] = {1.3, 0.8, 0.4, 0};
enum { BIRTH_DISTANCES = sizeof birth_distance / sizeof birth_distance[0] };
/* Random numbers have their own stream. */
enum { CARRY_STREAM = 5 };

/* Points that were carried, from 0 on, and after them places where others may be born. */
typedef struct crowd {
    const field *f;
    const surface *scan;
    const carry_params *params;
    threads *pool;
    motion motion;
    bbox box; /* nothing lands outside */
    double h; /* of an even packing */
    size_t carried, count;
    vec3 *position, *normal;
    double *spacing;
    uint32_t *parent; /* of the carried */
    bool *taken;      /* is one of the points */
    double *rank;     /* how crowded a point, how empty a place is: the largest first */
    uint32_t *order;
    neighbours *near;
} crowd;

void carried_free(carried *c)
{
    if (!c) return;
    free(c->position);
    free(c->normal);
    free(c->origin);
    free(c->parent);
    *c = (carried){0};
}

static void crowd_free(crowd *c)
{
    free(c->position);
    free(c->normal);
    free(c->spacing);
    free(c->parent);
    free(c->taken);
    free(c->rank);
    free(c->order);
    neighbours_free(c->near);
}

static bool crowd_make(crowd *c, error *e)
{
    const char *what = "carried points";
    size_t room = c->params->previous_count + PLACES * c->params->count;
    return (c->position = mem_array(room, sizeof *c->position, what, e)) &&
           (c->normal = mem_array(room, sizeof *c->normal, what, e)) &&
           (c->spacing = mem_array(room, sizeof *c->spacing, what, e)) &&
           (c->parent = mem_array(room, sizeof *c->parent, what, e)) &&
           (c->taken = mem_array(room, sizeof *c->taken, what, e)) &&
           (c->rank = mem_array(room, sizeof *c->rank, what, e)) &&
           (c->order = mem_array(room, sizeof *c->order, what, e)) &&
           (c->near = neighbours_new(room, SIZE_MAX, e));
}

/* Onto the surface, from anywhere. */
static bool land(const crowd *c, vec3 *x, vec3 *normal)
{
    double accept = LANDED * c->h;
    const project_limits limits = {LANDING_STEPS, accept, accept, accept};
    return project_point(c->f, &limits, x, normal) && bbox_contains(c->box, *x);
}

/* A point that lay in a face of the domain stays in it. Points were written in single precision, perhaps. */
static vec3 keep_in_faces(const field *f, vec3 before, vec3 x)
{
    for (int axis = 0; f->open && axis < 3; axis++) {
        float v = (float)vec3_get(before, axis);
        double low = vec3_get(f->rims.min, axis), high = vec3_get(f->rims.max, axis);
        if (v == (float)low) vec3_set(&x, axis, low);
        if (v == (float)high) vec3_set(&x, axis, high);
    }
    return x;
}

static void carry_chunk(void *context, int worker, size_t begin, size_t end)
{
    crowd *c = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        vec3 before = c->params->position[i],
             x = keep_in_faces(c->f, before, motion_apply(&c->motion, before));
        vec3 faced = motion_turn(&c->motion, c->params->normal[i]);
        bool left = c->f->open && project_rim_axes(c->f, x) == 0 && !bbox_contains(c->f->domain, x);
        c->taken[i] = !left && land(c, &x, &c->normal[i]) && vec3_dot(faced, c->normal[i]) > OTHER_SHEET;
        c->position[i] = x;
    }
}

/* The requested spacing where the points from `first` on are. */
static void set_spacings(crowd *c, size_t first)
{
    if (c->params->grading)
        grading_spacings(c->params->grading, c->count - first, c->position + first, c->spacing + first);
    else
        for (size_t i = first; i < c->count; i++) c->spacing[i] = c->h;
}

/* Closes the gaps that those who are not taken leave among the carried; no places are there yet. */
static void close_gaps(crowd *c)
{
    size_t kept = 0;
    for (size_t i = 0; i < c->count; i++) {
        if (!c->taken[i]) continue;
        c->position[kept] = c->position[i];
        c->normal[kept] = c->normal[i];
        c->spacing[kept] = c->spacing[i];
        c->parent[kept] = c->parent[i];
        c->taken[kept++] = true;
    }
    for (size_t i = kept; i < c->count; i++) c->taken[i] = false;
    c->carried = c->count = kept;
}

/* After a stop there are no lists that could be looked at. */
static bool build_lists(crowd *c, double reach, error *e)
{
    if (c->count > 0 && !neighbours_build(c->near, c->count, c->position, c->spacing, reach, c->pool, e))
        return false;
    return !threads_stopped(c->pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

/* How far two are apart, of their spacing; INFINITY: on different sheets. */
static double distance(const crowd *c, size_t i, size_t j)
{
    if (!(vec3_dot(c->normal[i], c->normal[j]) > OTHER_SHEET)) return INFINITY;
    return vec3_norm(vec3_sub(c->position[i], c->position[j])) / (0.5 * (c->spacing[i] + c->spacing[j]));
}

/* Whether a point from `first` on that is taken lies within `reach` of i. */
static bool has_near(const crowd *c, size_t i, double reach, size_t first)
{
    const uint32_t *list = neighbours_list(c->near, i);
    for (uint32_t k = 0; k < c->near->list_count[i]; k++)
        if (list[k] >= first && c->taken[list[k]] && distance(c, i, list[k]) < reach) return true;
    return false;
}

/* Carries the points, and lets go who did not arrive or crowds another. */
static bool carry_all(crowd *c, error *e)
{
    const carry_params *p = c->params;
    c->motion = motion_find(c->f, p->position, p->previous_count, c->h, c->pool);
    threads_run(c->pool, p->previous_count, 256, carry_chunk, c);
    if (threads_stopped(c->pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    c->count = p->previous_count;
    for (size_t i = 0; i < c->count; i++) c->parent[i] = (uint32_t)i;
    close_gaps(c);
    set_spacings(c, 0);
    if (!build_lists(c, CROWDED, e)) return false;
    for (size_t i = 0; i < c->count; i++) c->taken[i] = false;
    for (int inner = 0; inner <= 1; inner++) /* who is on a rim first: it is to stay closed */
        for (size_t i = 0; i < c->count; i++)
            if (inner == (project_rim_axes(c->f, c->position[i]) == 0))
                c->taken[i] = !has_near(c, i, CROWDED, 0);
    close_gaps(c);
    return true;
}

/* The three points nearest to a place; false: there are fewer. */
static bool find_corners(const crowd *c, size_t place, uint32_t corner[3])
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

/* Places go to the middle between the points around them: as far from all as can be, which at the core of a
 * dislocation is farther than elsewhere. Those by which there are fewer, or that would go far, stay. */
static void centre_chunk(void *context, int worker, size_t begin, size_t end)
{
    crowd *c = context;
    (void)worker;
    for (size_t i = begin + c->carried; i < end + c->carried; i++) {
        uint32_t corner[3];
        if (!find_corners(c, i, corner)) continue;
        vec3 a = c->position[corner[0]], ab = vec3_sub(c->position[corner[1]], a),
             ac = vec3_sub(c->position[corner[2]], a), n = vec3_cross(ab, ac), normal;
        vec3 to = vec3_add(vec3_scale(vec3_cross(n, ab), vec3_norm2(ac)),
                           vec3_scale(vec3_cross(ac, n), vec3_norm2(ab)));
        vec3 x = vec3_axpy(1 / (2 * vec3_norm2(n)), to, a);
        if (!(vec3_norm(vec3_sub(x, c->position[i])) < c->spacing[i]) || !land(c, &x, &normal)) continue;
        c->position[i] = x;
        c->normal[i] = normal;
    }
}

/* Places all over the surface, PLACES for each point that there is to be. */
static bool draw_places(crowd *c, error *e)
{
    rng r = rng_seed(c->params->seed, CARRY_STREAM);
    size_t places = PLACES * c->params->count;
    for (size_t k = 0; k < places; k++) {
        if (threads_stopped(c->pool)) return error_set(e, ERROR_CANCELLED, "stopped");
        for (int draw = 0; draw < DRAWS; draw++) {
            double where = ((double)k + rng_uniform(&r)) / (double)places;
            vec3 x = grading_draw(c->params->grading, c->scan, where, &r), n;
            if (!land(c, &x, &n)) continue;
            c->position[c->count] = x;
            c->normal[c->count++] = n;
            break;
        }
    }
    set_spacings(c, c->carried);
    if (!build_lists(c, NEAR, e)) return false;
    threads_run(c->pool, c->count - c->carried, 256, centre_chunk, c);
    return build_lists(c, NEAR, e);
}

/* How far a place is from the nearest point, how crowded a point is by all. */
static void rank_chunk(void *context, int worker, size_t begin, size_t end)
{
    crowd *c = context;
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

/* Ranks all, and orders those from `first` to before `end`, the largest first. */
static void rank_all(crowd *c, size_t first, size_t end)
{
    threads_run(c->pool, c->count, 256, rank_chunk, c);
    for (size_t i = first; i < end; i++) c->order[i] = (uint32_t)i;
    qsort_r(c->order + first, end - first, sizeof *c->order, compare_rank, c->rank);
}

/* Takes at most `most` places, the emptiest first, that are at least `gap` from the carried and `apart` from
 * each other. Returns how many. */
static size_t give_birth(crowd *c, double gap, double apart, size_t most)
{
    size_t born = 0;
    for (size_t k = c->carried; k < c->count && born < most; k++) {
        uint32_t i = c->order[k];
        if (c->rank[i] < gap) break;
        if (c->taken[i] || has_near(c, i, apart, c->carried)) continue;
        c->taken[i] = true;
        born++;
    }
    return born;
}

/* Whether a neighbour of i was let go just now. */
static bool has_lost(const crowd *c, size_t i)
{
    const uint32_t *list = neighbours_list(c->near, i);
    for (uint32_t k = 0; k < c->near->list_count[i]; k++)
        if (list[k] < c->carried && !c->taken[list[k]]) return true;
    return false;
}

/* Lets go so many of the carried, the most crowded first; no two neighbours if `spread`. Returns how many. */
static size_t thin_out(crowd *c, bool spread, size_t most)
{
    size_t died = 0;
    for (size_t k = 0; k < c->carried && died < most; k++) {
        uint32_t i = c->order[k];
        if (!c->taken[i] || (spread && has_lost(c, i))) continue;
        c->taken[i] = false;
        died++;
    }
    return died;
}

/* Fills the holes and comes to the exact count. */
static bool populate(crowd *c, error *e)
{
    size_t count = c->params->count, there = c->carried;
    rank_all(c, c->carried, c->count);
    there += give_birth(c, HOLE, HOLE, count);
    for (int k = 0; k < BIRTH_DISTANCES && there < count; k++)
        there += give_birth(c, 0, birth_distance[k], count - there);
    if (there < count)
        return error_set(e, ERROR_NO_SURFACE, "particle %zu of %zu does not reach the surface in %d draws",
                         there + 1, count, DRAWS);
    if (there > count) {
        rank_all(c, 0, c->carried);
        there -= thin_out(c, true, there - count);
        there -= thin_out(c, false, there - count);
    }
    return true;
}

/* The carried point that is nearest to a place; CARRY_NONE: none is near. */
static uint32_t nearest_carried(const crowd *c, size_t place)
{
    const uint32_t *list = neighbours_list(c->near, place);
    uint32_t nearest = CARRY_NONE;
    double least = INFINITY;
    for (uint32_t k = 0; k < c->near->list_count[place]; k++) {
        double d = list[k] < c->carried ? distance(c, place, list[k]) : INFINITY;
        if (d > least || d == INFINITY || (d == least && list[k] > nearest)) continue;
        least = d;
        nearest = list[k];
    }
    return nearest;
}

/* Where a place would have been in the frame before: it went the way of the nearest point, or of the
 * whole. */
static vec3 origin_of(const crowd *c, size_t place)
{
    uint32_t guide = nearest_carried(c, place);
    vec3 x = c->position[place];
    if (guide == CARRY_NONE) return vec3_sub(vec3_scale(x, 2), motion_apply(&c->motion, x));
    return vec3_sub(x, vec3_sub(c->position[guide], c->params->position[c->parent[guide]]));
}

/* Those that are taken, in the order in which they are to be kept. */
static bool hand_over(const crowd *c, carried *out, error *e)
{
    const char *what = "carried points";
    size_t n = c->params->count, next = 0;
    bool ok = false;
    uint32_t *member = mem_array(n, sizeof *member, what, e), *order = mem_array(n, sizeof *order, what, e);
    vec3 *place = mem_array(n, sizeof *place, what, e);
    if (!member || !order || !place || !(out->position = mem_array(n, sizeof *out->position, what, e)) ||
        !(out->normal = mem_array(n, sizeof *out->normal, what, e)) ||
        !(out->origin = mem_array(n, sizeof *out->origin, what, e)) ||
        !(out->parent = mem_array(n, sizeof *out->parent, what, e)))
        goto done;
    for (size_t i = 0; i < c->count; i++)
        if (c->taken[i]) member[next++] = (uint32_t)i;
    for (size_t k = 0; k < n; k++) place[k] = c->position[member[k]];
    if (!morton_order(place, n, order, e)) goto done;
    out->count = n;
    out->motion = c->motion;
    for (size_t k = 0; k < n; k++) {
        uint32_t i = member[order[k]];
        bool born = i >= c->carried;
        out->position[k] = c->position[i];
        out->normal[k] = c->normal[i];
        out->parent[k] = born ? CARRY_NONE : c->parent[i];
        out->origin[k] = born ? origin_of(c, i) : c->params->position[c->parent[i]];
        out->born += born;
    }
    out->died = c->params->previous_count - (n - out->born);
    ok = true;
done:
    free(member);
    free(order);
    free(place);
    return ok;
}

bool carry_points(const field *f, const surface *scan, const carry_params *params, threads *pool,
                  carried *out, error *e)
{
    crowd c = {.f = f, .scan = scan, .params = params, .pool = pool};
    c.h = levels_spacing(scan->area, params->count);
    c.box = bbox_grow(scan->box, FARTHEST * fmax(c.h, f->cell_size));
    *out = (carried){0};
    bool ok = crowd_make(&c, e) && carry_all(&c, e);
    if (ok && (double)c.carried < SAME_SURFACE * (double)params->previous_count)
        out->died = params->previous_count;
    else
        ok = ok && draw_places(&c, e) && populate(&c, e) && hand_over(&c, out, e);
    crowd_free(&c);
    return ok;
}
