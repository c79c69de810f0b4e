// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/facets.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/sets.h"
#include "surface/field/patches.h"
#include "surface/field/projection.h"
#include "geometry/space/cell_list.h"
#include "geometry/space/morton.h"
#include "geometry/space/triangle.h"

/* Maximum items of a leaf. With 4, the nodes take twice the memory, and the measures take as long. */
enum { LEAF_ITEMS = 8, DEEPEST = 64 };
/* If the projected midpoint of an edge is farther from the edge than this fraction of its length, it belongs
 * to another part of the surface: an arc of a right angle rises by 0.21. */
static const double MIDDLE_RISE = 0.25;
/* Maximum angle, radians, between a normal in a grid cell and the gradient at its centre, by the class of
 * curvature (field_bend). The values only bound the normals of a node; triangles are tested with their own
 * normals. */
static const float CELL_ANGLE[] = {[FIELD_BENT] = 1.05f, [FIELD_GENTLE] = 0.5f, [FIELD_FLAT] = 0.15f};
/* Directions whose cosine exceeds 1 minus this belong to one edge at a corner: angles below 1e-4 radians. */
static const double SAME_DIRECTION = 5e-9;
/* Factor on the radii of spheres, which covers rounding errors. */
static const double ROUNDING = 1 + 1e-12;

static const char what[] = "the measures of the surface";

static void mesh_corners(const facets *f, uint32_t item, vec3 out[3])
{
    for (int k = 0; k < 3; k++) out[k] = f->in.vertex[f->in.triangle[item][k]];
}

/* ---- pieces */

/* The end with the higher index of an edge, and a triangle at the edge; stored at the lower end. */
typedef struct edge_end {
    uint32_t high, triangle;
} edge_end;

static size_t count_vertices(const facets_input *in)
{
    size_t count = 0;
    for (size_t k = 0; k < in->triangle_count; k++)
        for (int c = 0; c < 3; c++)
            count = in->triangle[k][c] + (size_t)1 > count ? in->triangle[k][c] + (size_t)1 : count;
    return count;
}

/* Joins the triangles that share an edge. */
static bool join_triangles(const facets_input *in, uint32_t *parent, error *e)
{
    const size_t vertices = count_vertices(in);
    size_t *first = mem_array(vertices + 2, sizeof *first, what, e);
    edge_end *end = first ? mem_array(3 * in->triangle_count, sizeof *end, what, e) : NULL;
    sets_reset(parent, in->triangle_count);
    for (int pass = 0; end && pass < 2; pass++) {
        for (size_t k = 0; k < 3 * in->triangle_count; k++) {
            const uint32_t a = in->triangle[k / 3][k % 3], b = in->triangle[k / 3][(k + 1) % 3],
                           low = a < b ? a : b;
            if (pass == 0)
                first[low + 2]++;
            else
                end[first[low + 1]++] = (edge_end){a < b ? b : a, (uint32_t)(k / 3)};
        }
        for (size_t v = 0; pass == 0 && v < vertices; v++) first[v + 2] += first[v + 1];
    }
    for (size_t v = 0; end && v < vertices; v++)
        for (size_t k = first[v]; k < first[v + 1]; k++)
            for (size_t l = first[v]; l < k; l++)
                if (end[k].high == end[l].high) {
                    sets_join(parent, end[k].triangle, end[l].triangle);
                    break;
                }
    const bool ok = end != NULL;
    free(first);
    free(end);
    return ok;
}

/* Numbers the sets in the order of their roots. Returns their number. */
static size_t number_sets(uint32_t *parent, size_t count)
{
    size_t sets = 0;
    for (uint32_t k = 0; k < count;
         k++) { /* the root is the lowest index of its set, so that its number is known before */
        const uint32_t root = parent[k] == k ? k : sets_root(parent, k);
        parent[k] = root;
    }
    for (uint32_t k = 0; k < count; k++) parent[k] = parent[k] == k ? (uint32_t)sets++ : parent[parent[k]];
    return sets;
}

bool facets_count_pieces(const facets_input *in, size_t *count, error *e)
{
    uint32_t *piece = mem_array(in->triangle_count, sizeof *piece, what, e);
    const bool ok = piece && join_triangles(in, piece, e);
    if (ok) *count = number_sets(piece, in->triangle_count);
    free(piece);
    return ok;
}

