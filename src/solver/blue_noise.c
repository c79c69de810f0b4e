/* blue_noise: points without regular packing, as a solver_method (solver_state.h). See "Blue noise" in doc/method.md.
 *
 * The particles start at random positions. A few steps on the energy of the packing equalise their density. Each further step corrects
 * only pairs that are too close and places that are too far from all particles. The steps are those of all particles at once (Jacobi), so
 * that the result does not depend on the number of threads. Particles of all patches interact, and none is held on a curve.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "packing/neighbours.h"
#include "solver/particles/random_streams.h"
#include "solver/passes/passes.h"
#include "solver/solver_state.h"
#include "voronoi/resolution.h"

/* Number of Newton steps on the energy. Fewer: more power at low frequencies; more: a more regular packing. */
enum { ENERGY_STEPS = 4 };
/* Longest step, in spacings. Longer: particles pass each other. */
static const double LONGEST_STEP = 0.3;
/* Maximum number of corrections. On smooth surfaces 30 to 110 suffice; the last ones move few particles. */
enum { MAX_CORRECTIONS = 200 };
/* Distances that corrections aim at, in spacings: of pairs, and of places from their nearest particle. Nearer to the bounds: the
 * corrections converge slowly; beyond them: more regular points. */
static const double PAIR_DISTANCE = 0.75, PLACE_DISTANCE = 0.76;
/* Fraction of a deviation that each particle concerned corrects in one step. */
static const double CORRECTION = 0.5;
/* Number of corrections without a smaller violation of the bounds after which the points are stuck. */
enum { PATIENCE = 40 };
/* Convergence: SOLVER_BLUE_NOISE_LEAST and SOLVER_BLUE_NOISE_COVERAGE are met with this margin, because coverage is measured at
 * the corners of cells in the tangent plane. */
static const double MARGIN = 0.005;
/* Cutoff of the neighbour lists, in spacings: twice the largest distance of a place in a nearly converged set. */
static const double CUTOFF = 2;
/* Reach of the lists beyond the cutoff (Verlet skin), in spacings. Larger: fewer builds of longer lists. */
static const double SKIN = 0.2;
/* Deviations below this are not corrected, in spacings. It is smaller than the margin between the bounds and the distances
 * that corrections aim at. Smaller: more particles move in each step. */
static const double LEAST_CORRECTION = 0.002;
/* Half the side of the square that Voronoi cells are cut from, in spacings. */
static const double CELL_SIDE = 1.5;
/* Distance of a corner of a cell from its particle, in spacings, above which the place is examined. Below it the place is covered. */
static const double EXAMINED = 0.73;
/* The same where the surface bends: distances in the tangent plane are too short across creases. */
static const double EXAMINED_AT_BENDS = 0.4;
/* Cosine of the normals of neighbours below which the surface bends. */
static const double BENDS_COSINE = 0.8;
/* Cosine of normals below which a step ended on another wall. */
static const double TURNED_COSINE = 0;
/* Bisections that find the end of the surface along a step or from a particle towards a corner of its cell. */
enum { STEP_BISECTIONS = 6, PLACE_BISECTIONS = 10 };
/* Maximum distance, in spacings, of the places at which one patch ends and the next begins: the step of the last bisection. */
static const double MAX_CROSSING = 0.05;
/* Directions in which places are examined towards an edge of a cell that lies beyond the end of the surface, and bisections about the
 * farthest one. */
enum { EDGE_PLACES = 8, EDGE_REFINEMENTS = 5 };
/* Maximum number of steps from a corner of a cell in the tangent plane to the place that is equally far from three particles. */
enum { CORNER_STEPS = 2 };
/* A place that is farther from the particle than this factor times the distance of the nearest particle is not in its cell. */
static const double IN_CELL = 1.05;
/* Directions and length, in spacings, in which an energy step searches the end of the surface. The length is half of the support: farther
 * from the end no mirrored particle is within the support. */
enum { PROBES = 6 };
static const double PROBE = 0.87;
/* Least determinant of the Hessian over the square of its trace: below it, all neighbours lie in one direction. */
static const double LEAST_DETERMINANT = 1e-9;
/* Maximum number of neighbours that a Voronoi cell is made from; a list has about 20. */
enum { MAX_NEAR = 64 };
/* Maximum number of corners of a Voronoi cell; a cell has 6 on average. */
enum { MAX_CORNERS = 64 };
/* Sums and extrema are those of this many parts, which do not depend on the number of threads. */
enum { PARTS = 256 };

