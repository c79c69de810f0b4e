#include "mesh/levelset.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"
#include "geometry/bbox.h"
#include "geometry/block_map.h"
#include "mesh/mesh_repair.h"
#include "mesh/triangle.h"
#include "mesh/winding_number.h"

#define SIDE VDB_LEAF_SIDE
#define VOXELS VDB_LEAF_VOXELS
#define TILE_BLOCKS 16 /* along a side of the larger of the two kinds of tiles that are used */

/* So many triangles, in a box of so many voxels, are held against the voxels together. More of them spare more rows, and
 * a larger ball spares fewer voxels. */
enum { TOGETHER = 16 };
static const double together_vox = 2;

/* Triangles with an angle whose sine is smaller, or with longer sides, have no normal that could be relied on; with those of
 * others the squares of distances within a block are right to `rounding`. It is a share of distances, too. */
static const double least_sine2 = 1e-6, large_vox = 64, rounding = 1e-9;

/* Of so many triangles near a block or more, about so many tell first how far its voxels may be. */
enum { MANY = 256, SOME = 128 };

/* Fewer voxels along the longest side show nothing of a shape. */
static const double fewest_voxels = 8;
/* The mesh begins so far from the grid's origin; half a voxel keeps faces along the axes off the voxels. */
static const double origin_gap = 0.5;

typedef struct making {
    mesh *m;
    mesh_notes *notes;
    size_t limit;
    double band, voxel_size;
    winding_point *fixed;
    mesh_solids solids;
    winding_columns columns;
    block_map map;        /* blocks within the band of a triangle */
    uint32_t (*pairs)[2]; /* block and triangle, in the order of triangles */
    size_t pair_count, pair_room;
    size_t *first; /* triangles of block b: near[first[b]] .. near[first[b + 1]] */
    uint32_t *near;
    threads *pool;
    uint32_t *stamps; /* of each worker, of a solid: the last block, plus one, that has triangles of it */
    vdb_grid *out;
} making;

