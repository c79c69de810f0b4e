// SPDX-License-Identifier: Apache-2.0
#include "mesh_fixture.h"

#include "base/core/rng.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "geometry/mesh/mesh_weld.h"
#include "base/core/memory.h"

threads *mesh_fixture_pool(void)
{
    static threads *pool;
    if (!pool) pool = threads_new(2, NULL, NULL);
    return pool;
}

static mesh with_room(size_t vertices, size_t triangles)
{
    mesh m = {0};
    m.vertex = mem_array(vertices, sizeof *m.vertex, "test", NULL);
    m.triangle = mem_array(triangles, sizeof *m.triangle, "test", NULL);
    return m;
}

static uint32_t add_vertex(mesh *m, vec3 v)
{
    m->vertex[m->vertex_count] = v;
    return (uint32_t)m->vertex_count++;
}

static void add_triangle(mesh *m, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t *t = m->triangle[m->triangle_count++];
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

static mesh icosahedron(void)
{
    static const uint32_t faces[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                          {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                          {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                          {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    const double t = (1 + sqrt(5)) / 2;
    const vec3 corners[12] = {{-1, t, 0},  {1, t, 0},  {-1, -t, 0}, {1, -t, 0}, {0, -1, t},  {0, 1, t},
                              {0, -1, -t}, {0, 1, -t}, {t, 0, -1},  {t, 0, 1},  {-t, 0, -1}, {-t, 0, 1}};
    mesh m = with_room(12, 20);
    for (int k = 0; k < 12; k++) add_vertex(&m, vec3_unit(corners[k]));
    for (int k = 0; k < 20; k++) add_triangle(&m, faces[k][0], faces[k][1], faces[k][2]);
    return m;
}

/* Midpoints of shared edges are made twice with equal coordinates, so that every ball tests the welding. */
static mesh split(mesh m)
{
    mesh out = with_room(m.vertex_count + 3 * m.triangle_count, 4 * m.triangle_count);
    for (size_t k = 0; k < m.vertex_count; k++) add_vertex(&out, m.vertex[k]);
    for (size_t k = 0; k < m.triangle_count; k++) {
        uint32_t middle[3];
        const uint32_t *t = m.triangle[k];
        for (int i = 0; i < 3; i++) {
            uint32_t a = t[i], b = t[(i + 1) % 3];
            middle[i] = add_vertex(&out, vec3_unit(a < b ? vec3_add(m.vertex[a], m.vertex[b])
                                                         : vec3_add(m.vertex[b], m.vertex[a])));
        }
        for (int i = 0; i < 3; i++) add_triangle(&out, t[i], middle[i], middle[(i + 2) % 3]);
        add_triangle(&out, middle[0], middle[1], middle[2]);
    }
    mesh_free(&m);
    return out;
}

mesh mesh_fixture_ball(vec3 center, double radius, int splits)
{
    mesh m = icosahedron();
    mesh_notes notes = {0};
    for (int k = 0; k < splits; k++) {
        m = split(m);
        if (k + 1 < splits) mesh_weld(&m, MESH_DROP_CANCELLED, &notes, NULL);
    }
    m.welded = false;
    for (size_t k = 0; k < m.vertex_count; k++) m.vertex[k] = vec3_axpy(radius, m.vertex[k], center);
    return m;
}

static vec3 rotate(vec3 p, double angle)
{
    const vec3 axis = vec3_unit((vec3){1, 2, 3}); /* Rodrigues' formula */
    vec3 out = vec3_scale(p, cos(angle));
    out = vec3_axpy(sin(angle), vec3_cross(axis, p), out);
    return vec3_axpy((1 - cos(angle)) * vec3_dot(axis, p), axis, out);
}

vec3 mesh_fixture_unturn(vec3 p, double angle)
{
    return rotate(p, -angle);
}

mesh mesh_fixture_box(vec3 center, vec3 half, double angle)
{
    static const uint32_t faces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    mesh m = with_room(8, 12);
    for (int k = 0; k < 8; k++) {
        vec3 p = {k & 1 ? half.x : -half.x, k & 2 ? half.y : -half.y, k & 4 ? half.z : -half.z};
        add_vertex(&m, vec3_add(center, rotate(p, angle)));
    }
    for (int k = 0; k < 6; k++) {
        add_triangle(&m, faces[k][0], faces[k][1], faces[k][2]);
        add_triangle(&m, faces[k][0], faces[k][2], faces[k][3]);
    }
    return m;
}

mesh mesh_fixture_sheet(int nu, int nv, vec3 (*place)(double u, double v))
{
    mesh m = with_room((size_t)(nu + 1) * (size_t)(nv + 1), 2 * (size_t)nu * (size_t)nv);
    for (int j = 0; j <= nv; j++)
        for (int i = 0; i <= nu; i++) add_vertex(&m, place(i / (double)nu, j / (double)nv));
    for (int j = 0; j < nv; j++)
        for (int i = 0; i < nu; i++) {
            uint32_t a = (uint32_t)(j * (nu + 1) + i), b = a + 1, c = a + (uint32_t)nu + 1, d = c + 1;
            add_triangle(&m, a, b, d);
            add_triangle(&m, a, d, c);
        }
    return m;
}

vec3 mesh_fixture_rounded(vec3 p)
{
    return vec3_make(round(p.x * 1e9) / 1e9, round(p.y * 1e9) / 1e9, round(p.z * 1e9) / 1e9);
}

vec3 mesh_fixture_moebius(double u, double v)
{
    const double a = 2 * M_PI * u, w = 0.6 * (v - 0.5), r = 1 + w * cos(a / 2);
    return mesh_fixture_rounded(vec3_make(r * cos(a), r * sin(a), w * sin(a / 2)));
}

void mesh_fixture_append(mesh *a, mesh b)
{
    mesh out = with_room(a->vertex_count + b.vertex_count, a->triangle_count + b.triangle_count);
    const uint32_t base = (uint32_t)a->vertex_count;
    for (size_t k = 0; k < a->vertex_count; k++) add_vertex(&out, a->vertex[k]);
    for (size_t k = 0; k < b.vertex_count; k++) add_vertex(&out, b.vertex[k]);
    for (size_t k = 0; k < a->triangle_count; k++)
        add_triangle(&out, a->triangle[k][0], a->triangle[k][1], a->triangle[k][2]);
    for (size_t k = 0; k < b.triangle_count; k++)
        add_triangle(&out, base + b.triangle[k][0], base + b.triangle[k][1], base + b.triangle[k][2]);
    mesh_free(a);
    mesh_free(&b);
    *a = out;
}

void mesh_fixture_turn(mesh *m, size_t triangle)
{
    uint32_t *t = m->triangle[triangle], swap = t[0];
    t[0] = t[1];
    t[1] = swap;
}

void mesh_fixture_remove(mesh *m, size_t triangle)
{
    m->triangle_count--;
    memmove(m->triangle + triangle, m->triangle + triangle + 1,
            (m->triangle_count - triangle) * sizeof *m->triangle);
}

void mesh_fixture_add(mesh *m, uint32_t a, uint32_t b, uint32_t c)
{
    mesh one = with_room(0, 1);
    add_triangle(&one, a - (uint32_t)m->vertex_count, b - (uint32_t)m->vertex_count,
                 c - (uint32_t)m->vertex_count);
    mesh_fixture_append(m, one);
}

double mesh_fixture_area(const mesh *m)
{
    double area = 0;
    for (size_t k = 0; k < m->triangle_count; k++) {
        const uint32_t *t = m->triangle[k];
        vec3 a = m->vertex[t[0]];
        area += 0.5 * vec3_norm(vec3_cross(vec3_sub(m->vertex[t[1]], a), vec3_sub(m->vertex[t[2]], a)));
    }
    return area;
}

mesh_fixture_points *mesh_fixture_scatter(const mesh *m, double spacing, uint64_t seed, int trials)
{
    mesh_fixture_points *s = calloc(1, sizeof *s);
    rng r = rng_seed(seed, 0);
    double *area_up_to = calloc(m->triangle_count, sizeof *area_up_to), area = 0;
    for (size_t n = 0; n < m->triangle_count; n++) {
        const vec3 a = m->vertex[m->triangle[n][0]];
        area += 0.5 * vec3_norm(vec3_cross(vec3_sub(m->vertex[m->triangle[n][1]], a),
                                           vec3_sub(m->vertex[m->triangle[n][2]], a)));
        area_up_to[n] = area;
    }
    for (int trial = 0; trial < trials && s->count < MESH_FIXTURE_POINTS; trial++) {
        const double at = rng_uniform(&r) * area;
        double u = rng_uniform(&r), v = rng_uniform(&r);
        size_t n = 0, last = m->triangle_count - 1;
        while (n < last) { /* the first triangle up to whose end the area is at least `at` */
            const size_t middle = (n + last) / 2;
            if (area_up_to[middle] < at)
                n = middle + 1;
            else
                last = middle;
        }
        const vec3 a = m->vertex[m->triangle[n][0]], b = vec3_sub(m->vertex[m->triangle[n][1]], a),
                   c = vec3_sub(m->vertex[m->triangle[n][2]], a), across = vec3_cross(b, c);
        if (u + v > 1) {
            u = 1 - u;
            v = 1 - v;
        }
        const vec3 x = vec3_axpy(u, b, vec3_axpy(v, c, a)), normal = vec3_unit(across);
        bool free_place = true;
        for (size_t i = 0; i < s->count && free_place; i++)
            free_place =
                vec3_dot(s->normal[i], normal) < 0 || vec3_norm(vec3_sub(s->position[i], x)) > 0.7 * spacing;
        if (!free_place) continue;
        s->position[s->count] = x;
        s->normal[s->count] = normal;
        s->spacing[s->count] = spacing;
        s->name[s->count] = (uint32_t)s->count;
        s->count++;
    }
    free(area_up_to);
    return s;
}

static void print_binary_stl(const mesh *m, FILE *file)
{
    char head[80] = "binary";
    uint32_t count = (uint32_t)m->triangle_count;
    fwrite(head, sizeof head, 1, file);
    fwrite(&count, sizeof count, 1, file);
    for (size_t k = 0; k < m->triangle_count; k++) {
        float v[12] = {0};
        uint16_t attribute = 0;
        for (int i = 0; i < 3; i++) {
            vec3 p = m->vertex[m->triangle[k][i]];
            v[3 + 3 * i] = (float)p.x;
            v[4 + 3 * i] = (float)p.y;
            v[5 + 3 * i] = (float)p.z;
        }
        fwrite(v, sizeof v, 1, file);
        fwrite(&attribute, sizeof attribute, 1, file);
    }
}

static void print_stl(const mesh *m, FILE *file)
{
    fprintf(file, "solid test\n");
    for (size_t k = 0; k < m->triangle_count; k++) {
        fprintf(file, "facet normal 0 0 0\nouter loop\n");
        for (int i = 0; i < 3; i++) {
            vec3 p = m->vertex[m->triangle[k][i]];
            fprintf(file, "vertex %.17g %.17g %.17g\n", p.x, p.y, p.z);
        }
        fprintf(file, "endloop\nendfacet\n");
    }
    fprintf(file, "endsolid test\n");
}

char *mesh_fixture_print(const mesh *m, const char *format, size_t *bytes)
{
    char *text;
    FILE *file = open_memstream(&text, bytes);
    bool obj = strcmp(format, "obj") == 0;
    if (strcmp(format, "bstl") == 0) {
        print_binary_stl(m, file);
    } else if (strcmp(format, "stl") == 0) {
        print_stl(m, file);
    } else {
        if (strcmp(format, "off") == 0) fprintf(file, "OFF\n%zu %zu 0\n", m->vertex_count, m->triangle_count);
        if (strcmp(format, "ply") == 0)
            fprintf(file,
                    "ply\nformat ascii 1.0\nelement vertex %zu\nproperty float x\nproperty float y\nproperty "
                    "float z\n"
                    "element face %zu\nproperty list uchar int vertex_indices\nend_header\n",
                    m->vertex_count, m->triangle_count);
        for (size_t k = 0; k < m->vertex_count; k++)
            fprintf(file, "%s%.17g %.17g %.17g\n", obj ? "v " : "", m->vertex[k].x, m->vertex[k].y,
                    m->vertex[k].z);
        for (size_t k = 0; k < m->triangle_count; k++)
            fprintf(file, "%s %u %u %u\n", obj ? "f" : "3", m->triangle[k][0] + obj, m->triangle[k][1] + obj,
                    m->triangle[k][2] + obj);
    }
    fclose(file);
    return text;
}
