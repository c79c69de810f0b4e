// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/plain_mesh.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io/meshes/mesh_check.h"
#include "io/meshes/plain_textures.h"

bool plain_mesh_refuse_at(plain_mesh *m, const char *data, const char *at, const char *format, ...)
{
    enum { WHY_SIZE = 256 };
    char why[WHY_SIZE];
    size_t line = 1;
    va_list arguments;
    for (const char *p = data; p < at && !m->is_binary; p++)
        line += *p == '\n' || (*p == '\r' && p[1] != '\n');
    va_start(arguments, format);
    vsnprintf(why, sizeof why, format, arguments);
    va_end(arguments);
    return plain_mesh_refuse(m, ERROR_INPUT_DAMAGED, "%s %zu %s", m->is_binary ? "byte" : "line",
                             m->is_binary ? (size_t)(at - data) : line, why);
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
    bool has_values;     /* values of the vertices are read */
} mesh_format;

static const mesh_format readers[FILE_FORMATS] = {
    [FILE_FORMAT_OBJ] = {plain_mesh_read_obj, true, true},
    [FILE_FORMAT_PLY] = {plain_mesh_read_ply, true, true},
    [FILE_FORMAT_STL] = {plain_mesh_read_stl, true, true},
    [FILE_FORMAT_OFF] = {plain_mesh_read_off, false, true},
    [FILE_FORMAT_GLTF] = {plain_mesh_read_gltf, true, false},
    [FILE_FORMAT_3MF] = {plain_mesh_read_3mf, true, false},
    [FILE_FORMAT_VTK] = {plain_mesh_read_vtk, true, true, true},
    [FILE_FORMAT_VTP] = {plain_mesh_read_vtp, true, true, true},
    [FILE_FORMAT_GIFTI] = {plain_mesh_read_gifti, true, true, true},
    [FILE_FORMAT_NPZ] = {plain_mesh_read_npz, true, true}};

bool plain_mesh_reads(file_format format)
{
    return readers[format].read != NULL;
}

bool plain_mesh_is_only_reader(const char *ending)
{
    return readers[file_format_of_name(ending)].is_only_reader;
}

bool plain_mesh_reads_values(const char *ending)
{
    return readers[file_format_of_name(ending)].has_values;
}

static int compare_unusable(const void *key, const void *item)
{
    const uint32_t vertex = *(const uint32_t *)key, other = ((const plain_mesh_unusable *)item)->vertex;
    return (vertex > other) - (vertex < other);
}

/* Refuses the file if a triangle has a vertex that is not usable and whose place is known. */
static bool check_vertices(const char *format, const char *data, plain_mesh *m)
{
    for (size_t n = 0; n < 3 * m->triangles && m->unusables > 0; n++) {
        const plain_mesh_unusable *found = bsearch(&m->triangle[n / 3][n % 3], m->unusable, m->unusables,
                                                   sizeof *m->unusable, compare_unusable);
        if (found)
            return plain_mesh_refuse_at(
                m, data, found->at,
                "of the %s file is a vertex with a coordinate that is not finite or exceeds %g. Repair the mesh.",
                format, MESH_CHECK_LARGEST);
    }
    return true;
}

/* Members of *out that begin with `keeps`, and textures, are set by the caller. */
static bool read_as(const char *ending, const char *data, size_t size, plain_mesh *out)
{
    const file_format named = file_format_of_name(ending);
    const mesh_format *format = &readers[named];
    const size_t mark = strncmp(data, "\xEF\xBB\xBF", 3) == 0 &&
                                (named != FILE_FORMAT_STL || strncmp(data + 3, "solid", 5) == 0)
                            ? 3
                            : 0; /* of UTF-8 */
    data += mark;
    size -= mark;
    if (format->read && format->read(data, size, out) &&
        check_vertices(file_formats[named].name, data, out) && (out->triangles > 0 || format->is_final))
        return true;
    if (format->is_only_reader)
        plain_mesh_refuse(out, ERROR_INPUT_DAMAGED, "the file is damaged. Save it again.");
    if (out->refused == ERROR_NONE) out->text[0] = 0;
    plain_mesh left = {.refused = out->refused,
                       .unit = out->unit,
                       .is_quantised = out->is_quantised,
                       .textures = out->textures};
    memcpy(left.text, out->text, sizeof left.text);
    plain_mesh_free(out);
    *out = left;
    return false;
}

bool plain_mesh_read(const char *ending, const char *data, size_t size, plain_mesh *out)
{
    *out = (plain_mesh){0};
    return read_as(ending, data, size, out);
}

bool plain_mesh_read_polygons(const char *ending, const char *data, size_t size, plain_mesh *out)
{
    *out = (plain_mesh){.keeps_polygons = true};
    return read_as(ending, data, size, out);
}

bool plain_mesh_read_values(const char *ending, const char *data, size_t size, plain_mesh *out)
{
    *out = (plain_mesh){.keeps_values = true};
    return read_as(ending, data, size, out);
}

bool plain_mesh_reads_textures(const char *ending)
{
    const file_format format = file_format_of_name(ending);
    return format == FILE_FORMAT_OBJ || format == FILE_FORMAT_PLY || format == FILE_FORMAT_GLTF ||
           format == FILE_FORMAT_3MF;
}

bool plain_mesh_read_textures(const char *ending, const char *data, size_t size, plain_textures *textures,
                              plain_mesh *out)
{
    *textures = (plain_textures){0};
    *out = (plain_mesh){.keeps_polygons = true, .textures = textures};
    return read_as(ending, data, size, out);
}
