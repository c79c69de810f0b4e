#include "mesh/levelset.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/isa.h"
#include "base/memory.h"
#include "geometry/bbox.h"
#include "geometry/block_map.h"
#include "mesh/mesh_repair.h"
#include "geometry/triangle.h"
#include "mesh/winding_number.h"

#define SIDE VDB_LEAF_SIDE
#define VOXELS VDB_LEAF_VOXELS
#define TILE_BLOCKS 16 /* along a side of the larger of the two kinds of tiles that are used */

/* Triangles with their middles in one cube of so many voxels are a group, which is held against the voxels together. */
static const double group_vox = 1;
/* So many of a group at a time. */
enum { TOGETHER = 32 };
/* In a chunk of work. */
enum { VERTICES = 4096, GROUPS = 1024 };

/* Triangles with an angle whose sine is smaller, or with longer sides, have no normal that could be relied on; with those of
 * others the squares of distances within a block are right to `rounding`. It is a share of distances, too. */
static const double least_sine2 = 1e-6, large_vox = 64, rounding = 1e-9, least_length = 0.5;

/* Of so many groups near a block or more, about so many tell first how far its voxels may be. */
enum { MANY = 16, SOME = 128 };

/* Fewer voxels along the longest side show nothing of a shape. */
static const double fewest_voxels = 8;
/* The mesh begins so far from the grid's origin; half a voxel keeps faces along the axes off the voxels. */
static const double origin_gap = 0.5;

/* A disc around some triangles, thick enough to hold them. */
typedef struct disc {
    vec3 middle, normal; /* of length 1; 0: a ball */
    double radius, depth;
} disc;

/* Each is of one solid; in the order of solids. */
typedef struct groups {
    size_t count;
    uint32_t *first, *triangle; /* of group g: triangle[first[g]] .. triangle[first[g + 1]], in their order */
    bbox *box;
    disc *disc;
    vec3 *place; /* on one of the triangles */
} groups;

typedef struct making {
    mesh *m;
    mesh_notes *notes;
    size_t limit;
    double band, voxel_size;
    mesh_solids solids;
    winding_columns columns;
    groups groups;
    block_map map;        /* blocks within the band of a group */
    uint32_t (*pairs)[2]; /* block and group, in the order of groups */
    size_t pair_count, pair_room;
    size_t *first; /* groups near block b: near[first[b]] .. near[first[b + 1]] */
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

typedef struct moving {
    mesh *m;
    vec3 low;
    double voxel_size;
} moving;

static void move_chunk(void *context, int worker, size_t begin, size_t end)
{
    const moving *w = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        const vec3 d = vec3_sub(w->m->vertex[n], w->low);
        w->m->vertex[n] = (vec3){d.x / w->voxel_size + origin_gap, d.y / w->voxel_size + origin_gap,
                                 d.z / w->voxel_size + origin_gap};
    }
}

static bool to_index_space(making *k, const levelset_params *p, double index_to_world[16], error *e)
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
    threads_run(k->pool, m->vertex_count, VERTICES, move_chunk, &(moving){m, box.min, size});
    memset(index_to_world, 0, 16 * sizeof *index_to_world);
    for (int axis = 0; axis < 3; axis++) {
        index_to_world[5 * axis] = size;
        index_to_world[4 * axis + 3] = vec3_get(box.min, axis) - origin_gap * size;
    }
    index_to_world[15] = 1;
    return may_go_on(k, e);
}

/* ---- groups of triangles */

static triangle corners_of(const making *k, uint32_t n)
{
    const uint32_t *t = k->m->triangle[n];
    return (triangle){k->m->vertex[t[0]], k->m->vertex[t[1]], k->m->vertex[t[2]]};
}

static vec3 middle_of(const triangle *t)
{
    return vec3_scale(vec3_add(t->a, vec3_add(t->b, t->c)), 1.0 / 3);
}

static vec3 normal_of(const triangle *t)
{
    const vec3 ab = vec3_sub(t->b, t->a), ac = vec3_sub(t->c, t->a), normal = vec3_cross(ab, ac);
    const double square = vec3_norm2(normal);
    const bool large = vec3_norm2(ab) > large_vox * large_vox || vec3_norm2(ac) > large_vox * large_vox;
    if (large || !(square > least_sine2 * vec3_norm2(ab) * vec3_norm2(ac))) return (vec3){0, 0, 0};
    return vec3_scale(normal, 1 / sqrt(square));
}

