// SPDX-License-Identifier: Apache-2.0
#include "sampling/weights/quadrature.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/isa.h"
#include "base/core/memory.h"
#include "sampling/weights/elimination.h"
#include "sampling/weights/triangle_moments.h"

enum {
    NODES = QUADRATURE_NODES,
    TERMS = (QUADRATURE_DEGREE + 1) * (QUADRATURE_DEGREE + 2) / 2,
    LAST_TERMS = QUADRATURE_DEGREE + 1, /* polynomials of the highest degree */
    SIZE = NODES + TERMS,
    /* Right sides of a system: the integrals; the area on the surface of a unit weight of each node; 1 for each of the
     * last terms. */
    OF_INTEGRALS = SIZE,
    OF_AREAS,
    OF_LAST_TERMS,
    COLUMNS = OF_LAST_TERMS + LAST_TERMS,
    STRIDE = (COLUMNS + 7) / 8 * 8,
    /* Points around a triangle, ring by ring, from which the nearest ones are chosen. Six rings of a hexagonal
     * lattice have 147 points, the nearest 80 lie within four to five. */
    RINGS_LEAST = NODES * 3 / 2,
    RINGS_MOST = 512,
    TABLE_BITS = 11,
    /* Triangles whose weights are in memory at a time: 2 MB. */
    BLOCK = 2048
};

/* Minimum cosine between a ray of the projection and the normals of the triangle and of the surface at a node.
 * Smaller: nodes that the projection moves far away. */
static const double LEAST_COSINE = 0.1;

static const char what[] = "the quadrature weights";

/* A side of a triangle, stored at its first corner. */
typedef struct fan_side {
    uint32_t to, triangle;
} fan_side;

/* The projection of a triangle: from a point x, relative to corner A, along `axis` - bend x. */
typedef struct projection {
    vec3 a, normal, u, v; /* corner A, unit normal and frame of the triangle */
    vec3 middle;          /* of the triangle, relative to A */
    vec3 axis;            /* its component along the normal is 1 */
    double bend; /* 1 over the height of the centre of projection above the plane; 0: it is at infinity */
} projection;

typedef struct candidate {
    double distance2;
    double x, y, stretch;
    uint32_t node;
} candidate;

/* Memory of a worker. */
typedef struct workspace {
    double matrix[SIZE * STRIDE];
    double x[NODES], y[NODES], stretch[NODES];
    uint32_t table[1 << TABLE_BITS]; /* the points in `near`, hashed: index + 1 */
    uint32_t near[RINGS_MOST];
    candidate candidate[RINGS_MOST];
} workspace;

typedef struct job {
    const quadrature_input *in;
    const size_t *first; /* per point: its entries of `fan`; count + 1 values */
    const fan_side *fan;
    workspace *space; /* per worker */
    size_t begin;     /* first triangle of the block */
    uint32_t (*node)[NODES];
    double (*weight)[NODES];
    double *lower; /* per triangle of the block: its part of lower_area */
    quadrature_end *end;
} job;

/* ---- the triangles around a point */

static bool make_fans(const quadrature_input *in, size_t **first, fan_side **fan, error *e)
{
    *first = mem_array(in->count + 2, sizeof **first, what, e);
    *fan = *first ? mem_array(3 * in->triangle_count, sizeof **fan, what, e) : NULL;
    if (!*fan) return false;
    size_t *next = *first + 1;
    for (size_t k = 0; k < 3 * in->triangle_count; k++) (*first)[in->triangle[k / 3][k % 3] + 2]++;
    for (size_t i = 0; i < in->count; i++) (*first)[i + 2] += (*first)[i + 1];
    for (size_t k = 0; k < 3 * in->triangle_count; k++)
        (*fan)[next[in->triangle[k / 3][k % 3]]++] =
            (fan_side){in->triangle[k / 3][(k + 1) % 3], (uint32_t)(k / 3)};
    return true;
}

