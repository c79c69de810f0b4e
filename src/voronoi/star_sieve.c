#include "voronoi/star_sieve.h"

#include <string.h>

#include "base/isa.h"

/* Triangles that are sifted side by side, and how many of the nearest points do so. */
enum { SIEVED = 8, CUTTERS = 32 };
typedef float row __attribute__((vector_size(4 * SIEVED)));
typedef int32_t mask __attribute__((vector_size(4 * SIEVED)));
/* Directions of a triangle whose sine at the point is s are off by 1e-6 / s: thinner ones stay, and bounds farther away than s times
 * this (squared) tell nothing. */
static const float THIN2 = 0.0025f, FAR2 = 1e5f;
/* The circumsphere is smaller by so much of the list's reach, squared: what is left of a line stays so. */
static const double LOOSE = 2e-4;
/* Of what else may be told either way: relatively, as heights above the corners' planes, as the side that a triangle faces. */
static const float MORE = 1.001f, SURE = 0.01f, HEIGHT = 1e-3f, TURNED = 1e-4f;
static const float OTHER_SIDE2 = 0.999f * (float)(VORONOI_OTHER_SIDE * VORONOI_OTHER_SIDE);

void star_sieve_fill(const star_around *in, star_sieve *out)
{
    const double over = 1 / in->spacing, over2 = over * over;
    out->count = in->count;
    out->own_nx = (float)in->normal.x;
    out->own_ny = (float)in->normal.y;
    out->own_nz = (float)in->normal.z;
    out->loose = in->count > 0 ? (float)(LOOSE * in->square[in->count - 1] * over2) : 0;
    for (uint32_t k = 0; k < in->count; k++) {
        const float size = (float)(in->other[k] * over);
        out->x[k] = (float)((in->x[k] - in->at.x) * over);
        out->y[k] = (float)((in->y[k] - in->at.y) * over);
        out->z[k] = (float)((in->z[k] - in->at.z) * over);
        out->nx[k] = (float)in->nx[k];
        out->ny[k] = (float)in->ny[k];
        out->nz[k] = (float)in->nz[k];
        out->widest[k] = (float)(2 * STAR_WIDEST) * (size > 1 ? size : 1);
        out->finest[k] = size < 1 ? size : 1;
        out->square[k] = (float)(in->square[k] * over2);
    }
}

/* Triangles of the point at hand, b and a third of each lane. */
typedef struct batch {
    row x, y, z, nx, ny, nz, widest, finest;
    mask third;
    mask stays, low_by, high_by;
} batch;

/* Of each the line of places that are as far from all three corners, counted along `w` from the circumcentre `c`, and what the
 * nearest points leave of it. */
typedef struct lines {
    row ux, uy, uz;     /* b */
    row wx, wy, wz, w2; /* may face either way */
    row cx, cy, cz, radius2, bound;
    row fx, fy, fz, hidden2; /* as `facing` and `hidden2` of voronoi.c */
    row low, high;
    row far2, deep2;         /* how far bounds tell something; how far is looked at where it is narrow */
    mask thin, narrow, wide; /* (neither of both: not sure) */
    mask gone;
} lines;

/* Lane by lane a where `which` is set, else b. (No function: vectors are not handed over alike with and without AVX.) */
#define CHOOSE(which, a, b) (((a) & (which)) | ((b) & ~(which)))
#define ALL(number) ((number) - (row){0})

ISA_INLINE bool is_any_set(const mask *m)
{
    int64_t pair[SIEVED / 2], any = 0;
    memcpy(pair, m, sizeof pair);
    for (int l = 0; l < SIEVED / 2; l++) any |= pair[l];
    return any != 0;
}

