// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/mesh_array.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "io/meshes/mesh_check.h"
#include "io/meshes/plain_mesh.h"

static const char what[] = "the mesh";

static bool may_go_on(const array_view *a, error *e)
{
    return !array_view_stopped(a) || error_set(e, ERROR_CANCELLED, "stopped");
}

static vec3 *read_vertices(const array_view *a, error *e)
{
    vec3 *out = mem_array(a->size[0], sizeof *out, what, e);
    for (size_t i = 0; out && i < a->size[0] && !array_view_stopped(a); i++)
        out[i] =
            vec3_make(array_view_number(a, i, 0), array_view_number(a, i, 1), array_view_number(a, i, 2));
    if (!out || may_go_on(a, e)) return out;
    free(out);
    return NULL;
}

static bool check_index(const mesh_array *a, int64_t index, size_t i, size_t j, error *e)
{
    if (index >= 0 && (uint64_t)index < a->vertices.size[0]) return true;
    char place[64];
    snprintf(place, sizeof place, a->faces.dimensions > 1 ? "[%zu, %zu]" : "[%zu]", i, j);
    if (a->vertices.size[0] == 0)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "faces%s is %" PRId64 ", and vertices has no rows: give the vertices", place, index);
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "faces%s is %" PRId64 ", and there are %zu vertices: an index must be from 0 to %zu",
                     place, index, a->vertices.size[0], a->vertices.size[0] - 1);
}

/* Triangles need neither cutting nor a second copy. */
static bool read_triangles(const mesh_array *a, size_t memory_limit, mesh *out, mesh_notes *notes, error *e)
{
    mesh m = {.vertex_count = a->vertices.size[0], .triangle_count = a->faces.size[0]};
    size_t unused = 0;
    if (m.triangle_count == 0)
        return error_set(e, ERROR_NO_SURFACE, "faces has no rows, and vertices has %zu: give the triangles",
                         m.vertex_count);
    if (!mesh_check_counts(m.vertex_count, m.triangle_count, 0, memory_limit, e)) return false;
    m.vertex = read_vertices(&a->vertices, e);
    m.triangle = m.vertex ? mem_array(m.triangle_count, sizeof *m.triangle, what, e) : NULL;
    bool ok = m.triangle != NULL;
    for (size_t i = 0; ok && i < m.triangle_count; i++)
        for (size_t j = 0; ok && j < 3; j++) {
            const int64_t index = array_view_whole(&a->faces, i, j);
            ok = check_index(a, index, i, j, e) && may_go_on(&a->faces, e);
            m.triangle[i][j] = (uint32_t)index;
        }
    ok = ok && mesh_check_vertices(&m, &unused, e);
    if (!ok) {
        mesh_free(&m);
        return false;
    }
    mesh_check_note_unused(notes, unused);
    *out = m;
    return true;
}

static bool add_vertices(const array_view *a, plain_mesh *to, error *e)
{
    if (!plain_mesh_expect(to, a->size[0], 0)) return false;
    for (size_t i = 0; i < a->size[0]; i++) {
        if (!may_go_on(a, e)) return false;
        const double at[3] = {array_view_number(a, i, 0), array_view_number(a, i, 1),
                              array_view_number(a, i, 2)};
        if (!plain_mesh_add_vertex(to, at)) return false;
    }
    return true;
}

/* The number of corners of face i of faces with counts. `left`: corners that are left. */
static bool read_count(const mesh_array *a, size_t i, size_t left, size_t *out, error *e)
{
    const int64_t count = array_view_whole(&a->counts, i, 0);
    if (count >= 0 && (uint64_t)count <= left) {
        *out = (size_t)count;
        return true;
    }
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "counts[%zu] is %" PRId64
                     ", and %zu of the %zu corners in faces are left: the sum of the counts "
                     "must be the length of faces",
                     i, count, left, a->faces.size[0]);
}

/* False without an error: *to is refused. */
static bool add_faces(const mesh_array *a, plain_mesh *to, error *e)
{
    const bool has_counts = a->counts.data != NULL;
    const size_t count = has_counts ? a->counts.size[0] : a->faces.size[0];
    size_t begin = 0;
    for (size_t i = 0; i < count; i++) {
        size_t corners = a->faces.size[1];
        if (!may_go_on(&a->faces, e)) return false;
        if (has_counts && !read_count(a, i, a->faces.size[0] - begin, &corners, e)) return false;
        if (!plain_mesh_expect_corners(to, corners)) return false;
        for (size_t j = 0; j < corners; j++) {
            const size_t row = has_counts ? begin + j : i, column = has_counts ? 0 : j;
            const int64_t index = array_view_whole(&a->faces, row, column);
            if (!check_index(a, index, row, column, e)) return false;
            to->corner[j] = (uint32_t)index;
        }
        if (!plain_mesh_add_polygon(to, to->corner, corners)) return false;
        begin += corners;
    }
    return !has_counts || begin == a->faces.size[0] ||
           error_set(e, ERROR_INPUT_DAMAGED, "the sum of counts is %zu, and faces has %zu corners", begin,
                     a->faces.size[0]);
}

