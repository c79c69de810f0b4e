// SPDX-License-Identifier: Apache-2.0
#include "surface/scan/components.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "surface/field/patches.h"
#include "geometry/space/affine.h"
#include "geometry/space/block_map.h"
#include "geometry/space/cell_list.h"

static const char what[] = "the surface's parts"; /* for messages about memory */

/* Maximum distance of the centres of two cells with a common face, in mean edge lengths, if their sizes
 * differ: for edges of 1 and 2 it is sqrt(1.5^2 + 0.5^2 + 0.5^2). */
static const double TOUCHING_UNEVEN = 1.106;

/* A position in a lattice is valid if its coordinates, in cells, differ from integers by at most CLEAR and do
 * not exceed LARGEST. */
static const double CLEAR = 0.25, LARGEST = 0x1p30;

enum { CHUNK = 1024 };
/* The lattice is stored in blocks of SIDE^3 positions. They are small, because most positions of a block
 * around a small droplet are empty. */
enum { SHIFT = 2, SIDE = 1 << SHIFT, BLOCK = SIDE * SIDE * SIDE };

/* Cells of one size, by their positions in a lattice. */
typedef struct lattice {
    const field *field;
    vec3 first;                       /* centre of the first cell, whose position is (0, 0, 0) */
    double to_cells[3][4];            /* converts offsets in world space to cells */
    atomic_bool has_invalid_position; /* a position is not valid: coordinates are too large */
    int32_t (*at)[3];                 /* per cell: its position */
    uint8_t *
        crossed_faces; /* per cell: the faces that the surface crosses; bit 2 axis + 1 is the face at the upper
                      * end */
    block_map map;     /* blocks that contain cells */
    uint32_t (*cell)[BLOCK]; /* per block and position: index of the cell + 1, or 0 */
    uint32_t *parent;
} lattice;

static void measure_lattice(lattice *l)
{
    field_cell cell;
    double edges[3][4] = {{0}};
    l->field->ops->cell(l->field, 0, &cell);
    l->first = field_cell_middle(&cell);
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < 3; i++)
            edges[i][axis] = vec3_get(vec3_sub(cell.corner[1 << axis], cell.corner[0]), i);
    affine_invert(edges, l->to_cells);
}

static void place_chunk(void *context, int worker, size_t begin, size_t end)
{
    lattice *l = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        field_cell cell;
        l->field->ops->cell(l->field, k, &cell);
        const vec3 middle = field_cell_middle(&cell), offset = vec3_sub(middle, l->first),
                   way = affine_apply(l->to_cells, offset.x, offset.y, offset.z);
        for (int axis = 0; axis < 3; axis++) {
            const double along = vec3_get(way, axis), whole = rint(along);
            if (fabs(along - whole) < CLEAR && fabs(whole) < LARGEST)
                l->at[k][axis] = (int32_t)whole;
            else
                atomic_store_explicit(&l->has_invalid_position, true, memory_order_relaxed);
        }
        l->crossed_faces[k] = (uint8_t)field_cell_passed_faces(&cell);
    }
}

/* The entry for a position in the lattice. NULL: its block has no cells. */
static uint32_t *find_place(const lattice *l, const int32_t at[3], block_map_seen *seen)
{
    const int mask = SIDE - 1;
    const uint32_t block = block_map_find_near(&l->map, at[0] >> SHIFT, at[1] >> SHIFT, at[2] >> SHIFT, seen);
    if (block == BLOCK_MAP_NONE) return NULL;
    return &l->cell[block][((at[0] & mask) * SIDE + (at[1] & mask)) * SIDE + (at[2] & mask)];
}

static bool store_positions(lattice *l, size_t cells, error *e)
{
    block_map_seen seen = {0};
    int32_t last[3] = {INT32_MAX, 0, 0};
    for (size_t k = 0; k < cells; k++) {
        const int32_t *at = l->at[k], block[3] = {at[0] >> SHIFT, at[1] >> SHIFT, at[2] >> SHIFT};
        if (memcmp(block, last, sizeof last) == 0) continue;
        if (!block_map_find_or_add(&l->map, block[0], block[1], block[2], NULL, e)) return false;
        memcpy(last, block, sizeof last);
    }
    l->cell = mem_array(l->map.count, sizeof *l->cell, what, e);
    for (size_t k = 0; l->cell && k < cells; k++) *find_place(l, l->at[k], &seen) = (uint32_t)k + 1;
    return l->cell != NULL;
}

