// SPDX-License-Identifier: Apache-2.0
#include "surface/field/creased.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/field/creases.h"
#include "surface/field/kuhn.h"

/* Maximum cell size in cells of the whole, and minimum number of cells along the longest side. Triangles end
 * at creases, so that cells may be larger than for a combination. The triangles are flat: the area of a
 * sphere is 1e-4 too small. */
static const double WIDER = 2, CELLS_LONGEST = 96;
/* Margins of the grid around the bounding box, in cells: no plane of the solid should contain its corners. */
static const double BELOW = 0.3819, ABOVE = 0.2764;
static const double MOST_CELLS = 1 << 28; /* maximum; one byte each */
/* In cell sizes: a place nearer to a leaf lies on it. */
static const double ON_LEAF = 1e-9;
/* In cell sizes: tolerance for equal corners that were computed from different leaves. */
static const double SAME_CORNER = 1e-5;
/* Maximum steps of regula falsi (to ROOT_TOLERANCE cell sizes) and of Newton's method. */
enum { ROOT_STEPS = 40, PROJECT_STEPS = 8 };
static const double ROOT_TOLERANCE = 1e-13;
/* In cell sizes: if Newton's method moves a place farther, the place is not changed. */
static const double PROJECT_REACH = 2;

static const char *const WHAT = "the patches of the surface";

/* The part of a leaf's zero set that is the solid's surface. */
typedef struct piece {
    field base;
    const solid *solid;
    int leaf, sign; /* as solid_surface returns it */
} piece;

struct creased {
    field base; /* first: the field's functions get this pointer */
    solid *solid;
    field_patches patches;
    piece *piece; /* one per patch */
    vec3 (*triangle)[3];
    size_t triangle_count, cell_count;
    size_t *cell; /* first triangle of each cell; cell_count + 1 entries */
    uint32_t *patch;
};

/* ---- the field */

static bool piece_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const piece *p = (const piece *)f;
    field_sample s;
    if (!field_sample_at(&p->solid->leaf[p->leaf].base, x, order, &s)) return false;
    out->value = p->sign * s.value;
    out->gradient = vec3_scale(s.gradient, p->sign);
    const sym3 h = s.hessian;
    const double g = p->sign;
    if (order == FIELD_HESSIAN)
        out->hessian = (sym3){g * h.xx, g * h.yy, g * h.zz, g * h.xy, g * h.xz, g * h.yz};
    return true;
}

/* On a crease the sides depend on rounding: any combination of them is accepted. */
static bool piece_within(const field *f, vec3 x, uint32_t *hint)
{
    (void)hint;
    const piece *p = (const piece *)f;
    const solid *s = p->solid;
    uint64_t sides = 0, open[3];
    int opened = 0;
    for (int k = 0; k < s->count; k++) {
        double distance = solid_distance(s, k, x);
        sides |= (uint64_t)(distance < 0) << k;
        if (k != p->leaf && opened < 3 && fabs(distance) < ON_LEAF * s->size)
            open[opened++] = (uint64_t)1 << k;
    }
    for (int n = 0; n < 1 << opened; n++) {
        uint64_t turned = sides;
        for (int k = 0; k < opened; k++)
            if (n >> k & 1) turned ^= open[k];
        if (solid_surface(s, p->leaf, turned) == p->sign) return true;
    }
    return false;
}

static const field_ops piece_ops = {.sample = piece_sample, .within = piece_within};

static bool creased_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    piece nearest = {.solid = ((const creased *)f)->solid};
    nearest.leaf = solid_nearest(nearest.solid, x, &nearest.sign);
    return piece_sample(&nearest.base, x, order, out);
}

static double creased_side(const field *f, vec3 x)
{
    const solid *s = ((const creased *)f)->solid;
    field_sample unused;
    if (creased_sample(f, x, FIELD_GRADIENT, &unused)) return 0;
    return solid_holds(&s->inside, solid_sides(s, x)) ? -1 : 1;
}

static size_t creased_cell_count(const field *f)
{
    return ((const creased *)f)->cell_count;
}

static int creased_cell_triangles(const field *f, size_t k, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    const creased *c = (const creased *)f;
    size_t count = c->cell[k + 1] - c->cell[k];
    memcpy(out, c->triangle + c->cell[k], count * sizeof *c->triangle);
    return (int)count;
}

