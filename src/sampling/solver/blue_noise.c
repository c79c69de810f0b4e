// SPDX-License-Identifier: Apache-2.0
/* blue_noise: points without regular packing, as a solver_method (solver_state.h). See "Blue noise" in
 * doc/method.md.
 *
 * The particles start at random positions. A few steps on the energy of the packing equalise their density.
 * Each further step corrects only pairs that are too close and places that are too far from all particles.
 * The steps are those of all particles at once (Jacobi), so that the result does not depend on the number of
 * threads. Particles of all patches interact, and none is held on a curve.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/box_tree.h"
#include "sampling/packing/neighbours.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/passes/passes.h"
#include "sampling/solver/solver_state.h"
#include "sampling/voronoi/resolution.h"

/* Number of Newton steps on the energy. Fewer: more power at low frequencies; more: a more regular
 * packing. */
enum { ENERGY_STEPS = 4 };
/* Longest step, in spacings. Longer: particles pass each other. */
static const double LONGEST_STEP = 0.3;
/* Maximum number of corrections. On smooth surfaces 30 to 110 suffice; the last ones move few particles. */
enum { MAX_CORRECTIONS = 200 };
/* Distances that corrections aim at, in spacings: of pairs, and of places from their nearest particle. Nearer
 * to the bounds: the corrections converge slowly; beyond them: more regular points. */
static const double PAIR_DISTANCE = 0.75, PLACE_DISTANCE = 0.76;
/* Fraction of a deviation that each particle concerned corrects in one step. */
static const double CORRECTION = 0.5;
/* Deviations below this are not corrected, in spacings. It is smaller than the margin between the bounds and
 * the distances that corrections aim at. Smaller: more particles move in each step. */
static const double LEAST_CORRECTION = 0.002;
/* Number of corrections without fewer particles that miss a bound after which the points are stuck. */
enum { PATIENCE = 40 };
/* Convergence: the bounds of pairs and places, in spacings. They are narrower than SOLVER_BLUE_NOISE_LEAST
 * and SOLVER_BLUE_NOISE_COVERAGE, because places of smooth surfaces are examined only near corners of
 * cells in the tangent plane. */
static const double LEAST = SOLVER_BLUE_NOISE_LEAST + 0.005,
                    COVERAGE = SOLVER_BLUE_NOISE_LEAST * SOLVER_BLUE_NOISE_COVERAGE;
/* Cutoff of the neighbour lists, in spacings: twice the largest distance of a place in a nearly converged
 * set. */
static const double CUTOFF = 2;
/* Reach of the lists beyond the cutoff (Verlet skin), in spacings. Larger: fewer builds of longer lists. */
static const double SKIN = 0.2;
/* Half the side of the square of the tangent plane, or of the cube, that a Voronoi cell is cut from, in
 * spacings. Larger: cells take more time, and beyond half of the cutoff the lists do not have all
 * neighbours of a place; smaller: large holes are closed more slowly. */
static const double CELL_SIDE = 0.9;
/* Distance in the tangent plane, in spacings, below which a place of a curved surface is nearer than
 * PLACE_DISTANCE. */
static const double EXAMINED = 0.73;
/* Bisections that find the end of the surface along a step or a probe. */
enum { BISECTIONS = 8 };
/* Maximum distance, in spacings, of the places at which one patch ends and the next begins: the step of
 * the last bisection. */
static const double MAX_CROSSING = 0.05;
/* Directions and length, in spacings, in which an energy step searches the end of the surface. The length is
 * half of the support: farther from the end no mirrored particle is within the support. */
enum { PROBES = 6 };
static const double PROBE = 0.87;
/* Least determinant of the Hessian over the square of its trace: below it, all neighbours lie in one
 * direction. */
static const double LEAST_DETERMINANT = 1e-9;
/* Maximum number of neighbours that a Voronoi cell is made from; a list has about 20. */
enum { MAX_NEAR = 64 };
/* Maximum number of corners of a Voronoi cell; a cell has 6 on average. */
enum { MAX_CORNERS = 64 };

typedef struct point2 {
    double x, y;
} point2;

/* A place of the surface. */
typedef struct surface_place {
    vec3 position, normal;
    uint32_t patch, hint;
} surface_place;

/* A triangle of the surface. */
typedef struct facet {
    vec3 corner[3];
    uint32_t patch;
} facet;

