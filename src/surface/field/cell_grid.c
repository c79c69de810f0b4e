// SPDX-License-Identifier: Apache-2.0
#include "surface/field/cell_grid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

enum { BLOCK = CELL_GRID_BLOCK, ROW = BLOCK + 1, SLAB = ROW * ROW };
/* Test for a sharp edge in a cell. Where F is smooth it is nearly linear: the sums of the values at opposite
 * corners are equal. A difference above KINK, in cell sizes, indicates a kink. An edge in the cell is at most
 * FARTHEST, in cell sizes, from a corner. */
static const double KINK = 0.1, FARTHEST = 1;
/* Places along each axis at which a cell is searched for a sharp edge, corners included. */
enum { PLACES = 5 };
/* The index of a crossing cell has its level in the bits from LEVEL_BIT, and its linear index within the
 * level below. */
enum { LEVEL_BIT = 58 };

/* Blocks in a chunk of work, and blocks that are sampled to estimate the number of crossing cells. */
enum { CHUNK = 32, PROBES = 512 };
/* Maximum cells along an axis: block indices have 32 bits. */
static const double LONGEST = 0x1p31;
/* Minimum cell size as a fraction of the coordinates: corners of smaller cells may coincide. */
static const double CELL_LEAST = 0x1p-40;

/* A block: its level and its index along each axis. */
typedef struct block {
    int level;
    int32_t at[3];
} block;

typedef struct search {
    cell_grid *grid;
    const field *field;
    const cell_grid_oracle *oracle;
    threads *pool; /* may be NULL */
    block *blocks; /* blocks that the surface may cross, in the order of their cells */
    size_t count, capacity;
} search;

/* The scan of a block, and the crossing cells found so far. */
typedef struct scan {
    const search *search;
    int level;
    double cell;     /* size of the level's cells, world units */
    double *corners; /* ROW * SLAB values */
    int64_t *crossing;
    size_t count, capacity;
} scan;

/* Corners on faces of the box are exact. Indices beyond the last cell give the face. */
static vec3 grid_corner(const cell_grid *g, int level, int64_t i, int64_t j, int64_t k)
{
    const int64_t at[3] = {i, j, k};
    vec3 corner = g->box.max, size = bbox_size(g->box);
    for (int axis = 0; axis < 3; axis++) {
        const int64_t cells = g->cells[axis] << level;
        if (at[axis] >= cells) continue;
        double from_min = vec3_get(size, axis) * (double)at[axis] / (double)cells;
        vec3_set(&corner, axis, vec3_get(g->box.min, axis) + from_min);
    }
    return corner;
}

/* F at `count` places. Unused lanes repeat the last place. */
static void values_at(const cell_grid_oracle *o, const field *f, const vec3 *place, int count, double *value)
{
    for (int done = 0; o->values && done < count; done += VEC3_LANES) {
        double all[VEC3_LANES];
        vec3_lanes x;
        const int left = count - done < VEC3_LANES ? count - done : VEC3_LANES;
        for (int l = 0; l < VEC3_LANES; l++) vec3_lanes_put(&x, l, place[done + (l < left ? l : left - 1)]);
        o->values(f, &x, all);
        memcpy(value + done, all, (size_t)left * sizeof *value);
    }
    for (int k = 0; !o->values && k < count; k++) value[k] = o->value(f, place[k]);
}

static void note_crossing(scan *l, const int64_t at[3])
{
    const cell_grid *g = l->search->grid;
    const int64_t x = g->cells[0] << l->level, y = g->cells[1] << l->level;
    if (l->count == l->capacity) {
        l->capacity = l->capacity ? 2 * l->capacity : 512;
        l->crossing = mem_resize(l->crossing, l->capacity * sizeof *l->crossing);
    }
    l->crossing[l->count++] = (int64_t)l->level << LEVEL_BIT | ((at[2] * y + at[1]) * x + at[0]);
}

/* Whether a sharp edge of the surface enters a cell whose corners all have one sign. `low`, `high`: its
 * extreme corners. */
