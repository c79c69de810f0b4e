// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/plain_mesh.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <unistd.h>

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
        polygon_cut((const double(*)[3])m->vertex, corner, corners, m->triangle + m->triangles);
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

bool plain_mesh_refuse_line(plain_mesh *m, const char *data, const char *at, const char *format, ...)
{
    enum { WHY_SIZE = 256 };
    char why[WHY_SIZE];
    size_t line = 1;
    va_list arguments;
    for (const char *p = data; p < at; p++) line += *p == '\n' || (*p == '\r' && p[1] != '\n');
    va_start(arguments, format);
    vsnprintf(why, sizeof why, format, arguments);
    va_end(arguments);
    return plain_mesh_refuse(m, ERROR_INPUT_DAMAGED, "line %zu %s", line, why);
}

const char *plain_mesh_text(const char *data, size_t size, plain_mesh *m)
{
    const size_t length = strlen(data);
    if (size >= 2 && (memcmp(data, "\xFF\xFE", 2) == 0 || memcmp(data, "\xFE\xFF", 2) == 0)) {
        plain_mesh_refuse(m, ERROR_INPUT_UNSUPPORTED, "the file is UTF-16 text. Save it as UTF-8.");
        return NULL;
    }
    for (size_t k = length; k < size; k++)
        if (data[k]) {
            plain_mesh_refuse(m, ERROR_INPUT_DAMAGED,
                              "byte %zu of the file is 0, which text does not have. Save it again.", length);
            return NULL;
        }
    return data + (strncmp(data, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0);
}

bool plain_mesh_read_xml(plain_mesh *m, xml *document, const char *what)
{
    switch (xml_read(document)) {
    case XML_RESULT_READ:
    case XML_RESULT_STOPPED:
        return m->refused == ERROR_NONE;
    case XML_RESULT_NO_MEMORY:
        return plain_mesh_refuse_memory(m);
    case XML_RESULT_DECLARATIONS:
        return plain_mesh_refuse(
            m, ERROR_INPUT_UNSUPPORTED, "%s has %s, which hexad does not read: save it without", what,
            document->allows_doctype ? "declarations in its document type" : "a document type");
    default:
        return plain_mesh_refuse(m, ERROR_INPUT_DAMAGED,
                                 "%s is damaged: line %lu is not valid XML (%s). Save it again.", what,
                                 document->line, document->why);
    }
}

void plain_mesh_warn(plain_mesh *m, const char *format, ...)
{
    const size_t used = strlen(m->text), begin = used > 0 ? used + 1 : 0;
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    if (length < 0 || begin + (size_t)length >= sizeof m->text) return;
    if (used > 0) m->text[used] = '\n';
    va_start(arguments, format);
    vsnprintf(m->text + begin, sizeof m->text - begin, format, arguments);
    va_end(arguments);
}

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static bool is_behind(char c)
{
    return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == 0;
}

/* Numbers of at most 15 digits and 22 places, which one multiplication or division rounds correctly
 * (Clinger 1990). */
static bool short_number(const char **at, double *out)
{
    static const double power[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                   1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    enum { DIGITS_MOST = 15, POWER_MOST = 22 };
    const char *p = *at;
    const bool minus = *p == '-';
    uint64_t value = 0;
    int digits = 0, places = 0, exponent = 0;
    p += minus || *p == '+';
    for (; is_digit(*p) && digits <= DIGITS_MOST; p++, digits++) value = 10 * value + (uint64_t)(*p - '0');
    if (*p == '.')
        for (p++; is_digit(*p) && digits <= DIGITS_MOST; p++, digits++, places--)
            value = 10 * value + (uint64_t)(*p - '0');
    if (digits == 0 || digits > DIGITS_MOST) return false;
    if (*p == 'e' || *p == 'E') {
        const bool down = *++p == '-';
        p += down || *p == '+';
        if (!is_digit(*p)) return false;
        for (; is_digit(*p) && exponent < 1000; p++) exponent = 10 * exponent + (*p - '0');
        places += down ? -exponent : exponent;
    }
    if (places < -POWER_MOST || places > POWER_MOST || !is_behind(*p)) return false;
    *out = places < 0 ? (double)value / power[-places] : (double)value * power[places];
    if (minus) *out = -*out;
    *at = p;
    return true;
}

bool plain_mesh_number(const char **at, double *out)
{
    while (**at == ' ' || **at == '\t') ++*at;
    if (short_number(at, out)) return true;
    const char *digits = *at + (**at == '-' || **at == '+');
    const bool is_word = strncasecmp(digits, "nan", 3) == 0 || strncasecmp(digits, "inf", 3) == 0;
    if (!is_digit(*digits) && *digits != '.' && !is_word) return false;
    if (digits[0] == '0' && (digits[1] == 'x' || digits[1] == 'X')) return false;
    char *end;
    *out = strtod(*at, &end);
    if (end == *at || !is_behind(*end)) return false;
    *at = end;
    return true;
}

typedef struct mesh_format {
    bool (*read)(const char *data, size_t size, plain_mesh *out);
    bool is_final;       /* a file without triangles is accepted: nothing is left to the library */
    bool is_only_reader; /* the library does not read such files */
} mesh_format;

static const mesh_format readers[FILE_FORMATS] = {[FILE_FORMAT_OBJ] = {plain_mesh_read_obj, true, true},
                                                  [FILE_FORMAT_PLY] = {plain_mesh_read_ply, true, true},
                                                  [FILE_FORMAT_STL] = {plain_mesh_read_stl, true, true},
                                                  [FILE_FORMAT_OFF] = {plain_mesh_read_off, false, true},
                                                  [FILE_FORMAT_GLTF] = {plain_mesh_read_gltf, true, false},
                                                  [FILE_FORMAT_3MF] = {plain_mesh_read_3mf, true, false},
                                                  [FILE_FORMAT_VTK] = {plain_mesh_read_vtk, true, true},
                                                  [FILE_FORMAT_VTP] = {plain_mesh_read_vtp, true, true},
                                                  [FILE_FORMAT_GIFTI] = {plain_mesh_read_gifti, true, true},
                                                  [FILE_FORMAT_NPZ] = {plain_mesh_read_npz, true, true}};

bool plain_mesh_reads(file_format format)
{
    return readers[format].read != NULL;
}

bool plain_mesh_is_only_reader(const char *ending)
{
    return readers[file_format_of_name(ending)].is_only_reader;
}

static void free_arrays(plain_mesh *m)
{
    free(m->vertex);
    free(m->triangle);
    free(m->corner);
    free(m->polygon_size);
    free(m->polygon_corner);
}

static bool read_as(const char *ending, const char *data, size_t size, bool keeps_polygons, plain_mesh *out)
{
    const mesh_format *format = &readers[file_format_of_name(ending)];
    *out = (plain_mesh){.keeps_polygons = keeps_polygons};
    if (format->read && format->read(data, size, out) && (out->triangles > 0 || format->is_final))
        return true;
    if (format->is_only_reader)
        plain_mesh_refuse(out, ERROR_INPUT_DAMAGED, "the file is damaged. Save it again.");
    if (out->refused == ERROR_NONE) out->text[0] = 0;
    free_arrays(out);
    plain_mesh left = {.refused = out->refused, .unit = out->unit, .is_quantised = out->is_quantised};
    memcpy(left.text, out->text, sizeof left.text);
    *out = left;
    return false;
}

bool plain_mesh_read(const char *ending, const char *data, size_t size, plain_mesh *out)
{
    return read_as(ending, data, size, false, out);
}

bool plain_mesh_read_polygons(const char *ending, const char *data, size_t size, plain_mesh *out)
{
    return read_as(ending, data, size, true, out);
}

void plain_mesh_free(plain_mesh *m)
{
    free_arrays(m);
    *m = (plain_mesh){0};
}