typedef struct blue_noise_state {
    neighbours *near;
    vec3 *anchor;     /* position at the last list build */
    bool lists_stale; /* a particle has moved by half of the skin since then */
    bool corrects;    /* the step is a correction */
    bool only_pairs;  /* which leaves places that are too far: not all points can meet both bounds */
    bool has_borders; /* the surface ends somewhere */
    size_t best;      /* least number of particles that miss a bound up to now */
    size_t best_at;   /* the step before which they were counted */
    /* of a surface with patches */
    facet *facets; /* in the order of the tree */
    box_tree tree;
    /* The particles that take the step: those that have moved in the last one, and their neighbours. */
    uint32_t *active;
    size_t active_count;
    bool *is_active;
    surface_place *next; /* of each active particle, after the step */
    bool *misses;        /* per particle: it or its cell misses a bound */
} blue_noise_state;

static double spacing_of(const solver *s, size_t i)
{
    return s->state.spacing * particles_size(s->state.p, i);
}

static bool is_one_sided(const particles *p, uint32_t patch)
{
    return p->patch && p->patches->patch[patch].one_sided;
}

static bool is_opposite(const particles *p, size_t i, uint32_t patch, vec3 normal)
{
    const double cosine = vec3_dot(p->normal[i], normal);
    return (is_one_sided(p, patch) && p->patch[i] == patch ? fabs(cosine) : cosine) <= RESOLUTION_OPPOSITE;
}

/* ---- places on the surface */

/* The place at d from another one, projected onto the same patch. False: the patch does not reach there. Beside the
 * end of a crease, a search from the triangle of the other place may end at a triangle that is not the nearest. */
static bool reach(const solver *s, const surface_place *from, vec3 d, double h, surface_place *out)
{
    const projection_limits limits = solver_rounding(h);
    const field *f = field_of_patch(s->setup.field, from->patch);
    const vec3 target = vec3_add(from->position, d);
    surface_place to = *from;
    to.position = target;
    to.hint = FIELD_NO_HINT;
    if (!projection_find_near(f, &limits, &to.hint, &to.position, &to.normal) ||
        vec3_norm(vec3_sub(to.position, target)) > fmax(LONGEST_STEP * h, vec3_norm(d)))
        return false;
    if (s->setup.field->patches && !field_is_within_near(f, to.position, &to.hint)) return false;
    if (vec3_dot(to.normal, from->normal) <= RESOLUTION_OPPOSITE && !is_one_sided(s->state.p, to.patch))
        return false;
    *out = to;
    return true;
}

/* reach, not as far as to the faces that cut the surface: on them a particle would not leave them again. */
static bool reach_inside(const solver *s, const surface_place *from, vec3 d, double h, surface_place *out)
{
    surface_place to;
    if (!reach(s, from, d, h, &to) || projection_boundary_axes(s->setup.field, to.position) != 0)
        return false;
    *out = to;
    return true;
}

static surface_place place_of(const solver *s, size_t i)
{
    const particles *p = s->state.p;
    return (surface_place){p->position[i], p->normal[i], particles_patch(p, i),
                           p->hint ? p->hint[i] : FIELD_NO_HINT};
}

/* v turned as the unit vector `from` is turned to `to`. Across a crease, whose direction is the axis, this
 * unfolds the surface. */
static vec3 turned(vec3 v, vec3 from, vec3 to)
{
    const vec3 sum = vec3_add(from, to);
    const double along = vec3_dot(sum, v) / (1 + vec3_dot(from, to));
    return vec3_axpy(2 * vec3_dot(from, v), to, vec3_axpy(-along, sum, v));
}

/* Continues along d from a place at a curve on the patch of a neighbour of particle i. False: no patch
 * begins there. */
static bool cross(const solver *s, size_t i, const surface_place *end, vec3 d, double h, surface_place *out)
{
    const particles *p = s->state.p;
    const neighbours *near = s->state.blue_noise->near;
    const uint32_t *list = neighbours_list(near, i);
    const projection_limits limits = solver_rounding(h);
    double best = MAX_CROSSING * h;
    bool found = false;
    for (uint32_t k = 0; k < near->list_count[i]; k++) {
        const uint32_t patch = p->patch[list[k]];
        surface_place begin = *end, to;
        if (patch == end->patch || (k > 0 && patch == p->patch[list[k - 1]])) continue;
        begin.patch = patch;
        begin.hint = FIELD_NO_HINT;
        if (!projection_find_near(field_of_patch(s->setup.field, patch), &limits, &begin.hint,
                                  &begin.position, &begin.normal))
            continue;
        const double distance = vec3_norm(vec3_sub(begin.position, end->position));
        if (distance >= best || vec3_dot(begin.normal, end->normal) <= RESOLUTION_OPPOSITE ||
            !reach_inside(s, &begin, turned(d, end->normal, begin.normal), h, &to))
            continue;
        best = distance;
        found = true;
        *out = to;
    }
    return found;
}

