// SPDX-License-Identifier: Apache-2.0
/* GIfTI surfaces (.gii): an array of points, one of triangles, and values of the points if the mesh keeps them,
 * as text, base64 or base64 of zlib. base/xml finds the arrays; what they hold is read here. libgiftiio 1.0.9 is
 * not used: it takes data that end early without an error, and crashes on damaged files. */
#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <zlib.h>

#include "io/meshes/base64.h"
#include "io/meshes/vtk_data.h"

enum { SIDES = 6, SPACE_SIZE = 64, MATRIX_SIZE = 1024, NUMBERS_OF_MATRIX = 16, WORD_SIZE = 24 };

/* Maximum number of arrays of a file. */
static const int most_arrays = 4096;

/* Maximum length of unpacked data: (packed bytes + most_of_none) * most_packed. A deflate stream expands a
 * byte to at most 1032. */
static const double most_packed = 1032, most_of_none = 64;

typedef enum encoding {
    ENCODING_TEXT,
    ENCODING_BASE64,
    ENCODING_ZLIB,
    ENCODING_EXTERNAL,
    ENCODING_OTHER
} encoding;

typedef struct array {
    int number; /* index in the file, from 0 */
    encoding encoding;
    number_type type;
    bool has_type, is_swapped, by_column;
    int dimensions;
    double side[SIDES];
    size_t begin, end; /* range of its text in the file */
} array;

/* One of the two arrays of a surface, or an array of values. */
typedef struct wanted {
    const char *intent;
    char name[MESH_VALUES_NAME_SIZE]; /* of values */
    mesh_values_kind kind;            /* of values */
    array array;
    int count; /* how often the file has it */
} wanted;

typedef struct gifti {
    const char *data;
    size_t size;
    xml document;
    plain_mesh *out;
    wanted points, triangles, values[MESH_VALUES_MOST];
    int arrays, value_arrays;
    char declared[WORD_SIZE]; /* number of arrays that the file states */
    bool has_root;
    wanted *open; /* the array that is open, or NULL if it is none of these */
    char *text;   /* buffer for character data; NULL: they are ignored */
    size_t text_size;
    char data_space[SPACE_SIZE], other_space[SPACE_SIZE], matrix[MATRIX_SIZE];
    char key[MESH_VALUES_NAME_SIZE]; /* of the metadata that are open */
} gifti;

/* ---- the elements */

static const char *find(const char **attributes, const char *name)
{
    const char *value = xml_attribute(attributes, name);
    return value ? value : "";
}

static void read_type(const char *name, array *a)
{
    static const char prefix[] = "NIFTI_TYPE_";
    if (strncmp(name, prefix, sizeof prefix - 1) != 0) return;
    a->has_type = number_find(name + sizeof prefix - 1, &a->type);
}

/* The next array of values, or NULL: values are not kept, or there are too many. */
static wanted *begin_values(gifti *g, const char *intent)
{
    if (!g->out->keeps_values || g->value_arrays == MESH_VALUES_MOST) return NULL;
    if (strcmp(intent, "NIFTI_INTENT_NODE_INDEX") == 0)
        plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "the GIfTI file has values of some points (NIFTI_INTENT_NODE_INDEX): save values of all points");
    wanted *w = &g->values[g->value_arrays++];
    snprintf(w->name, sizeof w->name, "array %d", g->arrays);
    w->intent = w->name;
    w->kind = strcmp(intent, "NIFTI_INTENT_LABEL") == 0 ? MESH_VALUES_WHOLE : MESH_VALUES_NUMBER;
    return w;
}

/* Refuses an attribute that is not one of two words. */
static bool check_word(gifti *g, const char **attributes, const char *name, const char *one,
                       const char *other)
{
    const char *value = find(attributes, name);
    return strcmp(value, one) == 0 || strcmp(value, other) == 0 ||
           plain_mesh_refuse(g->out, ERROR_INPUT_UNSUPPORTED,
                             "array %d of the GIfTI file has the %s \"%.40s\": %s and %s are read",
                             g->arrays - 1, name, value, one, other);
}

