#include "io/meshes/vtk_data.h"

#include <string.h>

size_t vtk_type_bytes(vtk_type type)
{
    static const size_t bytes[VTK_TYPES] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
    return bytes[type];
}

bool vtk_type_is_whole(vtk_type type)
{
    return type < VTK_FLOAT;
}

typedef union number {
    unsigned char bytes[8];
    int8_t i8;
    uint8_t u8;
    int16_t i16;
    uint16_t u16;
    int32_t i32;
    uint32_t u32;
    int64_t i64;
    uint64_t u64;
    float f;
    double d;
} number;

static number load(const void *at, vtk_type type, bool swapped)
{
    number n = {.i64 = 0};
    const unsigned char *from = at;
    const size_t size = vtk_type_bytes(type);
    for (size_t k = 0; k < size; k++) n.bytes[k] = from[swapped ? size - 1 - k : k];
    return n;
}

int64_t vtk_whole(const void *at, vtk_type type, bool swapped)
{
    const number n = load(at, type, swapped);
    switch (type) {
    case VTK_INT8:
        return n.i8;
    case VTK_UINT8:
        return n.u8;
    case VTK_INT16:
        return n.i16;
    case VTK_UINT16:
        return n.u16;
    case VTK_INT32:
        return n.i32;
    case VTK_UINT32:
        return n.u32;
    case VTK_UINT64:
        return n.u64 > INT64_MAX ? INT64_MAX
                                 : (int64_t)n.u64; /* more than there can be, as any such number */
    default:
        return n.i64;
    }
}

double vtk_number(const void *at, vtk_type type, bool swapped)
{
    const number n = load(at, type, swapped);
    if (type == VTK_FLOAT) return (double)n.f;
    if (type == VTK_DOUBLE) return n.d;
    return type == VTK_UINT64 ? (double)n.u64 : (double)vtk_whole(at, type, swapped);
}

const char *vtk_cells_name(vtk_cells_kind kind)
{
    static const char *const names[VTK_CELLS_KINDS] = {"Verts", "Lines", "Strips", "Polys"};
    return names[kind];
}

/* A strip's triangles turn round one after the other. */
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