/* Goes from particle i along d as far as its patch reaches. Returns the fraction of d. */
static double go_on_patch(const solver *s, size_t i, vec3 d, double h, surface_place *out)
{
    const surface_place from = place_of(s, i);
    double low = 0, high = 1;
    *out = from;
    if (reach_inside(s, &from, d, h, out)) return 1;
    for (int k = 0; k < BISECTIONS; k++) {
        const double middle = 0.5 * (low + high);
        const bool reached = reach_inside(s, &from, vec3_scale(d, middle), h, out);
        *(reached ? &low : &high) = middle;
    }
    return low;
}

/* The same across the curves at which patches meet. True: to the end of d. */
static bool go(const solver *s, size_t i, vec3 d, double h, surface_place *out)
{
    const double share = go_on_patch(s, i, d, h, out);
    if (share == 1 || !s->state.p->patch) return share == 1;
    const surface_place end = *out;
    return cross(s, i, &end, vec3_scale(d, 1 - share), h, out);
}

/* ---- Voronoi cells */

/* A neighbour of a particle. */
typedef struct near_particle {
    uint32_t index;
    bool is_opposite; /* on an opposite wall: it cuts cells on a third wall only */
    vec3 d;           /* from the particle */
    double distance;
} near_particle;

/* A particle and its neighbours. */
typedef struct surroundings {
    size_t own;
    double h;
    vec3 position, normal;
    int count;
    near_particle near[MAX_NEAR];
} surroundings;

static void surroundings_of(const solver *s, size_t i, surroundings *out)
{
    const particles *p = s->state.p;
    const neighbours *near = s->state.blue_noise->near;
    const uint32_t *list = neighbours_list(near, i);
    out->own = i;
    out->h = spacing_of(s, i);
    out->position = p->position[i];
    out->normal = p->normal[i];
    out->count = 0;
    for (uint32_t k = 0; k < near->list_count[i]; k++) {
        const uint32_t j = list[k];
        const vec3 d = vec3_sub(p->position[j], out->position);
        const double distance = vec3_norm(d);
        int at = out->count < MAX_NEAR ? out->count++ : MAX_NEAR;
        for (; at > 0 && out->near[at - 1].distance > distance; at--)
            if (at < MAX_NEAR) out->near[at] = out->near[at - 1];
        if (at < MAX_NEAR)
            out->near[at] =
                (near_particle){j, is_opposite(p, i, particles_patch(p, j), p->normal[j]), d, distance};
    }
}

/* d turned into the tangent plane, with the same length: across a crease the particle has to go this far.
 * 0: d has no direction there. */
static vec3 in_tangent_plane(const surroundings *a, vec3 d)
{
    const vec3 flat_d = vec3_axpy(-vec3_dot(d, a->normal), a->normal, d);
    const double length2 = vec3_norm2(flat_d);
    return length2 > 0 ? vec3_scale(flat_d, sqrt(vec3_norm2(d) / length2)) : flat_d;
}

/* A convex part of a plane. */
typedef struct polygon {
    int count;
    vec3 corner[MAX_CORNERS]; /* relative to the particle */
} polygon;

/* Cuts off the places x with dot(normal, x) > offset. */
static void cut(polygon *p, vec3 normal, double offset)
{
    double beyond[MAX_CORNERS], most = -INFINITY;
    for (int k = 0; k < p->count; k++) {
        beyond[k] = vec3_dot(normal, p->corner[k]) - offset;
        most = beyond[k] > most ? beyond[k] : most;
    }
    if (!(most > 0)) return;
    polygon rest;
    rest.count = 0;
    for (int k = 0; k < p->count && rest.count < MAX_CORNERS - 1; k++) {
        const int next = k + 1 < p->count ? k + 1 : 0;
        const bool in = beyond[k] <= 0, next_in = beyond[next] <= 0;
        if (in) rest.corner[rest.count++] = p->corner[k];
        if (in == next_in || beyond[k] == 0 || beyond[next] == 0) continue;
        const double share = beyond[k] / (beyond[k] - beyond[next]);
        rest.corner[rest.count++] = vec3_axpy(share, vec3_sub(p->corner[next], p->corner[k]), p->corner[k]);
    }
    p->count = rest.count;
    memcpy(p->corner, rest.corner, (size_t)rest.count * sizeof *rest.corner);
}

