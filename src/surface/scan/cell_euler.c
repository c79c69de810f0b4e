// SPDX-License-Identifier: Apache-2.0
#include "surface/scan/cell_euler.h"

#include "surface/scan/cell_roots.h"

/* Maximum corners of a triangle that is clipped at six planes. */
enum { CORNERS = 9 };

static unsigned corners_inside(const field_cell *cell)
{
    unsigned inside = 0;
    for (int c = 0; c < FIELD_CELL_CORNERS; c++) inside |= (unsigned)(cell->value[c] < 0) << c;
    return inside;
}

/* The share of a cell in an edge: four cells share one along an axis, two a diagonal of a face. */
static int edge_share(crossed_edge e)
{
    static const int share[] = {0, 1, 2, CELL_EULER_UNIT};
    return share[__builtin_popcount((unsigned)(e.inside ^ e.outside))];
}

void cell_euler_fill(int8_t table[256])
{
    for (unsigned inside = 0; inside < 256; inside++) {
        field_cell cell;
        crossed_edge edge[CELL_EDGES], at[FIELD_CELL_TRIANGLES][3];
        int sum = 0;
        for (int c = 0; c < FIELD_CELL_CORNERS; c++) cell.value[c] = inside >> c & 1 ? -1 : 1;
        const int edges = cell_crossed_edges(&cell, edge), triangles = cell_cut(inside, at);
        for (int k = 0; k < edges; k++) sum += edge_share(edge[k]);
        /* each side belongs to two triangles */
        table[inside] = (int8_t)(sum + triangles * CELL_EULER_UNIT - 3 * triangles * CELL_EULER_UNIT / 2);
    }
}

static vec3 root_of(const field_cell *cell, crossed_edge e)
{
    const double t = cell->value[e.inside] / (cell->value[e.inside] - cell->value[e.outside]);
    return vec3_axpy(t, vec3_sub(cell->corner[e.outside], cell->corner[e.inside]), cell->corner[e.inside]);
}

/* Whether a polygon, or a line between two corners, has a place in the box: clips it at each face. */
static bool reaches(bbox box, const vec3 *polygon, int count)
{
    vec3 from[CORNERS], to[CORNERS];
    for (int k = 0; k < count; k++) from[k] = polygon[k];
    for (int face = 0; face < 6 && count > 0; face++) {
        const int axis = face >> 1;
        const double plane = vec3_get(face & 1 ? box.max : box.min, axis), sign = face & 1 ? -1 : 1;
        int left = 0;
        if (!isfinite(plane)) continue;
        for (int k = 0; k < count; k++) {
            const vec3 p = from[k], q = from[(k + 1) % count];
            const double a = sign * (vec3_get(p, axis) - plane), b = sign * (vec3_get(q, axis) - plane);
            if (a >= 0) to[left++] = p;
            if ((a >= 0) != (b >= 0)) to[left++] = vec3_axpy(a / (a - b), vec3_sub(q, p), p);
        }
        count = left;
        for (int k = 0; k < count; k++) from[k] = to[k];
    }
    return count > 0;
}

/* For a closed surface cut by a convex box, the corners in the box, minus the sides that reach into it, plus the faces
 * that do, are the characteristic of the part in the box. */
int cell_euler_cut(const field_cell *cell, bbox within)
{
    crossed_edge edge[CELL_EDGES], at[FIELD_CELL_TRIANGLES][3];
    const int edges = cell_crossed_edges(cell, edge), triangles = cell_cut(corners_inside(cell), at);
    int sum = 0;
    for (int k = 0; k < edges; k++)
        sum += bbox_contains(within, root_of(cell, edge[k])) ? edge_share(edge[k]) : 0;
    for (int i = 0; i < triangles; i++) {
        vec3 at_root[4];
        for (int c = 0; c < 4; c++) at_root[c] = root_of(cell, at[i][c % 3]);
        sum += reaches(within, at_root, 3) ? CELL_EULER_UNIT : 0;
        for (int c = 0; c < 3; c++) sum -= reaches(within, at_root + c, 2) ? CELL_EULER_UNIT / 2 : 0;
    }
    return sum;
}
