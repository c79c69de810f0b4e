// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/volume_field.h"

#include <endian.h>
#include <math.h>
#include <string.h>

#include "base/core/isa.h"
#include "geometry/space/affine.h"

/* Distance from a crossed cell, in voxels, within which the spline determines the side of a point. */
#define NEAR (VOLUME_FIELD_MARGIN - 1)
/* Every SPARSE-th block is added first to the bounding box; most others then lie within it. */
enum { SPARSE = 61 };
/* Tolerance for places at the end of dense data, voxels. */
static const double ROUNDING = 1e-6;

/* floor(at), for values in the range of int32_t. */
static inline int32_t voxel_of(double at)
{
    const int32_t i = (int32_t)at;
    return i - (at < (double)i);
}

static bool sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const volume *v = (const volume *)f;
    const vec3 at = affine_apply(v->to_index, x.x, x.y, x.z);
    const double p[3] = {at.x, at.y, at.z};
    int32_t block[3];
    int cell[3];
    double t[3];
    for (int axis = 0; axis < 3; axis++) {
        if (!(p[axis] >= v->low[axis] && p[axis] < v->high[axis])) return false; /* also for NaN */
        const int32_t i = voxel_of(p[axis]);
        block[axis] = i >> 3;
        cell[axis] = i & 7;
        t[axis] = p[axis] - (double)i;
    }
    uint32_t n = block_map_find(&v->map, block[0], block[1], block[2]);
    if (n == BLOCK_MAP_NONE) return false;
    float buffer[COEFFICIENT_BLOCK_CELL];
    const float *corner = coefficient_blocks_find_cell(&v->coefficients, n, cell, buffer);
    spline_jet jet;
    if (order == FIELD_HESSIAN) {
        v->spline->hessian(corner, COEFFICIENT_BLOCK_SIDE, COEFFICIENT_BLOCK_SLAB, t, &jet);
        out->hessian =
            affine_pull_hessian(v->to_index, (sym3){jet.xx, jet.yy, jet.zz, jet.xy, jet.xz, jet.yz});
    } else {
        v->spline->gradient(corner, COEFFICIENT_BLOCK_SIDE, COEFFICIENT_BLOCK_SLAB, t, &jet);
    }
    out->value = jet.f;
    out->gradient = affine_pull_gradient(v->to_index, (vec3){jet.d[0], jet.d[1], jet.d[2]});
    return true;
}

static size_t cell_count(const field *f)
{
    return ((const volume *)f)->cells.count;
}

static void cell(const field *f, size_t k, field_cell *out)
{
    const volume *v = (const volume *)f;
    crossed_cell c;
    crossed_cells_get(&v->cells, k, &c);
    for (int corner = 0; corner < 8; corner++) {
        out->corner[corner] =
            affine_apply(v->to_world, (double)c.at[0] + (corner & 1), (double)c.at[1] + (corner >> 1 & 1),
                         (double)c.at[2] + (corner >> 2));
        out->value[corner] = (double)c.value[corner];
    }
    const size_t row = 64 * (size_t)c.block + 8 * (size_t)(c.at[0] & 7) + (size_t)(c.at[1] & 7);
    out->hidden_crossing = v->hidden_crossing[row] >> (c.at[2] & 7) & 1;
    const bool flat = v->flat[row] >> (c.at[2] & 7) & 1, gentle = v->gentle[row] >> (c.at[2] & 7) & 1;
    out->bend = flat ? FIELD_FLAT : gentle ? FIELD_GENTLE : FIELD_BENT;
}

static vec3 cell_middle(const field *f, size_t k, double *radius)
{
    const volume *v = (const volume *)f;
    int32_t at[3];
    crossed_cells_place(&v->cells, k, at);
    *radius = v->cell_radius;
    return affine_apply(v->to_world, at[0] + 0.5, at[1] + 0.5, at[2] + 0.5);
}

