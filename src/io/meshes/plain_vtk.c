// SPDX-License-Identifier: Apache-2.0
/* VTK's legacy files of PolyData, as text and binary (big-endian), of versions 1.0 to 5.1. Values of points are
 * read if the mesh keeps them; those of cells are not read. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io/meshes/vtk_data.h"

typedef struct vtk {
    const char *data, *at, *end;
    bool is_binary, has_offsets; /* has_offsets: the cells have the layout of version 5.0 and later */
    bool has_points, has_cells[VTK_CELLS_KINDS];
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
    return plain_mesh_refuse_at(v->out, v->data, v->at, "of the VTK file %s", text);
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

/* Words that begin the cells of each kind. */
static const char *const cell_words[VTK_CELLS_KINDS] = {"VERTICES", "LINES", "TRIANGLE_STRIPS", "POLYGONS"};

/* Whether a line is the first one of cells: the word and two whole numbers. Arrays can have the word as their name. */
static bool begins_cells(const char *line, const char *word)
{
    const char *at = line + strlen(word);
    if (strncasecmp(line, word, strlen(word)) != 0) return false;
    for (int k = 0; k < 2; k++) {
        const size_t blanks = strspn(at, " \t"), digits = strspn(at + blanks, "0123456789");
        if (blanks == 0 || digits == 0) return false;
        at += blanks + digits;
    }
    return at[strspn(at, " \t\r")] == '\n';
}

/* Refuses cells in a part of the file that is not read. `where`: the end of the message. */
static bool check_skipped(vtk *v, const char *begin, const char *end, const char *where)
{
    for (const char *at = begin; (at = memchr(at, '\n', (size_t)(end - at))); at++)
        for (int k = 0; k < VTK_CELLS_KINDS; k++)
            if (begins_cells(at + 1, cell_words[k])) {
                v->at = at + 1;
                return refuse(v, "has %s %s", cell_words[k], where);
            }
    return true;
}

