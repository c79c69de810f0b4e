// SPDX-License-Identifier: Apache-2.0
#include "surface/field/flat_cell.h"

#include <math.h>

#include "base/core/isa.h"
#include "surface/field/kuhn.h"

/* In edge lengths: larger than the rounding errors of corners. */
static const double HAIR = 1e-3;

enum { LANES = 8 };

/* Cells in SIMD lanes. */
typedef struct cell_lanes {
    double value[8][LANES];
    double edge[3][3][LANES]; /* axis, coordinate */
} cell_lanes;

static inline double least(double a, double b)
{
    return a < b ? a : b;
}

static inline double largest(double a, double b)
{
    return a > b ? a : b;
}

/* The derivative, with respect to the level at 0, of the fraction of a tetrahedron in which F, linear between
 * the values p, q, r, s, is below the level. Computes all cases without branches. */
static inline double density(double p, double q, double r, double s)
{
    const double low_p = least(p, q), high_p = largest(p, q), low_r = least(r, s), high_r = largest(r, s),
                 a = least(low_p, low_r), d = largest(high_p, high_r), x = largest(low_p, low_r),
                 y = least(high_p, high_r), b = least(x, y), c = largest(x, y);
    const double up = (d - a) * (c - a), over_one = up * (b - a), over_three = (d - a) * (d - b) * (d - c),
                 over_two = up * (c - b) * (d - b), two = d * -b * (c - a) - c * a * (d - b);
    const double share = b < 0 ? (c < 0 ? d * d : two) : a * a,
                 over = b < 0 ? (c < 0 ? over_three : over_two) : over_one;
    const double some = a < 0 ? (d < 0 ? 0 : share) : 0;
    return 3 * some / (some > 0 ? over : 1);
}

/* The compiler vectorises the loops over the lanes. */
ISA_CLONES static void sum_tetrahedra(const cell_lanes *in, double area[LANES])
{
    double across[3][3][LANES];
    for (int a = 0; a < 3; a++)
        for (int i = 0; i < 3; i++) {
            const double *u = in->edge[(a + 1) % 3][(i + 1) % 3], *v = in->edge[(a + 2) % 3][(i + 2) % 3],
                         *w = in->edge[(a + 1) % 3][(i + 2) % 3], *x = in->edge[(a + 2) % 3][(i + 1) % 3];
            for (int l = 0; l < LANES; l++) across[a][i][l] = u[l] * v[l] - w[l] * x[l];
        }
    for (int l = 0; l < LANES; l++) area[l] = 0;
    for (int k = 0; k < KUHN_TETRAHEDRA; k++) {
        const kuhn_path path = kuhn_path_of(k);
        const int *c = path.corner, *axis = path.axis;
        const double *f0 = in->value[c[0]], *f1 = in->value[c[1]], *f2 = in->value[c[2]],
                     *f3 = in->value[c[3]];
        const double(*s)[LANES] = across[axis[0]], (*t)[LANES] = across[axis[1]],
              (*u)[LANES] = across[axis[2]];
        for (int l = 0; l < LANES; l++) {
            const double p = f1[l] - f0[l], q = f2[l] - f1[l], r = f3[l] - f2[l];
            const double x = p * s[0][l] + q * t[0][l] + r * u[0][l],
                         y = p * s[1][l] + q * t[1][l] + r * u[1][l],
                         z = p * s[2][l] + q * t[2][l] + r * u[2][l];
            area[l] += sqrt(x * x + y * y + z * z) * density(f0[l], f1[l], f2[l], f3[l]);
        }
    }
}

/* Linear interpolation, clamped to [a, b]: a box that contains the corners then contains the roots, in spite
 * of rounding. */
static double between(double a, double b, double t)
{
    const double x = a + t * (b - a);
    return least(largest(x, least(a, b)), largest(a, b));
}

/* Adds the zeros of F, linear along each edge of the cell. */
static void add_roots(const field_cell *cell, bbox *box)
{
    for (int from = 0; from < 7; from++)
        for (int axis = 0; axis < 3; axis++) {
            const int to = from | 1 << axis;
            const double low = cell->value[from], high = cell->value[to];
            if (to == from || (low < 0) == (high < 0)) continue;
            const vec3 a = cell->corner[from], b = cell->corner[to];
            const double t = low / (low - high);
            *box =
                bbox_include(*box, (vec3){between(a.x, b.x, t), between(a.y, b.y, t), between(a.z, b.z, t)});
        }
}

