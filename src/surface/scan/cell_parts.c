// SPDX-License-Identifier: Apache-2.0
#include "surface/scan/cell_parts.h"

#include <string.h>

#include "base/core/isa.h"
#include "base/core/lanes.h"

enum {
    NODES = CELL_PARTS + 1,
    LAYER = NODES * NODES, /* nodes of a layer */
    ALL_NODES = NODES * LAYER,
    AXES = 8, /* number of sets of axes: the direction of an edge, as bits */
    EDGES = ALL_NODES * AXES,
    TRIANGLES = CELL_PARTS * CELL_PARTS * CELL_PARTS * FIELD_CELL_TRIANGLES
};

/* F and its gradient at the corners of the parts. */
typedef struct part_nodes {
    vec3 at[ALL_NODES], gradient[ALL_NODES];
    double value[ALL_NODES];
} part_nodes;

/* Offset from a node to the node one step along the axes given as bits. */
static int step_along(int axes)
{
    return (axes & 1) + (axes >> 1 & 1) * NODES + (axes >> 2) * LAYER;
}

/* Edges in SIMD lanes: from the end inside the solid, with its F and slope, to the end outside. */
typedef struct edge_lanes {
    double x[LANES], y[LANES], z[LANES], dx[LANES], dy[LANES], dz[LANES];
    double gx[LANES], gy[LANES], gz[LANES]; /* the gradients at the ends */
    double tx[LANES], ty[LANES], tz[LANES];
    double f0[LANES], f1[LANES];
} edge_lanes;

/* Roots of F on edges. `smooth` 0: the normal of the root is not usable. */
typedef struct roots {
    int count;
    double x[EDGES + LANES], y[EDGES + LANES], z[EDGES + LANES];
    double nx[EDGES + LANES], ny[EDGES + LANES], nz[EDGES + LANES];
    double smooth[EDGES + LANES]; /* 1 or 0 */
    uint16_t
        of[EDGES]; /* per node and direction: the index of the root plus 1 on the edge from the node; 0: not
                    * computed yet */
} roots;

/* The triangles of all parts, each by its three roots. */
typedef struct part_triangles {
    int count;
    uint16_t corner[TRIANGLES][3], part[TRIANGLES];
} part_triangles;

static vec3 part_node(const field_cell *cell, int parts, int n)
{
    const vec3 from = cell->corner[0];
    const double x = n % NODES / (double)parts, y = n / NODES % NODES / (double)parts,
                 z = n / LAYER / (double)parts;
    return vec3_axpy(
        z, vec3_sub(cell->corner[4], from),
        vec3_axpy(y, vec3_sub(cell->corner[2], from), vec3_axpy(x, vec3_sub(cell->corner[1], from), from)));
}

/* The n-th node to sample. The last axis comes first, because fields may share computations between nodes
 * with the same first coordinate. */
static int node_in_turn(int parts, int n)
{
    const int nodes = parts + 1;
    return n % nodes * LAYER + n / nodes % nodes * NODES + n / (nodes * nodes);
}

/* Samples F at all nodes, in single precision, which is sufficient for areas. False: F is not defined at a
 * node. */
static bool sample_parts(const field *f, const field_cell *cell, int parts, part_nodes *out)
{
    const int all = (parts + 1) * (parts + 1) * (parts + 1);
    for (int first = 0; first < all; first += VEC3_LANES) {
        vec3_lanes x, gradient;
        bool defined[VEC3_LANES];
        double value[VEC3_LANES];
        for (int l = 0; l < VEC3_LANES; l++) {
            vec3_lanes_put(
                &x, l, part_node(cell, parts, node_in_turn(parts, first + l < all ? first + l : all - 1)));
            defined[l] = true;
        }
        field_sample_lanes(f, &x, defined, value, &gradient);
        for (int l = 0; l < VEC3_LANES && first + l < all; l++) {
            const int n = node_in_turn(parts, first + l);
            if (!defined[l]) return false;
            out->at[n] = vec3_lanes_get(&x, l);
            out->gradient[n] = vec3_lanes_get(&gradient, l);
            out->value[n] = value[l];
        }
    }
    return true;
}

/* Computes roots from the values and slopes at both ends of the edges: the root of the cubic that has them.
 * For splines this is exact along the axes; elsewhere the error is of fourth order. The normal is
 * interpolated linearly. */
