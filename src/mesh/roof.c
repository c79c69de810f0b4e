#include "mesh/roof.h"

#include <math.h>

/* How steep roofs are. A ball of radius r that touches the triangle 2 r from a side has places 1.6 r high and 1.2 r from the
 * plane over that side: 4 / 3 is the least that covers it. */
static const double slope = 1.34;
/* Of the longest side: a triangle that is less high is a needle; what is less than the other is rounding. */
static const double least_height = 1e-3, rounding = 1e-12;

typedef struct roof {
    size_t own;
    vec3 corner[3], normal, inward[3]; /* unit; of the side that begins at corner k, in the plane */
    double slack;
} roof;

/* Under one roof, on the face that the normal is turned to by `face`; false only where the triangle is surely not. */
static bool may_be_under(const roof *r, const vec3 corner[3], double face)
{
    double height[3];
    bool above = false;
    for (int i = 0; i < 3; i++) {
        height[i] = face * vec3_dot(vec3_sub(corner[i], r->corner[0]), r->normal);
        above |= height[i] > r->slack;
    }
    for (int k = 0; above && k < 3; k++) {
        bool under = false;
        for (int i = 0; i < 3; i++)
            under |= slope * vec3_dot(vec3_sub(corner[i], r->corner[k]), r->inward[k]) > height[i] + r->slack;
        above = under;
    }
    return above;
}

static bool is_in_the_way(const void *context, size_t n, const triangle *t)
{
    const roof *r = context;
    const vec3 corner[3] = {t->a, t->b, t->c};
    return n != r->own && (may_be_under(r, corner, 1) || may_be_under(r, corner, -1));
}

bool roof_is_clear(const nearest_triangle *tree, const mesh *m, size_t n)
{
    roof r = {.own = n};
    bbox box = bbox_empty();
    vec3 middle = {0, 0, 0}; /* of the circle inside, times `around` */
    double longest = 0, around = 0;
    for (int k = 0; k < 3; k++) r.corner[k] = m->vertex[m->triangle[n][k]];
    for (int k = 0; k < 3; k++) {
        const double length = vec3_norm(vec3_sub(r.corner[(k + 1) % 3], r.corner[k]));
        longest = fmax(longest, length);
        around += length;
        box = bbox_include(box, r.corner[k]);
        middle = vec3_axpy(length, m->vertex[m->triangle[n][(k + 2) % 3]], middle);
    }
    const vec3 cross = vec3_cross(vec3_sub(r.corner[1], r.corner[0]), vec3_sub(r.corner[2], r.corner[0]));
    const double twice = vec3_norm(cross);
    if (!(twice > least_height * longest * longest)) return false;
    r.normal = vec3_scale(cross, 1 / twice);
    r.slack = rounding * longest;
    for (int k = 0; k < 3; k++)
        r.inward[k] = vec3_unit(vec3_cross(r.normal, vec3_sub(r.corner[(k + 1) % 3], r.corner[k])));
    const double top = slope * twice / around;
    middle = vec3_scale(middle, 1 / around);
    box =
        bbox_include(bbox_include(box, vec3_axpy(top, r.normal, middle)), vec3_axpy(-top, r.normal, middle));
    return !nearest_triangle_any(tree, bbox_grow(box, r.slack), is_in_the_way, &r);
}