static bool may_go_on(const making *k, error *e)
{
    return !threads_stopped(k->pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

static bool over_limit(const making *k, size_t needed, error *e)
{
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "its level set with voxels of %g needs more than %zu MiB and %zu MiB are left of the limit: "
        "raise limits.memory_mb or use larger voxels",
        k->voxel_size, needed >> 20, k->limit >> 20);
}

/* ---- into index space */

static bool to_index_space(making *k, const levelset_params *p, double index_to_world[16], error *e)
{
    mesh *m = k->m;
    const bbox box = mesh_box(m);
    const double longest = m->triangle_count ? bbox_longest(box) : 0;
    if (!(longest > 0))
        return error_set(e, ERROR_NO_SURFACE, "the mesh has no extent: all of its triangles are points");
    double size = p->voxel_size > 0 ? p->voxel_size : longest / p->resolution, voxels = longest / size;
    if (!(voxels >= fewest_voxels && voxels <= WINDING_MOST_VOXELS - 2 * origin_gap))
        return error_set(e, ERROR_SPEC_INVALID,
                         "a voxel_size of %g makes %.4g voxels along the longest side, %g, of the mesh: it "
                         "must be %g to %d",
                         size, voxels, longest, fewest_voxels, WINDING_MOST_VOXELS - 1);
    k->voxel_size = size;
    m->welded = false;
    for (size_t n = 0; n < m->vertex_count; n++) {
        vec3 d = vec3_sub(m->vertex[n], box.min);
        m->vertex[n] = (vec3){d.x / size + origin_gap, d.y / size + origin_gap, d.z / size + origin_gap};
    }
    memset(index_to_world, 0, 16 * sizeof *index_to_world);
    for (int axis = 0; axis < 3; axis++) {
        index_to_world[5 * axis] = size;
        index_to_world[4 * axis + 3] = vec3_get(box.min, axis) - origin_gap * size;
    }
    index_to_world[15] = 1;
    return true;
}

/* ---- which blocks are near which triangles */

static bool add_pair(making *k, const int32_t block[3], uint32_t n, error *e)
{
    uint32_t number;
    if (k->pair_count == k->pair_room) {
        size_t room = k->pair_room ? 2 * k->pair_room : 1 << 16;
        size_t needed = room * 4 * sizeof *k->near + k->map.count * (size_t)(VOXELS * sizeof(float));
        if (needed > k->limit) return over_limit(k, needed, e);
    }
    uint32_t(*pairs)[2] = mem_grow(k->pairs, k->pair_count, &k->pair_room, 1 << 16, sizeof *pairs,
                                   "the blocks around the mesh", e);
    if (!pairs) return false;
    k->pairs = pairs;
    if (!block_map_find_or_add(&k->map, block[0], block[1], block[2], &number, e)) return false;
    k->pairs[k->pair_count][0] = number;
    k->pairs[k->pair_count++][1] = n;
    return true;
}

static triangle corners_of(const making *k, uint32_t n)
{
    const uint32_t *t = k->m->triangle[n];
    return (triangle){k->m->vertex[t[0]], k->m->vertex[t[1]], k->m->vertex[t[2]]};
}

static bool plan_triangle(making *k, uint32_t n, error *e)
{
    const triangle t = corners_of(k, n);
    const bbox box = bbox_grow(triangle_box(&t), k->band);
    const double reach = k->band + 0.5 * (SIDE - 1) * sqrt(3), reach2 = reach * reach;
    int32_t low[3], high[3], b[3];
    bool large = false;
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = (int32_t)floor(ceil(vec3_get(box.min, axis)) / SIDE);
        high[axis] = (int32_t)floor(floor(vec3_get(box.max, axis)) / SIDE);
        large |= high[axis] - low[axis] > 2;
    }
    for (b[0] = low[0]; b[0] <= high[0]; b[0]++)
        for (b[1] = low[1]; b[1] <= high[1]; b[1]++)
            for (b[2] = low[2]; b[2] <= high[2]; b[2]++) {
                const double half = 0.5 * (SIDE - 1);
                vec3 middle = {SIDE * b[0] + half, SIDE * b[1] + half, SIDE * b[2] + half};
                if (large && triangle_distance2(&t, middle) > reach2) continue;
                if (!add_pair(k, b, n, e)) return false;
            }
    return true;
}

/* Pairs into lists by block, which keep the order of the triangles and so of their solids. */
static bool plan(making *k, error *e)
{
    if (!block_map_init(&k->map, 1024, e)) return false;
    for (uint32_t n = 0; n < k->m->triangle_count; n++)
        if (!plan_triangle(k, n, e)) return false;
    size_t needed = k->map.count * (VOXELS * sizeof(float) + 128) + block_map_bytes(k->map.count) +
                    k->pair_count * (sizeof *k->pairs + sizeof *k->near);
    if (needed > k->limit) return over_limit(k, needed, e);
    k->first = mem_array((size_t)k->map.count + 2, sizeof *k->first, "the blocks around the mesh", e);
    k->near = mem_array(k->pair_count, sizeof *k->near, "the blocks around the mesh", e);
    if (!k->first || !k->near) return false;
    for (size_t n = 0; n < k->pair_count; n++) k->first[k->pairs[n][0] + 2]++;
    for (size_t b = 2; b < (size_t)k->map.count + 2; b++) k->first[b] += k->first[b - 1];
    for (size_t n = 0; n < k->pair_count; n++) k->near[k->first[k->pairs[n][0] + 1]++] = k->pairs[n][1];
    free(k->pairs);
    k->pairs = NULL;
    return true;
}

/* ---- distances */

static int32_t clip(double v)
{
    return v < 0 ? 0 : v > SIDE ? SIDE : (int32_t)v;
}

/* Triangles that lie close together, in coordinates of a block, in a box and in a ball. */
typedef struct cluster {
    triangle at[TOGETHER];
    vec3 middle[TOGETHER], normal[TOGETHER]; /* of length 1; 0 where it is not to be relied on */
    double radius[TOGETHER];                 /* of a ball around the triangle */
    int count;
    bbox box;
} cluster;

