// SPDX-License-Identifier: Apache-2.0
#include "sampling/voronoi/triangle_filter.h"

#include <string.h>

#include "base/core/lanes.h"

/* The direction of a triangle with the sine s at the point has an error of 1e-6 / s. Triangles with a squared
 * sine below THIN2 are not discarded. Bounds of a line beyond the square root of FAR2, times s, are
 * ignored. */
static const float THIN2 = 0.0025f, FAR2 = 1e5f;
/* Margins for rounding errors, larger than these: relative, and of lengths in spacings. The squared
 * circumradius is decreased by the latter fraction of the squared reach of the list, so that rounding
 * never removes a part of a line that remains in double precision. */
static const float SURE = 0.01f, ROUNDING = 1e-3f;
static const float OTHER_SIDE2 = (1 - SURE) * (float)(VORONOI_OPPOSITE_COSINE * VORONOI_OPPOSITE_COSINE);

void triangle_filter_fill(const triangle_filter_input *in, triangle_filter *out)
{
    const double over = 1 / in->spacing, over2 = over * over;
    out->count = in->count;
    out->own_nx = (float)in->normal.x;
    out->own_ny = (float)in->normal.y;
    out->own_nz = (float)in->normal.z;
    out->loose = in->count > 0 ? (float)(ROUNDING * in->square[in->count - 1] * over2) : 0;
    for (uint32_t k = 0; k < in->count; k++) {
        const float size = (float)(in->other[k] * over);
        out->x[k] = (float)((in->x[k] - in->at.x) * over);
        out->y[k] = (float)((in->y[k] - in->at.y) * over);
        out->z[k] = (float)((in->z[k] - in->at.z) * over);
        out->nx[k] = (float)in->nx[k];
        out->ny[k] = (float)in->ny[k];
        out->nz[k] = (float)in->nz[k];
        out->widest[k] = (float)(2 * TRIANGLE_MAX_CIRCUMRADIUS) * (size > 1 ? size : 1);
        out->finest[k] = size < 1 ? size : 1;
        out->square[k] = (float)(in->square[k] * over2);
    }
}

/* Triangles of the own point, neighbour b and the third corner of each lane. */
typedef struct batch {
    lanes x, y, z, nx, ny, nz, widest, finest;
    lanes_mask third;
    lanes_mask stays, low_by, high_by;
} batch;

/* Per triangle: its Voronoi line, with a parameter along `w` from the circumcentre `c`, clipped to low ..
 * high by the nearest points. */
typedef struct lines {
    lanes ux, uy, uz;     /* b */
    lanes wx, wy, wz, w2; /* either orientation */
    lanes cx, cy, cz, radius2, bound;
    lanes fx, fy, fz, hidden2; /* `facing` and `hidden2` of voronoi.c */
    lanes low, high;
    lanes far2;                    /* squared distance beyond which a bound is ignored */
    lanes deep2;                   /* squared length that is tested, if narrow */
    lanes_mask thin, narrow, wide; /* neither narrow nor wide: rounding decides */
    lanes_mask gone;               /* discarded */
} lines;

#define ALL(number) ((number) - (lanes){0})

ISA_INLINE bool is_any_set(const lanes_mask *m)
{
    int64_t pair[LANES / 2], any = 0;
    memcpy(pair, m, sizeof pair);
    for (int l = 0; l < LANES / 2; l++) any |= pair[l];
    return any != 0;
}

