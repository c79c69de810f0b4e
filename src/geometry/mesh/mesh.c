// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/mesh.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const char what[] = "the triangles of the mesh";

void mesh_note(mesh_notes *notes, const char *format, ...)
{
    if (notes->count == MESH_MAX_NOTES) return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(notes->text[notes->count++], sizeof notes->text[0], format, arguments);
    va_end(arguments);
}

void mesh_free(mesh *m)
{
    if (!m) return;
    free(m->vertex);
    free(m->triangle);
    *m = (mesh){0};
}

bbox mesh_box(const mesh *m, threads *pool)
{
    return m->welded ? bbox_of_points(m->vertex, m->vertex_count, pool)
                     : bbox_of_corners(m->vertex, (const uint32_t *)m->triangle, 3 * m->triangle_count, pool);
}

double mesh_area(const mesh *m)
{
    double twice = 0;
    for (size_t n = 0; n < m->triangle_count; n++) twice += vec3_norm(mesh_across(m, n));
    return twice / 2;
}

bool mesh_copy(const mesh *m, threads *pool, mesh *out, error *e)
{
    mesh copy = {m->vertex_count, m->triangle_count, mem_array(m->vertex_count, sizeof *m->vertex, what, e),
                 NULL, m->welded};
    if (copy.vertex) copy.triangle = mem_array(m->triangle_count, sizeof *m->triangle, what, e);
    if (!copy.triangle) {
        mesh_free(&copy);
        return false;
    }
    threads_copy(pool, copy.vertex, m->vertex, m->vertex_count * sizeof *m->vertex);
    threads_copy(pool, copy.triangle, m->triangle, m->triangle_count * sizeof *m->triangle);
    if (!threads_stopped(pool)) {
        *out = copy;
        return true;
    }
    mesh_free(&copy);
    return error_set(e, ERROR_CANCELLED, "stopped");
}

/* Per triangle: the triangle, a sorted copy, three sides of 8 bytes in each of two lists of edges, and the
 * sets. Per vertex: its position, its slots in the hash table, and its entries in the lists of edges. */
size_t mesh_bytes(size_t vertices, size_t triangles)
{
    return vertices * (sizeof(vec3) + 32) + triangles * 128;
}

size_t mesh_drop_degenerate(mesh *m)
{
    size_t kept = 0, all = m->triangle_count;
    for (size_t n = 0; n < all; n++) {
        const uint32_t *t = m->triangle[n];
        if (mesh_is_degenerate(t)) continue;
        memmove(m->triangle[kept++], t, sizeof m->triangle[0]);
    }
    m->triangle_count = kept;
    return all - kept;
}