/* Checks that only blanks and bytes 0 follow. */
static bool check_end(vtk *v)
{
    for (const char *at = v->at; at < v->end; at++)
        if (!strchr(" \t\r\n", *at)) return refuse(v, "has a byte 0 in place of a word");
    return true;
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
        v->out->vertex_at = v->at;
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
        int64_t count = 0;
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
    if (v->has_cells[kind]) return refuse(v, "begins %s for the second time", vtk_cells_name(kind));
    v->has_cells[kind] = true;
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

/* An array of values. */
typedef struct array {
    char name[WORD_SIZE], type[WORD_SIZE];
    mesh_values_kind kind;
    size_t components, tuples;
    double full; /* the number that is 1 */
    bool of_points;
} array;

/* Reads the numbers of an array, or skips them. */
static bool read_numbers(vtk *v, const array *a)
{
    number_type type = NUMBER_UINT8;
    plain_values *to = NULL;
    double row[MESH_VALUES_COMPONENTS];
    if (a->components > 0 && a->tuples > SIZE_MAX / 16 / a->components)
        return refuse(v, "has a field that is too large");
    size_t count = a->components * a->tuples;
    if (strcasecmp(a->type, "string") == 0 || strcasecmp(a->type, "utf8_string") == 0)
        return skip_strings(v, count);
    const bool are_bits = strcasecmp(a->type, "bit") == 0;
    if (!are_bits && !find_type(a->type, &type))
        return refuse(v, "has a field of the type \"%.40s\"", a->type);
    if (are_bits && v->is_binary) count = (count + 7) / 8;
    if (!expect_numbers(v, type, count, "a field")) return false;
    if (a->of_points && a->tuples != v->out->vertices)
        return refuse(v, "begins %zu values \"%.40s\", and there are %zu points", a->tuples, a->name,
                      v->out->vertices);
    if (a->of_points && !are_bits) to = plain_mesh_add_values(v->out, a->name, a->kind, a->components);
    if (v->is_binary && !to) {
        v->at += count * number_bytes(type);
        return true;
    }
    for (size_t k = 0; k < count; k++) {
        double number;
        if (!read_real(v, type, "a field", &number)) return false;
        if (!to) continue;
        row[k % a->components] = number / a->full;
        if ((k + 1) % a->components == 0 && !plain_mesh_set_values(v->out, to, k / a->components, row))
            return false;
    }
    return true;
}

/* Replaces %20 and other codes of bytes, which names of arrays have. */
static void decode_name(char *name)
{
    char *to = name;
    for (const char *from = name; *from; from++) {
        char code[3] = "";
        if (*from == '%') snprintf(code, sizeof code, "%s", from + 1);
        const bool is_code = strspn(code, "0123456789abcdefABCDEF") == 2;
        *to++ = is_code ? (char)strtol(code, NULL, 16) : *from;
        if (is_code) from += 2;
    }
    *to = 0;
}

/* Reads an array of a field. */
static bool read_array(vtk *v, bool of_points)
{
    array a = {.kind = MESH_VALUES_NUMBER, .full = 1, .of_points = of_points};
    if (!read_word(v, a.name)) return refuse(v, "ends within a field");
    decode_name(a.name);
    if (!read_count(v, "components", &a.components) || !read_count(v, "tuples", &a.tuples)) return false;
    return read_word(v, a.type) ? read_numbers(v, &a) : refuse(v, "ends within a field");
}

/* Skips the names and other metadata of an array, up to an empty line. */
static bool skip_metadata(vtk *v)
{
    const char *begin = v->at;
    skip_line(v);
    while (v->at < v->end) {
        const char *line = v->at;
        skip_line(v);
        if (line[strspn(line, " \t\r")] == '\n') return true;
    }
    return check_skipped(v, begin, v->end, "in METADATA, which an empty line has to end");
}

static bool read_field(vtk *v, bool of_points)
{
    char word[WORD_SIZE];
    size_t arrays = 0;
    if (!read_word(v, word) || !read_count(v, "arrays", &arrays)) return refuse(v, "ends within a field");
    for (; arrays > 0; arrays--) {
        if (!read_array(v, of_points)) return false;
        const char *at = v->at;
        if (!read_word(v, word) || strcasecmp(word, "METADATA") != 0)
            v->at = at;
        else if (!skip_metadata(v))
            return false;
    }
    return true;
}

/* The number of components, which may be absent, at the end of the line that begins SCALARS. */
static bool read_components(vtk *v, size_t *out)
{
    *out = 1;
    v->at += strspn(v->at, " \t\r");
    return *v->at == '\n' || v->at == v->end || read_count(v, "components", out);
}

/* How the first line of an array goes on behind its name. */
typedef enum head_form {
    HEAD_TYPE,       /* the type */
    HEAD_COUNT_TYPE, /* the number of components, the type */
    HEAD_SCALARS,    /* the type, optionally the number of components; then a line with the name of a table */
    HEAD_COLORS,     /* the number of components; bytes, or as text numbers from 0 to 1 */
    HEAD_COLOR_TABLE, /* the number of colours of four components, as HEAD_COLORS */
} head_form;

/* Reads the first line of an array behind its first word. */
static bool read_head(vtk *v, const char *word, array *a)
{
    static const struct {
        const char *word;
        head_form form;
        mesh_values_kind kind;
        size_t components; /* 0: the line has them */
    } heads[] = {{"SCALARS", HEAD_SCALARS, MESH_VALUES_NUMBER, 0},
                 {"COLOR_SCALARS", HEAD_COLORS, MESH_VALUES_COLOR, 0},
                 {"LOOKUP_TABLE", HEAD_COLOR_TABLE, MESH_VALUES_NUMBER, 4},
                 {"VECTORS", HEAD_TYPE, MESH_VALUES_NUMBER, 3},
                 {"NORMALS", HEAD_TYPE, MESH_VALUES_NORMAL, 3},
                 {"TEXTURE_COORDINATES", HEAD_COUNT_TYPE, MESH_VALUES_UV, 0},
                 {"TENSORS", HEAD_TYPE, MESH_VALUES_NUMBER, 9},
                 {"TENSORS6", HEAD_TYPE, MESH_VALUES_NUMBER, 6},
                 {"GLOBAL_IDS", HEAD_TYPE, MESH_VALUES_NUMBER, 1},
                 {"PEDIGREE_IDS", HEAD_TYPE, MESH_VALUES_NUMBER, 1},
                 {"EDGE_FLAGS", HEAD_TYPE, MESH_VALUES_NUMBER, 1}};
    size_t k = 0;
    while (k < sizeof heads / sizeof *heads && strcasecmp(word, heads[k].word) != 0) k++;
    if (k == sizeof heads / sizeof *heads)
        return refuse(v, "has \"%.40s\" in place of SCALARS, FIELD or another array of values", word);
    const head_form form = heads[k].form;
    a->kind = heads[k].kind;
    a->components = heads[k].components;
    bool ok = read_word(v, a->name);
    decode_name(a->name);
    if (form == HEAD_COLOR_TABLE) ok = ok && read_count(v, "colours", &a->tuples);
    if (form == HEAD_COLORS || form == HEAD_COUNT_TYPE)
        ok = ok && read_count(v, "components", &a->components);
    if (form == HEAD_COLORS || form == HEAD_COLOR_TABLE) {
        snprintf(a->type, sizeof a->type, "%s", v->is_binary ? "unsigned_char" : "float");
        a->full = v->is_binary ? UINT8_MAX : 1;
    } else {
        ok = ok && read_word(v, a->type);
    }
    a->of_points = a->of_points && form != HEAD_COLOR_TABLE;
    char next[WORD_SIZE] = "";
    if (form == HEAD_SCALARS && ok)
        ok = read_components(v, &a->components) && read_word(v, next) &&
             strcasecmp(next, "LOOKUP_TABLE") == 0 && read_word(v, next);
    if ((a->kind == MESH_VALUES_COLOR && a->components < 3) ||
        (a->kind == MESH_VALUES_UV && a->components != 2))
        a->kind = MESH_VALUES_NUMBER;
    return ok || refuse(v, "begins the array %s \"%.40s\", whose first lines are damaged", word, a->name);
}

/* Reads the values of the points, and skips those of the cells, up to the end of the file. `word`: POINT_DATA or
 * CELL_DATA. */
static bool read_values(vtk *v, char word[WORD_SIZE])
{
    array section = {.full = 1};
    do {
        bool ok = true;
        const bool is_of_points = strcasecmp(word, "POINT_DATA") == 0;
        if (is_of_points || strcasecmp(word, "CELL_DATA") == 0) {
            section.of_points = is_of_points;
            ok = read_count(v, is_of_points ? "points" : "cells", &section.tuples);
            if (ok && is_of_points && section.tuples != v->out->vertices)
                ok = refuse(v, "begins values of %zu points, and there are %zu points", section.tuples,
                            v->out->vertices);
        } else if (strcasecmp(word, "METADATA") == 0) {
            ok = skip_metadata(v);
        } else if (strcasecmp(word, "FIELD") == 0) {
            ok = read_field(v, section.of_points);
        } else {
            array a = section;
            ok = read_head(v, word, &a) && read_numbers(v, &a);
        }
        if (!ok) return false;
    } while (read_word(v, word));
    return check_end(v);
}

static bool read_sections(vtk *v)
{
    char word[WORD_SIZE];
    while (read_word(v, word)) {
        bool is_known = false, ok = true;
        if (strcasecmp(word, "POINT_DATA") == 0 || strcasecmp(word, "CELL_DATA") == 0)
            return v->out->keeps_values
                       ? read_values(v, word)
                       : check_skipped(v, v->at, v->end, "after values: write it before them");
        if ((is_known = strcasecmp(word, "POINTS") == 0))
            ok = read_points(v);
        else if ((is_known = strcasecmp(word, "FIELD") == 0))
            ok = read_field(v, false);
        else if ((is_known = strcasecmp(word, "METADATA") == 0))
            ok = skip_metadata(v);
        for (int k = 0; !is_known && k < VTK_CELLS_KINDS; k++)
            if ((is_known = strcasecmp(word, cell_words[k]) == 0)) {
                ok = read_cells(v, (vtk_cells_kind)k);
                break;
            }
        if (!is_known)
            return refuse(v, "has \"%.40s\" in place of POINTS, POLYGONS or another section of PolyData",
                          word);
        if (!ok) return false;
    }
    return check_end(v);
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
    const char *at = data + sizeof magic - 1;
    double version = 0;
    if (!plain_mesh_number(&at, &version) || !(version >= 1))
        return refuse(&v, "has a version that is not a number: write 3.0, or 5.1 for cells with offsets");
    v.has_offsets = version >= 5;
    skip_line(&v);
    skip_line(&v); /* the title */
    if (!read_word(&v, word)) return refuse(&v, "ends within its header");
    v.is_binary = out->is_binary = strcasecmp(word, "BINARY") == 0;
    if (!v.is_binary && strcasecmp(word, "ASCII") != 0)
        return refuse(&v, "has \"%.40s\" in place of ASCII or BINARY", word);
    if (!read_word(&v, word) || strcasecmp(word, "DATASET") != 0)
        return refuse(&v, "has \"%.40s\" in place of DATASET", word);
    if (!read_word(&v, word)) return refuse(&v, "ends within its header");
    if (strcasecmp(word, "POLYDATA") != 0) return refuse_dataset(&v, word);
    return read_sections(&v);
}
