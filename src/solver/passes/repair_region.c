#include "solver/passes/repair_region.h"

#include <assert.h>
#include <math.h>

#include "field/projection.h"
#include "packing/energy.h"
#include "packing/neighbours.h"
#include "packing/packing.h"
#include "voronoi/voronoi.h"

enum { SWEEPS = 16, LIST_SWEEPS = 8 };
/* Of what is tried: one less; one more; the rest moves one. */
static const double REMOVAL = 0.4, INSERTION = 0.4;
/* An ideal energy of excess counts as so many particles out of order: of pieces with as many, the one under less strain
 * remains. */
static const double PRICE = 0.1;
/* So does the square of how far the spacing that a cell has is off; one of five or seven neighbours is off by .035. At most so
 * large a square counts, and so much where there is no cell. */
static const double UNEVEN = 50, UNEVEN_MOST = 0.1;
/* A particle more in the same area adds so many ideal energies to the sum. */
static const double PRESSURE = 3.35;
/* Over-relaxation; and over h the longest step and one that wakes nobody. */
static const double OMEGA = 2.4, LONGEST_STEP = 0.15, STILL = 1e-2;
/* Who is nearer than this to what is changed, over h, has to move. */
static const double WOKEN = 2;
/* Between the first and the second shell. */
static const double BETWEEN_SHELLS = 1.366;

/* --- neighbours --- */

/* Two loops, of which the first goes by lanes. */
static void list_one(repair_region *p, uint32_t i, uint32_t *at)
{
    const vec3 x = p->x[i];
    const double h = p->h[i];
    double beyond[REPAIR_REGION_MOST];
    for (uint32_t j = 0; j < p->count; j++) {
        double dx = p->x[j].x - x.x, dy = p->x[j].y - x.y, dz = p->x[j].z - x.z;
        double within = 0.5 * VORONOI_REACH * (h + p->h[j]);
        beyond[j] = dx * dx + dy * dy + dz * dz - within * within;
    }
    p->begin[i] = *at;
    for (uint32_t j = 0; j < p->count && *at < REPAIR_LIST_MOST; j++) {
        p->list[*at] = j;
        *at += (beyond[j] < 0) & (j != i);
    }
    p->listed[i] = *at - p->begin[i];
}

static void list_first(repair_region *p, uint32_t count)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < count; i++) list_one(p, i, &at);
}

void repair_region_list(repair_region *p)
{
    list_first(p, p->count);
}

void repair_scratch_begin(repair_scratch *b, const solver *s)
{
    double(*of)[REPAIR_PAIRS_MOST] = b->number;
    b->s = s;
    b->pairs = (pair_list){0, of[0], of[1], of[2], of[3], of[4], of[5], of[6], of[7], of[8]};
}

/* Its pairs, weighed as in the solve. */
static const pair_list *gather_pairs(repair_scratch *b, const repair_region *p, uint32_t i)
{
    pair_list *g = &b->pairs;
    const uint32_t *list = p->list + p->begin[i];
    const uint32_t listed = p->listed[i] < REPAIR_PAIRS_MOST ? p->listed[i] : REPAIR_PAIRS_MOST;
    g->blocks = (listed + PAIR_LANES - 1) / PAIR_LANES;
    for (uint32_t k = 0; k < g->blocks * PAIR_LANES; k++) {
        const uint32_t j = k < listed ? list[k] : i;
        const double size = 0.5 * (1 + p->h[j] / p->h[i]);
        g->x[k] = k < listed ? p->x[j].x : p->x[i].x + 2 * packing_support(p->h[i]);
        g->y[k] = p->x[j].y;
        g->z[k] = p->x[j].z;
        g->nx[k] = p->normal[j].x;
        g->ny[k] = p->normal[j].y;
        g->nz[k] = p->normal[j].z;
        g->size2[k] = size * size;
        g->amplitude[k] = k < listed;
    }
    pair_weigh(g, p->normal[i]);
    return g;
}

