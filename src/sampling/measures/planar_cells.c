// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/planar_cells.h"

#include <math.h>

#include "sampling/voronoi/voronoi.h"

/* See planar_cells.h. The error of a polygon grows with the square of the angle between the normals: half of 1
 * minus the cosine is the bound of the edge. With the cosine 0.9 and the edge 0.225 of the solver, half as many
 * cells of strongly bent surfaces are certain. */
static const voronoi_planar_bounds BOUNDS[] = {{.cosine = 0.8, .edge = 0.1, .near_only = true},
                                               {.cosine = 0.95, .edge = 0.025, .near_only = true},
                                               {.cosine = 0.99, .edge = 0.005, .near_only = true}};

static bool find_star(const voronoi_sites *sites, uint32_t at, voronoi_star *out)
{
    bool found = false;
    for (size_t k = 0; !found && k < sizeof BOUNDS / sizeof *BOUNDS; k++)
        found = voronoi_star_planar(sites, at, &BOUNDS[k], out);
    return found;
}

static voronoi_sites sites_of(const partition *part)
{
    return (voronoi_sites){part->position, part->normal, part->spacing, part->near, NULL, part->index};
}

/* The middle of the curve between two places with unit normals m and n: a cubic with its ends in the tangent
 * planes (Vlachos, Peters, Boyd and Mitchell 2001, "Curved PN triangles"). */
static vec3 curve_middle(vec3 a, vec3 m, vec3 b, vec3 n)
{
    const vec3 d = vec3_sub(b, a), middle = vec3_scale(vec3_add(a, b), 0.5);
    return vec3_axpy(-0.125 * vec3_dot(m, d), m, vec3_axpy(0.125 * vec3_dot(n, d), n, middle));
}