typedef struct flat {
    double x, y;
} flat;

typedef struct cell {
    int count;
    flat corner[MAX_CORNERS];
} cell;

/* What a step measures before particles move. */
typedef struct extremes {
    double least;    /* distance of a pair, in spacings */
    double coverage; /* distance of a place from its nearest particle, in spacings */
    double energy, squares;
} extremes;

typedef struct blue_noise_state {
    neighbours *near;
    double best;    /* least violation of the bounds up to now */
    size_t best_at; /* the step before which it was measured */
    size_t grain;
    bool corrects;    /* the step is a correction */
    bool has_borders; /* the surface ends somewhere */
    /* The surface or one of its patches ends somewhere. Elsewhere a place that is not reached is on another wall. */
    bool has_ends;
    vec3 *position, *normal; /* after the step */
    uint32_t *patch, *hint;  /* after the step; NULL without patches */
    vec3 *anchor;            /* position at the last list build */
    bool *moved[2];          /* in the last step, and in this one */
    float *least, *coverage; /* of each particle the extremes that it has seen */
    extremes part[PARTS];
} blue_noise_state;

/* A place of the surface. */
typedef struct surface_place {
    vec3 position, normal;
    uint32_t patch, hint;
} surface_place;

static double length2(flat v)
{
    return v.x * v.x + v.y * v.y;
}

static flat between(flat from, flat to, double share)
{
    return (flat){from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)};
}

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

/* The place at d from another one, projected onto the same patch. False: the patch does not reach there. */
static bool reach(const solver *s, const surface_place *from, vec3 d, double h, surface_place *out)
{
    const projection_limits limits = solver_rounding(h);
    const field *f = field_of_patch(s->setup.field, from->patch);
    const vec3 target = vec3_add(from->position, d);
    surface_place to = *from;
    to.position = target;
    if (!projection_find_near(f, &limits, &to.hint, &to.position, &to.normal) ||
        vec3_norm(vec3_sub(to.position, target)) > fmax(LONGEST_STEP * h, vec3_norm(d)))
        return false;
    if (s->setup.field->patches && !field_is_within_near(f, to.position, &to.hint)) return false;
    if (projection_boundary_axes(f, to.position) != 0) return false;
    if (vec3_dot(to.normal, from->normal) < TURNED_COSINE && !is_one_sided(s->state.p, to.patch))
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

/* v turned as the unit vector `from` is turned to `to`. Across a crease, whose direction is the axis, this unfolds the surface. */
static vec3 turned(vec3 v, vec3 from, vec3 to)
{
    const vec3 sum = vec3_add(from, to);
    const double along = vec3_dot(sum, v) / (1 + vec3_dot(from, to));
    return vec3_axpy(2 * vec3_dot(from, v), to, vec3_axpy(-along, sum, v));
}

/* Continues along d from a place at a curve on the patch of a neighbour of particle i. False: no patch begins there. */
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
            !reach(s, &begin, turned(d, end->normal, begin.normal), h, &to))
            continue;
        best = distance;
        found = true;
        *out = to;
    }
    return found;
}

/* Goes from particle i along d as far as its patch reaches. Returns the fraction of d. */
static double go_on_patch(const solver *s, size_t i, vec3 d, double h, int bisections, surface_place *out)
{
    const surface_place from = place_of(s, i);
    double low = 0, high = 1;
    *out = from;
    if (reach(s, &from, d, h, out)) return 1;
    for (int k = 0; k < bisections; k++) {
        const double middle = 0.5 * (low + high);
        const bool reached = reach(s, &from, vec3_scale(d, middle), h, out);
        *(reached ? &low : &high) = middle;
    }
    return low;
}

/* The same across the curves at which patches meet. True: to the end of d. */
static bool go(const solver *s, size_t i, vec3 d, double h, int bisections, surface_place *out)
{
    const double share = go_on_patch(s, i, d, h, bisections, out);
    if (share == 1 || !s->state.p->patch) return share == 1;
    const surface_place end = *out;
    return cross(s, i, &end, vec3_scale(d, 1 - share), h, out);
}

