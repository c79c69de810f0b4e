// SPDX-License-Identifier: Apache-2.0
#include "job/source/mesh_clip.h"

#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/affine.h"

/* Maximum corners of a triangle that is clipped at six planes. */
enum { MOST_CORNERS = 9 };

typedef struct clipped_mesh {
    mesh out; /* three vertices for each triangle */
    size_t vertex_room, triangle_room;
} clipped_mesh;

void mesh_move(mesh *m, const double to_world[3][4])
{
    double unused[3][4];
    m->welded = false;
    for (size_t k = 0; k < m->vertex_count; k++)
        m->vertex[k] = affine_apply(to_world, m->vertex[k].x, m->vertex[k].y, m->vertex[k].z);
    if (affine_invert(to_world, unused) > 0) return;
    for (size_t n = 0; n < m->triangle_count; n++) {
        uint32_t *t = m->triangle[n], first = t[0];
        t[0] = t[1];
        t[1] = first;
    }
}

static bool comes_before(vec3 a, vec3 b)
{
    return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.z < b.z;
}

/* Intersection of a side with the plane; equal to the last bit for both directions of the side. */
static vec3 meet(vec3 a, vec3 b, int axis, double at)
{
    if (comes_before(b, a)) return meet(b, a, axis, at);
    const double from = vec3_get(a, axis);
    vec3 out = vec3_axpy((at - from) / (vec3_get(b, axis) - from), vec3_sub(b, a), a);
    vec3_set(&out, axis, at);
    return out;
}

/* Keeps the part of the polygon above `at` along the axis, or below it. Source: Sutherland and Hodgman 1974,
 * "Reentrant Polygon Clipping". */
static int cut(vec3 corner[MOST_CORNERS], int count, int axis, double at, bool above)
{
    vec3 kept[MOST_CORNERS];
    int next = 0;
    for (int k = 0; k < count; k++) {
        const vec3 a = corner[k], b = corner[(k + 1) % count];
        const double x = above ? vec3_get(a, axis) - at : at - vec3_get(a, axis),
                     y = above ? vec3_get(b, axis) - at : at - vec3_get(b, axis);
        if (x >= 0) kept[next++] = a;
        if ((x > 0 && y < 0) || (x < 0 && y > 0)) kept[next++] = meet(a, b, axis, at);
    }
    memcpy(corner, kept, (size_t)next * sizeof *kept);
    return next < 3 ? 0 : next;
}

static bool add_triangle(clipped_mesh *c, vec3 a, vec3 b, vec3 d, error *e)
{
    const char *what = "the mesh within the region";
    const vec3 corner[3] = {a, b, d};
    mesh *m = &c->out;
    if (!MEM_GROW(m->triangle, m->triangle_count, &c->triangle_room, what, e)) return false;
    for (int k = 0; k < 3; k++) {
        if (!MEM_GROW(m->vertex, m->vertex_count, &c->vertex_room, what, e)) return false;
        m->triangle[m->triangle_count][k] = (uint32_t)m->vertex_count;
        m->vertex[m->vertex_count++] = corner[k];
    }
    m->triangle_count++;
    return true;
}

bool mesh_clip(mesh *m, bbox box, error *e)
{
    clipped_mesh c = {0};
    bool ok = true;
    for (size_t n = 0; ok && n < m->triangle_count; n++) {
        vec3 corner[MOST_CORNERS];
        int count = 3;
        mesh_get_corners(m, n, corner);
        for (int axis = 0; axis < 3; axis++) {
            count = cut(corner, count, axis, vec3_get(box.min, axis), true);
            count = cut(corner, count, axis, vec3_get(box.max, axis), false);
        }
        for (int k = 2; ok && k < count; k++) ok = add_triangle(&c, corner[0], corner[k - 1], corner[k], e);
    }
    if (ok && c.out.triangle_count == 0)
        ok = error_set(e, ERROR_NO_SURFACE,
                       "no part of the mesh is inside the region: move or enlarge the region");
    mesh_free(ok ? m : &c.out);
    if (ok) *m = c.out;
    return ok;
}
