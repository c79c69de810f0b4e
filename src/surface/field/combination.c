// SPDX-License-Identifier: Apache-2.0
#include "surface/field/combination.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/packing.h"
#include "surface/field/cell_grid.h"

/* In cell sizes: distance by which a surface may extend beyond the cells that it crosses. */
static const double BULGE = 0.5;
/* If a cell of a part is at least this many blocks wide, blocks that the surface of the part does not cross
 * are discarded. */
enum { SMALL = 4 };
/* Minimum cells along the longest side. A sharp edge is cut off in each cell that it crosses: with 32 cells,
 * as for formulas, the area of a sphere minus a sphere is up to 5e-3 wrong, with 96 2e-4, with 192 4e-5. Few
 * points need FEWEST_LONGEST, or CELLS_PER_SPACING along their spacing, up to CELLS_LONGEST. */
static const double CELLS_LONGEST = 192, FEWEST_LONGEST = 96, CELLS_PER_SPACING = 12;
/* Area in squares of the longest side, for the spacing of a number of points. A sphere has 3.1, a cube 6; a
 * smaller value gives smaller cells. */
static const double USUAL_AREA = 2;
/* Value, in cell sizes, where F is not defined. No edge is near there: it exceeds the distance at which edges
 * are searched. */
static const double FAR = 2;
/* Number of cells of a part over which the slope is averaged. */
enum { SLOPES = 256 };
/* Cells of a part that are wider than this, in cells of the combination, have eight sample places instead
 * of one. */
static const double WIDE = 1.5;
/* Maximum number of blocks of the finest cells, one byte each: 256 MB. */
static const double MOST_BLOCKS = 1 << 28;

/* Two surfaces are opposite if the cosine of their outward normals is less than FACING. They then meet, if at
 * all, in edges sharper than 18 degrees; blunter edges are cut off by at most three cells. They are separate
 * if their distance exceeds APART times the longest side: coincident faces bound nothing. */
static const double FACING = -0.95, APART = 1e-6;
/* Near the sharp edge of a wedge, within BESIDE_EDGE cells (of the size without walls), the thickness that
 * cells must resolve is reduced to the fraction SEEN_AT_EDGE: a cell that an edge enters is searched for it.
 * Otherwise each halving near the edge of a wedge would double the cells for half of the area. */
static const double BESIDE_EDGE = 4, SEEN_AT_EDGE = 0.25;
/* CELL_IN_WALL: cell size as a fraction of the thickness of a wall. Errors of the area of a shell: 1e-6; 2e-3
 * at 0.6, 3e-2 at 0.7. Halving ends at MOST_IN_WALLS cells, at the memory limit with BYTES_IN_WALL for each
 * cell, or if less than THIN_SHARE of the area is in thinner walls: a wedge has some of any thickness. */
static const double CELL_IN_WALL = 0.55, MOST_IN_WALLS = 8e6, BYTES_IN_WALL = 128, THIN_SHARE = 0.005;

/* A place on the surface of a part: the thickness to the opposite surface (see thickness_at), its variation
 * within the place, and the area of the place. World units. */
typedef struct wall {
    float thickness, spread, area;
} wall;

/* F of the combination = sense * min over parts k of sign_k F_k / slope_k; slope: mean |grad F_k| on the
 * part's surface. */
typedef struct part {
    const field *field;
    double sign, slope;
    double edge; /* edge of its smallest cells */
    int places;  /* sample places per cell: 1, or 8 in cells much wider than those of the combination */
    wall *walls; /* one per place, sorted by cell; NULL: not computed */
} part;