static double twice_area(vec3 a, vec3 b, vec3 c)
{
    return vec3_norm(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
}

/* A neighbour: its place relative to the point, its normal, and the middle of the curve to it. */
typedef struct neighbour {
    vec3 at, normal, middle;
} neighbour;

/* The area between the three curves of a triangle over that of the triangle, by one division into four and
 * Richardson's extrapolation. The first corner is at the origin. `twice`: twice the area of the triangle. */
static double bend_factor(const neighbour *u, const neighbour *v, double twice)
{
    const vec3 between = curve_middle(u->at, u->normal, v->at, v->normal);
    const double four = vec3_norm(vec3_cross(u->middle, v->middle)) + twice_area(u->middle, u->at, between) +
                        twice_area(v->middle, between, v->at) + twice_area(u->middle, between, v->middle);
    return (4 * four / twice - 1) / 3;
}

/* What a triangle of neighbours adds to the cell of its first corner: an area (`bend` of it by the bend of the
 * surface), a corner, and the halves of the sides to the second and the third corner. */
typedef struct share {
    double area, bend, farthest, side[2];
} share;

static share share_of(vec3 normal, const neighbour *b, const neighbour *c)
{
    const vec3 u = b->at, v = c->at, cross = vec3_cross(u, v);
    const double u2 = vec3_norm2(u), v2 = vec3_norm2(v), uv = vec3_dot(u, v), twice = vec3_norm(cross),
                 half = 0.5 / twice;
    const double at_v = half * (v2 - uv),
                 at_u = half * (u2 - uv); /* half the cotangents of the angles there */
    /* the circumcentre */
    const vec3 centre =
        vec3_scale(vec3_add(vec3_scale(vec3_cross(cross, u), v2), vec3_scale(vec3_cross(v, cross), u2)),
                   2 * half * half);
    /* the surface over it: its distance from a tangent plane is half of the plane's distance from the chord */
    const double rise = -(vec3_dot(normal, centre) + vec3_dot(b->normal, vec3_sub(centre, u)) +
                          vec3_dot(c->normal, vec3_sub(centre, v))) /
                        6;
    const vec3 corner = vec3_axpy(rise / twice * copysign(1, vec3_dot(cross, normal)), cross, centre);
    const double flat = 0.25 * (u2 * at_v + v2 * at_u), bend = flat * (bend_factor(b, c, twice) - 1);
    return (share){.area = flat + bend,
                   .bend = bend,
                   .farthest = vec3_norm(corner),
                   .side = {copysign(vec3_norm(vec3_sub(corner, b->middle)), at_v),
                            copysign(vec3_norm(vec3_sub(corner, c->middle)), at_u)}};
}

static bool is_plain(const partition *part, const uint32_t *piece, uint32_t at, uint32_t other)
{
    return (!part->flags || !part->flags[other]) &&
           (!piece || piece[part->index[other]] == piece[part->index[at]]);
}

/* Whether all points that can bound a cell with corners as far as `farthest` are plain. */
static bool has_plain_neighbours(const partition *part, const uint32_t *piece, uint32_t at, double farthest)
{
    const uint32_t *list = neighbours_list(part->near, at), count = part->near->list_count[at];
    for (uint32_t k = 0; (part->flags || piece) && k < count; k++)
        if (!is_plain(part, piece, at, list[k]) &&
            vec3_norm2(vec3_sub(part->position[list[k]], part->position[at])) < 4 * farthest * farthest)
            return false;
    return true;
}

/* Adds what a side to a neighbour gives. */
static void add_side(const partition *part, uint32_t at, uint32_t other, double distance, planar_cell *out)
{
    const double h = part->spacing[at], k = part->spacing[other], edge = distance / (0.5 * (h + k)) - 1,
                 growth = (k - h) / distance;
    out->edge += (float)edge;
    out->edge2 += (float)(edge * edge);
    out->growth2 += (float)(growth * growth);
}

void planar_cell_at(const partition *part, const uint32_t *piece, uint32_t at, planar_cell *out, double *area)
{
    const voronoi_sites sites = sites_of(part);
    voronoi_star star;
    *out = (planar_cell){.certain = false};
    if ((part->flags && part->flags[at]) || !find_star(&sites, at, &star)) return;
    neighbour around[VORONOI_PLANAR_MAX];
    double length[VORONOI_PLANAR_MAX] = {0}, sum = 0, bend = 0, farthest = 0;
    const vec3 normal = part->normal[at];
    for (uint32_t k = 0; k < star.count; k++) {
        neighbour *n = &around[k];
        n->at = vec3_sub(part->position[star.point[k]], part->position[at]);
        n->normal = part->normal[star.point[k]];
        n->middle = curve_middle((vec3){0, 0, 0}, normal, n->at, n->normal);
    }
    for (uint32_t k = 0; k < star.count; k++) {
        const uint32_t next = k + 1 < star.count ? k + 1 : 0;
        const share s = share_of(normal, &around[k], &around[next]);
        sum += s.area;
        bend += fabs(s.bend);
        length[k] += s.side[0];
        length[next] += s.side[1];
        farthest = s.farthest > farthest ? s.farthest : farthest;
    }
    if (!(farthest <= PLANAR_CELLS_FARTHEST * part->spacing[at]) ||
        !has_plain_neighbours(part, piece, at, farthest))
        return;
    double straight = 0;
    for (uint32_t k = 0; k < star.count; k++) {
        add_side(part, at, star.point[k], star.distance[k], out);
        straight += 0.25 * star.distance[k] * length[k];
    }
    straight /= part->spacing[at] * part->spacing[at];
    out->straight = (float)(straight - PLANAR_STRAIGHT);
    out->certain = true;
    out->degree = (uint8_t)star.count;
    *area = sum;
    out->bend = (uint16_t)ceil(PLANAR_BEND * fmin(bend / sum, 1));
    out->farthest = (float)farthest;
}

double planar_cell_mean(const partition *part, uint32_t at, const double *value)
{
    const voronoi_sites sites = sites_of(part);
    voronoi_star star;
    double sum = value[part->index[at]];
    if (!find_star(&sites, at, &star)) return sum;
    for (uint32_t k = 0; k < star.count; k++) sum += value[part->index[star.point[k]]];
    return sum / (1 + star.count);
}