static bool hides_edge(const scan *l, const double *value, vec3 low, vec3 high)
{
    const search *w = l->search;
    double cell = l->cell, nearest = INFINITY, least = INFINITY, most = -INFINITY;
    for (int v = 0; v < 4; v++) {
        double sum = value[v] + value[7 - v];
        least = fmin(least, sum);
        most = fmax(most, sum);
        nearest = fmin(nearest, fmin(fabs(value[v]), fabs(value[7 - v])));
    }
    if (nearest > FARTHEST * cell || most - least < KINK * cell) return false;
    vec3 size = vec3_sub(high, low);
    for (int n = 0; n < PLACES * PLACES * PLACES; n++) {
        vec3 at = {n % PLACES, n / PLACES % PLACES, n / PLACES / PLACES};
        vec3 x = {low.x + size.x * at.x / (PLACES - 1), low.y + size.y * at.y / (PLACES - 1),
                  low.z + size.z * at.z / (PLACES - 1)};
        if ((w->oracle->value(w->field, x) < 0) != (value[0] < 0)) return true;
    }
    return false;
}

static bool is_crossed(const scan *l, const double *corners, const int64_t at[3])
{
    const cell_grid *g = l->search->grid;
    double value[8];
    int inside = 0;
    for (int v = 0; v < 8; v++) {
        value[v] = corners[(v & 1) + (v >> 1 & 1) * ROW + (v >> 2) * SLAB];
        inside += value[v] < 0;
    }
    if (inside > 0 && inside < 8) return true;
    return l->search->field->sharp && hides_edge(l, value, grid_corner(g, l->level, at[0], at[1], at[2]),
                                                 grid_corner(g, l->level, at[0] + 1, at[1] + 1, at[2] + 1));
}

static void scan_block(scan *l, const block *b)
{
    const search *w = l->search;
    const cell_grid *g = w->grid;
    int64_t first[3], last[3];
    l->level = b->level;
    l->cell = ldexp(w->field->cell_size, g->finest - b->level);
    for (int axis = 0; axis < 3; axis++) {
        const int64_t cells = g->cells[axis] << b->level;
        first[axis] = (int64_t)BLOCK * b->at[axis];
        last[axis] = first[axis] + BLOCK < cells ? first[axis] + BLOCK : cells;
    }
    vec3 along[ROW], place[SLAB];
    for (int i = 0; i <= BLOCK; i++)
        along[i] = grid_corner(g, b->level, first[0] + i, first[1] + i, first[2] + i);
    for (int k = 0; k <= BLOCK; k++) {
        for (int n = 0; n < SLAB; n++) place[n] = (vec3){along[n % ROW].x, along[n / ROW].y, along[k].z};
        values_at(w->oracle, w->field, place, SLAB, l->corners + k * SLAB);
    }
    int64_t at[3];
    for (at[2] = first[2]; at[2] < last[2]; at[2]++)
        for (at[1] = first[1]; at[1] < last[1]; at[1]++)
            for (at[0] = first[0]; at[0] < last[0]; at[0]++) {
                const int64_t row = (at[2] - first[2]) * ROW + at[1] - first[1];
                if (is_crossed(l, l->corners + row * ROW + at[0] - first[0], at)) note_crossing(l, at);
            }
}

static bool too_fine(const search *w, error *e)
{
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "the surface crosses more than %zu cells of size %g: enlarge its thinnest part or "
                     "shortest period, shrink the rest, or sample the same shape as a mesh",
                     CELL_GRID_MOST, w->field->cell_size);
}

/* Checks that every cell has an index, and that its corners differ. */
static bool check_cells(const search *w, error *e)
{
    const cell_grid *g = w->grid;
    double most = 0, cells = 1, longest = 0, edge = w->field->cell_size;
    for (int axis = 0; axis < 3; axis++) {
        most = fmax(most, fmax(fabs(vec3_get(g->box.min, axis)), fabs(vec3_get(g->box.max, axis))));
        cells *= ldexp((double)g->cells[axis], g->finest);
        longest = fmax(longest, ldexp((double)g->cells[axis], g->finest));
    }
    if (!(edge > CELL_LEAST * most))
        return error_set(e, ERROR_NOT_SUPPORTED,
                         "cells of size %g are below the precision of coordinates of %g: enlarge the finest "
                         "part of the surface, or move it nearer to the origin",
                         edge, most);
    return (cells < 0x1p58 && longest < LONGEST) || too_fine(w, e);
}

/* Appends a block to the list. Does nothing if the list is at its limit. */
static void note_block(search *w, int level, const int64_t at[3])
{
    if (w->count > CELL_GRID_MOST / BLOCK) return;
    if (w->count == w->capacity) {
        w->capacity = w->capacity ? 2 * w->capacity : 256;
        w->blocks = mem_resize(w->blocks, w->capacity * sizeof *w->blocks);
    }
    w->blocks[w->count++] = (block){level, {(int32_t)at[0], (int32_t)at[1], (int32_t)at[2]}};
}