struct combination {
    field base; /* first: the field's functions get this pointer */
    part *parts;
    size_t count;
    double sense;
    double missing, area; /* see combination_missing */
    double reach;         /* distance from a sharp edge within which SEEN_AT_EDGE applies */
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
            return false; /* this part has the minimum and is not defined */
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

/* F, or a value of the right sign. */
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

static vec3 combination_cell_middle(const field *f, size_t k, double *radius)
{
    return cell_grid_middle(&((const combination *)f)->grid, k, radius);
}

static const field_ops combination_ops = {.sample = combination_sample,
                                          .cell_count = combination_cell_count,
                                          .cell = combination_cell,
                                          .cell_middle = combination_cell_middle,
                                          .side = combination_side};

/* ---- construction */

static double slope_of(const field *f)
{
    size_t cells = f->ops->cell_count(f), step = cells / SLOPES + 1, count = 0;
    double sum = 0;
    for (size_t k = 0; k < cells; k += step) {
        field_cell cell;
        field_sample s;
        f->ops->cell(f, k, &cell);
        if (!field_sample_at(f, field_cell_middle(&cell), FIELD_GRADIENT, &s)) continue;
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
        c->parts[k] = (part){parts[k], sign, slope_of(parts[k]), shortest_edge(parts[k]), 1, NULL};
        surfaces = bbox_unite(surfaces, parts[k]->domain);
        if (kind == COMBINATION_UNION) solid = bbox_unite(solid, field_solid_box(parts[k]));
        if (kind == COMBINATION_INTERSECTION) solid = bbox_common(solid, field_solid_box(parts[k]));
    }
    c->base.domain = bbox_common(surfaces, solid);
    field_set_solid_box(&c->base, solid);
}

static bool no_surface(combination_kind kind, error *e)
{
    static const char *const words[] = {
        "the union is empty: correct its parts",
        "the intersection is empty, because the solids do not overlap: move or enlarge them",
        "the difference is empty, because the first solid is inside the others: move or "
        "enlarge it"};
    return error_set(e, ERROR_NO_SURFACE, "%s", words[kind]);
}

static bool has_open_part(const combination *c)
{
    bool open = false;
    for (size_t k = 0; k < c->count; k++) open |= c->parts[k].field->open;
    return open;
}

/* The maximum cell size. For the arguments see combination_new. */
static double largest_cell(double longest, double spacing, double points)
{
    if (!(spacing > 0) && points > 0) spacing = packing_spacing(USUAL_AREA * longest * longest, points);
    return fmin(fmax(spacing / CELLS_PER_SPACING, longest / CELLS_LONGEST), longest / FEWEST_LONGEST);
}

/* Level 0 is for the part with the widest cells, the last level for the part with the smallest. The curves in
 * which faces of the domain cut the surface consist of sides of cells: if there may be any, all cells have
 * the smallest size. */
static bool lay_out_grid(combination *c, double spacing, double points, error *e)
{
    const double most = largest_cell(bbox_longest(c->base.domain), spacing, points);
    double edge = most, widest = 0, blocks = 1;
    const bool open = has_open_part(c);
    for (size_t k = 0; k < c->count; k++) {
        edge = fmin(edge, c->parts[k].edge);
        widest = fmax(widest, fmin(c->parts[k].edge, most));
    }
    while (!open && c->grid.finest < CELL_GRID_LEVELS - 1 && ldexp(edge, c->grid.finest + 1) <= widest)
        c->grid.finest++;
    vec3 size = bbox_size(c->base.domain);
    c->base.cell_size = edge;
    c->base.uneven = c->grid.finest > 0;
    c->base.extent = bbox_longest(c->base.domain);
    c->reach = BESIDE_EDGE * edge;
    c->grid.box = c->base.domain;
    for (int axis = 0; axis < 3; axis++) {
        double cells = ceil(vec3_get(size, axis) / ldexp(edge, c->grid.finest));
        blocks *= ceil(ldexp(cells, c->grid.finest) / CELL_GRID_BLOCK);
        c->grid.cells[axis] = blocks <= MOST_BLOCKS ? (int64_t)cells : 0;
    }
    if (blocks <= MOST_BLOCKS) return true;
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "the combination is %g times as long as the cells of its finest part, %g: make that "
                     "part coarser",
                     bbox_longest(c->base.domain) / edge, edge);
}

/* ---- walls and gaps thinner than cells: their two surfaces belong to different parts, and the cells of each
 * part resolve its own surface */

/* *away: distance of x from the surface of a part, negative if the part covers x. *outward: the outward
 * normal of the combination there. False: the part is not defined. */
