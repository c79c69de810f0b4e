// SPDX-License-Identifier: Apache-2.0
/* faces: surfaces made of flat rectangles, as fields with patches, for tests of patches. */
#ifndef HEXAD_TESTS_FACES_H
#define HEXAD_TESTS_FACES_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "surface/field/patches.h"

enum { FACES_MOST = 8, FACE_CELLS = 20 /* along each side */ };

/* A rectangle: centre, half side vectors, normal. */
typedef struct face {
    field base; /* its own F: the height above its plane */
    vec3 centre, u, v, normal;
} face;

typedef struct faces {
    field base;
    size_t count;
    face face[FACES_MOST];
    field_patches patches;
    field_patch patch[FACES_MOST];
    field_curve curve[4 * FACES_MOST];
    vec3 vertex[8 * FACES_MOST];
    uint32_t curve_patch[4 * FACES_MOST];
} faces;

static bool face_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const face *a = (const face *)f;
    out->value = vec3_dot(vec3_sub(x, a->centre), a->normal);
    out->gradient = a->normal;
    if (order == FIELD_HESSIAN) out->hessian = (sym3){0};
    return true;
}

static bool face_within(const field *f, vec3 x, uint32_t *hint)
{
    (void)hint;
    const face *a = (const face *)f;
    vec3 r = vec3_sub(x, a->centre);
    double hair = 1 + 1e-9;
    return fabs(vec3_dot(r, a->u)) <= hair * vec3_norm2(a->u) &&
           fabs(vec3_dot(r, a->v)) <= hair * vec3_norm2(a->v);
}

static const field_ops face_ops = {.sample = face_sample, .within = face_within};

static const face *nearest_face(const faces *s, vec3 x)
{
    double least = INFINITY;
    const face *best = s->face;
    for (size_t k = 0; k < s->count; k++) {
        const face *a = &s->face[k];
        vec3 r = vec3_sub(x, a->centre);
        double over_u = fmax(fabs(vec3_dot(r, a->u)) / vec3_norm(a->u) - vec3_norm(a->u), 0);
        double over_v = fmax(fabs(vec3_dot(r, a->v)) / vec3_norm(a->v) - vec3_norm(a->v), 0);
        double height = vec3_dot(r, a->normal), square = over_u * over_u + over_v * over_v + height * height;
        if (square >= least) continue;
        least = square;
        best = a;
    }
    return best;
}

static bool faces_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    return face_sample(&nearest_face((const faces *)f, x)->base, x, order, out);
}

static size_t faces_cell_count(const field *f)
{
    return ((const faces *)f)->count * FACE_CELLS * FACE_CELLS;
}

static vec3 face_place(const face *a, double u, double v)
{
    return vec3_axpy(u, a->u, vec3_axpy(v, a->v, a->centre));
}

/* The two triangles of a square cell. */
static int faces_cell_triangles(const field *f, size_t k, vec3 out[FIELD_CELL_TRIANGLES][3])
{
    const face *a = &((const faces *)f)->face[k / (FACE_CELLS * FACE_CELLS)];
    double step = 2.0 / FACE_CELLS, u = -1 + step * (double)(k % FACE_CELLS),
           v = -1 + step * (double)(k / FACE_CELLS % FACE_CELLS);
    vec3 corner[4] = {face_place(a, u, v), face_place(a, u + step, v), face_place(a, u + step, v + step),
                      face_place(a, u, v + step)};
    for (int t = 0; t < 2; t++) {
        out[t][0] = corner[0];
        out[t][1] = corner[1 + t];
        out[t][2] = corner[2 + t];
    }
    return 2;
}

static void faces_cell(const field *f, size_t k, field_cell *out)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    bbox box = bbox_empty();
    faces_cell_triangles(f, k, t);
    for (int c = 0; c < 6; c++) box = bbox_include(box, t[c / 3][c % 3]);
    *out = (field_cell){.hidden_crossing = false};
    for (int c = 0; c < 8; c++)
        out->corner[c] = (vec3){c & 1 ? box.max.x : box.min.x, c & 2 ? box.max.y : box.min.y,
                                c & 4 ? box.max.z : box.min.z};
}