/* Divides a block of `size` cells that the surface may cross into eight, recursively down to BLOCK cells. */
static void divide_block(search *w, const int64_t *first, int64_t size)
{
    const cell_grid *g = w->grid;
    for (int axis = 0; axis < 3; axis++)
        if (first[axis] >= g->cells[axis]) return;
    if (w->count > CELL_GRID_MOST / BLOCK || threads_stopped(w->pool)) return;
    if (!w->oracle->may_cross(w->field, grid_corner(g, 0, first[0], first[1], first[2]),
                              grid_corner(g, 0, first[0] + size, first[1] + size, first[2] + size)))
        return;
    if (size == BLOCK) {
        note_block(w, 0, (const int64_t[3]){first[0] / BLOCK, first[1] / BLOCK, first[2] / BLOCK});
        return;
    }
    for (int child = 0; child < 8; child++) {
        int64_t at[3];
        for (int axis = 0; axis < 3; axis++) at[axis] = first[axis] + (child >> axis & 1) * (size / 2);
        divide_block(w, at, size / 2);
    }
}

/* The results of the chunks, one scan each. */
typedef struct scans {
    const search *search;
    scan *of;
    size_t size, stride; /* blocks per chunk; only every stride-th block is scanned */
} scans;

static void scan_chunk(void *context, int worker, size_t begin, size_t end)
{
    const scans *all = context;
    (void)worker;
    for (size_t chunk = begin; chunk < end; chunk++) {
        scan *l = &all->of[chunk];
        double corners[ROW * SLAB];
        l->search = all->search;
        l->corners = corners;
        for (size_t k = chunk * all->size;
             k < (chunk + 1) * all->size && k * all->stride < all->search->count; k++)
            scan_block(l, &all->search->blocks[k * all->stride]);
    }
}

/* Whether the list has more crossing cells than allowed: an estimate from some of its blocks, only for
 * long lists. */
static bool has_too_many(const search *w)
{
    scan probe = {0};
    scans all = {w, &probe, PROBES, w->count / PROBES};
    if (w->count > CELL_GRID_MOST / BLOCK) return true;
    if (w->count < CELL_GRID_MOST / (BLOCK * BLOCK * BLOCK)) return false;
    scan_chunk(&all, 0, 0, 1);
    free(probe.crossing);
    return (double)probe.count * (double)all.stride > 1.5 * (double)CELL_GRID_MOST;
}

/* Scans the listed blocks and frees the list. */
static bool search_list(search *w, error *e)
{
    cell_grid *g = w->grid;
    const size_t chunks = (w->count + CHUNK - 1) / CHUNK;
    scans all = {w, mem_alloc((chunks + 1) * sizeof *all.of), CHUNK, 1};
    bool ok = !has_too_many(w) || too_fine(w, e);
    if (ok) threads_run(w->pool, chunks, 1, scan_chunk, &all);
    ok = ok && threads_may_go_on(w->pool, e);
    size_t count = 0;
    for (size_t k = 0; k < chunks; k++) count += all.of[k].count;
    if (ok && count > CELL_GRID_MOST) ok = too_fine(w, e);
    if (ok && count > 0)
        ok = (g->crossing = mem_array(count, sizeof *g->crossing, "the cells that the surface crosses", e)) !=
             NULL;
    for (size_t k = 0; k < chunks; k++) {
        if (ok && all.of[k].count > 0) {
            memcpy(g->crossing + g->count, all.of[k].crossing, all.of[k].count * sizeof *g->crossing);
            g->count += all.of[k].count;
        }
        free(all.of[k].crossing);
    }
    free(all.of);
    free(w->blocks);
    return ok;
}

bool cell_grid_search(cell_grid *g, const field *f, const cell_grid_oracle *oracle, threads *pool, error *e)
{
    search w = {.grid = g, .field = f, .oracle = oracle, .pool = pool};
    if (!check_cells(&w, e)) return false;
    int64_t size = BLOCK;
    while (size < g->cells[0] || size < g->cells[1] || size < g->cells[2]) size *= 2;
    divide_block(&w, (const int64_t[3]){0, 0, 0}, size);
    return search_list(&w, e);
}