static double farthest_corner2(const polygon *p)
{
    double farthest2 = 0;
    for (int k = 0; k < p->count; k++) {
        const double own2 = vec3_norm2(p->corner[k]);
        farthest2 = own2 > farthest2 ? own2 : farthest2;
    }
    return farthest2;
}

/* Cuts off what is nearer to a neighbour that is not on an opposite wall of the polygon, which has this patch
 * and normal. Ends when no place is farther than `enough`. Returns the distance of the farthest corner. */
static double cut_to_cell(const solver *s, const surroundings *a, uint32_t patch, vec3 normal, double enough,
                          polygon *p)
{
    double farthest2 = farthest_corner2(p);
    for (int n = 0; n < a->count && farthest2 > enough * enough; n++) {
        const double distance2 = vec3_norm2(a->near[n].d);
        if (distance2 >= 4 * farthest2) break;
        if (is_opposite(s->state.p, a->near[n].index, patch, normal)) continue;
        cut(p, a->near[n].d, 0.5 * distance2);
        farthest2 = farthest_corner2(p);
    }
    return sqrt(farthest2);
}

/* Cuts off what is outside of a box. */
static void cut_to_box(polygon *p, const bbox *box)
{
    for (int axis = 0; axis < 3; axis++) {
        vec3 n = {0, 0, 0};
        vec3_set(&n, axis, 1);
        if (isfinite(vec3_get(box->max, axis))) cut(p, n, vec3_get(box->max, axis));
        if (isfinite(vec3_get(box->min, axis))) cut(p, vec3_scale(n, -1), -vec3_get(box->min, axis));
    }
}

/* Whether a polygon is nearer to one neighbour than to the particle everywhere. */
static bool is_outside_cell(const solver *s, const surroundings *a, uint32_t patch, vec3 normal,
                            const polygon *p)
{
    for (int n = 0; n < a->count; n++) {
        const double half = 0.5 * a->near[n].distance * a->near[n].distance;
        int beyond = 0;
        while (beyond < p->count && vec3_dot(a->near[n].d, p->corner[beyond]) > half) beyond++;
        if (beyond == p->count && !is_opposite(s->state.p, a->near[n].index, patch, normal)) return true;
    }
    return false;
}

/* A far place of a cell. */
typedef struct far_place {
    double distance; /* from the nearest particle; at first the distance above which places are searched */
    vec3 d;          /* from the particle */
} far_place;

/* Takes the farthest corner of the part of a facet in the cell and in the cube, if it is farther than *far.
 * The distance in space has its maximum there. */
static void examine_facet(const solver *s, const surroundings *a, const bbox *cube, const facet *f,
                          far_place *far)
{
    bbox box = bbox_empty();
    polygon part;
    part.count = 3;
    for (int c = 0; c < 3; c++) {
        part.corner[c] = vec3_sub(f->corner[c], a->position);
        box = bbox_include(box, part.corner[c]);
    }
    if (!bbox_meet(&box, cube) || farthest_corner2(&part) <= far->distance * far->distance) return;
    const vec3 normal = vec3_unit(vec3_across(f->corner[0], f->corner[1], f->corner[2]));
    if (is_opposite(s->state.p, a->own, f->patch, normal) || is_outside_cell(s, a, f->patch, normal, &part))
        return;
    cut_to_box(&part, cube);
    const double distance = cut_to_cell(s, a, f->patch, normal, far->distance, &part);
    for (int c = 0; c < part.count && distance > far->distance; c++)
        if (vec3_norm(part.corner[c]) == distance) *far = (far_place){distance, part.corner[c]};
}

/* The cell in the facets. */
static void examine_facets(const solver *s, const surroundings *a, far_place *far)
{
    const blue_noise_state *b = s->state.blue_noise;
    const bbox cube = bbox_grow((bbox){{0, 0, 0}, {0, 0, 0}}, CELL_SIDE * a->h),
               where = bbox_move(cube, a->position);
    box_tree_walk w;
    box_tree_begin(&b->tree, &w);
    while (box_tree_next_meeting(&b->tree, &w, &where))
        for (size_t at = w.first; at < w.end; at++) examine_facet(s, a, &cube, &b->facets[at], far);
}

/* The distance of a place from the nearest of a particle and its neighbours. */
static double nearest_distance(const solver *s, const surroundings *a, const surface_place *at)
{
    const vec3 own = vec3_sub(at->position, a->position);
    double nearest2 = vec3_norm2(own);
    for (int n = 0; n < a->count; n++) {
        const double distance2 = vec3_norm2(vec3_sub(own, a->near[n].d));
        if (distance2 < nearest2 && !is_opposite(s->state.p, a->near[n].index, at->patch, at->normal))
            nearest2 = distance2;
    }
    return sqrt(nearest2);
}