/* The group of each triangle goes to `group`. */
static bool find_groups(making *k, uint32_t *group, error *e)
{
    block_map cells;
    int32_t last[3] = {-1, -1, -1};
    uint32_t solid = 0, number = 0;
    bool ok = block_map_init(&cells, 1024, e);
    for (uint32_t n = 0; ok && n < k->m->triangle_count; n++) {
        while (n >= k->solids.first[solid + 1]) solid++;
        const triangle t = corners_of(k, n);
        const vec3 middle = vec3_scale(middle_of(&t), 1 / group_vox);
        /* places along an axis take 14 bits */
        const int32_t at[3] = {(int32_t)middle.x | (int32_t)middle.y << 16, (int32_t)middle.z,
                               (int32_t)solid};
        if (memcmp(at, last, sizeof at) != 0)
            ok = block_map_find_or_add(&cells, at[0], at[1], at[2], &number, e);
        memcpy(last, at, sizeof last);
        group[n] = number;
    }
    k->groups.count = cells.count;
    block_map_free(&cells);
    return ok;
}

static bbox box_of_group(const making *k, size_t g)
{
    bbox box = bbox_empty();
    for (size_t n = k->groups.first[g]; n < k->groups.first[g + 1]; n++) {
        const triangle t = corners_of(k, k->groups.triangle[n]);
        box = bbox_unite(box, triangle_box(&t));
    }
    return box;
}

/* The disc lies in the middle of the corners' heights, not of their box's: a plane may pass a box far from its middle. */
static disc disc_of_group(const making *k, size_t g)
{
    const bbox *box = &k->groups.box[g];
    disc d = {.middle = vec3_scale(vec3_add(box->min, box->max), 0.5)};
    for (size_t n = k->groups.first[g]; n < k->groups.first[g + 1]; n++) {
        const triangle t = corners_of(k, k->groups.triangle[n]);
        d.normal = vec3_add(d.normal, normal_of(&t));
    }
    const double length = vec3_norm(d.normal);
    d.normal = length > least_length ? vec3_scale(d.normal, 1 / length) : (vec3){0, 0, 0};
    double low = INFINITY, high = -INFINITY, radius2 = 0;
    for (size_t n = k->groups.first[g]; n < k->groups.first[g + 1]; n++) {
        const uint32_t *t = k->m->triangle[k->groups.triangle[n]];
        for (int c = 0; c < 3; c++) {
            const vec3 way = vec3_sub(k->m->vertex[t[c]], d.middle);
            const double height = vec3_dot(way, d.normal), beside2 = vec3_norm2(way) - height * height;
            low = height < low ? height : low;
            high = height > high ? height : high;
            radius2 = beside2 > radius2 ? beside2 : radius2;
        }
    }
    d.middle = vec3_axpy(0.5 * (low + high), d.normal, d.middle);
    d.depth = 0.5 * (high - low) * (1 + rounding) + rounding;
    d.radius = sqrt(radius2) * (1 + rounding) + rounding;
    return d;
}

static void bound_chunk(void *context, int worker, size_t begin, size_t end)
{
    const making *k = context;
    (void)worker;
    for (size_t g = begin; g < end; g++) {
        k->groups.box[g] = box_of_group(k, g);
        k->groups.disc[g] = disc_of_group(k, g);
        const triangle t = corners_of(k, k->groups.triangle[k->groups.first[g]]);
        k->groups.place[g] = middle_of(&t);
    }
}

static bool make_groups(making *k, error *e)
{
    static const char what[] = "the parts of the mesh";
    const size_t count = k->m->triangle_count;
    groups *all = &k->groups;
    uint32_t *group = mem_array(count, sizeof *group, what, e);
    bool ok = group && find_groups(k, group, e);
    if (ok) {
        all->first = mem_array(all->count + 2, sizeof *all->first, what, e);
        all->triangle = mem_array(count, sizeof *all->triangle, what, e);
        all->box = mem_array(all->count, sizeof *all->box, what, e);
        all->disc = mem_array(all->count, sizeof *all->disc, what, e);
        all->place = mem_array(all->count, sizeof *all->place, what, e);
        ok = all->first && all->triangle && all->box && all->disc && all->place;
    }
    if (ok) { /* counted two ahead, so that filling moves the starts to their places */
        for (size_t n = 0; n < count; n++) all->first[group[n] + 2]++;
        for (size_t g = 2; g < all->count + 2; g++) all->first[g] += all->first[g - 1];
        for (uint32_t n = 0; n < count; n++) all->triangle[all->first[group[n] + 1]++] = n;
        threads_run(k->pool, all->count, GROUPS, bound_chunk, k);
    }
    free(group);
    return ok;
}