static bool find_side(const combination *c, const part *p, vec3 x, double *away, vec3 *outward)
{
    field_sample s;
    if (!field_sample_at(p->field, x, FIELD_GRADIENT, &s)) return false;
    const double slope = vec3_norm(s.gradient);
    if (!(slope > 0)) return false;
    *away = p->sign * s.value / slope;
    *outward = vec3_scale(s.gradient, c->sense * p->sign / slope);
    return true;
}

/* Projects x, near the surface of a part, onto that surface. False: it failed. */
static bool project_to_part(const combination *c, const part *own, vec3 *x, vec3 *outward)
{
    double away;
    for (int step = 0; step < 3; step++) {
        if (!find_side(c, own, *x, &away, outward)) return false;
        *x = vec3_axpy(-away * c->sense, *outward, *x);
    }
    return true;
}

/* The thickness at x: the distance from the surface of a part near x to the closest opposite surface of
 * another part. FLT_MAX: there is none. INFINITY: the surface at x does not belong to the
 * combination. *slope: the derivative of the thickness along the surface. *cover: the opposite part that
 * covers the surface there, or NULL. */
static double thickness_at(const combination *c, const part *own, vec3 x, double *slope, const part **cover)
{
    const double apart = APART * bbox_longest(c->base.domain);
    double thickness = FLT_MAX, away = 0;
    vec3 outward, other;
    *slope = 0;
    *cover = NULL;
    if (!project_to_part(c, own, &x, &outward)) return INFINITY;
    for (const part *p = c->parts; p < c->parts + c->count; p++) {
        const double side = p == own ? 1 : p->sign * p->field->ops->side(p->field, x);
        if (side < 0) return INFINITY;
        if (side > 0 || !find_side(c, p, x, &away, &other)) continue;
        const double cosine = vec3_dot(outward, other);
        if (away < -apart) {
            *cover = cosine < FACING ? p : NULL;
            return INFINITY;
        }
        if (!(away > apart && away < thickness && cosine < FACING)) continue;
        thickness = away;
        *slope = sqrt(fmax(1 - cosine * cosine, 0));
    }
    return thickness;
}

/* Projects *x onto the surface of `own`. *away: the distance of the opposite surface from it, negative if the
 * opposite part covers it. *rise: its gradient along the surface. */
static bool find_rise(const combination *c, const part *own, const part *facing, vec3 *x, double *away,
                      vec3 *rise)
{
    vec3 outward, other;
    if (!project_to_part(c, own, x, &outward) || !find_side(c, facing, *x, away, &other)) return false;
    *rise = vec3_scale(vec3_axpy(-vec3_dot(outward, other), outward, other), c->sense);
    return true;
}

/* The wall of a place whose centre is covered, but which may be partly uncovered, as at a lens narrower than
 * the place. The wall is at the maximum of the thickness, where the linearly extrapolated gradient is 0.
 * `most`: the area of the place. */
static wall wall_at_top(const combination *c, const part *own, const part *cover, vec3 x, double edge,
                        double most)
{
    const wall none = {INFINITY, 0, (float)most};
    const double reach = 0.5 * sqrt(3) * edge;
    double away, slope;
    vec3 rise, beyond;
    if (!find_rise(c, own, cover, &x, &away, &rise) || !((slope = vec3_norm(rise)) > 0) ||
        -away > reach * slope)
        return none;
    const vec3 way = vec3_scale(rise, 1 / slope);
    vec3 there = vec3_axpy(reach, way, x);
    if (!find_rise(c, own, cover, &there, &away, &beyond)) return none;
    const double bend = (slope - vec3_dot(beyond, way)) / reach;
    if (!(bend * reach > slope)) return none; /* other places contain it */
    const double thickness = thickness_at(c, own, vec3_axpy(slope / bend, way, x), &slope, &cover);
    if (!(thickness < FLT_MAX)) return none;
    /* area of the cap of a paraboloid with this height and curvature */
    const double cap = 2 * M_PI * thickness / bend;
    return (wall){(float)(0.5 * thickness), (float)thickness, (float)fmin(cap, most)};
}