/* The cell in the tangent plane, whose corners are projected onto the surface. */
static void examine_tangent_plane(const solver *s, const surroundings *a, far_place *far)
{
    const bbox box = bbox_move(s->setup.field->boundary_box, vec3_scale(a->position, -1));
    const double side = CELL_SIDE * a->h, examined = EXAMINED * a->h;
    const surface_place own = place_of(s, a->own);
    polygon cell = {.count = 4};
    vec3 u, v;
    vec3_frame(a->normal, &u, &v);
    for (int k = 0; k < 4; k++)
        cell.corner[k] = vec3_axpy(k == 0 || k == 3 ? -side : side, u, vec3_scale(v, k < 2 ? -side : side));
    cut_to_cell(s, a, own.patch, a->normal, 0, &cell);
    if (s->setup.field->open) cut_to_box(&cell, &box);
    for (int k = 0; k < cell.count; k++) {
        surface_place to;
        if (vec3_norm2(cell.corner[k]) <= examined * examined || !reach(s, &own, cell.corner[k], a->h, &to))
            continue;
        const double distance = nearest_distance(s, a, &to);
        if (distance > far->distance) *far = (far_place){distance, vec3_sub(to.position, a->position)};
    }
}

/* ---- steps */

static vec3 limited(vec3 d, double longest)
{
    const double length = vec3_norm(d);
    return length > longest ? vec3_scale(d, longest / length) : d;
}

/* Pushes the particle off neighbours that are too close; without such neighbours, pulls it towards the
 * farthest place of its cell. *misses: a distance is beyond the bounds. */
static vec3 correction(const solver *s, const surroundings *a, bool *misses)
{
    vec3 step = {0, 0, 0};
    *misses = false;
    for (int n = 0; n < a->count; n++) {
        const near_particle *near = &a->near[n];
        if (near->is_opposite) continue;
        const double h = 0.5 * (a->h + spacing_of(s, near->index)),
                     excess = PAIR_DISTANCE * h - near->distance;
        *misses |= near->distance < LEAST * h;
        if (excess > LEAST_CORRECTION * h && near->distance > 0)
            step = vec3_axpy(-CORRECTION * excess / near->distance, in_tangent_plane(a, near->d), step);
    }
    if (*misses || s->state.blue_noise->only_pairs) return step;
    far_place far = {PLACE_DISTANCE * a->h, {0, 0, 0}};
    if (s->state.p->patch)
        examine_facets(s, a, &far);
    else
        examine_tangent_plane(s, a, &far);
    const double excess = far.distance - PLACE_DISTANCE * a->h;
    *misses = far.distance > COVERAGE * a->h;
    if (excess > LEAST_CORRECTION * a->h)
        step = vec3_axpy(CORRECTION * excess / vec3_norm(far.d), in_tangent_plane(a, far.d), step);
    return step;
}

/* Forces and the first term of the Hessian (10) in the tangent frame. */
typedef struct newton_terms {
    double fx, fy, xx, xy, yy;
} newton_terms;

/* Adds a neighbour at `at`; `h`: the spacing of the pair. Returns the energy of the pair. */
static double add_pair(const solver *s, point2 at, double h, double weight, newton_terms *t)
{
    const energy_function *energy = s->setup.params.energy;
    const double distance = sqrt(at.x * at.x + at.y * at.y),
                 u = distance / (s->state.sigma / s->state.spacing * h);
    if (!(u < 1 && distance > 0)) return 0;
    const double x = at.x / distance, y = at.y / distance, force = weight * h * energy->first(u),
                 slope = weight * energy->second(u);
    t->fx += force * x;
    t->fy += force * y;
    t->xx += slope * x * x;
    t->xy += slope * x * y;
    t->yy += slope * y * y;
    return weight * energy->value(u);
}

/* A straight line: the places at `distance` along the unit vector `out`. */
typedef struct line {
    point2 out;
    double distance;
} line;

/* The tangent to the end of the surface near a particle, from places at which probes in several directions
 * end. False: the surface does not end within PROBE spacings. */
