// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/passes/repair_region.h"

#include <assert.h>
#include <math.h>

#include "base/core/elementary.h"
#include "surface/field/projection.h"
#include "sampling/packing/energy.h"
#include "sampling/packing/neighbours.h"
#include "geometry/space/packing.h"
#include "sampling/voronoi/voronoi.h"

/* Maximum number of sweeps of a trial; it ends earlier if all members have converged. */
enum { MAX_SWEEPS = 16 };
/* Sweeps between list builds. */
enum { LIST_SWEEPS = 8 };
/* Probability that a trial deletes a particle. */
static const double DELETION_SHARE = 0.4;
/* Probability that a trial inserts a particle. The remaining trials move one. */
static const double INSERTION_SHARE = 0.4;
/* Cost of an excess energy of one ideal energy, in defects. Small: strain decides only between regions of
 * equally many defects. */
static const double ENERGY_COST = 0.1;
/* Cost of the squared relative deviation of a cell's spacing from the mean, in defects. Cells of five or
 * seven neighbours deviate by 0.035. */
static const double AREA_COST = 50;
/* Maximum of that square; also its value for a point without a cell. */
static const double MAX_AREA_SQUARE = 0.1;
/* Increase of the energy sum by one more particle in the same area, in ideal energies. */
static const double ENERGY_PER_PARTICLE = 3.35;
/* Over-relaxation factor of a Newton step: fewer sweeps. */
static const double OMEGA = 2.4;
/* Maximum step over h. */
static const double MAX_STEP = 0.15;
/* Step over h below which a member has converged. */
static const double CONVERGED_STEP = 1e-2;
/* Members within this distance of a change become active, over h. */
static const double ACTIVATION_RADIUS = 2;

/* --- neighbours --- */

/* Builds the list of member i at *at. The first loop is vectorised. */
static void build_list(repair_region *p, uint32_t i, uint32_t *at)
{
    const vec3 x = p->x[i];
    const double h = p->h[i];
    double beyond[REPAIR_MAX_MEMBERS];
    for (uint32_t j = 0; j < p->count; j++) {
        double dx = p->x[j].x - x.x, dy = p->x[j].y - x.y, dz = p->x[j].z - x.z;
        double within = 0.5 * VORONOI_REACH * (h + p->h[j]);
        beyond[j] = dx * dx + dy * dy + dz * dz - within * within;
    }
    p->begin[i] = *at;
    for (uint32_t j = 0; j < p->count && *at < REPAIR_MAX_LIST; j++) {
        p->list[*at] = j;
        *at += (beyond[j] < 0) & (j != i);
    }
    p->listed[i] = *at - p->begin[i];
}

static void build_lists(repair_region *p, uint32_t count)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < count; i++) build_list(p, i, &at);
}

void repair_region_list(repair_region *p)
{
    build_lists(p, p->count);
}

void repair_scratch_init(repair_scratch *b, const solver *s)
{
    b->s = s;
    b->pairs = pair_list_in(b->number, REPAIR_MAX_PAIRS);
}

/* The pairs of member i, weighted as in the solve. */
static const pair_list *gather_pairs(repair_scratch *b, const repair_region *p, uint32_t i)
{
    pair_list *g = &b->pairs;
    const uint32_t *list = p->list + p->begin[i];
    const uint32_t listed = p->listed[i] < REPAIR_MAX_PAIRS ? p->listed[i] : REPAIR_MAX_PAIRS;
    g->blocks = (listed + PAIR_LANES - 1) / PAIR_LANES;
    for (uint32_t k = 0; k < listed; k++)
        pair_list_set(g, k, p->x[list[k]], p->normal[list[k]], 1, 0.5 * (1 + p->h[list[k]] / p->h[i]));
    vec3 away = p->x[i];
    away.x += 2 * packing_support(p->h[i]);
    for (size_t k = listed; k < g->blocks * PAIR_LANES; k++) pair_list_set(g, k, away, p->normal[i], 0, 1);
    pair_weigh(g, p->normal[i]);
    return g;
}

/* --- cost --- */

static int count_shell(const repair_region *p, uint32_t i)
{
    int near = 0;
    for (uint32_t k = 0; k < p->listed[i]; k++) {
        const uint32_t j = p->list[p->begin[i] + k];
        const double within = packing_first_shell(0.5 * (p->h[i] + p->h[j]));
        near += vec3_norm2(vec3_sub(p->x[i], p->x[j])) < within * within;
    }
    return near;
}

