#include "volume/volume_field.h"

#include <math.h>
#include <string.h>

#include "geometry/affine.h"
#include "volume/brick.h"

/* Voxels from a crossed cell within which a volume's spline is asked on which side a point lies. */
#define NEAR (VOLUME_FIELD_MARGIN - 1)

static bool sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const volume *v = (const volume *)f;
    const vec3 at = affine_apply(v->to_index, x.x, x.y, x.z);
    const double p[3] = {at.x, at.y, at.z};
    int32_t block[3];
    int cell[3];
    double t[3];
    for (int axis = 0; axis < 3; axis++) {
        if (!(p[axis] >= v->low[axis] && p[axis] < v->high[axis])) return false; /* NaN as well */
        int32_t i = (int32_t)p[axis];
        i -= p[axis] < (double)i;
        block[axis] = i >> 3;
        cell[axis] = i & 7;
        t[axis] = p[axis] - (double)i;
    }
    uint32_t n = block_map_find(&v->map, block[0], block[1], block[2]);
    if (n == BLOCK_MAP_NONE) return false;
    const float *corner = brick_cell(v->coefficients, n, cell[0], cell[1], cell[2]);
    spline_jet jet;
    if (order == FIELD_HESSIAN) {
        v->spline->hessian(corner, BRICK_SIDE, BRICK_SLAB, t, &jet);
        out->hessian =
            affine_pull_hessian(v->to_index, (sym3){jet.xx, jet.yy, jet.zz, jet.xy, jet.xz, jet.yz});
    } else {
        v->spline->gradient(corner, BRICK_SIDE, BRICK_SLAB, t, &jet);
    }
    out->value = jet.f;
    out->gradient = affine_pull_gradient(v->to_index, (vec3){jet.d[0], jet.d[1], jet.d[2]});
    return true;
}

static size_t cell_count(const field *f)
{
    return ((const volume *)f)->cell_count;
}

static void cell(const field *f, size_t k, field_cell *out)
{
    const volume *v = (const volume *)f;
    const crossed_cell *c = &v->cells[k];
    for (int corner = 0; corner < 8; corner++) {
        out->corner[corner] =
            affine_apply(v->to_world, (double)c->at[0] + (corner & 1), (double)c->at[1] + (corner >> 1 & 1),
                         (double)c->at[2] + (corner >> 2));
        out->value[corner] = (double)c->value[corner];
    }
    size_t n = block_map_find(&v->map, c->at[0] >> 3, c->at[1] >> 3, c->at[2] >> 3);
    out->grazed =
        v->grazed[64 * n + 8 * (size_t)(c->at[0] & 7) + (size_t)(c->at[1] & 7)] >> (c->at[2] & 7) & 1;
}

/* Whether a cell within NEAR voxels of this one, which lies in a brick, is crossed. */
static bool is_near(const volume *v, const int32_t cell[3])
{
    for (int32_t x = cell[0] - NEAR; x <= cell[0] + NEAR; x++)
        for (int32_t y = cell[1] - NEAR; y <= cell[1] + NEAR; y++)
            for (int32_t z = cell[2] - NEAR; z <= cell[2] + NEAR;) {
                uint32_t n = block_map_find(&v->map, x >> 3, y >> 3, z >> 3);
                int32_t end =
                    (z | 7) < cell[2] + NEAR ? z | 7 : cell[2] + NEAR; /* the row's last in this block */
                unsigned row = (2u << (end & 7)) - (1u << (z & 7));
                if (n != BLOCK_MAP_NONE &&
                    v->crossed[64 * (size_t)n + 8 * (size_t)(x & 7) + (size_t)(y & 7)] & row)
                    return true;
                z = end + 1;
            }
    return false;
}

/* Every crossing lies in a brick, NEAR or more from its end, so the side is that of the first voxel of a brick
 * on any straight way to one. Splines are no judge far from the surface, where the continuation of a band may
 * ring. */
