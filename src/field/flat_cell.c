#include "field/flat_cell.h"

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

double flat_cell_area(const field_cell *cell, bbox *box)
{
    const vec3 *p = cell->corner, x = vec3_sub(p[1], p[0]), y = vec3_sub(p[2], p[0]),
               z = vec3_sub(p[4], p[0]);
    const vec3 across[3] = {vec3_cross(y, z), vec3_cross(z, x), vec3_cross(x, y)};
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