static bool cell_group(const field *f, size_t k, size_t *end, vec3 *middle, double *radius)
{
    const volume *v = (const volume *)f;
    if (k >= crossed_cells_in_blocks(&v->cells)) return false;
    const cell_block *b = crossed_cells_block(&v->cells, k);
    const int32_t *at = v->map.blocks[b->block];
    *end = b[1].cells;
    *middle = affine_apply(v->to_world, 8.0 * at[0] + 4, 8.0 * at[1] + 4, 8.0 * at[2] + 4);
    *radius = 8 * v->cell_radius;
    return true;
}

/* The world bounding box of side^3 voxels from `low`. */
static bbox box_of_voxels(const volume *v, const int32_t low[3], int side)
{
    const vec3 from = {low[0], low[1], low[2]};
    return affine_box(v->to_world, (bbox){from, vec3_add(from, vec3_make(side, side, side))});
}

static bbox add_cells(const volume *v, size_t first, size_t last, bbox box)
{
    for (size_t k = first; k < last; k++) {
        crossed_cell c;
        crossed_cells_get(&v->cells, k, &c);
        box = bbox_unite(box, box_of_voxels(v, c.at, 1));
    }
    return box;
}

/* Extends `box` by the cells of block `b`, unless it already contains the bounding box of the block. */
static bbox add_block(const volume *v, const cell_block *b, bbox of_first, bbox box)
{
    const int32_t *at = v->map.blocks[b->block];
    vec3 way = {0, 0, 0}; /* from the first block */
    for (int axis = 0; axis < 3; axis++) way = vec3_axpy(8.0 * at[axis], affine_axis(v->to_world, axis), way);
    if (bbox_contains(box, vec3_add(of_first.min, way)) && bbox_contains(box, vec3_add(of_first.max, way)))
        return box;
    return add_cells(v, b->cells, b[1].cells, box);
}

bbox volume_field_cells_box(const volume *v)
{
    const crossed_cells *c = &v->cells;
    bbox box = add_cells(v, crossed_cells_in_blocks(c), c->count, bbox_empty());
    const bbox first = box_of_voxels(v, (const int32_t[]){0, 0, 0}, 8);
    for (size_t k = 0; k < c->block_count; k += SPARSE) box = add_block(v, &c->blocks[k], first, box);
    for (size_t k = 0; k < c->block_count; k++) box = add_block(v, &c->blocks[k], first, box);
    return box;
}

/* Whether a cell from `low` to `high`, inclusive, is crossed. */
static bool any_crossed(const volume *v, const int32_t low[3], const int32_t high[3])
{
    for (int32_t bx = low[0] >> 3; bx <= high[0] >> 3; bx++)
        for (int32_t by = low[1] >> 3; by <= high[1] >> 3; by++)
            for (int32_t bz = low[2] >> 3; bz <= high[2] >> 3; bz++) {
                const uint32_t n = block_map_find(&v->map, bx, by, bz);
                if (n == BLOCK_MAP_NONE) continue;
                const int32_t block[3] = {bx, by, bz};
                int first[3], last[3];
                for (int axis = 0; axis < 3; axis++) {
                    first[axis] = low[axis] >> 3 == block[axis] ? low[axis] & 7 : 0;
                    last[axis] = high[axis] >> 3 == block[axis] ? high[axis] & 7 : 7;
                }
                const uint8_t row = (uint8_t)((2u << last[2]) - (1u << first[2]));
                const uint64_t rows = ~UINT64_C(0) >> (56 - 8 * (last[1] - first[1])) << 8 * first[1];
                const uint64_t wanted = htole64(rows & UINT64_C(0x0101010101010101) * row);
                uint64_t layer;
                for (int x = first[0]; x <= last[0]; x++) {
                    memcpy(&layer, v->crossed + 64 * (size_t)n + 8 * (size_t)x, sizeof layer);
                    if (layer & wanted) return true;
                }
            }
    return false;
}