/* Adds a point to `near`, if it is not there and there is room. Returns the new number of points. */
static size_t visit(workspace *w, uint32_t point, size_t count)
{
    const uint32_t mask = (1u << TABLE_BITS) - 1;
    uint32_t at = (point * 2654435769u) >> (32 - TABLE_BITS);
    for (; w->table[at] != 0; at = (at + 1) & mask)
        if (w->table[at] == point + 1) return count;
    if (count == RINGS_MOST) return count;
    w->table[at] = point + 1;
    w->near[count] = point;
    return count + 1;
}

/* Lists the points of the rings around a triangle. Returns their number. */
static size_t find_near(const job *j, const uint32_t corner[3], workspace *w)
{
    size_t count = 0, begin = 0;
    memset(w->table, 0, sizeof w->table);
    for (int k = 0; k < 3; k++) count = visit(w, corner[k], count);
    for (size_t end = count; begin < end && end < RINGS_LEAST; begin = end, end = count)
        for (size_t i = begin; i < end; i++)
            for (size_t k = j->first[w->near[i]]; k < j->first[w->near[i] + 1]; k++)
                count = visit(w, j->fan[k].to, count);
    return count;
}

/* ---- the projection */

/* The normal of the cutting plane of the side from point `from` to point `to` of a triangle with unit normal
 * `own`. */
static vec3 cutting_normal(const job *j, vec3 own, uint32_t from, uint32_t to)
{
    vec3 mean = own;
    for (size_t k = j->first[to]; k < j->first[to + 1]; k++)
        if (j->fan[k].to == from) {
            const uint32_t *c = j->in->triangle[j->fan[k].triangle];
            const vec3 *x = j->in->position;
            mean = vec3_add(own, vec3_unit(vec3_across(x[c[0]], x[c[1]], x[c[2]])));
            break;
        }
    return vec3_cross(mean, vec3_sub(j->in->position[to], j->in->position[from]));
}

static void make_projection(const job *j, size_t triangle, projection *out)
{
    const uint32_t *c = j->in->triangle[triangle];
    const vec3 *p = j->in->position, ab = vec3_sub(p[c[1]], p[c[0]]), ac = vec3_sub(p[c[2]], p[c[0]]);
    out->a = p[c[0]];
    out->normal = vec3_unit(vec3_cross(ab, ac));
    out->u = vec3_unit(ab);
    out->v = vec3_cross(out->normal, out->u);
    out->middle = vec3_scale(vec3_add(ab, ac), 1.0 / 3);
    const vec3 of_ab = cutting_normal(j, out->normal, c[0], c[1]),
               of_bc = cutting_normal(j, out->normal, c[1], c[2]),
               of_ca = cutting_normal(j, out->normal, c[2], c[0]), line = vec3_cross(of_ab, of_ca);
    /* The centre is A + line (of_bc . ab) / (of_bc . line). */
    const double height = vec3_dot(out->normal, line);
    out->axis = vec3_scale(line, 1 / height);
    out->bend = vec3_dot(of_bc, line) / (vec3_dot(of_bc, ab) * height);
}

/* Projects a point to the plane. False: its ray is nearly tangential to the plane or to the surface. */
static bool project(const projection *p, vec3 position, vec3 normal, candidate *out)
{
    const vec3 x = vec3_sub(position, p->a), ray = vec3_axpy(-p->bend, x, p->axis),
               from_middle = vec3_sub(position, vec3_add(p->a, p->middle));
    const double height = vec3_dot(p->normal, x), depth = vec3_dot(p->normal, ray),
                 across = vec3_dot(normal, ray), least = LEAST_COSINE * vec3_norm(ray);
    if (!(depth > least && across > least)) return false;
    const vec3 in_plane = vec3_sub(vec3_axpy(-height / depth, ray, x), p->middle);
    out->distance2 = vec3_norm2(from_middle);
    out->x = vec3_dot(in_plane, p->u);
    out->y = vec3_dot(in_plane, p->v);
    out->stretch = depth * depth * depth / across;
    return true;
}

static int compare_candidates(const void *a, const void *b)
{
    const candidate *x = a, *y = b;
    if (x->distance2 != y->distance2) return x->distance2 < y->distance2 ? -1 : 1;
    return x->node < y->node ? -1 : x->node > y->node;
}

/* Chooses the nodes of a triangle, projects them, and scales the plane, so that they lie in the unit disc. False:
 * there are too few. */