ISA_CLONES static void find_roots(const edge_lanes *e, double last_step, int first, roots *out)
{
    double low[LANES], high[LANES], at_low[LANES], at_high[LANES], newton[LANES], kept[LANES], done[LANES],
        end[LANES], rise[LANES], d0[LANES], d1[LANES], across[LANES], nx[LANES], ny[LANES], nz[LANES];
    for (int l = 0; l < LANES; l++) {
        low[l] = kept[l] = done[l] = end[l] = nx[l] = ny[l] = nz[l] = 0;
        high[l] = 1;
        at_low[l] = e->f0[l];
        at_high[l] = e->f1[l];
        newton[l] = -1;
        rise[l] = e->f1[l] - e->f0[l];
        d0[l] = e->gx[l] * e->dx[l] + e->gy[l] * e->dy[l] + e->gz[l] * e->dz[l] - rise[l];
        d1[l] = e->tx[l] * e->dx[l] + e->ty[l] * e->dy[l] + e->tz[l] * e->dz[l] - rise[l];
        across[l] = sqrt(e->dx[l] * e->dx[l] + e->dy[l] * e->dy[l] + e->dz[l] * e->dz[l]);
    }
    double left = LANES;
    for (int k = 0; k < CELL_ROOT_STEPS && left > 0; k++) {
        left = LANES;
        const double odd = k & 1;
        for (int l = 0; l < LANES; l++) {
            const double straight = low[l] + (high[l] - low[l]) * at_low[l] / (at_low[l] - at_high[l]);
            const double between = newton[l] < high[l] ? odd : 0,
                         t = newton[l] > low[l] && between > 0 ? newton[l] : straight;
            const double value = e->f0[l] + t * rise[l] + t * (1 - t) * ((1 - t) * d0[l] - t * d1[l]);
            const double gx = e->gx[l] + t * (e->tx[l] - e->gx[l]), gy = e->gy[l] + t * (e->ty[l] - e->gy[l]),
                         gz = e->gz[l] + t * (e->tz[l] - e->gz[l]);
            const double length = sqrt(gx * gx + gy * gy + gz * gz);
            const double step = t - value / (gx * e->dx[l] + gy * e->dy[l] + gz * e->dz[l]),
                         next = value == 0 ? t : step;
            const double is_near = fabs(next - t) * across[l] <= last_step ? 1.0 : 0.0,
                         found = length > 0 ? is_near : 0.0;
            const double above = next > low[l] ? next : low[l], within = above < high[l] ? above : high[l];
            const double place = found > 0 ? within : t, over = 1 / length;
            end[l] = done[l] > 0 ? end[l] : place;
            nx[l] = done[l] > 0 ? nx[l] : gx * over;
            ny[l] = done[l] > 0 ? ny[l] : gy * over;
            nz[l] = done[l] > 0 ? nz[l] : gz * over;
            done[l] = found > 0 ? 1.0 : done[l];
            const double halved_high = kept[l] > 0 ? 0.5 * at_high[l] : at_high[l],
                         halved_low = kept[l] < 0 ? 0.5 * at_low[l] : at_low[l];
            low[l] = value < 0 ? t : low[l];
            high[l] = value < 0 ? high[l] : t;
            at_low[l] = value < 0 ? value : halved_low;
            at_high[l] = value < 0 ? halved_high : value;
            kept[l] = value < 0 ? 1.0 : -1.0;
            newton[l] = next;
        }
        for (int l = 0; l < LANES; l++) left -= done[l];
    }
    for (int l = 0; l < LANES; l++) {
        out->x[first + l] = e->x[l] + end[l] * e->dx[l];
        out->y[first + l] = e->y[l] + end[l] * e->dy[l];
        out->z[first + l] = e->z[l] + end[l] * e->dz[l];
        out->nx[first + l] = nx[l];
        out->ny[first + l] = ny[l];
        out->nz[first + l] = nz[l];
        out->smooth[first + l] = done[l];
    }
}

static void put_edge(const part_nodes *n, int inside, int outside, int l, edge_lanes *out)
{
    const vec3 from = n->at[inside], edge = vec3_sub(n->at[outside], from);
    out->x[l] = from.x;
    out->y[l] = from.y;
    out->z[l] = from.z;
    out->dx[l] = edge.x;
    out->dy[l] = edge.y;
    out->dz[l] = edge.z;
    out->gx[l] = n->gradient[inside].x;
    out->gy[l] = n->gradient[inside].y;
    out->gz[l] = n->gradient[inside].z;
    out->tx[l] = n->gradient[outside].x;
    out->ty[l] = n->gradient[outside].y;
    out->tz[l] = n->gradient[outside].z;
    out->f0[l] = n->value[inside];
    out->f1[l] = n->value[outside];
}

/* Computes a root by evaluating F: where F is not smooth, values and slopes at the ends do not determine
 * it. */
