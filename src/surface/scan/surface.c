// SPDX-License-Identifier: Apache-2.0
#include "surface/scan/surface.h"

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/field/flat_cell.h"
#include "surface/field/projection.h"
#include "surface/scan/bent_areas.h"
#include "surface/scan/cell_euler.h"
#include "surface/scan/cell_parts.h"

/* Cells in a chunk of work: whole groups. */
static const size_t GRAIN = THREADS_GRAIN;
/* Chunks after which a field may free its caches: the coefficient blocks of AT_ONCE chunks take a few
 * megabytes. */
static const size_t AT_ONCE = 128;

/* Tolerance for the projection of corners, in cell sizes: the square of it is far below the error of the
 * area. */
static const double CORNER_TOLERANCE = 1e-4;
/* The relative error of the second-order correction is about the square of the excess. Triangles with a
 * larger excess are divided into four. */
static const double EXCESS_FINE = 5e-3;
/* Maximum depth of this division. It is sufficient for bumps of the size of a cell; at this depth the
 * correction of a sliver is limited, too. */
static const int EXCESS_DEPTH = 2;
/* If the projected midpoint of a side is farther from the side than this fraction of its length, it belongs
 * to the opposite wall, or the surface is too rough: the side then stays straight. An arc of a right angle
 * rises by 0.21. */
static const double RISE_LIMIT = 0.25;
/* Tolerance for roots, in cell sizes. */
static const double ROOT_TOLERANCE = 1e-6;
/* If the cosine between two normals in a cell is smaller, the surface bends within the cell, and triangles
 * of the size of the cell are not accurate: the cell is measured by parts (cell_parts.h). With 0.8 the area
 * of smoke is 3e-3 too small, with 0.9 2e-3. With all cells in parts the area of fogs is accurate to 2e-4. */
static const double BENT_FACING = 0.9;
/* A cell is also measured by parts if its size exceeds this fraction of the radius of curvature, which is
 * estimated from the normals of its triangles: the surface crosses tetrahedra whose corners have one sign.
 * The area of balls with a radius of 2.4 voxels is then accurate to 5e-4; without this, it is 2e-2 too
 * small. Corners closer to each other than TOO_NEAR, in cell sizes, are not used. */
static const double BENT_SIZE = 0.3, TOO_NEAR = 0.1;
/* If at least MANY_BENT cells of AT_ONCE chunks (half of the cells) are bent, the bent cells are sampled
 * (bent_areas.h). The same applies to the last, incomplete group of chunks. */
enum { MANY_BENT = 16384 };
/* A triangle that a face of the domain may cut is divided until its sides are at most this fraction of a
 * cell and of the shortest side of the domain, or to the maximum depth. The area between a boundary and its
 * chords decreases with the square of the length. */
static const double CLIP_CELL = 1.0 / 8, CLIP_SIDE = 1.0 / 16;
static const int CLIP_DEPTH = 8;
/* Maximum distance by which the surface above a triangle extends beyond its corners, as a fraction of its
 * longest side. */
static const double CLIP_BULGE = 0.1;
/* Maximum Newton steps for a corner of a clipped triangle, which is close to the surface. */
static const int SLIDE_STEPS = 4;
/* maximum corners of a triangle that is clipped at six planes */
#define CLIP_CORNERS 9
/* Areas below this fraction of a cell's face count as 0. */
static const double TINY = 1e-9;
/* Triangles with less than this fraction of the area of a cell are not used to draw points. */
static const double LITTLE = 0.1;
/* Distance, in cells, from a face of the domain within which corners of triangles count as beyond it. It exceeds the
 * rounding errors of corners in that face. */
static const double BEYOND_END = 1e-6;
/* Steps of surface_bisect, to a millionth of the distance. */
enum { BISECT_STEPS = 20 };
/* Maximum draws for a point of a triangle inside the domain; after that a point outside is accepted. */
static const int INSIDE_DRAWS = 200;

/* Sets a corner to the projection of x onto the surface if this is within `reach`, otherwise to x. */
static void place_corner(const field *f, vec3 x, double reach, corner *c)
{
    const projection_limits limits = {3, CORNER_TOLERANCE * f->cell_size,
                                      10 * CORNER_TOLERANCE * f->cell_size, 0.05 * f->cell_size};
    *c = (corner){.position = x};
    vec3 p = x;
    if (projection_find(f, &limits, &p, &c->normal) && vec3_norm2(vec3_sub(p, x)) < reach * reach) {
        c->position = p;
        c->smooth = true;
    }
}

/* The relative excess of a geodesic triangle over the flat triangle, to second order in edge length over
 * radius of curvature. An edge of length l along which the normal turns by the angle a has the length l (1 +
 * a^2 / 24) on the surface. The area changes by cot(opposite angle) / 4 per change of the squared length.
 * Gaussian curvature K adds the fraction K (sum of squared sides) / 24. */
