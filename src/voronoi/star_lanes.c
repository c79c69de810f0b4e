#include "voronoi/star_lanes.h"

#include <string.h>

#include "base/isa.h"
#include "packing/packing.h"

enum { LANES = STAR_LANES };
/* Maximum number of points of a ring; an ideal packing has six. */
enum { SLOTS = 8 };

/* False: a list is longer than STAR_LIST_MAX. */
static bool gather_lists(const voronoi_sites *in, const uint32_t *points, uint32_t count, star_lists *out)
{
    out->most = 0;
    for (uint32_t l = 0; l < LANES; l++) {
        const uint32_t a = points[l < count ? l : 0], listed = in->near->list_count[a];
        if (listed > STAR_LIST_MAX) return false;
        const uint32_t *list = neighbours_list(in->near, a);
        const vec3 x = in->position[a], n = in->normal[a];
        out->point[l] = a;
        out->count[l] = listed;
        out->most = listed > out->most ? listed : out->most;
        for (uint32_t k = 0; k < listed; k++) {
            const vec3 r = vec3_sub(in->position[list[k]], x);
            vec3 m = in->normal[list[k]];
            if (in->flags && in->flags[list[k]] & PACKING_ONE_SIDED && vec3_dot(m, n) < 0)
                m = vec3_scale(m, -1);
            out->x[k][l] = r.x;
            out->y[k][l] = r.y;
            out->z[k][l] = r.z;
            out->nx[k][l] = m.x;
            out->ny[k][l] = m.y;
            out->nz[k][l] = m.z;
            out->spacing[k][l] = in->spacing[list[k]];
        }
    }
    return true;
}

#define SQRT(to, from) \
    for (int l_ = 0; l_ < LANES; l_++) (to)[l_] = sqrt((from)[l_])

/* The points around each own point, one per slot. */
typedef struct slots {
    lane_values x[SLOTS + 1], y[SLOTS + 1], z[SLOTS + 1], square[SLOTS + 1];
} slots;

typedef struct rings {
    lane_values spacing, nx, ny, nz, ux, uy, uz, vx, vy, vz;
    lane_mask listed, within[STAR_LIST_MAX], bent;
    lane_values beyond;          /* lower bound of the squared distance of the points outside */
    lane_values clear;           /* minimum length of an edge */
    uint8_t place[SLOTS][LANES]; /* per slot: its entry in the list */
    lane_mask count;             /* points of each ring; 0: too few, or too many */
    lane_mask rank[SLOTS];       /* per slot: its rank by angle */
    uint32_t most;               /* maximum of `count` */
    slots in_list, at; /* offsets in space, in the order of the list; offsets in the plane, by angle */
    lane_values last_x, last_y, last_square; /* of the point before the first */
    lane_mask is_planar;
    lane_values distance[SLOTS], edge[SLOTS];
} rings;

static void set_frames(const voronoi_sites *in, const star_lists *lists, rings *g)
{
    for (int l = 0; l < LANES; l++) {
        const vec3 n = in->normal[lists->point[l]];
        vec3 u, v;
        vec3_frame(n, &u, &v);
        g->spacing[l] = in->spacing[lists->point[l]];
        g->listed[l] = lists->count[l];
        g->nx[l] = n.x;
        g->ny[l] = n.y;
        g->nz[l] = n.z;
        g->ux[l] = u.x;
        g->uy[l] = u.y;
        g->uz[l] = u.z;
        g->vx[l] = v.x;
        g->vy[l] = v.y;
        g->vz[l] = v.z;
    }
}