static bool choose_nodes(const job *j, const projection *p, const uint32_t corner[3], workspace *w,
                         uint32_t *node, double *scale)
{
    const size_t near = find_near(j, corner, w);
    size_t count = 0;
    for (size_t k = 0; k < near; k++) {
        candidate *c = &w->candidate[count];
        c->node = w->near[k];
        count += project(p, j->in->position[c->node], j->in->normal[c->node], c);
    }
    if (count < NODES) return false;
    qsort(w->candidate, count, sizeof *w->candidate, compare_candidates);
    double most = 0;
    for (int i = 0; i < NODES; i++) {
        const candidate *c = &w->candidate[i];
        most = fmax(most, c->x * c->x + c->y * c->y);
    }
    *scale = sqrt(most);
    for (int i = 0; i < NODES; i++) {
        const candidate *c = &w->candidate[i];
        node[i] = c->node;
        w->x[i] = c->x / *scale;
        w->y[i] = c->y / *scale;
        w->stretch[i] = c->stretch;
    }
    return true;
}

/* ---- the weights of a triangle */

/* The 7th powers of the distances between the nodes. */
ISA_CLONES static void fill_distances(const double *restrict x, const double *restrict y,
                                      double *restrict matrix)
{
    for (int i = 0; i < NODES; i++)
        for (int k = 0; k < NODES; k++) {
            const double dx = x[k] - x[i], dy = y[k] - y[i], d2 = dx * dx + dy * dy;
            matrix[i * STRIDE + k] = d2 * d2 * d2 * sqrt(d2);
        }
}

/* The monomials at the nodes, in both borders of the matrix, and zeros in its corner. */
static void fill_terms(workspace *w)
{
    for (int i = 0; i < NODES; i++) {
        double *row = w->matrix + i * STRIDE + NODES;
        row[0] = 1;
        for (int d = 1, k = 1; d <= QUADRATURE_DEGREE; k += ++d) {
            for (int n = 0; n < d; n++) row[k + n] = row[k - d + n] * w->x[i];
            row[k + d] = row[k - 1] * w->y[i];
        }
        for (int k = 0; k < TERMS; k++) w->matrix[(NODES + k) * STRIDE + i] = row[k];
    }
    for (int k = 0; k < TERMS; k++)
        memset(w->matrix + (NODES + k) * STRIDE + NODES, 0, TERMS * sizeof(double));
}

static void fill_sides(const double corner[3][2], workspace *w)
{
    double moment[TERMS];
    triangle_moments_monomials(corner, QUADRATURE_DEGREE, moment);
    for (int i = 0; i < SIZE; i++) {
        double *row = w->matrix + i * STRIDE;
        const int last = i - (SIZE - LAST_TERMS);
        row[OF_INTEGRALS] =
            i < NODES ? triangle_moments_distance7(corner, w->x[i], w->y[i]) : moment[i - NODES];
        row[OF_AREAS] = i < NODES ? w->stretch[i] : 0;
        for (int k = 0; k < LAST_TERMS; k++) row[OF_LAST_TERMS + k] = k == last;
    }
}

/* What the area of the triangle on the surface loses without the last terms; NAN: unknown. With the system K, its right
 * side b and the areas a, the weights give a' K^-1 b. The unit right sides E are added to b such that the multipliers of
 * the last terms, E' K^-1 b, become 0. K is symmetric: a' K^-1 E are the last unknowns for the right side a. */
static double area_of_last_terms(const workspace *w, const double *solution)
{
    enum { FIRST = SIZE - LAST_TERMS, SYSTEM = LAST_TERMS + 1 };
    double block[LAST_TERMS * SYSTEM], x[SIZE], c[LAST_TERMS], sum = 0;
    for (int k = 0; k < LAST_TERMS; k++) {
        elimination_solve(w->matrix, SIZE, STRIDE, OF_LAST_TERMS + k, FIRST, x);
        for (int i = 0; i < LAST_TERMS; i++) block[i * SYSTEM + k] = x[FIRST + i];
        block[k * SYSTEM + LAST_TERMS] = solution[FIRST + k];
    }
    if (!elimination_reduce(block, LAST_TERMS, SYSTEM, SYSTEM)) return NAN;
    elimination_solve(block, LAST_TERMS, SYSTEM, LAST_TERMS, 0, c);
    elimination_solve(w->matrix, SIZE, STRIDE, OF_AREAS, FIRST, x);
    for (int k = 0; k < LAST_TERMS; k++) sum += c[k] * x[FIRST + k];
    return sum;
}

