// SPDX-License-Identifier: Apache-2.0
#include "surface/levelset/levelset.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "geometry/mesh/mesh_weld.h"
#include "base/core/memory.h"
#include "geometry/space/bbox.h"
#include "geometry/space/block_map.h"
#include "surface/levelset/mesh_repair.h"
#include "surface/levelset/triangle_groups.h"
#include "surface/levelset/winding_number.h"

#define SIDE VDB_LEAF_SIDE
#define VOXELS VDB_LEAF_VOXELS
#define TILE_BLOCKS 16 /* side of the larger tiles, in blocks */

enum { CHUNK = 4096 }; /* of vertices */

/* Minimum number of voxels along the longest side. */
static const double fewest_voxels = 8;
/* Distance of the mesh from the grid's origin beyond the band, voxels. Half a voxel keeps faces parallel
 * to the axes off the voxel centres. */
static const double origin_gap = 0.5;

typedef struct level_set_build {
    mesh *m;
    mesh_notes *notes;
    size_t limit;
    double band, voxel_size;
    mesh_solids solids;
    winding_columns columns;
    triangle_groups groups;
    block_map map;        /* blocks within the band of a group */
    uint32_t (*pairs)[2]; /* (block, group), sorted by group */
    size_t pair_count, pair_room;
    size_t *first; /* block b is near the groups near[first[b]] .. near[first[b + 1] - 1] */
    uint32_t *near;
    threads *pool;
    uint32_t *stamps; /* per worker and solid: the last block with triangles of it, plus one */
    vdb_grid *out;
} level_set_build;

static bool over_limit(const level_set_build *k, size_t needed, error *e)
{
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "its level set with voxels of %g needs more than %zu MiB and %zu MiB are left of the limit: "
        "raise limits.memory_mb or use larger voxels",
        k->voxel_size, needed >> 20, k->limit >> 20);
}

/* ---- into index space */

typedef struct to_voxels_job {
    mesh *m;
    vec3 low;
    double voxel_size;
} to_voxels_job;

static void move_chunk(void *context, int worker, size_t begin, size_t end)
{
    const to_voxels_job *w = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const vec3 d = vec3_sub(w->m->vertex[n], w->low);
        w->m->vertex[n] = (vec3){d.x / w->voxel_size + origin_gap, d.y / w->voxel_size + origin_gap,
                                 d.z / w->voxel_size + origin_gap};
    }
}

static bool to_index_space(level_set_build *k, const levelset_params *p, double index_to_world[16], error *e)
{
    mesh *m = k->m;
    const bbox box = mesh_box(m, k->pool);
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
    threads_run(k->pool, m->vertex_count, CHUNK, move_chunk, &(to_voxels_job){m, box.min, size});
    memset(index_to_world, 0, 16 * sizeof *index_to_world);
    for (int axis = 0; axis < 3; axis++) {
        index_to_world[5 * axis] = size;
        index_to_world[4 * axis + 3] = vec3_get(box.min, axis) - origin_gap * size;
    }
    index_to_world[15] = 1;
    return threads_may_go_on(k->pool, e);
}

/* ---- which blocks are near which groups */

static bool add_pair(level_set_build *k, const int32_t block[3], uint32_t group, error *e)
{
    uint32_t number;
    if (k->pair_count == k->pair_room) {
        size_t room = k->pair_room ? 2 * k->pair_room : 1 << 16;
        size_t needed = room * 4 * sizeof *k->near + k->map.count * (size_t)(VOXELS * sizeof(float));
        if (needed > k->limit) return over_limit(k, needed, e);
    }
    if (!MEM_GROW(k->pairs, k->pair_count, &k->pair_room, "the blocks around the mesh", e)) return false;
    if (!block_map_find_or_add(&k->map, block[0], block[1], block[2], &number, e)) return false;
    k->pairs[k->pair_count][0] = number;
    k->pairs[k->pair_count++][1] = group;
    return true;
}

static bool plan_group(level_set_build *k, uint32_t group, error *e)
{
    const bbox box = bbox_grow(k->groups.box[group], k->band);
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
                if (large && !triangle_groups_is_within(&k->groups, group, middle, reach2)) continue;
                if (!add_pair(k, b, group, e)) return false;
            }
    return true;
}