static vec3 normal_of(const triangle *t)
{
    const vec3 ab = vec3_sub(t->b, t->a), ac = vec3_sub(t->c, t->a), normal = vec3_cross(ab, ac);
    const double square = vec3_norm2(normal);
    const bool large = vec3_norm2(ab) > large_vox * large_vox || vec3_norm2(ac) > large_vox * large_vox;
    if (large || !(square > least_sine2 * vec3_norm2(ab) * vec3_norm2(ac))) return (vec3){0, 0, 0};
    return vec3_scale(normal, 1 / sqrt(square));
}

/* Whether the triangle found room: not beside another that is far from it. */
static bool cluster_add(cluster *c, const triangle *t, const int32_t origin[3])
{
    const vec3 base = {origin[0], origin[1], origin[2]};
    const triangle at = {vec3_sub(t->a, base), vec3_sub(t->b, base), vec3_sub(t->c, base)};
    const bbox own = triangle_box(&at);
    bbox box = c->count ? bbox_include(bbox_include(c->box, own.min), own.max) : own;
    if (c->count == TOGETHER || (c->count > 0 && bbox_longest(box) > together_vox)) return false;
    const vec3 middle = vec3_scale(vec3_add(at.a, vec3_add(at.b, at.c)), 1.0 / 3);
    c->box = box;
    c->at[c->count] = at;
    c->middle[c->count] = middle;
    c->normal[c->count] = normal_of(&at);
    c->radius[c->count++] =
        sqrt(fmax(vec3_norm2(vec3_sub(at.a, middle)),
                  fmax(vec3_norm2(vec3_sub(at.b, middle)), vec3_norm2(vec3_sub(at.c, middle)))));
    return true;
}

/* Lowers a voxel's distance from what was seen so far. Most of the work is spared by balls: a voxel is not nearer to the
 * triangle than to its ball; and by discs: what is that near along the normal must also lie above the triangle, or nearly. */
ISA_INLINE void approach_voxel(const cluster *c, vec3 p, double *nearest)
{
    for (int k = 0; k < c->count; k++) {
        const vec3 way = vec3_sub(p, c->middle[k]);
        const double away2 = vec3_norm2(way), radius = c->radius[k], ball = *nearest + radius;
        if (away2 >= ball * ball) continue;
        const double height = vec3_dot(way, c->normal[k]), height2 = height * height,
                     room =
                         *nearest * *nearest - height2 + rounding, /* squared: how far beside the triangle */
            beyond = away2 - height2 - radius * radius - room;
        if (room <= 0 || (beyond > 0 && beyond * beyond >= 4 * radius * radius * room)) continue;
        const double d2 = triangle_distance2(&c->at[k], p);
        if (d2 < *nearest * *nearest) *nearest = sqrt(d2);
    }
}

/* The same of all voxels of the block, a row of them at a time being held against the ball around the box. */
ISA_CLONES static void approach(const cluster *c, double band, double nearest[VOXELS])
{
    const bbox box = bbox_grow(c->box, band);
    const vec3 middle = vec3_scale(vec3_add(c->box.min, c->box.max), 0.5);
    const double radius = 0.5 * vec3_norm(bbox_size(c->box)) * (1 + DBL_EPSILON);
    const int32_t x1 = clip(floor(box.max.x) + 1), y1 = clip(floor(box.max.y) + 1),
                  z0 = clip(ceil(box.min.z)), z1 = clip(floor(box.max.z) + 1);
    double along2[SIDE];
    for (int z = 0; z < SIDE; z++) along2[z] = (z - middle.z) * (z - middle.z);
    for (int32_t x = clip(ceil(box.min.x)); x < x1; x++)
        for (int32_t y = clip(ceil(box.min.y)); y < y1; y++) {
            double *row = &nearest[64 * x + 8 * y];
            const double across2 = (x - middle.x) * (x - middle.x) + (y - middle.y) * (y - middle.y);
            int64_t may[SIDE], any = 0;
            for (int z = 0; z < SIDE; z++) {
                const double ball = row[z] + radius;
                may[z] = across2 + along2[z] < ball * ball;
                any |= may[z];
            }
            for (int32_t z = z0; any && z < z1; z++)
                if (may[z]) approach_voxel(c, (vec3){x, y, z}, &row[z]);
        }
}