/* Reads an attribute that is a whole number from 0. *out: the number, or UINT32_MAX + 1. */
static void read_whole(const char *text, double *out)
{
    char *end;
    *out = strtod(text, &end);
    if (end == text || *end || !(*out >= 0 && *out <= UINT32_MAX) || *out != (double)(uint32_t)*out)
        *out = (double)UINT32_MAX + 1;
}

static void begin_array(gifti *g, const char **attributes)
{
    static const struct {
        const char *name;
        encoding encoding;
    } encodings[] = {{"ASCII", ENCODING_TEXT},
                     {"Base64Binary", ENCODING_BASE64},
                     {"GZipBase64Binary", ENCODING_ZLIB},
                     {"ExternalFileBinary", ENCODING_EXTERNAL}};
    const char *intent = find(attributes, "Intent"), *packed = find(attributes, "Encoding");
    g->open = strcmp(intent, g->points.intent) == 0      ? &g->points
              : strcmp(intent, g->triangles.intent) == 0 ? &g->triangles
                                                         : begin_values(g, intent);
    if (++g->arrays > most_arrays) {
        plain_mesh_refuse(g->out, ERROR_INPUT_UNSUPPORTED,
                          "the GIfTI file has more than %d arrays: save its surface as a file of its own",
                          most_arrays);
        return;
    }
    if (!g->open) return;
    g->open->count++;
    array *a = &g->open->array;
    *a = (array){.number = g->arrays - 1, .encoding = ENCODING_OTHER};
    for (size_t k = 0; k < sizeof encodings / sizeof *encodings; k++)
        if (strcmp(packed, encodings[k].name) == 0) a->encoding = encodings[k].encoding;
    if (a->encoding == ENCODING_OTHER)
        plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "array %d of the GIfTI file has the Encoding \"%.40s\": ASCII, Base64Binary and GZipBase64Binary are read",
            a->number, packed);
    if (a->encoding == ENCODING_EXTERNAL)
        plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "array %d of the GIfTI file has its data in another file: save it with GZipBase64Binary "
            "(`gifti_tool -infiles a.gii -write_gifti b.gii -encoding GZIP`)",
            a->number);
    read_type(find(attributes, "DataType"), a);
    a->is_swapped =
        (strcmp(find(attributes, "Endian"), "BigEndian") == 0) != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__);
    a->by_column = strcmp(find(attributes, "ArrayIndexingOrder"), "ColumnMajorOrder") == 0;
    double dimensions;
    read_whole(find(attributes, "Dimensionality"), &dimensions);
    a->dimensions = dimensions <= SIDES ? (int)dimensions : 0;
    if (!check_word(g, attributes, "ArrayIndexingOrder", "RowMajorOrder", "ColumnMajorOrder") ||
        (a->encoding != ENCODING_TEXT && !check_word(g, attributes, "Endian", "LittleEndian", "BigEndian")))
        return;
    for (int k = 0; k < a->dimensions; k++) {
        char name[16];
        snprintf(name, sizeof name, "Dim%d", k);
        const char *text = find(attributes, name);
        read_whole(text, &a->side[k]);
        if (a->side[k] > UINT32_MAX) {
            plain_mesh_refuse(
                g->out, ERROR_INPUT_DAMAGED,
                "array %d of the GIfTI file has the %s \"%.40s\", which is not a number of rows or columns",
                a->number, name, text);
            return;
        }
    }
}

/* Sets the buffer for the character data of the element that begins. */
static void collect(gifti *g, char *to, size_t size)
{
    g->text = to;
    g->text_size = size;
    to[0] = 0;
}