ISA_INLINE void span_lines(const star_sieve *s, uint32_t at, const batch *t, lines *g)
{
    const row ux = ALL(s->x[at]), uy = ALL(s->y[at]), uz = ALL(s->z[at]);
    const row vx = t->x, vy = t->y, vz = t->z;
    const row u2 = ux * ux + uy * uy + uz * uz, v2 = vx * vx + vy * vy + vz * vz;
    const row dx = ux - vx, dy = uy - vy, dz = uz - vz, uv2 = dx * dx + dy * dy + dz * dz;
    const row wx = uy * vz - uz * vy, wy = uz * vx - ux * vz, wz = ux * vy - uy * vx;
    const row w2 = wx * wx + wy * wy + wz * wz, half = 0.5f / w2;
    const row cx = half * (v2 * (wy * uz - wz * uy) + u2 * (vy * wz - vz * wy));
    const row cy = half * (v2 * (wz * ux - wx * uz) + u2 * (vz * wx - vx * wz));
    const row cz = half * (v2 * (wx * uy - wy * ux) + u2 * (vx * wy - vy * wx));
    const row c2 = cx * cx + cy * cy + cz * cz;
    g->ux = ux, g->uy = uy, g->uz = uz;
    g->wx = wx, g->wy = wy, g->wz = wz, g->w2 = w2;
    g->cx = cx, g->cy = cy, g->cz = cz;
    g->radius2 = c2;
    g->bound = c2 - s->loose;
    g->fx = s->own_nx + s->nx[at] + t->nx;
    g->fy = s->own_ny + s->ny[at] + t->ny;
    g->fz = s->own_nz + s->nz[at] + t->nz;
    g->hidden2 = OTHER_SIDE2 * (g->fx * g->fx + g->fy * g->fy + g->fz * g->fz);
    const row listed = (float)(0.5 * VORONOI_REACH) * t->finest,
              least = (float)(STAR_DEEP * STAR_DEEP) * t->finest * t->finest;
    g->deep2 = listed * listed - c2;
    g->narrow = g->deep2 > (1 + SURE) * least;
    g->wide = g->deep2 < (1 - SURE) * least;
    g->thin = ~(w2 > THIN2 * u2 * v2);
    g->far2 = FAR2 * w2 / (u2 * v2);
    g->gone = u2 * v2 * uv2 > MORE * t->widest * t->widest * w2;
    g->low = ALL(-INFINITY);
    g->high = ALL(INFINITY);
}

/* Nothing is left between the bounds, or as far as is looked at. There a bound is one from whichever side it comes. */
ISA_INLINE void drop_empty(lines *g)
{
    const row low2 = g->low * g->low * g->w2, high2 = g->high * g->high * g->w2,
              deep2 = (1 + SURE) * g->deep2;
    g->gone |= (g->low > g->high) & (low2 < g->far2) & (high2 < g->far2);
    g->gone |= g->narrow & (((g->low > 0) & (low2 > deep2)) | ((g->high < 0) & (high2 > deep2)));
}

/* No line that may stay is cut by who is as far as this, squared: what takes something away is in a ball about either bound, and
 * the point at hand is on both. */
ISA_INLINE bool is_settled(float square, lines *g)
{
    drop_empty(g);
    const row low2 = g->low * g->low * g->w2, high2 = g->high * g->high * g->w2;
    const row far2 = (row)CHOOSE(low2 > high2, (mask)low2, (mask)high2);
    const mask deep = g->narrow & (far2 > g->deep2);
    const row end2 = (row)CHOOSE(deep, (mask)g->deep2, (mask)far2);
    const mask open = ~g->gone & ~g->thin & (4 * (1 + SURE) * (g->radius2 + end2) > square);
    return !is_any_set(&open);
}

ISA_INLINE void cut_lines(const star_sieve *s, uint32_t at, uint32_t cutters, batch *t, lines *g)
{
    mask low_by = (mask){0} - 1, high_by = low_by;
    for (uint32_t k = 0; k < cutters; k++) {
        if (k == at) continue;
        const row facing = s->nx[k] * g->fx + s->ny[k] * g->fy + s->nz[k] * g->fz;
        const row qx = s->x[k] - g->cx, qy = s->y[k] - g->cy, qz = s->z[k] - g->cz;
        const row along = 2 * (g->wx * qx + g->wy * qy + g->wz * qz);
        const row to = (qx * qx + qy * qy + qz * qz - g->bound) / along;
        const mask sees = ((facing > 0) | (facing * facing < g->hidden2)) & (t->third != (int32_t)k);
        const mask above = sees & (along > 0) & (to < g->high), below = sees & (along < 0) & (to > g->low);
        g->high = (row)CHOOSE(above, (mask)to, (mask)g->high);
        g->low = (row)CHOOSE(below, (mask)to, (mask)g->low);
        high_by = CHOOSE(above, (mask){0} + (int32_t)k, high_by);
        low_by = CHOOSE(below, (mask){0} + (int32_t)k, low_by);
        if (k % 4 == 3 && k + 1 < cutters && is_settled(s->square[k + 1], g)) break;
    }
    drop_empty(g);
    t->low_by = low_by;
    t->high_by = high_by;
}