/* One solid's signed distance into `f`, the least of those of all solids. */
static void unite(const making *k, uint32_t solid, const int32_t origin[3], const double nearest[VOXELS],
                  double f[VOXELS])
{
    for (int row = 0; row < 64; row++) {
        unsigned inside = winding_inside(&k->columns, solid, k->solids.one_sided[solid],
                                         origin[0] + (row >> 3), origin[1] + (row & 7), origin[2]);
        for (int z = 0; z < SIDE; z++) {
            double d = nearest[8 * row + z];
            f[8 * row + z] = fmin(f[8 * row + z], inside >> z & 1 ? -d : d);
        }
    }
}

/* No voxel is farther from a triangle than from a place of it; squared. */
ISA_CLONES static void bound_by_place(vec3 at, double nearest2[VOXELS])
{
    double along2[SIDE];
    for (int z = 0; z < SIDE; z++) along2[z] = (z - at.z) * (z - at.z);
    for (int row = 0; row < 64; row++) {
        const double x = (row >> 3) - at.x, y = (row & 7) - at.y, across2 = x * x + y * y;
        for (int z = 0; z < SIDE; z++) {
            const double d2 = across2 + along2[z];
            nearest2[8 * row + z] = d2 < nearest2[8 * row + z] ? d2 : nearest2[8 * row + z];
        }
    }
}

/* Of many triangles some are looked at before all others: what they leave to be nearer is little. Distances come out a trace
 * too large, so that the nearest triangle is still looked at. */
static void bound_by_some(const making *k, const int32_t origin[3], const uint32_t *near, size_t count,
                          double nearest[VOXELS])
{
    if (count < MANY) return;
    double nearest2[VOXELS];
    const size_t step = count / SOME;
    for (int v = 0; v < VOXELS; v++) nearest2[v] = nearest[v] * nearest[v];
    for (size_t n = 0; n < count; n += step) {
        const triangle t = corners_of(k, near[n]);
        const vec3 base = {origin[0], origin[1], origin[2]};
        bound_by_place(vec3_sub(vec3_scale(vec3_add(t.a, vec3_add(t.b, t.c)), 1.0 / 3), base), nearest2);
    }
    for (int v = 0; v < VOXELS; v++) {
        const double d = sqrt(nearest2[v]) * (1 + rounding);
        if (d < nearest[v]) nearest[v] = d;
    }
}

/* The end of a solid's triangles in a list that ends with `end`. */
static size_t end_of_solid(const making *k, uint32_t solid, size_t from, size_t end)
{
    while (from < end && k->near[from] < k->solids.first[solid + 1]) from++;
    return from;
}

/* The block's distances in voxels, clamped to the band. */
static void fill_block(const making *k, uint32_t block, uint32_t *stamp, double f[VOXELS])
{
    const int32_t *b = k->map.blocks[block], origin[3] = {SIDE * b[0], SIDE * b[1], SIDE * b[2]};
    double nearest[VOXELS];
    uint32_t solid = 0;
    for (int v = 0; v < VOXELS; v++) f[v] = k->band;
    for (size_t n = k->first[block]; n < k->first[block + 1];) {
        while (k->near[n] >= k->solids.first[solid + 1]) solid++;
        for (int v = 0; v < VOXELS; v++) nearest[v] = k->band;
        cluster close = {.count = 0};
        const size_t end = end_of_solid(k, solid, n, k->first[block + 1]);
        bound_by_some(k, origin, k->near + n, end - n, nearest);
        for (; n < end; n++) {
            triangle t = corners_of(k, k->near[n]);
            if (cluster_add(&close, &t, origin)) continue;
            approach(&close, k->band, nearest);
            close.count = 0;
            cluster_add(&close, &t, origin);
        }
        approach(&close, k->band, nearest);
        stamp[solid] = block + 1;
        unite(k, solid, origin, nearest, f);
    }
    if (!winding_covers(&k->columns, k->solids.one_sided, stamp, block + 1, origin)) return;
    for (int v = 0; v < VOXELS; v++) f[v] = -k->band; /* deep within a solid that has no surface here */
}