/* Finds the piece of each item, if the patches do not determine it. */
static bool find_pieces(facets *f, error *e)
{
    const facets_input *in = &f->in;
    f->piece_count = 1;
    if (in->patch_piece) {
        for (size_t p = 0; p < in->patch_count; p++)
            f->piece_count =
                in->patch_piece[p] + 1 > f->piece_count ? in->patch_piece[p] + 1 : f->piece_count;
        return true;
    }
    if (in->triangle_count > 0) {
        f->piece = mem_array(in->triangle_count, sizeof *f->piece, what, e);
        if (!f->piece || !join_triangles(in, f->piece, e)) return false;
        f->piece_count = number_sets(f->piece, in->triangle_count);
        return true;
    }
    const components *parts = &in->scan->parts;
    if (parts->count <= 1) return true;
    f->piece = mem_array(in->scan->cells, sizeof *f->piece, what, e);
    if (!f->piece) return false;
    f->piece_count = parts->count;
    for (size_t p = 0; p < parts->count; p++)
        for (size_t k = parts->begin[p]; k < parts->begin[p + 1]; k++) f->piece[k] = (uint32_t)p;
    return true;
}

/* ---- items */

/* The patch of an item: cells and triangles are numbered patch after patch. */
static uint32_t patch_of_item(const facets *f, uint32_t item)
{
    if (f->in.patch_count <= 1) return 0;
    const size_t *first = f->in.triangle_count > 0 ? f->in.patch_first : f->in.scan->parts.begin;
    size_t low = 0, high = f->in.patch_count;
    while (high - low > 1) *(first[(low + high) / 2] <= item ? &low : &high) = (low + high) / 2;
    return (uint32_t)low;
}

static uint32_t piece_of_item(const facets *f, uint32_t item)
{
    return f->in.patch_piece ? f->in.patch_piece[patch_of_item(f, item)] : f->piece ? f->piece[item] : 0;
}

uint32_t facets_piece(const facets *f, size_t k)
{
    return piece_of_item(f, f->item[k]);
}

/* The gradient of F at the centre of a cell, from the values at its corners. */
static vec3 cell_normal(const field_cell *cell)
{
    vec3 sum = {0, 0, 0};
    const vec3 middle = field_cell_middle(cell);
    for (int c = 0; c < 8; c++) sum = vec3_axpy(cell->value[c], vec3_sub(cell->corner[c], middle), sum);
    return vec3_unit(sum);
}

/* The sphere, normal and area of one item. */
typedef struct item_bounds {
    vec3 centre, normal;
    double radius, area;
    float angle;
} item_bounds;

static vec3 item_sphere(const facets *f, uint32_t item, double *radius)
{
    if (f->in.triangle_count == 0) return surface_cell_middle(f->in.scan, item, radius);
    vec3 c[3];
    mesh_corners(f, item, c);
    const vec3 centre = field_triangle_middle(c);
    *radius = 0;
    for (int k = 0; k < 3; k++) *radius = fmax(*radius, vec3_norm(vec3_sub(c[k], centre)));
    return centre;
}

static void bound_item(const facets *f, uint32_t item, vec3 normal, float angle, item_bounds *out)
{
    out->centre = item_sphere(f, item, &out->radius);
    if (f->in.triangle_count == 0) {
        out->normal = normal;
        out->angle = angle;
        out->area = surface_cell_area(f->in.scan, item);
        return;
    }
    vec3 c[3];
    mesh_corners(f, item, c);
    const vec3 cross = vec3_across(c[0], c[1], c[2]);
    out->normal = vec3_unit(cross);
    out->angle = 0;
    out->area = 0.5 * vec3_norm(cross);
}

static double area_of_item(const facets *f, uint32_t item)
{
    item_bounds b;
    if (f->in.triangle_count == 0) return surface_cell_area(f->in.scan, item);
    bound_item(f, item, (vec3){0, 0, 0}, 0, &b);
    return b.area;
}

static facets_item describe_item(const facets *f, uint32_t item)
{
    item_bounds b;
    bound_item(f, item, (vec3){0, 0, 0}, 0, &b);
    return (facets_item){
        b.centre, b.radius, b.area, b.normal, patch_of_item(f, item), piece_of_item(f, item)};
}