ISA_INLINE void span_lines(const triangle_filter *s, uint32_t at, const batch *t, lines *g)
{
    const lanes ux = ALL(s->x[at]), uy = ALL(s->y[at]), uz = ALL(s->z[at]);
    const lanes vx = t->x, vy = t->y, vz = t->z;
    const lanes u2 = ux * ux + uy * uy + uz * uz, v2 = vx * vx + vy * vy + vz * vz;
    const lanes dx = ux - vx, dy = uy - vy, dz = uz - vz, uv2 = dx * dx + dy * dy + dz * dz;
    const lanes wx = uy * vz - uz * vy, wy = uz * vx - ux * vz, wz = ux * vy - uy * vx;
    const lanes w2 = wx * wx + wy * wy + wz * wz, half = 0.5f / w2;
    const lanes cx = half * (v2 * (wy * uz - wz * uy) + u2 * (vy * wz - vz * wy));
    const lanes cy = half * (v2 * (wz * ux - wx * uz) + u2 * (vz * wx - vx * wz));
    const lanes cz = half * (v2 * (wx * uy - wy * ux) + u2 * (vx * wy - vy * wx));
    const lanes c2 = cx * cx + cy * cy + cz * cz;
    g->ux = ux, g->uy = uy, g->uz = uz;
    g->wx = wx, g->wy = wy, g->wz = wz, g->w2 = w2;
    g->cx = cx, g->cy = cy, g->cz = cz;
    g->radius2 = c2;
    g->bound = c2 - s->loose;
    g->fx = s->own_nx + s->nx[at] + t->nx;
    g->fy = s->own_ny + s->ny[at] + t->ny;
    g->fz = s->own_nz + s->nz[at] + t->nz;
    g->hidden2 = OTHER_SIDE2 * (g->fx * g->fx + g->fy * g->fy + g->fz * g->fz);
    const lanes listed = (float)(0.5 * VORONOI_REACH) * t->finest,
                least = (float)(TRIANGLE_MIN_DEPTH * TRIANGLE_MIN_DEPTH) * t->finest * t->finest;
    g->deep2 = listed * listed - c2;
    g->narrow = g->deep2 > (1 + SURE) * least;
    g->wide = g->deep2 < (1 - SURE) * least;
    g->thin = ~(w2 > THIN2 * u2 * v2);
    g->far2 = FAR2 * w2 / (u2 * v2);
    g->gone = u2 * v2 * uv2 > (1 + SURE) * t->widest * t->widest * w2;
    g->low = ALL(-INFINITY);
    g->high = ALL(INFINITY);
}

/* Discards triangles of whose line nothing is left, within the tested length. */
ISA_INLINE void drop_empty(lines *g)
{
    const lanes low2 = g->low * g->low * g->w2, high2 = g->high * g->high * g->w2,
                deep2 = (1 + SURE) * g->deep2;
    g->gone |= (g->low > g->high) & (low2 < g->far2) & (high2 < g->far2);
    g->gone |= g->narrow & (((g->low > 0) & (low2 > deep2)) | ((g->high < 0) & (high2 > deep2)));
}

/* Whether no point beyond this squared distance can clip a line that is not discarded. A point that clips a
 * line lies in a ball about one of its ends, whose sphere passes through the own point. */
ISA_INLINE bool is_settled(float square, lines *g)
{
    drop_empty(g);
    const lanes low2 = g->low * g->low * g->w2, high2 = g->high * g->high * g->w2;
    const lanes far2 = lanes_chosen(low2 > high2, low2, high2);
    const lanes_mask deep = g->narrow & (far2 > g->deep2);
    const lanes end2 = lanes_chosen(deep, g->deep2, far2);
    const lanes_mask open = ~g->gone & ~g->thin & (4 * (1 + SURE) * (g->radius2 + end2) > square);
    return !is_any_set(&open);
}

ISA_INLINE void cut_lines(const triangle_filter *s, uint32_t at, batch *t, lines *g)
{
    lanes_mask low_by = (lanes_mask){0} - 1, high_by = low_by;
    for (uint32_t k = 0; k < s->count; k++) {
        if (k == at) continue;
        const lanes facing = s->nx[k] * g->fx + s->ny[k] * g->fy + s->nz[k] * g->fz;
        const lanes qx = s->x[k] - g->cx, qy = s->y[k] - g->cy, qz = s->z[k] - g->cz;
        const lanes along = 2 * (g->wx * qx + g->wy * qy + g->wz * qz);
        const lanes to = (qx * qx + qy * qy + qz * qz - g->bound) / along;
        const lanes_mask sees = ((facing > 0) | (facing * facing < g->hidden2)) & (t->third != (int32_t)k);
        const lanes_mask above = sees & (along > 0) & (to < g->high),
                         below = sees & (along < 0) & (to > g->low);
        g->high = lanes_chosen(above, to, g->high);
        g->low = lanes_chosen(below, to, g->low);
        high_by = (above & (int32_t)k) | (~above & high_by);
        low_by = (below & (int32_t)k) | (~below & low_by);
        if (k % 2 == 1 && k + 1 < s->count && is_settled(s->square[k + 1], g)) break;
    }
    drop_empty(g);
    t->low_by = low_by;
    t->high_by = high_by;
}

