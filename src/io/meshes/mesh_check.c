// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/mesh_check.h"

#include <inttypes.h>
#include <math.h>

bool mesh_check_counts(uint64_t vertices, uint64_t triangles, uint64_t others, size_t limit, error *e)
{
    if (triangles == 0)
        return error_set(
            e, ERROR_NO_SURFACE,
            "the mesh has no triangles (%llu vertices, %llu points or lines): save it with faces",
            (unsigned long long)vertices, (unsigned long long)others);
    if (vertices >= UINT32_MAX || triangles >= UINT32_MAX / 3)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the mesh has %llu vertices and %llu triangles, more than 32-bit indices allow: "
                         "split or simplify it",
                         (unsigned long long)vertices, (unsigned long long)triangles);
    size_t needed = mesh_bytes(vertices, triangles);
    if (needed <= limit) return true;
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "its %llu triangles require %zu MiB, and %zu MiB of the limit are left: raise "
                     "limits.memory_mb by at least %zu",
                     (unsigned long long)triangles, (needed >> 20) + 1, limit >> 20,
                     ((needed - limit) >> 20) + 1);
}

bool mesh_check_vertices(mesh *m, size_t *unused, error *e)
{
    *unused = 0;
    for (size_t n = 0; n < m->vertex_count; n++) *unused += !mesh_check_is_usable(m->vertex[n]);
    if (*unused == 0) return true;
    for (size_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++)
            if (!mesh_check_is_usable(m->vertex[m->triangle[n][k]]))
                return error_set(e, ERROR_INPUT_DAMAGED,
                                 "triangle %zu: its vertex %" PRIu32
                                 " has a coordinate that is not finite or exceeds %g: repair the mesh",
                                 n, m->triangle[n][k], MESH_CHECK_LARGEST);
    for (size_t n = 0; n < m->vertex_count; n++)
        if (!mesh_check_is_usable(m->vertex[n])) m->vertex[n] = m->vertex[m->triangle[0][0]];
    return true;
}

bool mesh_check_points(const vec3 *point, size_t count, error *e)
{
    for (size_t i = 0; i < count; i++)
        if (!mesh_check_is_usable(point[i]))
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "row %zu: a coordinate is not finite or exceeds %g: remove the row", i,
                             MESH_CHECK_LARGEST);
    return true;
}

void mesh_check_note_unused(mesh_notes *notes, size_t unused)
{
    if (unused > 0) mesh_note(notes, "%zu unused vertices are not finite: they are skipped", unused);
}

void mesh_check_note_crossed(mesh_notes *notes, uint64_t crossed)
{
    if (crossed > 0)
        mesh_note(notes,
                  "%llu polygons intersect themselves or are not planar: their triangles may overlap. "
                  "Triangulate them in the file.",
                  (unsigned long long)crossed);
}