static bool find_border(const solver *s, const surroundings *a, const vec3 axis[2], line *out)
{
    point2 end[PROBES];
    double length[PROBES];
    int nearest = -1;
    for (int k = 0; k < PROBES; k++) {
        const double angle = 2 * M_PI * k / PROBES, reach_of = PROBE * a->h;
        const point2 v = {reach_of * elementary_cos(angle), reach_of * elementary_sin(angle)};
        surface_place to;
        length[k] = INFINITY;
        if (go(s, a->own, vec3_axpy(v.x, axis[0], vec3_scale(axis[1], v.y)), a->h, &to)) continue;
        const vec3 d = vec3_sub(to.position, a->position);
        end[k] = (point2){vec3_dot(d, axis[0]), vec3_dot(d, axis[1])};
        length[k] = elementary_hypot(end[k].x, end[k].y);
        if (nearest < 0 || length[k] < length[nearest]) nearest = k;
    }
    if (nearest < 0) return false;
    const int before = (nearest + PROBES - 1) % PROBES, after = (nearest + 1) % PROBES,
              beside = length[before] < length[after] ? before : after;
    const double angle = 2 * M_PI * nearest / PROBES;
    out->out = (point2){elementary_cos(angle), elementary_sin(angle)};
    if (length[beside] < INFINITY) {
        const double x = end[beside].y - end[nearest].y, y = end[nearest].x - end[beside].x,
                     norm = elementary_hypot(x, y), side = x * out->out.x + y * out->out.y < 0 ? -1 : 1;
        if (norm > 0) out->out = (point2){side * x / norm, side * y / norm};
    }
    out->distance = end[nearest].x * out->out.x + end[nearest].y * out->out.y;
    return true;
}

static point2 mirrored(const line *l, point2 v)
{
    const double beyond = 2 * (l->distance - v.x * l->out.x - v.y * l->out.y);
    return (point2){v.x + beyond * l->out.x, v.y + beyond * l->out.y};
}

/* One Newton step on the energy. Near the end of the surface the particles are mirrored at it: otherwise the
 * forces, which act from one side only, would move particles to the end. */
static vec3 energy_step(const solver *s, const surroundings *a)
{
    newton_terms t = {0};
    line border = {{0, 0}, INFINITY};
    vec3 axis[2];
    vec3_frame(a->normal, &axis[0], &axis[1]);
    const bool is_near_border = s->state.blue_noise->has_borders && find_border(s, a, axis, &border);
    if (is_near_border) {
        rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_BLUE_NOISE + a->own);
        add_pair(s, mirrored(&border, (point2){0, 0}), a->h, rng_uniform(&r), &t);
    }
    double energy = 0;
    for (int k = 0; k < a->count; k++) {
        if (a->near[k].is_opposite) continue;
        const vec3 d = in_tangent_plane(a, a->near[k].d);
        const point2 at = {vec3_dot(d, axis[0]), vec3_dot(d, axis[1])};
        const double h = 0.5 * (a->h + spacing_of(s, a->near[k].index));
        energy += add_pair(s, at, h, 1, &t);
        if (is_near_border) add_pair(s, mirrored(&border, at), h, 1, &t);
    }
    s->state.p->energy[a->own] = (float)energy;
    const double determinant = t.xx * t.yy - t.xy * t.xy, trace = t.xx + t.yy,
                 scale = s->state.sigma / s->state.spacing / determinant;
    if (!(determinant > LEAST_DETERMINANT * trace * trace)) return (vec3){0, 0, 0};
    return vec3_axpy(scale * (t.yy * t.fx - t.xy * t.fy), axis[0],
                     vec3_scale(axis[1], scale * (t.xx * t.fy - t.xy * t.fx)));
}

/* The particle after its step. */
static surface_place next_place(solver *s, size_t i)
{
    blue_noise_state *b = s->state.blue_noise;
    surroundings a;
    surroundings_of(s, i, &a);
    surface_place to = place_of(s, i);
    const vec3 full = b->corrects ? correction(s, &a, &b->misses[i]) : energy_step(s, &a);
    if (vec3_norm2(full) > 0) go(s, i, limited(full, LONGEST_STEP * a.h), a.h, &to);
    return to;
}

static void step_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    blue_noise_state *b = s->state.blue_noise;
    (void)worker;
    for (size_t k = begin; k < end; k++) b->next[k] = next_place(s, b->active[k]);
}

static size_t count_misses(const solver *s)
{
    size_t count = 0;
    for (size_t i = 0; i < s->state.p->count; i++) count += s->state.blue_noise->misses[i];
    return count;
}

/* The particles of is_active take the next step. */
static void list_active(solver *s)
{
    blue_noise_state *b = s->state.blue_noise;
    b->active_count = 0;
    for (size_t i = 0; i < s->state.p->count; i++) {
        if (b->is_active[i]) b->active[b->active_count++] = (uint32_t)i;
        b->is_active[i] = false;
    }
}