static double curvature_excess(const corner *t, vec3 twice_area)
{
    double area = 0.5 * vec3_norm(twice_area), sum = 0, squares = 0;
    for (int k = 0; k < 3; k++) {
        const corner *o = &t[k], *p = &t[(k + 1) % 3], *q = &t[(k + 2) % 3];
        vec3 e = vec3_sub(q->position, p->position);
        double l2 = vec3_norm2(e), turn = vec3_dot(e, vec3_sub(q->normal, p->normal));
        double cot =
            vec3_dot(vec3_sub(p->position, o->position), vec3_sub(q->position, o->position)) / (2 * area);
        squares += l2;
        if (l2 > 0) sum += cot / 4 * (turn * turn / l2) * l2 / 12;
    }
    vec3 turns = vec3_cross(vec3_sub(t[1].normal, t[0].normal), vec3_sub(t[2].normal, t[0].normal));
    double gauss = vec3_dot(turns, twice_area) / vec3_norm2(twice_area);
    return sum / area + gauss * squares / 24;
}

/* Area of the surface above a triangle. If the curvature is large, the triangle is divided into four. */
static double curved_area(const field *f, const corner *t, int depth)
{
    vec3 twice_area =
        vec3_cross(vec3_sub(t[1].position, t[0].position), vec3_sub(t[2].position, t[0].position));
    double area = 0.5 * vec3_norm(twice_area);
    if (!(area > 0) || !t[0].smooth || !t[1].smooth || !t[2].smooth) return area;
    double excess = curvature_excess(t, twice_area);
    if (fabs(excess) < EXCESS_FINE) return area * (1 + excess);
    if (depth == EXCESS_DEPTH) return area * (1 + fmin(fmax(excess, -CELL_EXCESS_LIMIT), CELL_EXCESS_LIMIT));
    corner middle[3]; /* middle[k]: of the side opposite to corner k */
    for (int k = 0; k < 3; k++) {
        vec3 p = t[(k + 1) % 3].position, q = t[(k + 2) % 3].position;
        place_corner(f, vec3_scale(vec3_add(p, q), 0.5), RISE_LIMIT * vec3_norm(vec3_sub(q, p)), &middle[k]);
    }
    double sum = curved_area(f, middle, depth + 1);
    for (int k = 0; k < 3; k++)
        sum += curved_area(f, (corner[3]){t[k], middle[(k + 1) % 3], middle[(k + 2) % 3]}, depth + 1);
    return sum;
}

/* ---- open surfaces: clips triangles at the faces of the domain */

typedef struct clip_corner {
    corner corner;
    unsigned faces; /* bit 2 axis + high: the corner lies in this face of the domain */
} clip_corner;

bool surface_slide(const field *f, unsigned fixed, double reach, vec3 *x, vec3 *normal)
{
    vec3 p = *x;
    for (int k = 0; k <= SLIDE_STEPS; k++) {
        field_sample s;
        if (!field_sample_at(f, p, FIELD_GRADIENT, &s)) return false;
        double length = vec3_norm(s.gradient);
        if (length > 0 && fabs(s.value) <= ROOT_TOLERANCE * f->cell_size * length) {
            *x = p;
            *normal = vec3_scale(s.gradient, 1 / length);
            return true;
        }
        for (int axis = 0; axis < 3; axis++)
            if (fixed >> axis & 1) vec3_set(&s.gradient, axis, 0);
        double g2 = vec3_norm2(s.gradient);
        if (!(g2 > 0)) return false;
        p = vec3_axpy(-s.value / g2, s.gradient, p);
        if (vec3_norm2(vec3_sub(p, *x)) > reach * reach) return false;
    }
    return false;
}

/* The point of the segment between two corners that lies in a face. */
static clip_corner cut_side(const field *f, const clip_corner *p, const clip_corner *q, int face)
{
    int axis = face >> 1;
    double plane = vec3_get(face & 1 ? f->domain.max : f->domain.min, axis);
    double from = vec3_get(p->corner.position, axis), to = vec3_get(q->corner.position, axis);
    vec3 side = vec3_sub(q->corner.position, p->corner.position);
    clip_corner c = {.faces = (p->faces & q->faces) | 1u << face};
    c.corner.position = vec3_axpy((plane - from) / (to - from), side, p->corner.position);
    unsigned fixed = 0;
    for (int k = 0; k < BBOX_FACES; k++)
        if (c.faces >> k & 1) fixed |= 1u << (k >> 1);
    vec3_set(&c.corner.position, axis, plane);
    c.corner.smooth =
        surface_slide(f, fixed, RISE_LIMIT * vec3_norm(side), &c.corner.position, &c.corner.normal);
    return c;
}

/* Clips a polygon at one face (Sutherland and Hodgman 1974, "Reentrant Polygon Clipping"). Returns the
 * number of corners left. */
