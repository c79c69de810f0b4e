#include "surface/cell_parts.h"

#include <string.h>

#include "base/isa.h"

enum {
    NODES = CELL_PARTS + 1,
    LAYER = NODES * NODES, /* of nodes */
    ALL_NODES = NODES * LAYER,
    AXES = 8, /* sets of them, by bits: which way an edge goes */
    /* Of all parts' edges: along one axis, two or three. */
    EDGES = 3 * CELL_PARTS * NODES * NODES + 3 * CELL_PARTS * CELL_PARTS * NODES +
            CELL_PARTS * CELL_PARTS * CELL_PARTS,
    TRIANGLES = CELL_PARTS * CELL_PARTS * CELL_PARTS * FIELD_CELL_TRIANGLES,
    SIDE_BY_SIDE = 8
};

/* F at the corners of the parts. */
typedef struct part_nodes {
    vec3 at[ALL_NODES], gradient[ALL_NODES];
    double value[ALL_NODES];
    uint32_t inside[NODES]; /* of each layer, by bits */
} part_nodes;

/* From a node along some axes, bits: how far that is in a layer, and which nodes of a layer have one there. */
#define STEP(axes) (((axes)&1) + ((axes) >> 1 & 1) * NODES)
typedef struct part_grid {
    int parts; /* along each axis; nodes beyond theirs are not there */
    uint32_t have_step[4];
} part_grid;
static const part_grid whole_grid = {CELL_PARTS, {0x1ffffff, 0xf7bdef, 0xfffff, 0x7bdef}},
                       half_grid = {CELL_PARTS / 2, {0x1ce7, 0xc63, 0xe7, 0x63}};

/* Edges side by side: from the end inside, where F and its slope are the first, to that outside. */
typedef struct edge_lanes {
    double x[SIDE_BY_SIDE], y[SIDE_BY_SIDE], z[SIDE_BY_SIDE], dx[SIDE_BY_SIDE], dy[SIDE_BY_SIDE],
        dz[SIDE_BY_SIDE];
    double gx[SIDE_BY_SIDE], gy[SIDE_BY_SIDE], gz[SIDE_BY_SIDE]; /* the gradients at the ends */
    double tx[SIDE_BY_SIDE], ty[SIDE_BY_SIDE], tz[SIDE_BY_SIDE];
    double f0[SIDE_BY_SIDE], f1[SIDE_BY_SIDE];
} edge_lanes;

/* Roots: where the surface cuts edges. The normal of a root that is not smooth is not usable. */
typedef struct roots {
    int count;
    double x[EDGES + SIDE_BY_SIDE], y[EDGES + SIDE_BY_SIDE], z[EDGES + SIDE_BY_SIDE];
    double nx[EDGES + SIDE_BY_SIDE], ny[EDGES + SIDE_BY_SIDE], nz[EDGES + SIDE_BY_SIDE];
    double smooth[EDGES + SIDE_BY_SIDE]; /* 1 or 0 */
    uint16_t of[ALL_NODES * AXES]; /* of the edges that go up from a node, by the axes that they go along */
} roots;

/* The triangles of the parts, part after part, by their roots. */
typedef struct part_triangles {
    int count;
    uint16_t corner[TRIANGLES][3], part[TRIANGLES];
} part_triangles;

static vec3 part_node(const field_cell *cell, int parts, int n)
{
    const int at[3] = {n % NODES, n / NODES % NODES, n / NODES / NODES};
    vec3 node = cell->corner[0];
    for (int axis = 0; axis < 3; axis++)
        node = vec3_axpy(at[axis] / (double)parts, vec3_sub(cell->corner[1 << axis], cell->corner[0]), node);
    return node;
}

/* The n-th node to ask for F, along the last axis first: fields may share what nodes of one place along the first have
 * in common. */
static int node_in_turn(int parts, int n)
{
    const int nodes = parts + 1;
    return n % nodes * LAYER + n / nodes % nodes * NODES + n / (nodes * nodes);
}

/* False where F is not defined. Single precision is enough for an area. */
static bool sample_parts(const field *f, const field_cell *cell, int parts, part_nodes *out)
{
    const int all = (parts + 1) * (parts + 1) * (parts + 1);
    memset(out->inside, 0, sizeof out->inside);
    for (int first = 0; first < all; first += VEC3_LANES) {
        vec3_lanes x, gradient;
        bool defined[VEC3_LANES];
        double value[VEC3_LANES];
        for (int l = 0; l < VEC3_LANES; l++) {
            vec3 node = part_node(cell, parts, node_in_turn(parts, first + l < all ? first + l : all - 1));
            x.x[l] = node.x;
            x.y[l] = node.y;
            x.z[l] = node.z;
            defined[l] = true;
        }
        field_sample_lanes(f, &x, defined, value, &gradient);
        for (int l = 0; l < VEC3_LANES && first + l < all; l++) {
            const int n = node_in_turn(parts, first + l);
            if (!defined[l]) return false;
            out->at[n] = (vec3){x.x[l], x.y[l], x.z[l]};
            out->gradient[n] = (vec3){gradient.x[l], gradient.y[l], gradient.z[l]};
            out->value[n] = value[l];
            out->inside[n / LAYER] |= (uint32_t)(value[l] < 0) << n % LAYER;
        }
    }
    return true;
}