typedef struct wall_job {
    const combination *c;
    part *own;
} wall_job;

/* Place v of a cell: its centre, or the centre of an eighth. */
static vec3 place_of(const part *p, const field_cell *cell, int v)
{
    const vec3 middle = field_cell_middle(cell);
    return p->places > 1 ? vec3_axpy(0.5, vec3_sub(cell->corner[v], middle), middle) : middle;
}

static void wall_chunk(void *context, int worker, size_t begin, size_t end)
{
    const wall_job *job = context;
    part *own = job->own;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        field_cell cell;
        own->field->ops->cell(own->field, k, &cell);
        const double edge = field_cell_edge(&cell);
        for (int v = 0; v < own->places; v++) {
            wall *w = &own->walls[k * (size_t)own->places + (size_t)v];
            const vec3 place = place_of(own, &cell, v);
            const double across = edge / (own->places > 1 ? 2 : 1), area = edge * edge / own->places;
            const part *cover;
            double slope;
            const double thickness = thickness_at(job->c, own, place, &slope, &cover);
            *w = cover ? wall_at_top(job->c, own, cover, place, across, area)
                       : (wall){(float)thickness, (float)(slope * across), (float)area};
        }
    }
}

static size_t places_of(const part *p)
{
    return p->field->ops->cell_count(p->field) * (size_t)p->places;
}

static bool find_walls(combination *c, threads *pool, error *e)
{
    for (part *p = c->parts; p < c->parts + c->count; p++) {
        p->places = p->edge > WIDE * c->base.cell_size ? 8 : 1;
        p->walls = mem_array(places_of(p), sizeof *p->walls, "the walls of the combination", e);
        if (!p->walls) return false;
        threads_run(pool, p->field->ops->cell_count(p->field), 512, wall_chunk, &(wall_job){c, p});
        if (!threads_may_go_on(pool, e)) return false;
    }
    return true;
}

/* The cell size that resolves the wall at a place, at least `least`. */
static double size_at(const part *p, size_t place, double least)
{
    return p->walls ? fmax(fmin(p->edge, CELL_IN_WALL * p->walls[place].thickness), least) : p->edge;
}

/* The number of cells that the surfaces in walls need, with sizes of at least `least`. */
static double cells_in_walls(const combination *c, double least)
{
    double count = 0;
    for (const part *p = c->parts; p < c->parts + c->count; p++)
        for (size_t k = 0; k < places_of(p); k++) {
            const double size = size_at(p, k, least);
            if (size < p->edge) /* cells that a plane crosses per cell area: mean over orientations */
                count += 1.5 * p->walls[k].area / (size * size);
        }
    return count;
}

/* The fraction of a place in walls thinner than `thinner`. `reach`: see combination. */
static double share_of_place(const wall *w, double thinner, double reach)
{
    if (w->thickness * sqrt(w->area) < reach * w->spread) thinner *= SEEN_AT_EDGE;
    const double low = fmax(w->thickness - 0.5 * w->spread, 0), high = w->thickness + 0.5 * w->spread;
    if (!(low < thinner)) return 0;
    return high > thinner ? (thinner - low) / (high - low) : 1;
}

/* The fraction of the surface in walls thinner than `thinner`. *area (or NULL): the approximate total
 * area. */
static double share_in_walls(const combination *c, double thinner, double *area)
{
    double all = 0, thin = 0;
    for (const part *p = c->parts; p < c->parts + c->count; p++)
        for (size_t k = 0; k < places_of(p); k++) {
            if (p->walls[k].thickness < INFINITY) all += p->walls[k].area;
            thin += share_of_place(&p->walls[k], thinner, c->reach) * p->walls[k].area;
        }
    if (area) *area = all;
    return thin > 0 ? thin / all : 0;
}

static double blocks_of(const cell_grid *g, int finest)
{
    double blocks = 1;
    for (int axis = 0; axis < 3; axis++)
        blocks *= ceil(ldexp((double)g->cells[axis], finest) / CELL_GRID_BLOCK);
    return blocks;
}

/* Adds at most `levels` levels of cells, until walls are thicker than cells. Adds none if most of the thin
 * area would remain. */