static int clip_at_face(const field *f, int face, const clip_corner *in, int count, clip_corner *out)
{
    int axis = face >> 1, left = 0;
    double sign = face & 1 ? -1 : 1, plane = vec3_get(face & 1 ? f->domain.max : f->domain.min, axis);
    for (int k = 0; k < count; k++) {
        const clip_corner *p = &in[k], *q = &in[(k + 1) % count];
        bool p_inside = sign * (vec3_get(p->corner.position, axis) - plane) >= 0;
        bool q_inside = sign * (vec3_get(q->corner.position, axis) - plane) >= 0;
        if (p_inside) out[left++] = *p;
        if (p_inside != q_inside) out[left++] = cut_side(f, p, q, face);
    }
    return left;
}

/* Area above a triangle that is small enough to clip along straight lines. */
static double clip_small(const field *f, const corner *t, bbox *box)
{
    clip_corner polygon[2][CLIP_CORNERS + 1];
    int count = 3, at = 0;
    for (int k = 0; k < 3; k++) polygon[0][k] = (clip_corner){t[k], 0};
    for (int face = 0; face < BBOX_FACES && count > 0; face++, at = !at)
        count = clip_at_face(f, face, polygon[at], count, polygon[!at]);
    const clip_corner *c = polygon[at];
    double sum = 0;
    for (int k = 0; k < count; k++) *box = bbox_include(*box, c[k].corner.position);
    for (int k = 1; k + 1 < count; k++)
        sum += curved_area(f, (corner[3]){c[0].corner, c[k].corner, c[k + 1].corner}, EXCESS_DEPTH);
    return sum;
}

static double clipped_area(const field *f, const corner *t, int depth, bbox *box)
{
    bbox mine = bbox_empty();
    double longest = 0;
    for (int k = 0; k < 3; k++) {
        mine = bbox_include(mine, t[k].position);
        longest = fmax(longest, vec3_norm(vec3_sub(t[k].position, t[(k + 1) % 3].position)));
    }
    bbox reach = bbox_grow(mine, CLIP_BULGE * longest);
    if (!bbox_overlap(reach, f->domain)) return 0;
    if (bbox_contains(f->domain, reach.min) && bbox_contains(f->domain, reach.max)) {
        *box = bbox_unite(*box, mine);
        return curved_area(f, t, 0);
    }
    vec3 size = bbox_size(f->domain);
    double fine = fmin(CLIP_CELL * f->cell_size, CLIP_SIDE * fmin(size.x, fmin(size.y, size.z)));
    if (longest <= fine || depth == CLIP_DEPTH) return clip_small(f, t, box);
    corner middle[3]; /* middle[k]: of the side opposite to corner k */
    for (int k = 0; k < 3; k++) {
        vec3 p = t[(k + 1) % 3].position, q = t[(k + 2) % 3].position;
        middle[k] = (corner){.position = vec3_scale(vec3_add(p, q), 0.5)};
        middle[k].smooth = surface_slide(f, 0, RISE_LIMIT * vec3_norm(vec3_sub(q, p)), &middle[k].position,
                                         &middle[k].normal);
    }
    double sum = clipped_area(f, middle, depth + 1, box);
    for (int k = 0; k < 3; k++)
        sum += clipped_area(f, (corner[3]){t[k], middle[(k + 1) % 3], middle[(k + 2) % 3]}, depth + 1, box);
    return sum;
}

/* Whether no face of the domain cuts the cell. */
static bool is_whole(const field *f, const field_cell *cell)
{
    for (int k = 0; f->open && k < FIELD_CELL_CORNERS; k++)
        if (!bbox_contains(f->domain, cell->corner[k])) return false;
    return true;
}

/* The roots of a cell: [corner inside][corner outside]. */
typedef const corner *root_table[8][8];

/* Makes the triangles of a cell from its roots, without areas. */
static void join_roots(const field_cell *cell, root_table root, triangulation *out)
{
    unsigned inside = 0;
    crossed_edge at[FIELD_CELL_TRIANGLES][3];
    for (int k = 0; k < FIELD_CELL_CORNERS; k++) inside |= (unsigned)(cell->value[k] < 0) << k;
    out->count = cell_cut(inside, at);
    for (int i = 0; i < out->count; i++)
        for (int c = 0; c < 3; c++) out->at[i][c] = *root[at[i][c].inside][at[i][c].outside];
}

/* Computes roots and triangles of a single cell; see cell_find_root. */
static void cut_cell(const field *f, const field_cell *cell, bool is_straight, triangulation *out)
{
    crossed_edge edge[CELL_EDGES];
    corner at[CELL_EDGES];
    root_table root;
    const int count = cell_crossed_edges(cell, edge);
    for (int k = 0; k < count; k++) {
        cell_find_root(f, cell, edge[k].inside, edge[k].outside, is_straight, &at[k]);
        root[edge[k].inside][edge[k].outside] = &at[k];
    }
    join_roots(cell, root, out);
}

