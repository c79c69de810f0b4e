// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_mesh.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"
#include "geometry/space/block_map.h"
#include "surface/labels/label_smoothing.h"

static const char what[] = "the interfaces of the labels";

/* The corners of the six tetrahedra of a cell, as bits of the axes. Each tetrahedron is a path from corner 0
 * to corner 7 that adds one axis at a time. */
static const unsigned char corners_of[6][4] = {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7},
                                               {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}};

enum { BLOCK = 8 }; /* voxels */

typedef struct mesh_build {
    const label_volume *v;
    block_map numbers; /* vertex numbers, by a voxel and a code of the other voxels; see vertex_between */
    mesh m;
    float *limit; /* per vertex: maximum displacement along each axis, in voxels */
    uint32_t *kind;
    size_t most; /* maximum number of triangles */
    size_t vertex_room, limit_room, triangle_room, kind_room;
    /* position of the cell of the current tetrahedron */
    int64_t at[3];
    int number;
    uint16_t label[4];
} mesh_build;

static void corner_of(const mesh_build *k, int i, int64_t out[3])
{
    const int bits = corners_of[k->number][i];
    for (int axis = 0; axis < 3; axis++) out[axis] = k->at[axis] + (bits >> axis & 1);
}

/* ---- vertices */

/* The number of voxels, of the six that share a face with this one, that have its material. Voxels outside
 * the volume count as equal. */
static int neighbours_alike(const label_volume *v, const int64_t at[3])
{
    const uint16_t own = label_volume_at(v, at[0], at[1], at[2]);
    int count = 0;
    for (int axis = 0; axis < 3; axis++)
        for (int step = -1; step <= 1; step += 2) {
            int64_t to[3] = {at[0], at[1], at[2]};
            to[axis] += step;
            count +=
                to[axis] < 0 || to[axis] >= v->size[axis] || label_volume_at(v, to[0], to[1], to[2]) == own;
        }
    return count;
}

/* Whether the voxel is single or part of a thread: smoothing would shrink it to nothing. False for a bump on
 * a thicker part. */
static bool is_thread(const label_volume *v, const int64_t at[3])
{
    enum { OF_A_THREAD = 2 };
    if (neighbours_alike(v, at) > OF_A_THREAD) return false;
    const uint16_t own = label_volume_at(v, at[0], at[1], at[2]);
    for (int n = 0; n < 27; n++) {
        const int64_t to[3] = {at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1};
        bool there = true;
        for (int axis = 0; axis < 3; axis++) there &= to[axis] >= 0 && to[axis] < v->size[axis];
        if (there && label_volume_at(v, to[0], to[1], to[2]) == own && neighbours_alike(v, to) > OF_A_THREAD)
            return false;
    }
    return true;
}

/* Maximum displacement of a vertex along each axis, in voxels. With half a voxel it stays between the voxels
 * that it separates. */
static const float usual_limit = 0.5F, line_limit = 1, thread_limit = 0.1F;

static bool add_vertex(mesh_build *k, const int *corner, int count, error *e)
{
    vec3 sum = {0, 0, 0};
    float limit = count > 2 ? line_limit : usual_limit;
    for (int i = 0; i < count; i++) {
        int64_t at[3];
        corner_of(k, corner[i], at);
        sum = vec3_add(sum, vec3_make((double)at[0], (double)at[1], (double)at[2]));
        if (is_thread(k->v, at)) limit = thread_limit;
    }
    if (!MEM_GROW(k->m.vertex, k->m.vertex_count, &k->vertex_room, what, e)) return false;
    if (!MEM_GROW(k->limit, k->m.vertex_count, &k->limit_room, what, e)) return false;
    k->limit[k->m.vertex_count] = limit;
    k->m.vertex[k->m.vertex_count++] = vec3_scale(sum, 1.0 / count);
    return true;
}

/* The vertex between two, three or four corners, given in ascending order. Its key is the voxel of the first
 * corner and the axis bits of the others relative to it. Tetrahedra with a common edge or face give the same
 * key. */