/* ---- Voronoi cells */

/* The tangent frame of a particle, and the positions of its neighbours in it. */
typedef struct surroundings {
    size_t own;
    double h;
    vec3 axis[2];
    const uint32_t *list;
    uint32_t count;
    double examined; /* EXAMINED or EXAMINED_AT_BENDS, world units */
} surroundings;

static surroundings surroundings_of(const solver *s, size_t i)
{
    const neighbours *near = s->state.blue_noise->near;
    surroundings out = {
        .own = i, .h = spacing_of(s, i), .list = neighbours_list(near, i), .count = near->list_count[i]};
    vec3_frame(s->state.p->normal[i], &out.axis[0], &out.axis[1]);
    bool bends = false;
    for (uint32_t k = 0; !bends && k < out.count; k++)
        bends = vec3_dot(s->state.p->normal[i], s->state.p->normal[out.list[k]]) < BENDS_COSINE;
    out.examined = (bends ? EXAMINED_AT_BENDS : EXAMINED) * out.h;
    return out;
}

/* The offset of a neighbour in the tangent plane, turned into it so that its length is the distance. False: it is on an opposite wall, or
 * has no direction. */
static bool offset_of(const solver *s, const surroundings *a, uint32_t j, flat *out, double *distance)
{
    const particles *p = s->state.p;
    const vec3 d = vec3_sub(p->position[j], p->position[a->own]);
    if (is_opposite(p, a->own, particles_patch(p, j), p->normal[j])) return false;
    const double x = vec3_dot(d, a->axis[0]), y = vec3_dot(d, a->axis[1]), flat_length = sqrt(x * x + y * y);
    *distance = vec3_norm(d);
    if (!(flat_length > 0)) return false;
    *out = (flat){x * *distance / flat_length, y * *distance / flat_length};
    return true;
}

static vec3 in_space(const surroundings *a, flat v)
{
    return vec3_add(vec3_scale(a->axis[0], v.x), vec3_scale(a->axis[1], v.y));
}

/* Cuts off what is nearer to a neighbour at `at`. */
static void cut(cell *c, flat at)
{
    const double half = 0.5 * length2(at);
    double beyond[MAX_CORNERS], most = -INFINITY;
    for (int k = 0; k < c->count; k++) {
        beyond[k] = c->corner[k].x * at.x + c->corner[k].y * at.y - half;
        most = beyond[k] > most ? beyond[k] : most;
    }
    if (!(most > 0)) return;
    cell rest = {0};
    for (int k = 0; k < c->count && rest.count < MAX_CORNERS - 1; k++) {
        const int next = (k + 1) % c->count;
        const flat from = c->corner[k], to = c->corner[next];
        if (beyond[k] <= 0) rest.corner[rest.count++] = from;
        if ((beyond[k] < 0) == (beyond[next] < 0) || beyond[k] == 0 || beyond[next] == 0) continue;
        rest.corner[rest.count++] = between(from, to, beyond[k] / (beyond[k] - beyond[next]));
    }
    *c = rest;
}

/* The particles nearest to a place: at least one, and three where the tangent plane has a corner of their cells. */
typedef struct nearest_three {
    vec3 away[3]; /* from each particle to the place; by distance */
    double distance[3];
} nearest_three;

static void offer(nearest_three *n, vec3 away)
{
    const double distance = vec3_norm(away);
    int k = 3;
    while (k > 0 && distance < n->distance[k - 1]) k--;
    for (int m = 2; m > k; m--) {
        n->distance[m] = n->distance[m - 1];
        n->away[m] = n->away[m - 1];
    }
    if (k == 3) return;
    n->distance[k] = distance;
    n->away[k] = away;
}

/* The nearest of particle a->own and its neighbours that are not on an opposite wall. */
static nearest_three nearest_to(const solver *s, const surroundings *a, const surface_place *to)
{
    const particles *p = s->state.p;
    nearest_three out = {.distance = {INFINITY, INFINITY, INFINITY}};
    offer(&out, vec3_sub(to->position, p->position[a->own]));
    for (uint32_t k = 0; k < a->count; k++)
        if (!is_opposite(p, a->list[k], to->patch, to->normal))
            offer(&out, vec3_sub(to->position, p->position[a->list[k]]));
    return out;
}