static bool begin_element(void *context, const char *name, const char **attributes)
{
    gifti *g = context;
    g->text = NULL;
    if (!g->has_root && strcmp(name, "GIFTI") != 0) {
        plain_mesh_refuse(g->out, ERROR_INPUT_DAMAGED,
                          "the file is XML with the element \"%.40s\" and no GIfTI file", name);
        return false;
    }
    if (!g->has_root) snprintf(g->declared, sizeof g->declared, "%s", find(attributes, "NumberOfDataArrays"));
    g->has_root = true;
    if (strcmp(name, "DataArray") == 0) begin_array(g, attributes);
    if (g->open && strcmp(name, "Data") == 0) {
        if (g->open->array.begin > 0)
            return plain_mesh_refuse(g->out, ERROR_INPUT_DAMAGED,
                                     "array %d of the GIfTI file has its data twice", g->open->array.number);
        g->open->array.begin = xml_tag_end(&g->document);
    }
    if (strcmp(name, "Name") == 0) collect(g, g->key, sizeof g->key);
    if (strcmp(name, "Value") == 0 && g->open && g->open->intent == g->open->name &&
        strcmp(g->key, "Name") == 0)
        collect(g, g->open->name, sizeof g->open->name);
    if (g->open != &g->points) return g->out->refused == ERROR_NONE;
    if (strcmp(name, "DataSpace") == 0) collect(g, g->data_space, sizeof g->data_space);
    if (strcmp(name, "TransformedSpace") == 0) collect(g, g->other_space, sizeof g->other_space);
    if (strcmp(name, "MatrixData") == 0) collect(g, g->matrix, sizeof g->matrix);
    return g->out->refused == ERROR_NONE;
}

/* Warns of a matrix that is not the identity, or is not read to its end. */
static void warn_of_transform(gifti *g)
{
    const char *at = g->matrix;
    bool is_identity = true;
    for (int k = 0; is_identity && k < NUMBERS_OF_MATRIX; k++) {
        double value = 0;
        at += strspn(at, " \t\r\n");
        is_identity = plain_mesh_number(&at, &value) && value == (k % 5 == 0);
    }
    if (!is_identity || at[strspn(at, " \t\r\n")])
        plain_mesh_warn(
            g->out,
            "the GIfTI file has a transform to \"%s\", which is not applied: points are in its data space, \"%s\"",
            g->other_space, g->data_space);
}

static void end_element(void *context, const char *name)
{
    gifti *g = context;
    g->text = NULL;
    if (g->open && strcmp(name, "Data") == 0) g->open->array.end = xml_tag_begin(&g->document);
    if (g->open == &g->points && strcmp(name, "MatrixData") == 0) warn_of_transform(g);
    if (strcmp(name, "DataArray") == 0) g->open = NULL;
}

static void take_text(void *context, const char *text, int length)
{
    gifti *g = context;
    if (!g->text) return;
    const size_t used = strlen(g->text);
    snprintf(g->text + used, g->text_size - used, "%.*s", length, text);
}

/* ---- numbers */

/* Checks that the file has one array with this intent, with rows of three numbers. */
static bool check_array(gifti *g, const wanted *w, bool is_whole)
{
    const array *a = &w->array;
    if (w->count == 0)
        return plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "the GIfTI file has no array with the intent %s, only %d others, such as values or labels of the vertices of a surface in "
            "another file: give the file of the surface (.surf.gii). Append the arrays of values to that file to use them.",
            w->intent, g->arrays - g->points.count - g->triangles.count);
    if (w->count > 1)
        return plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "the GIfTI file has %d arrays with the intent %s: save each surface as a file of its own",
            w->count, w->intent);
    if (a->dimensions != 2 || a->side[1] != 3)
        return plain_mesh_refuse(g->out, ERROR_INPUT_DAMAGED,
                                 "array %d of the GIfTI file (%s) is not rows of three numbers", a->number,
                                 w->intent);
    if (!a->has_type || (is_whole && !number_is_whole(a->type)))
        return plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "array %d of the GIfTI file (%s) has numbers that are not read: save it with %s", a->number,
            w->intent, is_whole ? "NIFTI_TYPE_INT32" : "NIFTI_TYPE_FLOAT32");
    return true;
}

static bool damaged(gifti *g, const wanted *w, const char *format, ...) __attribute__((format(printf, 3, 4)));

static bool damaged(gifti *g, const wanted *w, const char *format, ...)
{
    char text[160];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return plain_mesh_refuse(g->out, ERROR_INPUT_DAMAGED,
                             "array %d of the GIfTI file (%s) %s: it is damaged or truncated. Save it again.",
                             w->array.number, w->intent, text);
}