/* Takes away from those outside and from those inside whose line is not so at both of its bounds, as one corner says. */
ISA_INLINE void judge_ends(const lines *g, const row corner[3], const row normal[3], mask *outside,
                           mask *inside)
{
    const row slope = normal[0] * g->wx + normal[1] * g->wy + normal[2] * g->wz;
    const row height =
        normal[0] * (g->cx - corner[0]) + normal[1] * (g->cy - corner[1]) + normal[2] * (g->cz - corner[2]);
    const row low = height + g->low * slope, high = height + g->high * slope;
    *outside &= (low > HEIGHT) & (high > HEIGHT);
    *inside &= (low < -HEIGHT) & (high < -HEIGHT);
}

/* Where all three corners say that a whole line is outside, or inside, it is on one side of the surface, whoever takes more of it
 * away. An end that nobody bounds is inside where it is the lower one, else outside. */
ISA_INLINE void drop_one_sided(const star_sieve *s, uint32_t at, const batch *t, lines *g)
{
    const row low2 = g->low * g->low * g->w2, high2 = g->high * g->high * g->w2,
              deep2 = (1 - SURE) * g->deep2;
    const mask low_ends = (low2 < g->far2) & (g->wide | (low2 < deep2)),
               high_ends = (high2 < g->far2) & (g->wide | (high2 < deep2));
    const row turned = (g->fx * g->wx + g->fy * g->wy + g->fz * g->wz);
    const mask backward = turned<-TURNED, forward = turned> TURNED;
    mask outside = (low_ends | backward) & (high_ends | forward),
         inside = (low_ends | forward) & (high_ends | backward);
    const row a[3] = {{0}}, an[3] = {ALL(s->own_nx), ALL(s->own_ny), ALL(s->own_nz)};
    const row b[3] = {g->ux, g->uy, g->uz}, bn[3] = {ALL(s->nx[at]), ALL(s->ny[at]), ALL(s->nz[at])};
    const row c[3] = {t->x, t->y, t->z}, cn[3] = {t->nx, t->ny, t->nz};
    judge_ends(g, a, an, &outside, &inside);
    judge_ends(g, b, bn, &outside, &inside);
    judge_ends(g, c, cn, &outside, &inside);
    g->gone |= outside | inside;
}

/* Tells which triangles may be of the surface: of the others the nearest points surely leave nothing, or nothing that crosses it. */
ISA_CLONES static void sift(const star_sieve *s, uint32_t at, uint32_t cutters, batch *t)
{
    lines g;
    span_lines(s, at, t, &g);
    cut_lines(s, at, cutters, t, &g);
    drop_one_sided(s, at, t, &g);
    t->stays = ~g.gone | g.thin;
}

uint32_t star_sieve_thirds(const star_sieve *s, uint32_t at, uint32_t count, uint32_t third[VORONOI_STAR_MAX],
                           int32_t by[VORONOI_STAR_MAX][2])
{
    const uint32_t cutters = s->count < CUTTERS ? s->count : CUTTERS;
    uint32_t kept = 0;
    batch t;
    for (uint32_t first = 0; first < count; first += SIEVED) {
        for (uint32_t l = 0; l < SIEVED; l++) {
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
        sift(s, at, cutters, &t);
        for (uint32_t l = 0; l < SIEVED && first + l < count; l++) {
            third[kept] = (uint32_t)t.third[l];
            by[kept][0] = t.low_by[l];
            by[kept][1] = t.high_by[l];
            kept += t.stays[l] != 0;
        }
    }
    return kept;
}
