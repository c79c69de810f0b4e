#include "field/cell_grid.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"

/* Blocks are looked at cell by cell. */
enum { BLOCK = CELL_GRID_BLOCK, ROW = BLOCK + 1, SLAB = ROW * ROW };
/* Where F is smooth it is nearly linear in a cell: the values at opposite corners have one sum. Sums that differ
 * by more than this, in cells, are of a kink; and an edge in the cell is no farther from a corner than FARTHEST.
 */
static const double KINK = 0.1, FARTHEST = 1;
/* A cell is searched for an edge at so many places along each axis, corners included. */
enum { PLACES = 5 };
/* A crossing cell's number: its level from this bit on, and its linear index within the level below. */
enum { LEVEL_BIT = 58 };

typedef struct search {
    cell_grid *grid;
    int level;
    double cell; /* the size of the level's */
    const field *field;
    const cell_grid_oracle *oracle;
    size_t capacity;
    double *corners; /* ROW * SLAB values of the block at hand */
    threads *pool;   /* only to ask whether to stop */
} search;

/* Faces are exact, and what is beyond the last cell stands for its face. */
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

static void note_crossing(search *w, const int64_t at[3])
{
    cell_grid *g = w->grid;
    const int64_t x = g->cells[0] << w->level, y = g->cells[1] << w->level;
    if (g->count == w->capacity) {
        w->capacity = w->capacity ? 2 * w->capacity : 4096;
        g->crossing = mem_resize(g->crossing, w->capacity * sizeof *g->crossing);
    }
    g->crossing[g->count++] = (int64_t)w->level << LEVEL_BIT | ((at[2] * y + at[1]) * x + at[0]);
}

/* Whether an edge of the surface enters a cell that has one sign at its corners, the outermost of which are
 * `low` and `high`. */
static bool hides_edge(const search *w, const double *value, vec3 low, vec3 high)
{
    double cell = w->cell, nearest = INFINITY, least = INFINITY, most = -INFINITY;
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

static bool is_crossed(const search *w, const double *corners, const int64_t at[3])
{
    const cell_grid *g = w->grid;
    double value[8];
    int inside = 0;
    for (int v = 0; v < 8; v++) {
        value[v] = corners[(v & 1) + (v >> 1 & 1) * ROW + (v >> 2) * SLAB];
        inside += value[v] < 0;
    }
    if (inside > 0 && inside < 8) return true;
    return w->field->sharp && hides_edge(w, value, grid_corner(g, w->level, at[0], at[1], at[2]),
                                         grid_corner(g, w->level, at[0] + 1, at[1] + 1, at[2] + 1));
}

static void search_cells(search *w, const int64_t *first)
{
    const cell_grid *g = w->grid;
    int64_t last[3];
    for (int axis = 0; axis < 3; axis++) {
        const int64_t cells = g->cells[axis] << w->level;
        last[axis] = first[axis] + BLOCK < cells ? first[axis] + BLOCK : cells;
    }
    for (int k = 0; k <= BLOCK; k++)
        for (int j = 0; j <= BLOCK; j++)
            for (int i = 0; i <= BLOCK; i++)
                w->corners[(k * ROW + j) * ROW + i] = w->oracle->value(
                    w->field, grid_corner(g, w->level, first[0] + i, first[1] + j, first[2] + k));
    int64_t at[3];
    for (at[2] = first[2]; at[2] < last[2]; at[2]++)
        for (at[1] = first[1]; at[1] < last[1]; at[1]++)
            for (at[0] = first[0]; at[0] < last[0]; at[0]++) {
                const int64_t row = (at[2] - first[2]) * ROW + at[1] - first[1];
                if (is_crossed(w, w->corners + row * ROW + at[0] - first[0], at)) note_crossing(w, at);
            }
}

/* Blocks of `size` cells: those that the surface may pass are cut in eight, down to BLOCK. */
static void search_block(search *w, const int64_t *first, int64_t size)
{
    const cell_grid *g = w->grid;
    for (int axis = 0; axis < 3; axis++)
        if (first[axis] >= g->cells[axis]) return;
    if (g->count > CELL_GRID_MOST || threads_stopped(w->pool)) return;
    if (!w->oracle->may_cross(w->field, grid_corner(g, 0, first[0], first[1], first[2]),
                              grid_corner(g, 0, first[0] + size, first[1] + size, first[2] + size)))
        return;
    if (size == BLOCK) {
        search_cells(w, first);
        return;
    }
    for (int child = 0; child < 8; child++) {
        int64_t at[3];
        for (int axis = 0; axis < 3; axis++) at[axis] = first[axis] + (child >> axis & 1) * (size / 2);
        search_block(w, at, size / 2);
    }
}

static search begin_search(cell_grid *g, const field *f, const cell_grid_oracle *oracle, threads *pool)
{
    return (search){.grid = g,
                    .cell = f->cell_size,
                    .field = f,
                    .oracle = oracle,
                    .corners = mem_alloc(ROW * SLAB * sizeof(double)),
                    .pool = pool};
}

static bool end_search(search *w, error *e)
{
    free(w->corners);
    if (threads_stopped(w->pool)) return error_set(e, ERROR_CANCELLED, "stopped");
    if (w->grid->count <= CELL_GRID_MOST) return true;
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "the surface crosses more than %zu cells of size %g: it is too fine for its size",
                     CELL_GRID_MOST, w->field->cell_size);
}