static void groups_free(groups *all)
{
    free(all->first);
    free(all->triangle);
    free(all->box);
    free(all->disc);
    free(all->place);
    *all = (groups){0};
}

/* ---- which blocks are near which groups */

static bool add_pair(making *k, const int32_t block[3], uint32_t group, error *e)
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
    k->pairs[k->pair_count++][1] = group;
    return true;
}

/* Whether a triangle of the group is as near to a place as that; squared. */
static bool group_comes_near(const making *k, uint32_t group, vec3 place, double reach2)
{
    for (size_t n = k->groups.first[group]; n < k->groups.first[group + 1]; n++) {
        const triangle t = corners_of(k, k->groups.triangle[n]);
        if (triangle_distance2(&t, place) <= reach2) return true;
    }
    return false;
}

static bool plan_group(making *k, uint32_t group, error *e)
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
                if (large && !group_comes_near(k, group, middle, reach2)) continue;
                if (!add_pair(k, b, group, e)) return false;
            }
    return true;
}

/* Pairs into lists by block, which keep the order of the groups and so of their solids. */
static bool plan(making *k, error *e)
{
    if (!block_map_init(&k->map, 1024, e) || !make_groups(k, e)) return false;
    for (uint32_t g = 0; g < k->groups.count; g++)
        if (!plan_group(k, g, e)) return false;
    size_t needed = k->map.count * (VOXELS * sizeof(float) + 128) + block_map_bytes(k->map.count) +
                    k->pair_count * (sizeof *k->pairs + sizeof *k->near) +
                    k->groups.count * (sizeof(bbox) + sizeof(disc) + sizeof(vec3)) + 4 * k->m->triangle_count;
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

#pragma GCC diagnostic ignored "-Wpsabi" /* what takes or returns such is inlined */
/* Of a row of voxels. In single precision, which may be off by a share `roughly` of squares. */
typedef float lanes __attribute__((vector_size(SIDE * sizeof(float))));
typedef int32_t lanes_mask __attribute__((vector_size(SIDE * sizeof(int32_t)))); /* -1: yes, 0: no */
static const float roughly = 1e-5f;
/* Places near a block are rounded by less. */
static const float hair = 1e-5f;
static const lanes counting = {0, 1, 2, 3, 4, 5, 6, 7};

ISA_INLINE lanes lanes_at(const double row[SIDE])
{
    lanes l;
    for (int z = 0; z < SIDE; z++) l[z] = (float)row[z];
    return l;
}

ISA_INLINE unsigned lanes_bits(lanes_mask which)
{
    uint64_t two[SIDE / 2];
    which &= (lanes_mask){1, 2, 4, 8, 16, 32, 64, 128};
    memcpy(two, &which, sizeof two);
    const uint64_t all = two[0] | two[1] | two[2] | two[3];
    return (unsigned)(all | all >> 32);
}

/* How far x lies outside of the interval, squared. */
static double outside2(double low, double high, double x)
{
    const double below = low - x, above = x - high, most = below > above ? below : above;
    return most > 0 ? most * most : 0;
}

/* The voxels of a row, by bits, that may be nearer to something in a disc than to anything so far: those that are near enough
 * along the normal, and above the disc, or nearly. `from`: the first voxel, seen from the disc's middle. */
ISA_INLINE unsigned find_near_disc(const disc *d, vec3 from, lanes nearest)
{
    const float across2 = (float)(from.x * from.x + from.y * from.y),
                radius2 = (float)(d->radius * d->radius),
                height0 = (float)(from.x * d->normal.x + from.y * d->normal.y), depth = (float)d->depth;
    const lanes at = (float)from.z + counting, away2 = across2 + at * at,
                height = height0 + at * (float)d->normal.z, up = height - depth, down = -height - depth,
                over = (lanes)(((up > 0) & (lanes_mask)up) | ((down > 0) & (lanes_mask)down)),
                within2 = nearest * nearest, off = roughly * (away2 + within2 + radius2);
    const lanes room = within2 - over * over + off, /* squared: how far beside it */
        beyond = away2 - height * height - radius2 - room;
    return lanes_bits((room > 0) & ((beyond <= 0) | (beyond * beyond < 4 * radius2 * room)));
}

/* The square of the farthest that a voxel of each row is from what was seen so far. */
static void find_farthest(const double nearest[VOXELS], lanes farthest2[SIDE])
{
    for (int row = 0; row < 64; row++) {
        double most = 0;
        for (int z = 0; z < SIDE; z++) most = nearest[8 * row + z] > most ? nearest[8 * row + z] : most;
        farthest2[row >> 3][row & 7] = (float)(most * most);
    }
}

/* Squared, of 0 to SIDE - 1. */
ISA_INLINE lanes outside_lanes(double low, double high)
{
    double out[SIDE];
    for (int k = 0; k < SIDE; k++) out[k] = outside2(low, high, k);
    return lanes_at(out);
}

/* The voxels of each row that may be nearer to what is in a box and a disc than to all so far, by bits; whether there are any.
 * Most rows have none, which the box tells of eight rows at a time. */
ISA_CLONES static bool find_rows(bbox box, const disc *d, const double nearest[VOXELS],
                                 const lanes farthest2[SIDE], uint8_t rows[64])
{
    const lanes across2 = outside_lanes(box.min.y, box.max.y), along2 = outside_lanes(box.min.z, box.max.z);
    const float beside2 = (float)outside2(box.min.z - (SIDE - 1), box.max.z, 0); /* of a whole row */
    unsigned any = 0;
    memset(rows, 0, 64);
    for (int x = 0; x < SIDE; x++) {
        const lanes off2 = (float)outside2(box.min.x, box.max.x, x) + across2;
        unsigned near = lanes_bits((off2 + beside2) * (1 - roughly) < farthest2[x]);
        for (; near; near &= near - 1) {
            const int y = __builtin_ctz(near), row = SIDE * x + y;
            const lanes so_far = lanes_at(&nearest[SIDE * row]);
            unsigned bits = lanes_bits((off2[y] + along2) * (1 - roughly) < so_far * so_far);
            if (bits) bits &= find_near_disc(d, vec3_sub((vec3){x, y, 0}, d->middle), so_far);
            rows[row] = (uint8_t)bits;
            any |= bits;
        }
    }
    return any != 0;
}

/* Some triangles of a group, in coordinates of a block, and flat discs around them. */
typedef struct cluster {
    triangle at[TOGETHER];
    lanes middle[3][TOGETHER / SIDE], normal[3][TOGETHER / SIDE], radius2[TOGETHER / SIDE];
    int count;
} cluster;

static void cluster_add(cluster *c, const triangle *t, vec3 origin)
{
    const triangle at = {vec3_sub(t->a, origin), vec3_sub(t->b, origin), vec3_sub(t->c, origin)};
    const vec3 middle = middle_of(&at), normal = normal_of(&at);
    const double a2 = vec3_norm2(vec3_sub(at.a, middle)), b2 = vec3_norm2(vec3_sub(at.b, middle)),
                 c2 = vec3_norm2(vec3_sub(at.c, middle)), ab2 = a2 > b2 ? a2 : b2;
    const int n = c->count / SIDE, l = c->count % SIDE;
    for (int axis = 0; axis < 3; axis++) {
        c->middle[axis][n][l] = (float)vec3_get(middle, axis);
        c->normal[axis][n][l] = (float)vec3_get(normal, axis);
    }
    c->radius2[n][l] = (float)(ab2 > c2 ? ab2 : c2);
    c->at[c->count++] = at;
}

/* Those of the triangles from n * SIDE on, by bits, that may be nearer to a voxel than that: those in whose flat discs there is
 * something as near. */
ISA_INLINE unsigned find_near_triangles(const cluster *c, int n, vec3 voxel, double nearest)
{
    const lanes x = (float)voxel.x - c->middle[0][n], y = (float)voxel.y - c->middle[1][n],
                z = (float)voxel.z - c->middle[2][n], away2 = x * x + y * y + z * z,
                height = x * c->normal[0][n] + y * c->normal[1][n] + z * c->normal[2][n],
                height2 = height * height, radius2 = c->radius2[n];
    const float within = (float)nearest + hair, within2 = within * within;
    const lanes room = within2 - height2 + roughly * (away2 + within2 + radius2),
                beyond = away2 - height2 - radius2 - room;
    const unsigned there = SIDE * (n + 1) > c->count ? (1u << (c->count - SIDE * n)) - 1 : 255;
    return there & lanes_bits((room > 0) & ((beyond <= 0) | (beyond * beyond < 4 * radius2 * room)));
}

/* Lowers the distances of these voxels from what was seen so far. */
ISA_CLONES static void approach(const cluster *c, const uint8_t rows[64], double nearest[VOXELS])
{
    for (int row = 0; row < 64; row++)
        for (unsigned left = rows[row]; left; left &= left - 1) {
            const int along = __builtin_ctz(left);
            const vec3 voxel = {row >> 3, row & 7, along};
            double so_far = nearest[8 * row + along];
            for (int n = 0; SIDE * n < c->count; n++)
                for (unsigned near = find_near_triangles(c, n, voxel, so_far); near; near &= near - 1) {
                    const double d2 = triangle_distance2(&c->at[SIDE * n + __builtin_ctz(near)], voxel);
                    if (d2 < so_far * so_far) so_far = sqrt(d2);
                }
            nearest[8 * row + along] = so_far;
        }
}

static void approach_group(const making *k, uint32_t group, vec3 origin, const lanes farthest2[SIDE],
                           double nearest[VOXELS])
{
    const bbox *box = &k->groups.box[group];
    const size_t end = k->groups.first[group + 1];
    uint8_t rows[64];
    disc around = k->groups.disc[group];
    around.middle = vec3_sub(around.middle, origin);
    if (!find_rows((bbox){vec3_sub(box->min, origin), vec3_sub(box->max, origin)}, &around, nearest,
                   farthest2, rows))
        return;
    for (size_t n = k->groups.first[group]; n < end;) {
        cluster c;
        c.count = 0;
        for (; n < end && c.count < TOGETHER; n++) {
            const triangle t = corners_of(k, k->groups.triangle[n]);
            cluster_add(&c, &t, origin);
        }
        approach(&c, rows, nearest);
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

/* How far voxels are at most, squared, and of which of the groups that tell it; -1: of none yet. No voxel is farther from a
 * triangle than from a place of it. In single precision. */
typedef struct bounds {
    float nearest2[VOXELS];
    int32_t from[VOXELS];
} bounds;

ISA_CLONES static void bound_by_place(vec3 at, int32_t number, bounds *b)
{
    float along2[SIDE];
    for (int z = 0; z < SIDE; z++) along2[z] = (float)((z - at.z) * (z - at.z));
    for (int row = 0; row < 64; row++) {
        const double x = (row >> 3) - at.x, y = (row & 7) - at.y;
        const float across2 = (float)(x * x + y * y);
        for (int z = 0; z < SIDE; z++) {
            const float d2 = across2 + along2[z], so_far = b->nearest2[8 * row + z];
            b->nearest2[8 * row + z] = d2 < so_far ? d2 : so_far;
            b->from[8 * row + z] = d2 < so_far ? number : b->from[8 * row + z];
        }
    }
}

/* Places along each axis, so many of a group. */
typedef struct places {
    float at[3][TOGETHER];
} places;

/* The middles of a group's triangles, or of some of them. */
static places middles_of_group(const making *k, uint32_t group, vec3 origin)
{
    const size_t first = k->groups.first[group], count = k->groups.first[group + 1] - first;
    places p;
    for (size_t n = 0; n < TOGETHER; n++) {
        const size_t which = count > TOGETHER ? n * count / TOGETHER : n < count ? n : 0;
        const triangle t = corners_of(k, k->groups.triangle[first + which]);
        const vec3 at = vec3_sub(middle_of(&t), origin);
        p.at[0][n] = (float)at.x;
        p.at[1][n] = (float)at.y;
        p.at[2][n] = (float)at.z;
    }
    return p;
}

/* The same of a list of voxels, each of which names the next, and of many places. */
ISA_CLONES static void bound_by_places(const places *p, int voxel, const int16_t next[VOXELS], bounds *b)
{
    for (; voxel >= 0; voxel = next[voxel]) {
        const float x = (float)(voxel >> 6), y = (float)(voxel >> 3 & 7), z = (float)(voxel & 7);
        lanes least = b->nearest2[voxel] + (lanes){0};
        for (int n = 0; n < TOGETHER; n += SIDE) {
            for (int l = 0; l < SIDE; l++) {
                const float dx = x - p->at[0][n + l], dy = y - p->at[1][n + l], dz = z - p->at[2][n + l],
                            d2 = dx * dx + dy * dy + dz * dz;
                least[l] = d2 < least[l] ? d2 : least[l];
            }
        }
        for (int l = 0; l < SIDE; l++)
            if (least[l] < b->nearest2[voxel]) b->nearest2[voxel] = least[l];
    }
}

/* Of many groups one triangle each is looked at before all others, then the triangles of the group that is nearest to a voxel so
 * far: what they leave to be nearer is little. Distances come out a trace too large, so that the nearest triangle is still
 * looked at. */
static void bound_by_some(const making *k, vec3 origin, const uint32_t *near, size_t count,
                          double nearest[VOXELS])
{
    if (count < MANY) return;
    bounds b;
    int16_t first[2 * SOME], next[VOXELS];
    const size_t step = 1 + count / (2 * SOME);
    for (int v = 0; v < VOXELS; v++) {
        b.nearest2[v] = (float)(nearest[v] * nearest[v]);
        b.from[v] = -1;
    }
    for (size_t n = 0; n < count; n += step)
        bound_by_place(vec3_sub(k->groups.place[near[n]], origin), (int32_t)(n / step), &b);
    memset(first, -1, sizeof first);
    for (int v = 0; v < VOXELS; v++) {
        if (b.from[v] < 0) continue;
        next[v] = first[b.from[v]];
        first[b.from[v]] = (int16_t)v;
    }
    for (size_t n = 0; n < count; n += step) {
        if (first[n / step] < 0) continue;
        const places middles = middles_of_group(k, near[n], origin);
        bound_by_places(&middles, first[n / step], next, &b);
    }
    for (int v = 0; v < VOXELS; v++) {
        const double d = sqrt((double)b.nearest2[v]) * (1 + roughly) + hair;
        if (d < nearest[v]) nearest[v] = d;
    }
}

/* The solid of a group, which is not before that one. */
static uint32_t solid_of(const making *k, uint32_t solid, uint32_t group)
{
    while (k->groups.triangle[k->groups.first[group]] >= k->solids.first[solid + 1]) solid++;
    return solid;
}

/* The end of a solid's groups in a list that ends with `end`. */
static size_t end_of_solid(const making *k, uint32_t solid, size_t from, size_t end)
{
    while (from < end && solid_of(k, solid, k->near[from]) == solid) from++;
    return from;
}

/* The block's distances in voxels, clamped to the band. */
static void fill_block(const making *k, uint32_t block, uint32_t *stamp, double f[VOXELS])
{
    const int32_t *b = k->map.blocks[block], origin[3] = {SIDE * b[0], SIDE * b[1], SIDE * b[2]};
    const vec3 base = {origin[0], origin[1], origin[2]};
    double nearest[VOXELS];
    lanes farthest2[SIDE];
    uint32_t solid = 0;
    for (int v = 0; v < VOXELS; v++) f[v] = k->band;
    for (size_t n = k->first[block]; n < k->first[block + 1];) {
        solid = solid_of(k, solid, k->near[n]);
        for (int v = 0; v < VOXELS; v++) nearest[v] = k->band;
        const size_t end = end_of_solid(k, solid, n, k->first[block + 1]);
        bound_by_some(k, base, k->near + n, end - n, nearest);
        find_farthest(nearest, farthest2);
        for (; n < end; n++) approach_group(k, k->near[n], base, farthest2, nearest);
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
    const double longest = k->m->triangle_count ? bbox_longest(mesh_box(k->m, k->pool)) : 0;
    assert(!p->edges || k->m->welded);
    if (!mesh_weld(k->m, MESH_DROP_CANCELLED, k->notes, e) || !to_index_space(k, p, out->index_to_world, e))
        return false;
    const mesh_place place = {p->weld * longest / k->voxel_size, out->index_to_world, p->edges, k->pool};
    out->grid_class = VDB_LEVEL_SET;
    out->background = (float)(k->band * k->voxel_size);
    return mesh_repair_solids(k->m, &place, &k->solids, k->notes, e) && may_go_on(k, e) && plan(k, e) &&
           may_go_on(k, e) &&
           winding_make(k->m, k->solids.first, k->solids.solid_count, k->pool, k->limit, &k->columns, e) &&
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
    mesh_solids_free(&k.solids);
    winding_free(&k.columns);
    groups_free(&k.groups);
    block_map_free(&k.map);
    free(k.pairs);
    free(k.first);
    free(k.near);
    free(k.stamps);
    if (ok) return out;
    vdb_grid_free(out);
    return NULL;
}