/* The index in the field of the k-th cell of the surface. */
static size_t number_of(const surface *s, size_t k)
{
    return s->parts.order ? s->parts.order[k] : k;
}

void surface_cell(const surface *s, size_t k, field_cell *out)
{
    s->field->ops->cell(s->field, number_of(s, k), out);
}

vec3 surface_cell_middle(const surface *s, size_t k, double *radius)
{
    if (s->field->ops->cell_middle) return s->field->ops->cell_middle(s->field, number_of(s, k), radius);
    field_cell cell;
    vec3 sum = {0, 0, 0};
    double most2 = 0;
    surface_cell(s, k, &cell);
    for (int c = 0; c < FIELD_CELL_CORNERS; c++) sum = vec3_add(sum, cell.corner[c]);
    const vec3 middle = vec3_scale(sum, 0.125);
    for (int c = 0; c < FIELD_CELL_CORNERS; c++)
        most2 = fmax(most2, vec3_norm2(vec3_sub(cell.corner[c], middle)));
    *radius = sqrt(most2);
    return middle;
}

bool surface_cell_group(const surface *s, size_t k, size_t *end, vec3 *middle, double *radius)
{
    return s->field->ops->cell_group && !s->parts.begin &&
           s->field->ops->cell_group(s->field, k, end, middle, radius);
}

uint32_t surface_cell_patch(const surface *s, size_t k, vec3 x)
{
    return s->field->patches ? s->field->ops->patch_at(s->field, number_of(s, k), x) : 0;
}

/* Takes the triangles of a field whose cells consist of triangles (cell_triangles). False: its cells do
 * not. */
static bool take_triangles(const surface *s, size_t k, triangulation *out)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    if (!s->field->ops->cell_triangles) return false;
    out->count = s->field->ops->cell_triangles(s->field, number_of(s, k), t);
    for (int i = 0; i < out->count; i++) {
        for (int c = 0; c < 3; c++) out->at[i][c] = (corner){.position = t[i][c]};
        out->area[i] = 0.5 * vec3_norm(vec3_cross(vec3_sub(t[i][1], t[i][0]), vec3_sub(t[i][2], t[i][0])));
    }
    return true;
}

/* Returns the area of the triangles, and extends the box by them. */
static double sum_triangles(const triangulation *t, bbox *box)
{
    double area = 0;
    for (int i = 0; i < t->count; i++) {
        area += t->area[i];
        for (int k = 0; k < 3; k++) *box = bbox_include(*box, t->at[i][k].position);
    }
    return area;
}

static bool is_bent(const triangulation *t, double cell_size)
{
    if (t->count == 0) return true; /* only an edge crosses the cell, between its corners */
    for (int i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++) {
            const corner *a = &t->at[0][0], *b = &t->at[i][k];
            const double share = vec3_norm(vec3_sub(b->position, a->position)) / cell_size;
            const double apart = share > TOO_NEAR ? share : TOO_NEAR;
            if (vec3_dot(b->normal, a->normal) < BENT_FACING) return true;
            if (vec3_norm(vec3_sub(b->normal, a->normal)) > BENT_SIZE * apart) return true;
        }
    return false;
}

/* Measures a cell by its parts. A cell without triangles gets some of the parts' triangles in `t`. At a
 * sharp edge, the area that triangles cut off is proportional to their size in the mean of all cells along
 * it. The parts therefore lack a third of what they gain over the whole cell, which is added. 0: the parts
 * have no area. */
static double measure_parts(const field *f, const field_cell *cell, triangulation *t)
{
    double rough = 0;
    const bool is_lacking = t->count == 0;
    for (int i = 0; f->sharp && i < t->count; i++) rough += curved_area(f, t->at[i], 0);
    const double fine = cell_parts_area(f, cell, is_lacking ? t : NULL);
    return t->count == 0 ? 0 : fmax(f->sharp ? fine + (fine - rough) / (CELL_PARTS - 1) : fine, 0);
}

static double triangles_area(const field *f, const triangulation *t)
{
    double piece[FIELD_CELL_TRIANGLES], excess[FIELD_CELL_TRIANGLES], area = 0;
    cell_measure_triangles(t, piece, excess);
    for (int i = 0; i < t->count; i++)
        area += fabs(excess[i]) < EXCESS_FINE ? piece[i] : curved_area(f, t->at[i], 0);
    return area;
}

/* The area of the triangles without subdivision, limited to be positive. */
static double rough_area(const triangulation *t, double cell_size)
{
    double piece[FIELD_CELL_TRIANGLES], excess[FIELD_CELL_TRIANGLES], area = TINY * cell_size * cell_size;
    cell_measure_triangles(t, piece, excess);
    for (int i = 0; i < t->count; i++) area += piece[i];
    return area;
}

/* A cell whose area is computed from its triangles, with its roots. */
typedef struct cell_at_hand {
    size_t number;
    field_cell cell;
    root_table root;
} cell_at_hand;