static quadrature_end weigh_triangle(const job *j, size_t triangle, workspace *w, uint32_t *node,
                                     double *weight, double *lower)
{
    const uint32_t *c = j->in->triangle[triangle];
    projection p;
    double scale, corner[3][2], solution[SIZE], sum = 0;
    make_projection(j, triangle, &p);
    if (!choose_nodes(j, &p, c, w, node, &scale)) return QUADRATURE_FEW_NODES;
    for (int k = 0; k < 3; k++) {
        const vec3 x = vec3_sub(vec3_sub(j->in->position[c[k]], p.a), p.middle);
        corner[k][0] = vec3_dot(x, p.u) / scale;
        corner[k][1] = vec3_dot(x, p.v) / scale;
    }
    fill_distances(w->x, w->y, w->matrix);
    fill_terms(w);
    fill_sides((const double(*)[2])corner, w);
    if (!elimination_reduce(w->matrix, SIZE, COLUMNS, STRIDE)) return QUADRATURE_SINGULAR;
    elimination_solve(w->matrix, SIZE, STRIDE, OF_INTEGRALS, 0, solution);
    for (int i = 0; i < NODES; i++) {
        weight[i] = solution[i] * w->stretch[i] * (scale * scale);
        sum += weight[i];
    }
    *lower = sum - area_of_last_terms(w, solution) * (scale * scale);
    return isfinite(sum) && isfinite(*lower) ? QUADRATURE_COMPLETE : QUADRATURE_SINGULAR;
}

static void weigh_chunk(void *context, int worker, size_t begin, size_t end)
{
    const job *j = context;
    for (size_t k = begin; k < end; k++)
        j->end[k] =
            weigh_triangle(j, j->begin + k, &j->space[worker], j->node[k], j->weight[k], &j->lower[k]);
}

/* ---- all triangles */

/* Adds the weights of a block in the order of its triangles. */
static quadrature_end add_block(const job *j, size_t count, double *weight, double *lower_area)
{
    for (size_t k = 0; k < count; k++) {
        if (j->end[k] != QUADRATURE_COMPLETE) return j->end[k];
        for (int i = 0; i < NODES; i++) weight[j->node[k][i]] += j->weight[k][i];
        *lower_area += j->lower[k];
    }
    return QUADRATURE_COMPLETE;
}

bool quadrature_make(const quadrature_input *in, threads *pool, double *weight, double *lower_area,
                     quadrature_end *end, error *e)
{
    size_t *first = NULL;
    fan_side *fan = NULL;
    job j = {.in = in};
    bool ok = make_fans(in, &first, &fan, e);
    j.first = first;
    j.fan = fan;
    ok = ok && (j.space = mem_array((size_t)threads_count(pool), sizeof *j.space, what, e)) &&
         (j.node = mem_array(BLOCK, sizeof *j.node, what, e)) &&
         (j.weight = mem_array(BLOCK, sizeof *j.weight, what, e)) &&
         (j.lower = mem_array(BLOCK, sizeof *j.lower, what, e)) &&
         (j.end = mem_array(BLOCK, sizeof *j.end, what, e));
    for (size_t i = 0; ok && i < in->count; i++) weight[i] = 0;
    *lower_area = 0;
    *end = QUADRATURE_COMPLETE;
    for (; ok && *end == QUADRATURE_COMPLETE && j.begin < in->triangle_count; j.begin += BLOCK) {
        const size_t left = in->triangle_count - j.begin, count = left < BLOCK ? left : BLOCK;
        threads_run(pool, count, 8, weigh_chunk, &j);
        ok = threads_may_go_on(pool, e);
        if (ok) *end = add_block(&j, count, weight, lower_area);
    }
    free(first);
    free(fan);
    free(j.space);
    free(j.node);
    free(j.weight);
    free(j.lower);
    free(j.end);
    return ok;
}
