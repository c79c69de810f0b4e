// SPDX-License-Identifier: Apache-2.0
#include "geometry/space/triangle.h"

#include <math.h>

/* If the squared sine of an angle is below this, the triangle is treated as its three edges: rounding makes
 * the direction of its normal arbitrary. The ignored face is narrower than 1e-7 of its length. */
static const double least_sine2 = 1e-14;

static double square_along(vec3 from, vec3 way, double s)
{
    return vec3_norm2(vec3_axpy(-s, way, from));
}

static double segment_distance2(vec3 from, vec3 way)
{
    double length2 = vec3_norm2(way), s = length2 > 0 ? vec3_dot(from, way) / length2 : 0;
    return square_along(from, way, s < 0 ? 0 : s > 1 ? 1 : s);
}

double triangle_distance2(const triangle *t, vec3 p)
{
    const vec3 ab = vec3_sub(t->b, t->a), ac = vec3_sub(t->c, t->a), bc = vec3_sub(t->c, t->b);
    const vec3 ap = vec3_sub(p, t->a), bp = vec3_sub(p, t->b), cp = vec3_sub(p, t->c),
               normal = vec3_cross(ab, ac);
    if (vec3_norm2(normal) <= least_sine2 * vec3_norm2(ab) * vec3_norm2(ac))
        return fmin(segment_distance2(ap, ab), fmin(segment_distance2(ap, ac), segment_distance2(bp, bc)));
    const double ab_a = vec3_dot(ab, ap), ac_a = vec3_dot(ac, ap);
    if (ab_a <= 0 && ac_a <= 0) return vec3_norm2(ap);
    const double ab_b = vec3_dot(ab, bp), ac_b = vec3_dot(ac, bp);
    if (ab_b >= 0 && ac_b <= ab_b) return vec3_norm2(bp);
    const double ab_c = vec3_dot(ab, cp), ac_c = vec3_dot(ac, cp);
    if (ac_c >= 0 && ab_c <= ac_c) return vec3_norm2(cp);
    const double of_c =
        ab_a * ac_b - ab_b * ac_a; /* unnormalised barycentric weights of the projected point */
    if (of_c <= 0 && ab_a >= 0 && ab_b <= 0) return square_along(ap, ab, ab_a / (ab_a - ab_b));
    const double of_b = ab_c * ac_a - ab_a * ac_c;
    if (of_b <= 0 && ac_a >= 0 && ac_c <= 0) return square_along(ap, ac, ac_a / (ac_a - ac_c));
    const double of_a = ab_b * ac_c - ab_c * ac_b;
    /* positions of the projected point along bc, measured from b and from c */
    const double bc_b = ac_b - ab_b, bc_c = ab_c - ac_c;
    if (of_a <= 0 && bc_b >= 0 && bc_c >= 0) return square_along(bp, bc, bc_b / (bc_b + bc_c));
    const double height = vec3_dot(normal, ap);
    return height * height / vec3_norm2(normal);
}

/* Updates *best with the point of an edge that is nearest to p, if that is nearer. */
static void try_edge(const vec3 corner[3], int from, vec3 p, double *best, double weight[3])
{
    int to = (from + 1) % 3;
    vec3 way = vec3_sub(corner[to], corner[from]), ahead = vec3_sub(p, corner[from]);
    double length2 = vec3_norm2(way), s = length2 > 0 ? vec3_dot(ahead, way) / length2 : 0;
    s = s < 0 ? 0 : s > 1 ? 1 : s;
    double distance2 = square_along(ahead, way, s);
    if (!(distance2 < *best)) return;
    *best = distance2;
    weight[0] = weight[1] = weight[2] = 0;
    weight[from] = 1 - s;
    weight[to] = s;
}

void triangle_weights(const triangle *t, vec3 p, double weight[3])
{
    const vec3 corner[3] = {t->a, t->b, t->c};
    const vec3 ab = vec3_sub(t->b, t->a), ac = vec3_sub(t->c, t->a), ap = vec3_sub(p, t->a);
    const vec3 normal = vec3_cross(ab, ac);
    double area2 = vec3_norm2(normal), best = INFINITY;
    if (area2 > least_sine2 * vec3_norm2(ab) * vec3_norm2(ac)) {
        weight[1] = vec3_dot(vec3_cross(ap, ac), normal) / area2;
        weight[2] = vec3_dot(vec3_cross(ab, ap), normal) / area2;
        weight[0] = 1 - weight[1] - weight[2];
        if (weight[0] >= 0 && weight[1] >= 0 && weight[2] >= 0) return;
    }
    for (int edge = 0; edge < 3; edge++) try_edge(corner, edge, p, &best, weight);
}

vec3 triangle_nearest(const triangle *t, vec3 p)
{
    double weight[3];
    triangle_weights(t, p, weight);
    return vec3_axpy(weight[1], vec3_sub(t->b, t->a), vec3_axpy(weight[2], vec3_sub(t->c, t->a), t->a));
}

int triangle_split(const bool halved[3], int parts[4][3])
{
    const int count = halved[0] + halved[1] + halved[2], sum = halved[1] + 2 * halved[2];
    /* k: the side that differs from the other two */
    const int k = count == 2 ? 3 - sum : sum % 3, a = (k + 1) % 3, b = (k + 2) % 3;
    const int all[4][4][3] = {{{0, 1, 2}},
                              {{k, 3 + k, b}, {3 + k, a, b}},
                              {{3 + a, b, 3 + b}, {k, a, 3 + a}, {k, 3 + a, 3 + b}},
                              {{3, 4, 5}, {0, 3, 5}, {1, 4, 3}, {2, 5, 4}}};
    for (int n = 0; n <= count; n++)
        for (int i = 0; i < 3; i++) parts[n][i] = all[count][n][i];
    return count + 1;
}