typedef struct cell_group {
    int count;
    size_t smooth_count;
    cell_at_hand cells[ROOT_GROUP_CELLS];
    root_group *roots;
    field_cell smooth[ROOT_GROUP_CELLS]; /* cells in which F is nearly linear */
    size_t number[ROOT_GROUP_CELLS];     /* index of each of these cells */
} cell_group;

/* The surface in each cell by the signs of F. */
typedef struct cell_signs {
    int8_t table[256]; /* see cell_euler.h */
    bbox within;       /* the part of the boundary box whose corners of triangles count */
    int8_t *euler;     /* of each cell, or BETWEEN_CORNERS; NULL: cells consist of triangles */
} cell_signs;

/* Corners of cells that were found by following the surface are values of the spline, with this relative error: a sample
 * of 0 must not be negative there. */
static const double VALUE_ERROR = 1e-6;
/* Value of a cell whose corners have one sign. */
enum { BETWEEN_CORNERS = INT8_MIN };

static bool prepare_signs(const field *f, size_t cells, cell_signs *out, error *e)
{
    cell_euler_fill(out->table);
    out->within = bbox_grow(f->boundary_box, -BEYOND_END * f->cell_size);
    out->euler = NULL;
    if (f->ops->cell_triangles) return true;
    out->euler = mem_array(cells, sizeof *out->euler, "the scan of the surface", e);
    return out->euler != NULL;
}

static int8_t euler_of_cell(const field *f, const cell_signs *signs, const field_cell *cell)
{
    bool whole = true;
    unsigned inside = 0;
    double least = 0;
    for (int c = 0; cell->hidden_crossing && c < FIELD_CELL_CORNERS; c++)
        least = fmax(least, VALUE_ERROR * fabs(cell->value[c]));
    for (int c = 0; c < FIELD_CELL_CORNERS; c++) {
        inside |= (unsigned)(cell->value[c] < -least) << c;
        whole &= !f->open || bbox_contains(signs->within, cell->corner[c]);
    }
    if (inside == 0 || inside == UINT8_MAX) return BETWEEN_CORNERS;
    return whole ? signs->table[inside] : (int8_t)cell_euler_cut(cell, signs->within);
}

/* Sums up the Euler characteristic of each part of the surface. */
static bool sum_euler(surface *s, const cell_signs *signs, error *e)
{
    const size_t whole[] = {0, s->cells}, *begin = s->parts.begin ? s->parts.begin : whole;
    s->euler = mem_array(s->parts.count, sizeof *s->euler, "the scan of the surface", e);
    for (size_t p = 0; s->euler && p < s->parts.count; p++) {
        int64_t sum = 0;
        bool seen = false;
        for (size_t k = begin[p]; signs->euler && k < begin[p + 1]; k++) {
            if (signs->euler[k] == BETWEEN_CORNERS) continue;
            seen = true;
            sum += signs->euler[k];
        }
        s->euler[p] = seen ? (double)sum / CELL_EULER_UNIT : NAN;
    }
    return s->euler != NULL;
}

/* Returns the area of the surface of a cell in the domain, and extends the box. For a cell that will be
 * measured by parts: minus an estimate of the area. */
static double measure_cell(const field *f, cell_at_hand *own, bbox *box)
{
    const field_cell *cell = &own->cell;
    triangulation t;
    double area = 0;
    join_roots(cell, own->root, &t);
    if (!is_whole(f, cell)) {
        for (int i = 0; i < t.count; i++) area += clipped_area(f, t.at[i], 0, box);
        return area;
    }
    const bool is_later = !cell->hidden_crossing && !f->sharp && t.count > 0,
               bent = is_bent(&t, field_cell_size(f, cell));
    if (cell->hidden_crossing || (bent && !is_later)) area = measure_parts(f, cell, &t);
    for (int i = 0; i < t.count; i++)
        for (int k = 0; k < 3; k++) *box = bbox_include(*box, t.at[i][k].position);
    if (bent && is_later) return -rough_area(&t, field_cell_size(f, cell));
    return area > 0 ? area : triangles_area(f, &t);
}

/* Whether the area of a cell is computed by flat_cell.h. On an open surface only flat cells are: cells at
 * the boundary use roots, and gentle cells beside them would be inaccurate (the area of a cap of a ball of
 * 14 voxels would be 3e-3 too small). */
static bool is_smooth(const field *f, const field_cell *cell)
{
    const bool bends_little = cell->bend == FIELD_FLAT || (cell->bend == FIELD_GENTLE && !f->open);
    return bends_little && !cell->hidden_crossing && is_whole(f, cell);
}

