// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/coverage_search.h"

#include <math.h>

/* Triangles of at most this radius, in spacings, are not divided further: the test of their centre
 * decides. */
static const double LEAST_RADIUS = 0.02;
/* Scans: the surface places of two places of a triangle are at most this factor farther apart than these
 * two, since the triangles only approximate the surface. */
static const double STRETCH = 2;
/* Maximum depth of division: it is sufficient for any triangle with coordinates in doubles. */
enum { DEEPEST = 40 };

static void divide(const vec3 c[3], int part, vec3 out[3])
{
    const vec3 middle[3] = {vec3_scale(vec3_add(c[1], c[2]), 0.5), vec3_scale(vec3_add(c[2], c[0]), 0.5),
                            vec3_scale(vec3_add(c[0], c[1]), 0.5)};
    if (part == 3) {
        for (int k = 0; k < 3; k++) out[k] = middle[k];
        return;
    }
    out[0] = c[part];
    out[1] = middle[(part + 2) % 3];
    out[2] = middle[(part + 1) % 3];
}

static vec3 middle_of(const vec3 c[3], double *radius)
{
    const vec3 middle = vec3_scale(vec3_add(c[0], vec3_add(c[1], c[2])), 1.0 / 3);
    *radius = 0;
    for (int k = 0; k < 3; k++) *radius = fmax(*radius, vec3_norm(vec3_sub(c[k], middle)));
    return middle;
}

static double farthest_corner(const vec3 c[3], vec3 x)
{
    double most2 = 0;
    for (int k = 0; k < 3; k++) most2 = fmax(most2, vec3_norm2(vec3_sub(c[k], x)));
    return sqrt(most2);
}

static double search_farthest(const facets *f, const sites *s, const vec3 c[3], const facet *of, double known,
                              int depth)
{
    double radius, distance;
    const vec3 middle = middle_of(c, &radius);
    uint32_t nearest = cell_list_nearest(s->near, middle, 0, &distance);
    double high = farthest_corner(c, s->position[nearest]) / s->spacing[nearest];
    if (high <= known) return known;
    const vec3 place = facets_onto(f, of, middle);
    if (vec3_norm2(vec3_sub(place, middle)) > 0) nearest = cell_list_nearest(s->near, place, 0, &distance);
    const double h = s->spacing[nearest], low = distance / h;
    high = fmin(farthest_corner(c, s->position[nearest]) / h, low + STRETCH * radius / h);
    if (high <= known) return known;
    if (high - low <= COVERAGE_ACCURACY || radius <= LEAST_RADIUS * h || depth == DEEPEST)
        return fmax(known, low);
    for (int part = 0; part < 4; part++) {
        vec3 sub[3];
        divide(c, part, sub);
        known = search_farthest(f, s, sub, of, known, depth + 1);
    }
    return known;
}

double coverage_search_farthest(const facets *f, const sites *s, const vec3 corner[3], const facet *of,
                                double known)
{
    return search_farthest(f, s, corner, of, known, 0);
}

/* The points near a triangle that are not on an opposite wall, and what they cover. */
typedef struct near_facing {
    const sites *s;
    const vec3 *corner;
    vec3 middle, normal;
    uint32_t patch;
    double radius; /* radius, about `middle`, of the surface places of the triangle */
    bool all;      /* all places have a point near: one point is near all of them */
    bool some;     /* a place may have a point near */
    bool centre;   /* the middle has a point near */
} near_facing;

static void look_at_point(void *context, uint32_t i)
{
    near_facing *n = context;
    const double reach = COVERAGE_MISSING * n->s->spacing[i],
                 d = vec3_norm(vec3_sub(n->s->position[i], n->middle));
    if (n->all || d - n->radius > reach || !(sites_facing(n->s, i, n->normal, n->patch) > SITES_OPPOSITE))
        return;
    n->some = true;
    n->centre |= d <= reach;
    n->all |= d + n->radius <= reach || farthest_corner(n->corner, n->s->position[i]) <= reach;
}

static double search_missing(const facets *f, const sites *s, const vec3 c[3], const facet *of, int depth)
{
    near_facing n = {.s = s, .corner = c, .normal = of->normal, .patch = of->patch};
    double radius;
    const vec3 middle = middle_of(c, &radius);
    n.middle = facets_onto(f, of, middle);
    n.radius = fmin(radius + vec3_norm(vec3_sub(n.middle, middle)), STRETCH * radius);
    cell_list_within(s->near, n.middle, COVERAGE_MISSING * s->largest_spacing + n.radius, look_at_point, &n);
    const double area = 0.5 * vec3_norm(vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])));
    if (n.all) return 0;
    if (!n.some) return area;
    double distance;
    const double h = s->spacing[cell_list_nearest(s->near, n.middle, 0, &distance)];
    if (radius <= LEAST_RADIUS * h || depth == DEEPEST) return n.centre ? 0 : area;
    double sum = 0;
    for (int part = 0; part < 4; part++) {
        vec3 sub[3];
        divide(c, part, sub);
        sum += search_missing(f, s, sub, of, depth + 1);
    }
    return sum;
}

double coverage_search_missing(const facets *f, const sites *s, const vec3 corner[3], const facet *of)
{
    return search_missing(f, s, corner, of, 0);
}