/* gather_ring of voronoi.c, entry by entry. */
ISA_CLONES static void look_around(star_lists *lists, rings *g)
{
    const lane_values nx = g->nx, ny = g->ny, nz = g->nz, reach = STAR_RING_FIRST * g->spacing,
                      reach2 = reach * reach;
    lane_values least = g->spacing, widest = g->spacing, beyond = ALL(INFINITY);
    lane_mask bent = {0};
    for (uint32_t k = 0; k < lists->most; k++) {
        const lane_values x = *(const lane_values *)lists->x[k], y = *(const lane_values *)lists->y[k],
                          z = *(const lane_values *)lists->z[k], mx = *(const lane_values *)lists->nx[k],
                          my = *(const lane_values *)lists->ny[k], mz = *(const lane_values *)lists->nz[k],
                          spacing = *(const lane_values *)lists->spacing[k];
        const lane_values facing = nx * mx + ny * my + nz * mz, square = x * x + y * y + z * z,
                          height = nx * x + ny * y + nz * z;
        const lane_mask seen = (g->listed > k) & ~(facing <= STAR_OPPOSITE_COSINE);
        const lane_mask bends = (facing < STAR_MIN_COSINE) |
                                (height * height > STAR_MAX_SLOPE * STAR_MAX_SLOPE * square) | (square == 0);
        const lane_mask within = seen & (square < reach2), outside = seen & ~within & (square < beyond);
        const lane_mask finer = seen & (spacing < least), wider = seen & (spacing > widest);
        bent |= seen & bends;
        least = CHOOSE(finer, spacing, least);
        widest = CHOOSE(wider, spacing, widest);
        beyond = CHOOSE(outside, square, beyond);
        g->within[k] = within;
        *(lane_values *)lists->facing[k] = facing;
        *(lane_values *)lists->square[k] = square;
    }
    const lane_values unlisted = VORONOI_REACH * 0.5 * (g->spacing + least), unlisted2 = unlisted * unlisted;
    g->beyond = CHOOSE(unlisted2 < beyond, unlisted2, beyond);
    g->clear = STAR_MIN_EDGE * widest;
    g->bent = bent;
}

/* Collects the points within, in the order of the list. Which they are is unpredictable: there are no branches on it. */
static void fill_slots(const star_lists *lists, rings *g)
{
    g->most = 0;
    memset(&g->in_list, 0, sizeof g->in_list); /* old values may be denormal, which is slow */
    for (int l = 0; l < LANES; l++) {
        uint8_t place[STAR_LIST_MAX + 1];
        uint32_t count = 0;
        for (uint32_t k = 0; k < lists->count[l]; k++) {
            place[count] = (uint8_t)k;
            count += g->within[k][l] & 1;
        }
        if (count < 3 || count > SLOTS) count = 0;
        g->count[l] = count;
        g->most = count > g->most ? count : g->most;
        for (uint32_t t = 0; t < count; t++) {
            const uint32_t k = place[t];
            g->place[t][l] = place[t];
            g->in_list.x[t][l] = lists->x[k][l];
            g->in_list.y[t][l] = lists->y[k][l];
            g->in_list.z[t][l] = lists->z[k][l];
            g->in_list.square[t][l] = lists->square[k][l];
        }
    }
}