/* Whether a cell within NEAR voxels of this one, which lies in a coefficient block, is crossed. */
static bool is_near(const volume *v, const int32_t cell[3])
{
    int32_t low[3], high[3];
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = cell[axis] - NEAR;
        high[axis] = cell[axis] + NEAR;
    }
    return any_crossed(v, cell, cell) || any_crossed(v, low, high);
}

/* A lower bound of the number of steps from p that remain in the block of its voxel. */
static double steps_within_block(vec3 p, const int32_t voxel[3], vec3 step)
{
    double steps = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        const double by = vec3_get(step, axis), low = (double)(voxel[axis] & ~7);
        if (by != 0) steps = fmin(steps, ((by > 0 ? low + 8 : low) - vec3_get(p, axis)) / by);
    }
    return fmax(floor(steps) - 1, 0);
}

/* The fraction of the way from a place to the bounding box of the coefficient blocks. */
static double way_to_blocks(const volume *v, vec3 from, vec3 way)
{
    double share = 0;
    for (int axis = 0; axis < 3; axis++) {
        const double at = vec3_get(from, axis), by = vec3_get(way, axis);
        if (at < v->low[axis] && by > 0) share = fmax(share, (v->low[axis] - at) / by);
        if (at > v->high[axis] && by < 0) share = fmax(share, (v->high[axis] - at) / by);
    }
    return share;
}

/* The voxel of a place, and the index of its coefficient block. */
static uint32_t block_at(const volume *v, vec3 index, int32_t voxel[3])
{
    for (int axis = 0; axis < 3; axis++) voxel[axis] = voxel_of(vec3_get(index, axis));
    return block_map_find(&v->map, voxel[0] >> 3, voxel[1] >> 3, voxel[2] >> 3);
}

static double side_of_voxel(const volume *v, uint32_t index, const int32_t voxel[3])
{
    const int bit = 8 * (voxel[1] & 7) + (voxel[2] & 7);
    return v->inside[8 * (size_t)index + (size_t)(voxel[0] & 7)] >> bit & 1 ? -1 : 1;
}

/* The side in the first coefficient block on the way, found by testing all coefficient blocks: used if there
 * are fewer coefficient blocks than blocks on the way. */
static double side_of_first(const volume *v, vec3 from, vec3 way)
{
    double first = INFINITY;
    uint32_t found = BLOCK_MAP_NONE;
    for (uint32_t index = 0; index < v->map.count; index++) {
        double begin = 0, end = 1;
        for (int axis = 0; axis < 3; axis++) {
            const double by = vec3_get(way, axis),
                         low = 8.0 * v->map.blocks[index][axis] - vec3_get(from, axis);
            if (by == 0 && !(low <= 0 && low + 8 > 0)) end = -1;
            if (by == 0) continue;
            begin = fmax(begin, fmin(low / by, (low + 8) / by));
            end = fmin(end, fmax(low / by, (low + 8) / by));
        }
        if (!(begin <= end && begin < first)) continue;
        first = begin;
        found = index;
    }
    if (found == BLOCK_MAP_NONE) return 1;
    int32_t voxel[3];
    for (int axis = 0; axis < 3; axis++) {
        const int32_t low = 8 * v->map.blocks[found][axis];
        const double at = vec3_get(from, axis) + first * vec3_get(way, axis);
        voxel[axis] = (int32_t)fmin(fmax(floor(at), low), (double)low + 7);
    }
    return side_of_voxel(v, found, voxel);
}

/* The side in the first voxel of a coefficient block on the straight line from a place outside all
 * coefficient blocks to the first cell. */
static double side_on_way(const volume *v, vec3 from)
{
    crossed_cell to;
    crossed_cells_get(&v->cells, 0, &to);
    const vec3 way = vec3_sub((vec3){to.at[0] + 0.5, to.at[1] + 0.5, to.at[2] + 0.5}, from);
    /* one voxel each */
    const double steps = fmax(ceil(fmax(fabs(way.x), fmax(fabs(way.y), fabs(way.z)))), 1);
    if (steps > 8.0 * v->map.count) return side_of_first(v, from, way);
    for (double k = fmax(floor(way_to_blocks(v, from, way) * steps) - 1, 1); k <= steps; k++) {
        const vec3 p = vec3_axpy(k / steps, way, from);
        int32_t voxel[3];
        const uint32_t index = block_at(v, p, voxel);
        if (index != BLOCK_MAP_NONE) return side_of_voxel(v, index, voxel);
        k += steps_within_block(p, voxel, vec3_scale(way, 1 / steps));
    }
    return 1;
}

