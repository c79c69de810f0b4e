// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "measured_scene.h"
#include "geometry/mesh/mesh_euler.h"

#include "geometry/space/triangle.h"
#include "sampling/packing/point_flags.h"

enum { MOST_NORMALS = 16 };

static void *grown(void *array, size_t count, size_t size)
{
    if (count & (count + 1)) return array; /* its capacity is 2^k - 1 elements */
    array = realloc(array, 2 * (count + 1) * size);
    assert_non_null(array);
    return array;
}

void scene_free(scene *s)
{
    free(s->vertex);
    free(s->point);
    free(s->triangle);
    free(s->spacing);
    *s = (scene){0};
}

static bool is_at(vec3 a, vec3 b)
{
    return vec3_norm(vec3_sub(a, b)) <= SCENE_ON;
}

uint32_t scene_vertex(scene *s, vec3 x)
{
    for (size_t k = 0; k < s->vertices; k++)
        if (is_at(s->vertex[k], x)) return (uint32_t)k;
    s->vertex = grown(s->vertex, s->vertices, sizeof *s->vertex);
    s->vertex[s->vertices] = x;
    return (uint32_t)s->vertices++;
}

void scene_triangle(scene *s, vec3 a, vec3 b, vec3 c)
{
    s->triangle = grown(s->triangle, s->triangles, sizeof *s->triangle);
    s->triangle[s->triangles][0] = scene_vertex(s, a);
    s->triangle[s->triangles][1] = scene_vertex(s, b);
    s->triangle[s->triangles++][2] = scene_vertex(s, c);
}

void scene_quad(scene *s, vec3 a, vec3 b, vec3 c, vec3 d)
{
    scene_triangle(s, a, b, c);
    scene_triangle(s, a, c, d);
}

void scene_point_again(scene *s, vec3 x)
{
    s->point = grown(s->point, s->points, sizeof *s->point);
    s->spacing = grown(s->spacing, s->points, sizeof *s->spacing);
    s->spacing[s->points] = 1;
    s->point[s->points++] = x;
}

void scene_point(scene *s, vec3 x)
{
    for (size_t k = 0; k < s->points; k++)
        if (is_at(s->point[k], x)) return;
    scene_point_again(s, x);
}

static double triangle_area(const scene *s, size_t k)
{
    const vec3 a = s->vertex[s->triangle[k][0]];
    return 0.5 * vec3_norm(vec3_cross(vec3_sub(s->vertex[s->triangle[k][1]], a),
                                      vec3_sub(s->vertex[s->triangle[k][2]], a)));
}

void scene_random_points(scene *s, size_t count, rng *r)
{
    double largest = 0;
    for (size_t k = 0; k < s->triangles; k++) largest = fmax(largest, triangle_area(s, k));
    for (size_t made = 0; made < count;) {
        const size_t t = (size_t)(rng_uniform(r) * (double)s->triangles);
        if (rng_uniform(r) * largest > triangle_area(s, t)) continue;
        const vec3 a = s->vertex[s->triangle[t][0]], ab = vec3_sub(s->vertex[s->triangle[t][1]], a),
                   ac = vec3_sub(s->vertex[s->triangle[t][2]], a);
        double u = rng_uniform(r), v = rng_uniform(r);
        if (u + v > 1) {
            u = 1 - u;
            v = 1 - v;
        }
        scene_point_again(s, vec3_axpy(u, ab, vec3_axpy(v, ac, a)));
        made++;
    }
}

void scene_remove(scene *s, bool (*drop)(vec3 x, const void *context), const void *context)
{
    size_t kept = 0;
    for (size_t k = 0; k < s->points; k++) {
        if (drop(s->point[k], context)) continue;
        s->spacing[kept] = s->spacing[k];
        s->point[kept++] = s->point[k];
    }
    s->points = kept;
}

void scene_set_spacing(scene *s, double h)
{
    for (size_t k = 0; k < s->points; k++) s->spacing[k] = h;
}

void scene_rows(scene *s, vec3 origin, vec3 along, vec3 up, int n, int rows)
{
    for (int row = 0; row < rows; row++)
        for (int k = 0; k <= n - row % 2; k++)
            scene_point(s, vec3_axpy(k + 0.5 * (row % 2), along, vec3_axpy(row * sqrt(0.75), up, origin)));
}

void scene_lattice_triangle(scene *s, vec3 a, vec3 b, vec3 c, int n)
{
    scene_triangle(s, a, b, c);
    const vec3 ab = vec3_scale(vec3_sub(b, a), 1.0 / n), ac = vec3_scale(vec3_sub(c, a), 1.0 / n);
    for (int i = 0; i <= n; i++)
        for (int k = 0; k <= n - i; k++) scene_point(s, vec3_axpy(i, ab, vec3_axpy(k, ac, a)));
}

