#include "field/combination.h"

#include <stdlib.h>

#include "base/memory.h"
#include "field/cell_grid.h"

/* Of a cell: how far a surface may bulge out of the cells that it crosses. */
static const double BULGE = 0.5;
/* Cells along the longest side, at least: an edge where two parts meet is cut off in each cell that it
 * passes. At 32, as formulas have, the area of a sphere from which another is cut is 5e-3 too small. */
static const double CELLS_LONGEST = 192;
/* Where F is not defined no edge is near. The value there says so: it is farther, in cells, than edges are searched for. */
static const double FAR = 2;
/* Cells of a part whose slopes are averaged. */
enum { SLOPES = 256 };
/* Blocks of the finest cells that are marked one by one, in bytes: 256 MB. */
static const double MOST_BLOCKS = 1 << 28;

/* F = sense * min over parts of sign_k F_k / slope_k. */
typedef struct part {
    const field *field;
    double sign, slope;
    double edge; /* of its cells: the shortest */
} part;

struct combination {
    field base; /* first: the field's functions get this pointer */
    part *parts;
    size_t count;
    double sense;
    cell_grid grid;
};

static bool combination_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const combination *c = (const combination *)f;
    field_sample best = {.value = INFINITY}, s;
    double factor = 0;
    for (size_t k = 0; k < c->count; k++) {
        const part *p = &c->parts[k];
        double side = p->sign * p->field->ops->side(p->field, x);
        if (side > 0) continue;
        if (side < 0 || !field_sample_at(p->field, x, order, &s))
            return false; /* the least, and not defined */
        double value = p->sign * s.value / p->slope;
        if (!(value < best.value)) continue;
        best = s;
        best.value = value;
        factor = c->sense * p->sign / p->slope;
    }
    if (factor == 0) return false;
    out->value = c->sense * best.value;
    out->gradient = vec3_scale(best.gradient, factor);
    if (order == FIELD_HESSIAN) {
        const sym3 h = best.hessian;
        out->hessian =
            (sym3){factor * h.xx, factor * h.yy, factor * h.zz, factor * h.xy, factor * h.xz, factor * h.yz};
    }
    return true;
}

static double combination_side(const field *f, vec3 x)
{
    const combination *c = (const combination *)f;
    double least = INFINITY;
    for (size_t k = 0; k < c->count; k++) {
        double side = c->parts[k].sign * c->parts[k].field->ops->side(c->parts[k].field, x);
        if (side < least) least = side;
    }
    return c->sense * least;
}

/* F, or a value of its side. */
static double corner_value(const field *f, vec3 x)
{
    field_sample s;
    if (combination_sample(f, x, FIELD_GRADIENT, &s)) return s.value;
    return copysign(ldexp(FAR * f->cell_size, ((const combination *)f)->grid.finest), combination_side(f, x));
}

static const cell_grid_oracle oracle = {.value = corner_value};

static size_t combination_cell_count(const field *f)
{
    return ((const combination *)f)->grid.count;
}

static void combination_cell(const field *f, size_t k, field_cell *out)
{
    cell_grid_cell(&((const combination *)f)->grid, f, &oracle, k, out);
}

static const field_ops combination_ops = {.sample = combination_sample,
                                          .cell_count = combination_cell_count,
                                          .cell = combination_cell,
                                          .side = combination_side};

/* ---- making one */

static double slope_of(const field *f)
{
    size_t cells = f->ops->cell_count(f), step = cells / SLOPES + 1, count = 0;
    double sum = 0;
    for (size_t k = 0; k < cells; k += step) {
        field_cell cell;
        field_sample s;
        f->ops->cell(f, k, &cell);
        if (!field_sample_at(f, vec3_scale(vec3_add(cell.corner[0], cell.corner[7]), 0.5), FIELD_GRADIENT,
                             &s))
            continue;
        sum += vec3_norm(s.gradient);
        count++;
    }
    return sum > 0 ? sum / (double)count : 1;
}

static double shortest_edge(const field *f)
{
    field_cell cell;
    double edge = INFINITY;
    f->ops->cell(f, 0, &cell);
    for (int axis = 0; axis < 3; axis++)
        edge = fmin(edge, vec3_norm(vec3_sub(cell.corner[1 << axis], cell.corner[0])));
    return f->uneven ? edge * f->cell_size / field_cell_edge(&cell) : edge;
}

static void set_parts(combination *c, combination_kind kind, const field *const *parts)
{
    bbox surfaces = bbox_empty(), solid = field_solid_box(parts[0]);
    c->sense = kind == COMBINATION_UNION ? 1 : -1;
    for (size_t k = 0; k < c->count; k++) {
        double sign = kind == COMBINATION_INTERSECTION || (kind == COMBINATION_DIFFERENCE && k == 0) ? -1 : 1;
        c->parts[k] = (part){parts[k], sign, slope_of(parts[k]), shortest_edge(parts[k])};
        surfaces = bbox_unite(surfaces, parts[k]->domain);
        if (kind == COMBINATION_UNION) solid = bbox_unite(solid, field_solid_box(parts[k]));
        if (kind == COMBINATION_INTERSECTION) solid = bbox_common(solid, field_solid_box(parts[k]));
    }
    c->base.domain = bbox_common(surfaces, solid);
    field_set_solid_box(&c->base, solid);
}

