#include "field/flat_cell.h"

#include <math.h>

/* Kuhn's tetrahedra: the corners from 0 to 7 along an order of the axes. */
static const struct {
    uint8_t axis[3], corner[4];
} tetrahedra[6] = {{{0, 1, 2}, {0, 1, 3, 7}}, {{0, 2, 1}, {0, 1, 5, 7}}, {{1, 0, 2}, {0, 2, 3, 7}},
                   {{1, 2, 0}, {0, 2, 6, 7}}, {{2, 0, 1}, {0, 4, 5, 7}}, {{2, 1, 0}, {0, 4, 6, 7}}};

/* By how much the share of a tetrahedron that lies below 0 grows with that, where F is linear between its values. */
static double density(const double value[4])
{
    double in[4], out[4];
    int inside = 0, outside = 0;
    for (int k = 0; k < 4; k++) {
        if (value[k] < 0)
            in[inside++] = value[k];
        else
            out[outside++] = value[k];
    }
    if (inside == 1) return 3 * in[0] * in[0] / ((out[0] - in[0]) * (out[1] - in[0]) * (out[2] - in[0]));
    if (inside == 3) return 3 * out[0] * out[0] / ((out[0] - in[0]) * (out[0] - in[1]) * (out[0] - in[2]));
    if (inside != 2) return 0;
    const double a = in[0], b = in[1], c = out[0], d = out[1];
    return 3 * (c * -a * (d - b) + d * -b * (c - a)) / ((d - a) * (c - b) * (c - a) * (d - b));
}

/* Where F, linear, is zero on the cell's edges. */
static void add_roots(const field_cell *cell, bbox *box)
{
    for (int from = 0; from < 7; from++)
        for (int axis = 0; axis < 3; axis++) {
            const int to = from | 1 << axis;
            const double low = cell->value[from], high = cell->value[to];
            if (to == from || (low < 0) == (high < 0)) continue;
            const vec3 way = vec3_sub(cell->corner[to], cell->corner[from]);
            *box = bbox_include(*box, vec3_axpy(low / (low - high), way, cell->corner[from]));
        }
}

/* The cell's edges, and of each axis the vector across the other two. */
static void find_edges(const field_cell *cell, vec3 edge[3], vec3 across[3])
{
    for (int a = 0; a < 3; a++) edge[a] = vec3_sub(cell->corner[1 << a], cell->corner[0]);
    for (int a = 0; a < 3; a++) across[a] = vec3_cross(edge[(a + 1) % 3], edge[(a + 2) % 3]);
}

double flat_cell_area(const field_cell *cell, bbox *box)
{
    const vec3 *p = cell->corner;
    vec3 edge[3], across[3];
    find_edges(cell, edge, across);
    double area = 0;
    for (int k = 0; k < 6; k++) {
        const uint8_t *c = tetrahedra[k].corner;
        const double f[4] = {cell->value[c[0]], cell->value[c[1]], cell->value[c[2]], cell->value[c[3]]};
        vec3 slope = {0, 0, 0};
        for (int i = 0; i < 3; i++) slope = vec3_axpy(f[i + 1] - f[i], across[tetrahedra[k].axis[i]], slope);
        area += vec3_norm(slope) * density(f);
    }
    bool within = true;
    for (int k = 0; k < 8; k++) within = within && bbox_contains(*box, p[k]);
    if (!within) add_roots(cell, box);
    return area / 6;
}

/* The square of what lies across the normal. */
static double tangent_norm2(vec3 v, vec3 normal)
{
    const double along = vec3_dot(v, normal);
    return vec3_norm2(v) - along * along;
}

/* Over all places of a tetrahedron the mean of the slope of e, the difference of F from what is linear between the corners, along the
 * cell's edges. bend[i][j]: the second derivative of F along edges i and j. */
static void mean_slope(const double bend[3][3], const uint8_t axis[3], double out[3])
{
    const int a = axis[0], b = axis[1], c = axis[2];
    out[a] = -0.25 * (bend[a][a] + 2 * bend[a][b] + bend[a][c]);
    out[b] = 0.25 * (bend[a][b] - bend[b][c]);
    out[c] = 0.25 * (bend[c][c] + bend[a][c] + 2 * bend[b][c]);
}

/* The surface of linear pieces lies e / |grad F| below that of F. With H the second derivatives across the normal its area differs by
 * -tr H <e> / |grad F|^2, since it is elsewhere, and by <|grad e|^2> / (2 |grad F|^2), since it is tilted. Of a tetrahedron <e> and
 * <grad e> follow from the corners, and e's slope varies about that as its places do: all by the second moments of the corners. */
double flat_cell_shortage(const field_cell *cell, const field_sample *middle)
{
    vec3 edge[3], across[3], turn[3], sum = {0, 0, 0};
    double bend[3][3], mean_e = 0, tilt2 = 0;
    const double slope2 = vec3_norm2(middle->gradient);
    const vec3 normal = vec3_scale(middle->gradient, 1 / sqrt(slope2));
    find_edges(cell, edge, across);
    const double volume = vec3_dot(edge[0], across[0]);
    for (int i = 0; i < 3; i++) {
        turn[i] = sym3_apply(middle->hessian, edge[i]);
        sum = vec3_add(sum, turn[i]);
        tilt2 += tangent_norm2(turn[i], normal) / 48;
        for (int j = 0; j <= i; j++) mean_e += (bend[i][j] = bend[j][i] = vec3_dot(turn[i], edge[j])) / 12;
    }
    tilt2 += tangent_norm2(sum, normal) / 48;
    for (int k = 0; k < 6; k++) {
        double along[3];
        vec3 slope = {0, 0, 0};
        mean_slope(bend, tetrahedra[k].axis, along);
        for (int i = 0; i < 3; i++) slope = vec3_axpy(along[i] / volume, across[i], slope);
        tilt2 += tangent_norm2(slope, normal) / 6;
    }
    const double trace = middle->hessian.xx + middle->hessian.yy + middle->hessian.zz -
                         vec3_dot(normal, sym3_apply(middle->hessian, normal));
    return (trace * mean_e - tilt2 / 2) / slope2;
}