static void activate_all(solver *s)
{
    memset(s->state.blue_noise->is_active, true, s->state.p->count);
    list_active(s);
}

/* Activates the neighbours whose pairs or cells a step of particle i from `was` changes. A larger cell than
 * is assumed here has a place that pulls its particle, which is active then. */
static void activate_near(const solver *s, size_t i, vec3 was)
{
    const blue_noise_state *b = s->state.blue_noise;
    const vec3 *position = s->state.p->position;
    const uint32_t *list = neighbours_list(b->near, i);
    for (uint32_t n = 0; n < b->near->list_count[i]; n++) {
        const uint32_t j = list[n];
        const double reach = 2 * (PLACE_DISTANCE + LEAST_CORRECTION) * spacing_of(s, j);
        b->is_active[j] |= vec3_norm2(vec3_sub(position[j], position[i])) < reach * reach ||
                           vec3_norm2(vec3_sub(position[j], was)) < reach * reach;
    }
}

/* Moves the active particles. Returns the sum of the squares of their steps, in spacings. */
static double take_step(solver *s)
{
    blue_noise_state *b = s->state.blue_noise;
    particles *p = s->state.p;
    double squares = 0;
    for (size_t k = 0; k < b->active_count; k++) {
        const size_t i = b->active[k];
        const surface_place *to = &b->next[k];
        if (vec3_compare(to->position, p->position[i]) == 0) continue;
        const double h = spacing_of(s, i), most = 0.5 * SKIN * h;
        const vec3 was = p->position[i];
        squares += vec3_norm2(vec3_sub(to->position, p->position[i])) / (h * h);
        p->position[i] = to->position;
        p->normal[i] = to->normal;
        if (p->patch) {
            p->patch[i] = to->patch;
            p->hint[i] = to->hint;
        }
        b->lists_stale |= vec3_norm2(vec3_sub(to->position, b->anchor[i])) >= most * most;
        b->is_active[i] = true;
        activate_near(s, i, was);
    }
    if (b->corrects)
        list_active(s);
    else
        activate_all(s);
    return squares;
}

static void record(solver *s, double squares)
{
    const particles *p = s->state.p;
    double energy = 0;
    for (size_t i = 0; !s->state.blue_noise->corrects && i < p->count; i++) energy += (double)p->energy[i];
    s->record.sweep[s->record.sweep_count++] = (solver_sweep){.energy = energy / (double)p->count,
                                                              .rms_step = sqrt(squares / (double)p->count),
                                                              .count = p->count,
                                                              .sigma = s->state.sigma};
    s->state.fraction =
        fmax(s->state.fraction, (double)s->record.sweep_count / (ENERGY_STEPS + MAX_CORRECTIONS));
}

/* Whether no step can bring the points nearer to the bounds, as on features smaller than the spacing. */
static bool is_stuck(blue_noise_state *b, size_t misses, size_t taken)
{
    if (misses < b->best) {
        b->best = misses;
        b->best_at = taken;
    }
    return taken - b->best_at >= PATIENCE ||
           taken + 1 + (b->only_pairs ? 0 : PATIENCE) >= ENERGY_STEPS + MAX_CORRECTIONS;
}

static void release(solver *s)
{
    blue_noise_state *b = s->state.blue_noise;
    if (!b) return;
    neighbours_free(b->near);
    free(b->facets);
    box_tree_free(&b->tree);
    free(b->anchor);
    free(b->active);
    free(b->is_active);
    free(b->next);
    free(b->misses);
    free(b);
    s->state.blue_noise = NULL;
}

static bool update_lists(solver *s, error *e)
{
    blue_noise_state *b = s->state.blue_noise;
    const particles *p = s->state.p;
    if (!b->lists_stale) return true;
    b->lists_stale = false;
    solver_renew_sizes(s);
    memcpy(b->anchor, p->position, p->count * sizeof *b->anchor);
    return neighbours_build(b->near, p->count, p->position, p->size, (CUTOFF + SKIN) * s->state.spacing,
                            s->setup.pool, e);
}

static void end(solver *s, bool is_done)
{
    solver_note_round(s, is_done ? "converged" : "sweeps_spent", 0, 0);
    s->state.outcome = is_done ? SOLVER_CONVERGED : SOLVER_STALLED;
    s->state.fraction = 1;
    release(s); /* before the result is measured, which takes more memory */
}

