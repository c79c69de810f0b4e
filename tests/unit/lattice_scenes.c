// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "lattice_scenes.h"

static const vec3 along_x = {1, 0, 0}, along_y = {0, 1, 0};

scene scene_rectangle(int n, int rows)
{
    scene s = {0};
    const double height = (rows - 1) * ROW;
    scene_quad(&s, (vec3){0, 0, 0}, (vec3){n, 0, 0}, (vec3){n, height, 0}, (vec3){0, height, 0});
    scene_rows(&s, (vec3){0, 0, 0}, along_x, along_y, n, rows);
    return s;
}

scene scene_open_triangle(int n)
{
    scene s = {0};
    scene_lattice_triangle(&s, (vec3){0, 0, 0}, (vec3){n, 0, 0}, (vec3){0.5 * n, n * ROW, 0}, n);
    return s;
}

static void add_box(scene *s, vec3 size)
{
    vec3 c[8];
    for (int k = 0; k < 8; k++) c[k] = (vec3){k & 1 ? size.x : 0, k & 2 ? size.y : 0, k & 4 ? size.z : 0};
    scene_quad(s, c[0], c[2], c[3], c[1]);
    scene_quad(s, c[4], c[5], c[7], c[6]);
    scene_quad(s, c[0], c[1], c[5], c[4]);
    scene_quad(s, c[2], c[6], c[7], c[3]);
    scene_quad(s, c[0], c[4], c[6], c[2]);
    scene_quad(s, c[1], c[3], c[7], c[5]);
}

scene scene_plate(int n, int rows, double thickness)
{
    scene s = {0};
    add_box(&s, (vec3){n, (rows - 1) * ROW, thickness});
    scene_rows(&s, (vec3){0, 0, 0}, along_x, along_y, n, rows);
    scene_rows(&s, (vec3){0, 0, thickness}, along_x, along_y, n, rows);
    return s;
}

scene scene_cube(int n)
{
    scene s = {0};
    add_box(&s, (vec3){n, n, n});
    for (int i = 0; i <= n; i++)
        for (int j = 0; j <= n; j++)
            for (int k = 0; k <= n; k++)
                if (i % n == 0 || j % n == 0 || k % n == 0) scene_point(&s, (vec3){i, j, k});
    return s;
}

static vec3 tube_place(int half_steps, int n, double z)
{
    const double angle = M_PI * half_steps / n, radius = 0.5 / sin(M_PI / n);
    return (vec3){radius * cos(angle), radius * sin(angle), z};
}

scene scene_tube(int n, int rows)
{
    scene s = {.smooth = true};
    const double chord = sin(M_PI / (2 * n)) / sin(M_PI / n), step = sqrt(1 - chord * chord);
    for (int row = 0; row < rows; row++)
        for (int k = 0; k < 2 * n; k++) {
            const double z = row * step, next = z + step;
            if ((k + row) % 2 == 0) scene_point(&s, tube_place(k, n, z));
            if (row + 1 < rows)
                scene_quad(&s, tube_place(k, n, z), tube_place(k + 1, n, z), tube_place(k + 1, n, next),
                           tube_place(k, n, next));
        }
    return s;
}

static vec3 torus_place(int half_steps, int row, int n, int rows)
{
    const double u = M_PI * half_steps / n, v = 2 * M_PI * row / rows, major = n / (2 * M_PI),
                 minor = rows * ROW / (2 * M_PI), out = major + minor * cos(v);
    return (vec3){out * cos(u), out * sin(u), minor * sin(v)};
}

scene scene_torus(int n, int rows)
{
    scene s = {.smooth = true};
    for (int row = 0; row < rows; row++)
        for (int k = 0; k < 2 * n; k++) {
            if ((k + row) % 2 == 0) scene_point(&s, torus_place(k, row, n, rows));
            scene_quad(&s, torus_place(k, row, n, rows), torus_place(k + 1, row, n, rows),
                       torus_place(k + 1, row + 1, n, rows), torus_place(k, row + 1, n, rows));
        }
    return s;
}