/* A root by what is known at the ends: a cubic through their values and slopes, as splines are along the axes; elsewhere its
 * error is of fourth order. The gradient between is taken for linear. */
ISA_CLONES static void find_roots(const edge_lanes *e, double last_step, int first, roots *out)
{
    double low[SIDE_BY_SIDE], high[SIDE_BY_SIDE], at_low[SIDE_BY_SIDE], at_high[SIDE_BY_SIDE],
        newton[SIDE_BY_SIDE], kept[SIDE_BY_SIDE], done[SIDE_BY_SIDE], end[SIDE_BY_SIDE], rise[SIDE_BY_SIDE],
        d0[SIDE_BY_SIDE], d1[SIDE_BY_SIDE], across[SIDE_BY_SIDE], nx[SIDE_BY_SIDE], ny[SIDE_BY_SIDE],
        nz[SIDE_BY_SIDE];
    for (int l = 0; l < SIDE_BY_SIDE; l++) {
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
    double left = SIDE_BY_SIDE;
    for (int k = 0; k < CELL_ROOT_STEPS && left > 0; k++) {
        left = SIDE_BY_SIDE;
        const double odd = k & 1;
        for (int l = 0; l < SIDE_BY_SIDE; l++) {
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
        for (int l = 0; l < SIDE_BY_SIDE; l++) left -= done[l];
    }
    for (int l = 0; l < SIDE_BY_SIDE; l++) {
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

/* Where F is not smooth, values and gradients at the ends of an edge do not determine the root: F is evaluated. */
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

/* The root between a node and the one up from it along some axes. */
static void cut_edge(const field *f, const part_nodes *n, int node, int axes, edge_lanes *lanes, roots *out)
{
    const int other = node + STEP(axes) + (axes >> 2) * LAYER, k = out->count++;
    const bool up = n->value[node] < 0;
    const int inside = up ? node : other, outside = up ? other : node;
    out->of[node * AXES + axes] = (uint16_t)k;
    if (f->sharp) {
        find_sharp_root(f, n, inside, outside, k, out);
        return;
    }
    put_edge(n, inside, outside, k % SIDE_BY_SIDE, lanes);
    if (out->count % SIDE_BY_SIDE == 0)
        find_roots(lanes, CELL_LAST_STEP * f->cell_size, out->count - SIDE_BY_SIDE, out);
}

/* The roots on all edges of parts. */
static void cut_edges(const field *f, const part_grid *grid, const part_nodes *n, roots *out)
{
    edge_lanes lanes = {.x = {0}};
    out->count = 0;
    for (int axes = 1; axes < AXES; axes++)
        for (int layer = 0; layer + (axes >> 2) <= grid->parts; layer++) {
            uint32_t cut =
                (n->inside[layer] ^ n->inside[layer + (axes >> 2)] >> STEP(axes)) & grid->have_step[axes & 3];
            for (; cut; cut &= cut - 1) cut_edge(f, n, layer * LAYER + __builtin_ctz(cut), axes, &lanes, out);
        }
    if (!f->sharp && out->count % SIDE_BY_SIDE > 0) /* and some of those before once more */
        find_roots(&lanes, CELL_LAST_STEP * f->cell_size, out->count / SIDE_BY_SIDE * SIDE_BY_SIDE, out);
}

/* An edge of a part that begins at corner a and ends at b, as `of` of roots counts it from the part's first node. */
#define EDGE(a, b) ((STEP(a) + ((a) >> 2) * LAYER) * AXES + ((a) ^ (b)))
#define TETRAHEDRON(a, b, c, d)                                                \
    {                                                                          \
        EDGE(a, b), EDGE(a, c), EDGE(a, d), EDGE(b, c), EDGE(b, d), EDGE(c, d) \
    }
static const uint16_t part_edges[6][6] = {TETRAHEDRON(0, 1, 3, 7), TETRAHEDRON(0, 1, 5, 7),
                                          TETRAHEDRON(0, 2, 3, 7), TETRAHEDRON(0, 2, 6, 7),
                                          TETRAHEDRON(0, 4, 5, 7), TETRAHEDRON(0, 4, 6, 7)};

static void cut_part(const part_nodes *n, const roots *r, int layer, int first, part_triangles *out)
{
    const uint16_t *of = r->of + (layer * LAYER + first) * AXES;
    const uint32_t low = n->inside[layer] >> first, high = n->inside[layer + 1] >> first;
    const unsigned inside = (low & 3) | (low >> NODES & 3) << 2 | (high & 3) << 4 | (high >> NODES & 3) << 6;
    for (int k = 0; k < 6; k++) {
        const uint8_t *passed = cell_rings[cell_inside(inside, k)];
        for (int i = 2; i < passed[0]; i++) {
            uint16_t *c = out->corner[out->count];
            c[0] = of[part_edges[k][passed[1]]];
            c[1] = of[part_edges[k][passed[i]]];
            c[2] = of[part_edges[k][passed[i + 1]]];
            out->part[out->count++] = (uint16_t)(layer * LAYER + first);
        }
    }
}

/* Part after part, of those that the surface passes. */
static void cut_parts(const part_grid *grid, const part_nodes *n, const roots *r, part_triangles *out)
{
    out->count = 0;
    for (int layer = 0; layer < grid->parts; layer++) {
        const uint32_t a = n->inside[layer], b = n->inside[layer + 1];
        uint32_t any = a | b, all = a & b;
        for (int axes = 1; axes < 4; axes++) {
            any |= (a | b) >> STEP(axes);
            all &= (a & b) >> STEP(axes);
        }
        for (uint32_t passed = any & ~all & grid->have_step[3]; passed; passed &= passed - 1)
            cut_part(n, r, layer, __builtin_ctz(passed), out);
    }
}

/* Triangles side by side. */
typedef struct triangle_lanes {
    double x[3][SIDE_BY_SIDE], y[3][SIDE_BY_SIDE], z[3][SIDE_BY_SIDE];
    double nx[3][SIDE_BY_SIDE], ny[3][SIDE_BY_SIDE], nz[3][SIDE_BY_SIDE];
    double smooth[SIDE_BY_SIDE];
} triangle_lanes;

/* As curved_area of surface.c without more triangles; and the excess that it would look at, 0 where it would not. */
ISA_CLONES static void measure_triangles(const triangle_lanes *t, double out[SIDE_BY_SIDE],
                                         double more_than_flat[SIDE_BY_SIDE])
{
    for (int l = 0; l < SIDE_BY_SIDE; l++) {
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
    for (int first = 0; first < t->count; first += SIDE_BY_SIDE) {
        triangle_lanes lanes;
        double area[SIDE_BY_SIDE], excess[SIDE_BY_SIDE];
        for (int l = 0; l < SIDE_BY_SIDE; l++) {
            const uint16_t *at = t->corner[first + l < t->count ? first + l : t->count - 1];
            for (int c = 0; c < 3; c++) {
                lanes.x[c][l] = r->x[at[c]];
                lanes.y[c][l] = r->y[at[c]];
                lanes.z[c][l] = r->z[at[c]];
                lanes.nx[c][l] = r->nx[at[c]];
                lanes.ny[c][l] = r->ny[at[c]];
                lanes.nz[c][l] = r->nz[at[c]];
            }
            lanes.smooth[l] = r->smooth[at[0]] * r->smooth[at[1]] * r->smooth[at[2]];
        }
        measure_triangles(&lanes, area, excess);
        for (int k = first; k < t->count && k < first + SIDE_BY_SIDE; k++) {
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
    for (int first = 0; first < t->count; first += SIDE_BY_SIDE) {
        triangle_lanes lanes;
        double of[SIDE_BY_SIDE], more[SIDE_BY_SIDE];
        for (int l = 0; l < SIDE_BY_SIDE; l++) {
            const corner *at = t->at[first + l < t->count ? first + l : t->count - 1];
            for (int c = 0; c < 3; c++) {
                lanes.x[c][l] = at[c].position.x;
                lanes.y[c][l] = at[c].position.y;
                lanes.z[c][l] = at[c].position.z;
                lanes.nx[c][l] = at[c].normal.x;
                lanes.ny[c][l] = at[c].normal.y;
                lanes.nz[c][l] = at[c].normal.z;
            }
            lanes.smooth[l] = at[0].smooth && at[1].smooth && at[2].smooth ? 1 : 0;
        }
        measure_triangles(&lanes, of, more);
        for (int k = first; k < t->count && k < first + SIDE_BY_SIDE; k++) {
            area[k] = of[k - first];
            excess[k] = more[k - first];
        }
    }
}

static corner corner_of(const roots *r, int k)
{
    return (corner){{r->x[k], r->y[k], r->z[k]}, {r->nx[k], r->ny[k], r->nz[k]}, r->smooth[k] > 0};
}

static double area_by(const field *f, const field_cell *cell, const part_grid *grid, triangulation *lacking)
{
    part_nodes nodes;
    roots r;
    part_triangles t;
    if (!sample_parts(f, cell, grid->parts, &nodes)) return 0;
    cut_edges(f, grid, &nodes, &r);
    cut_parts(grid, &nodes, &r, &t);
    for (int k = 0; lacking && k < t.count && lacking->count < FIELD_CELL_TRIANGLES; k++, lacking->count++)
        for (int c = 0; c < 3; c++) lacking->at[lacking->count][c] = corner_of(&r, t.corner[k][c]);
    return sum_areas(&t, &r);
}

double cell_parts_area(const field *f, const field_cell *cell, triangulation *lacking)
{
    return area_by(f, cell, &whole_grid, lacking);
}

double cell_half_parts_area(const field *f, const field_cell *cell)
{
    return area_by(f, cell, &half_grid, NULL);
}