double volume_field_side_beyond(const volume *v)
{
    double side = 0;
    for (int corner = 0; corner < 8; corner++) {
        vec3 at;
        for (int axis = 0; axis < 3; axis++)
            vec3_set(&at, axis, corner >> axis & 1 ? v->high[axis] + 1 : v->low[axis] - 1);
        const double own = side_on_way(v, at);
        if (corner > 0 && own != side) return 0;
        side = own;
    }
    return side;
}

/* Every crossing lies in a coefficient block, at least NEAR from its faces: the side is that of the first
 * voxel of a coefficient block on any straight line to a coefficient block. The spline is not used far
 * from the surface, where it extrapolates a band. */
static double side(const field *f, vec3 x)
{
    const volume *v = (const volume *)f;
    const vec3 from = affine_apply(v->to_index, x.x, x.y, x.z);
    bool within = true;
    int32_t voxel[3];
    for (int axis = 0; axis < 3; axis++) {
        double at = vec3_get(from, axis);
        if (!(fabs(at) < INT32_MAX / 2)) return 1;
        if (v->info.size[axis] > 0 && !(at >= -ROUNDING && at <= (double)(v->info.size[axis] - 1) + ROUNDING))
            return 1;
        within = within && at >= v->low[axis] && at < v->high[axis];
    }
    if (!within) return v->beyond != 0 ? v->beyond : side_on_way(v, from);
    const uint32_t index = block_at(v, from, voxel);
    if (index == BLOCK_MAP_NONE) return side_on_way(v, from);
    return is_near(v, voxel) ? 0 : side_of_voxel(v, index, voxel);
}

/* Positions of the lanes along one axis: block, voxel, and fraction within the voxel. Lanes outside `low` ..
 * `high` are in no block. */
typedef struct lane_places {
    int32_t block[VEC3_LANES], voxel[VEC3_LANES], within[VEC3_LANES];
    int32_t way[VEC3_LANES]; /* offset of the voxel's cell in a coefficient block */
    float t[VEC3_LANES];
} lane_places;

/* The compiler vectorises loops over numbers of one type. */
ISA_CLONES static void place_lanes(const double m[4], double low, double high, int32_t step,
                                   const vec3_lanes *x, lane_places *out)
{
    double at[VEC3_LANES], within[VEC3_LANES], whole[VEC3_LANES];
    for (int l = 0; l < VEC3_LANES; l++) {
        const double p = m[0] * x->x[l] + m[1] * x->y[l] + m[2] * x->z[l] + m[3];
        within[l] = (p >= low) & (p < high) ? 1 : 0; /* false for NaN */
        at[l] = within[l] > 0 ? p : low;
    }
    for (int l = 0; l < VEC3_LANES; l++) whole[l] = (double)(int32_t)at[l];
    for (int l = 0; l < VEC3_LANES; l++) whole[l] -= at[l] < whole[l] ? 1 : 0;
    for (int l = 0; l < VEC3_LANES; l++) out->t[l] = (float)(at[l] - whole[l]);
    for (int l = 0; l < VEC3_LANES; l++) out->within[l] = (int32_t)within[l];
    for (int l = 0; l < VEC3_LANES; l++) out->block[l] = (int32_t)whole[l] >> 3;
    for (int l = 0; l < VEC3_LANES; l++) out->voxel[l] = (int32_t)whole[l] & 7;
    for (int l = 0; l < VEC3_LANES; l++) out->way[l] = out->voxel[l] * step;
}

/* Finds the cells of the lanes; lanes that are not defined get none. `buffer`: for cells of coefficient
 * blocks that are not stored. */