facets_item facets_item_at(const facets *f, size_t k)
{
    return describe_item(f, f->item[k]);
}

size_t facets_total(const facets *f)
{
    return f->in.triangle_count > 0 ? f->in.triangle_count : f->in.scan->cells;
}

facets_item facets_any_item(const facets *f, size_t k)
{
    return describe_item(f, (uint32_t)k);
}

/* ---- the hierarchy */

static void include_sphere(vec3 *centre, double *radius, vec3 other, double r)
{
    const vec3 to = vec3_sub(other, *centre);
    const double d = vec3_norm(to);
    if (d + r <= *radius) return;
    if (d + *radius <= r) {
        *centre = other;
        *radius = r;
        return;
    }
    const double both = 0.5 * (d + *radius + r);
    *centre = vec3_axpy((both - *radius) / d, to, *centre);
    *radius = both;
}

static float angle_between(const float axis[3], vec3 n)
{
    const double c = axis[0] * n.x + axis[1] * n.y + axis[2] * n.z;
    return (float)elementary_acos(fmin(fmax(c, -1), 1)) + 1e-4f; /* plus the rounding error of floats */
}

static void set_axis(facets_node *n, vec3 sum)
{
    const vec3 axis = vec3_unit(sum);
    n->axis[0] = (float)axis.x;
    n->axis[1] = (float)axis.y;
    n->axis[2] = (float)axis.z;
    n->angle = vec3_norm2(axis) > 0 ? 0 : (float)M_PI;
}

static void widen_angle(facets_node *n, vec3 normal, float angle)
{
    if (n->angle < (float)M_PI) n->angle = fmaxf(n->angle, angle_between(n->axis, normal) + angle);
}

static vec3 face_normal_at(const facets *f, size_t at)
{
    return f->face_normal ? vec3_make(f->face_normal[at][0], f->face_normal[at][1], f->face_normal[at][2])
                          : (vec3){0, 0, 0};
}

static void bound_leaf(facets *f, const float *cell_angle, facets_node *n)
{
    item_bounds b[LEAF_ITEMS];
    const uint32_t count = n->end - n->begin;
    vec3 sum = {0, 0, 0};
    n->radius = -1;
    for (uint32_t k = 0; k < count; k++) {
        const uint32_t at = n->begin + k, item = f->item[at];
        bound_item(f, item, face_normal_at(f, at), cell_angle ? cell_angle[at] : 0, &b[k]);
        if (n->radius < 0) {
            n->centre = b[k].centre;
            n->radius = b[k].radius;
        } else
            include_sphere(&n->centre, &n->radius, b[k].centre, b[k].radius);
        n->area += b[k].area;
        sum = vec3_add(sum, b[k].normal);
        const uint32_t piece = piece_of_item(f, item), patch = patch_of_item(f, item);
        n->piece = k == 0 || n->piece == piece ? piece : FACETS_MIXED;
        n->patch = k == 0 || n->patch == patch ? patch : FACETS_MIXED;
    }
    n->radius *= ROUNDING;
    set_axis(n, sum);
    for (uint32_t k = 0; k < count; k++)
        if (vec3_norm2(b[k].normal) > 0)
            widen_angle(n, b[k].normal, b[k].angle);
        else if (b[k].area > 0)
            n->angle = (float)M_PI;
}

static vec3 axis_of(const facets_node *n)
{
    return vec3_make(n->axis[0], n->axis[1], n->axis[2]);
}

static void unite_nodes(const facets_node *a, const facets_node *b, facets_node *out)
{
    out->centre = a->centre;
    out->radius = a->radius;
    include_sphere(&out->centre, &out->radius, b->centre, b->radius);
    out->radius *= ROUNDING;
    out->area = a->area + b->area;
    out->piece = a->piece == b->piece ? a->piece : FACETS_MIXED;
    out->patch = a->patch == b->patch ? a->patch : FACETS_MIXED;
    set_axis(out, vec3_add(axis_of(a), axis_of(b)));
    widen_angle(out, axis_of(a), a->angle);
    widen_angle(out, axis_of(b), b->angle);
}

