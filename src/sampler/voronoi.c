#include "sampler/voronoi.h"

/* A Voronoi edge is cut off this far from its middle, in units of the spacing: nothing bounds it there. */
static const double EDGE_LIMIT = 1.5;
/* Two points farther apart than this, in spacings, have others between them, even beside a vacancy: where
 * none are seen the two are on sheets that no edge joins, such as the floor of a cup and its outer wall. */
static const double EDGE_FARTHEST = 2.2;
/* Voronoi edges shorter than this fraction of that limit belong to four points nearly on a circle, whose
 * two diagonals are judged in slightly different planes: they are settled by one rule for both. */
static const double EDGE_DOUBT = 0.1;

/* A ridge between two points is taken to be no higher than this, of their distance; 0.5 is that of a right
 * angle. */
static const double RIDGE_HIGHEST = 0.75, RIDGE_STEEPEST = 0.2;

/* The angle at p under which a and b are seen. */
static double angle_at(vec3 p, vec3 a, vec3 b)
{
    vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return atan2(vec3_norm(vec3_cross(u, v)), vec3_dot(u, v));
}

/* The cotangent of the angle at p under which a and b are seen. */
static double cotangent_at(vec3 p, vec3 a, vec3 b)
{
    vec3 u = vec3_sub(a, p), v = vec3_sub(b, p);
    return vec3_dot(u, v) / vec3_norm(vec3_cross(u, v));
}

/* Between the circumcentres of the triangles a b c and a b d, unfolded about their edge. */
static double dual_length(vec3 a, vec3 b, vec3 c, vec3 d)
{
    double length = 0.5 * vec3_norm(vec3_sub(b, a)) * (cotangent_at(c, a, b) + cotangent_at(d, a, b));
    return isfinite(length) ? fmax(length, 0) : 0;
}

/* Of a quadrilateral a c b d that nearly lies on a circle: is ab its Delaunay diagonal, rather than cd?
 * The same answer for either diagonal. */
static bool is_diagonal(const vec3 *x, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    double opposite = angle_at(x[c], x[a], x[b]) + angle_at(x[d], x[a], x[b]);
    double own = angle_at(x[a], x[c], x[d]) + angle_at(x[b], x[c], x[d]);
    if (opposite != own) return opposite < own;
    return (a < b ? a : b) < (c < d ? c : d);
}

/* How far above the middle of r the tangent planes of its ends meet: on a crease that is where the surface
 * is, and its points there have the say whether the two are neighbours. */
static double ridge_rise(vec3 r, vec3 normal_a, vec3 normal_b, vec3 up)
{
    double a = -vec3_dot(normal_a, r), b = vec3_dot(normal_b, r);
    double rise = 0.25 * (a / fmax(vec3_dot(normal_a, up), RIDGE_STEEPEST) +
                          b / fmax(vec3_dot(normal_b, up), RIDGE_STEEPEST));
    double most = RIDGE_HIGHEST * vec3_norm(r);
    return fmin(fmax(rise, -most), most);
}

bool voronoi_edge(const voronoi_sites *in, uint32_t a, uint32_t b, double *length)
{
    if (a > b) { /* one view of each pair */
        uint32_t swap = a;
        a = b;
        b = swap;
    }
    vec3 r = vec3_sub(in->position[b], in->position[a]);
    double farthest = EDGE_FARTHEST * 0.5 * (in->spacing[a] + in->spacing[b]);
    if (vec3_norm2(r) > farthest * farthest) return false;
    vec3 n = vec3_add(in->normal[a], in->normal[b]);
    vec3 d = vec3_unit(vec3_cross(n, r));
    double length_n = vec3_norm(n);
    vec3 up = vec3_unit(vec3_cross(r, d));
    double rise = ridge_rise(r, in->normal[a], in->normal[b], up);
    vec3 m = vec3_axpy(rise, up, vec3_axpy(0.5, r, in->position[a]));
    double quarter = 0.25 * vec3_norm2(r) + rise * rise;
    double limit = EDGE_LIMIT * fmax(in->spacing[a], in->spacing[b]), low = -limit, high = limit;
    uint32_t low_by = a, high_by = a; /* a: nobody */
    const uint32_t *list = neighbours_list(in->near, a);
    for (uint32_t k = 0; k < in->near->list_count[a]; k++) {
        uint32_t c = list[k];
        if (c == b || vec3_dot(in->normal[c], n) <= VORONOI_OTHER_SIDE * length_n) continue;
        vec3 q = vec3_sub(in->position[c], m);
        double along = 2 * vec3_dot(d, q), rest = vec3_norm2(q) - quarter;
        /* points m + t d of the bisector are nearer to c where 2 t d.q > |q|^2 - |r|^2 / 4 */
        if (along > 0 && rest < along * high) {
            high = rest / along;
            high_by = c;
        } else if (along < 0 && rest < along * low) {
            low = rest / along;
            low_by = c;
        } else if (along == 0 && rest < 0)
            return false; /* c lies between the two */
        if (high - low < -EDGE_DOUBT * limit) return false;
    }
    *length = low_by == a || high_by == a ? fmax(high - low, 0)
                                          : dual_length(in->position[a], in->position[b],
                                                        in->position[low_by], in->position[high_by]);
    if (high - low > EDGE_DOUBT * limit || low_by == a || high_by == a) return high > low;
    return is_diagonal(in->position, a, b, low_by, high_by);
}