static void creased_cell(const field *f, size_t k, field_cell *out)
{
    const creased *c = (const creased *)f;
    bbox box = bbox_empty();
    for (size_t t = c->cell[k]; t < c->cell[k + 1]; t++)
        for (int v = 0; v < 3; v++) box = bbox_include(box, c->triangle[t][v]);
    *out = (field_cell){.hidden_crossing = false};
    for (int v = 0; v < 8; v++)
        out->corner[v] = (vec3){v & 1 ? box.max.x : box.min.x, v & 2 ? box.max.y : box.min.y,
                                v & 4 ? box.max.z : box.min.z};
}

static uint32_t creased_patch_at(const field *f, size_t k, vec3 x)
{
    (void)x;
    return ((const creased *)f)->patch[k];
}

static const field_ops creased_ops = {.sample = creased_sample,
                                      .cell_count = creased_cell_count,
                                      .cell = creased_cell,
                                      .side = creased_side,
                                      .cell_triangles = creased_cell_triangles,
                                      .patch_at = creased_patch_at};

/* ---- construction: triangulates the leaves cell by cell */

/* A corner of a triangle, and the set of leaves that contain it. */
typedef struct node {
    vec3 x;
    uint64_t on;
} node;

typedef struct cut_triangle {
    vec3 at[3];
    uint32_t key; /* 2 leaf, or 2 leaf + 1 where the solid is outside the leaf */
} cut_triangle;

typedef struct builder {
    const solid *solid;
    bbox box;
    int64_t cells[3];
    double edge;            /* longest edge of a cell */
    int leaf;               /* the leaf that is triangulated */
    uint64_t varying;       /* leaves whose side changes in the cell */
    cut_triangle *triangle; /* of all cells so far; those of the current cell start at `first` */
    size_t first, count, capacity;
    size_t *cell;
    uint32_t *key; /* patch key of each cell of at most FIELD_CELL_TRIANGLES triangles */
    size_t cell_count, cell_capacity, key_capacity;
    crease_segment *segment;
    size_t segment_count, segment_capacity;
    bool failed;
    error *e;
} builder;

/* Projects x onto up to three leaves at once, by minimum-norm Newton steps. */
static vec3 project_onto_leaves(const builder *b, uint64_t on, vec3 x)
{
    const vec3 begin = x;
    for (int step = 0; step < PROJECT_STEPS; step++) {
        double value[3], gram[3][4];
        vec3 gradient[3];
        int count = 0;
        for (int k = 0; k < b->solid->count && count < 3; k++) {
            field_sample s;
            if (!(on >> k & 1)) continue;
            if (!field_sample_at(&b->solid->leaf[k].base, x, FIELD_GRADIENT, &s)) return begin;
            value[count] = s.value;
            gradient[count++] = s.gradient;
        }
        for (int i = 0; i < count; i++) {
            for (int j = 0; j < count; j++) gram[i][j] = vec3_dot(gradient[i], gradient[j]);
            gram[i][count] = value[i];
        }
        for (int i = 0; i < count; i++) { /* positive definite: no pivoting */
            if (!(gram[i][i] > 0)) return begin;
            for (int j = 0; j < count; j++) {
                double share = j == i ? 0 : gram[j][i] / gram[i][i];
                for (int k = i; k <= count; k++) gram[j][k] -= share * gram[i][k];
            }
        }
        for (int i = 0; i < count; i++) x = vec3_axpy(-gram[i][count] / gram[i][i], gradient[i], x);
        if (!(vec3_norm(vec3_sub(x, begin)) < PROJECT_REACH * b->edge)) return begin;
    }
    return x;
}

/* The zero of a leaf on the segment between a place inside and a place outside, by regula falsi
 * (Illinois). */