/* Stores the area of cell k if it is available without roots. Otherwise adds the cell to the group. */
static void open_cell(const surface *s, const cell_signs *signs, size_t k, cell_group *group, bbox *box)
{
    const field *f = s->field;
    triangulation t;
    crossed_edge edge[CELL_EDGES];
    if (take_triangles(s, k, &t)) {
        s->area_before[k + 1] = sum_triangles(&t, box);
        return;
    }
    cell_at_hand *own = &group->cells[group->count];
    surface_cell(s, k, &own->cell);
    signs->euler[k] = euler_of_cell(f, signs, &own->cell);
    if (is_smooth(f, &own->cell)) {
        group->smooth[group->smooth_count] = own->cell;
        group->number[group->smooth_count++] = k;
        return;
    }
    own->number = k;
    const int count = cell_crossed_edges(&own->cell, edge);
    for (int i = 0; i < count; i++)
        own->root[edge[i].inside][edge[i].outside] = root_group_add(group->roots, &own->cell, edge[i]);
    group->count++;
}

/* Computes the areas of cells in which F is nearly linear. */
static void measure_smooth(const surface *s, const cell_group *group, bbox *box)
{
    const field *f = s->field;
    double area[ROOT_GROUP_CELLS];
    flat_cell_areas(group->smooth, group->smooth_count, area);
    for (size_t i = 0; i < group->smooth_count; i++) {
        const field_cell *cell = &group->smooth[i];
        const vec3 middle = field_cell_middle(cell);
        field_sample at;
        flat_cell_widen(cell, box);
        if (cell->bend == FIELD_GENTLE && field_sample_at(f, middle, FIELD_HESSIAN, &at))
            area[i] *= 1 + flat_cell_shortage(cell, &at);
        s->area_before[group->number[i] + 1] = area[i];
    }
}

/* Computes the areas of at most ROOT_GROUP_CELLS consecutive cells. */
static void measure_group(const surface *s, const cell_signs *signs, size_t first, size_t last,
                          cell_group *group, bbox *box)
{
    group->count = group->smooth_count = 0;
    root_group_clear(group->roots);
    for (size_t k = first; k < last; k++) open_cell(s, signs, k, group, box);
    measure_smooth(s, group, box);
    root_group_find(group->roots, s->field);
    for (int i = 0; i < group->count; i++)
        s->area_before[group->cells[i].number + 1] = measure_cell(s->field, &group->cells[i], box);
}

/* Whether the triangles have only a small fraction of the cell's area. If corners are almost on the surface,
 * triangles may be as small as a point, and all points drawn from them would coincide. */
static bool are_specks(const triangulation *t, double area)
{
    double flat = 0;
    for (int i = 0; i < t->count; i++)
        flat += 0.5 * vec3_norm(vec3_cross(vec3_sub(t->at[i][1].position, t->at[i][0].position),
                                           vec3_sub(t->at[i][2].position, t->at[i][0].position)));
    return flat < LITTLE * area;
}

/* Computes the triangles from which points are drawn; the caller projects these points. The distribution of
 * the area within a cell is not critical, since it is not larger than the cell. */
static void draw_triangles(const surface *s, size_t index, triangulation *out)
{
    const field *f = s->field;
    field_cell cell;
    if (take_triangles(s, index, out)) return;
    surface_cell(s, index, &cell);
    cut_cell(f, &cell, true, out);
    const bool whole = is_whole(f, &cell);
    if (whole && are_specks(out, s->area_before[index + 1] - s->area_before[index])) out->count = 0;
    if (whole && out->count == 0) measure_parts(f, &cell, out);
    for (int i = 0; i < out->count; i++) {
        bbox box = bbox_empty();
        out->area[i] =
            whole ? curved_area(f, out->at[i], EXCESS_DEPTH) : clipped_area(f, out->at[i], 0, &box);
    }
}

typedef struct scan_job {
    surface *s;
    const cell_signs *signs;
    bbox *box;          /* per worker; a box that already has most cells changes rarely */
    bent_sums *bent;    /* per chunk */
    size_t first;       /* index of the first chunk of the current group */
    bent_samples every; /* sampling of bent cells in this group */
} scan_job;

static void scan_chunk(void *context, int worker, size_t begin, size_t end)
{
    scan_job *job = context;
    const size_t cells = job->s->cells;
    cell_group group;
    bbox box = job->box[worker];
    group.roots = root_group_new();
    for (size_t chunk = job->first + begin; chunk < job->first + end; chunk++)
        for (size_t k = chunk * GRAIN; k < (chunk + 1) * GRAIN && k < cells; k += ROOT_GROUP_CELLS)
            measure_group(job->s, job->signs, k, k + ROOT_GROUP_CELLS < cells ? k + ROOT_GROUP_CELLS : cells,
                          &group, &box);
    root_group_free(group.roots);
    job->box[worker] = box;
}

/* The area of bent cell k by its parts. Otherwise minus an estimate, by half of the parts or by the cell's
 * triangles, which bent_settle scales. */