/* Sorts the pairs by block. The order of the groups, and so of their solids, is kept. */
static bool plan(level_set_build *k, error *e)
{
    if (!block_map_init(&k->map, 1024, e) ||
        !triangle_groups_make(k->m, k->solids.first, k->pool, &k->groups, e))
        return false;
    for (uint32_t g = 0; g < k->groups.count; g++)
        if (!plan_group(k, g, e)) return false;
    size_t needed = k->map.count * (VOXELS * sizeof(float) + 128) + block_map_bytes(k->map.count) +
                    k->pair_count * (sizeof *k->pairs + sizeof *k->near) + triangle_groups_bytes(&k->groups);
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

/* Takes the minimum of `f` and the signed distance of one solid. */
static void unite(const level_set_build *k, uint32_t solid, const int32_t origin[3],
                  const double nearest[VOXELS], double f[VOXELS])
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

/* The solid of a group; it is `solid` or a later one. */
static uint32_t solid_of(const level_set_build *k, uint32_t solid, uint32_t group)
{
    while (k->groups.triangle[k->groups.first[group]] >= k->solids.first[solid + 1]) solid++;
    return solid;
}

/* The end of the groups of a solid in the list from .. end. */
static size_t end_of_solid(const level_set_build *k, uint32_t solid, size_t from, size_t end)
{
    while (from < end && solid_of(k, solid, k->near[from]) == solid) from++;
    return from;
}

/* Computes the distances of a block in voxels, clamped to the band. */
static void fill_block(const level_set_build *k, uint32_t block, uint32_t *stamp, double f[VOXELS])
{
    const int32_t *b = k->map.blocks[block], origin[3] = {SIDE * b[0], SIDE * b[1], SIDE * b[2]};
    double nearest[VOXELS];
    uint32_t solid = 0;
    for (int v = 0; v < VOXELS; v++) f[v] = k->band;
    for (size_t n = k->first[block]; n < k->first[block + 1];) {
        solid = solid_of(k, solid, k->near[n]);
        const size_t end = end_of_solid(k, solid, n, k->first[block + 1]);
        triangle_groups_lower_distances(&k->groups, k->near + n, end - n, origin, k->band, nearest);
        n = end;
        stamp[solid] = block + 1;
        unite(k, solid, origin, nearest, f);
    }
    if (!winding_covers(&k->columns, k->solids.one_sided, stamp, block + 1, origin)) return;
    for (int v = 0; v < VOXELS; v++) f[v] = -k->band; /* inside a solid without triangles near the block */
}

static void store_block(const level_set_build *k, uint32_t block, const double f[VOXELS], vdb_grid *out)
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
    const level_set_build *k = context;
    uint32_t *stamp = k->stamps + (size_t)worker * k->solids.solid_count;
    for (size_t block = begin; block < end; block++) {
        double f[VOXELS];
        fill_block(k, (uint32_t)block, stamp, f);
        store_block(k, (uint32_t)block, f, k->out);
    }
}

static bool fill_leaves(level_set_build *k, vdb_grid *out, error *e)
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
    return threads_may_go_on(k->pool, e);
}

/* ---- tiles of the inside beyond the band */

typedef struct tiling {
    vdb_tile *tiles;
    size_t count, room;
} tiling;

/* Adds a tile of one block, or of TILE_BLOCKS^3 blocks, if it is inside. It has no leaf, so that one voxel
 * decides for all. */
static bool add_tile(const level_set_build *k, tiling *t, const int32_t origin[3], int32_t side, error *e)
{
    if (!winding_covers(&k->columns, k->solids.one_sided, NULL, 0, origin)) return true;
    if (t->count == t->room) {
        size_t room = t->room ? 2 * t->room : 1024;
        if (2 * room * sizeof *t->tiles > k->limit) return over_limit(k, 2 * room * sizeof *t->tiles, e);
    }
    if (!MEM_GROW(t->tiles, t->count, &t->room, "the inside of the mesh", e)) return false;
    t->tiles[t->count++] =
        (vdb_tile){{origin[0], origin[1], origin[2]}, side, (float)(-k->band * k->voxel_size), false};
    return true;
}

static bool tile_region(const level_set_build *k, const block_map *regions, const int32_t at[3], tiling *t,
                        error *e)
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

static bool fill_tiles(const level_set_build *k, vdb_grid *out, error *e)
{
    block_map regions = {0};
    tiling t = {0};
    int32_t high[3] = {0, 0, 0}, at[3]; /* the inside has no negative coordinates */
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

static bool make(level_set_build *k, const levelset_params *p, vdb_grid *out, error *e)
{
    const double longest = k->m->triangle_count ? bbox_longest(mesh_box(k->m, k->pool)) : 0;
    assert(!p->edges || k->m->welded);
    if (!mesh_weld(k->m, MESH_DROP_IF_CLOSED, k->notes, e) || !to_index_space(k, p, out->index_to_world, e))
        return false;
    const mesh_repair_input in = {p->weld * longest / k->voxel_size, out->index_to_world, p->edges, k->pool};
    out->grid_class = VDB_LEVEL_SET;
    out->background = (float)(k->band * k->voxel_size);
    return mesh_repair_solids(k->m, &in, &k->solids, k->notes, e) && threads_may_go_on(k->pool, e) &&
           plan(k, e) && threads_may_go_on(k->pool, e) &&
           winding_make(k->m, k->solids.first, k->solids.solid_count, k->pool, k->limit, &k->columns, e) &&
           fill_leaves(k, out, e) && fill_tiles(k, out, e);
}

vdb_grid *levelset_make(mesh *m, const levelset_params *params, mesh_notes *notes, size_t *solids, error *e)
{
    level_set_build k = {.m = m, .notes = notes, .band = params->band_vox, .pool = params->pool};
    k.limit = mem_left(params->memory_limit, mesh_bytes(m->vertex_count, m->triangle_count));
    vdb_grid *out = mem_alloc(sizeof *out);
    bool ok = make(&k, params, out, e);
    if (ok && solids) *solids = k.solids.solid_count;
    mesh_solids_free(&k.solids);
    winding_free(&k.columns);
    triangle_groups_free(&k.groups);
    block_map_free(&k.map);
    free(k.pairs);
    free(k.first);
    free(k.near);
    free(k.stamps);
    if (ok) return out;
    vdb_grid_free(out);
    return NULL;
}