/* Appends the nodes of a range of items. Returns the index of its root. */
static uint32_t build_nodes(facets *f, const float *cell_angle, const threads *pool, uint32_t begin,
                            uint32_t end)
{
    const uint32_t at = (uint32_t)f->node_count++;
    f->node[at] = (facets_node){.begin = begin, .end = end};
    if (end - begin <= LEAF_ITEMS) {
        bound_leaf(f, cell_angle, &f->node[at]);
        return at;
    }
    const uint32_t leaves = (end - begin + LEAF_ITEMS - 1) / LEAF_ITEMS,
                   middle = begin + (leaves + 1) / 2 * LEAF_ITEMS;
    if (threads_stopped(pool)) return at; /* incomplete */
    build_nodes(f, cell_angle, pool, begin, middle);
    const uint32_t right = build_nodes(f, cell_angle, pool, middle, end);
    unite_nodes(&f->node[at + 1], &f->node[right], &f->node[at]);
    f->node[at].right = right;
    return at;
}

/* The items that a hierarchy contains. */
typedef struct choice {
    facets_need need;
    const void *context;
    const facets *f;
    uint32_t *kept;
    size_t count;
} choice;

/* The end of a group of cells that are not needed; `item` if it has none. */
static size_t group_end(const facets *f, const choice *c, size_t item)
{
    facets_item all = {.piece = FACETS_MIXED};
    size_t end;
    const bool group = c->need && f->in.triangle_count == 0 &&
                       surface_cell_group(f->in.scan, item, &end, &all.centre, &all.radius);
    return group && !c->need(c->context, &all) ? end : item;
}

/* Chooses the items that have area, and are needed. */
static void choose_items(const facets *f, choice *c)
{
    const size_t all = facets_total(f);
    size_t group = 0; /* the end of the last group that was looked at */
    for (size_t k = 0; k < all; k++) {
        if (k >= group) {
            const size_t end = group_end(f, c, k);
            group = end;
            if (end > k) {
                k = end - 1;
                continue;
            }
        }
        const facets_item item = describe_item(f, (uint32_t)k);
        if (!(item.area > 0) || (c->need && !c->need(c->context, &item))) continue;
        c->kept[c->count++] = (uint32_t)k;
    }
}

static vec3 middle_of_kept(const void *context, size_t k)
{
    const choice *c = context;
    double radius;
    return item_sphere(c->f, c->kept[k], &radius);
}

/* The chosen items in Morton order of their middles. */
static bool order_items(facets *f, facets_need need, const void *context, threads *pool, error *e)
{
    const size_t all = facets_total(f);
    choice c = {need, context, f, mem_array(all, sizeof *c.kept, what, e), 0};
    bool ok = c.kept != NULL;
    if (ok) choose_items(f, &c);
    uint32_t *order = ok ? mem_array(c.count + 1, sizeof *order, what, e) : NULL;
    ok = order && (c.count == 0 || morton_order_of(middle_of_kept, &c, c.count, pool, order, e));
    for (size_t k = 0; ok && k < c.count; k++) order[k] = c.kept[order[k]];
    free(c.kept);
    f->item = order;
    f->item_count = ok ? c.count : 0;
    return ok && threads_may_go_on(pool, e);
}

typedef struct normal_job {
    facets *f;
    float *angle;
} normal_job;

static void normal_chunk(void *context, int worker, size_t begin, size_t end)
{
    const normal_job *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        field_cell cell;
        surface_cell(job->f->in.scan, job->f->item[k], &cell);
        const vec3 n = cell_normal(&cell);
        for (int i = 0; i < 3; i++) job->f->face_normal[k][i] = (float)vec3_get(n, i);
        job->angle[k] = job->f->in.scan->field->ops->cell_triangles ? (float)M_PI : CELL_ANGLE[cell.bend];
    }
}

static bool sum_areas(facets *f, error *e)
{
    f->piece_area = mem_array(f->piece_count, sizeof *f->piece_area, what, e);
    const size_t all = facets_total(f);
    for (size_t k = 0; f->piece_area && k < all; k++) {
        const double area = area_of_item(f, (uint32_t)k);
        f->piece_area[piece_of_item(f, (uint32_t)k)] += area;
        f->area += area;
    }
    if (f->piece_area && !(f->area > 0)) return error_set(e, ERROR_NO_SURFACE, "the surface has no area");
    return f->piece_area != NULL;
}

