#include "voronoi/star_lanes.h"

#include <string.h>

#include "base/isa.h"
#include "packing/packing.h"

enum { LANES = STAR_LANES };
/* Points of a ring that are looked at: an even packing has six. */
enum { SLOTS = 8 };

/* False when a list is longer than STAR_ROWS. */
static bool gather_rows(const voronoi_sites *in, const uint32_t *points, uint32_t count, star_rows *out)
{
    out->most = 0;
    for (uint32_t l = 0; l < LANES; l++) {
        const uint32_t a = points[l < count ? l : 0], listed = in->near->list_count[a];
        if (listed > STAR_ROWS) return false;
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

/* The points around each, by slots. */
typedef struct slots {
    row x[SLOTS + 1], y[SLOTS + 1], z[SLOTS + 1], square[SLOTS + 1];
} slots;

typedef struct rings {
    row spacing, nx, ny, nz, ux, uy, uz, vx, vy, vz;
    mask listed, within[STAR_ROWS], bent;
    row beyond;                      /* squared distance that those outside have at least */
    row clear;                       /* the shortest edge that is */
    uint8_t place[SLOTS][LANES];     /* of each slot, in the list */
    mask count;                      /* points of each ring; 0: too few, or too many */
    mask rank[SLOTS];                /* where each slot stands by angle */
    uint32_t most;                   /* points of a ring */
    slots in_list, at;               /* ways in space, in the order of the list; in the plane, by angle */
    row last_x, last_y, last_square; /* before the first */
    mask is_clear;
    row distance[SLOTS], edge[SLOTS];
} rings;

static void set_frames(const voronoi_sites *in, const star_rows *rows, rings *g)
{
    for (int l = 0; l < LANES; l++) {
        const vec3 n = in->normal[rows->point[l]];
        vec3 u, v;
        vec3_frame(n, &u, &v);
        g->spacing[l] = in->spacing[rows->point[l]];
        g->listed[l] = rows->count[l];
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

/* As gather_ring of voronoi.c, entry by entry. */
ISA_CLONES static void look_around(star_rows *rows, rings *g)
{
    const row nx = g->nx, ny = g->ny, nz = g->nz, reach = STAR_RING_FIRST * g->spacing,
              reach2 = reach * reach;
    row least = g->spacing, widest = g->spacing, beyond = ALL(INFINITY);
    mask bent = {0};
    for (uint32_t k = 0; k < rows->most; k++) {
        const row x = *(const row *)rows->x[k], y = *(const row *)rows->y[k], z = *(const row *)rows->z[k],
                  mx = *(const row *)rows->nx[k], my = *(const row *)rows->ny[k],
                  mz = *(const row *)rows->nz[k], spacing = *(const row *)rows->spacing[k];
        const row facing = nx * mx + ny * my + nz * mz, square = x * x + y * y + z * z,
                  height = nx * x + ny * y + nz * z;
        const mask seen = (g->listed > k) & ~(facing <= STAR_OTHER_SIDE);
        const mask bends = (facing < STAR_FLAT_FACING) |
                           (height * height > STAR_FLAT_HEIGHT * STAR_FLAT_HEIGHT * square) | (square == 0);
        const mask within = seen & (square < reach2), outside = seen & ~within & (square < beyond);
        const mask finer = seen & (spacing < least), wider = seen & (spacing > widest);
        bent |= seen & bends;
        least = CHOOSE(finer, spacing, least);
        widest = CHOOSE(wider, spacing, widest);
        beyond = CHOOSE(outside, square, beyond);
        g->within[k] = within;
        *(row *)rows->facing[k] = facing;
        *(row *)rows->square[k] = square;
    }
    const row unlisted = VORONOI_REACH * 0.5 * (g->spacing + least), unlisted2 = unlisted * unlisted;
    g->beyond = CHOOSE(unlisted2 < beyond, unlisted2, beyond);
    g->clear = STAR_CLEAR * widest;
    g->bent = bent;
}

/* Those within, in the order of the list. Which they are is as good as random, so nothing branches on it. */
static void fill_slots(const star_rows *rows, rings *g)
{
    g->most = 0;
    memset(&g->in_list, 0, sizeof g->in_list); /* what stood there may be denormal, which is slow */
    for (int l = 0; l < LANES; l++) {
        uint8_t place[STAR_ROWS + 1];
        uint32_t count = 0;
        for (uint32_t k = 0; k < rows->count[l]; k++) {
            place[count] = (uint8_t)k;
            count += g->within[k][l] & 1;
        }
        if (count < 3 || count > SLOTS) count = 0;
        g->count[l] = count;
        g->most = count > g->most ? count : g->most;
        for (uint32_t t = 0; t < count; t++) {
            const uint32_t k = place[t];
            g->place[t][l] = place[t];
            g->in_list.x[t][l] = rows->x[k][l];
            g->in_list.y[t][l] = rows->y[k][l];
            g->in_list.z[t][l] = rows->z[k][l];
            g->in_list.square[t][l] = rows->square[k][l];
        }
    }
}

/* Where each stands by angle in the plane, the nearest first: as order_ring of voronoi.c. */
ISA_CLONES static void order_slots(rings *g)
{
    slots plane, *to = &g->at;
    row angle[SLOTS];
    mask rank[SLOTS] = {0};
    const uint32_t most = g->most;
    for (uint32_t t = 0; t < most; t++) {
        const row rx = g->in_list.x[t], ry = g->in_list.y[t], rz = g->in_list.z[t];
        const row x = g->ux * rx + g->uy * ry + g->uz * rz, y = g->vx * rx + g->vy * ry + g->vz * rz;
        const mask sign = (mask){0} + INT64_MIN;
        const row sum = (row)((mask)x & ~sign) + (row)((mask)y & ~sign);
        const row grows =
            (row)(((mask)(1 - x / sum) & ~sign) | ((mask)y & sign)); /* with the angle, from -2 to 2 */
        const mask is_there = g->count > t;
        plane.x[t] = x;
        plane.y[t] = y;
        plane.z[t] = g->nx * rx + g->ny * ry + g->nz * rz;
        plane.square[t] = CHOOSE(is_there, g->in_list.square[t], ALL(INFINITY));
        angle[t] = CHOOSE(is_there, grows, ALL(INFINITY));
    }
    for (uint32_t t = 1; t < most; t++)
        for (uint32_t s = 0; s < t; s++) {
            const mask later = angle[t] >= angle[s];
            rank[t] -= later;
            rank[s] += 1 + later;
        }
    mask first = rank[0];
    row nearest = plane.square[0];
    for (uint32_t t = 1; t < most; t++) {
        const mask nearer = plane.square[t] < nearest;
        first = (mask)CHOOSE(nearer, rank[t], first);
        nearest = CHOOSE(nearer, plane.square[t], nearest);
    }
    for (uint32_t t = 0; t < most; t++) {
        const mask is_there = g->count > t, before = rank[t] - first;
        rank[t] = (mask)CHOOSE(is_there, before + (g->count & (before < 0)), rank[t]);
        g->rank[t] = rank[t];
    }
    for (uint32_t s = 0; s <= most; s++) {
        row x = {0}, y = {0}, z = {0}, square = {0};
        for (uint32_t t = 0; t < most; t++) {
            const mask here = rank[t] == s;
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

/* The first again behind the last of each; and the last, which comes before the first. */
ISA_CLONES static void close_rings(rings *g)
{
    slots *at = &g->at;
    g->last_x = g->last_y = g->last_square = ALL(0);
    for (uint32_t t = 1; t <= g->most; t++) {
        const mask end = g->count == t;
        at->x[t] = CHOOSE(end, at->x[0], at->x[t]);
        at->y[t] = CHOOSE(end, at->y[0], at->y[t]);
        at->z[t] = CHOOSE(end, at->z[0], at->z[t]);
        at->square[t] = CHOOSE(end, at->square[0], at->square[t]);
        g->last_x = CHOOSE(end, at->x[t - 1], g->last_x);
        g->last_y = CHOOSE(end, at->y[t - 1], g->last_y);
        g->last_square = CHOOSE(end, at->square[t - 1], g->last_square);
    }
}

/* Whether every point of a ring keeps an edge, and those outside are too far to have one: as judge_edge and is_closed of
 * voronoi.c. */
ISA_CLONES static void judge_rings(rings *g)
{
    const slots *at = &g->at;
    row px = g->last_x, py = g->last_y, p2 = g->last_square, root;
    SQRT(root, g->beyond);
    const row corner = root - g->clear;
    mask good = (g->count > 0) & (corner > 0);
    for (uint32_t t = 0; t < g->most; t++) {
        const row qx = at->x[t], qy = at->y[t], q2 = at->square[t], rx = at->x[t + 1], ry = at->y[t + 1],
                  r2 = at->square[t + 1];
        const row plane = qx * qx + qy * qy, dot = qx * rx + qy * ry, before = px * qy - py * qx,
                  after = qx * ry - qy * rx;
        const row rest_p = p2 * plane - q2 * (qx * px + qy * py), rest_r = r2 * plane - q2 * dot;
        row across;
        SQRT(across, plane);
        const row length = rest_r * before + rest_p * after, least = 2 * g->clear * across * before * after;
        const mask kept = (before > 0) & (after > 0) & (length > least);
        const mask is_far =
            rest_r * rest_r + q2 * q2 * after * after > corner * corner * plane * after * after;
        good &= (kept & ~(dot < 0) & ~is_far) | (g->count <= t);
        px = qx;
        py = qy;
        p2 = q2;
    }
    g->is_clear = good;
}

/* As measure_star of voronoi.c. */
ISA_CLONES static void measure_rings(rings *g)
{
    const slots *at = &g->at;
    row next[SLOTS], last = {0};
    SQRT(g->distance[0], at->square[0]);
    for (uint32_t t = 0; t < g->most; t++) {
        const row q2 = at->square[t], r2 = at->square[t + 1];
        const row dot = at->x[t] * at->x[t + 1] + at->y[t] * at->y[t + 1] + at->z[t] * at->z[t + 1];
        const row sine2 = q2 * r2 - dot * dot;
        row sine, far;
        SQRT(sine, sine2);
        SQRT(far, r2);
        const row half = 0.5 / sine;
        if (t + 1 < SLOTS) g->distance[t + 1] = far;
        g->edge[t] = half * g->distance[t] * (r2 - dot);
        next[t] = half * far * (q2 - dot);
        last = CHOOSE(g->count == t + 1, next[t], last);
    }
    g->edge[0] += last;
    for (uint32_t t = 1; t < g->most; t++) g->edge[t] += next[t - 1];
}

static void find_rings(star_rows *rows, rings *g)
{
    look_around(rows, g);
    fill_slots(rows, g);
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

typedef enum verdict { CLEAR, UNSURE, BENT } verdict;

/* Fills in the stars of the first `count` points that are clear. UNSURE: the general way may find that one is. */
static void find_clear(const voronoi_sites *in, star_rows *rows, uint32_t count, voronoi_star *out,
                       verdict found[STAR_LANES])
{
    rings g;
    set_frames(in, rows, &g);
    find_rings(rows, &g);
    for (uint32_t l = 0; l < count; l++) {
        found[l] = g.bent[l] ? BENT : g.is_clear[l] ? CLEAR : UNSURE;
        if (found[l] == CLEAR) write_star(&g, (int)l, neighbours_list(in->near, rows->point[l]), &out[l]);
    }
}

bool star_lanes_at(const voronoi_sites *in, const uint32_t *points, uint32_t count, star_rows *rows,
                   voronoi_star *out)
{
    verdict found[STAR_LANES];
    const bool listed = gather_rows(in, points, count, rows);
    if (listed) find_clear(in, rows, count, out, found);
    for (uint32_t l = 0; l < count; l++)
        if (!listed || found[l] == UNSURE)
            voronoi_star_at(in, points[l], &out[l]);
        else if (found[l] == BENT)
            voronoi_star_triangles(in, points[l], &out[l]);
    return listed;
}