static vec3 find_root(const builder *b, int leaf, vec3 inside, vec3 outside, double at_inside,
                      double at_outside)
{
    double low = 0, high = 1;
    vec3 way = vec3_sub(outside, inside), x = inside;
    int kept = 0;
    for (int k = 0; k < ROOT_STEPS; k++) {
        double t = low + (high - low) * at_inside / (at_inside - at_outside);
        x = vec3_axpy(t, way, inside);
        double value = solid_distance(b->solid, leaf, x);
        if (fabs(value) <= ROOT_TOLERANCE * b->edge) break;
        if (value < 0) {
            low = t;
            at_inside = value;
            if (kept == 1) at_outside *= 0.5;
            kept = 1;
        } else {
            high = t;
            at_outside = value;
            if (kept == -1) at_inside *= 0.5;
            kept = -1;
        }
    }
    return x;
}

static void add_segment(builder *b, const node *p, const node *q, int other, uint64_t sides)
{
    b->failed |= !MEM_GROW(b->segment, b->segment_count, &b->segment_capacity, WHAT, b->e);
    if (b->failed) return;
    b->segment[b->segment_count++] = (crease_segment){{p->x, q->x}, {p->on, q->on}, {b->leaf, other}, sides};
}

/* Records the sides of a triangle at which its patch ends. To record each once: the triangle inside the other
 * leaf records it, if there is one; if both leaves end there, the leaf with the lower index does. */
static void note_segments(builder *b, const node t[3], uint64_t sides)
{
    for (int side = 0; side < 3; side++) {
        const node *p = &t[side], *q = &t[(side + 1) % 3];
        uint64_t both = p->on & q->on & ~((uint64_t)1 << b->leaf);
        for (int j = 0; both && j < b->solid->count; j++) {
            if (!(both >> j & 1)) continue;
            const uint64_t bit = (uint64_t)1 << j, mine = (uint64_t)1 << b->leaf;
            int in = solid_surface(b->solid, b->leaf, sides | bit),
                out = solid_surface(b->solid, b->leaf, sides & ~bit);
            bool owner = in ? (sides & bit) != 0 : (sides & bit) == 0;
            bool ends = in != out, other_ends = solid_surface(b->solid, j, sides | mine) !=
                                                solid_surface(b->solid, j, sides & ~mine);
            if (ends && owner && (b->leaf < j || !other_ends)) add_segment(b, p, q, j, sides);
        }
    }
}

static void emit(builder *b, const node t[3], uint64_t sides)
{
    int sign = solid_surface(b->solid, b->leaf, sides);
    if (sign == 0) return;
    note_segments(b, t, sides);
    b->failed |= !MEM_GROW(b->triangle, b->count, &b->capacity, WHAT, b->e);
    if (b->failed) return;
    for (int k = 0; k < 3; k++) b->triangle[b->count].at[k] = t[sign > 0 ? k : 2 - k].x;
    b->triangle[b->count++].key = (uint32_t)(2 * b->leaf + (sign < 0));
}

static node cut_side(const builder *b, int leaf, const node *inside, const node *outside, double at_inside,
                     double at_outside)
{
    node n = {.on = (inside->on & outside->on) | (uint64_t)1 << leaf};
    n.x = project_onto_leaves(b, n.on, find_root(b, leaf, inside->x, outside->x, at_inside, at_outside));
    return n;
}