bool cell_grid_search(cell_grid *g, const field *f, const cell_grid_oracle *oracle, threads *pool, error *e)
{
    search w = begin_search(g, f, oracle, pool);
    int64_t size = BLOCK;
    while (size < g->cells[0] || size < g->cells[1] || size < g->cells[2]) size *= 2;
    search_block(&w, (const int64_t[3]){0, 0, 0}, size);
    return end_search(&w, e);
}

/* A block of the level by its place among the blocks of that. */
static void search_marked(search *w, const uint8_t *const blocks[], int level, const int64_t at[3])
{
    const cell_grid *g = w->grid;
    for (int axis = 0; axis < 3; axis++)
        if (at[axis] >= cell_grid_blocks(g, level, axis)) return;
    const uint8_t mark =
        blocks[level]
              [(at[2] * cell_grid_blocks(g, level, 1) + at[1]) * cell_grid_blocks(g, level, 0) + at[0]];
    if (!mark || g->count > CELL_GRID_MOST || threads_stopped(w->pool)) return;
    if (mark & CELL_GRID_DIVIDE) {
        for (int k = 0; k < 8; k++)
            search_marked(
                w, blocks, level + 1,
                (const int64_t[3]){2 * at[0] + (k & 1), 2 * at[1] + (k >> 1 & 1), 2 * at[2] + (k >> 2)});
        return;
    }
    w->level = level;
    w->cell = ldexp(w->field->cell_size, g->finest - level);
    search_cells(w, (const int64_t[3]){BLOCK * at[0], BLOCK * at[1], BLOCK * at[2]});
}

bool cell_grid_search_blocks(cell_grid *g, const field *f, const cell_grid_oracle *oracle,
                             const uint8_t *const blocks[CELL_GRID_LEVELS], threads *pool, error *e)
{
    search w = begin_search(g, f, oracle, pool);
    for (int64_t z = 0; z < cell_grid_blocks(g, 0, 2); z++)
        for (int64_t y = 0; y < cell_grid_blocks(g, 0, 1); y++)
            for (int64_t x = 0; x < cell_grid_blocks(g, 0, 0); x++)
                search_marked(&w, blocks, 0, (const int64_t[3]){x, y, z});
    return end_search(&w, e);
}

/* The level of a crossing cell, and its place among the level's. */
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

void cell_grid_cell(const cell_grid *g, const field *f, const cell_grid_oracle *oracle, size_t index,
                    field_cell *out)
{
    int64_t at[3];
    const int level = find_place(g, index, at);
    out->grazed = false;
    for (int c = 0; c < 8; c++) {
        out->corner[c] = grid_corner(g, level, at[0] + (c & 1), at[1] + (c >> 1 & 1), at[2] + (c >> 2));
        out->value[c] = oracle->value(f, out->corner[c]);
    }
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
