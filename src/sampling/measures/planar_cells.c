// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/planar_cells.h"

#include <math.h>

#include "base/core/isa.h"

/* See planar_cells.h. The error of a polygon grows with the square of the angle between the normals: half of 1
 * minus the cosine is the bound of the edge. With the cosine 0.9 and the edge 0.225 of the solver, half as many
 * cells of strongly bent surfaces are certain. */
static const voronoi_planar_bounds BOUNDS[] = {
    {.cosine = PLANAR_CELLS_COSINE, .edge = 0.1, .near_only = true},
    {.cosine = 0.95, .edge = 0.025, .near_only = true},
    {.cosine = 0.99, .edge = 0.005, .near_only = true},
    {.cosine = 0.999, .edge = 0.0005, .near_only = true}};

void planar_cells_gather(const partition *part, uint32_t at, uint32_t first, voronoi_listed *out)
{
    const voronoi_sites sites = {part->position, part->normal, part->spacing, part->near, NULL, part->index};
    voronoi_gather_listed(&sites, at, first, out);
}

/* The neighbours of a point, counterclockwise. */
typedef struct polygon {
    uint32_t count, point[VORONOI_PLANAR_MAX];
    double distance[VORONOI_PLANAR_MAX];
} polygon;

static bool find_polygon(const partition *part, uint32_t at, const voronoi_listed *listed, polygon *out)
{
    const uint32_t *list = neighbours_list(part->near, at);
    uint32_t place[VORONOI_PLANAR_MAX];
    out->count =
        voronoi_planar_neighbours(listed, part->spacing[at], BOUNDS, sizeof BOUNDS / sizeof *BOUNDS, place);
    for (uint32_t k = 0; k < out->count; k++) {
        out->point[k] = list[place[k]];
        out->distance[k] = sqrt(listed->square[place[k]]);
    }
    return out->count > 0;
}

/* The middle of the curve between two places with unit normals m and n: a cubic with its ends in the tangent
 * planes (Vlachos, Peters, Boyd and Mitchell 2001, "Curved PN triangles"). */
ISA_INLINE vec3 curve_middle(vec3 a, vec3 m, vec3 b, vec3 n)
{
    const vec3 d = vec3_sub(b, a), middle = vec3_scale(vec3_add(a, b), 0.5);
    return vec3_axpy(-0.125 * vec3_dot(m, d), m, vec3_axpy(0.125 * vec3_dot(n, d), n, middle));
}