/* Splits a triangle recursively where leaves with index `next` or higher change their side. */
static void split(builder *b, const node given[3], int next, uint64_t sides)
{
    node t[3] = {given[0], given[1], given[2]};
    double value[3];
    int lone = -1, in = 0, out = 0;
    for (; next < b->solid->count; next++) {
        const uint64_t bit = (uint64_t)1 << next;
        if (next == b->leaf || !(b->varying & bit)) continue;
        in = out = 0;
        for (int k = 0; k < 3; k++) {
            value[k] = t[k].on & bit ? 0 : solid_distance(b->solid, next, t[k].x);
            if (fabs(value[k]) < ON_LEAF * b->edge) {
                value[k] = 0;
                t[k].on |= bit;
            }
            in += value[k] < 0;
            out += value[k] > 0;
        }
        if (in > 0 && out > 0) break;
        if (in + out == 0)
            in = solid_distance(b->solid, next,
                                field_triangle_middle((const vec3[3]){t[0].x, t[1].x, t[2].x})) < 0;
        sides = in > 0 ? sides | bit : sides & ~bit;
    }
    if (next == b->solid->count) {
        emit(b, t, sides);
        return;
    }
    /* the corner whose side differs from that of the other two; if two do (the third lies on the leaf), the
     * one inside */
    for (int k = 0; k < 3; k++)
        if (value[k] != 0 && (value[k] < 0 ? in : out) == 1 && (lone < 0 || value[k] < 0)) lone = k;
    const uint64_t bit = (uint64_t)1 << next, own = value[lone] < 0 ? sides | bit : sides & ~bit,
                   others = own ^ bit;
    node at[2]; /* roots on the edges from this corner to the next one and to the one after */
    for (int k = 0; k < 2; k++) {
        int to = (lone + 1 + k) % 3;
        if (value[to] == 0)
            at[k] = t[to];
        else if (value[lone] < 0)
            at[k] = cut_side(b, next, &t[lone], &t[to], value[lone], value[to]);
        else
            at[k] = cut_side(b, next, &t[to], &t[lone], value[to], value[lone]);
    }
    const node p = t[(lone + 1) % 3], q = t[(lone + 2) % 3];
    split(b, (const node[3]){t[lone], at[0], at[1]}, next + 1, own);
    if (value[(lone + 1) % 3] != 0) split(b, (const node[3]){at[0], p, at[1]}, next + 1, others);
    if (value[(lone + 2) % 3] != 0) split(b, (const node[3]){at[1], p, q}, next + 1, others);
}

static void cut_tetrahedron(builder *b, const int corners[4], const vec3 at[8], const double value[8],
                            uint64_t sides)
{
    int in[4], out[4], ins = 0, outs = 0;
    node n[4];
    for (int k = 0; k < 4; k++) {
        if (value[corners[k]] < 0)
            in[ins++] = corners[k];
        else
            out[outs++] = corners[k];
    }
    if (ins == 0 || outs == 0) return;
    int count = 0;
    for (int k = 0; k < ins; k++) /* order around a quadrilateral: 00, 01, 11, 10 */
        for (int m = 0; m < outs; m++) {
            int i = in[k], o = out[ins == 2 && k == 1 ? 1 - m : m];
            n[count++] =
                (node){find_root(b, b->leaf, at[i], at[o], value[i], value[o]), (uint64_t)1 << b->leaf};
        }
    vec3 across = vec3_sub(at[out[0]], at[in[0]]);
    vec3 normal = vec3_cross(vec3_sub(n[1].x, n[0].x), vec3_sub(n[2].x, n[0].x));
    if (vec3_dot(normal, across) < 0) { /* counter-clockwise seen from outside the leaf */
        node first = n[0];
        n[0] = n[2];
        n[2] = first;
    }
    split(b, n, 0, sides);
    if (count == 4) split(b, (const node[3]){n[0], n[2], n[3]}, 0, sides);
}

static vec3 corner_at(const builder *b, int64_t i, int64_t j, int64_t k)
{
    const int64_t at[3] = {i, j, k};
    vec3 x = b->box.min, size = bbox_size(b->box);
    for (int axis = 0; axis < 3; axis++)
        vec3_set(&x, axis,
                 vec3_get(b->box.min, axis) +
                     vec3_get(size, axis) * (double)at[axis] / (double)b->cells[axis]);
    return x;
}

static int compare_keys(const void *a, const void *b)
{
    const cut_triangle *p = a, *q = b;
    return p->key != q->key ? (p->key > q->key) - (p->key < q->key) : memcmp(p->at, q->at, sizeof p->at);
}

/* Groups the triangles of the current cell into field cells of one patch and at most FIELD_CELL_TRIANGLES
 * triangles. */
static void end_cell(builder *b)
{
    if (b->failed || b->count == b->first) return;
    qsort(b->triangle + b->first, b->count - b->first, sizeof *b->triangle, compare_keys);
    for (size_t k = b->first; k < b->count; k++) {
        if (k > b->first && k - b->cell[b->cell_count - 1] < FIELD_CELL_TRIANGLES &&
            b->triangle[k].key == b->triangle[k - 1].key)
            continue;
        b->failed |= !MEM_GROW(b->cell, b->cell_count, &b->cell_capacity, WHAT, b->e) ||
                     !MEM_GROW(b->key, b->cell_count, &b->key_capacity, WHAT, b->e);
        if (b->failed) return;
        b->cell[b->cell_count] = k;
        b->key[b->cell_count++] = b->triangle[k].key;
    }
    b->first = b->count;
}