/* Adds the triangles between corners at the distance `side`, with outward normals. */
static void add_solid(scene *s, const vec3 *corner, int count, double side, int n)
{
    for (int a = 0; a < count; a++)
        for (int b = a + 1; b < count; b++)
            for (int c = b + 1; c < count; c++) {
                const vec3 ab = vec3_sub(corner[b], corner[a]), ac = vec3_sub(corner[c], corner[a]);
                if (fabs(vec3_norm(ab) - side) > 1e-9 || fabs(vec3_norm(ac) - side) > 1e-9 ||
                    fabs(vec3_norm(vec3_sub(corner[c], corner[b])) - side) > 1e-9)
                    continue;
                const double scale = n / side;
                const bool turned = vec3_dot(vec3_cross(ab, ac), corner[a]) < 0;
                scene_lattice_triangle(s, vec3_scale(corner[a], scale),
                                       vec3_scale(corner[turned ? c : b], scale),
                                       vec3_scale(corner[turned ? b : c], scale), n);
            }
}

scene scene_tetrahedron(int n)
{
    scene s = {0};
    const vec3 corner[] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
    add_solid(&s, corner, 4, sqrt(8), n);
    return s;
}

scene scene_octahedron(int n)
{
    scene s = {0};
    const vec3 corner[] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    add_solid(&s, corner, 6, sqrt(2), n);
    return s;
}

scene scene_icosahedron(int n)
{
    scene s = {0};
    const double g = (1 + sqrt(5)) / 2;
    vec3 corner[12];
    for (int k = 0; k < 4; k++) {
        const double one = k & 1 ? 1 : -1, golden = k & 2 ? g : -g;
        corner[3 * k] = (vec3){0, one, golden};
        corner[3 * k + 1] = (vec3){one, golden, 0};
        corner[3 * k + 2] = (vec3){golden, 0, one};
    }
    add_solid(&s, corner, 12, 2, n);
    return s;
}

static vec3 sphere_place(int i, int along, int k, int around)
{
    const double v = M_PI * i / along, u = 2 * M_PI * k / around, out = i == 0 || i == along ? 0 : sin(v);
    return (vec3){out * cos(u), out * sin(u), cos(v)};
}

scene scene_sphere(int along, int around)
{
    scene s = {.smooth = true};
    for (int i = 0; i < along; i++)
        for (int k = 0; k < around; k++) {
            const vec3 a = sphere_place(i, along, k, around), b = sphere_place(i + 1, along, k, around),
                       c = sphere_place(i + 1, along, k + 1, around),
                       d = sphere_place(i, along, k + 1, around);
            if (i + 1 < along) scene_triangle(&s, a, b, c);
            if (i > 0) scene_triangle(&s, a, c, d);
        }
    return s;
}

scene scene_half_planes(int n, int rows, const double *angle, int count)
{
    scene s = {0};
    for (int k = 0; k < count; k++) {
        const vec3 up = {0, cos(angle[k]), sin(angle[k])}, top = vec3_scale(up, (rows - 1) * ROW);
        const vec3 a = {0, 0, 0}, b = {n, 0, 0}, c = vec3_add(b, top);
        if (angle[k] < 0.999 * M_PI) /* the two halves of a plane have one normal */
            scene_quad(&s, a, b, c, top);
        else
            scene_quad(&s, b, a, top, c);
        scene_rows(&s, a, along_x, up, n, rows);
    }
    return s;
}

scene scene_shells(int n, double factor)
{
    scene s = scene_icosahedron(n), inner = scene_icosahedron(n);
    for (size_t k = 0; k < inner.triangles; k++) {
        vec3 c[3];
        for (int i = 0; i < 3; i++) c[i] = vec3_scale(inner.vertex[inner.triangle[k][i]], factor);
        scene_triangle(&s, c[0], c[1], c[2]);
    }
    for (size_t k = 0; k < inner.points; k++) scene_point(&s, vec3_scale(inner.point[k], factor));
    scene_free(&inner);
    return s;
}