static bool vertex_between(mesh_build *k, const int *corner, int count, uint32_t *number, error *e)
{
    enum { CODES = 128, WHOLE = 64 };
    const unsigned char *bits = corners_of[k->number];
    int64_t at[3];
    int code = 0;
    corner_of(k, corner[0], at);
    for (int i = 1; i < count; i++) code = 8 * code + (bits[corner[i]] ^ bits[corner[0]]);
    if (count == 4) code = WHOLE + k->number;
    return block_map_find_or_add(&k->numbers, (int32_t)at[0], (int32_t)at[1], (int32_t)(CODES * at[2] + code),
                                 number, e) &&
           (*number < k->m.vertex_count || add_vertex(k, corner, count, e));
}

/* ---- triangles */

static vec3 middle_of(const mesh_build *k, uint16_t label)
{
    vec3 sum = {0, 0, 0};
    int count = 0;
    for (int i = 0; i < 4; i++) {
        int64_t at[3];
        if (k->label[i] != label) continue;
        corner_of(k, i, at);
        sum = vec3_add(sum, vec3_make((double)at[0], (double)at[1], (double)at[2]));
        count++;
    }
    return vec3_scale(sum, 1.0 / count);
}

/* Adds a convex polygon of the interface of two materials as triangles. Their normals point from the
 * material with the smaller number to the other one. */
static bool add_piece(mesh_build *k, uint16_t a, uint16_t b, const uint32_t *corner, int count, error *e)
{
    const uint16_t first = a < b ? a : b, second = a < b ? b : a;
    const vec3 *x = k->m.vertex;
    const vec3 along = vec3_sub(middle_of(k, second), middle_of(k, first)),
               across = vec3_across(x[corner[0]], x[corner[1]], x[corner[count - 1]]);
    const bool turn = vec3_dot(along, across) < 0;
    for (int i = 1; i + 1 < count; i++) {
        const uint32_t t[3] = {corner[0], corner[turn ? i + 1 : i], corner[turn ? i : i + 1]};
        if (!MEM_GROW(k->m.triangle, k->m.triangle_count, &k->triangle_room, what, e)) return false;
        if (!MEM_GROW(k->kind, k->m.triangle_count, &k->kind_room, what, e)) return false;
        k->kind[k->m.triangle_count] = label_mesh_kind(first, second);
        memcpy(k->m.triangle[k->m.triangle_count++], t, sizeof t);
    }
    return true;
}

/* The vertex of a set of corners, given as bits: of an edge, a face or the tetrahedron. */
static bool vertex_of(mesh_build *k, unsigned set, uint32_t *number, error *e)
{
    int corner[4], count = 0;
    for (int i = 0; i < 4; i++)
        if (set >> i & 1) corner[count++] = i;
    return vertex_between(k, corner, count, number, e);
}

static bool piece_of(mesh_build *k, uint16_t a, uint16_t b, const unsigned *sets, int count, error *e)
{
    uint32_t corner[4];
    for (int i = 0; i < count; i++)
        if (!vertex_of(k, sets[i], &corner[i], e)) return false;
    return add_piece(k, a, b, corner, count, e);
}

/* Divides a tetrahedron of two materials: a triangle separates one corner, or a quadrilateral two corners.
 * `one`: the corners of the first material. */
static bool cut_in_two(mesh_build *k, unsigned one, error *e)
{
    int in[4], out[4], ins = 0, outs = 0;
    for (int i = 0; i < 4; i++) {
        if (one >> i & 1)
            in[ins++] = i;
        else
            out[outs++] = i;
    }
    const uint16_t a = k->label[in[0]], b = k->label[out[0]];
    if (ins == 2)
        return piece_of(k, a, b,
                        (unsigned[]){1U << in[0] | 1U << out[0], 1U << in[0] | 1U << out[1],
                                     1U << in[1] | 1U << out[1], 1U << in[1] | 1U << out[0]},
                        4, e);
    const unsigned tip = 1U << (ins == 1 ? in[0] : out[0]);
    const int *base = ins == 1 ? out : in;
    return piece_of(k, a, b, (unsigned[]){tip | 1U << base[0], tip | 1U << base[1], tip | 1U << base[2]}, 3,
                    e);
}