static double side(const field *f, vec3 x)
{
    const volume *v = (const volume *)f;
    const vec3 from = affine_apply(v->to_index, x.x, x.y, x.z);
    const int32_t *cell_to = v->cells[0].at;
    const vec3 way = vec3_sub((vec3){cell_to[0] + 0.5, cell_to[1] + 0.5, cell_to[2] + 0.5}, from);
    for (int axis = 0; axis < 3; axis++) {
        double at = vec3_get(from, axis);
        if (!(fabs(at) < INT32_MAX / 2)) return 1;
        if (v->info.size[axis] > 0 && !(at >= 0 && at <= (double)(v->info.size[axis] - 1))) return 1;
    }
    const double steps = fmax(ceil(fmax(fabs(way.x), fmax(fabs(way.y), fabs(way.z)))), 1); /* a voxel each */
    for (double k = 0; k <= steps; k++) {
        const vec3 p = vec3_axpy(k / steps, way, from);
        const int32_t at[3] = {(int32_t)floor(p.x), (int32_t)floor(p.y), (int32_t)floor(p.z)};
        uint32_t n = block_map_find(&v->map, at[0] >> 3, at[1] >> 3, at[2] >> 3);
        if (n == BLOCK_MAP_NONE) continue;
        if (k == 0 && is_near(v, at)) return 0;
        int bit = 8 * (at[1] & 7) + (at[2] & 7);
        return v->inside[8 * (size_t)n + (size_t)(at[0] & 7)] >> bit & 1 ? -1 : 1;
    }
    return 1;
}

/* The lanes' cells; those that are not defined get some cell. */
static void find_cells(const volume *v, const vec3_lanes *x, bool *defined, spline_lanes *out)
{
    double p[3][VEC3_LANES];
    int32_t last[3] = {0};
    uint32_t n = BLOCK_MAP_NONE; /* of the block `last`: particles side by side often share one */
    for (int axis = 0; axis < 3; axis++) {
        const double *m = v->to_index[axis];
        for (int l = 0; l < VEC3_LANES; l++)
            p[axis][l] = m[0] * x->x[l] + m[1] * x->y[l] + m[2] * x->z[l] + m[3];
    }
    for (int l = 0; l < VEC3_LANES; l++) {
        int32_t block[3];
        int cell[3];
        bool within = defined[l];
        for (int axis = 0; axis < 3; axis++) {
            const double at = p[axis][l];
            within = within && at >= v->low[axis] && at < v->high[axis]; /* NaN: not */
            int32_t i = within ? (int32_t)at : 0;
            i -= within && at < (double)i;
            block[axis] = i >> 3;
            cell[axis] = i & 7;
            out->t[axis][l] = within ? (float)(at - (double)i) : 0;
        }
        if (within &&
            (n == BLOCK_MAP_NONE || block[0] != last[0] || block[1] != last[1] || block[2] != last[2])) {
            n = block_map_find(&v->map, block[0], block[1], block[2]);
            memcpy(last, block, sizeof last);
        }
        defined[l] = within && n != BLOCK_MAP_NONE;
        out->corner[l] =
            defined[l] ? brick_cell(v->coefficients, n, cell[0], cell[1], cell[2]) : v->coefficients;
    }
}

static void sample_lanes(const field *f, const vec3_lanes *x, bool *defined, double *value,
                         vec3_lanes *gradient)
{
    const volume *v = (const volume *)f;
    const double(*m)[4] = v->to_index;
    spline_lanes lanes;
    find_cells(v, x, defined, &lanes);
    v->spline->gradient_lanes(&lanes, BRICK_SIDE, BRICK_SLAB);
    for (int l = 0; l < VEC3_LANES; l++) {
        const vec3 g = {(double)lanes.d[0][l], (double)lanes.d[1][l], (double)lanes.d[2][l]};
        const vec3 pulled = affine_pull_gradient(m, g);
        value[l] = (double)lanes.f[l];
        gradient->x[l] = pulled.x;
        gradient->y[l] = pulled.y;
        gradient->z[l] = pulled.z;
    }
}

const field_ops volume_field_ops = {sample, cell_count, cell, side, sample_lanes};