ISA_INLINE double twice_area(vec3 a, vec3 b, vec3 c)
{
    return vec3_norm(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
}

/* The neighbours of a point, as separate arrays for SIMD: places relative to the point, normals, and the middles of the
 * curves to them. Behind the last one is the first one again. */
enum { LANES = 8, ROOM = VORONOI_PLANAR_MAX + LANES };
typedef struct places {
    double x[ROOM], y[ROOM], z[ROOM];
} places;
typedef struct neighbours_around {
    places at, normal, middle;
} neighbours_around;

static void put(places *p, uint32_t k, vec3 x)
{
    p->x[k] = x.x;
    p->y[k] = x.y;
    p->z[k] = x.z;
}

ISA_INLINE vec3 place_at(const places *p, size_t k)
{
    return (vec3){p->x[k], p->y[k], p->z[k]};
}

/* The area between the three curves of a triangle over that of the triangle, by one division into four and
 * Richardson's extrapolation. The first corner is at the origin; u and v are the others, with normals m and n, and
 * the middles of the curves to them are p and q. `twice`: twice the area of the triangle. */
ISA_INLINE double bend_factor(vec3 u, vec3 m, vec3 p, vec3 v, vec3 n, vec3 q, double twice)
{
    const vec3 between = curve_middle(u, m, v, n);
    const double four = vec3_norm(vec3_cross(p, q)) + twice_area(p, u, between) + twice_area(q, between, v) +
                        twice_area(p, between, q);
    return (4 * four / twice - 1) / 3;
}

/* The length of the side from the middle of a curve to a corner, to the second order: an arc of a circle. `turn`: the
 * third normal of the triangle minus the mean of those at the ends of the curve. The corner is at a third of the way
 * to that normal; noise of the normals enters less than by their angles with the side. */
ISA_INLINE double side_length(vec3 side, vec3 turn)
{
    const double bend = vec3_dot(turn, side) / 3;
    return sqrt(vec3_norm2(side) + bend * bend / 12);
}

/* What the triangles of the point and two consecutive neighbours add to its cell: an area (`bend` of it by the bend of
 * the surface), the distance of a corner, and the halves of the sides to the first and the second neighbour. */
typedef struct shares {
    double area[ROOM], bend[ROOM], farthest[ROOM], first[ROOM], second[ROOM];
} shares;

/* Computes LANES triangles, of the neighbours from k on. */
ISA_CLONES static void compute_shares(const neighbours_around *restrict in, vec3 normal, size_t from,
                                      shares *restrict out)
{
    for (size_t l = 0; l < LANES; l++) {
        const size_t k = from + l;
        const vec3 u = place_at(&in->at, k), v = place_at(&in->at, k + 1), m = place_at(&in->normal, k),
                   n = place_at(&in->normal, k + 1), p = place_at(&in->middle, k),
                   q = place_at(&in->middle, k + 1), cross = vec3_cross(u, v);
        const double u2 = vec3_norm2(u), v2 = vec3_norm2(v), uv = vec3_dot(u, v), twice = vec3_norm(cross),
                     half = 0.5 / twice;
        const double at_v = half * (v2 - uv),
                     at_u = half * (u2 - uv); /* half the cotangents of the angles there */
        /* the circumcentre */
        const vec3 centre =
            vec3_scale(vec3_add(vec3_scale(vec3_cross(cross, u), v2), vec3_scale(vec3_cross(v, cross), u2)),
                       2 * half * half);
        /* the surface over it: its distance from a tangent plane is half of the plane's distance from the
         * chord */
        const double rise = -(vec3_dot(normal, centre) + vec3_dot(m, vec3_sub(centre, u)) +
                              vec3_dot(n, vec3_sub(centre, v))) /
                            6;
        const vec3 corner = vec3_axpy(rise / twice * copysign(1, vec3_dot(cross, normal)), cross, centre);
        const double flat = 0.25 * (u2 * at_v + v2 * at_u);
        out->bend[k] = flat * (bend_factor(u, m, p, v, n, q, twice) - 1);
        out->area[k] = flat + out->bend[k];
        out->farthest[k] = vec3_norm(corner);
        const vec3 third_p = vec3_axpy(-0.5, vec3_add(normal, m), n),
                   third_q = vec3_axpy(-0.5, vec3_add(normal, n), m);
        out->first[k] = copysign(side_length(vec3_sub(corner, p), third_p), at_v);
        out->second[k] = copysign(side_length(vec3_sub(corner, q), third_q), at_u);
    }
}

/* Lists the neighbours of point `at`. */
static void list_neighbours(const partition *part, uint32_t at, const polygon *star, neighbours_around *out)
{
    const uint32_t padded = (star->count + LANES - 1) / LANES * LANES + 1;
    for (uint32_t k = 0; k < padded && k < ROOM; k++) {
        const uint32_t other = star->point[k < star->count ? k : 0];
        const vec3 to = vec3_sub(part->position[other], part->position[at]), n = part->normal[other];
        put(&out->at, k, to);
        put(&out->normal, k, n);
        put(&out->middle, k, curve_middle((vec3){0, 0, 0}, part->normal[at], to, n));
    }
}

static bool is_plain(const partition *part, const uint32_t *piece, uint32_t at, uint32_t other)
{
    return (!part->flags || !part->flags[other]) &&
           (!piece || piece[part->index[other]] == piece[part->index[at]]);
}

/* Whether all points within twice the distance `farthest` are plain, and on no opposite wall. */
static bool has_plain_neighbours(const partition *part, const uint32_t *piece, uint32_t at,
                                 const voronoi_listed *listed, double farthest)
{
    const uint32_t *list = neighbours_list(part->near, at);
    for (uint32_t k = 0; k < listed->count; k++)
        if ((!is_plain(part, piece, at, list[k]) || listed->facing[k] < VORONOI_OPPOSITE_COSINE) &&
            listed->square[k] < 4 * farthest * farthest)
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

void planar_cell_at(const partition *part, const uint32_t *piece, uint32_t at, const voronoi_listed *listed,
                    planar_cell *out, double *area)
{
    polygon star;
    *out = (planar_cell){.certain = false};
    if ((part->flags && part->flags[at]) || !find_polygon(part, at, listed, &star)) return;
    neighbours_around around;
    shares of;
    double sum = 0, bend = 0, farthest = 0, straight = 0;
    list_neighbours(part, at, &star, &around);
    for (uint32_t k = 0; k < star.count; k += LANES) compute_shares(&around, part->normal[at], k, &of);
    for (uint32_t k = 0; k < star.count; k++) {
        const uint32_t next = k + 1 < star.count ? k + 1 : 0;
        sum += of.area[k];
        bend += fabs(of.bend[k]);
        farthest = of.farthest[k] > farthest ? of.farthest[k] : farthest;
        straight += 0.25 * (star.distance[k] * of.first[k] + star.distance[next] * of.second[k]);
    }
    if (!(farthest <= PLANAR_CELLS_FARTHEST * part->spacing[at]) ||
        !has_plain_neighbours(part, piece, at, listed, farthest))
        return;
    for (uint32_t k = 0; k < star.count; k++) add_side(part, at, star.point[k], star.distance[k], out);
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
    voronoi_listed listed;
    polygon star;
    double sum = value[part->index[at]];
    planar_cells_gather(part, at, 0, &listed);
    if (!find_polygon(part, at, &listed, &star)) return sum;
    for (uint32_t k = 0; k < star.count; k++) sum += value[part->index[star.point[k]]];
    return sum / (1 + star.count);
}