bool facets_open(const facets_input *in, facets *out, error *e)
{
    *out = (facets){.in = *in};
    return find_pieces(out, e) && sum_areas(out, e);
}

static void drop_hierarchy(facets *f)
{
    free(f->item);
    free(f->node);
    free(f->face_normal);
    f->item = NULL;
    f->node = NULL;
    f->face_normal = NULL;
    f->item_count = f->node_count = 0;
}

bool facets_build(facets *f, facets_need need, const void *context, threads *pool, error *e)
{
    drop_hierarchy(f);
    float *angle = NULL;
    bool ok = order_items(f, need, context, pool, e);
    if (ok && f->item_count == 0) return true;
    if (ok && f->in.triangle_count == 0) {
        f->face_normal = mem_array(f->item_count, sizeof *f->face_normal, what, e);
        angle = mem_array(f->item_count, sizeof *angle, what, e);
        ok = f->face_normal && angle;
        if (ok) threads_run(pool, f->item_count, 1024, normal_chunk, &(normal_job){f, angle});
    }
    if (ok) {
        const size_t leaves = (f->item_count + LEAF_ITEMS - 1) / LEAF_ITEMS;
        f->node = mem_array(2 * leaves, sizeof *f->node, what, e);
        ok = f->node != NULL;
    }
    if (ok) build_nodes(f, angle, pool, 0, (uint32_t)f->item_count);
    free(angle);
    return ok && threads_may_go_on(pool, e);
}

void facets_free(facets *f)
{
    drop_hierarchy(f);
    free(f->piece);
    free(f->piece_area);
    *f = (facets){0};
}

/* ---- triangles */

/* The normal of a triangle, out of the solid: the triangles of a scan have no consistent orientation. */
static vec3 oriented(const facets *f, size_t k, uint32_t patch, const vec3 corner[3], vec3 normal)
{
    const field *of = f->in.scan->field;
    field_sample s;
    vec3 out = face_normal_at(f, k);
    if (of->ops->cell_triangles &&
        field_sample_at(field_of_patch(of, patch), field_triangle_middle(corner), FIELD_GRADIENT, &s))
        out = s.gradient;
    return vec3_dot(out, normal) < 0 ? vec3_scale(normal, -1) : normal;
}

/* The corners of an item's triangles. Returns the number of triangles. */
static int item_corners(const facets *f, uint32_t item, bool exact, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    if (f->in.triangle_count == 0)
        return exact ? surface_cell_triangles(f->in.scan, item, out)
                     : surface_cell_rough_triangles(f->in.scan, item, out);
    mesh_corners(f, item, out[0]);
    return 1;
}

/* Sets `stretch`. It is 1 on smooth surfaces: triangles cut off nothing there, and the area in a single grid cell is that
 * of the surface in it, which its triangles can leave to the triangles of another cell. It is 1 in a cell that the domain
 * cuts, too: the triangles reach beyond the domain. */
static void set_stretch(const facets *f, size_t k, int count, facet *t)
{
    const field *of = f->in.triangle_count == 0 ? f->in.scan->field : NULL;
    bool whole = of != NULL && of->sharp;
    double sum = 0;
    for (int i = 0; i < count; i++) {
        sum += t[i].area;
        for (int c = 0; whole && of->open && c < 3; c++)
            whole = bbox_contains(of->boundary_box, t[i].corner[c]);
    }
    for (int i = 0; i < count; i++) t[i].stretch = whole ? sqrt(area_of_item(f, f->item[k]) / sum) : 1;
}

int facets_expand(const facets *f, size_t k, facet out[FIELD_CELL_TRIANGLES])
{
    const uint32_t item = f->item[k];
    vec3 corner[FIELD_CELL_TRIANGLES][3];
    const int count = item_corners(f, item, true, corner);
    int kept = 0;
    const uint32_t patch = patch_of_item(f, item), piece = piece_of_item(f, item);
    for (int t = 0; t < count; t++) {
        const vec3 cross = vec3_across(corner[t][0], corner[t][1], corner[t][2]);
        const double twice = vec3_norm(cross);
        if (!(twice > 0)) continue;
        facet *to = &out[kept++];
        for (int c = 0; c < 3; c++) to->corner[c] = corner[t][c];
        to->normal = vec3_scale(cross, 1 / twice);
        to->area = 0.5 * twice;
        to->patch = patch;
        to->piece = piece;
        to->item = k;
        if (f->face_normal) to->normal = oriented(f, k, patch, corner[t], to->normal);
    }
    set_stretch(f, k, kept, out);
    return kept;
}

