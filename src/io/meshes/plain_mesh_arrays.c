// SPDX-License-Identifier: Apache-2.0
/* The arrays of a mesh that is being read, and its refusal: what the readers of all formats call. */
#include "io/meshes/plain_mesh.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "io/meshes/mesh_check.h"
#include "io/meshes/mesh_textures.h"
#include "io/meshes/polygon.h"

/* Arrays of at least this size, in bytes, use pages of 2 MiB: faults of 4 KiB pages would take longer than
 * filling the array. */
static const size_t LARGE = 4 << 20;

static bool resize(void **items, size_t *room, size_t n, size_t size)
{
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
    void *grown = realloc(*items, n * size);
    if (!grown) return false;
    const uintptr_t begin = ((uintptr_t)grown + page - 1) / page * page, end = (uintptr_t)grown + n * size;
    /* best effort: failure is ignored */
    if (n * size >= LARGE) madvise((void *)begin, end - begin, MADV_HUGEPAGE);
    *items = grown;
    *room = n;
    return true;
}

/* Makes room for n items. An array that grows gets capacity 2 n. */
static bool make_room(void **items, size_t *room, size_t n, size_t size)
{
    return n <= *room || resize(items, room, n < 512 ? 1024 : 2 * n, size);
}

bool plain_mesh_refuse_memory(plain_mesh *m)
{
    return plain_mesh_refuse(m, ERROR_LIMIT_MEMORY,
                             "reading it takes more memory than the limit: raise limits.memory_mb");
}

bool plain_mesh_make_room(plain_mesh *m, void **items, size_t *room, size_t n, size_t size)
{
    return make_room(items, room, n, size) || plain_mesh_refuse_memory(m);
}

bool plain_mesh_expect(plain_mesh *m, size_t vertices, size_t triangles)
{
    return ((vertices <= m->vertex_room ||
             resize((void **)&m->vertex, &m->vertex_room, vertices, sizeof *m->vertex)) &&
            (triangles <= m->triangle_room ||
             resize((void **)&m->triangle, &m->triangle_room, triangles, sizeof *m->triangle))) ||
           plain_mesh_refuse_memory(m);
}

bool plain_mesh_add_vertex(plain_mesh *m, const double at[3])
{
    if (m->vertices + 1 >= UINT32_MAX)
        return plain_mesh_refuse(m, ERROR_INPUT_UNSUPPORTED,
                                 "the mesh has more than %zu vertices: cut it into parts", m->vertices);
    if (!make_room((void **)&m->vertex, &m->vertex_room, m->vertices + 1, sizeof *m->vertex))
        return plain_mesh_refuse_memory(m);
    if (m->vertex_at && !mesh_check_is_usable((vec3){at[0], at[1], at[2]})) {
        if (!plain_mesh_make_room(m, (void **)&m->unusable, &m->unusable_room, m->unusables + 1,
                                  sizeof *m->unusable))
            return false;
        m->unusable[m->unusables++] = (plain_mesh_unusable){(uint32_t)m->vertices, m->vertex_at};
    }
    memcpy(m->vertex[m->vertices++], at, sizeof *m->vertex);
    return true;
}

bool plain_mesh_expect_corners(plain_mesh *m, size_t corners)
{
    return make_room((void **)&m->corner, &m->corner_room, corners, sizeof *m->corner) ||
           plain_mesh_refuse_memory(m);
}

/* Stores a polygon of the file, also with fewer than three corners: polygons are numbered. */
static bool keep_polygon(plain_mesh *m, const uint32_t *corner, size_t corners)
{
    if (!make_room((void **)&m->polygon_size, &m->polygon_room, m->polygons + 1, sizeof *m->polygon_size) ||
        !make_room((void **)&m->polygon_corner, &m->polygon_corner_room, m->polygon_corners + corners,
                   sizeof *m->polygon_corner))
        return plain_mesh_refuse_memory(m);
    m->polygon_size[m->polygons++] = (uint32_t)corners;
    if (corners > 0) memcpy(m->polygon_corner + m->polygon_corners, corner, corners * sizeof *corner);
    m->polygon_corners += corners;
    return true;
}

static bool are_equal(const plain_mesh *m, uint32_t a, uint32_t b)
{
    const double *p = m->vertex[a], *q = m->vertex[b];
    return p[0] == q[0] && p[1] == q[1] && p[2] == q[2];
}