/* Moves a place in its tangent plane to equal distances from its three nearest particles. The cell in the tangent plane of a particle
 * misses this place where the surface bends. False, nothing changed: there is no farther place nearby. */
static bool move_to_corner(const solver *s, const surroundings *a, surface_place *to, nearest_three *n)
{
    vec3 u, v;
    if (!(n->distance[2] < INFINITY)) return false;
    vec3_frame(to->normal, &u, &v);
    const vec3 first = vec3_sub(n->away[1], n->away[0]), second = vec3_sub(n->away[2], n->away[0]);
    const double e = 0.5 * (n->distance[0] * n->distance[0] - n->distance[1] * n->distance[1]),
                 f = 0.5 * (n->distance[0] * n->distance[0] - n->distance[2] * n->distance[2]),
                 xx = vec3_dot(first, u), xy = vec3_dot(first, v), yx = vec3_dot(second, u),
                 yy = vec3_dot(second, v), determinant = xx * yy - xy * yx;
    const vec3 d = vec3_add(vec3_scale(u, (e * yy - f * xy) / determinant),
                            vec3_scale(v, (f * xx - e * yx) / determinant));
    surface_place moved;
    if (!(vec3_norm(d) <= LONGEST_STEP * a->h) || !reach(s, to, d, a->h, &moved)) return false;
    const nearest_three then = nearest_to(s, a, &moved);
    if (then.distance[0] <= n->distance[0]) return false;
    *to = moved;
    *n = then;
    return true;
}

/* A place of the cell of a particle. */
typedef struct examined_place {
    bool is_whole; /* the surface, or the patch, reaches to the place in the tangent plane */
    bool is_own;   /* it is on the patch of the particle */
    double
        excess; /* the nearest particle is this much farther than PLACE_DISTANCE, world units; -INFINITY: none is far */
    vec3 pull; /* unit vector from the particle to the place */
} examined_place;

/* The place towards v: of the surface, or without `crosses` of the patch of the particle. With it the place is moved to the corner of cells
 * that is near. */
static examined_place examine(const solver *s, const surroundings *a, flat v, bool crosses, extremes *seen)
{
    surface_place to;
    const vec3 along = in_space(a, v);
    const int bisections = s->state.blue_noise->has_ends ? PLACE_BISECTIONS : 0;
    examined_place out = {.excess = -INFINITY};
    out.is_whole = crosses ? go(s, a->own, along, a->h, bisections, &to)
                           : go_on_patch(s, a->own, along, a->h, bisections, &to) == 1;
    out.is_own = out.is_whole && to.patch == particles_patch(s->state.p, a->own);
    nearest_three three = nearest_to(s, a, &to);
    for (int k = 0; crosses && out.is_whole && k < CORNER_STEPS && move_to_corner(s, a, &to, &three);) k++;
    const vec3 d = vec3_sub(to.position, s->state.p->position[a->own]);
    const double own = vec3_norm(d), nearest = three.distance[0];
    if (own <= EXAMINED * a->h || own >= IN_CELL * nearest) return out;
    seen->coverage = fmax(seen->coverage, nearest / a->h);
    out.excess = nearest - PLACE_DISTANCE * a->h;
    out.pull = vec3_scale(d, 1 / own);
    return out;
}

static void pull_towards(const surroundings *a, const examined_place *to, vec3 *pull)
{
    if (to->excess > LEAST_CORRECTION * a->h) *pull = vec3_axpy(CORRECTION * to->excess, to->pull, *pull);
}

/* The place on an edge of the cell, from a corner on the patch, at which the patch ends. */
static examined_place end_of_patch(const solver *s, const surroundings *a, flat inside, flat outside,
                                   extremes *seen)
{
    examined_place found = {.excess = -INFINITY};
    double low = 0, high = 1;
    for (int k = 0; k < PLACE_BISECTIONS; k++) {
        const double middle = 0.5 * (low + high);
        const examined_place at = examine(s, a, between(inside, outside, middle), false, seen);
        if (at.is_whole) found = at;
        *(at.is_whole ? &low : &high) = middle;
    }
    return found;
}