static bool no_surface(combination_kind kind, error *e)
{
    static const char *const words[] = {"the union has no surface",
                                        "the intersection is empty: the solids do not meet",
                                        "the difference is empty: the others hold the first solid"};
    return error_set(e, ERROR_NO_SURFACE, "%s", words[kind]);
}

/* Cells of level 0 for the part with the widest, of the last for that with the shortest. The curves in which faces of the
 * domain cut the surface are put together of sides of cells: where there may be such, all cells are the shortest. */
static bool lay_out_grid(combination *c, error *e)
{
    const double most = bbox_longest(c->base.domain) / CELLS_LONGEST;
    double edge = most, widest = 0, blocks = 1;
    bool open = false;
    for (size_t k = 0; k < c->count; k++) {
        edge = fmin(edge, c->parts[k].edge);
        widest = fmax(widest, fmin(c->parts[k].edge, most));
        open |= c->parts[k].field->open;
    }
    while (!open && c->grid.finest < CELL_GRID_LEVELS - 1 && ldexp(edge, c->grid.finest + 1) <= widest)
        c->grid.finest++;
    vec3 size = bbox_size(c->base.domain);
    c->base.cell_size = edge;
    c->base.uneven = c->grid.finest > 0;
    c->base.extent = bbox_longest(c->base.domain);
    c->grid.box = c->base.domain;
    for (int axis = 0; axis < 3; axis++) {
        double cells = ceil(vec3_get(size, axis) / ldexp(edge, c->grid.finest));
        blocks *= ceil(ldexp(cells, c->grid.finest) / CELL_GRID_BLOCK);
        c->grid.cells[axis] = blocks <= MOST_BLOCKS ? (int64_t)cells : 0;
    }
    if (blocks <= MOST_BLOCKS) return true;
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "the combination is %g times as long as its finest part's cells, %g: make that part coarser",
        bbox_longest(c->base.domain) / edge, edge);
}

/* Marks the blocks of a level that a part's cells touch. */
static void mark_cells(const combination *c, const field *f, int level, uint8_t mark, uint8_t *blocks)
{
    const cell_grid *g = &c->grid;
    int64_t across[3];
    vec3 size = bbox_size(g->box);
    for (int axis = 0; axis < 3; axis++) across[axis] = cell_grid_blocks(g, level, axis);
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        field_cell cell;
        bbox box = bbox_empty();
        int64_t first[3], last[3];
        f->ops->cell(f, k, &cell);
        for (int corner = 0; corner < 8; corner++) box = bbox_include(box, cell.corner[corner]);
        box = bbox_grow(box, BULGE * field_cell_edge(&cell));
        for (int axis = 0; axis < 3; axis++) {
            double unit = CELL_GRID_BLOCK * vec3_get(size, axis) / (double)(g->cells[axis] << level),
                   low = vec3_get(g->box.min, axis);
            first[axis] =
                (int64_t)fmin(fmax(floor((vec3_get(box.min, axis) - low) / unit), 0), (double)across[axis]);
            last[axis] = (int64_t)fmin(fmax(floor((vec3_get(box.max, axis) - low) / unit), -1),
                                       (double)across[axis] - 1);
        }
        for (int64_t z = first[2]; z <= last[2]; z++)
            for (int64_t y = first[1]; y <= last[1]; y++)
                for (int64_t x = first[0]; x <= last[0]; x++)
                    blocks[(z * across[1] + y) * across[0] + x] |= mark;
    }
}

/* Divides the parents of the blocks round each divided one of `level`, and of itself: what touches then is of this level or
 * finer, or one coarser. */
static void divide_around(const cell_grid *g, int level, const uint8_t *blocks, uint8_t *parents)
{
    int64_t across[3], above[2];
    for (int axis = 0; axis < 3; axis++) across[axis] = cell_grid_blocks(g, level, axis);
    for (int axis = 0; axis < 2; axis++) above[axis] = cell_grid_blocks(g, level - 1, axis);
    for (int64_t n = 0; n < across[0] * across[1] * across[2]; n++) {
        if (!(blocks[n] & CELL_GRID_DIVIDE)) continue;
        const int64_t at[3] = {n % across[0], n / across[0] % across[1], n / across[0] / across[1]};
        for (int way = 0; way < 27; way++) {
            const int64_t by[3] = {at[0] + way % 3 - 1, at[1] + way / 3 % 3 - 1, at[2] + way / 9 - 1};
            if (by[0] < 0 || by[1] < 0 || by[2] < 0 || by[0] >= across[0] || by[1] >= across[1] ||
                by[2] >= across[2])
                continue;
            parents[(by[2] / 2 * above[1] + by[1] / 2) * above[0] + by[0] / 2] |= CELL_GRID_DIVIDE;
        }
    }
}