/* Clears the lanes of *outside and *inside whose line is not outside, or inside, at both ends by the
 * normal of one corner. */
ISA_INLINE void judge_ends(const lines *g, const lanes corner[3], const lanes normal[3], lanes_mask *outside,
                           lanes_mask *inside)
{
    const lanes slope = normal[0] * g->wx + normal[1] * g->wy + normal[2] * g->wz;
    const lanes height =
        normal[0] * (g->cx - corner[0]) + normal[1] * (g->cy - corner[1]) + normal[2] * (g->cz - corner[2]);
    const lanes low = height + g->low * slope, high = height + g->high * slope;
    *outside &= (low > ROUNDING) & (high > ROUNDING);
    *inside &= (low < -ROUNDING) & (high < -ROUNDING);
}

/* Discards triangles whose whole line is on one side of the surface by the normals of all three corners.
 * Further clipping cannot change this. An end that no point clips is inside if it is the low one, else
 * outside. */
ISA_INLINE void drop_one_sided(const triangle_filter *s, uint32_t at, const batch *t, lines *g)
{
    const lanes low2 = g->low * g->low * g->w2, high2 = g->high * g->high * g->w2,
                deep2 = (1 - SURE) * g->deep2;
    const lanes_mask low_ends = (low2 < g->far2) & (g->wide | (low2 < deep2)),
                     high_ends = (high2 < g->far2) & (g->wide | (high2 < deep2));
    const lanes turned = (g->fx * g->wx + g->fy * g->wy + g->fz * g->wz);
    const lanes_mask backward = turned<-ROUNDING, forward = turned> ROUNDING;
    lanes_mask outside = (low_ends | backward) & (high_ends | forward),
               inside = (low_ends | forward) & (high_ends | backward);
    const lanes a[3] = {{0}}, an[3] = {ALL(s->own_nx), ALL(s->own_ny), ALL(s->own_nz)};
    const lanes b[3] = {g->ux, g->uy, g->uz}, bn[3] = {ALL(s->nx[at]), ALL(s->ny[at]), ALL(s->nz[at])};
    const lanes c[3] = {t->x, t->y, t->z}, cn[3] = {t->nx, t->ny, t->nz};
    judge_ends(g, a, an, &outside, &inside);
    judge_ends(g, b, bn, &outside, &inside);
    judge_ends(g, c, cn, &outside, &inside);
    g->gone |= outside | inside;
}

/* Sets t->stays: the triangles that are not discarded. */
ISA_CLONES static void filter(const triangle_filter *s, uint32_t at, batch *t)
{
    lines g;
    span_lines(s, at, t, &g);
    cut_lines(s, at, t, &g);
    drop_one_sided(s, at, t, &g);
    t->stays = ~g.gone | g.thin;
}

uint32_t triangle_filter_third_corners(const triangle_filter *s, uint32_t at, uint32_t count,
                                       uint32_t third[VORONOI_STAR_MAX], int32_t by[VORONOI_STAR_MAX][2])
{
    uint32_t kept = 0;
    batch t;
    for (uint32_t first = 0; first < count; first += LANES) {
        for (uint32_t l = 0; l < LANES; l++) {
            const uint32_t k = third[first + l < count ? first + l : count - 1];
            t.x[l] = s->x[k];
            t.y[l] = s->y[k];
            t.z[l] = s->z[k];
            t.nx[l] = s->nx[k];
            t.ny[l] = s->ny[k];
            t.nz[l] = s->nz[k];
            t.widest[l] = s->widest[k] > s->widest[at] ? s->widest[k] : s->widest[at];
            t.finest[l] = s->finest[k] < s->finest[at] ? s->finest[k] : s->finest[at];
            t.third[l] = (int32_t)k;
        }
        filter(s, at, &t);
        for (uint32_t l = 0; l < LANES && first + l < count; l++) {
            third[kept] = (uint32_t)t.third[l];
            by[kept][0] = t.low_by[l];
            by[kept][1] = t.high_by[l];
            kept += t.stays[l] != 0;
        }
    }
    return kept;
}