static size_t columns_of(const array *a)
{
    return a->dimensions == 2 ? (size_t)a->side[1] : 1;
}

/* Converts text to doubles or 64-bit integers. */
static bool read_text(gifti *g, const wanted *w, size_t count, bool is_whole, unsigned char *to)
{
    const char *at = g->data + w->array.begin, *end = g->data + w->array.end;
    for (size_t k = 0; k < count; k++) {
        char word[64];
        const char *in = word;
        char *behind = word;
        double real = 0;
        while (at < end && isspace((unsigned char)*at)) at++;
        size_t length = 0;
        while (at + length < end && !isspace((unsigned char)at[length])) length++;
        snprintf(word, sizeof word, "%.*s", (int)(length < sizeof word ? length : 0), at);
        const int64_t whole = is_whole ? strtoll(word, &behind, 10) : 0;
        if (!*word || (is_whole ? *behind != 0 : !plain_mesh_number(&in, &real) || *in))
            return damaged(g, w, "has %zu numbers, and %zu are expected", k, count);
        memcpy(to + 8 * k, is_whole ? (const void *)&whole : &real, 8);
        at += length;
    }
    while (at < end && isspace((unsigned char)*at)) at++;
    return at == end || damaged(g, w, "has more than %zu numbers", count);
}

static bool read_packed(gifti *g, const wanted *w, size_t bytes, unsigned char *to)
{
    const char *at = g->data + w->array.begin, *end = g->data + w->array.end;
    const size_t there = base64_count(at, end);
    if (w->array.encoding == ENCODING_BASE64) {
        if (there != bytes) return damaged(g, w, "has %zu bytes, and %zu are expected", there, bytes);
        return base64_read(&at, end, to, bytes) || damaged(g, w, "is not base64");
    }
    unsigned char *packed = malloc(there > 0 ? there : 1);
    if (!packed) return plain_mesh_refuse_memory(g->out);
    uLongf got = (uLongf)bytes;
    bool ok = base64_read(&at, end, packed, there) || damaged(g, w, "is not base64");
    if (ok && (uncompress(to, &got, packed, (uLong)there) != Z_OK || got != bytes))
        ok = damaged(g, w, "cannot be decompressed to %zu bytes", bytes);
    free(packed);
    return ok;
}

/* Reads the numbers of an array, text as doubles or 64-bit integers. The caller frees them. NULL: the file
 * is refused. */
static unsigned char *read_array(gifti *g, wanted *w)
{
    array *a = &w->array;
    const bool is_text = a->encoding == ENCODING_TEXT, is_whole = number_is_whole(a->type);
    if (is_text) {
        a->type = is_whole ? NUMBER_INT64 : NUMBER_DOUBLE;
        a->is_swapped = false;
    }
    const double count = a->side[0] * (double)columns_of(a), bytes = count * (double)number_bytes(a->type),
                 length = a->end > a->begin ? (double)(a->end - a->begin) : 0;
    /* check before allocation that the data can have this number of values */
    const double possible = is_text                        ? (length + 1) / 2 * 8
                            : a->encoding == ENCODING_ZLIB ? (length + most_of_none) * most_packed
                                                           : length;
    if (bytes > possible) {
        damaged(g, w, "has %.0f values, and its data have %.0f bytes", count, length);
        return NULL;
    }
    unsigned char *numbers = malloc(bytes > 0 ? (size_t)bytes : 1);
    if (!numbers) {
        plain_mesh_refuse_memory(g->out);
        return NULL;
    }
    if (is_text ? read_text(g, w, (size_t)count, is_whole, numbers)
                : read_packed(g, w, (size_t)bytes, numbers))
        return numbers;
    free(numbers);
    return NULL;
}

/* Address of the number `column` of row `row`. */
static const unsigned char *number_at(const wanted *w, const unsigned char *numbers, size_t row,
                                      size_t column)
{
    const array *a = &w->array;
    return numbers + (a->by_column ? column * (size_t)a->side[0] + row : columns_of(a) * row + column) *
                         number_bytes(a->type);
}

/* ---- the mesh */