int repair_region_estimate_defects(const repair_region *p)
{
    int found = 0;
    for (uint32_t i = 0; i < p->count; i++)
        found += p->evaluated[i] && count_shell(p, i) != PACKING_IDEAL_DEGREE;
    return found;
}

/* Energy sum of the evaluated members over the ideal energy, less ENERGY_PER_PARTICLE for each. */
static double excess(repair_scratch *b, const repair_region *p)
{
    double sum = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        if (!p->evaluated[i]) continue;
        sum += pair_energy_at(gather_pairs(b, p, i), &energy_cotangent, p->x[i], packing_support(p->h[i])) /
                   energy_cotangent.ideal -
               ENERGY_PER_PARTICLE;
    }
    return sum;
}

/* Cost of the area of a Voronoi cell. */
static double area_cost(double area, double h, double mean)
{
    const double off = area > 0 ? sqrt(area / packing_cell_area(h)) / mean - 1 : 1;
    return AREA_COST * fmin(off * off, MAX_AREA_SQUARE);
}

/* Orders the evaluated members: first those without six members in the first shell, mostly the defects. The
 * cost then exceeds the limit early. */
static uint32_t order_evaluated(const repair_region *p, uint32_t order[REPAIR_MAX_MEMBERS])
{
    uint32_t count = 0, regular_list[REPAIR_MAX_MEMBERS], regular = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        if (!p->evaluated[i]) continue;
        if (count_shell(p, i) != PACKING_IDEAL_DEGREE)
            order[count++] = i;
        else
            regular_list[regular++] = i;
    }
    for (uint32_t k = 0; k < regular; k++) order[count++] = regular_list[k];
    return count;
}

bool repair_region_evaluate(repair_scratch *b, repair_region *p, double limit)
{
    const neighbours near = {.count = p->count,
                             .list = p->list,
                             .list_begin = p->begin,
                             .list_count = p->listed,
                             .list_capacity = REPAIR_MAX_LIST};
    const voronoi_sites sites = {p->x, p->normal, p->h, &near, NULL, NULL};
    uint32_t order[REPAIR_MAX_MEMBERS];
    const uint32_t evaluated = order_evaluated(p, order);
    for (uint32_t i = 0; i < p->count; i++) p->degree[i] = PACKING_IDEAL_DEGREE;
    p->defects = 0;
    p->cost = ENERGY_COST * excess(b, p);
    for (uint32_t k = 0; k < evaluated && !(p->cost > limit); k++) {
        voronoi_star star;
        voronoi_star_at(&sites, order[k], &star);
        p->degree[order[k]] = (uint8_t)(star.count < UINT8_MAX ? star.count : UINT8_MAX);
        p->defects += star.count != PACKING_IDEAL_DEGREE;
        p->cost += (star.count != PACKING_IDEAL_DEGREE) +
                   area_cost(voronoi_star_area(&star), p->h[order[k]], b->mean);
    }
    return !(p->cost > limit);
}

/* --- trial changes --- */

static void activate(repair_region *p, vec3 x, double h)
{
    for (uint32_t i = 0; i < p->free; i++)
        p->active[i] |= vec3_norm2(vec3_sub(p->x[i], x)) < ACTIVATION_RADIUS * ACTIVATION_RADIUS * h * h;
}

static vec3 random_tangent(vec3 normal, rng *r)
{
    vec3 u, v;
    double angle = 2 * M_PI * rng_uniform(r);
    vec3_frame(normal, &u, &v);
    return vec3_axpy(elementary_cos(angle), u, vec3_scale(v, elementary_sin(angle)));
}

static void copy_member(repair_region *p, uint32_t to, uint32_t from)
{
    p->x[to] = p->x[from];
    p->normal[to] = p->normal[from];
    p->h[to] = p->h[from];
    p->evaluated[to] = p->evaluated[from];
    p->active[to] = p->active[from];
    p->degree[to] = p->degree[from];
    p->hint[to] = p->hint[from];
}

static void delete_member(repair_region *p, uint32_t k)
{
    assert(k < p->free);
    activate(p, p->x[k], p->h[k]);
    copy_member(p, k, --p->free);
    copy_member(p, p->free, --p->count);
}

