// SPDX-License-Identifier: Apache-2.0
#include "surface/levelset/triangle_groups.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/lanes.h"
#include "base/core/memory.h"
#include "geometry/space/block_map.h"
#include "geometry/space/triangle.h"

#define SIDE TRIANGLE_GROUPS_SIDE
#define VOXELS TRIANGLE_GROUPS_VOXELS

/* Edge length of the cubes that define groups, voxels. */
static const double group_vox = 1;
/* Triangles of a group that are processed together. */
enum { TOGETHER = 32 };
enum { CHUNK = 1024 }; /* groups of a task */

/* A triangle has a reliable normal if the squared sine of its angles is at least least_sine2 and its edges
 * are at most large_vox voxels. Squared distances within a block are then accurate to `rounding`,
 * absolutely and relatively. */
static const double least_sine2 = 1e-6, large_vox = 64, rounding = 1e-9, least_length = 0.5;

/* If at least MANY groups are near a block, about SOME of them are used first to bound the distances of
 * its voxels. */
enum { MANY = 16, SOME = 128 };

static triangle corners_of(const triangle_groups *k, uint32_t n)
{
    return triangle_of_corners(k->m->vertex, k->m->triangle[n]);
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

/* Sets group[n] of each triangle and k->count. */
static bool find_groups(triangle_groups *k, const uint32_t *first_of_solid, uint32_t *group, error *e)
{
    block_map cells;
    int32_t last[3] = {-1, -1, -1};
    uint32_t solid = 0, number = 0;
    bool ok = block_map_init(&cells, 1024, e);
    for (uint32_t n = 0; ok && n < k->m->triangle_count; n++) {
        while (n >= first_of_solid[solid + 1]) solid++;
        const triangle t = corners_of(k, n);
        const vec3 middle = vec3_scale(middle_of(&t), 1 / group_vox);
        /* a coordinate takes 14 bits */
        const int32_t at[3] = {(int32_t)middle.x | (int32_t)middle.y << 16, (int32_t)middle.z,
                               (int32_t)solid};
        if (memcmp(at, last, sizeof at) != 0)
            ok = block_map_find_or_add(&cells, at[0], at[1], at[2], &number, e);
        memcpy(last, at, sizeof last);
        group[n] = number;
    }
    k->count = cells.count;
    block_map_free(&cells);
    return ok;
}

static bbox box_of_group(const triangle_groups *k, size_t g)
{
    bbox box = bbox_empty();
    for (size_t n = k->first[g]; n < k->first[g + 1]; n++) {
        const triangle t = corners_of(k, k->triangle[n]);
        box = bbox_unite(box, triangle_box(&t));
    }
    return box;
}

/* The disc is centred by the heights of the corners, not of their box: a plane may cross a box far from
 * its centre. */
static triangle_disc disc_of_group(const triangle_groups *k, size_t g)
{
    const bbox *box = &k->box[g];
    triangle_disc d = {.middle = vec3_scale(vec3_add(box->min, box->max), 0.5)};
    for (size_t n = k->first[g]; n < k->first[g + 1]; n++) {
        const triangle t = corners_of(k, k->triangle[n]);
        d.normal = vec3_add(d.normal, normal_of(&t));
    }
    const double length = vec3_norm(d.normal);
    d.normal = length > least_length ? vec3_scale(d.normal, 1 / length) : (vec3){0, 0, 0};
    double low = INFINITY, high = -INFINITY, radius2 = 0;
    for (size_t n = k->first[g]; n < k->first[g + 1]; n++) {
        const uint32_t *t = k->m->triangle[k->triangle[n]];
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
    const triangle_groups *k = context;
    (void)worker;
    for (size_t g = begin; g < end; g++) {
        k->box[g] = box_of_group(k, g);
        k->disc[g] = disc_of_group(k, g);
        const triangle t = corners_of(k, k->triangle[k->first[g]]);
        k->place[g] = middle_of(&t);
    }
}

static bool make(triangle_groups *k, const uint32_t *first_of_solid, threads *pool, error *e)
{
    static const char what[] = "the parts of the mesh";
    const size_t count = k->m->triangle_count;
    uint32_t *group = mem_array(count, sizeof *group, what, e);
    bool ok = group && find_groups(k, first_of_solid, group, e);
    if (ok) {
        k->first = mem_array(k->count + 2, sizeof *k->first, what, e);
        k->triangle = mem_array(count, sizeof *k->triangle, what, e);
        k->box = mem_array(k->count, sizeof *k->box, what, e);
        k->disc = mem_array(k->count, sizeof *k->disc, what, e);
        k->place = mem_array(k->count, sizeof *k->place, what, e);
        ok = k->first && k->triangle && k->box && k->disc && k->place;
    }
    if (ok) { /* counted at index + 2, so that filling moves first[g + 1] to the end of group g */
        for (size_t n = 0; n < count; n++) k->first[group[n] + 2]++;
        for (size_t g = 2; g < k->count + 2; g++) k->first[g] += k->first[g - 1];
        for (uint32_t n = 0; n < count; n++) k->triangle[k->first[group[n] + 1]++] = n;
        threads_run(pool, k->count, CHUNK, bound_chunk, k);
    }
    free(group);
    if (ok && !threads_may_go_on(pool, e)) return false;
    return ok;
}

bool triangle_groups_make(const mesh *m, const uint32_t *first_of_solid, threads *pool, triangle_groups *out,
                          error *e)
{
    triangle_groups made = {.m = m};
    if (make(&made, first_of_solid, pool, e)) {
        *out = made;
        return true;
    }
    triangle_groups_free(&made);
    return false;
}

void triangle_groups_free(triangle_groups *groups)
{
    free(groups->first);
    free(groups->triangle);
    free(groups->box);
    free(groups->disc);
    free(groups->place);
    *groups = (triangle_groups){0};
}

size_t triangle_groups_bytes(const triangle_groups *k)
{
    return k->count * (sizeof *k->first + sizeof *k->box + sizeof *k->disc + sizeof *k->place) +
           k->m->triangle_count * sizeof *k->triangle;
}

bool triangle_groups_is_within(const triangle_groups *k, uint32_t group, vec3 place, double reach2)
{
    for (size_t n = k->first[group]; n < k->first[group + 1]; n++) {
        const triangle t = corners_of(k, k->triangle[n]);
        if (triangle_distance2(&t, place) <= reach2) return true;
    }
    return false;
}

/* ---- distances */

/* Relative rounding error of squared distances in single precision. */
static const float roughly = 1e-5f;
/* Upper bound of the rounding error of coordinates near a block. */
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

/* Squared distance of x from the interval. */
static double outside2(double low, double high, double x)
{
    const double below = low - x, above = x - high, most = below > above ? below : above;
    return most > 0 ? most * most : 0;
}

/* The voxels of a row, as bits, that may be nearer to something in a disc than their present distance: those
 * that are near enough along the normal and above the disc, or nearly so. `from`: the first voxel relative
 * to the centre of the disc. */
ISA_INLINE unsigned find_near_disc(const triangle_disc *d, vec3 from, lanes nearest)
{
    const float across2 = (float)(from.x * from.x + from.y * from.y),
                radius2 = (float)(d->radius * d->radius),
                height0 = (float)(from.x * d->normal.x + from.y * d->normal.y), depth = (float)d->depth;
    const lanes at = (float)from.z + counting, away2 = across2 + at * at,
                height = height0 + at * (float)d->normal.z, up = height - depth, down = -height - depth,
                over = (lanes)(((up > 0) & (lanes_mask)up) | ((down > 0) & (lanes_mask)down)),
                within2 = nearest * nearest, off = roughly * (away2 + within2 + radius2);
    const lanes room = within2 - over * over +
                       off, /* squared distance from the disc in its plane that is permitted */
        beyond = away2 - height * height - radius2 - room;
    return lanes_bits((room > 0) & ((beyond <= 0) | (beyond * beyond < 4 * radius2 * room)));
}

/* The largest squared present distance of the voxels of each row. */
static void find_farthest(const double nearest[VOXELS], lanes farthest2[SIDE])
{
    for (int row = 0; row < 64; row++) {
        double most = 0;
        for (int z = 0; z < SIDE; z++) most = nearest[8 * row + z] > most ? nearest[8 * row + z] : most;
        farthest2[row >> 3][row & 7] = (float)(most * most);
    }
}

/* Squared distances of the coordinates 0 to SIDE - 1 from the interval. */
ISA_INLINE lanes outside_lanes(double low, double high)
{
    double out[SIDE];
    for (int k = 0; k < SIDE; k++) out[k] = outside2(low, high, k);
    return lanes_at(out);
}

/* Sets the voxels of each row, as bits, that may be nearer to something in a box and a disc than their
 * present distance. Returns whether there are any. Most rows have none; the box test rejects eight rows at
 * a time. */
ISA_CLONES static bool find_rows(bbox box, const triangle_disc *d, const double nearest[VOXELS],
                                 const lanes farthest2[SIDE], uint8_t rows[64])
{
    const lanes across2 = outside_lanes(box.min.y, box.max.y), along2 = outside_lanes(box.min.z, box.max.z);
    const float beside2 = (float)outside2(box.min.z - (SIDE - 1), box.max.z, 0); /* for the whole row */
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

/* Triangles of a group in coordinates of a block, and flat discs that contain them. */
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
    if (l == 0) { /* old values of unused lanes may be denormal, which is slow */
        for (int axis = 0; axis < 3; axis++) c->middle[axis][n] = c->normal[axis][n] = (lanes){0};
        c->radius2[n] = (lanes){0};
    }
    for (int axis = 0; axis < 3; axis++) {
        c->middle[axis][n][l] = (float)vec3_get(middle, axis);
        c->normal[axis][n][l] = (float)vec3_get(normal, axis);
    }
    c->radius2[n][l] = (float)(ab2 > c2 ? ab2 : c2);
    c->at[c->count++] = at;
}

/* The triangles from n * SIDE on, as bits, that may be nearer to a voxel than `nearest`, by the distance
 * to their flat discs. */
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

/* Lowers the distances of the marked voxels to those from the triangles of a cluster. */
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

static void approach_group(const triangle_groups *k, uint32_t group, vec3 origin, const lanes farthest2[SIDE],
                           double nearest[VOXELS])
{
    const bbox *box = &k->box[group];
    const size_t end = k->first[group + 1];
    uint8_t rows[64];
    triangle_disc around = k->disc[group];
    around.middle = vec3_sub(around.middle, origin);
    if (!find_rows((bbox){vec3_sub(box->min, origin), vec3_sub(box->max, origin)}, &around, nearest,
                   farthest2, rows))
        return;
    for (size_t n = k->first[group]; n < end;) {
        cluster c;
        c.count = 0;
        for (; n < end && c.count < TOGETHER; n++) {
            const triangle t = corners_of(k, k->triangle[n]);
            cluster_add(&c, &t, origin);
        }
        approach(&c, rows, nearest);
    }
}

/* Upper bounds of the squared distances of voxels, in single precision, and the groups that give them; -1:
 * none yet. The distance from a place of a triangle is an upper bound of the distance from the triangle. */
typedef struct bounds {
    float nearest2[VOXELS];
    int32_t from[VOXELS];
} bounds;

/* The first row, 0 to SIDE - 1, within the band of a place. */
static int first_row(double at, double band)
{
    return at - band > 0 ? (int)ceil(at - band) : 0;
}

static int last_row(double at, double band)
{
    return at + band < SIDE - 1 ? (int)floor(at + band) : SIDE - 1;
}

ISA_CLONES static void bound_by_place(vec3 at, double band, int32_t number, bounds *b)
{
    const int first = first_row(at.y, band), last = last_row(at.y, band);
    float along2[SIDE];
    for (int z = 0; z < SIDE; z++) along2[z] = (float)((z - at.z) * (z - at.z));
    for (int x = first_row(at.x, band); x <= last_row(at.x, band); x++)
        for (int y = first; y <= last; y++) {
            const float across2 = (float)((x - at.x) * (x - at.x) + (y - at.y) * (y - at.y));
            float *nearest2 = &b->nearest2[SIDE * (SIDE * x + y)];
            int32_t *from = &b->from[SIDE * (SIDE * x + y)];
            for (int z = 0; z < SIDE; z++) {
                const float d2 = across2 + along2[z];
                from[z] = d2 < nearest2[z] ? number : from[z];
                nearest2[z] = d2 < nearest2[z] ? d2 : nearest2[z];
            }
        }
}

/* Coordinates of up to TOGETHER places of a group. */
typedef struct places {
    float at[3][TOGETHER];
} places;

/* The centroids of the triangles of a group, or of some of them. */
static places middles_of_group(const triangle_groups *k, uint32_t group, vec3 origin)
{
    const size_t first = k->first[group], count = k->first[group + 1] - first;
    places p;
    for (size_t n = 0; n < TOGETHER; n++) {
        const size_t which = count > TOGETHER ? n * count / TOGETHER : n < count ? n : 0;
        const triangle t = corners_of(k, k->triangle[first + which]);
        const vec3 at = vec3_sub(middle_of(&t), origin);
        p.at[0][n] = (float)at.x;
        p.at[1][n] = (float)at.y;
        p.at[2][n] = (float)at.z;
    }
    return p;
}

/* bound_by_place for all voxels of a linked list and many places. */
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

/* With many groups: bounds the distances first by one triangle of each group, then by the triangles of the
 * group that is nearest to each voxel. Few triangles can be nearer than these bounds. The bounds are
 * slightly too large, so that the nearest triangle is still tested. */
static void bound_by_some(const triangle_groups *k, vec3 origin, double band, const uint32_t *near,
                          size_t count, double nearest[VOXELS])
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
        bound_by_place(vec3_sub(k->place[near[n]], origin), band, (int32_t)(n / step), &b);
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

void triangle_groups_lower_distances(const triangle_groups *k, const uint32_t *near, size_t count,
                                     const int32_t origin[3], double band,
                                     double nearest[TRIANGLE_GROUPS_VOXELS])
{
    const vec3 base = {origin[0], origin[1], origin[2]};
    lanes farthest2[SIDE];
    for (int v = 0; v < VOXELS; v++) nearest[v] = band;
    bound_by_some(k, base, band, near, count, nearest);
    find_farthest(nearest, farthest2);
    for (size_t n = 0; n < count; n++) approach_group(k, near[n], base, farthest2, nearest);
}