static uint32_t faces_patch_at(const field *f, size_t k, vec3 x)
{
    (void)f;
    (void)x;
    return (uint32_t)(k / (FACE_CELLS * FACE_CELLS));
}

static const field_ops faces_ops = {.sample = faces_sample,
                                    .cell_count = faces_cell_count,
                                    .cell = faces_cell,
                                    .cell_triangles = faces_cell_triangles,
                                    .patch_at = faces_patch_at};

/* The curve with these ends; it is added if it is missing. */
static field_curve *faces_curve(faces *s, vec3 a, vec3 b)
{
    for (field_curve *c = s->curve; c < s->curve + s->patches.curve_count; c++) {
        const vec3 *end = s->vertex + c->first;
        if ((memcmp(&end[0], &a, sizeof a) == 0 && memcmp(&end[1], &b, sizeof b) == 0) ||
            (memcmp(&end[0], &b, sizeof b) == 0 && memcmp(&end[1], &a, sizeof a) == 0))
            return c;
    }
    size_t k = s->patches.curve_count++;
    s->vertex[2 * k] = a;
    s->vertex[2 * k + 1] = b;
    s->curve[k] = (field_curve){.first = 2 * k, .count = 2};
    return &s->curve[k];
}

/* Call it after `add_face` has added all faces. */
static void faces_join(faces *s)
{
    static const double turn[5][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-1, -1}};
    size_t used = 0;
    field_curve *side[FACES_MOST][4];
    bbox box = bbox_empty();
    for (size_t k = 0; k < s->count; k++) {
        const face *a = &s->face[k];
        s->patch[k] = (field_patch){&a->base, false, 4 * vec3_norm(vec3_cross(a->u, a->v))};
        for (int e = 0; e < 4; e++) {
            vec3 from = face_place(a, turn[e][0], turn[e][1]),
                 to = face_place(a, turn[e + 1][0], turn[e + 1][1]);
            box = bbox_include(box, from);
            side[k][e] = faces_curve(s, from, to);
        }
    }
    for (size_t c = 0; c < s->patches.curve_count; c++) {
        s->curve[c].patch_first = used;
        for (uint32_t k = 0; k < s->count; k++)
            for (int e = 0; e < 4; e++)
                if (side[k][e] == &s->curve[c]) s->curve_patch[used++] = k;
        s->curve[c].patch_count = used - s->curve[c].patch_first;
    }
    s->patches.count = s->count;
    s->patches.patch = s->patch;
    s->patches.curve = s->curve;
    s->patches.vertex = s->vertex;
    s->patches.curve_patch = s->curve_patch;
    s->base = (field){.ops = &faces_ops,
                      .domain = box,
                      .extent = bbox_longest(box),
                      .cell_size = 0.1,
                      .patches = &s->patches};
    field_set_boundary(&s->base, 0);
    for (size_t k = 0; k < s->count; k++) s->face[k].base.cell_size = 0.1;
}

static void add_face(faces *s, vec3 centre, vec3 u, vec3 v)
{
    s->face[s->count++] = (face){
        .base = {.ops = &face_ops}, .centre = centre, .u = u, .v = v, .normal = vec3_unit(vec3_cross(u, v))};
}

/* The cube of side 1 centred at the origin. */
static void make_cube(faces *s)
{
    *s = (faces){0};
    for (int axis = 0; axis < 3; axis++)
        for (int high = 0; high < 2; high++) {
            vec3 centre = {0, 0, 0}, u = {0, 0, 0}, v = {0, 0, 0};
            vec3_set(&centre, axis, high ? 0.5 : -0.5);
            vec3_set(&u, (axis + 1 + !high) % 3, 0.5);
            vec3_set(&v, (axis + 1 + high) % 3, 0.5);
            add_face(s, centre, u, v);
        }
    faces_join(s);
}

#endif