/* The farthest place of the patch towards an edge that lies beyond its end, as at a corner of the surface. */
static examined_place farthest_before(const solver *s, const surroundings *a, flat from, flat to,
                                      extremes *seen)
{
    examined_place farthest = {.excess = -INFINITY};
    double best = 0, apart = 1.0 / EDGE_PLACES;
    for (int n = 0; n <= EDGE_PLACES; n++) {
        const examined_place at = examine(s, a, between(from, to, n * apart), false, seen);
        if (!(at.excess > farthest.excess)) continue;
        farthest = at;
        best = n * apart;
    }
    for (int k = 0; k < EDGE_REFINEMENTS && farthest.excess > -INFINITY; k++) {
        const double middle = best;
        apart *= 0.5;
        for (int side = -1; side <= 1; side += 2) {
            const double share = fmin(fmax(middle + side * apart, 0), 1);
            const examined_place at = examine(s, a, between(from, to, share), false, seen);
            if (!(at.excess > farthest.excess)) continue;
            farthest = at;
            best = share;
        }
    }
    return farthest;
}

/* Examines the corners of the cell that are far from the particle, and where the edges of the cell leave its patch: at the end of the
 * surface and at creases a place may be farther from all particles than the places around it without being a corner of cells. */
static void examine_cell(const solver *s, const surroundings *a, const cell *c, vec3 *pull, extremes *seen)
{
    bool own[MAX_CORNERS];
    for (int k = 0; k < c->count; k++) {
        own[k] = true;
        if (length2(c->corner[k]) <= a->examined * a->examined) continue;
        const examined_place at = examine(s, a, c->corner[k], true, seen);
        own[k] = at.is_own || !s->state.blue_noise->has_ends;
        if (at.is_whole) pull_towards(a, &at, pull);
    }
    for (int k = 0; k < c->count; k++) {
        const int next = (k + 1) % c->count;
        const flat from = c->corner[k], to = c->corner[next];
        if (own[k] && own[next]) continue;
        const examined_place at = own[k]      ? end_of_patch(s, a, from, to, seen)
                                  : own[next] ? end_of_patch(s, a, to, from, seen)
                                              : farthest_before(s, a, from, to, seen);
        pull_towards(a, &at, pull);
    }
}

/* ---- steps */

static vec3 limited(vec3 d, double longest)
{
    const double length = vec3_norm(d);
    return length > longest ? vec3_scale(d, longest / length) : d;
}

/* A neighbour in the tangent plane. */
typedef struct flat_neighbour {
    flat at;
    double distance;
} flat_neighbour;

/* The nearest neighbours, by distance; more than MAX_NEAR are not needed for a cell. Pushes the particle off those that are too close. */
static int flatten(const solver *s, const surroundings *a, flat_neighbour out[MAX_NEAR], vec3 *push,
                   extremes *seen)
{
    int count = 0;
    for (uint32_t k = 0; k < a->count; k++) {
        flat_neighbour n;
        if (!offset_of(s, a, a->list[k], &n.at, &n.distance)) continue;
        const double h = 0.5 * (a->h + spacing_of(s, a->list[k])), excess = PAIR_DISTANCE * h - n.distance;
        seen->least = fmin(seen->least, n.distance / h);
        if (excess > LEAST_CORRECTION * h)
            *push = vec3_axpy(-CORRECTION * excess / n.distance, in_space(a, n.at), *push);
        int at = count < MAX_NEAR ? count++ : MAX_NEAR;
        for (; at > 0 && out[at - 1].distance > n.distance; at--)
            if (at < MAX_NEAR) out[at] = out[at - 1];
        if (at < MAX_NEAR) out[at] = n;
    }
    return count;
}

/* Pushes the particle off neighbours that are too close, and pulls it towards places that are too far. */
static vec3 correction(const solver *s, const surroundings *a, extremes *seen)
{
    const double side = CELL_SIDE * a->h;
    cell c = {4, {{-side, -side}, {side, -side}, {side, side}, {-side, side}}};
    vec3 step = {0, 0, 0};
    flat_neighbour near[MAX_NEAR];
    const int count = flatten(s, a, near, &step, seen);
    double farthest2 = 2 * side * side;
    for (int k = 0; k < count && near[k].distance * near[k].distance < 4 * farthest2; k++) {
        cut(&c, near[k].at);
        farthest2 = 0;
        for (int n = 0; n < c.count; n++) {
            const double own2 = length2(c.corner[n]);
            farthest2 = own2 > farthest2 ? own2 : farthest2;
        }
    }
    examine_cell(s, a, &c, &step, seen);
    return step;
}

