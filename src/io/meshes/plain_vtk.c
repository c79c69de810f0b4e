// SPDX-License-Identifier: Apache-2.0
/* VTK's legacy files of PolyData, as text and binary (big-endian), of versions 1.0 to 5.1. Only positions and
 * cells are read, not the values of points and cells. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io/meshes/vtk_data.h"

typedef struct vtk {
    const char *data, *at, *end;
    bool is_binary, has_offsets; /* has_offsets: the cells have the layout of version 5.0 and later */
    bool has_points;
    plain_mesh *out;
} vtk;

enum { WORD_SIZE = 64 };

/* Refuses the file with its current position. */
static bool refuse(vtk *v, const char *format, ...) __attribute__((format(printf, 2, 3)));

static bool refuse(vtk *v, const char *format, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return v->is_binary ? plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED, "byte %zu of the VTK file %s",
                                            (size_t)(v->at - v->data), text)
                        : plain_mesh_refuse_line(v->out, v->data, v->at, "of the VTK file %s", text);
}

/* ---- words */

static void skip_blanks(vtk *v)
{
    while (v->at < v->end && strchr(" \t\r\n", *v->at) && *v->at) v->at++;
}

/* Reads the next word, truncated to WORD_SIZE - 1 bytes. False: end of the file. */
static bool read_word(vtk *v, char word[WORD_SIZE])
{
    size_t length = 0;
    skip_blanks(v);
    while (v->at < v->end && *v->at && !strchr(" \t\r\n", *v->at)) {
        if (length + 1 < WORD_SIZE) word[length++] = *v->at;
        v->at++;
    }
    word[length] = 0;
    return length > 0;
}

static void skip_line(vtk *v)
{
    const char *end = memchr(v->at, '\n', (size_t)(v->end - v->at));
    v->at = end ? end + 1 : v->end;
}

/* Reads a count. `of`: what is counted, for messages. */
static bool read_count(vtk *v, const char *of, size_t *out)
{
    char word[WORD_SIZE], *end = word;
    const long long number = read_word(v, word) ? strtoll(word, &end, 10) : -1;
    if (number < 0 || *end || end == word)
        return refuse(v, "has \"%.40s\" in place of the number of %s", word, of);
    *out = (size_t)number;
    return true;
}

static bool find_type(const char *word, number_type *out)
{
    static const struct {
        const char *word;
        number_type type;
    } types[] = {{"char", NUMBER_INT8},
                 {"signed_char", NUMBER_INT8},
                 {"unsigned_char", NUMBER_UINT8},
                 {"short", NUMBER_INT16},
                 {"unsigned_short", NUMBER_UINT16},
                 {"int", NUMBER_INT32},
                 {"unsigned_int", NUMBER_UINT32},
                 {"vtkidtype", NUMBER_INT32},
                 {"long", NUMBER_INT64},
                 {"unsigned_long", NUMBER_UINT64},
                 {"vtktypeint64", NUMBER_INT64},
                 {"vtktypeuint64", NUMBER_UINT64},
                 {"vtktypeint32", NUMBER_INT32},
                 {"float", NUMBER_FLOAT},
                 {"double", NUMBER_DOUBLE}};
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (strcasecmp(types[k].word, word) == 0) {
            *out = types[k].type;
            return true;
        }
    return false;
}

static bool read_type(vtk *v, number_type *out)
{
    char word[WORD_SIZE];
    if (read_word(v, word) && find_type(word, out)) return true;
    return refuse(v, "has the type \"%.40s\", which is not one of numbers: save it with float or double",
                  word);
}

/* ---- numbers */

/* Checks, before allocation, that the rest of the file can have `count` numbers. Binary numbers begin after
 * the end of the line. In text each number takes at least two characters, except the last one of a file. */
static bool expect_numbers(vtk *v, number_type type, size_t count, const char *of)
{
    if (v->is_binary) skip_line(v);
    const size_t left = (size_t)(v->end - v->at);
    if (count <= (v->is_binary ? left / number_bytes(type) : (left + 1) / 2)) return true;
    return refuse(v,
                  "begins %zu numbers of %s, and the file has %zu bytes more: it is damaged or truncated. "
                  "Copy or save it again.",
                  count, of, left);
}