/* Ranks the slots by angle in the plane, starting with the nearest: order_ring of voronoi.c. */
ISA_CLONES static void order_slots(rings *g)
{
    slots plane, *to = &g->at;
    lane_values angle[SLOTS];
    lane_mask rank[SLOTS] = {0};
    const uint32_t most = g->most;
    for (uint32_t t = 0; t < most; t++) {
        const lane_values rx = g->in_list.x[t], ry = g->in_list.y[t], rz = g->in_list.z[t];
        const lane_values x = g->ux * rx + g->uy * ry + g->uz * rz, y = g->vx * rx + g->vy * ry + g->vz * rz;
        const lane_mask sign = (lane_mask){0} + INT64_MIN;
        const lane_values sum = (lane_values)((lane_mask)x & ~sign) + (lane_values)((lane_mask)y & ~sign);
        const lane_values grows = (lane_values)(((lane_mask)(1 - x / sum) & ~sign) |
                                                ((lane_mask)y & sign)); /* with the angle, from -2 to 2 */
        const lane_mask is_there = g->count > t;
        plane.x[t] = x;
        plane.y[t] = y;
        plane.z[t] = g->nx * rx + g->ny * ry + g->nz * rz;
        plane.square[t] = CHOOSE(is_there, g->in_list.square[t], ALL(INFINITY));
        angle[t] = CHOOSE(is_there, grows, ALL(INFINITY));
    }
    for (uint32_t t = 1; t < most; t++)
        for (uint32_t s = 0; s < t; s++) {
            const lane_mask later = angle[t] >= angle[s];
            rank[t] -= later;
            rank[s] += 1 + later;
        }
    lane_mask first = rank[0];
    lane_values nearest = plane.square[0];
    for (uint32_t t = 1; t < most; t++) {
        const lane_mask nearer = plane.square[t] < nearest;
        first = (lane_mask)CHOOSE(nearer, rank[t], first);
        nearest = CHOOSE(nearer, plane.square[t], nearest);
    }
    for (uint32_t t = 0; t < most; t++) {
        const lane_mask is_there = g->count > t, before = rank[t] - first;
        rank[t] = (lane_mask)CHOOSE(is_there, before + (g->count & (before < 0)), rank[t]);
        g->rank[t] = rank[t];
    }
    for (uint32_t s = 0; s <= most; s++) {
        lane_values x = {0}, y = {0}, z = {0}, square = {0};
        for (uint32_t t = 0; t < most; t++) {
            const lane_mask here = rank[t] == s;
            x = CHOOSE(here, plane.x[t], x);
            y = CHOOSE(here, plane.y[t], y);
            z = CHOOSE(here, plane.z[t], z);
            square = CHOOSE(here, plane.square[t], square);
        }
        to->x[s] = x;
        to->y[s] = y;
        to->z[s] = z;
        to->square[s] = square;
    }
}

/* Repeats the first point after the last one of each ring, and copies the last one to last_x, last_y and last_square. */
ISA_CLONES static void close_rings(rings *g)
{
    slots *at = &g->at;
    g->last_x = g->last_y = g->last_square = ALL(0);
    for (uint32_t t = 1; t <= g->most; t++) {
        const lane_mask end = g->count == t;
        at->x[t] = CHOOSE(end, at->x[0], at->x[t]);
        at->y[t] = CHOOSE(end, at->y[0], at->y[t]);
        at->z[t] = CHOOSE(end, at->z[0], at->z[t]);
        at->square[t] = CHOOSE(end, at->square[0], at->square[t]);
        g->last_x = CHOOSE(end, at->x[t - 1], g->last_x);
        g->last_y = CHOOSE(end, at->y[t - 1], g->last_y);
        g->last_square = CHOOSE(end, at->square[t - 1], g->last_square);
    }
}

/* Whether every point of a ring has an edge, and the points outside are too far for one: judge_edge and is_closed of voronoi.c. */
ISA_CLONES static void judge_rings(rings *g)
{
    const slots *at = &g->at;
    lane_values px = g->last_x, py = g->last_y, p2 = g->last_square, root;
    SQRT(root, g->beyond);
    const lane_values corner = root - g->clear;
    lane_mask good = (g->count > 0) & (corner > 0);
    for (uint32_t t = 0; t < g->most; t++) {
        const lane_values qx = at->x[t], qy = at->y[t], q2 = at->square[t], rx = at->x[t + 1],
                          ry = at->y[t + 1], r2 = at->square[t + 1];
        const lane_values plane = qx * qx + qy * qy, dot = qx * rx + qy * ry, before = px * qy - py * qx,
                          after = qx * ry - qy * rx;
        const lane_values rest_p = p2 * plane - q2 * (qx * px + qy * py), rest_r = r2 * plane - q2 * dot;
        lane_values across;
        SQRT(across, plane);
        const lane_values length = rest_r * before + rest_p * after,
                          least = 2 * g->clear * across * before * after;
        const lane_mask kept = (before > 0) & (after > 0) & (length > least);
        const lane_mask is_far =
            rest_r * rest_r + q2 * q2 * after * after > corner * corner * plane * after * after;
        good &= (kept & ~(dot < 0) & ~is_far) | (g->count <= t);
        px = qx;
        py = qy;
        p2 = q2;
    }
    g->is_planar = good;
}