facets_node facets_bound_triangles(const facets_item *item, int count, const facet *t)
{
    facets_node n = {
        .centre = item->centre, .radius = item->radius, .piece = t[0].piece, .patch = t[0].patch};
    vec3 sum = {0, 0, 0};
    for (int k = 0; k < count; k++) sum = vec3_add(sum, t[k].normal);
    set_axis(&n, sum);
    for (int k = 0; k < count; k++) widen_angle(&n, t[k].normal, 0);
    return n;
}

/* Moves x onto the surface of a scan. False, x unchanged: Newton's method finds no place within `reach`. */
static bool onto_surface(const facets *f, uint32_t patch, vec3 *x, double side, double reach)
{
    const projection_limits limits = projection_draft(side);
    vec3 place = *x, normal;
    if (!projection_find(field_of_patch(f->in.scan->field, patch), &limits, &place, &normal) ||
        vec3_norm(vec3_sub(place, *x)) > reach)
        return false;
    *x = place;
    return true;
}

vec3 facets_onto(const facets *f, const facet *of, vec3 x)
{
    if (f->in.triangle_count > 0) return x;
    const double side = sqrt(of->area);
    vec3 place = x;
    if (onto_surface(f, of->patch, &place, side, side) || f->in.scan->field->patches) return place;
    return surface_bisect(f->in.scan, f->item[of->item], x);
}

vec3 facets_middle(const facets *f, uint32_t patch, vec3 a, vec3 b)
{
    const double edge = vec3_norm(vec3_sub(b, a));
    vec3 middle = vec3_scale(vec3_add(a, b), 0.5);
    if (f->in.triangle_count == 0) onto_surface(f, patch, &middle, edge, MIDDLE_RISE * edge);
    return middle;
}

/* ---- queries */

/* A search for the nearest item. */
typedef struct item_search {
    const facets *f;
    vec3 x;
    double nearest;
    size_t found;
} item_search;

static double distance_to_sphere(vec3 centre, double radius, vec3 x)
{
    return vec3_norm(vec3_sub(centre, x)) - radius;
}

static bool is_beyond(const item_search *s, size_t k)
{
    double radius;
    const vec3 centre = item_sphere(s->f, s->f->item[k], &radius);
    return distance_to_sphere(centre, radius, s->x) >= s->nearest;
}

static void search_item(item_search *s, size_t k)
{
    const uint32_t item = s->f->item[k];
    vec3 corner[FIELD_CELL_TRIANGLES][3];
    const int count = item_corners(s->f, item, false, corner);
    for (int i = 0; i < count; i++) {
        const triangle at = {corner[i][0], corner[i][1], corner[i][2]};
        const double d = sqrt(triangle_distance2(&at, s->x));
        if (!(d < s->nearest) || !(vec3_norm2(vec3_across(corner[i][0], corner[i][1], corner[i][2])) > 0))
            continue;
        s->nearest = d;
        s->found = k;
    }
}

/* Pushes the children of a node; the nearer one is visited first. */
static int push_children(const facets *f, const facets_node *n, vec3 x, uint32_t *stack, int top)
{
    const uint32_t left = (uint32_t)(n - f->node) + 1;
    const bool left_first =
        vec3_norm2(vec3_sub(f->node[left].centre, x)) < vec3_norm2(vec3_sub(f->node[n->right].centre, x));
    stack[top++] = left_first ? n->right : left;
    stack[top++] = left_first ? left : n->right;
    return top;
}

/* Finds the nearest item that is nearer than `nearest`, if there is one. */
static void search_nodes(item_search *s)
{
    uint32_t stack[DEEPEST];
    int top = 0;
    stack[top++] = 0;
    while (top > 0) {
        const facets_node *n = &s->f->node[stack[--top]];
        if (distance_to_sphere(n->centre, n->radius, s->x) >= s->nearest) continue;
        if (n->right > 0) {
            top = push_children(s->f, n, s->x, stack, top);
            continue;
        }
        for (size_t k = n->begin; k < n->end; k++)
            if (!is_beyond(s, k)) search_item(s, k);
    }
}