static void cut_cell(builder *b, const int64_t at[3])
{
    vec3 corner[8];
    double value[SOLID_LEAVES][8];
    uint64_t any = 0, all = UINT64_MAX;
    for (int c = 0; c < 8; c++)
        corner[c] = corner_at(b, at[0] + (c & 1), at[1] + (c >> 1 & 1), at[2] + (c >> 2));
    for (int k = 0; k < b->solid->count; k++)
        for (int c = 0; c < 8; c++) {
            value[k][c] = solid_distance(b->solid, k, corner[c]);
            if (value[k][c] < 0)
                any |= (uint64_t)1 << k;
            else
                all &= ~((uint64_t)1 << k);
        }
    b->varying = any & ~all;
    for (b->leaf = 0; b->leaf < b->solid->count; b->leaf++)
        for (int t = 0; t < KUHN_TETRAHEDRA && b->varying >> b->leaf & 1; t++) {
            const kuhn_path path = kuhn_path_of(t);
            cut_tetrahedron(b, path.corner, corner, value[b->leaf], any & all);
        }
    end_cell(b);
}

/* Marks the cells that intersect cells of the whole. */
static void mark_cells(const builder *b, const field *whole, uint8_t *marks)
{
    vec3 size = bbox_size(b->box);
    for (size_t k = 0; k < whole->ops->cell_count(whole); k++) {
        field_cell cell;
        bbox box = bbox_empty();
        int64_t first[3], last[3];
        whole->ops->cell(whole, k, &cell);
        for (int c = 0; c < 8; c++) box = bbox_include(box, cell.corner[c]);
        box = bbox_grow(box, 0.5 * whole->cell_size);
        for (int axis = 0; axis < 3; axis++) {
            double unit = vec3_get(size, axis) / (double)b->cells[axis], low = vec3_get(b->box.min, axis);
            double most = (double)b->cells[axis];
            first[axis] = (int64_t)fmin(fmax(floor((vec3_get(box.min, axis) - low) / unit), 0), most);
            last[axis] = (int64_t)fmin(fmax(floor((vec3_get(box.max, axis) - low) / unit), -1), most - 1);
        }
        for (int64_t z = first[2]; z <= last[2]; z++)
            for (int64_t y = first[1]; y <= last[1]; y++)
                for (int64_t x = first[0]; x <= last[0]; x++)
                    marks[(z * b->cells[1] + y) * b->cells[0] + x] = 1;
    }
}

static bool cut_cells(builder *b, const field *whole, error *e)
{
    vec3 size = bbox_size(b->box);
    double count = 1, edge = fmin(WIDER * whole->cell_size, bbox_longest(b->box) / CELLS_LONGEST);
    for (int axis = 0; axis < 3; axis++) {
        double cells = ceil(vec3_get(size, axis) / edge);
        b->edge = fmax(b->edge, vec3_get(size, axis) / cells);
        count *= cells;
        b->cells[axis] = count <= MOST_CELLS ? (int64_t)cells : 0;
    }
    if (!(count <= MOST_CELLS))
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "the surface is too large, compared with its finest part, to sample its edges: "
                         "remove features");
    uint8_t *marks = mem_array((size_t)count, 1, WHAT, e);
    if (!marks) return false;
    mark_cells(b, whole, marks);
    for (int64_t n = 0; n < (int64_t)count && !b->failed; n++) {
        const int64_t at[3] = {n % b->cells[0], n / b->cells[0] % b->cells[1],
                               n / (b->cells[0] * b->cells[1])};
        if (marks[n]) cut_cell(b, at);
    }
    free(marks);
    return !b->failed;
}

/* ---- patches */