/* Copies the corners without those that are equal to the corner before them. Returns their number. */
static size_t copy_distinct(const plain_mesh *m, const uint32_t *corner, size_t corners, uint32_t *out)
{
    size_t count = 0;
    for (size_t k = 0; k < corners; k++)
        if (!are_equal(m, corner[k], corner[k > 0 ? k - 1 : corners - 1])) out[count++] = corner[k];
    return count;
}

/* Adds the triangles of a polygon without equal corners. */
static bool cut_distinct(plain_mesh *m, const uint32_t *corner, size_t corners)
{
    const polygon_result result =
        polygon_cut((const double(*)[3])m->vertex, corner, corners, m->stop, m->triangle + m->triangles);
    if (result == POLYGON_STOPPED) return plain_mesh_refuse(m, ERROR_CANCELLED, "stopped");
    if (result != POLYGON_CUT && result != POLYGON_CROSSED)
        return plain_mesh_refuse(
            m, ERROR_INPUT_UNSUPPORTED,
            "a polygon of %zu corners takes too much work or memory to cut into triangles: cut it into smaller ones",
            corners);
    m->crossed += result == POLYGON_CROSSED;
    m->triangles += corners - 2;
    return true;
}

/* Adds the triangles of a polygon. Of a polygon with equal neighbouring corners, such as a quadrangle at the pole
 * of a sphere, they are those of its distinct corners. If polygons are kept, triangles without area follow, so that
 * there are `corners` - 2. */
static bool cut_polygon(plain_mesh *m, const uint32_t *corner, size_t corners)
{
    if (corners < 3) {
        m->others++;
        return true;
    }
    if (!make_room((void **)&m->triangle, &m->triangle_room, m->triangles + corners - 2, sizeof *m->triangle))
        return plain_mesh_refuse_memory(m);
    bool repeats = false;
    for (size_t k = 0; corners > 3 && k < corners; k++)
        repeats |= are_equal(m, corner[k], corner[k > 0 ? k - 1 : corners - 1]);
    if (!repeats) return cut_distinct(m, corner, corners);
    uint32_t *distinct = malloc(corners * sizeof *distinct);
    if (!distinct) return plain_mesh_refuse_memory(m);
    const size_t count = copy_distinct(m, corner, corners, distinct), first = m->triangles;
    const bool ok = count < 3 || cut_distinct(m, distinct, count);
    free(distinct);
    if (!ok) return false;
    m->others += count < 3;
    while (m->keeps_polygons && m->triangles < first + corners - 2)
        memcpy(m->triangle[m->triangles++], (uint32_t[3]){corner[0], corner[0], corner[0]},
               sizeof *m->triangle);
    return true;
}

bool plain_mesh_add_polygon(plain_mesh *m, const uint32_t *corner, size_t corners)
{
    return (!m->keeps_polygons || keep_polygon(m, corner, corners)) && cut_polygon(m, corner, corners);
}

bool plain_mesh_add_triangle(plain_mesh *m, uint32_t a, uint32_t b, uint32_t c, bool is_mirrored)
{
    const uint32_t corner[3] = {a, b, c}, turned[3] = {a, c, b};
    return (!m->keeps_polygons || keep_polygon(m, corner, 3)) &&
           cut_polygon(m, is_mirrored ? turned : corner, 3);
}

bool plain_mesh_refuse(plain_mesh *m, error_code code, const char *format, ...)
{
    va_list arguments;
    if (m->refused != ERROR_NONE) return false;
    m->refused = code;
    va_start(arguments, format);
    vsnprintf(m->text, sizeof m->text, format, arguments);
    va_end(arguments);
    return false;
}

bool plain_mesh_append(char *text, size_t size, const char *format, va_list arguments)
{
    const size_t used = strlen(text), begin = used > 0 ? used + 1 : 0;
    va_list again;
    va_copy(again, arguments);
    const int length = vsnprintf(NULL, 0, format, again);
    va_end(again);
    if (length < 0 || begin + (size_t)length >= size) return false;
    if (used > 0) text[used] = '\n';
    vsnprintf(text + begin, size - begin, format, arguments);
    return true;
}

void plain_mesh_warn(plain_mesh *m, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    plain_mesh_append(m->text, sizeof m->text, format, arguments);
    va_end(arguments);
}

