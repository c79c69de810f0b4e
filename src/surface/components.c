#include "surface/components.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/sets.h"
#include "field/patches.h"
#include "geometry/affine.h"
#include "packing/neighbours.h"

/* Cells that share a face have their middles this far apart, in cells; a little for rounding. */
static const double TOUCHING = 1.0 + 1e-6;
/* Cells of two sizes, 1 and 2, are up to sqrt(1.5^2 + 0.5^2 + 0.5^2) apart then, which is this much of the mean. */
static const double TOUCHING_UNEVEN = 1.106;

/* What is known of the cells: where they are, and how large or which of their faces the surface passes. */
typedef struct cell_set {
    const field *field;
    vec3 *middle;
    double *edge;          /* NULL: all cells are of one size */
    uint8_t *passed;       /* then by faces: bit 2 axis + 1 for that at the greater end; NULL else */
    double to_cells[3][4]; /* then from differences of places to numbers of cells along their edges */
} cell_set;

static void look_chunk(void *context, int worker, size_t begin, size_t end)
{
    const cell_set *c = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        field_cell cell;
        c->field->ops->cell(c->field, k, &cell);
        c->middle[k] = vec3_scale(vec3_add(cell.corner[0], cell.corner[7]), 0.5);
        if (c->edge) c->edge[k] = field_cell_edge(&cell);
        if (c->passed) c->passed[k] = (uint8_t)field_cell_passed_faces(&cell);
    }
}

static void measure_cells(cell_set *c)
{
    field_cell cell;
    double edges[3][4] = {{0}};
    c->field->ops->cell(c->field, 0, &cell);
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < 3; i++)
            edges[i][axis] = vec3_get(vec3_sub(cell.corner[1 << axis], cell.corner[0]), i);
    affine_invert(edges, c->to_cells);
}

/* Whether the surface passes from a cell to one near it: two sheets in cells side by side that it does not are apart. */
static bool passes(const cell_set *c, uint32_t from, uint32_t to)
{
    if (!c->passed) return true;
    const vec3 by = vec3_sub(c->middle[to], c->middle[from]),
               way = affine_apply(c->to_cells, by.x, by.y, by.z);
    int faces = 0, face = 0;
    for (int axis = 0; axis < 3; axis++) {
        const double along = vec3_get(way, axis);
        if (fabs(along) < 0.5) continue;
        if (fabs(along) > 1.5) return false; /* short cells: one between them shares the faces */
        face = 2 * axis + (along > 0);
        faces++;
    }
    return faces == 1 && (c->passed[from] >> face | c->passed[to] >> (face ^ 1)) & 1;
}

/* Joins what hangs together; every cell's root is its part's first cell. */
static size_t join(const cell_set *c, const neighbours *near, uint32_t *parent)
{
    size_t parts = near->count;
    sets_reset(parent, near->count);
    for (uint32_t k = 0; k < near->count; k++)
        for (uint32_t i = 0; i < near->list_count[k]; i++) {
            const uint32_t other = neighbours_list(near, k)[i];
            if (passes(c, k, other)) parts -= sets_join(parent, k, other);
        }
    return parts;
}

/* Sorts the cells by part: `part` of each, of out->count parts. */
static bool sort_cells(const uint32_t *part, size_t cells, components *out, error *e)
{
    out->order = mem_array(cells, sizeof *out->order, "the surface's parts", e);
    out->begin = mem_array(out->count + 1, sizeof *out->begin, "the surface's parts", e);
    if (!out->order || !out->begin) return false;
    for (uint32_t k = 0; k < cells; k++) out->begin[part[k] + 1]++;
    for (size_t c = 0; c < out->count; c++) out->begin[c + 1] += out->begin[c];
    for (uint32_t k = 0; k < cells; k++) out->order[out->begin[part[k]]++] = k;
    for (size_t c = out->count; c > 0; c--) out->begin[c] = out->begin[c - 1]; /* each had moved to its end */
    out->begin[0] = 0;
    return true;
}

/* Numbers the parts by their first cells. */
static bool number_cells(uint32_t *parent, size_t cells, components *out, error *e)
{
    uint32_t *part = mem_array(cells, sizeof *part, "the surface's parts", e), parts = 0;
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
    uint32_t *part = mem_array(cells, sizeof *part, "the surface's parts", e);
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
    const char *what = "the surface's parts";
    if (f->patches) return find_patches(f, out, e);
    size_t n = f->ops->cell_count(f);
    *out = (components){.count = 1};
    if (f->joined) return true;
    cell_set all = {.field = f,
                    .middle = mem_array(n, sizeof *all.middle, what, e),
                    .edge = f->uneven ? mem_array(n, sizeof *all.edge, what, e) : NULL,
                    .passed = f->uneven ? NULL : mem_array(n, sizeof *all.passed, what, e)};
    uint32_t *parent = mem_array(n, sizeof *parent, what, e);
    neighbours *near = neighbours_new(n, SIZE_MAX, e);
    bool ok = all.middle && (all.edge || all.passed) && parent && near;
    if (ok && n > 0 && all.passed) measure_cells(&all);
    if (ok) {
        threads_run(pool, n, 1024, look_chunk, &all);
        ok = !threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped");
    }
    if (ok)
        ok = neighbours_build(near, n, all.middle, all.edge,
                              f->uneven ? TOUCHING_UNEVEN : TOUCHING * f->cell_size, pool, e);
    if (ok) out->count = n > 0 ? join(&all, near, parent) : 1;
    neighbours_free(near);
    if (ok && out->count > 1) ok = number_cells(parent, n, out, e);
    free(parent);
    free(all.middle);
    free(all.edge);
    free(all.passed);
    return ok;
}

void components_free(components *c)
{
    free(c->order);
    free(c->begin);
    *c = (components){0};
}