static bool number_patches(creased *c, const builder *b, uint32_t *patch_of, error *e)
{
    field_patches *p = &c->patches;
    for (int k = 0; k < 2 * SOLID_LEAVES; k++) patch_of[k] = UINT32_MAX;
    for (size_t k = 0; k < b->count; k++) patch_of[b->triangle[k].key] = 0;
    for (int k = 0; k < 2 * SOLID_LEAVES; k++)
        if (patch_of[k] == 0) patch_of[k] = (uint32_t)p->count++;
    if (p->count == 0) return error_set(e, ERROR_NO_SURFACE, "the surface is empty: correct its parts");
    p->patch = mem_array(p->count, sizeof *p->patch, WHAT, e);
    c->piece = mem_array(p->count, sizeof *c->piece, WHAT, e);
    c->triangle = mem_array(b->count, sizeof *c->triangle, WHAT, e);
    c->cell = mem_array(b->cell_count + 1, sizeof *c->cell, WHAT, e);
    c->patch = mem_array(b->cell_count, sizeof *c->patch, WHAT, e);
    if (!p->patch || !c->piece || !c->triangle || !c->cell || !c->patch) return false;
    for (int k = 0; k < 2 * SOLID_LEAVES; k++) {
        if (patch_of[k] == UINT32_MAX) continue;
        piece *of = &c->piece[patch_of[k]];
        *of = (piece){.base = c->base, .solid = c->solid, .leaf = k / 2, .sign = k % 2 ? -1 : 1};
        of->base.ops = &piece_ops;
        p->patch[patch_of[k]].field = &of->base;
    }
    return true;
}

static void take_triangles(creased *c, const builder *b, const uint32_t *patch_of)
{
    for (size_t k = 0; k < b->count; k++) {
        const vec3 *t = b->triangle[k].at;
        memcpy(c->triangle[k], t, sizeof *c->triangle);
        c->patches.patch[patch_of[b->triangle[k].key]].area +=
            0.5 * vec3_norm(vec3_cross(vec3_sub(t[1], t[0]), vec3_sub(t[2], t[0])));
    }
    c->triangle_count = b->count;
    c->cell_count = b->cell_count;
    memcpy(c->cell, b->cell, b->cell_count * sizeof *c->cell);
    c->cell[b->cell_count] = b->count;
    for (size_t k = 0; k < b->cell_count; k++) c->patch[k] = patch_of[b->key[k]];
}

static bool build(creased *c, const field *whole, bbox box, error *e)
{
    uint32_t patch_of[2 * SOLID_LEAVES];
    builder b = {.solid = c->solid, .box = bbox_common(whole->domain, box), .e = e};
    vec3 size = bbox_size(b.box);
    if (!(size.x > 0 && size.y > 0 && size.z > 0))
        return error_set(e, ERROR_NO_SURFACE, "the surface is empty: correct its parts");
    const double low = BELOW * WIDER * whole->cell_size, high = ABOVE * WIDER * whole->cell_size;
    b.box.min = vec3_sub(b.box.min, vec3_make(low, low, low));
    b.box.max = vec3_add(b.box.max, vec3_make(high, high, high));
    bool ok = cut_cells(&b, whole, e);
    c->base = (field){.ops = &creased_ops,
                      .domain = b.box,
                      .extent = whole->extent,
                      .cell_size = b.edge,
                      .patches = &c->patches};
    field_set_boundary(&c->base, 0);
    ok = ok && number_patches(c, &b, patch_of, e);
    if (ok) take_triangles(c, &b, patch_of);
    ok = ok &&
         creases_join(c->solid, b.segment, b.segment_count, patch_of, SAME_CORNER * b.edge, &c->patches, e);
    free(b.triangle);
    free(b.cell);
    free(b.key);
    free(b.segment);
    return ok;
}

creased *creased_new(solid *s, const field *whole, bbox box, error *e)
{
    creased *c = mem_alloc(sizeof *c);
    c->solid = s;
    if (build(c, whole, box, e)) return c;
    creased_free(c);
    return NULL;
}

void creased_free(creased *c)
{
    if (!c) return;
    solid_free(c->solid);
    free(c->patches.patch);
    free(c->patches.curve);
    free(c->patches.vertex);
    free(c->patches.curve_patch);
    free(c->piece);
    free(c->triangle);
    free(c->cell);
    free(c->patch);
    free(c);
}

const field *creased_field(const creased *c)
{
    return &c->base;
}

size_t creased_bytes(const creased *c)
{
    return c ? c->triangle_count * sizeof *c->triangle + c->cell_count * (sizeof *c->cell + sizeof *c->patch)
             : 0;
}