/* Reads faces of any number of corners. Free *out also after failure. */
static bool read_polygons(const mesh_array *a, bool keeps_polygons, plain_mesh *out, error *e)
{
    error why = {0};
    *out = (plain_mesh){.keeps_polygons = keeps_polygons, .stop = a->faces.stop};
    if (add_vertices(&a->vertices, out, &why) && add_faces(a, out, &why)) return true;
    if (out->refused != ERROR_NONE) return error_set(e, out->refused, "%s", out->text);
    if (e) *e = why;
    return false;
}

static bool copy_mesh(const plain_mesh *from, size_t memory_limit, mesh *out, mesh_notes *notes, error *e)
{
    mesh m = {.vertex_count = from->vertices, .triangle_count = from->triangles};
    size_t unused = 0;
    if (!mesh_check_counts(from->vertices, from->triangles, from->others, memory_limit, e)) return false;
    m.vertex = mem_array(m.vertex_count, sizeof *m.vertex, what, e);
    m.triangle = m.vertex ? mem_array(m.triangle_count, sizeof *m.triangle, what, e) : NULL;
    if (m.triangle) {
        memcpy(m.vertex, from->vertex, m.vertex_count * sizeof *m.vertex);
        memcpy(m.triangle, from->triangle, m.triangle_count * sizeof *m.triangle);
    }
    if (!m.triangle || !mesh_check_vertices(&m, &unused, e)) {
        mesh_free(&m);
        return false;
    }
    if (from->others)
        mesh_note(notes, "the mesh has %zu points or lines in addition to its triangles: they are skipped",
                  from->others);
    mesh_check_note_crossed(notes, from->crossed);
    mesh_check_note_unused(notes, unused);
    *out = m;
    return true;
}

bool mesh_array_read(const mesh_array *a, size_t memory_limit, mesh *out, mesh_notes *notes, error *e)
{
    if (!a->counts.data && a->faces.size[1] == 3) return read_triangles(a, memory_limit, out, notes, e);
    plain_mesh read;
    const bool ok = read_polygons(a, false, &read, e) && copy_mesh(&read, memory_limit, out, notes, e);
    plain_mesh_free(&read);
    return ok;
}

/* Moves the polygons. */
static bool take_polygons(plain_mesh *from, mesh_polygons *out, error *e)
{
    mesh_polygons p = {.count = from->polygons, .corners = from->polygon_corners};
    p.first = mem_array(p.count + 1, sizeof *p.first, "the polygons of the mesh", e);
    if (!p.first) return false;
    for (size_t k = 0; k < p.count; k++) p.first[k + 1] = p.first[k] + from->polygon_size[k];
    p.size = from->polygon_size;
    p.corner = from->polygon_corner;
    from->polygon_size = from->polygon_corner = NULL;
    *out = p;
    return true;
}

bool mesh_array_read_polygons(const mesh_array *a, size_t memory_limit, mesh *out, mesh_polygons *polygons,
                              error *e)
{
    plain_mesh read;
    mesh m = {0};
    mesh_notes unused = {0}; /* dropped: mesh_array_read adds the same notes */
    bool ok = read_polygons(a, true, &read, e) && copy_mesh(&read, memory_limit, &m, &unused, e) &&
              take_polygons(&read, polygons, e);
    plain_mesh_free(&read);
    if (ok)
        *out = m;
    else
        mesh_free(&m);
    return ok;
}

bool mesh_array_read_points(const array_view *a, size_t memory_limit, vec3 **out, size_t *count, error *e)
{
    const size_t n = a->size[0];
    if (n == 0) return error_set(e, ERROR_INPUT_DAMAGED, "the array has no points: give one with points");
    if (n > memory_limit / sizeof **out)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "its %zu points require more memory than is left: raise limits.memory_mb", n);
    vec3 *point = read_vertices(a, e);
    if (!point || !mesh_check_points(point, n, e)) {
        free(point);
        return false;
    }
    *out = point;
    *count = n;
    return true;
}