/* Inserts a free member half a spacing from member `beside`. False: no capacity or no valid position. */
static bool insert_member(repair_region *p, uint32_t beside, rng *r)
{
    const double h = p->h[beside];
    vec3 normal = p->normal[beside], x = vec3_axpy(0.5 * h, random_tangent(normal, r), p->x[beside]);
    uint32_t hint = FIELD_NO_HINT;
    if (p->count == REPAIR_MAX_MEMBERS || p->free == REPAIR_MAX_FREE ||
        !solver_project_point(p->field, h, h, &hint, &x, &normal) ||
        !field_is_within_near(p->field, x, &hint))
        return false;
    copy_member(p, p->count++, p->free);
    p->x[p->free] = x;
    p->normal[p->free] = normal;
    p->h[p->free] = h;
    p->hint[p->free] = hint;
    p->evaluated[p->free] = true;
    p->degree[p->free++] = PACKING_IDEAL_DEGREE;
    activate(p, x, h);
    return true;
}

/* Picks a random free member without six neighbours. False: there is none. */
static bool pick(const repair_region *p, rng *r, uint32_t *out)
{
    uint32_t found = 0;
    for (uint32_t k = 0; k < p->free; k++)
        if (p->degree[k] != PACKING_IDEAL_DEGREE && rng_uniform(r) * ++found < 1) *out = k;
    return found > 0;
}

bool repair_region_modify(repair_region *p, rng *r)
{
    uint32_t member = 0;
    const double kind = rng_uniform(r);
    if (!pick(p, r, &member)) return false;
    if (kind < INSERTION_SHARE) return insert_member(p, member, r);
    delete_member(p, member);
    return kind < INSERTION_SHARE + DELETION_SHARE || (pick(p, r, &member) && insert_member(p, member, r));
}

/* --- relaxation --- */

/* One Newton step with the first term of (10) only. Returns the step length over h. */
static double move_particle(repair_scratch *b, repair_region *p, uint32_t i)
{
    vec3 u, v, x, normal = p->normal[i];
    pair_forces f;
    vec3_frame(normal, &u, &v);
    pair_forces_at(gather_pairs(b, p, i), &energy_cotangent, p->x[i], u, v, packing_support(p->h[i]), &f);
    const double determinant = f.h11 * f.h22 - f.h12 * f.h12;
    if (!(determinant > 1e-9 * (f.h11 + f.h22) * (f.h11 + f.h22))) return 0;
    const double along_u = OMEGA * (f.h12 * f.d2 - f.h22 * f.d1) / determinant;
    const double along_v = OMEGA * (f.h12 * f.d1 - f.h11 * f.d2) / determinant;
    const double length = sqrt(along_u * along_u + along_v * along_v);
    const double scale = fmin(1, MAX_STEP * p->h[i] / fmax(length, 1e-300));
    x = vec3_axpy(scale * along_u, u, vec3_axpy(scale * along_v, v, p->x[i]));
    const projection_limits limits = projection_draft(p->h[i]);
    if (!projection_find_near(p->field, &limits, &p->hint[i], &x, &normal)) return 0;
    p->x[i] = x;
    p->normal[i] = normal;
    return scale * length / p->h[i];
}

/* Moves the active members once; those that move activate their neighbours. False: all have converged. */
static bool sweep_active(repair_scratch *b, repair_region *p)
{
    bool any = false;
    for (uint32_t i = 0; i < p->free; i++) {
        if (!p->active[i]) continue;
        p->active[i] = move_particle(b, p, i) > CONVERGED_STEP;
        any |= p->active[i];
        for (uint32_t k = 0; p->active[i] && k < p->listed[i]; k++)
            p->active[p->list[p->begin[i] + k]] = true;
    }
    return any;
}

static void renew_sizes(const solver *s, repair_region *p)
{
    if (!s->setup.params.sizing) return;
    for (uint32_t i = 0; i < p->free; i++)
        p->h[i] = sizing_field_spacing(s->setup.params.sizing, p->x[i], NULL);
}

bool repair_region_relax(repair_scratch *b, repair_region *p)
{
    for (int sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        if (sweep % LIST_SWEEPS == 0) {
            if (sweep > 0) renew_sizes(b->s, p);
            build_lists(p, p->free);
        }
        if (!sweep_active(b, p)) break;
    }
    for (uint32_t i = 0; i < p->free; i++)
        if (!field_is_within_near(p->field, p->x[i], &p->hint[i])) return false;
    renew_sizes(b->s, p);
    repair_region_list(p);
    for (uint32_t i = 0; i < p->count; i++) p->active[i] = false;
    return true;
}