static void find_sharp_root(const field *f, const part_nodes *n, int inside, int outside, int k, roots *out)
{
    corner c = {.smooth = false, .normal = {0, 0, 0}};
    field_cell ends;
    ends.corner[0] = n->at[inside];
    ends.corner[1] = n->at[outside];
    ends.value[0] = n->value[inside];
    ends.value[1] = n->value[outside];
    cell_find_root(f, &ends, 0, 1, false, &c);
    out->x[k] = c.position.x;
    out->y[k] = c.position.y;
    out->z[k] = c.position.z;
    out->nx[k] = c.normal.x;
    out->ny[k] = c.normal.y;
    out->nz[k] = c.normal.z;
    out->smooth[k] = c.smooth;
}

/* The index of the root on an edge. Roots are computed in batches; all are available after cut_parts. */
static uint16_t root_on(const field *f, const part_nodes *n, int inside, int outside, int axes,
                        edge_lanes *batch, roots *out)
{
    uint16_t *of = &out->of[(inside < outside ? inside : outside) * AXES + axes];
    if (*of > 0) return *of - 1;
    const int k = out->count++;
    *of = (uint16_t)out->count;
    if (f->sharp) {
        find_sharp_root(f, n, inside, outside, k, out);
        return (uint16_t)k;
    }
    put_edge(n, inside, outside, k % LANES, batch);
    if (out->count % LANES == 0) find_roots(batch, CELL_LAST_STEP * f->cell_size, out->count - LANES, out);
    return (uint16_t)k;
}

/* Adds the triangles of a part, by their roots. `first`: the part's first node. */
static void cut_part(const field *f, const part_nodes *n, int first, edge_lanes *batch, roots *r,
                     part_triangles *out)
{
    crossed_edge at[FIELD_CELL_TRIANGLES][3];
    unsigned inside = 0;
    for (int c = 0; c < FIELD_CELL_CORNERS; c++)
        inside |= (unsigned)(n->value[first + step_along(c)] < 0) << c;
    if (inside == 0 || inside == UINT8_MAX) return;
    const int count = cell_cut(inside, at);
    for (int i = 0; i < count; i++, out->count++) {
        out->part[out->count] = (uint16_t)first;
        for (int c = 0; c < 3; c++)
            out->corner[out->count][c] =
                root_on(f, n, first + step_along(at[i][c].inside), first + step_along(at[i][c].outside),
                        at[i][c].inside ^ at[i][c].outside, batch, r);
    }
}

static void cut_parts(const field *f, const part_nodes *n, int parts, roots *r, part_triangles *out)
{
    edge_lanes batch = {.x = {0}};
    r->count = out->count = 0;
    memset(r->of, 0, sizeof r->of);
    for (int z = 0; z < parts; z++)
        for (int y = 0; y < parts; y++)
            for (int x = 0; x < parts; x++) cut_part(f, n, x + y * NODES + z * LAYER, &batch, r, out);
    if (!f->sharp && r->count % LANES > 0) /* the last, incomplete batch; unused lanes repeat earlier edges */
        find_roots(&batch, CELL_LAST_STEP * f->cell_size, r->count / LANES * LANES, r);
}

/* Triangles in SIMD lanes. */
typedef struct triangle_lanes {
    double x[3][LANES], y[3][LANES], z[3][LANES];
    double nx[3][LANES], ny[3][LANES], nz[3][LANES];
    double smooth[LANES];
} triangle_lanes;

/* Computes the areas as curved_area of surface.c does without subdivision, and the excess that it would test
 * (0 where it would not). */
ISA_CLONES static void measure_triangles(const triangle_lanes *t, double out[LANES],
                                         double more_than_flat[LANES])
{
    for (int l = 0; l < LANES; l++) {
        const double ux = t->x[1][l] - t->x[0][l], uy = t->y[1][l] - t->y[0][l], uz = t->z[1][l] - t->z[0][l];
        const double vx = t->x[2][l] - t->x[0][l], vy = t->y[2][l] - t->y[0][l], vz = t->z[2][l] - t->z[0][l];
        const double wx = uy * vz - uz * vy, wy = uz * vx - ux * vz, wz = ux * vy - uy * vx;
        const double twice2 = wx * wx + wy * wy + wz * wz, area = 0.5 * sqrt(twice2);
        double sum = 0, squares = 0;
#pragma GCC unroll 3
        for (int k = 0; k < 3; k++) {
            const int o = k, p = (k + 1) % 3, q = (k + 2) % 3;
            const double ex = t->x[q][l] - t->x[p][l], ey = t->y[q][l] - t->y[p][l],
                         ez = t->z[q][l] - t->z[p][l];
            const double l2 = ex * ex + ey * ey + ez * ez;
            const double turn = ex * (t->nx[q][l] - t->nx[p][l]) + ey * (t->ny[q][l] - t->ny[p][l]) +
                                ez * (t->nz[q][l] - t->nz[p][l]);
            const double px = t->x[p][l] - t->x[o][l], py = t->y[p][l] - t->y[o][l],
                         pz = t->z[p][l] - t->z[o][l];
            const double qx = t->x[q][l] - t->x[o][l], qy = t->y[q][l] - t->y[o][l],
                         qz = t->z[q][l] - t->z[o][l];
            const double cot = (px * qx + py * qy + pz * qz) / (2 * area);
            const double more = cot / 4 * (turn * turn / l2) * l2 / 12;
            squares += l2;
            sum += l2 > 0 ? more : 0.0;
        }
        const double ax = t->nx[1][l] - t->nx[0][l], ay = t->ny[1][l] - t->ny[0][l],
                     az = t->nz[1][l] - t->nz[0][l];
        const double bx = t->nx[2][l] - t->nx[0][l], by = t->ny[2][l] - t->ny[0][l],
                     bz = t->nz[2][l] - t->nz[0][l];
        const double turns = (ay * bz - az * by) * wx + (az * bx - ax * bz) * wy + (ax * by - ay * bx) * wz;
        const double excess = sum / area + turns / twice2 * squares / 24;
        const double above = excess > -CELL_EXCESS_LIMIT ? excess : -CELL_EXCESS_LIMIT;
        const double within = above < CELL_EXCESS_LIMIT ? above : CELL_EXCESS_LIMIT;
        const double curved = area * (1 + within), smooth = area > 0 ? t->smooth[l] : 0.0;
        out[l] = smooth > 0 ? curved : area;
        more_than_flat[l] = smooth > 0 ? excess : 0;
    }
}