static void store_block(const making *k, uint32_t block, const double f[VOXELS], vdb_grid *out)
{
    float *to = out->leaf_values + (size_t)block * VOXELS;
    for (int axis = 0; axis < 3; axis++) out->leaf_origin[block][axis] = SIDE * k->map.blocks[block][axis];
    for (int v = 0; v < VOXELS; v++) {
        to[v] = (float)(f[v] * k->voxel_size);
        if (!(fabs(f[v]) < k->band)) continue;
        out->leaf_active[8 * (size_t)block + (size_t)(v >> 6)] |= (uint64_t)1 << (v & 63);
    }
}

static void fill_chunk(void *context, int worker, size_t begin, size_t end)
{
    const making *k = context;
    uint32_t *stamp = k->stamps + (size_t)worker * k->solids.solid_count;
    for (size_t block = begin; block < end; block++) {
        double f[VOXELS];
        fill_block(k, (uint32_t)block, stamp, f);
        store_block(k, (uint32_t)block, f, k->out);
    }
}

static bool fill_leaves(making *k, vdb_grid *out, error *e)
{
    static const char leaves[] = "the band around the mesh";
    if (k->map.count == 0)
        return error_set(
            e, ERROR_NO_SURFACE,
            "nothing is left of the mesh when vertices as near as surface.mesh.weld are joined: is a "
            "vertex far away from the others?");
    out->leaf_count = k->map.count;
    out->leaf_origin = mem_array(k->map.count, sizeof *out->leaf_origin, leaves, e);
    out->leaf_values = mem_array((size_t)k->map.count * VOXELS, sizeof *out->leaf_values, leaves, e);
    out->leaf_active = mem_array((size_t)k->map.count * 8, sizeof *out->leaf_active, leaves, e);
    k->stamps =
        mem_array((size_t)threads_count(k->pool) * k->solids.solid_count, sizeof *k->stamps, leaves, e);
    if (!out->leaf_origin || !out->leaf_values || !out->leaf_active || !k->stamps) return false;
    k->out = out;
    threads_run(k->pool, k->map.count, 16, fill_chunk, k);
    for (size_t word = 0; word < 8 * k->map.count; word++)
        out->active_voxels += (uint64_t)__builtin_popcountll(out->leaf_active[word]);
    return may_go_on(k, e);
}

/* ---- what is inside, away from the surface */

typedef struct tiling {
    vdb_tile *tiles;
    size_t count, room;
} tiling;

/* Adds the block, or TILE_BLOCKS^3 of them, if it is inside; it has no leaf, so that one voxel tells of
 * all. */
static bool add_tile(const making *k, tiling *t, const int32_t origin[3], int32_t side, error *e)
{
    if (!winding_covers(&k->columns, k->solids.one_sided, NULL, 0, origin)) return true;
    if (t->count == t->room) {
        size_t room = t->room ? 2 * t->room : 1024;
        if (2 * room * sizeof *t->tiles > k->limit) return over_limit(k, 2 * room * sizeof *t->tiles, e);
    }
    vdb_tile *tiles =
        mem_grow(t->tiles, t->count, &t->room, 1024, sizeof *tiles, "the inside of the mesh", e);
    if (!tiles) return false;
    t->tiles = tiles;
    t->tiles[t->count++] =
        (vdb_tile){{origin[0], origin[1], origin[2]}, side, (float)(-k->band * k->voxel_size), false};
    return true;
}

