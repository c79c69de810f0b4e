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

typedef bool format_reader(const char *data, size_t size, plain_mesh *out);

static format_reader *const readers[FILE_FORMATS] = {
    [FILE_FORMAT_OBJ] = plain_mesh_read_obj,     [FILE_FORMAT_PLY] = plain_mesh_read_ply,
    [FILE_FORMAT_STL] = plain_mesh_read_stl,     [FILE_FORMAT_OFF] = plain_mesh_read_off,
    [FILE_FORMAT_GLTF] = plain_mesh_read_gltf,   [FILE_FORMAT_3MF] = plain_mesh_read_3mf,
    [FILE_FORMAT_VTK] = plain_mesh_read_vtk,     [FILE_FORMAT_VTP] = plain_mesh_read_vtp,
    [FILE_FORMAT_GIFTI] = plain_mesh_read_gifti, [FILE_FORMAT_NPZ] = plain_mesh_read_npz};

bool plain_mesh_reads(file_format format)
{
    return readers[format] != NULL;
}

bool plain_mesh_reads_textures(file_format format)
{
    return format == FILE_FORMAT_OBJ || format == FILE_FORMAT_PLY || format == FILE_FORMAT_GLTF ||
           format == FILE_FORMAT_3MF;
}

/* Refuses the file if a triangle has a vertex that is not usable and whose place is known. */
static bool check_vertices(const char *format, const char *data, plain_mesh *m)
{
    for (size_t n = 0; n < 3 * m->triangles && m->unusables > 0; n++) {
        const char *at = plain_mesh_unusable_at(m, m->triangle[n / 3][n % 3]);
        if (at)
            return plain_mesh_refuse_at(
                m, data, at,
                "of the %s file is a vertex with a coordinate that is not finite or exceeds %g. Repair the mesh.",
                format, MESH_CHECK_LARGEST);
    }
    return true;
}

/* Finds whether anything but white space and zeros follows the declared content. */
static void find_rest(const char *data, size_t size, plain_mesh *m)
{
    size_t at = m->end ? (size_t)(m->end - data) : size;
    while (at < size && (!data[at] || strchr(" \t\n\v\f\r", data[at]))) at++;
    if (at < size) m->rest = (size_t)(m->end - data);
}

bool plain_mesh_complete_values(plain_mesh *m)
{
    static const double none[MESH_VALUES_COMPONENTS] = {(double)NAN, (double)NAN, (double)NAN, (double)NAN};
    uint32_t count = 0;
    for (uint32_t k = 0; k < m->value_arrays; k++) {
        plain_values *v = &m->values[k];
        if (v->count > 0 && v->count < m->vertices && !plain_mesh_set_values(m, v, m->vertices - 1, none))
            return false;
    }
    for (uint32_t k = 0; k < m->value_arrays; k++)
        if (m->values[k].count > 0) m->values[count++] = m->values[k];
    m->value_arrays = count;
    return true;
}

bool plain_mesh_read(file_format format, const char *data, size_t size, plain_mesh *out)
{
    const bool has_mark = strncmp(data, "\xEF\xBB\xBF", 3) == 0 && /* of UTF-8 */
                          (format != FILE_FORMAT_STL || strncmp(data + 3, "solid", 5) == 0);
    const char *text = data + (has_mark ? 3 : 0);
    if (readers[format](text, size - (size_t)(text - data), out) &&
        check_vertices(file_formats[format].name, text, out) && plain_mesh_complete_values(out)) {
        find_rest(data, size, out);
        return true;
    }
    if (!out->needs_library)
        plain_mesh_refuse(out, ERROR_INPUT_DAMAGED, "the file is damaged. Save it again.");
    plain_mesh left = {.refused = out->refused,
                       .needs_library = out->needs_library,
                       .keeps_polygons = out->keeps_polygons,
                       .keeps_values = out->keeps_values,
                       .textures = out->textures};
    if (out->refused != ERROR_NONE) memcpy(left.text, out->text, sizeof left.text);
    plain_mesh_free(out);
    *out = left;
    return false;
}
