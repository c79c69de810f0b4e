// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/vtk_data.h"

const char *vtk_cells_name(vtk_cells_kind kind)
{
    static const char *const names[VTK_CELLS_KINDS] = {"Verts", "Lines", "Strips", "Polys"};
    return names[kind];
}

/* Adds the triangles of a strip. Odd triangles have opposite orientation. */
static bool add_strip(plain_mesh *m, size_t count)
{
    for (size_t k = 0; k + 2 < count; k++)
        if (!plain_mesh_add_triangle(m, m->corner[k], m->corner[k + 1], m->corner[k + 2], k % 2 == 1))
            return false;
    return true;
}

bool vtk_add_cell(plain_mesh *m, vtk_cells_kind kind, int64_t cell, const int64_t *vertex, size_t count,
                  size_t first)
{
    if (!plain_mesh_expect_corners(m, count)) return false;
    for (size_t k = 0; k < count; k++) {
        if (vertex[k] < 0 || vertex[k] >= (int64_t)(m->vertices - first))
            return plain_mesh_refuse(
                m, ERROR_INPUT_DAMAGED,
                "cell %lld of %s has the point %lld, and there are %zu points: repair the file",
                (long long)cell, vtk_cells_name(kind), (long long)vertex[k], m->vertices - first);
        m->corner[k] = (uint32_t)((size_t)vertex[k] + first);
    }
    if (kind == VTK_VERTS || kind == VTK_LINES || (kind == VTK_STRIPS && count < 3)) {
        m->others++;
        return true;
    }
    return kind == VTK_STRIPS ? add_strip(m, count) : plain_mesh_add_polygon(m, m->corner, count);
}