static double measure_bent(const scan_job *job, size_t k, bent_sums *sums)
{
    const field *f = job->s->field;
    const double rough = -job->s->area_before[k + 1];
    field_cell cell;
    triangulation t;
    if (!bent_is_drawn(k, job->every.half)) return -rough;
    surface_cell(job->s, k, &cell);
    const bool sampled = job->every.whole > 1, by_whole = bent_is_drawn(k, job->every.whole);
    const double half = sampled ? cell_half_parts_area(f, &cell) : 0,
                 area = by_whole ? cell_parts_area(f, &cell, NULL) : -half;
    if (half > 0) {
        sums->half += half;
        sums->rough_of_half += rough;
    }
    if (half > 0 && area > 0) {
        sums->whole += area;
        sums->half_of_whole += half;
        sums->wholes++;
    }
    if (area != 0) return area;
    cut_cell(f, &cell, false, &t);
    return triangles_area(f, &t);
}

static void bent_chunk(void *context, int worker, size_t begin, size_t end)
{
    scan_job *job = context;
    double *area = job->s->area_before + 1;
    (void)worker;
    for (size_t chunk = job->first + begin; chunk < job->first + end; chunk++)
        for (size_t k = chunk * GRAIN; k < (chunk + 1) * GRAIN && k < job->s->cells; k++)
            if (area[k] < 0) area[k] = measure_bent(job, k, &job->bent[chunk]);
}

static size_t count_bent(const scan_job *job, size_t chunks)
{
    const size_t last = (job->first + chunks) * GRAIN;
    size_t count = 0;
    for (size_t k = job->first * GRAIN; k < last && k < job->s->cells; k++)
        count += job->s->area_before[k + 1] < 0;
    return count;
}

/* Scans the chunks in groups, so that the caches of the field stay small enough for the processor's cache.
 * Returns how bent cells were sampled. */
static bent_samples scan_cells(const scan_job *job, size_t chunks, threads *pool)
{
    const field *f = job->s->field;
    const bent_samples all = {1, 1};
    bent_samples chosen = all;
    scan_job part = *job;
    for (size_t done = 0; done < chunks; done += AT_ONCE) {
        const size_t count = chunks - done < AT_ONCE ? chunks - done : AT_ONCE;
        part.first = done;
        threads_run(pool, count, 1, scan_chunk, &part);
        const size_t bent = count_bent(&part, count), few = chosen.whole > 1 ? count * GRAIN / 2 : MANY_BENT;
        if (bent >= few && chosen.whole == 1)
            chosen = bent_choose((double)bent / (double)(count * GRAIN) * (double)job->s->cells);
        part.every = bent >= few ? chosen : all;
        if (bent > 0) threads_run(pool, count, 1, bent_chunk, &part);
        if (f->ops->forget) f->ops->forget(f);
    }
    return chosen;
}

static bool no_area(const field *f, error *e)
{
    vec3 low = f->domain.min, high = f->domain.max;
    if (!f->open) return error_set(e, ERROR_NO_SURFACE, "the surface has no area");
    return error_set(
        e, ERROR_NO_SURFACE,
        "no part of the surface lies between (%g, %g, %g) and (%g, %g, %g): move or widen the region", low.x,
        low.y, low.z, high.x, high.y, high.z);
}

surface *surface_scan(const field *f, threads *pool, error *e)
{
    surface *s = mem_alloc(sizeof *s);
    s->field = f;
    s->cells = f->ops->cell_count(f);
    const size_t chunks = (s->cells + GRAIN - 1) / GRAIN, workers = (size_t)threads_count(pool);
    cell_signs signs;
    scan_job job = {s,
                    &signs,
                    mem_array(workers, sizeof *job.box, "the scan of the surface", e),
                    mem_array(chunks, sizeof *job.bent, "the scan of the surface", e),
                    0,
                    {1, 1}};
    s->area_before = mem_array(s->cells + 1, sizeof *s->area_before, "the scan of the surface", e);
    if (!prepare_signs(f, s->cells, &signs, e) || !job.box || !job.bent || !s->area_before ||
        !components_find(f, pool, &s->parts, e))
        goto fail;
    for (size_t k = 0; k < workers; k++) job.box[k] = bbox_empty();
    bent_settle(s->area_before + 1, s->cells, GRAIN, job.bent, scan_cells(&job, chunks, pool));
    if (!threads_may_go_on(pool, e)) goto fail;
    s->box = bbox_empty();
    for (size_t k = 0; k < workers; k++) s->box = bbox_unite(s->box, job.box[k]);
    for (size_t k = 0; k < s->cells; k++) s->area_before[k + 1] += s->area_before[k];
    s->area = s->area_before[s->cells];
    if (!(s->area > 0)) {
        no_area(f, e);
        goto fail;
    }
    if (!sum_euler(s, &signs, e)) goto fail;
    free(job.box);
    free(job.bent);
    free(signs.euler);
    return s;
fail:
    free(job.box);
    free(job.bent);
    free(signs.euler);
    surface_free(s);
    return NULL;
}

void surface_free(surface *s)
{
    if (!s) return;
    components_free(&s->parts);
    free(s->area_before);
    free(s->euler);
    free(s);
}