/* measure_star of voronoi.c. */
ISA_CLONES static void measure_rings(rings *g)
{
    const slots *at = &g->at;
    lane_values next[SLOTS], last = {0};
    SQRT(g->distance[0], at->square[0]);
    for (uint32_t t = 0; t < g->most; t++) {
        const lane_values q2 = at->square[t], r2 = at->square[t + 1];
        const lane_values dot = at->x[t] * at->x[t + 1] + at->y[t] * at->y[t + 1] + at->z[t] * at->z[t + 1];
        const lane_values sine2 = q2 * r2 - dot * dot;
        lane_values sine, far;
        SQRT(sine, sine2);
        SQRT(far, r2);
        const lane_values half = 0.5 / sine;
        if (t + 1 < SLOTS) g->distance[t + 1] = far;
        g->edge[t] = half * g->distance[t] * (r2 - dot);
        next[t] = half * far * (q2 - dot);
        last = CHOOSE(g->count == t + 1, next[t], last);
    }
    g->edge[0] += last;
    for (uint32_t t = 1; t < g->most; t++) g->edge[t] += next[t - 1];
}

static void find_rings(star_lists *lists, rings *g)
{
    look_around(lists, g);
    fill_slots(lists, g);
    order_slots(g);
    close_rings(g);
    judge_rings(g);
    measure_rings(g);
}

static void write_star(const rings *g, int l, const uint32_t *list, voronoi_star *out)
{
    const uint32_t count = (uint32_t)g->count[l];
    out->count = out->triangle_count = count;
    out->pinched = false;
    for (uint32_t t = 0; t < count; t++) out->place[g->rank[t][l]] = g->place[t][l];
    for (uint32_t t = 0; t < count; t++) {
        out->point[t] = list[out->place[t]];
        out->distance[t] = g->distance[t][l];
        out->edge[t] = g->edge[t][l];
        out->triangles[t] = 2;
        out->corner[t][0] = (uint8_t)t;
        out->corner[t][1] = (uint8_t)(t + 1 < count ? t + 1 : 0);
    }
}

/* PLANAR: the star is valid. UNSURE: voronoi_star_planar may find a valid one. BENT: it cannot. */
typedef enum verdict { PLANAR, UNSURE, BENT } verdict;

/* Computes the planar stars of the first `count` points. */
static void find_planar(const voronoi_sites *in, star_lists *lists, uint32_t count, voronoi_star *out,
                        verdict found[STAR_LANES])
{
    rings g;
    set_frames(in, lists, &g);
    find_rings(lists, &g);
    for (uint32_t l = 0; l < count; l++) {
        found[l] = g.bent[l] ? BENT : g.is_planar[l] ? PLANAR : UNSURE;
        if (found[l] == PLANAR) write_star(&g, (int)l, neighbours_list(in->near, lists->point[l]), &out[l]);
    }
}

bool star_lanes_at(const voronoi_sites *in, const uint32_t *points, uint32_t count, star_lists *lists,
                   voronoi_star *out)
{
    verdict found[STAR_LANES];
    const bool listed = gather_lists(in, points, count, lists);
    if (listed) find_planar(in, lists, count, out, found);
    for (uint32_t l = 0; l < count; l++)
        if (!listed || found[l] == UNSURE)
            voronoi_star_at(in, points[l], &out[l]);
        else if (found[l] == BENT)
            voronoi_star_triangles(in, points[l], &out[l]);
    return listed;
}