static void set_lane(const field_cell *cell, int l, cell_lanes *out)
{
    for (int c = 0; c < 8; c++) out->value[c][l] = cell->value[c];
    for (int a = 0; a < 3; a++) {
        const vec3 edge = vec3_sub(cell->corner[1 << a], cell->corner[0]);
        out->edge[a][0][l] = edge.x;
        out->edge[a][1][l] = edge.y;
        out->edge[a][2][l] = edge.z;
    }
}

void flat_cell_areas(const field_cell *cells, size_t count, double *area)
{
    cell_lanes in;
    double found[LANES];
    for (size_t first = 0; first < count; first += LANES) {
        for (int l = 0; l < LANES; l++) set_lane(&cells[first + l < count ? first + l : first], l, &in);
        sum_tetrahedra(&in, found);
        for (size_t l = 0; l < LANES && first + l < count; l++) area[first + l] = found[l] / 6;
    }
}

void flat_cell_widen(const field_cell *cell, bbox *box)
{
    const vec3 *low = &cell->corner[0];
    vec3 reach = {0, 0, 0}; /* maximum extent along each axis, except for rounding */
    for (int a = 0; a < 3; a++) {
        const vec3 edge = vec3_sub(cell->corner[1 << a], *low);
        reach = vec3_add(reach, (vec3){fabs(edge.x), fabs(edge.y), fabs(edge.z)});
    }
    reach = vec3_scale(reach, 1 + HAIR);
    if (!bbox_contains(*box, vec3_sub(*low, reach)) || !bbox_contains(*box, vec3_add(*low, reach)))
        add_roots(cell, box);
}

/* The squared length of the component of v perpendicular to the unit normal. */
static double tangent_norm2(vec3 v, vec3 normal)
{
    const double along = vec3_dot(v, normal);
    return vec3_norm2(v) - along * along;
}

/* The gradient, along the edges of the cell, of e = (linear interpolant in a tetrahedron) - F: mean over the
 * tetrahedron. bend[i][j]: the second derivative of F along edges i and j. */
static void mean_slope(const double bend[3][3], const int axis[3], double out[3])
{
    const int a = axis[0], b = axis[1], c = axis[2];
    out[a] = -0.25 * (bend[a][a] + 2 * bend[a][b] + bend[a][c]);
    out[b] = 0.25 * (bend[a][b] - bend[b][c]);
    out[c] = 0.25 * (bend[c][c] + bend[a][c] + 2 * bend[b][c]);
}

/* The piecewise linear surface lies e / |grad F| below that of F. <> is the mean over the cell, H the second
 * derivatives of F in the tangent plane. The areas differ by -tr H <e> / |grad F|^2, because of the offset of
 * a curved surface, and by <|grad e|^2> / (2 |grad F|^2), because of the tilt. Both means follow from the
 * second moments of the corners of the tetrahedra. */
double flat_cell_shortage(const field_cell *cell, const field_sample *middle)
{
    vec3 edge[3], across[3], turn[3], sum = {0, 0, 0};
    double bend[3][3], mean_e = 0, tilt2 = 0;
    const double slope2 = vec3_norm2(middle->gradient);
    const vec3 normal = vec3_scale(middle->gradient, 1 / sqrt(slope2));
    for (int a = 0; a < 3; a++) edge[a] = vec3_sub(cell->corner[1 << a], cell->corner[0]);
    for (int a = 0; a < 3; a++) across[a] = vec3_cross(edge[(a + 1) % 3], edge[(a + 2) % 3]);
    const double volume = vec3_dot(edge[0], across[0]);
    for (int i = 0; i < 3; i++) {
        turn[i] = sym3_apply(middle->hessian, edge[i]);
        sum = vec3_add(sum, turn[i]);
        tilt2 += tangent_norm2(turn[i], normal) / 48;
        for (int j = 0; j <= i; j++) mean_e += (bend[i][j] = bend[j][i] = vec3_dot(turn[i], edge[j])) / 12;
    }
    tilt2 += tangent_norm2(sum, normal) / 48;
    for (int k = 0; k < KUHN_TETRAHEDRA; k++) {
        const kuhn_path path = kuhn_path_of(k);
        double along[3];
        vec3 slope = {0, 0, 0};
        mean_slope(bend, path.axis, along);
        for (int i = 0; i < 3; i++) slope = vec3_axpy(along[i] / volume, across[i], slope);
        tilt2 += tangent_norm2(slope, normal) / 6;
    }
    const double trace = middle->hessian.xx + middle->hessian.yy + middle->hessian.zz -
                         vec3_dot(normal, sym3_apply(middle->hessian, normal));
    return (trace * mean_e - tilt2 / 2) / slope2;
}