static bool read_whole(vtk *v, number_type type, const char *of, int64_t *out)
{
    if (v->is_binary) {
        if ((size_t)(v->end - v->at) < number_bytes(type)) return refuse(v, "ends within %s", of);
        *out = number_whole(v->at, type, __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
        v->at += number_bytes(type);
        return true;
    }
    char *end;
    skip_blanks(v);
    *out = strtoll(v->at, &end, 10);
    if (end == v->at || (*end && !strchr(" \t\r\n", *end)))
        return refuse(v, "has \"%.*s\" in place of a whole number of %s", (int)strcspn(v->at, " \t\r\n"),
                      v->at, of);
    v->at = end;
    return true;
}

static bool read_real(vtk *v, number_type type, const char *of, double *out)
{
    if (v->is_binary) {
        if ((size_t)(v->end - v->at) < number_bytes(type)) return refuse(v, "ends within %s", of);
        *out = number_value(v->at, type, __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
        v->at += number_bytes(type);
        return true;
    }
    skip_blanks(v);
    if (plain_mesh_number(&v->at, out)) return true;
    return refuse(v, "has \"%.*s\" in place of a number of %s", (int)strcspn(v->at, " \t\r\n"), v->at, of);
}

/* ---- sections */

static bool read_points(vtk *v)
{
    size_t count = 0;
    number_type type = NUMBER_DOUBLE;
    if (!read_count(v, "points", &count) || !read_type(v, &type)) return false;
    if (v->has_points) return refuse(v, "begins points for the second time");
    v->has_points = true;
    if (count > SIZE_MAX / 8 || !expect_numbers(v, type, 3 * count, "the points"))
        return count <= SIZE_MAX / 8 ? false : refuse(v, "has too many points");
    if (!plain_mesh_expect(v->out, count, 0)) return false;
    for (size_t n = 0; n < count; n++) {
        double at[3];
        for (int k = 0; k < 3; k++)
            if (!read_real(v, type, "the points", &at[k])) return false;
        if (!plain_mesh_add_vertex(v->out, at)) return false;
    }
    return true;
}

/* Reads cells that begin with their number of points. */
static bool read_counted_cells(vtk *v, vtk_cells_kind kind, size_t cells, size_t size)
{
    const char *name = vtk_cells_name(kind);
    int64_t *vertex = NULL;
    size_t room = 0;
    if (!expect_numbers(v, NUMBER_INT32, size, name)) return false;
    bool ok = true;
    for (size_t n = 0; ok && n < cells; n++) {
        int64_t count;
        ok = read_whole(v, NUMBER_INT32, name, &count);
        if (ok && (size == 0 || count < 0 || (size_t)count > size - 1))
            ok = refuse(v, "has a cell of %s with %lld points, and %zu numbers are left", name,
                        (long long)count, size > 0 ? size - 1 : 0);
        if (!ok) break;
        size -= (size_t)count + 1;
        if ((size_t)count > room) {
            int64_t *grown = realloc(vertex, (size_t)count * sizeof *grown);
            if (!grown) {
                ok = plain_mesh_refuse_memory(v->out);
                break;
            }
            vertex = grown;
            room = (size_t)count;
        }
        for (int64_t k = 0; ok && k < count; k++) ok = read_whole(v, NUMBER_INT32, name, &vertex[k]);
        ok = ok && vtk_add_cell(v->out, kind, (int64_t)n, vertex, (size_t)count, 0);
    }
    free(vertex);
    return ok && (size == 0 || refuse(v, "ends %s, of which %zu numbers belong to no cell", name, size));
}

/* Reads OFFSETS or CONNECTIVITY with its type: `count` numbers, which the caller frees. */
static int64_t *read_list(vtk *v, const char *word, const char *of, size_t count)
{
    char found[WORD_SIZE];
    number_type type = NUMBER_DOUBLE;
    if (!read_word(v, found) || strcasecmp(found, word) != 0) {
        refuse(v, "has \"%.40s\" in place of %s", found, word);
        return NULL;
    }
    if (!read_type(v, &type)) return NULL;
    if (!number_is_whole(type)) {
        refuse(v, "has %s that are not whole numbers", word);
        return NULL;
    }
    if (!expect_numbers(v, type, count, of)) return NULL;
    int64_t *list = malloc((count > 0 ? count : 1) * sizeof *list);
    if (!list) plain_mesh_refuse_memory(v->out);
    for (size_t k = 0; list && k < count; k++)
        if (!read_whole(v, type, of, &list[k])) {
            free(list);
            return NULL;
        }
    return list;
}

/* Reads cells given by `count` offsets, one more than the number of cells. */
static bool read_offset_cells(vtk *v, vtk_cells_kind kind, size_t count, size_t size)
{
    const char *name = vtk_cells_name(kind);
    int64_t *offset = read_list(v, "OFFSETS", name, count), *vertex = NULL;
    bool ok = offset && (vertex = read_list(v, "CONNECTIVITY", name, size));
    for (size_t n = 0; ok && n + 1 < count; n++) {
        if (offset[n] < 0 || offset[n] > offset[n + 1] || offset[n + 1] > (int64_t)size)
            ok = refuse(v, "ends %s, whose cell %zu goes from %lld to %lld of %zu numbers", name, n,
                        (long long)offset[n], (long long)offset[n + 1], size);
        ok = ok && vtk_add_cell(v->out, kind, (int64_t)n, vertex + offset[n],
                                (size_t)(offset[n + 1] - offset[n]), 0);
    }
    free(offset);
    free(vertex);
    return ok;
}

static bool read_cells(vtk *v, vtk_cells_kind kind)
{
    size_t cells = 0, size = 0;
    if (!read_count(v, "cells", &cells) || !read_count(v, "numbers", &size)) return false;
    return v->has_offsets ? read_offset_cells(v, kind, cells, size)
                          : read_counted_cells(v, kind, cells, size);
}

/* Skips strings. In text each has a line. In binary files each has a length of 1, 2, 4 or 8 bytes, whose
 * size is given by its first two bits. */
static bool skip_strings(vtk *v, size_t count)
{
    skip_line(v);
    for (; count > 0; count--) {
        if (v->at == v->end) return refuse(v, "ends within a field");
        if (!v->is_binary) {
            skip_line(v);
            continue;
        }
        const int bytes = (int[]){8, 4, 2, 1}[(unsigned char)*v->at >> 6];
        uint64_t length = (unsigned char)*v->at & 63;
        if (v->end - v->at < bytes) return refuse(v, "ends within a field");
        for (int k = 1; k < bytes; k++) length = length << 8 | (unsigned char)v->at[k];
        v->at += bytes;
        if (length > (uint64_t)(v->end - v->at)) return refuse(v, "ends within a field");
        v->at += length;
    }
    return true;
}

/* Skips an array of a field. */
static bool skip_array(vtk *v)
{
    char word[WORD_SIZE];
    size_t components = 0, tuples = 0;
    number_type type = NUMBER_UINT8;
    if (!read_word(v, word)) return refuse(v, "ends within a field");
    if (!read_count(v, "components", &components) || !read_count(v, "tuples", &tuples)) return false;
    if (!read_word(v, word)) return refuse(v, "ends within a field");
    if (components > 0 && tuples > SIZE_MAX / 16 / components)
        return refuse(v, "has a field that is too large");
    if (strcasecmp(word, "string") == 0 || strcasecmp(word, "utf8_string") == 0)
        return skip_strings(v, components * tuples);
    const bool are_bits = strcasecmp(word, "bit") == 0;
    if (!are_bits && !find_type(word, &type)) return refuse(v, "has a field of the type \"%.40s\"", word);
    size_t count = components * tuples;
    if (are_bits && v->is_binary) count = (count + 7) / 8;
    if (!expect_numbers(v, type, count, "a field")) return false;
    if (v->is_binary) v->at += count * number_bytes(type);
    for (size_t k = 0; !v->is_binary && k < count; k++) {
        double unused;
        if (!read_real(v, type, "a field", &unused)) return false;
    }
    return true;
}

/* Skips the names and other metadata of an array, up to an empty line. */
static void skip_metadata(vtk *v)
{
    skip_line(v);
    while (v->at < v->end) {
        const char *line = v->at;
        skip_line(v);
        if (line[strspn(line, " \t\r")] == '\n') return;
    }
}

static bool skip_field(vtk *v)
{
    char word[WORD_SIZE];
    size_t arrays = 0;
    if (!read_word(v, word) || !read_count(v, "arrays", &arrays)) return refuse(v, "ends within a field");
    for (; arrays > 0; arrays--) {
        if (!skip_array(v)) return false;
        const char *at = v->at;
        if (read_word(v, word) && strcasecmp(word, "METADATA") == 0)
            skip_metadata(v);
        else
            v->at = at;
    }
    return true;
}

static bool read_sections(vtk *v)
{
    static const struct {
        const char *word;
        vtk_cells_kind kind;
    } cells[] = {{"VERTICES", VTK_VERTS},
                 {"LINES", VTK_LINES},
                 {"POLYGONS", VTK_POLYS},
                 {"TRIANGLE_STRIPS", VTK_STRIPS}};
    char word[WORD_SIZE];
    while (read_word(v, word)) {
        bool is_known = false, ok = true;
        if (strcasecmp(word, "POINT_DATA") == 0 || strcasecmp(word, "CELL_DATA") == 0) break;
        if ((is_known = strcasecmp(word, "POINTS") == 0))
            ok = read_points(v);
        else if ((is_known = strcasecmp(word, "FIELD") == 0))
            ok = skip_field(v);
        else if ((is_known = strcasecmp(word, "METADATA") == 0))
            skip_metadata(v);
        for (size_t k = 0; !is_known && k < sizeof cells / sizeof *cells; k++)
            if ((is_known = strcasecmp(word, cells[k].word) == 0)) {
                ok = read_cells(v, cells[k].kind);
                break;
            }
        if (!is_known)
            return refuse(v, "has \"%.40s\" in place of POINTS, POLYGONS or another section of PolyData",
                          word);
        if (!ok) return false;
    }
    return true;
}

/* Refuses the other kinds of data sets. */
static bool refuse_dataset(vtk *v, const char *word)
{
    const bool is_volume =
        strcasecmp(word, "STRUCTURED_POINTS") == 0 || strcasecmp(word, "RECTILINEAR_GRID") == 0;
    return plain_mesh_refuse(
        v->out, ERROR_INPUT_UNSUPPORTED, "the VTK file has the data set %.40s, and PolyData is read: %s",
        word,
        is_volume ? "it is a volume. Save it as NRRD with 3D Slicer and name it as /surface/volume/path."
                  : "apply Extract Surface in ParaView, and save it as .vtp.");
}

bool plain_mesh_read_vtk(const char *data, size_t size, plain_mesh *out)
{
    static const char magic[] = "# vtk DataFile Version ";
    vtk v = {.data = data, .at = data, .end = data + size, .out = out};
    char word[WORD_SIZE];
    if (size < sizeof magic || strncmp(data, magic, sizeof magic - 1) != 0)
        return plain_mesh_refuse(
            out, ERROR_INPUT_DAMAGED,
            "the file does not begin with \"# vtk DataFile Version\": give a VTK file, or "
            "name XML files .vtp");
    v.has_offsets = strtod(data + sizeof magic - 1, NULL) >= 5;
    skip_line(&v);
    skip_line(&v); /* the title */
    if (!read_word(&v, word)) return refuse(&v, "ends within its header");
    v.is_binary = strcasecmp(word, "BINARY") == 0;
    if (!v.is_binary && strcasecmp(word, "ASCII") != 0)
        return refuse(&v, "has \"%.40s\" in place of ASCII or BINARY", word);
    if (!read_word(&v, word) || strcasecmp(word, "DATASET") != 0)
        return refuse(&v, "has \"%.40s\" in place of DATASET", word);
    if (!read_word(&v, word)) return refuse(&v, "ends within its header");
    if (strcasecmp(word, "POLYDATA") != 0) return refuse_dataset(&v, word);
    return read_sections(&v);
}
