// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/planar_cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/voronoi/voronoi.h"

static const char what[] = "the measures of the surface";

bool planar_cells_new(size_t count, planar_cells *out, error *e)
{
    *out = (planar_cells){.count = count};
    out->certain = mem_array(count, sizeof *out->certain, what, e);
    out->area = mem_array(count, sizeof *out->area, what, e);
    out->farthest = mem_array(count, sizeof *out->farthest, what, e);
    out->side_room = 3 * count; /* of a closed surface without handles */
    out->side = mem_array(out->side_room, sizeof *out->side, what, e);
    return out->certain && out->area && out->farthest && out->side;
}

void planar_cells_free(planar_cells *c)
{
    free(c->certain);
    free(c->area);
    free(c->farthest);
    free(c->side);
    *c = (planar_cells){0};
}

/* The middle of the curve between two places with unit normals m, n: a cubic whose ends lie in the tangent
 * planes. */
static vec3 curve_middle(vec3 a, vec3 m, vec3 b, vec3 n)
{
    const vec3 d = vec3_sub(b, a), middle = vec3_scale(vec3_add(a, b), 0.5);
    return vec3_axpy(-0.125 * vec3_dot(m, d), m, vec3_axpy(0.125 * vec3_dot(n, d), n, middle));
}

static double twice_area(vec3 a, vec3 b, vec3 c)
{
    return vec3_norm(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
}

/* The area of the surface between three curves (curve_middle) over that of the triangle of their ends, by one
 * division into four and Richardson's extrapolation. `twice`: twice the area of the triangle 0, u, v. */
static double bend_factor(vec3 u, vec3 v, const vec3 normal[3], double twice)
{
    const vec3 o = {0, 0, 0}, ou = curve_middle(o, normal[0], u, normal[1]),
               ov = curve_middle(o, normal[0], v, normal[2]), uv = curve_middle(u, normal[1], v, normal[2]);
    const double four = twice_area(o, ou, ov) + twice_area(ou, u, uv) + twice_area(ov, uv, v) + twice_area(ou, uv, ov);
    return (4 * four / twice - 1) / 3;
}

/* What one triangle of neighbours adds to the cell of its first corner. */
typedef struct share {
    double area, farthest;
    double side[2]; /* halves of the sides against the second and the third corner */
} share;

/* The length of half a side: from the middle of the curve to a neighbour to the corner. */
static double side_length(vec3 corner, vec3 u, vec3 m, vec3 n, double sign)
{
    return copysign(vec3_norm(vec3_sub(corner, curve_middle((vec3){0, 0, 0}, m, u, n))), sign);
}

/* A point and two of its neighbours, which follow each other around it; u, v: their places relative to it. */
static share triangle_share(vec3 u, vec3 v, const vec3 normal[3])
{
    const vec3 cross = vec3_cross(u, v);
    const double u2 = vec3_norm2(u), v2 = vec3_norm2(v), uv = vec3_dot(u, v), twice = vec3_norm(cross),
                 half = 0.5 / twice;
    const double more = bend_factor(u, v, normal, twice);
    const double a = half * (v2 - uv), b = half * (u2 - uv); /* half the cotangents at the third, second corner */
    /* the circumcentre, and the place of the surface over it */
    const vec3 centre = vec3_scale(vec3_add(vec3_scale(vec3_cross(cross, u), v2),
                                            vec3_scale(vec3_cross(v, cross), u2)),
                                   2 * half * half);
    const double height = (vec3_dot(normal[0], centre) + vec3_dot(normal[1], vec3_sub(centre, u)) +
                           vec3_dot(normal[2], vec3_sub(centre, v))) /
                          6;
    const vec3 corner = vec3_axpy(-height / twice * copysign(1, vec3_dot(cross, normal[0])), cross, centre);
    return (share){.area = 0.25 * (u2 * a + v2 * b) * more,
                   .farthest = vec3_norm(corner),
                   .side = {side_length(corner, u, normal[0], normal[1], a),
                            side_length(corner, v, normal[0], normal[2], b)}};
}

static bool is_plain(const partition *part, const uint32_t *piece, uint32_t at, uint32_t other)
{
    return (!part->flags || !part->flags[other]) && (!piece || piece[part->index[other]] == piece[part->index[at]]);
}

/* Whether all points that could bound a cell with corners as far as `farthest` are plain, and of its piece. */
static bool has_plain_neighbours(const partition *part, const uint32_t *piece, uint32_t at, double farthest)
{
    const uint32_t *list = neighbours_list(part->near, at), count = part->near->list_count[at];
    for (uint32_t k = 0; (part->flags || piece) && k < count; k++)
        if (!is_plain(part, piece, at, list[k]) &&
            vec3_norm2(vec3_sub(part->position[list[k]], part->position[at])) < 4 * farthest * farthest)
            return false;
    return true;
}

int planar_cells_set(planar_cells *c, const partition *part, const uint32_t *piece, uint32_t at,
                     voronoi_side side[PLANAR_CELLS_SIDES])
{
    const voronoi_sites sites = {part->position, part->normal, part->spacing, part->near, NULL, part->index, true};
    const uint32_t i = part->index[at];
    voronoi_star star;
    c->certain[i] = false;
    if ((part->flags && part->flags[at]) || !voronoi_star_planar(&sites, at, &star) ||
        star.count > PLANAR_CELLS_SIDES)
        return 0;
    double length[PLANAR_CELLS_SIDES] = {0}, area = 0, farthest = 0;
    for (uint32_t k = 0; k < star.count; k++) {
        const uint32_t next = k + 1 < star.count ? k + 1 : 0, q = star.point[k], r = star.point[next];
        const vec3 normal[3] = {part->normal[at], part->normal[q], part->normal[r]};
        const share t = triangle_share(vec3_sub(part->position[q], part->position[at]),
                                       vec3_sub(part->position[r], part->position[at]), normal);
        area += t.area;
        length[k] += t.side[0];
        length[next] += t.side[1];
        farthest = fmax(farthest, t.farthest);
    }
    if (!(farthest <= PLANAR_CELLS_FARTHEST * part->spacing[at]) ||
        !has_plain_neighbours(part, piece, at, farthest))
        return 0;
    int count = 0;
    for (uint32_t k = 0; k < star.count; k++) {
        const uint32_t j = part->index[star.point[k]];
        if (j > i) side[count++] = (voronoi_side){i, j, (float)length[k]};
    }
    c->area[i] = (float)area;
    c->farthest[i] = (float)farthest;
    c->certain[i] = true;
    return count;
}

bool planar_cells_reserve(planar_cells *c, size_t count, error *e)
{
    if (c->side_count + count <= c->side_room) return true;
    const size_t room = c->side_count + count + c->side_count / 4;
    voronoi_side *grown = mem_array(room, sizeof *grown, what, e);
    if (!grown) return false;
    memcpy(grown, c->side, c->side_count * sizeof *grown);
    free(c->side);
    c->side = grown;
    c->side_room = room;
    return true;
}

void planar_cells_keep_certain(planar_cells *c)
{
    size_t kept = 0;
    for (size_t k = 0; k < c->side_count; k++)
        if (c->certain[c->side[k].a] && c->certain[c->side[k].b]) c->side[kept++] = c->side[k];
    c->side_count = kept;
}