/* --- what it is worth --- */

static int count_shell(const repair_region *p, uint32_t i)
{
    int near = 0;
    for (uint32_t k = 0; k < p->listed[i]; k++) {
        const uint32_t j = p->list[p->begin[i] + k];
        const double within = 0.5 * BETWEEN_SHELLS * (p->h[i] + p->h[j]);
        near += vec3_norm2(vec3_sub(p->x[i], p->x[j])) < within * within;
    }
    return near;
}

int repair_region_guess(const repair_region *p)
{
    int found = 0;
    for (uint32_t i = 0; i < p->count; i++) found += p->judged[i] && count_shell(p, i) != 6;
    return found;
}

/* The energies of those that are judged, over the ideal, less what their number alone asks for. */
static double excess(repair_scratch *b, const repair_region *p)
{
    double sum = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        if (!p->judged[i]) continue;
        sum += pair_energy_at(gather_pairs(b, p, i), &energy_cotangent, p->x[i], packing_support(p->h[i])) /
                   energy_cotangent.ideal -
               PRESSURE;
    }
    return sum;
}

static double unevenness(double area, double h, double mean)
{
    const double off = area > 0 ? sqrt(area / packing_cell_area(h)) / mean - 1 : 1;
    return UNEVEN * fmin(off * off, UNEVEN_MOST);
}

/* Those whose shell is not of six first: they are mostly the disordered, and soon cost more than the limit. */
static uint32_t order_judged(const repair_region *p, uint32_t order[REPAIR_REGION_MOST])
{
    uint32_t count = 0, ordered[REPAIR_REGION_MOST], later = 0;
    for (uint32_t i = 0; i < p->count; i++) {
        if (!p->judged[i]) continue;
        if (count_shell(p, i) != 6)
            order[count++] = i;
        else
            ordered[later++] = i;
    }
    for (uint32_t k = 0; k < later; k++) order[count++] = ordered[k];
    return count;
}

bool repair_region_judge(repair_scratch *b, repair_region *p, double limit)
{
    const neighbours near = {.count = p->count,
                             .list = p->list,
                             .list_begin = p->begin,
                             .list_count = p->listed,
                             .list_capacity = REPAIR_LIST_MOST};
    const voronoi_sites sites = {p->x, p->normal, p->h, &near, NULL, NULL};
    uint32_t order[REPAIR_REGION_MOST];
    const uint32_t judged = order_judged(p, order);
    for (uint32_t i = 0; i < p->count; i++) p->degree[i] = 6;
    p->disordered = 0;
    p->cost = PRICE * excess(b, p);
    for (uint32_t k = 0; k < judged && !(p->cost > limit); k++) {
        voronoi_star star;
        voronoi_star_at(&sites, order[k], &star);
        p->degree[order[k]] = (uint8_t)(star.count < UINT8_MAX ? star.count : UINT8_MAX);
        p->disordered += star.count != 6;
        p->cost += (star.count != 6) + unevenness(voronoi_star_area(&star), p->h[order[k]], b->mean);
    }
    return !(p->cost > limit);
}

/* --- what is tried --- */

static void wake(repair_region *p, vec3 x, double h)
{
    for (uint32_t i = 0; i < p->free; i++)
        p->awake[i] |= vec3_norm2(vec3_sub(p->x[i], x)) < WOKEN * WOKEN * h * h;
}

static vec3 random_tangent(vec3 normal, rng *r)
{
    vec3 u, v;
    double angle = 2 * M_PI * rng_uniform(r);
    vec3_frame(normal, &u, &v);
    return vec3_axpy(cos(angle), u, vec3_scale(v, sin(angle)));
}

static void copy_member(repair_region *p, uint32_t to, uint32_t from)
{
    p->x[to] = p->x[from];
    p->normal[to] = p->normal[from];
    p->h[to] = p->h[from];
    p->judged[to] = p->judged[from];
    p->awake[to] = p->awake[from];
    p->degree[to] = p->degree[from];
    p->hint[to] = p->hint[from];
}