/* Divides a tetrahedron of three materials; corners i and j have the same. The two interfaces of their
 * material and the interface of the other two meet in a segment between two face vertices. */
static bool cut_in_three(mesh_build *k, int i, int j, error *e)
{
    int other[2], count = 0;
    for (int n = 0; n < 4; n++)
        if (n != i && n != j) other[count++] = n;
    const unsigned p = 1U << i, q = 1U << j, r = 1U << other[0], s = 1U << other[1], near = p | r | s,
                   far = q | r | s;
    const uint16_t own = k->label[i], first = k->label[other[0]], second = k->label[other[1]];
    return piece_of(k, own, first, (unsigned[]){p | r, q | r, far, near}, 4, e) &&
           piece_of(k, own, second, (unsigned[]){p | s, q | s, far, near}, 4, e) &&
           piece_of(k, first, second, (unsigned[]){r | s, near, far}, 3, e);
}

static bool cut_in_four(mesh_build *k, error *e)
{
    for (int i = 0; i < 4; i++)
        for (int j = i + 1; j < 4; j++) {
            const unsigned both = 1U << i | 1U << j, rest = 15U ^ both, low = rest & -rest;
            if (!piece_of(k, k->label[i], k->label[j], (unsigned[]){both, both | low, 15U, 15U ^ low}, 4, e))
                return false;
        }
    return true;
}

static bool cut(mesh_build *k, error *e)
{
    const uint16_t *l = k->label;
    int equal = 0, i = 0, j = 0;
    unsigned first = 0;
    for (int a = 0; a < 4; a++) {
        if (l[a] == l[0]) first |= 1U << a;
        for (int b = a + 1; b < 4; b++) {
            if (l[a] != l[b]) continue;
            equal++;
            i = a;
            j = b;
        }
    }
    switch (equal) { /* number of pairs of corners with the same material */
    case 0:
        return cut_in_four(k, e);
    case 1:
        return cut_in_three(k, i, j, e);
    case 6:
        return true;
    default:
        return cut_in_two(k, first, e);
    }
}

static bool cut_cell(mesh_build *k, error *e)
{
    for (k->number = 0; k->number < 6; k->number++) {
        for (int i = 0; i < 4; i++) {
            int64_t at[3];
            corner_of(k, i, at);
            k->label[i] = label_volume_at(k->v, at[0], at[1], at[2]);
        }
        if (!cut(k, e)) return false;
    }
    return true;
}

static bool is_mixed(const label_volume *v, int64_t x, int64_t y, int64_t z)
{
    const int64_t row = v->size[0], slice = row * v->size[1];
    const uint16_t *at = v->at + z * slice + y * row + x, own = *at;
    return at[1] != own || at[row] != own || at[row + 1] != own || at[slice] != own || at[slice + 1] != own ||
           at[slice + row] != own || at[slice + row + 1] != own;
}

/* Divides the cells whose lowest voxel lies in the block. */
static bool cut_block(mesh_build *k, const int64_t low[3], error *e)
{
    const int64_t *size = k->v->size;
    int64_t end[3];
    for (int axis = 0; axis < 3; axis++)
        end[axis] = low[axis] + BLOCK < size[axis] - 1 ? low[axis] + BLOCK : size[axis] - 1;
    for (int64_t z = low[2]; z < end[2]; z++)
        for (int64_t y = low[1]; y < end[1]; y++)
            for (int64_t x = low[0]; x < end[0]; x++) {
                memcpy(k->at, (int64_t[3]){x, y, z}, sizeof k->at);
                if (is_mixed(k->v, x, y, z) && !cut_cell(k, e)) return false;
            }
    return true;
}