/* Blocks that a part's cells touch are searched, in cells as small as the part's. */
static void mark_parts(const combination *c, uint8_t *const blocks[])
{
    const int finest = c->grid.finest;
    for (size_t k = 0; k < c->count; k++) {
        int own = 0;
        while (own < finest && ldexp(c->base.cell_size, finest - own) > c->parts[k].edge) own++;
        for (int level = 0; level <= finest; level++)
            mark_cells(c, c->parts[k].field, level,
                       level < own ? CELL_GRID_SEARCH | CELL_GRID_DIVIDE : CELL_GRID_SEARCH, blocks[level]);
    }
    for (int level = finest - 1; level > 0; level--)
        divide_around(&c->grid, level, blocks[level], blocks[level - 1]);
}

static bool find_cells(combination *c, threads *pool, error *e)
{
    uint8_t *blocks[CELL_GRID_LEVELS] = {NULL};
    bool ok = true;
    for (int level = 0; ok && level <= c->grid.finest; level++) {
        size_t count = 1;
        for (int axis = 0; axis < 3; axis++) count *= (size_t)cell_grid_blocks(&c->grid, level, axis);
        ok = (blocks[level] = mem_array(count, 1, "the blocks of the combination", e));
    }
    if (ok) mark_parts(c, blocks);
    ok = ok && cell_grid_search_blocks(&c->grid, &c->base, &oracle, (const uint8_t *const *)blocks, pool, e);
    for (int level = 0; level <= c->grid.finest; level++) free(blocks[level]);
    return ok;
}

/* Whether the plane through a face of an open part's domain, which is no face of the whole's, meets the
 * surface. */
static bool is_cut_at(const combination *c, const part *p, int face)
{
    int axis = face >> 1;
    double at = vec3_get(face & 1 ? p->field->boundary_box.max : p->field->boundary_box.min, axis);
    if (!isfinite(at) || at == vec3_get(face & 1 ? c->base.domain.max : c->base.domain.min, axis))
        return false;
    for (size_t k = 0; k < c->grid.count; k++) {
        field_cell cell;
        combination_cell(&c->base, k, &cell);
        if (vec3_get(cell.corner[0], axis) <= at && vec3_get(cell.corner[7], axis) >= at) return true;
    }
    return false;
}

/* Whether the data of a part end where it is solid, in a cell of the whole: of its corners some are inside of the part and some
 * outside, and none is near its surface. */
static bool ends_in_a_cell(const combination *c, const part *p)
{
    const vec3 beyond = vec3_add(p->field->solid_below, p->field->solid_above);
    if (!(beyond.x + beyond.y + beyond.z > 0)) return false;
    for (size_t k = 0; k < c->grid.count; k++) {
        field_cell cell;
        bool near = false, inside = false, outside = false;
        combination_cell(&c->base, k, &cell);
        for (int corner = 0; corner < 8; corner++) {
            const double side = p->field->ops->side(p->field, cell.corner[corner]);
            near |= side == 0;
            inside |= side < 0;
            outside |= side > 0;
        }
        if (inside && outside && !near) return true;
    }
    return false;
}

static bool check_boundaries(const combination *c, error *e)
{
    for (size_t k = 0; k < c->count; k++) {
        bool ends = ends_in_a_cell(c, &c->parts[k]);
        for (int face = 0; c->parts[k].field->open && face < 6; face++)
            ends = ends || is_cut_at(c, &c->parts[k], face);
        if (ends)
            return error_set(
                e, ERROR_NOT_SUPPORTED,
                "part %zu of the combination is open and ends within it: only what lies inside of its "
                "domain can be combined with it (intersect it with a box first)",
                k);
    }
    return true;
}

combination *combination_new(combination_kind kind, const field *const *parts, size_t count, threads *pool,
                             error *e)
{
    combination *c = mem_alloc(sizeof *c);
    c->base.ops = &combination_ops;
    c->base.sharp = true;
    c->parts = mem_alloc(count * sizeof *c->parts);
    c->count = count;
    set_parts(c, kind, parts);
    vec3 size = bbox_size(c->base.domain);
    bool some = size.x > 0 && size.y > 0 && size.z > 0;
    bool ok = some && lay_out_grid(c, e) && find_cells(c, pool, e);
    if (!some || (ok && c->grid.count == 0)) ok = no_surface(kind, e);
    if (ok) {
        field_set_boundary(&c->base, cell_grid_cut_faces(&c->grid, &c->base, &oracle));
        ok = check_boundaries(c, e);
    }
    if (ok) return c;
    combination_free(c);
    return NULL;
}

void combination_free(combination *c)
{
    if (!c) return;
    cell_grid_free(&c->grid);
    free(c->parts);
    free(c);
}

const field *combination_field(const combination *c)
{
    return &c->base;
}

size_t combination_bytes(const combination *c)
{
    return cell_grid_bytes(&c->grid);
}