/* A grid cell of a scan whose centre is nearest to x, or almost so. Its triangles bound the distance of the
 * nearest item closely, and the cells around it need not be expanded for that. */
static size_t near_cell(const facets *f, vec3 x)
{
    uint32_t stack[DEEPEST];
    int top = 0;
    /* distance of the nearest centre; upper bound of the distance of the nearest sphere's far side */
    double nearest = INFINITY, reach = INFINITY;
    size_t found = 0;
    stack[top++] = 0;
    while (top > 0) {
        const facets_node *n = &f->node[stack[--top]];
        if (distance_to_sphere(n->centre, n->radius, x) >= reach) continue;
        if (n->right > 0) {
            top = push_children(f, n, x, stack, top);
            continue;
        }
        for (size_t k = n->begin; k < n->end; k++) {
            double radius;
            const vec3 middle = item_sphere(f, f->item[k], &radius);
            const double distance = vec3_norm(vec3_sub(middle, x));
            if (distance >= nearest) continue;
            nearest = distance;
            reach = distance - radius;
            found = k;
        }
    }
    return found;
}

static item_search search_at(const facets *f, vec3 x)
{
    item_search s = {f, x, INFINITY, 0};
    if (f->in.triangle_count == 0) search_item(&s, near_cell(f, x));
    return s;
}

size_t facets_nearest(const facets *f, vec3 x)
{
    item_search s = search_at(f, x);
    search_nodes(&s);
    return s.found;
}

double facets_distance(const facets *f, vec3 x)
{
    item_search s = search_at(f, x);
    search_nodes(&s);
    return s.nearest;
}

/* ---- pieces of points on a scan with several pieces */

/* The cells of a scan, by their middles. */
typedef struct cells_near {
    const facets *f;
    vec3 *middle;
    double radius; /* the largest of all cells */
    cell_list *list;
} cells_near;

/* A search for the piece of a place, among the cells near it. */
typedef struct piece_search {
    const cells_near *in;
    vec3 x;
    size_t count;   /* of cells */
    uint32_t piece; /* of all of them, or FACETS_MIXED; of the nearest triangle */
    double nearest; /* distance of the nearest middle; later of the nearest triangle */
} piece_search;

static void look_at_cell(void *context, uint32_t k)
{
    piece_search *s = context;
    const uint32_t piece = piece_of_item(s->in->f, k);
    s->piece = s->count++ == 0 || s->piece == piece ? piece : FACETS_MIXED;
    s->nearest = fmin(s->nearest, vec3_norm(vec3_sub(s->in->middle[k], s->x)));
}

static void look_at_triangles(void *context, uint32_t k)
{
    piece_search *s = context;
    vec3 corner[FIELD_CELL_TRIANGLES][3];
    const int count = item_corners(s->in->f, k, false, corner);
    for (int i = 0; i < count; i++) {
        const triangle at = {corner[i][0], corner[i][1], corner[i][2]};
        const double d = sqrt(triangle_distance2(&at, s->x));
        if (!(d < s->nearest)) continue;
        s->nearest = d;
        s->piece = piece_of_item(s->in->f, k);
    }
}

/* The piece of the triangle that is nearest to x. Where all cells near x are of one piece, and one contains x, no
 * triangle is needed. */
static uint32_t find_piece(const cells_near *in, vec3 x)
{
    piece_search s;
    double reach = 3 * in->radius;
    do {
        s = (piece_search){.in = in, .x = x, .nearest = INFINITY};
        cell_list_within(in->list, x, reach, look_at_cell, &s);
        if (s.nearest <= in->radius && s.piece != FACETS_MIXED) return s.piece;
        s.nearest = INFINITY;
        cell_list_within(in->list, x, reach, look_at_triangles, &s);
        reach *= 2;
    } while (s.nearest > 0.5 * reach - in->radius && s.count < in->f->in.scan->cells);
    return s.piece == FACETS_MIXED ? 0 : s.piece;
}

typedef struct piece_job {
    const cells_near *in;
    const vec3 *x;
    uint32_t *piece;
} piece_job;