static bool check_count(const mesh_build *k, error *e)
{
    return k->m.triangle_count <= k->most ||
           error_set(e, ERROR_LIMIT_MEMORY,
                     "the interfaces of its labels have more than %zu triangles, which exceed the memory "
                     "limit: choose fewer labels, or raise limits.memory_mb; for an image, use "
                     "surface.volume with an isovalue",
                     k->most);
}

/* Divides all cells, block by block, so that vertices near each other in space are near each other in
 * memory. */
static bool cut_cells(mesh_build *k, error *e)
{
    const int64_t *size = k->v->size;
    if (!block_map_init(&k->numbers, 4096, e)) return false;
    for (int64_t z = 0; z < size[2]; z += BLOCK)
        for (int64_t y = 0; y < size[1]; y += BLOCK)
            for (int64_t x = 0; x < size[0]; x += BLOCK)
                if (!cut_block(k, (int64_t[3]){x, y, z}, e) || !check_count(k, e)) return false;
    return true;
}

/* ---- public functions */

static void keep_wanted(mesh_build *k, label_mesh_wanted *wanted, const void *context)
{
    size_t kept = 0;
    for (size_t n = 0; n < k->m.triangle_count; n++) {
        if (!wanted(context, (uint16_t)(k->kind[n] >> 16), (uint16_t)k->kind[n])) continue;
        memmove(k->m.triangle[kept], k->m.triangle[n], sizeof *k->m.triangle);
        k->kind[kept++] = k->kind[n];
    }
    k->m.triangle_count = kept;
}

static void to_world(mesh *m, const double map[3][4])
{
    double inverse[3][4];
    for (size_t v = 0; v < m->vertex_count; v++)
        m->vertex[v] = affine_apply(map, m->vertex[v].x, m->vertex[v].y, m->vertex[v].z);
    if (affine_invert(map, inverse) > 0) return;
    /* a mirroring transform reverses the orientation */
    for (size_t n = 0; n < m->triangle_count; n++) {
        const uint32_t swap = m->triangle[n][1];
        m->triangle[n][1] = m->triangle[n][2];
        m->triangle[n][2] = swap;
    }
}

static const char *after_majority(const label_volume *v)
{
    return v->changed > 0 ? " after surface.labels.majority" : "";
}

static bool make(mesh_build *k, double smooth, label_mesh_wanted *wanted, const void *context, threads *pool,
                 error *e)
{
    if (!cut_cells(k, e)) return false;
    block_map_free(&k->numbers);
    k->numbers = (block_map){0};
    if (k->m.triangle_count == 0)
        return error_set(e, ERROR_NO_SURFACE,
                         "all voxels have the label %lld%s, so there is no interface: set "
                         "/surface/labels/closed to make the end of the data one",
                         (long long)k->v->material[label_volume_at(k->v, 0, 0, 0)].value,
                         after_majority(k->v));
    const label_smoothing smoothing = {smooth, k->limit, {k->v->size[0], k->v->size[1], k->v->size[2]}};
    if (!label_smoothing_apply(&smoothing, &k->m, k->kind, pool, e)) return false;
    if (wanted) keep_wanted(k, wanted, context);
    if (k->m.triangle_count == 0)
        return error_set(e, ERROR_NO_SURFACE,
                         "the labels of /surface/labels/interfaces do not touch%s: run hexadctl inspect for "
                         "the labels that do",
                         after_majority(k->v));
    to_world(&k->m, k->v->index_to_world);
    return true;
}

bool label_mesh_make(const label_volume *v, double smooth, label_mesh_wanted *wanted, const void *context,
                     size_t most, threads *pool, label_mesh *out, error *e)
{
    mesh_build k = {.v = v, .most = most};
    bool ok = make(&k, smooth, wanted, context, pool, e);
    block_map_free(&k.numbers);
    free(k.limit);
    label_mesh made = {k.m, k.kind};
    if (ok)
        *out = made;
    else
        label_mesh_free(&made);
    return ok;
}

void label_mesh_free(label_mesh *m)
{
    mesh_free(&m->m);
    free(m->kind);
    *m = (label_mesh){0};
}