/* Forces and the first term of the Hessian (10) in the tangent frame. */
typedef struct newton_terms {
    double fx, fy, xx, xy, yy;
} newton_terms;

/* Adds a neighbour at `at`; `h`: the spacing of the pair. Returns the energy of the pair. */
static double add_pair(const solver *s, flat at, double h, double weight, newton_terms *t)
{
    const energy_function *energy = s->setup.params.energy;
    const double distance = hypot(at.x, at.y), u = distance / (s->state.sigma / s->state.spacing * h);
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
    flat out;
    double distance;
} line;

/* The tangent to the end of the surface near a particle, from places at which probes in several directions end. False: the surface does
 * not end within PROBE spacings. */
static bool find_border(const solver *s, const surroundings *a, line *out)
{
    flat end[PROBES];
    double length[PROBES];
    int nearest = -1;
    for (int k = 0; k < PROBES; k++) {
        const double angle = 2 * M_PI * k / PROBES, reach_of = PROBE * a->h;
        const flat v = {reach_of * cos(angle), reach_of * sin(angle)};
        surface_place to;
        length[k] = INFINITY;
        if (go(s, a->own, in_space(a, v), a->h, PLACE_BISECTIONS, &to)) continue;
        const vec3 d = vec3_sub(to.position, s->state.p->position[a->own]);
        end[k] = (flat){vec3_dot(d, a->axis[0]), vec3_dot(d, a->axis[1])};
        length[k] = hypot(end[k].x, end[k].y);
        if (nearest < 0 || length[k] < length[nearest]) nearest = k;
    }
    if (nearest < 0) return false;
    const int before = (nearest + PROBES - 1) % PROBES, after = (nearest + 1) % PROBES,
              beside = length[before] < length[after] ? before : after;
    const double angle = 2 * M_PI * nearest / PROBES;
    out->out = (flat){cos(angle), sin(angle)};
    if (length[beside] < INFINITY) {
        const double x = end[beside].y - end[nearest].y, y = end[nearest].x - end[beside].x,
                     norm = hypot(x, y), side = x * out->out.x + y * out->out.y < 0 ? -1 : 1;
        if (norm > 0) out->out = (flat){side * x / norm, side * y / norm};
    }
    out->distance = end[nearest].x * out->out.x + end[nearest].y * out->out.y;
    return true;
}

static flat mirrored(const line *l, flat v)
{
    const double beyond = 2 * (l->distance - v.x * l->out.x - v.y * l->out.y);
    return (flat){v.x + beyond * l->out.x, v.y + beyond * l->out.y};
}

/* One Newton step on the energy. Near the end of the surface the particles are mirrored at it: otherwise the forces, which act from one
 * side only, would move particles to the end. */
static vec3 energy_step(const solver *s, const surroundings *a, extremes *seen)
{
    newton_terms t = {0};
    line border = {{0, 0}, INFINITY};
    const bool is_near_border = s->state.blue_noise->has_borders && find_border(s, a, &border);
    if (is_near_border) {
        rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_BLUE_NOISE + a->own);
        add_pair(s, mirrored(&border, (flat){0, 0}), a->h, rng_uniform(&r), &t);
    }
    for (uint32_t k = 0; k < a->count; k++) {
        flat at;
        double distance;
        if (!offset_of(s, a, a->list[k], &at, &distance)) continue;
        const double h = 0.5 * (a->h + spacing_of(s, a->list[k]));
        seen->energy += add_pair(s, at, h, 1, &t);
        if (is_near_border) add_pair(s, mirrored(&border, at), h, 1, &t);
    }
    const double determinant = t.xx * t.yy - t.xy * t.xy, trace = t.xx + t.yy,
                 scale = s->state.sigma / s->state.spacing / determinant;
    if (!(determinant > LEAST_DETERMINANT * trace * trace)) return (vec3){0, 0, 0};
    return in_space(a, (flat){scale * (t.yy * t.fx - t.xy * t.fy), scale * (t.xx * t.fy - t.xy * t.fx)});
}