static void piece_chunk(void *context, int worker, size_t begin, size_t end)
{
    const piece_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) job->piece[i] = find_piece(job->in, job->x[i]);
}

bool facets_find_pieces(const facets *f, const vec3 *x, size_t count, threads *pool, uint32_t *piece,
                        error *e)
{
    const size_t cells = f->in.scan->cells;
    cells_near in = {.f = f, .middle = mem_array(cells, sizeof *in.middle, what, e)};
    for (size_t k = 0; in.middle && k < cells; k++) {
        double radius;
        in.middle[k] = item_sphere(f, (uint32_t)k, &radius);
        in.radius = fmax(in.radius, radius);
    }
    if (in.middle) in.list = cell_list_new(in.middle, cells, pool, e);
    const bool ok = in.list != NULL;
    if (ok) threads_run(pool, count, 256, piece_chunk, &(piece_job){&in, x, piece});
    cell_list_free(in.list);
    free(in.middle);
    return ok;
}

/* The edges at a corner, by their directions, with the number of faces at each. */
enum { MOST_EDGES = 256 };
typedef struct edge_fan {
    int count;
    vec3 direction[MOST_EDGES];
    int faces[MOST_EDGES];
} edge_fan;

static void add_edge(edge_fan *fan, vec3 direction)
{
    const vec3 d = vec3_unit(direction);
    int k = 0;
    while (k < fan->count && vec3_norm2(vec3_sub(fan->direction[k], d)) > 2 * SAME_DIRECTION) k++;
    if (k == MOST_EDGES) return;
    if (k == fan->count) {
        fan->direction[fan->count++] = d;
        fan->faces[k] = 0;
    }
    fan->faces[k]++;
}

static double angle_at(vec3 a, vec3 b)
{
    return elementary_atan2(vec3_norm(vec3_cross(a, b)), vec3_dot(a, b));
}

/* Adds the angle of one triangle at x, and its two edges there. */
static void add_face(const facet *t, vec3 x, double tolerance, edge_fan *fan, double *angle)
{
    const triangle at = {t->corner[0], t->corner[1], t->corner[2]};
    if (!(triangle_distance2(&at, x) <= tolerance * tolerance)) return;
    for (int k = 0; k < 3; k++) {
        const vec3 a = t->corner[k], to_b = vec3_sub(t->corner[(k + 1) % 3], a),
                   to_c = vec3_sub(t->corner[(k + 2) % 3], a);
        if (vec3_norm2(vec3_sub(x, a)) > tolerance * tolerance) continue;
        *angle += angle_at(to_b, to_c);
        add_edge(fan, to_b);
        add_edge(fan, to_c);
        return;
    }
    for (int k = 0; k < 3; k++) {
        const vec3 a = t->corner[k], side = vec3_sub(t->corner[(k + 1) % 3], a), to = vec3_sub(x, a);
        if (vec3_norm2(vec3_cross(side, to)) > tolerance * tolerance * vec3_norm2(side)) continue;
        *angle += M_PI;
        add_edge(fan, side);
        add_edge(fan, vec3_scale(side, -1));
        return;
    }
    *angle += 2 * M_PI;
}

void facets_corner_at(const facets *f, vec3 x, double tolerance, facets_corner *out)
{
    uint32_t stack[DEEPEST];
    int top = 0;
    edge_fan fan = {.count = 0};
    *out = (facets_corner){0};
    if (f->item_count > 0) stack[top++] = 0;
    while (top > 0) {
        const facets_node *n = &f->node[stack[--top]];
        if (distance_to_sphere(n->centre, n->radius, x) > tolerance) continue;
        if (n->right > 0) {
            stack[top++] = n->right;
            stack[top++] = (uint32_t)(n - f->node) + 1;
            continue;
        }
        for (size_t k = n->begin; k < n->end; k++) {
            facet t[FIELD_CELL_TRIANGLES];
            const int count = facets_expand(f, k, t);
            for (int i = 0; i < count; i++) add_face(&t[i], x, tolerance, &fan, &out->angle);
        }
    }
    for (int k = 0; k < fan.count; k++) {
        out->border |= fan.faces[k] == 1;
        out->fork |= fan.faces[k] > 2;
    }
}