/* Whether an array belongs to the textures of a mesh (mesh_textures.h). */
static bool is_of_textures(const char *name)
{
    return strcmp(name, MESH_TEXTURES_UV) == 0 || strcmp(name, MESH_TEXTURES_MATERIAL) == 0 ||
           strcmp(name, MESH_TEXTURES_TINT) == 0;
}

plain_values *plain_mesh_add_values(plain_mesh *m, const char *name, mesh_values_kind kind, size_t components)
{
    if (!m->keeps_values || components == 0 || components > MESH_VALUES_COMPONENTS ||
        m->value_arrays == MESH_VALUES_MOST || (m->textures && !is_of_textures(name)))
        return NULL;
    plain_values *v = &m->values[m->value_arrays++];
    *v = (plain_values){.head = {.kind = kind, .components = (uint32_t)components}};
    snprintf(v->head.name, sizeof v->head.name, "%s", name);
    return v;
}

plain_values *plain_mesh_find_values(plain_mesh *m, const char *name, mesh_values_kind kind,
                                     size_t components)
{
    for (uint32_t k = 0; k < m->value_arrays; k++)
        if (strcmp(m->values[k].head.name, name) == 0 && m->values[k].head.components == components)
            return &m->values[k];
    return plain_mesh_add_values(m, name, kind, components);
}

bool plain_mesh_set_values(plain_mesh *m, plain_values *v, size_t vertex, const double *value)
{
    if (!v) return true;
    const size_t width = v->head.components, end = vertex + 1 > v->count ? vertex + 1 : v->count;
    if (!plain_mesh_make_room(m, (void **)&v->value, &v->room, end, width * sizeof *v->value)) return false;
    for (size_t k = width * v->count; k < width * vertex; k++) v->value[k] = (double)NAN;
    memcpy(v->value + width * vertex, value, width * sizeof *value);
    v->count = end;
    return true;
}

bool plain_mesh_scale_colors(plain_mesh *m, plain_values *v, double full, const char *type)
{
    double low = 0, high = 0;
    for (size_t k = 0; v && k < 4 * v->count; k++) {
        low = fmin(low, v->value[k]);
        high = fmax(high, v->value[k]);
    }
    if (!(low >= 0 && high <= fmax(full, UINT8_MAX)))
        return plain_mesh_refuse(
            m, ERROR_INPUT_UNSUPPORTED,
            "its colours are numbers of type \"%s\", some below 0 or above 255, whose range is not known. Save "
            "them as whole numbers from 0 to 255.",
            type);
    if (full == 0) full = high > 1 ? UINT8_MAX : 1;
    for (size_t k = 0; v && k < 4 * v->count; k++) {
        double *c = &v->value[k];
        *c = k % 4 == 3 && isnan(*c) && !isnan(c[-1]) ? 1 : *c / full;
    }
    return true;
}

static int compare_unusable(const void *key, const void *item)
{
    const uint32_t vertex = *(const uint32_t *)key, other = ((const plain_mesh_unusable *)item)->vertex;
    return (vertex > other) - (vertex < other);
}

const char *plain_mesh_unusable_at(const plain_mesh *m, uint32_t vertex)
{
    const plain_mesh_unusable *found =
        m->unusables > 0 ? bsearch(&vertex, m->unusable, m->unusables, sizeof *m->unusable, compare_unusable)
                         : NULL;
    return found ? found->at : NULL;
}

bool plain_mesh_copy_vertex(plain_mesh *m, uint32_t vertex)
{
    const double at[3] = {m->vertex[vertex][0], m->vertex[vertex][1], m->vertex[vertex][2]};
    double value[MESH_VALUES_COMPONENTS];
    m->vertex_at = plain_mesh_unusable_at(m, vertex);
    if (!plain_mesh_add_vertex(m, at)) return false;
    for (uint32_t k = 0; k < m->value_arrays; k++) {
        plain_values *v = &m->values[k];
        if (v->count <= vertex) continue;
        memcpy(value, v->value + (size_t)vertex * v->head.components, v->head.components * sizeof *value);
        if (!plain_mesh_set_values(m, v, m->vertices - 1, value)) return false;
    }
    return true;
}

void plain_mesh_free(plain_mesh *m)
{
    for (uint32_t k = 0; k < m->value_arrays; k++) free(m->values[k].value);
    free(m->vertex);
    free(m->triangle);
    free(m->corner);
    free(m->unusable);
    free(m->polygon_size);
    free(m->polygon_corner);
    *m = (plain_mesh){0};
}