/* Joins each cell with its neighbours beyond the faces that the surface crosses. Both cells of a face are
 * tested, because a crossing inside a face may be recorded in only one of them. */
static void join_chunk(void *context, int worker, size_t begin, size_t end)
{
    const lattice *l = context;
    block_map_seen seen = {0};
    (void)worker;
    for (size_t k = begin; k < end; k++)
        for (unsigned faces = l->crossed_faces[k]; faces; faces &= faces - 1) {
            const int face = __builtin_ctz(faces);
            int32_t at[3] = {l->at[k][0], l->at[k][1], l->at[k][2]};
            at[face >> 1] += face & 1 ? 1 : -1;
            const uint32_t *other = find_place(l, at, &seen);
            if (other && *other) sets_join_shared(l->parent, (uint32_t)k, *other - 1);
        }
}

/* Joins cells of equal size. all_placed: whether the positions of all cells in the lattice are valid. */
static bool join_even(const field *f, size_t cells, uint32_t *parent, threads *pool, bool *all_placed,
                      error *e)
{
    lattice l = {.field = f,
                 .at = mem_array(cells, sizeof *l.at, what, e),
                 .crossed_faces = mem_array(cells, sizeof *l.crossed_faces, what, e),
                 .parent = parent};
    bool ok = l.at && l.crossed_faces && block_map_init(&l.map, cells / SIDE / SIDE, e);
    if (ok) {
        measure_lattice(&l);
        threads_run(pool, cells, CHUNK, place_chunk, &l);
        *all_placed = !atomic_load(&l.has_invalid_position);
    }
    ok = ok && (threads_stopped(pool) || !*all_placed || store_positions(&l, cells, e));
    if (ok && *all_placed) threads_run(pool, cells, CHUNK, join_chunk, &l);
    ok = ok && threads_may_go_on(pool, e);
    free(l.at);
    free(l.crossed_faces);
    block_map_free(&l.map);
    free(l.cell);
    return ok;
}

/* Cells of different sizes, or with positions that are not valid. Cells near each other are joined, whether
 * or not the surface crosses their common face. */
typedef struct cell_set {
    const field *field;
    vec3 *middle;
    double *edge;
} cell_set;

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    const cell_set *c = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        field_cell cell;
        c->field->ops->cell(c->field, k, &cell);
        c->middle[k] = field_cell_middle(&cell);
        c->edge[k] = field_cell_edge(&cell);
    }
}

/* The cell for which neighbours are searched. */
typedef struct cell_joins {
    const cell_set *all;
    uint32_t *parent;
    uint32_t cell;
} cell_joins;

/* Joins a pair of cells; each pair is found from the larger one. */
static void join_near(void *context, uint32_t other)
{
    const cell_joins *j = context;
    const cell_set *c = j->all;
    const double reach = TOUCHING_UNEVEN * (c->edge[j->cell] + c->edge[other]) / 2;
    if (c->edge[other] > c->edge[j->cell]) return;
    if (vec3_norm(vec3_sub(c->middle[other], c->middle[j->cell])) < reach)
        sets_join_shared(j->parent, j->cell, other);
}

typedef struct uneven_joins {
    const cell_set *all;
    const cell_list *near;
    uint32_t *parent;
} uneven_joins;

static void join_near_chunk(void *context, int worker, size_t begin, size_t end)
{
    const uneven_joins *u = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        cell_joins of_cell = {u->all, u->parent, (uint32_t)k};
        cell_list_within(u->near, u->all->middle[k], TOUCHING_UNEVEN * u->all->edge[k], join_near, &of_cell);
    }
}