static bool step(solver *s, error *e)
{
    blue_noise_state *b = s->state.blue_noise;
    const size_t taken = s->record.sweep_count;
    b->corrects = taken >= ENERGY_STEPS;
    if (!update_lists(s, e)) return false;
    threads_run(s->setup.pool, b->active_count, THREADS_GRAIN, step_chunk, s);
    if (!threads_may_go_on(s->setup.pool, e)) return false;
    const size_t misses = b->corrects ? count_misses(s) : SIZE_MAX;
    /* The sizes were those of the last list build. With new ones all particles are measured again. */
    const bool is_renewed = misses == 0 && solver_renew_sizes(s) > 0;
    if (is_renewed) activate_all(s);
    record(s, misses == 0 ? 0 : take_step(s));
    const bool is_over = (misses == 0 && !is_renewed) || is_stuck(b, misses, taken);
    if (is_over && (misses == 0 || b->only_pairs)) {
        end(s, !b->only_pairs);
    } else if (is_over) {
        b->only_pairs = true;
        b->best = SIZE_MAX;
        activate_all(s);
    }
    return true;
}

static bool has_borders(const field *f)
{
    bool found = f->open;
    for (size_t k = 0; f->patches && k < f->patches->curve_count; k++)
        found |= f->patches->curve[k].patch_count == 1;
    return found;
}

static bbox facet_box(const void *context, uint32_t k)
{
    const facet *f = (const facet *)context + k;
    return bbox_of_points(f->corner, 3, NULL);
}

/* Appends the triangles of a cell that have area. */
static void add_facets(const surface *scan, size_t k, facet *out, size_t *count)
{
    vec3 corner[FIELD_CELL_TRIANGLES][3];
    const int triangles = surface_cell_triangles(scan, k, corner);
    for (int t = 0; t < triangles; t++) {
        if (!(vec3_norm2(vec3_across(corner[t][0], corner[t][1], corner[t][2])) > 0)) continue;
        facet *f = &out[(*count)++];
        memcpy(f->corner, corner[t], sizeof f->corner);
        f->patch = surface_cell_patch(scan, k, field_triangle_middle(corner[t]));
    }
}

/* Puts the facets into the order of their tree, so that those of a leaf are consecutive. */
static void sort_facets(facet *facets, box_tree *tree)
{
    for (uint32_t k = 0; k < tree->count; k++) {
        const facet first = facets[k];
        uint32_t at = k;
        for (uint32_t next = tree->order[at]; next != k; next = tree->order[at]) {
            facets[at] = facets[next];
            tree->order[at] = at;
            at = next;
        }
        facets[at] = first;
        tree->order[at] = at;
    }
}

static bool gather_facets(solver *s, error *e)
{
    const char *what = "the facets of the surface";
    blue_noise_state *b = s->state.blue_noise;
    const surface *scan = s->setup.scan;
    size_t most = 0, count = 0;
    vec3 unused[FIELD_CELL_TRIANGLES][3];
    for (size_t k = 0; k < scan->cells; k++) most += (size_t)surface_cell_triangles(scan, k, unused);
    vec3 *middle = mem_array(most, sizeof *middle, what, e);
    b->facets = mem_array(most, sizeof *b->facets, what, e);
    bool ok = middle && b->facets;
    for (size_t k = 0; ok && k < scan->cells; k++) add_facets(scan, k, b->facets, &count);
    for (size_t k = 0; ok && k < count; k++) middle[k] = field_triangle_middle(b->facets[k].corner);
    ok = ok && box_tree_make(count, middle, facet_box, b->facets, NULL, what, &b->tree, e);
    free(middle);
    if (ok) sort_facets(b->facets, &b->tree);
    return ok;
}

static bool begin(solver *s, error *e)
{
    const char *what = "particles";
    const size_t n = s->state.p->count;
    blue_noise_state *b = s->state.blue_noise = mem_alloc(sizeof *b);
    b->best = SIZE_MAX;
    b->lists_stale = true;
    b->has_borders = has_borders(s->setup.field);
    b->near = neighbours_new(n, s->setup.params.list_limit, e);
    b->anchor = mem_array(n, sizeof *b->anchor, what, e);
    b->active = mem_array(n, sizeof *b->active, what, e);
    b->is_active = mem_array(n, sizeof *b->is_active, what, e);
    b->next = mem_array(n, sizeof *b->next, what, e);
    b->misses = mem_array(n, sizeof *b->misses, what, e);
    if (!b->near || !b->anchor || !b->active || !b->is_active || !b->next || !b->misses) return false;
    activate_all(s);
    return !s->setup.field->patches || gather_facets(s, e);
}

static bool describe(solver *s, error *e)
{
    (void)s;
    (void)e;
    return true;
}

const solver_method solver_blue_noise = {begin, step, describe, release};