/* ---- copies */

scene scene_copy(const scene *s)
{
    scene out = {.smooth = s->smooth};
    for (size_t k = 0; k < s->triangles; k++) {
        const uint32_t *t = s->triangle[k];
        scene_triangle(&out, s->vertex[t[0]], s->vertex[t[1]], s->vertex[t[2]]);
    }
    for (size_t k = 0; k < s->points; k++) {
        scene_point_again(&out, s->point[k]);
        out.spacing[k] = s->spacing[k];
    }
    return out;
}

static vec3 move(vec3 x)
{
    const vec3 axis = vec3_unit((vec3){1, 2, -3}), turn = vec3_cross(axis, x);
    const double angle = 0.7;
    const vec3 along = vec3_scale(axis, (1 - cos(angle)) * vec3_dot(axis, x));
    return vec3_add(vec3_axpy(cos(angle), x, vec3_axpy(sin(angle), turn, along)), (vec3){5, -2, 11});
}

scene scene_moved(const scene *s)
{
    scene out = scene_copy(s);
    for (size_t k = 0; k < out.vertices; k++) out.vertex[k] = move(out.vertex[k]);
    for (size_t k = 0; k < out.points; k++) out.point[k] = move(out.point[k]);
    return out;
}

scene scene_subdivided(const scene *s)
{
    scene out = {.smooth = s->smooth};
    for (size_t k = 0; k < s->triangles; k++) {
        vec3 c[3], m[3];
        for (int i = 0; i < 3; i++) c[i] = s->vertex[s->triangle[k][i]];
        for (int i = 0; i < 3; i++) m[i] = vec3_scale(vec3_add(c[(i + 1) % 3], c[(i + 2) % 3]), 0.5);
        scene_triangle(&out, c[0], m[2], m[1]);
        scene_triangle(&out, m[2], c[1], m[0]);
        scene_triangle(&out, m[1], m[0], c[2]);
        scene_triangle(&out, m[0], m[1], m[2]);
    }
    for (size_t k = 0; k < s->points; k++) {
        scene_point_again(&out, s->point[k]);
        out.spacing[k] = s->spacing[k];
    }
    return out;
}

static void random_order(rng *r, uint32_t *order, size_t count)
{
    for (size_t k = 0; k < count; k++) {
        const size_t at = (size_t)(rng_uniform(r) * (double)(k + 1));
        order[k] = order[at];
        order[at] = (uint32_t)k;
    }
}

scene scene_shuffled(const scene *s, uint64_t seed)
{
    rng r = rng_seed(seed, 7);
    const size_t most = s->triangles + s->points;
    uint32_t *order = malloc(most * sizeof *order);
    scene out = {.smooth = s->smooth};
    assert_non_null(order);
    random_order(&r, order, s->triangles);
    for (size_t k = 0; k < s->triangles; k++) { /* vertices are numbered in the order of their first use */
        const uint32_t *t = s->triangle[order[k]], first = (uint32_t)(3 * rng_uniform(&r));
        scene_triangle(&out, s->vertex[t[first]], s->vertex[t[(first + 1) % 3]],
                       s->vertex[t[(first + 2) % 3]]);
    }
    random_order(&r, order, s->points);
    for (size_t k = 0; k < s->points; k++) {
        scene_point_again(&out, s->point[order[k]]);
        out.spacing[k] = s->spacing[order[k]];
    }
    free(order);
    return out;
}

/* ---- measures */

/* The copies of the points: arrays of measures_input. */
typedef struct stand_list {
    size_t count;
    vec3 *normal;
    uint32_t *point;
    uint8_t *flags;
} stand_list;

static int count_triangles_at_edge(const scene *s, uint32_t a, uint32_t b)
{
    int count = 0;
    for (size_t k = 0; k < s->triangles; k++) {
        int found = 0;
        for (int i = 0; i < 3; i++) found += s->triangle[k][i] == a || s->triangle[k][i] == b;
        count += found == 2;
    }
    return count;
}

static bool is_on_segment(vec3 x, vec3 a, vec3 b)
{
    const vec3 ab = vec3_sub(b, a), ax = vec3_sub(x, a);
    const double t = vec3_dot(ax, ab) / vec3_norm2(ab);
    return is_at(x, vec3_axpy(t < 0 ? 0 : t > 1 ? 1 : t, ab, a));
}