static bool join_uneven(const field *f, size_t cells, uint32_t *parent, threads *pool, error *e)
{
    cell_set all = {.field = f,
                    .middle = mem_array(cells, sizeof *all.middle, what, e),
                    .edge = mem_array(cells, sizeof *all.edge, what, e)};
    cell_list *near = NULL;
    bool ok = all.middle && all.edge;
    if (ok) {
        threads_run(pool, cells, CHUNK, look_chunk, &all);
        ok = threads_may_go_on(pool, e);
    }
    ok = ok && (near = cell_list_new(all.middle, cells, pool, e));
    if (ok) {
        threads_run(pool, cells, CHUNK, join_near_chunk, &(uneven_joins){&all, near, parent});
        ok = threads_may_go_on(pool, e);
    }
    cell_list_free(near);
    free(all.middle);
    free(all.edge);
    return ok;
}

static bool is_sorted(const uint32_t *part, size_t cells)
{
    bool sorted = true;
    for (size_t k = 1; sorted && k < cells; k++) sorted = part[k - 1] <= part[k];
    return sorted;
}

/* Sorts the cells by part. `part`: the part of each cell, less than out->count. */
static bool sort_cells(const uint32_t *part, size_t cells, components *out, error *e)
{
    out->begin = mem_array(out->count + 1, sizeof *out->begin, what, e);
    if (!out->begin) return false;
    for (uint32_t k = 0; k < cells; k++) out->begin[part[k] + 1]++;
    for (size_t c = 0; c < out->count; c++) out->begin[c + 1] += out->begin[c];
    if (is_sorted(part, cells)) return true;
    out->order = mem_array(cells, sizeof *out->order, what, e);
    if (!out->order) return false;
    for (uint32_t k = 0; k < cells; k++) out->order[out->begin[part[k]]++] = k;
    /* begin[c] has advanced to the end of part c */
    for (size_t c = out->count; c > 0; c--) out->begin[c] = out->begin[c - 1];
    out->begin[0] = 0;
    return true;
}

/* Numbers the parts in the order of their first cells. */
static bool number_cells(uint32_t *parent, size_t cells, components *out, error *e)
{
    uint32_t *part = mem_array(cells, sizeof *part, what, e), parts = 0;
    if (!part) return false;
    for (uint32_t k = 0; k < cells; k++) {
        uint32_t root = sets_root(parent, k);
        part[k] = root == k ? parts++ : part[root];
    }
    bool ok = sort_cells(part, cells, out, e);
    free(part);
    return ok;
}

static bool find_patches(const field *f, components *out, error *e)
{
    size_t cells = f->ops->cell_count(f);
    uint32_t *part = mem_array(cells, sizeof *part, what, e);
    bool ok = part != NULL;
    *out = (components){.count = f->patches->count};
    for (size_t k = 0; ok && k < cells; k++) {
        vec3 t[FIELD_CELL_TRIANGLES][3];
        if (f->ops->cell_triangles(f, k, t) > 0)
            part[k] = f->ops->patch_at(f, k, field_triangle_middle(t[0]));
    }
    ok = ok && sort_cells(part, cells, out, e);
    free(part);
    return ok;
}

bool components_find(const field *f, threads *pool, components *out, error *e)
{
    if (f->patches) return find_patches(f, out, e);
    const size_t cells = f->ops->cell_count(f);
    *out = (components){.count = 1};
    if (f->joined || cells == 0) return true;
    uint32_t *parent = mem_array(cells, sizeof *parent, what, e);
    if (!parent) return false;
    sets_reset(parent, cells);
    bool all_placed = false, ok = f->uneven || join_even(f, cells, parent, pool, &all_placed, e);
    if (ok && !all_placed) ok = join_uneven(f, cells, parent, pool, e);
    out->count = 0;
    for (size_t k = 0; ok && k < cells; k++) out->count += parent[k] == k;
    if (ok && out->count > 1) ok = number_cells(parent, cells, out, e);
    free(parent);
    return ok;
}

void components_free(components *c)
{
    free(c->order);
    free(c->begin);
    *c = (components){0};
}