static double sum_areas(const part_triangles *t, const roots *r)
{
    double sum = 0, of_part = 0;
    for (int first = 0; first < t->count; first += LANES) {
        triangle_lanes batch;
        double area[LANES], excess[LANES];
        for (int l = 0; l < LANES; l++) {
            const uint16_t *at = t->corner[first + l < t->count ? first + l : t->count - 1];
            for (int c = 0; c < 3; c++) {
                batch.x[c][l] = r->x[at[c]];
                batch.y[c][l] = r->y[at[c]];
                batch.z[c][l] = r->z[at[c]];
                batch.nx[c][l] = r->nx[at[c]];
                batch.ny[c][l] = r->ny[at[c]];
                batch.nz[c][l] = r->nz[at[c]];
            }
            batch.smooth[l] = r->smooth[at[0]] * r->smooth[at[1]] * r->smooth[at[2]];
        }
        measure_triangles(&batch, area, excess);
        for (int k = first; k < t->count && k < first + LANES; k++) {
            if (k > 0 && t->part[k] != t->part[k - 1]) {
                sum += of_part;
                of_part = 0;
            }
            of_part += area[k - first];
        }
    }
    return sum + of_part;
}

void cell_measure_triangles(const triangulation *t, double area[], double excess[])
{
    for (int first = 0; first < t->count; first += LANES) {
        triangle_lanes batch;
        double of[LANES], more[LANES];
        for (int l = 0; l < LANES; l++) {
            const corner *at = t->at[first + l < t->count ? first + l : t->count - 1];
            for (int c = 0; c < 3; c++) {
                batch.x[c][l] = at[c].position.x;
                batch.y[c][l] = at[c].position.y;
                batch.z[c][l] = at[c].position.z;
                batch.nx[c][l] = at[c].normal.x;
                batch.ny[c][l] = at[c].normal.y;
                batch.nz[c][l] = at[c].normal.z;
            }
            batch.smooth[l] = at[0].smooth && at[1].smooth && at[2].smooth ? 1 : 0;
        }
        measure_triangles(&batch, of, more);
        for (int k = first; k < t->count && k < first + LANES; k++) {
            area[k] = of[k - first];
            excess[k] = more[k - first];
        }
    }
}

static corner corner_of(const roots *r, int k)
{
    return (corner){{r->x[k], r->y[k], r->z[k]}, {r->nx[k], r->ny[k], r->nz[k]}, r->smooth[k] > 0};
}

static double area_by(const field *f, const field_cell *cell, int parts, triangulation *lacking)
{
    part_nodes nodes;
    roots r;
    part_triangles t;
    if (!sample_parts(f, cell, parts, &nodes)) return 0;
    cut_parts(f, &nodes, parts, &r, &t);
    for (int k = 0; lacking && k < t.count && lacking->count < FIELD_CELL_TRIANGLES; k++, lacking->count++)
        for (int c = 0; c < 3; c++) lacking->at[lacking->count][c] = corner_of(&r, t.corner[k][c]);
    return sum_areas(&t, &r);
}

double cell_parts_area(const field *f, const field_cell *cell, triangulation *lacking)
{
    return area_by(f, cell, CELL_PARTS, lacking);
}

double cell_half_parts_area(const field *f, const field_cell *cell)
{
    return area_by(f, cell, CELL_PARTS / 2, NULL);
}