/* Whether the triangle has an edge through x that belongs to no other triangle. */
static bool has_border_at(const scene *s, size_t k, vec3 x)
{
    for (int i = 0; i < 3; i++) {
        const uint32_t a = s->triangle[k][i], b = s->triangle[k][(i + 1) % 3];
        if (is_on_segment(x, s->vertex[a], s->vertex[b]) && count_triangles_at_edge(s, a, b) == 1)
            return true;
    }
    return false;
}

/* The different normals at x, at most MOST_NORMALS. */
static int find_normals(const scene *s, vec3 x, vec3 *out, bool *border)
{
    int count = 0;
    *border = false;
    for (size_t k = 0; k < s->triangles; k++) {
        const triangle t = {s->vertex[s->triangle[k][0]], s->vertex[s->triangle[k][1]],
                            s->vertex[s->triangle[k][2]]};
        if (triangle_distance2(&t, x) > SCENE_ON * SCENE_ON) continue;
        const vec3 n = vec3_unit(vec3_cross(vec3_sub(t.b, t.a), vec3_sub(t.c, t.a)));
        bool known = s->smooth && count > 0;
        for (int i = 0; i < count; i++) known |= vec3_dot(n, out[i]) > 1 - 1e-9;
        if (!known) {
            assert_in_range(count, 0, MOST_NORMALS - 1);
            out[count++] = n;
        }
        *border |= has_border_at(s, k, x);
    }
    return count;
}

/* A point that lies on no triangle has no normal: a fault of the scene. */
static stand_list find_stands(const scene *s)
{
    stand_list out = {.count = s->points};
    out.normal = calloc(s->points * MOST_NORMALS, sizeof *out.normal);
    out.point = calloc(s->points * MOST_NORMALS, sizeof *out.point);
    out.flags = calloc(s->points * MOST_NORMALS, sizeof *out.flags);
    assert_true(out.normal && out.point && out.flags);
    for (size_t i = 0; i < s->points; i++) {
        vec3 normal[MOST_NORMALS];
        bool border;
        const int count = find_normals(s, s->point[i], normal, &border);
        const uint8_t flags = count > 1 ? PACKING_FIXED | PACKING_AT_WEDGE : border ? PACKING_FIXED : 0;
        assert_true(count > 0);
        for (int k = 0; k < count; k++) {
            const size_t at = k == 0 ? i : out.count++;
            out.normal[at] = normal[k];
            out.point[at] = (uint32_t)i;
            out.flags[at] = flags;
        }
    }
    return out;
}

/* The Euler characteristic of each piece. The caller frees it. */
static double *find_euler(const scene *s, const facets_input *on, threads *pool)
{
    error e = {0};
    facets f = {0};
    mesh one = {.vertex_count = s->vertices,
                .vertex = s->vertex,
                .triangle = calloc(s->triangles, sizeof *one.triangle)};
    assert_true(facets_open(on, &f, &e));
    double *euler = calloc(f.piece_count, sizeof *euler);
    assert_true(euler && one.triangle);
    for (uint32_t p = 0; p < f.piece_count; p++) {
        one.triangle_count = 0;
        for (size_t t = 0; t < s->triangles; t++)
            if (f.piece[t] == p)
                memcpy(one.triangle[one.triangle_count++], s->triangle[t], sizeof *one.triangle);
        assert_true(mesh_euler_add(&one, true, pool, &euler[p], &e));
    }
    free(one.triangle);
    facets_free(&f);
    return euler;
}

measures scene_measure(const scene *s, const scene_options *options)
{
    error e = {0};
    threads *pool = threads_new(options && options->workers ? options->workers : 2, NULL, &e);
    stand_list stands = find_stands(s);
    double *local = calloc(s->points, sizeof *local), farthest;
    measures out;
    assert_true(pool && local);
    const facets_input on = {.triangle_count = s->triangles,
                             .vertex = s->vertex,
                             .triangle = (const uint32_t(*)[3])s->triangle,
                             .patch_count = 1};
    double *euler = find_euler(s, &on, pool);
    const measures_input in = {.surface = on,
                               .piece_euler = euler,
                               .count = s->points,
                               .position = s->point,
                               .spacing = s->spacing,
                               .h = s->spacing[0],
                               .spacing_at = options ? options->spacing_at : NULL,
                               .exact = options && options->exact,
                               .copy_count = stands.count,
                               .copy_normal = stands.normal,
                               .copy_point = stands.point,
                               .copy_flags = stands.flags};
    assert_true(measures_take(&in, pool, local, options ? options->degree : NULL, &farthest, &out, &e));
    if (options && options->local) memcpy(options->local, local, s->points * sizeof *local);
    free(stands.normal);
    free(stands.point);
    free(stands.flags);
    free(local);
    free(euler);
    threads_free(pool);
    return out;
}