/* Processes a block of a level, and recursively its parts. */
static void divide_marked(search *w, const uint8_t *const blocks[], int level, const int64_t at[3])
{
    const cell_grid *g = w->grid;
    for (int axis = 0; axis < 3; axis++)
        if (at[axis] >= cell_grid_blocks(g, level, axis)) return;
    const uint8_t mark =
        blocks[level]
              [(at[2] * cell_grid_blocks(g, level, 1) + at[1]) * cell_grid_blocks(g, level, 0) + at[0]];
    if (!mark) return;
    if (!(mark & CELL_GRID_DIVIDE)) {
        note_block(w, level, at);
        return;
    }
    for (int k = 0; k < 8; k++)
        divide_marked(
            w, blocks, level + 1,
            (const int64_t[3]){2 * at[0] + (k & 1), 2 * at[1] + (k >> 1 & 1), 2 * at[2] + (k >> 2)});
}

bool cell_grid_search_blocks(cell_grid *g, const field *f, const cell_grid_oracle *oracle,
                             const uint8_t *const blocks[CELL_GRID_LEVELS], threads *pool, error *e)
{
    search w = {.grid = g, .field = f, .oracle = oracle, .pool = pool};
    if (!check_cells(&w, e)) return false;
    for (int64_t z = 0; z < cell_grid_blocks(g, 0, 2); z++)
        for (int64_t y = 0; y < cell_grid_blocks(g, 0, 1); y++)
            for (int64_t x = 0; x < cell_grid_blocks(g, 0, 0); x++)
                divide_marked(&w, blocks, 0, (const int64_t[3]){x, y, z});
    return search_list(&w, e);
}

/* Returns the level of a crossing cell. at: its index along each axis. */
static int find_place(const cell_grid *g, size_t index, int64_t at[3])
{
    const int level = (int)(g->crossing[index] >> LEVEL_BIT);
    const int64_t x = g->cells[0] << level, y = g->cells[1] << level,
                  linear = g->crossing[index] - ((int64_t)level << LEVEL_BIT);
    at[0] = linear % x;
    at[1] = linear / x % y;
    at[2] = linear / (x * y);
    return level;
}

/* The lowest and the highest corner of a crossing cell. */
static void find_corners(const cell_grid *g, size_t index, vec3 *low, vec3 *high)
{
    int64_t at[3];
    const int level = find_place(g, index, at);
    *low = grid_corner(g, level, at[0], at[1], at[2]);
    *high = grid_corner(g, level, at[0] + 1, at[1] + 1, at[2] + 1);
}

vec3 cell_grid_middle(const cell_grid *g, size_t index, double *radius)
{
    vec3 low, high;
    find_corners(g, index, &low, &high);
    const vec3 half = vec3_scale(vec3_sub(high, low), 0.5);
    *radius = vec3_norm(half);
    return vec3_add(low, half);
}

void cell_grid_cell(const cell_grid *g, const field *f, const cell_grid_oracle *oracle, size_t index,
                    field_cell *out)
{
    vec3 low, high;
    find_corners(g, index, &low, &high);
    out->hidden_crossing = false;
    out->bend = FIELD_BENT;
    for (int c = 0; c < 8; c++)
        out->corner[c] = (vec3){c & 1 ? high.x : low.x, c >> 1 & 1 ? high.y : low.y, c >> 2 ? high.z : low.z};
    values_at(oracle, f, out->corner, 8, out->value);
}

unsigned cell_grid_cut_faces(const cell_grid *g, const field *f, const cell_grid_oracle *oracle)
{
    unsigned faces = 0;
    for (size_t n = 0; n < g->count; n++) {
        int64_t at[3];
        const int level = find_place(g, n, at);
        for (int face = 0; face < 6; face++) {
            int axis = face >> 1, high = face & 1, inside = 0;
            field_cell cell;
            if (faces >> face & 1 || at[axis] != (high ? (g->cells[axis] << level) - 1 : 0)) continue;
            cell_grid_cell(g, f, oracle, n, &cell);
            for (int c = 0; c < 8; c++) inside += (c >> axis & 1) == high && cell.value[c] < 0;
            if (inside > 0 && inside < 4) faces |= 1u << face;
        }
    }
    return faces;
}

size_t cell_grid_bytes(const cell_grid *g)
{
    return g->count * sizeof *g->crossing;
}

void cell_grid_free(cell_grid *g)
{
    free(g->crossing);
    g->crossing = NULL;
    g->count = 0;
}