static void resolve_walls(combination *c, int levels, size_t memory)
{
    const double before = share_in_walls(c, c->base.cell_size / CELL_IN_WALL, NULL),
                 most = fmin(MOST_IN_WALLS, (double)memory / BYTES_IN_WALL);
    double size = c->base.cell_size, left = before;
    int finest = c->grid.finest;
    const int last = finest + levels < CELL_GRID_LEVELS ? finest + levels : CELL_GRID_LEVELS - 1;
    for (; finest < last && left > THIN_SHARE; finest++) {
        if (cells_in_walls(c, 0.5 * size) > most || blocks_of(&c->grid, finest + 1) > MOST_BLOCKS) break;
        size *= 0.5;
        left = share_in_walls(c, size / CELL_IN_WALL, NULL);
    }
    if (left > 0.5 * before) return;
    c->grid.finest = finest;
    c->base.cell_size = size;
    c->base.uneven = finest > 0;
}

/* ---- cells */

/* In half diagonals of a block: a surface farther from the centre, estimated by the slope, does not cross
 * the block. */
static const double PASSES_BY = 2;

/* Whether the surface of a part does not cross a block much smaller than the part's cell. */
static bool is_not_crossed(const combination *c, const part *p, int level, const int64_t at[3])
{
    const cell_grid *g = &c->grid;
    const vec3 size = bbox_size(g->box);
    vec3 middle, half;
    for (int axis = 0; axis < 3; axis++) {
        const double unit = CELL_GRID_BLOCK * vec3_get(size, axis) / (double)(g->cells[axis] << level);
        vec3_set(&half, axis, 0.5 * unit);
        vec3_set(&middle, axis, vec3_get(g->box.min, axis) + ((double)at[axis] + 0.5) * unit);
    }
    field_sample s;
    return field_sample_at(p->field, middle, FIELD_GRADIENT, &s) &&
           fabs(s.value) > PASSES_BY * vec3_norm(half) * fmax(vec3_norm(s.gradient), p->slope);
}

/* Marks the blocks of a level that a box intersects. */
static void mark_box(const combination *c, const part *p, bbox box, int level, uint8_t mark, uint8_t *blocks)
{
    const cell_grid *g = &c->grid;
    const vec3 size = bbox_size(g->box);
    int64_t across[3], first[3], last[3], at[3];
    for (int axis = 0; axis < 3; axis++) {
        across[axis] = cell_grid_blocks(g, level, axis);
        double unit = CELL_GRID_BLOCK * vec3_get(size, axis) / (double)(g->cells[axis] << level),
               low = vec3_get(g->box.min, axis);
        first[axis] =
            (int64_t)fmin(fmax(floor((vec3_get(box.min, axis) - low) / unit), 0), (double)across[axis]);
        last[axis] =
            (int64_t)fmin(fmax(floor((vec3_get(box.max, axis) - low) / unit), -1), (double)across[axis] - 1);
    }
    bool are_small = false;
    for (int axis = 0; axis < 3; axis++) are_small |= last[axis] - first[axis] >= SMALL;
    for (at[2] = first[2]; at[2] <= last[2]; at[2]++)
        for (at[1] = first[1]; at[1] <= last[1]; at[1]++)
            for (at[0] = first[0]; at[0] <= last[0]; at[0]++) {
                uint8_t *block = &blocks[(at[2] * across[1] + at[1]) * across[0] + at[0]];
                if ((*block & mark) != mark && !(are_small && is_not_crossed(c, p, level, at)))
                    *block |= mark;
            }
}

/* Marks the blocks of a level that the cells of a part intersect: those of the part's own size, and eighths
 * of these where walls need smaller ones. */