static vec3 point_of_triangle(const vec3 c[3], rng *r)
{
    double u = sqrt(rng_uniform(r)), v = rng_uniform(r);
    return vec3_add(vec3_scale(c[0], 1 - u),
                    vec3_add(vec3_scale(c[1], u * (1 - v)), vec3_scale(c[2], u * v)));
}

/* The last cell whose cumulative value is at most `where`. */
static size_t find_cell(const surface *s, const double *before, double where)
{
    size_t low = 0, high = s->cells - 1;
    while (low < high) {
        size_t middle = low + (high - low + 1) / 2;
        if (before[middle] <= where)
            low = middle;
        else
            high = middle - 1;
    }
    return low;
}

static void draw_from_cell(const surface *s, size_t k, surface_last_cell *out)
{
    triangulation t;
    draw_triangles(s, k, &t);
    out->known = true;
    out->cell = k;
    out->count = t.count;
    for (int i = 0; i < t.count; i++) {
        for (int c = 0; c < 3; c++) out->at[i][c] = t.at[i][c].position;
        out->area[i] = t.area[i];
    }
}

static vec3 point_of_cell(const surface *s, size_t k, double share, rng *r, surface_last_cell *t)
{
    if (!t->known || t->cell != k) draw_from_cell(s, k, t);
    double rest = 0;
    for (int i = 0; i < t->count; i++) rest += share * t->area[i];
    int which = 0;
    while (which < t->count - 1 && rest >= t->area[which]) rest -= t->area[which++];
    vec3 p = point_of_triangle(t->at[which], r);
    for (int draw = 0; s->field->open && draw < INSIDE_DRAWS && !bbox_contains(s->field->domain, p); draw++)
        p = point_of_triangle(t->at[which], r);
    return p;
}

vec3 surface_point(const surface *s, const double *before, double where, rng *r, surface_last_cell *last)
{
    surface_last_cell own;
    own.known = false;
    size_t k = find_cell(s, before, where);
    return point_of_cell(s, k, (where - before[k]) / (before[k + 1] - before[k]), r, last ? last : &own);
}

bool surface_patch_point(const surface *s, const double *before, uint32_t patch, double where, rng *r,
                         vec3 *out, uint32_t *hint)
{
    *hint = FIELD_NO_HINT;
    if (!s->field->patches) {
        *out = surface_point(s, before, where * before[s->cells], r, NULL);
        return true;
    }
    double low = before[s->parts.begin[patch]], high = before[s->parts.begin[patch + 1]];
    if (!(high > low)) return false;
    double at = low + where * (high - low);
    size_t k = find_cell(s, before, at);
    surface_last_cell own;
    own.known = false;
    vec3 x = point_of_cell(s, k, (at - before[k]) / (before[k + 1] - before[k]), r, &own);
    if (surface_cell_patch(s, k, x) != patch) return false;
    if (s->field->ops->cell_hint) *hint = s->field->ops->cell_hint(s->field, number_of(s, k));
    *out = x;
    return true;
}

static int cell_triangles(const surface *s, size_t cell, bool is_straight, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    field_cell place;
    triangulation t;
    if (s->field->ops->cell_triangles)
        return s->field->ops->cell_triangles(s->field, number_of(s, cell), out);
    surface_cell(s, cell, &place);
    cut_cell(s->field, &place, is_straight, &t);
    for (int i = 0; i < t.count; i++)
        for (int k = 0; k < 3; k++) out[i][k] = t.at[i][k].position;
    return t.count;
}

int surface_cell_triangles(const surface *s, size_t cell, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    return cell_triangles(s, cell, false, out);
}

vec3 surface_bisect(const surface *s, size_t k, vec3 x)
{
    const field *f = s->field;
    field_cell cell;
    field_sample at;
    if (!field_sample_at(f, x, FIELD_GRADIENT, &at)) return x;
    const bool inside = at.value < 0;
    vec3 other = x;
    double nearest2 = INFINITY;
    surface_cell(s, k, &cell);
    for (int c = 0; c < FIELD_CELL_CORNERS; c++) {
        const double away2 = vec3_norm2(vec3_sub(cell.corner[c], x));
        if (!(away2 < nearest2) || !field_sample_at(f, cell.corner[c], FIELD_GRADIENT, &at) ||
            (at.value < 0) == inside)
            continue;
        nearest2 = away2;
        other = cell.corner[c];
    }
    for (int step = 0; nearest2 < INFINITY && step < BISECT_STEPS; step++) {
        const vec3 middle = vec3_scale(vec3_add(x, other), 0.5);
        if (!field_sample_at(f, middle, FIELD_GRADIENT, &at)) break;
        *((at.value < 0) == inside ? &x : &other) = middle;
    }
    return x;
}

int surface_cell_rough_triangles(const surface *s, size_t cell, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    return cell_triangles(s, cell, true, out);
}
