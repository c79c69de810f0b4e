#include "volume/grazed.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "volume/brick.h"
#include "volume/grid_view.h"

enum { FACES = 6, LATTICE = 8 };
/* Of a face's largest coefficient: what passes by less is rounding, or too little of the surface to count. */
static const double LEAST_DEPTH = 1e-3;
static const int step_along[3] = {BRICK_SLAB, BRICK_SIDE, 1};

typedef struct search {
    const block_map *map;
    const float *bricks;
    const int64_t *size;
    uint8_t *crossed;
    grazed *out;
} search;

void grazed_free(grazed *g)
{
    free(g->cell);
    free(g->passed);
    *g = (grazed){0};
}

/* Of a cubic from its B-spline coefficients. */
static void to_bezier(double *c, int step)
{
    double a = c[0], b = c[step], d = c[2 * step], e = c[3 * step];
    c[0] = (a + 4 * b + d) / 6;
    c[step] = (2 * b + d) / 3;
    c[2 * step] = (b + 2 * d) / 3;
    c[3 * step] = (b + 4 * d + e) / 6;
}

static double bezier_at(const double *c, double t)
{
    double s = 1 - t;
    return s * s * (s * c[0] + 3 * t * c[1]) + t * t * (3 * s * c[2] + t * c[3]);
}

typedef struct range {
    double low, high;
} range;

static void widen(range *r, double value)
{
    r->low = value < r->low ? value : r->low;
    r->high = value > r->high ? value : r->high;
}

/* Whether corners on one side, within `depth`, have something on the other among `all`. */
static bool is_passed(const range *corners, const range *all, double depth)
{
    return (corners->high < depth && all->high > depth) || (corners->low > -depth && all->low < -depth);
}

/* Whether the face's corners are on one side, and some place of it is on the other. Its Bezier coefficients bound it:
 * most faces need no look at places. */
static bool dips(const double bezier[16], double depth)
{
    const range none = {INFINITY, -INFINITY};
    range corners = none, bound = none, places = none;
    for (int k = 0; k < 4; k++) widen(&corners, bezier[k / 2 * 12 + k % 2 * 3]);
    for (int k = 0; k < 16; k++) widen(&bound, bezier[k]);
    if (!is_passed(&corners, &bound, depth)) return false;
    for (int i = 0; i <= LATTICE; i++) {
        double row[4];
        for (int k = 0; k < 4; k++) row[k] = bezier_at(bezier + 4 * k, (double)i / LATTICE);
        for (int j = 0; j <= LATTICE; j++) widen(&places, bezier_at(row, (double)j / LATTICE));
    }
    return is_passed(&corners, &places, depth);
}

/* `first`: of the cell's coefficients. */
static bool face_is_passed(const float *first, int face)
{
    int axis = face >> 1, across = step_along[axis];
    const int along[2] = {step_along[(axis + 1) % 3], step_along[(axis + 2) % 3]};
    double c[16], largest = 0;
    int inside = 0;
    for (int k = 0; k < 16; k++) {
        const float *p = first + (face & 1) * across + k / 4 * along[0] + k % 4 * along[1];
        c[k] = ((double)p[0] + 4 * (double)p[across] + (double)p[2 * across]) / 6;
    }
    for (int k = 0; k < 4; k++) to_bezier(c + 4 * k, 1);
    for (int k = 0; k < 4; k++) to_bezier(c + k, 4);
    for (int k = 0; k < 16; k++) {
        inside += c[k] < 0;
        largest = fabs(c[k]) > largest ? fabs(c[k]) : largest;
    }
    return inside > 0 && inside < 16 && dips(c, LEAST_DEPTH * largest);
}

/* F at the node whose coefficients around it begin with p. */
static double node_value(const float *p)
{
    static const double weight[3] = {1.0 / 6, 4.0 / 6, 1.0 / 6};
    double sum = 0;
    for (int k = 0; k < 27; k++)
        sum += weight[k / 9] * weight[k / 3 % 3] * weight[k % 3] *
               (double)p[k / 9 * BRICK_SLAB + k / 3 % 3 * BRICK_SIDE + k % 3];
    return sum;
}

static bool append(grazed *g, const int32_t at[3], const float *first, error *e)
{
    crossed_cell *cells =
        mem_grow(g->cell, g->count, &g->room, 256, sizeof *cells, "the cells that the surface grazes", e);
    if (!cells) return false;
    g->cell = cells;
    crossed_cell *c = &g->cell[g->count++];
    memcpy(c->at, at, sizeof c->at);
    for (int k = 0; k < 8; k++)
        c->value[k] = (float)node_value(first + (k & 1) * BRICK_SLAB + (k >> 1 & 1) * BRICK_SIDE + (k >> 2));
    return true;
}

/* The byte of the row of cells that this one lies in. */
static uint8_t *row_of(uint8_t *rows, uint32_t n, const int32_t at[3])
{
    return &rows[64 * (size_t)n + 8 * (size_t)(at[0] & 7) + (size_t)(at[1] & 7)];
}

/* Follows the surface out of a cell of block n, into cells that are not known yet. */
static bool leave(search *s, uint32_t n, const int32_t at[3], error *e)
{
    const float *first = brick_cell(s->bricks, n, at[0] & 7, at[1] & 7, at[2] & 7);
    for (int face = 0; face < FACES; face++) {
        int axis = face >> 1;
        int32_t to[3] = {at[0], at[1], at[2]};
        to[axis] += face & 1 ? 1 : -1;
        if (!face_is_passed(first, face)) continue;
        *row_of(s->out->passed, n, at) |= (uint8_t)(1u << (at[2] & 7));
        uint32_t there = block_map_find(s->map, to[0] >> 3, to[1] >> 3, to[2] >> 3);
        if (there == BLOCK_MAP_NONE || (s->size[axis] > 0 && (to[axis] < 0 || to[axis] > s->size[axis] - 2)))
            continue;
        uint8_t *row = row_of(s->crossed, there, to);
        unsigned bit = 1u << (to[2] & 7);
        if (*row & bit) continue;
        *row = (uint8_t)(*row | bit);
        if (!append(s->out, to, brick_cell(s->bricks, there, to[0] & 7, to[1] & 7, to[2] & 7), e))
            return false;
    }
    return true;
}

bool grazed_find(const block_map *map, const float *bricks, const int64_t size[3], uint8_t *crossed,
                 grazed *out, error *e)
{
    search s = {map, bricks, size, crossed, out};
    if (!(out->passed = mem_array((size_t)map->count * 64, 1, "the cells that the surface grazes", e)))
        return false;
    for (uint32_t n = 0; n < map->count; n++)
        for (int k = 0; k < GRID_VIEW_VOXELS; k++) {
            const int in_block[3] = {k >> 6, k >> 3 & 7, k & 7};
            int32_t at[3];
            if (!(crossed[64 * (size_t)n + (size_t)(k >> 3)] >> (k & 7) & 1)) continue;
            for (int axis = 0; axis < 3; axis++)
                at[axis] = map->blocks[n][axis] * GRID_VIEW_SIDE + in_block[axis];
            if (!leave(&s, n, at, e)) return false;
        }
    for (size_t k = 0; k < out->count; k++) {
        const crossed_cell c = out->cell[k]; /* the list may move */
        if (!leave(&s, block_map_find(map, c.at[0] >> 3, c.at[1] >> 3, c.at[2] >> 3), c.at, e)) return false;
    }
    return true;
}