/* Whether the particle or a neighbour has moved in the last step. */
static bool is_active(const blue_noise_state *b, size_t i)
{
    const uint32_t *list = neighbours_list(b->near, i);
    bool moved = b->moved[0][i];
    for (uint32_t k = 0; !moved && k < b->near->list_count[i]; k++) moved = b->moved[0][list[k]];
    return moved;
}

/* The particle after its step. Sets what it has seen. */
static surface_place next_place(solver *s, size_t i, extremes *seen)
{
    blue_noise_state *b = s->state.blue_noise;
    const surroundings a = surroundings_of(s, i);
    surface_place to = place_of(s, i);
    extremes own = {.least = INFINITY};
    const vec3 full = b->corrects ? correction(s, &a, &own) : energy_step(s, &a, &own),
               d = limited(full, LONGEST_STEP * a.h);
    if (vec3_norm2(d) > 0) go(s, i, d, a.h, STEP_BISECTIONS, &to);
    b->least[i] = (float)own.least;
    b->coverage[i] = (float)own.coverage;
    seen->energy += own.energy;
    seen->squares += vec3_norm2(vec3_sub(to.position, s->state.p->position[i])) / (a.h * a.h);
    return to;
}

static void step_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    blue_noise_state *b = s->state.blue_noise;
    extremes seen = {.least = INFINITY};
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const surface_place to = is_active(b, i) ? next_place(s, i, &seen) : place_of(s, i);
        b->moved[1][i] = !b->corrects || vec3_compare(to.position, s->state.p->position[i]) != 0;
        seen.least = fmin(seen.least, (double)b->least[i]);
        seen.coverage = fmax(seen.coverage, (double)b->coverage[i]);
        b->position[i] = to.position;
        b->normal[i] = to.normal;
        if (!b->patch) continue;
        b->patch[i] = to.patch;
        b->hint[i] = to.hint;
    }
    b->part[begin / b->grain] = seen;
}

static extremes gather(const blue_noise_state *b)
{
    extremes all = {.least = INFINITY};
    for (int k = 0; k < PARTS; k++) {
        all.least = fmin(all.least, b->part[k].least);
        all.coverage = fmax(all.coverage, b->part[k].coverage);
        all.energy += b->part[k].energy;
        all.squares += b->part[k].squares;
    }
    return all;
}

static void take_step(solver *s)
{
    const blue_noise_state *b = s->state.blue_noise;
    particles *p = s->state.p;
    memcpy(p->position, b->position, p->count * sizeof *p->position);
    memcpy(p->normal, b->normal, p->count * sizeof *p->normal);
    if (!b->patch) return;
    memcpy(p->patch, b->patch, p->count * sizeof *p->patch);
    memcpy(p->hint, b->hint, p->count * sizeof *p->hint);
}

static void record(solver *s, const extremes *seen)
{
    const double count = (double)s->state.p->count;
    s->record.sweep[s->record.sweep_count++] = (solver_sweep){.energy = seen->energy / count,
                                                              .rms_step = sqrt(seen->squares / count),
                                                              .count = s->state.p->count,
                                                              .sigma = s->state.sigma};
    s->state.fraction =
        fmax(s->state.fraction, (double)s->record.sweep_count / (ENERGY_STEPS + MAX_CORRECTIONS));
}

/* The largest violation of the bounds by a set of points; at most 0: it meets them. */
static double violation(const extremes *seen)
{
    return fmax(SOLVER_BLUE_NOISE_LEAST - seen->least,
                seen->coverage / seen->least - SOLVER_BLUE_NOISE_COVERAGE) +
           MARGIN;
}

/* Whether no step can bring the points nearer to the bounds, as on features smaller than the spacing. */
static bool is_stuck(blue_noise_state *b, double violated, size_t taken)
{
    if (violated < b->best) {
        b->best = violated;
        b->best_at = taken;
    }
    return taken - b->best_at >= PATIENCE || taken + 1 >= ENERGY_STEPS + MAX_CORRECTIONS;
}