static void mark_cells(const combination *c, const part *p, int level, uint8_t *blocks)
{
    const double size = ldexp(c->base.cell_size, c->grid.finest - level);
    const bool has_finer = level < c->grid.finest;
    for (size_t k = 0; k < p->field->ops->cell_count(p->field); k++) {
        field_cell cell;
        p->field->ops->cell(p->field, k, &cell);
        const double grown = BULGE * field_cell_edge(&cell);
        bbox box = bbox_empty();
        for (int v = 0; v < 8; v++) box = bbox_include(box, cell.corner[v]);
        mark_box(c, p, bbox_grow(box, grown), level,
                 has_finer && size > p->edge ? CELL_GRID_SEARCH | CELL_GRID_DIVIDE : CELL_GRID_SEARCH,
                 blocks);
        for (int v = 0; p->walls && has_finer && v < p->places; v++) {
            if (!(size > size_at(p, k * (size_t)p->places + (size_t)v, c->base.cell_size))) continue;
            const vec3 across = vec3_sub(vec3_scale(place_of(p, &cell, v), 2), cell.corner[v]);
            if (p->places > 1) box = bbox_include(bbox_include(bbox_empty(), cell.corner[v]), across);
            mark_box(c, p, bbox_grow(box, grown / (p->places > 1 ? 2 : 1)), level,
                     CELL_GRID_SEARCH | CELL_GRID_DIVIDE, blocks);
        }
    }
}

/* Divides the parents of each divided block of `level` and of its 26 neighbours, so that the levels of
 * adjacent cells differ by at most one. */
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

/* Marks all blocks that are searched, with cells as small as the part or its walls need. */
static void mark_parts(const combination *c, uint8_t *const blocks[])
{
    const int finest = c->grid.finest;
    for (size_t k = 0; k < c->count; k++)
        for (int level = 0; level <= finest; level++) mark_cells(c, &c->parts[k], level, blocks[level]);
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

/* Finds the crossing cells, and the area missing in thinner walls. If there are walls but no crossing cells,
 * adds levels one by one: a combination that contains this one may have such small cells everywhere. */
static bool find_surface(combination *c, int wall_levels, size_t memory, threads *pool, error *e)
{
    const bool divides = wall_levels > 0 && !has_open_part(c);
    if (wall_levels > 0 && !find_walls(c, pool, e)) return false;
    for (int levels = wall_levels; levels < CELL_GRID_LEVELS; levels++) {
        const double before = c->base.cell_size;
        if (divides) resolve_walls(c, levels, memory);
        if (levels > wall_levels && !(c->base.cell_size < before)) continue;
        if (!find_cells(c, pool, e)) return false;
        if (wall_levels > 0) c->missing = share_in_walls(c, c->base.cell_size, &c->area);
        if (c->grid.count > 0 || c->missing == 0 || !divides) break;
    }
    return true;
}

/* Whether the plane of a face of an open part's domain meets the surface. False for a plane that is also a
 * face of the combination's domain. */
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

/* Whether the data of a part end inside the solid in a cell of the combination: some corners are inside the
 * part, some outside, and none is near its surface. */
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
                "part %zu of the combination is open and ends inside it: intersect it with a box first", k);
    }
    return true;
}

combination *combination_new(combination_kind kind, const field *const *parts, size_t count, int wall_levels,
                             double spacing, double points, size_t memory, threads *pool, error *e)
{
    combination *c = mem_alloc(sizeof *c);
    c->base.ops = &combination_ops;
    c->base.sharp = true;
    c->parts = mem_alloc(count * sizeof *c->parts);
    c->count = count;
    set_parts(c, kind, parts);
    vec3 size = bbox_size(c->base.domain);
    bool some = size.x > 0 && size.y > 0 && size.z > 0;
    bool ok = some && lay_out_grid(c, spacing, points, e) && find_surface(c, wall_levels, memory, pool, e);
    for (size_t k = 0; k < count; k++) {
        free(c->parts[k].walls);
        c->parts[k].walls = NULL;
    }
    if (ok && c->grid.count == 0 && c->missing > 0)
        ok = error_set(e, ERROR_LIMIT_MEMORY,
                       "the combination is thinner than its smallest possible cells, %g, everywhere: remove "
                       "it, or make it thicker",
                       c->base.cell_size);
    else if (!some || (ok && c->grid.count == 0))
        ok = no_surface(kind, e);
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

double combination_missing(const combination *c, double *area)
{
    if (area) *area = c->area;
    return c->missing;
}