static bool add_points(gifti *g)
{
    wanted *w = &g->points;
    unsigned char *numbers = read_array(g, w);
    const size_t count = (size_t)w->array.side[0];
    bool ok = numbers && plain_mesh_expect(g->out, count, 0);
    for (size_t n = 0; ok && n < count; n++) {
        double at[3];
        for (size_t k = 0; k < 3; k++)
            at[k] = number_value(number_at(w, numbers, n, k), w->array.type, w->array.is_swapped);
        ok = plain_mesh_add_vertex(g->out, at);
    }
    free(numbers);
    return ok;
}

static bool add_triangles(gifti *g)
{
    wanted *w = &g->triangles;
    unsigned char *numbers = read_array(g, w);
    const size_t count = (size_t)w->array.side[0];
    bool ok = numbers && plain_mesh_expect(g->out, 0, count);
    for (size_t n = 0; ok && n < count; n++) {
        int64_t corner[3];
        for (size_t k = 0; k < 3; k++)
            corner[k] = number_whole(number_at(w, numbers, n, k), w->array.type, w->array.is_swapped);
        for (int k = 0; ok && k < 3; k++)
            if (corner[k] < 0 || corner[k] >= (int64_t)g->out->vertices)
                ok = plain_mesh_refuse(
                    g->out, ERROR_INPUT_DAMAGED,
                    "triangle %zu of the GIfTI file has the point %lld, and there are %zu points: repair the file",
                    n, (long long)corner[k], g->out->vertices);
        ok = ok && plain_mesh_add_triangle(g->out, (uint32_t)corner[0], (uint32_t)corner[1],
                                           (uint32_t)corner[2], false);
    }
    free(numbers);
    return ok;
}

/* Reads an array of values. One of more than MESH_VALUES_COMPONENTS columns is skipped. */
static bool add_values(gifti *g, wanted *w)
{
    const array *a = &w->array;
    if (a->dimensions < 1 || a->dimensions > 2 || a->side[0] != (double)g->out->vertices || !a->has_type)
        return plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "array %d of the GIfTI file (%s) does not have a row of numbers for each of the %zu "
            "points: correct it, or remove it",
            a->number, w->name, g->out->vertices);
    const size_t columns = columns_of(a);
    plain_values *to = plain_mesh_add_values(g->out, w->name, w->kind, columns);
    if (!to) return true;
    unsigned char *numbers = read_array(g, w);
    bool ok = numbers != NULL;
    for (size_t n = 0; ok && n < g->out->vertices; n++) {
        double row[MESH_VALUES_COMPONENTS];
        for (size_t c = 0; c < columns; c++)
            row[c] = number_value(number_at(w, numbers, n, c), a->type, a->is_swapped);
        ok = plain_mesh_set_values(g->out, to, n, row);
    }
    free(numbers);
    return ok;
}

static bool add_all_values(gifti *g)
{
    for (int k = 0; k < g->value_arrays; k++)
        if (!add_values(g, &g->values[k])) return false;
    return true;
}

bool plain_mesh_read_gifti(const char *data, size_t size, plain_mesh *out)
{
    gifti g = {.data = data,
               .size = size,
               .out = out,
               .points = {.intent = "NIFTI_INTENT_POINTSET"},
               .triangles = {.intent = "NIFTI_INTENT_TRIANGLE"}};
    g.document = (xml){.data = data,
                       .size = size,
                       .context = &g,
                       .begin = begin_element,
                       .end = end_element,
                       .text = take_text,
                       .allows_doctype = true};
    const bool ok = plain_mesh_read_xml(out, &g.document, "the GIfTI file") &&
                    check_array(&g, &g.points, false) && check_array(&g, &g.triangles, true) &&
                    add_points(&g) && add_triangles(&g) && add_all_values(&g);
    char arrays[WORD_SIZE];
    snprintf(arrays, sizeof arrays, "%d", g.arrays);
    if (ok && strcmp(g.declared, arrays) != 0)
        plain_mesh_warn(out, "NumberOfDataArrays is \"%s\", and the file has %s arrays: all are read",
                        g.declared, arrays);
    return ok;
}