static void find_cells(const volume *v, const vec3_lanes *x, bool *defined, spline_lanes *out,
                       float buffer[VEC3_LANES][COEFFICIENT_BLOCK_CELL])
{
    static const int32_t step[3] = {COEFFICIENT_BLOCK_SLAB, COEFFICIENT_BLOCK_SIDE, 1};
    lane_places at[3];
    block_map_seen seen = {0};
    int32_t last[3] = {0};
    int32_t way[VEC3_LANES], all_within[VEC3_LANES];
    uint32_t n = BLOCK_MAP_NONE;
    const float *coefficients = NULL; /* coefficient block of block `last`: adjacent lanes often share one */
    for (int axis = 0; axis < 3; axis++) {
        place_lanes(v->to_index[axis], v->low[axis], v->high[axis], step[axis], x, &at[axis]);
        memcpy(out->t[axis], at[axis].t, sizeof out->t[axis]);
    }
    for (int l = 0; l < VEC3_LANES; l++) all_within[l] = at[0].within[l] & at[1].within[l] & at[2].within[l];
    for (int l = 0; l < VEC3_LANES; l++) way[l] = at[0].way[l] + at[1].way[l] + at[2].way[l];
    for (int l = 0; l < VEC3_LANES; l++) {
        const bool within = defined[l] && all_within[l];
        const int32_t block[3] = {at[0].block[l], at[1].block[l], at[2].block[l]};
        if (within && (!coefficients || block[0] != last[0] || block[1] != last[1] || block[2] != last[2])) {
            n = block_map_find_near(&v->map, block[0], block[1], block[2], &seen);
            coefficients = n == BLOCK_MAP_NONE ? NULL : coefficient_blocks_at(&v->coefficients, n);
            memcpy(last, block, sizeof last);
        }
        defined[l] = within && n != BLOCK_MAP_NONE;
        out->corner[l] = defined[l] && coefficients ? coefficients + way[l] : NULL;
        if (!defined[l] || coefficients) continue;
        const int voxel[3] = {at[0].voxel[l], at[1].voxel[l], at[2].voxel[l]};
        out->corner[l] = coefficient_blocks_find_cell(&v->coefficients, n, voxel, buffer[l]);
    }
}

/* Converts the derivatives of all lanes from index to world space. */
ISA_CLONES static void pull_lanes(const double m[3][4], const spline_lanes *lanes, double *value,
                                  vec3_lanes *gradient)
{
    for (int l = 0; l < VEC3_LANES; l++) {
        const double x = (double)lanes->d[0][l], y = (double)lanes->d[1][l], z = (double)lanes->d[2][l];
        value[l] = (double)lanes->f[l];
        gradient->x[l] = m[0][0] * x + m[1][0] * y + m[2][0] * z;
        gradient->y[l] = m[0][1] * x + m[1][1] * y + m[2][1] * z;
        gradient->z[l] = m[0][2] * x + m[1][2] * y + m[2][2] * z;
    }
}

static void sample_lanes(const field *f, const vec3_lanes *x, bool *defined, double *value,
                         vec3_lanes *gradient)
{
    const volume *v = (const volume *)f;
    spline_lanes lanes;
    float buffer[VEC3_LANES][COEFFICIENT_BLOCK_CELL];
    find_cells(v, x, defined, &lanes, buffer);
    v->spline->gradient_lanes(&lanes, COEFFICIENT_BLOCK_SIDE, COEFFICIENT_BLOCK_SLAB);
    pull_lanes(v->to_index, &lanes, value, gradient);
}

static void forget(const field *f)
{
    coefficient_blocks_discard(&((const volume *)f)->coefficients);
}

const field_ops volume_field_ops = {.sample = sample,
                                    .cell_count = cell_count,
                                    .cell = cell,
                                    .cell_middle = cell_middle,
                                    .cell_group = cell_group,
                                    .side = side,
                                    .sample_lanes = sample_lanes,
                                    .forget = forget};