static void release(solver *s)
{
    blue_noise_state *b = s->state.blue_noise;
    if (!b) return;
    neighbours_free(b->near);
    free(b->position);
    free(b->normal);
    free(b->anchor);
    free(b->least);
    free(b->coverage);
    free(b->moved[0]);
    free(b->moved[1]);
    free(b->patch);
    free(b->hint);
    free(b);
    s->state.blue_noise = NULL;
}

/* Builds the lists again if a particle has moved by half of the skin. */
static bool update_lists(solver *s, error *e)
{
    blue_noise_state *b = s->state.blue_noise;
    const particles *p = s->state.p;
    bool valid = s->record.sweep_count > 0;
    for (size_t i = 0; valid && i < p->count; i++) {
        const double most = 0.5 * SKIN * spacing_of(s, i);
        valid = vec3_norm2(vec3_sub(p->position[i], b->anchor[i])) < most * most;
    }
    if (valid) return true;
    memcpy(b->anchor, p->position, p->count * sizeof *b->anchor);
    return neighbours_build(b->near, p->count, p->position, p->size, (CUTOFF + SKIN) * s->state.spacing,
                            s->setup.pool, e);
}

static bool step(solver *s, error *e)
{
    blue_noise_state *b = s->state.blue_noise;
    const size_t taken = s->record.sweep_count;
    b->corrects = taken >= ENERGY_STEPS;
    solver_renew_sizes(s);
    if (!update_lists(s, e)) return false;
    for (int k = 0; k < PARTS; k++) b->part[k] = (extremes){.least = INFINITY};
    threads_run(s->setup.pool, s->state.p->count, b->grain, step_chunk, s);
    if (threads_stopped(s->setup.pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    const extremes seen = gather(b);
    const double violated = b->corrects ? violation(&seen) : INFINITY;
    const bool is_done = violated <= 0;
    if (!is_done) take_step(s);
    bool *const moved = b->moved[0];
    b->moved[0] = b->moved[1];
    b->moved[1] = moved;
    record(s, &seen);
    if (!is_done && (!b->corrects || !is_stuck(b, violated, taken))) return true;
    solver_note_round(s, is_done ? "converged" : "sweeps_spent", seen.energy, 0);
    s->state.outcome = is_done ? SOLVER_CONVERGED : SOLVER_STALLED;
    s->state.fraction = 1;
    release(s); /* before the result is measured, which takes more memory */
    return true;
}

static bool has_borders(const field *f)
{
    bool found = f->open;
    for (size_t k = 0; f->patches && k < f->patches->curve_count; k++)
        found |= f->patches->curve[k].patch_count == 1;
    return found;
}

static bool begin(solver *s, error *e)
{
    const char *what = "particles";
    const size_t n = s->state.p->count;
    blue_noise_state *b = s->state.blue_noise = mem_alloc(sizeof *b);
    b->best = INFINITY;
    b->has_borders = has_borders(s->setup.field);
    b->has_ends = b->has_borders || (s->setup.field->patches && s->setup.field->patches->curve_count > 0);
    b->grain = n / PARTS + 1;
    b->near = neighbours_new(n, s->setup.params.list_limit, e);
    b->position = mem_array(n, sizeof *b->position, what, e);
    b->normal = mem_array(n, sizeof *b->normal, what, e);
    b->anchor = mem_array(n, sizeof *b->anchor, what, e);
    b->least = mem_array(n, sizeof *b->least, what, e);
    b->coverage = mem_array(n, sizeof *b->coverage, what, e);
    for (int k = 0; k < 2; k++) b->moved[k] = mem_array(n, sizeof *b->moved[k], what, e);
    for (size_t i = 0; b->moved[0] && i < n; i++) b->moved[0][i] = true;
    if (s->state.p->patch) {
        b->patch = mem_array(n, sizeof *b->patch, what, e);
        b->hint = mem_array(n, sizeof *b->hint, what, e);
    }
    return b->near && b->position && b->normal && b->anchor && b->least && b->coverage && b->moved[0] &&
           b->moved[1] && (!s->state.p->patch || (b->patch && b->hint));
}

static bool describe(solver *s, error *e)
{
    (void)s;
    (void)e;
    return true;
}

const solver_method solver_blue_noise = {begin, step, describe, release};