static void take_out(repair_region *p, uint32_t k)
{
    assert(k < p->free);
    wake(p, p->x[k], p->h[k]);
    copy_member(p, k, --p->free);
    copy_member(p, p->free, --p->count);
}

/* Half a spacing from one that moves. */
static bool put_in(repair_region *p, uint32_t beside, rng *r)
{
    const double h = p->h[beside];
    vec3 normal = p->normal[beside], x = vec3_axpy(0.5 * h, random_tangent(normal, r), p->x[beside]);
    if (p->count == REPAIR_REGION_MOST || p->free == REPAIR_FREE_MOST ||
        !solver_project_point(p->field, h, h, &x, &normal) || !field_is_within(p->field, x))
        return false;
    copy_member(p, p->count++, p->free);
    p->x[p->free] = x;
    p->normal[p->free] = normal;
    p->h[p->free] = h;
    p->hint[p->free] = FIELD_NO_HINT;
    p->judged[p->free] = true;
    p->degree[p->free++] = 6;
    wake(p, x, h);
    return true;
}

/* One of those that are out of order and move; false where there is none. */
static bool pick(const repair_region *p, rng *r, uint32_t *out)
{
    uint32_t found = 0;
    for (uint32_t k = 0; k < p->free; k++)
        if (p->degree[k] != 6 && rng_uniform(r) * ++found < 1) *out = k;
    return found > 0;
}

bool repair_region_change(repair_region *p, rng *r)
{
    uint32_t who = 0;
    const double kind = rng_uniform(r);
    if (!pick(p, r, &who)) return false;
    if (kind < INSERTION) return put_in(p, who, r);
    take_out(p, who);
    return kind < INSERTION + REMOVAL || (pick(p, r, &who) && put_in(p, who, r));
}

/* --- its way to rest --- */

/* One Newton step, with the first term of (10) alone; how far it went over h. */
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
    const double shorter = fmin(1, LONGEST_STEP * p->h[i] / fmax(length, 1e-300));
    x = vec3_axpy(shorter * along_u, u, vec3_axpy(shorter * along_v, v, p->x[i]));
    const projection_limits limits = {6, 1e-3 * p->h[i], 3e-2 * p->h[i], 1e-2 * p->h[i]};
    if (!projection_find_near(p->field, &limits, &p->hint[i], &x, &normal)) return 0;
    p->x[i] = x;
    p->normal[i] = normal;
    return shorter * length / p->h[i];
}

/* Of those that are awake. False where nobody is any more. */
static bool sweep_awake(repair_scratch *b, repair_region *p)
{
    bool any = false;
    for (uint32_t i = 0; i < p->free; i++) {
        if (!p->awake[i]) continue;
        p->awake[i] = move_particle(b, p, i) > STILL;
        any |= p->awake[i];
        for (uint32_t k = 0; p->awake[i] && k < p->listed[i]; k++) p->awake[p->list[p->begin[i] + k]] = true;
    }
    return any;
}

static void renew_sizes(const solver *s, repair_region *p)
{
    if (!s->setup.params.sizing) return;
    for (uint32_t i = 0; i < p->free; i++)
        p->h[i] = sizing_field_spacing(s->setup.params.sizing, p->x[i], NULL);
}

bool repair_region_settle(repair_scratch *b, repair_region *p)
{
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        if (sweep % LIST_SWEEPS == 0) {
            if (sweep > 0) renew_sizes(b->s, p);
            list_first(p, p->free);
        }
        if (!sweep_awake(b, p)) break;
    }
    for (uint32_t i = 0; i < p->free; i++)
        if (!field_is_within_near(p->field, p->x[i], &p->hint[i])) return false;
    renew_sizes(b->s, p);
    repair_region_list(p);
    for (uint32_t i = 0; i < p->count; i++) p->awake[i] = false;
    return true;
}