static bool tile_region(const making *k, const block_map *regions, const int32_t at[3], tiling *t, error *e)
{
    const int32_t whole[3] = {at[0] * SIDE * TILE_BLOCKS, at[1] * SIDE * TILE_BLOCKS,
                              at[2] * SIDE * TILE_BLOCKS};
    if (block_map_find(regions, at[0], at[1], at[2]) == BLOCK_MAP_NONE)
        return add_tile(k, t, whole, SIDE * TILE_BLOCKS, e);
    for (int32_t n = 0; n < TILE_BLOCKS * TILE_BLOCKS * TILE_BLOCKS; n++) {
        const int32_t x = at[0] * TILE_BLOCKS + (n >> 8), y = at[1] * TILE_BLOCKS + (n >> 4 & 15),
                      z = at[2] * TILE_BLOCKS + (n & 15);
        const int32_t origin[3] = {x * SIDE, y * SIDE, z * SIDE};
        if (block_map_find(&k->map, x, y, z) == BLOCK_MAP_NONE && !add_tile(k, t, origin, SIDE, e))
            return false;
    }
    return true;
}

static bool fill_tiles(const making *k, vdb_grid *out, error *e)
{
    block_map regions = {0};
    tiling t = {0};
    int32_t high[3] = {0, 0, 0}, at[3]; /* what is inside has no negative coordinate */
    bool ok = block_map_init(&regions, 64, e);
    for (uint32_t n = 0; ok && n < k->map.count; n++) {
        const int32_t *b = k->map.blocks[n];
        ok = block_map_find_or_add(&regions, b[0] >> 4, b[1] >> 4, b[2] >> 4, NULL, e);
        for (int axis = 0; axis < 3; axis++)
            if (b[axis] >> 4 > high[axis]) high[axis] = b[axis] >> 4;
    }
    for (at[0] = 0; at[0] <= high[0]; at[0]++)
        for (at[1] = 0; at[1] <= high[1]; at[1]++)
            for (at[2] = 0; ok && at[2] <= high[2]; at[2]++) ok = tile_region(k, &regions, at, &t, e);
    block_map_free(&regions);
    out->tiles = t.tiles;
    out->tile_count = t.count;
    return ok;
}

/* ---- the whole */

static bool make(making *k, const levelset_params *p, vdb_grid *out, error *e)
{
    const double longest = k->m->triangle_count ? bbox_longest(mesh_box(k->m)) : 0;
    if (!mesh_weld(k->m, MESH_DROP_CANCELLED, k->notes, e) || !to_index_space(k, p, out->index_to_world, e))
        return false;
    const mesh_place place = {p->weld * longest / k->voxel_size, out->index_to_world};
    k->fixed = mem_array(k->m->vertex_count, sizeof *k->fixed, "the mesh", e);
    if (!k->fixed) return false;
    for (size_t n = 0; n < k->m->vertex_count; n++) k->fixed[n] = winding_fix(k->m->vertex[n]);
    out->grid_class = VDB_LEVEL_SET;
    out->background = (float)(k->band * k->voxel_size);
    return mesh_repair_solids(k->m, k->fixed, &place, &k->solids, k->notes, e) && may_go_on(k, e) &&
           plan(k, e) && may_go_on(k, e) &&
           winding_make(k->m, k->fixed, k->solids.first, k->solids.solid_count, k->limit, &k->columns, e) &&
           fill_leaves(k, out, e) && fill_tiles(k, out, e);
}

vdb_grid *levelset_make(mesh *m, const levelset_params *params, mesh_notes *notes, size_t *solids, error *e)
{
    size_t held = mesh_bytes(m->vertex_count, m->triangle_count);
    making k = {.m = m, .notes = notes, .band = params->band_vox, .pool = params->pool};
    k.limit = params->memory_limit > held ? params->memory_limit - held : 0;
    vdb_grid *out = mem_alloc(sizeof *out);
    bool ok = make(&k, params, out, e);
    if (ok && solids) *solids = k.solids.solid_count;
    free(k.fixed);
    mesh_solids_free(&k.solids);
    winding_free(&k.columns);
    block_map_free(&k.map);
    free(k.pairs);
    free(k.first);
    free(k.near);
    free(k.stamps);
    if (ok) return out;
    vdb_grid_free(out);
    return NULL;
}
