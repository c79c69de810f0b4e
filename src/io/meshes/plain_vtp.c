// SPDX-License-Identifier: Apache-2.0
/* VTK's XML files of PolyData (.vtp). Arrays may be text, base64, or appended (raw or base64), with or
 * without compression by zlib. base/xml finds the arrays; their contents are read here. Values of points are read if
 * the mesh keeps them; those of cells are not read. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <zlib.h>

#include "io/meshes/base64.h"
#include "io/meshes/vtk_data.h"

enum { SECTIONS = VTK_CELLS_KINDS + 1, POINTS = VTK_CELLS_KINDS, VALUES };

/* Maximum number of pieces of a file. */
static const size_t most_pieces = 1 << 16;

/* Maximum length of unpacked data: (packed bytes + most_of_none) * most_packed. A deflate stream expands a
 * byte to at most 1032. */
static const uint64_t most_packed = 1032, most_of_none = 64;

typedef enum place { PLACE_NONE, PLACE_TEXT, PLACE_BASE64, PLACE_APPENDED } place;

typedef struct array {
    place place;
    number_type type;
    size_t begin, end; /* range in the file; `begin` of an appended array is relative to the start of the
                        * appended data */
    bool has_end;
} array;

/* An array of values of the points. */
typedef struct point_values {
    char name[MESH_VALUES_NAME_SIZE];
    mesh_values_kind kind;
    size_t components;
    array array;
} point_values;

/* A piece: for each section (points, and each kind of cells) the number of items and the arrays.
 * `connectivity` of the points has their positions; they have no offsets. */
typedef struct piece {
    size_t count[SECTIONS];
    array connectivity[SECTIONS], offsets[SECTIONS];
    point_values *values;
    size_t value_count;
} piece;

typedef struct vtp {
    const char *data;
    size_t size; /* bytes */
    xml document;
    plain_mesh *out;
    piece *pieces;
    size_t piece_count;
    bool is_swapped, has_long_heads, is_packed;
    bool has_file; /* the element VTKFile has been read */
    int section;   /* the section that is open, or -1; VALUES: those of the points */
    /* names of the open section VALUES, from its element */
    char normals[MESH_VALUES_NAME_SIZE], uv[MESH_VALUES_NAME_SIZE];
    array *open; /* the array that is open, or NULL */
    bool has_appended, is_appended_base64;
    size_t appended; /* start of the appended data in the file */
} vtp;

/* ---- the elements */

static bool read_count(vtp *v, const char **attributes, const char *name, size_t *out)
{
    const char *text = xml_attribute(attributes, name);
    char *end = NULL;
    const long long number = text ? strtoll(text, &end, 10) : 0;
    *out = number > 0 ? (size_t)number : 0;
    if (text && (end == text || end[strspn(end, " \t\r\n")] || number < 0))
        return plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED,
                                 "line %lu of the VTK file has %s=\"%.40s\", which is not a number",
                                 xml_line(&v->document), name, text);
    return true;
}

static void begin_file(vtp *v, const char *name, const char **attributes)
{
    const char *type = xml_attribute(attributes, "type"), *order = xml_attribute(attributes, "byte_order"),
               *heads = xml_attribute(attributes, "header_type"),
               *packing = xml_attribute(attributes, "compressor");
    v->has_file = true;
    if (strcmp(name, "VTKFile") != 0) {
        plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED,
                          "the file is XML with the element \"%.40s\" and no VTK file", name);
    } else if (!type || strcmp(type, "PolyData") != 0) {
        const bool is_volume =
            type && (strcmp(type, "ImageData") == 0 || strcmp(type, "RectilinearGrid") == 0);
        plain_mesh_refuse(
            v->out, ERROR_INPUT_UNSUPPORTED, "the VTK file has the type \"%.40s\", and PolyData is read: %s",
            type ? type : "",
            is_volume
                ? "it is a volume. Save it as MetaImage with ParaView and name it as /surface/volume/path."
                : "apply Extract Surface in ParaView, and save it as .vtp.");
    } else if (packing && *packing && strcmp(packing, "vtkZLibDataCompressor") != 0) {
        plain_mesh_refuse(
            v->out, ERROR_INPUT_UNSUPPORTED,
            "the VTK file has the compressor \"%.60s\", which is not read: save it with zlib or without "
            "compression",
            packing);
    }
    if ((order && strcmp(order, "LittleEndian") != 0 && strcmp(order, "BigEndian") != 0) ||
        (heads && strcmp(heads, "UInt32") != 0 && strcmp(heads, "UInt64") != 0))
        plain_mesh_refuse(
            v->out, ERROR_INPUT_UNSUPPORTED,
            "the VTK file has the byte_order \"%.40s\" and the header_type \"%.40s\": LittleEndian, "
            "BigEndian, UInt32 and UInt64 are read",
            order ? order : "", heads ? heads : "");
    v->is_packed = packing && *packing;
    v->has_long_heads = heads && strcmp(heads, "UInt64") == 0;
    v->is_swapped = (order && strcmp(order, "BigEndian") == 0) != (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__);
}

static void begin_piece(vtp *v, const char **attributes)
{
    static const char *const counts[SECTIONS] = {"NumberOfVerts", "NumberOfLines", "NumberOfStrips",
                                                 "NumberOfPolys", "NumberOfPoints"};
    if (v->piece_count == most_pieces) {
        plain_mesh_refuse(v->out, ERROR_INPUT_UNSUPPORTED,
                          "the VTK file has more than %zu pieces: save it as one", most_pieces);
        return;
    }
    piece *grown = realloc(v->pieces, (v->piece_count + 1) * sizeof *grown);
    if (!grown) {
        plain_mesh_refuse_memory(v->out);
        return;
    }
    v->pieces = grown;
    v->open = NULL;
    v->section = -1;
    piece *p = &v->pieces[v->piece_count++];
    memset(p, 0, sizeof *p);
    for (int k = 0; k < SECTIONS; k++)
        if (!read_count(v, attributes, counts[k], &p->count[k])) return;
}

/* The values of points: which arrays are normals and texture coordinates. */
static void begin_values(vtp *v, const char **attributes)
{
    const char *normals = xml_attribute(attributes, "Normals"), *uv = xml_attribute(attributes, "TCoords");
    snprintf(v->normals, sizeof v->normals, "%s", normals ? normals : "");
    snprintf(v->uv, sizeof v->uv, "%s", uv ? uv : "");
    v->section = VALUES;
}

/* Adds an array of values to the last piece, unless it has no numbers. Returns its place, or NULL. */
static array *add_values(vtp *v, const char *name, const char *type, const char **attributes)
{
    piece *p = &v->pieces[v->piece_count - 1];
    number_type number;
    size_t components = 1;
    if (!type || !number_find(type, &number) || !name || p->value_count == MESH_VALUES_MOST) return NULL;
    if (xml_attribute(attributes, "NumberOfComponents") &&
        !read_count(v, attributes, "NumberOfComponents", &components))
        return NULL;
    if (components == 0 || components > MESH_VALUES_COMPONENTS) return NULL;
    point_values *grown = realloc(p->values, (p->value_count + 1) * sizeof *grown);
    if (!grown) {
        plain_mesh_refuse_memory(v->out);
        return NULL;
    }
    p->values = grown;
    point_values *one = &p->values[p->value_count++];
    *one = (point_values){.components = components};
    snprintf(one->name, sizeof one->name, "%s", name);
    one->kind = components == 3 && strcmp(one->name, v->normals) == 0 ? MESH_VALUES_NORMAL
                : components == 2 && strcmp(one->name, v->uv) == 0    ? MESH_VALUES_UV
                                                                      : MESH_VALUES_NUMBER;
    return &one->array;
}

static void begin_array(vtp *v, const char **attributes)
{
    const char *name = xml_attribute(attributes, "Name"), *type = xml_attribute(attributes, "type"),
               *format = xml_attribute(attributes, "format"),
               *components = xml_attribute(attributes, "NumberOfComponents");
    piece *p = &v->pieces[v->piece_count - 1];
    array *a = v->section == VALUES                        ? add_values(v, name, type, attributes)
               : v->section == POINTS                      ? &p->connectivity[POINTS]
               : name && strcmp(name, "connectivity") == 0 ? &p->connectivity[v->section]
               : name && strcmp(name, "offsets") == 0      ? &p->offsets[v->section]
                                                           : NULL;
    if (!a) return;
    if (a->place != PLACE_NONE) {
        plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED,
                          "line %lu of the VTK file begins an array of its piece for the second time",
                          xml_line(&v->document));
        return;
    }
    *a = (array){.begin = xml_tag_end(&v->document), .end = v->size};
    if (!type || !number_find(type, &a->type) || (v->section < POINTS && !number_is_whole(a->type)) ||
        (v->section == POINTS && components && strcmp(components + strspn(components, " "), "3") != 0)) {
        plain_mesh_refuse(
            v->out, ERROR_INPUT_UNSUPPORTED,
            "line %lu of the VTK file has an array of %.10s numbers of the type \"%.40s\": points have three "
            "numbers, and indices are whole",
            xml_line(&v->document), components ? components : "1", type ? type : "");
        return;
    }
    a->place = !format || strcmp(format, "ascii") == 0 ? PLACE_TEXT
               : strcmp(format, "binary") == 0         ? PLACE_BASE64
               : strcmp(format, "appended") == 0       ? PLACE_APPENDED
                                                       : PLACE_NONE;
    if (a->place == PLACE_NONE)
        plain_mesh_refuse(
            v->out, ERROR_INPUT_UNSUPPORTED,
            "line %lu of the VTK file has the format \"%.40s\": save it as ascii, binary or appended",
            xml_line(&v->document), format);
    if (a->place == PLACE_APPENDED && !xml_attribute(attributes, "offset"))
        plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED,
                          "line %lu of the VTK file has an appended array without an offset",
                          xml_line(&v->document));
    if (a->place == PLACE_APPENDED && !read_count(v, attributes, "offset", &a->begin)) return;
    v->open = a;
}

/* Finds the start of the appended data, and stops the XML reader: they may not be valid XML. */
static void begin_appended(vtp *v, const char **attributes)
{
    const char *encoding = xml_attribute(attributes, "encoding");
    v->is_appended_base64 = !encoding || strcmp(encoding, "base64") == 0;
    if (!v->is_appended_base64 && strcmp(encoding, "raw") != 0) {
        plain_mesh_refuse(v->out, ERROR_INPUT_UNSUPPORTED,
                          "the VTK file has appended data in the encoding \"%.40s\": raw and base64 are read",
                          encoding);
        return;
    }
    v->appended = xml_tag_end(&v->document);
    while (v->appended < v->size && isspace((unsigned char)v->data[v->appended])) v->appended++;
    if (v->appended >= v->size || v->data[v->appended] != '_') {
        plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED,
                          "the appended data of the VTK file do not begin with \"_\": it is damaged");
        return;
    }
    v->appended++;
    v->has_appended = true;
}

static const char points[] = "Points", values[] = "PointData";

static bool begin_element(void *context, const char *name, const char **attributes)
{
    vtp *v = context;
    if (v->open && !v->open->has_end && v->open->place != PLACE_APPENDED) {
        v->open->end = xml_tag_begin(&v->document);
        v->open->has_end = true;
    }
    if (!v->has_file) {
        begin_file(v, name, attributes);
        return v->out->refused == ERROR_NONE;
    }
    if (strcmp(name, "Piece") == 0) begin_piece(v, attributes);
    if (strcmp(name, "AppendedData") == 0) begin_appended(v, attributes);
    if (strcmp(name, "DataArray") == 0 && v->section >= 0 && v->piece_count > 0 && !v->open)
        begin_array(v, attributes);
    if (strcmp(name, points) == 0) v->section = POINTS;
    if (strcmp(name, values) == 0 && v->out->keeps_values) begin_values(v, attributes);
    for (int k = 0; k < VTK_CELLS_KINDS; k++)
        if (strcmp(name, vtk_cells_name((vtk_cells_kind)k)) == 0) v->section = k;
    return v->out->refused == ERROR_NONE && !v->has_appended;
}

static void end_element(void *context, const char *name)
{
    vtp *v = context;
    if (strcmp(name, "DataArray") == 0) {
        if (v->open && !v->open->has_end && v->open->place != PLACE_APPENDED) {
            v->open->end = xml_tag_begin(&v->document);
            v->open->has_end = true;
        }
        v->open = NULL;
    }
    if (strcmp(name, points) == 0 || strcmp(name, values) == 0) v->section = -1;
    for (int k = 0; k < VTK_CELLS_KINDS; k++)
        if (strcmp(name, vtk_cells_name((vtk_cells_kind)k)) == 0) v->section = -1;
}

/* ---- bytes of an array */

typedef struct stream {
    const char *at, *end;
    bool is_base64;
} stream;

/* Reads the next bytes. In base64 they are one block: whole groups of four characters, with padding. */
static bool read_bytes(stream *s, unsigned char *to, size_t count)
{
    if (!s->is_base64) {
        if ((size_t)(s->end - s->at) < count) return false;
        memcpy(to, s->at, count);
        s->at += count;
        return true;
    }
    return base64_read(&s->at, s->end, to, count);
}

/* An upper bound of the number of bytes left in a stream. */
static uint64_t bytes_left(const stream *s)
{
    const uint64_t left = (uint64_t)(s->end - s->at);
    return s->is_base64 ? left / 4 * 3 : left;
}

static size_t head_bytes(const vtp *v)
{
    return v->has_long_heads ? 8 : 4;
}

static uint64_t head_at(const vtp *v, const unsigned char *at)
{
    const int64_t whole = number_whole(at, v->has_long_heads ? NUMBER_UINT64 : NUMBER_UINT32, v->is_swapped);
    return (uint64_t)whole;
}

/* An array, for messages: its name and piece. */
typedef struct wanted {
    const char *name;
    size_t piece, bytes; /* bytes: the required length */
} wanted;

static bool damaged(vtp *v, const wanted *w, const char *why)
{
    return plain_mesh_refuse(
        v->out, ERROR_INPUT_DAMAGED,
        "the array %s of piece %zu of the VTK file %s: it is damaged or truncated. Save it again.", w->name,
        w->piece, why);
}

static bool read_plain(vtp *v, stream s, const wanted *w, unsigned char *to)
{
    unsigned char head[8];
    const size_t size = head_bytes(v);
    stream peek = s;
    char why[120];
    if (!read_bytes(&peek, head, size)) return damaged(v, w, "ends within its length");
    const uint64_t said = head_at(v, head);
    if (said != w->bytes) {
        snprintf(why, sizeof why, "has %llu bytes, and %zu are expected", (unsigned long long)said, w->bytes);
        return damaged(v, w, why);
    }
    if (!s.is_base64) return read_bytes(&peek, to, w->bytes) || damaged(v, w, "ends early");
    /* base64: the length and the data share one block */
    unsigned char *both = malloc(size + w->bytes);
    if (!both) return plain_mesh_refuse_memory(v->out);
    const bool ok = read_bytes(&s, both, size + w->bytes) || damaged(v, w, "ends early, or is not base64");
    if (ok) memcpy(to, both + size, w->bytes);
    free(both);
    return ok;
}

/* Reads compressed data: a header with the number of blocks, their unpacked length, that of the last block
 * if it is shorter, and the packed lengths; then the blocks. */
static bool read_packed(vtp *v, stream s, const wanted *w, unsigned char *to)
{
    unsigned char first[24];
    const size_t size = head_bytes(v);
    stream peek = s;
    char why[120];
    if (!read_bytes(&peek, first, 3 * size)) return damaged(v, w, "ends within its lengths");
    const uint64_t blocks = head_at(v, first), length = head_at(v, first + size),
                   last = head_at(v, first + 2 * size), left = bytes_left(&s);
    if (blocks > left / size || (blocks > 0 && (length == 0 || length > SIZE_MAX / 4 / blocks)) ||
        last > length)
        return damaged(v, w, "has invalid lengths of blocks");
    const uint64_t said = blocks == 0 ? 0 : (blocks - 1) * length + (last > 0 ? last : length);
    if (said != w->bytes) {
        snprintf(why, sizeof why, "has %llu bytes, and %zu are expected", (unsigned long long)said, w->bytes);
        return damaged(v, w, why);
    }
    const size_t heads = (3 + (size_t)blocks) * size;
    unsigned char *head = malloc(heads), *packed = NULL;
    if (!head) return plain_mesh_refuse_memory(v->out);
    bool ok = read_bytes(&s, head, heads) || damaged(v, w, "ends within its lengths");
    uint64_t total = 0, most = 0;
    for (uint64_t k = 0; ok && k < blocks; k++) {
        const uint64_t own = head_at(v, head + (3 + k) * size);
        if (own > left) ok = damaged(v, w, "has a block that is longer than the file");
        total += own;
        most = own > most ? own : most;
    }
    if (ok && total > left) ok = damaged(v, w, "has blocks that are longer than the file");
    /* base64: all blocks of data share one block of base64 */
    if (ok && s.is_base64 && (!(packed = malloc(total > 0 ? (size_t)total : 1))))
        ok = plain_mesh_refuse_memory(v->out);
    if (ok && s.is_base64 && !read_bytes(&s, packed, (size_t)total))
        ok = damaged(v, w, "ends early, or is not base64");
    if (ok && !s.is_base64 && total > (uint64_t)(s.end - s.at)) ok = damaged(v, w, "ends early");
    const unsigned char *from = packed ? packed : (const unsigned char *)s.at;
    for (uint64_t k = 0, at = 0; ok && k < blocks; k++) {
        const uint64_t own = head_at(v, head + (3 + k) * size);
        const uint64_t expected = k + 1 < blocks || last == 0 ? length : last;
        uLongf got = (uLongf)expected;
        if (uncompress(to + k * length, &got, from + at, (uLong)own) != Z_OK || got != expected)
            ok = damaged(v, w, "cannot be decompressed");
        at += own;
    }
    free(packed);
    free(head);
    return ok;
}

/* Converts text to doubles or 64-bit integers. */
static bool read_text(vtp *v, const array *a, const wanted *w, size_t count, bool is_whole, unsigned char *to)
{
    const char *at = v->data + a->begin, *end = v->data + a->end;
    for (size_t k = 0; k < count; k++) {
        double real = 0;
        char *behind;
        while (at < end && isspace((unsigned char)*at)) at++;
        const char *begin = at;
        if (is_whole) {
            const int64_t whole = at < end ? strtoll(at, &behind, 10) : 0;
            if (at < end) at = behind;
            memcpy(to + 8 * k, &whole, sizeof whole);
        } else if (at < end) {
            /* numbers end at blanks, or at a tag */
            char word[64];
            const size_t length = strcspn(at, " \t\r\n<");
            const char *in = word;
            snprintf(word, sizeof word, "%.*s", (int)(length < sizeof word ? length : sizeof word - 1), at);
            if (length < sizeof word && plain_mesh_number(&in, &real)) at += length;
            memcpy(to + 8 * k, &real, sizeof real);
        }
        if (at == begin || at > end) {
            char why[120];
            snprintf(why, sizeof why, "has %zu numbers, and %zu are expected", k, count);
            return damaged(v, w, why);
        }
    }
    while (at < end && isspace((unsigned char)*at)) at++;
    return at == end || damaged(v, w, "has more numbers than its piece declares, or a damaged one");
}

/* Reads `count` numbers of an array. The caller frees them. *type: their type. *swapped: they have the
 * opposite byte order. NULL: the file is refused. */
static unsigned char *read_array(vtp *v, const array *a, size_t piece_index, const char *name, size_t count,
                                 number_type *type, bool *swapped)
{
    const bool is_whole = number_is_whole(a->type);
    *type = a->place != PLACE_TEXT ? a->type : is_whole ? NUMBER_INT64 : NUMBER_DOUBLE;
    *swapped = a->place != PLACE_TEXT && v->is_swapped;
    const size_t each = number_bytes(*type);
    stream s = {v->data + a->begin, v->data + a->end, true};
    wanted w = {name, piece_index, 0};
    if (a->place == PLACE_NONE || (a->place == PLACE_APPENDED && !v->has_appended)) {
        damaged(v, &w, "is missing");
        return NULL;
    }
    if (a->place == PLACE_APPENDED) {
        if (a->begin > v->size - v->appended) {
            damaged(v, &w, "begins behind the end of the file");
            return NULL;
        }
        s = (stream){v->data + v->appended + a->begin, v->data + v->size, v->is_appended_base64};
    }
    /* check before allocation that the data can have this number of values */
    const uint64_t left = (uint64_t)(s.end - s.at),
                   possible = a->place == PLACE_TEXT ? (left + 1) / 2
                              : v->is_packed         ? (left + most_of_none) * most_packed / each
                                                     : bytes_left(&s) / each;
    if (count > possible) {
        char why[120];
        snprintf(why, sizeof why, "has at most %llu numbers, and %zu are expected",
                 (unsigned long long)possible, count);
        damaged(v, &w, why);
        return NULL;
    }
    w.bytes = count * each;
    unsigned char *bytes = malloc(w.bytes > 0 ? w.bytes : 1);
    if (!bytes) {
        plain_mesh_refuse_memory(v->out);
        return NULL;
    }
    bool ok = a->place == PLACE_TEXT ? read_text(v, a, &w, count, is_whole, bytes)
              : v->is_packed         ? read_packed(v, s, &w, bytes)
                                     : read_plain(v, s, &w, bytes);
    if (ok) return bytes;
    free(bytes);
    return NULL;
}

/* ---- the mesh */

static bool add_points(vtp *v, size_t index)
{
    const piece *p = &v->pieces[index];
    const size_t count = p->count[POINTS];
    number_type type = NUMBER_DOUBLE;
    bool swapped = false;
    if (count == 0) return true;
    if (count > UINT32_MAX)
        return plain_mesh_refuse(v->out, ERROR_INPUT_UNSUPPORTED,
                                 "the VTK file has %zu points: cut it into parts", count);
    unsigned char *bytes =
        read_array(v, &p->connectivity[POINTS], index, "Points", 3 * count, &type, &swapped);
    if (!bytes) return false;
    const size_t each = number_bytes(type);
    bool ok = plain_mesh_expect(v->out, v->out->vertices + count, 0);
    for (size_t n = 0; ok && n < count; n++) {
        double at[3];
        for (size_t k = 0; k < 3; k++) at[k] = number_value(bytes + (3 * n + k) * each, type, swapped);
        ok = plain_mesh_add_vertex(v->out, at);
    }
    free(bytes);
    return ok;
}

/* Whether an array has text other than blanks in its element. */
static bool has_numbers(const vtp *v, const array *a)
{
    if (a->place != PLACE_TEXT) return false;
    size_t at = a->begin;
    while (at < a->end && isspace((unsigned char)v->data[at])) at++;
    return at < a->end;
}

static bool add_cells(vtp *v, size_t index, vtk_cells_kind kind, size_t first)
{
    const piece *p = &v->pieces[index];
    const size_t cells = p->count[kind];
    number_type type = NUMBER_INT64, corner_type = NUMBER_INT64;
    bool swapped = false, corner_swapped = false, ok = true;
    char name[64];
    int64_t *vertex = NULL;
    size_t room = 0;
    if (cells == 0 && !has_numbers(v, &p->connectivity[kind])) return true;
    if (cells == 0) return damaged(v, &(wanted){vtk_cells_name(kind), index, 0}, "has numbers for 0 cells");
    if (cells > SIZE_MAX / 16)
        return plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED, "the VTK file has too many cells");
    snprintf(name, sizeof name, "offsets of %s", vtk_cells_name(kind));
    unsigned char *offsets = read_array(v, &p->offsets[kind], index, name, cells, &type, &swapped),
                  *corners = NULL;
    const int64_t total =
        offsets ? number_whole(offsets + (cells - 1) * number_bytes(type), type, swapped) : 0;
    snprintf(name, sizeof name, "connectivity of %s", vtk_cells_name(kind));
    if (offsets && (total < 0 || total > INT64_MAX / 16))
        ok = damaged(v, &(wanted){name, index, 0}, "has an invalid length");
    ok = ok && offsets &&
         (corners = read_array(v, &p->connectivity[kind], index, name, (size_t)total, &corner_type,
                               &corner_swapped));
    int64_t begin = 0;
    for (size_t n = 0; ok && n < cells; n++) {
        const int64_t end = number_whole(offsets + n * number_bytes(type), type, swapped);
        if (end < begin || end > total) {
            ok = damaged(v, &(wanted){name, index, 0}, "has offsets that do not grow");
            break;
        }
        const size_t count = (size_t)(end - begin);
        if (count > room) {
            int64_t *grown = realloc(vertex, count * sizeof *grown);
            if (!grown) {
                ok = plain_mesh_refuse_memory(v->out);
                break;
            }
            vertex = grown;
            room = count;
        }
        for (size_t k = 0; k < count; k++)
            vertex[k] = number_whole(corners + ((size_t)begin + k) * number_bytes(corner_type), corner_type,
                                     corner_swapped);
        ok = vtk_add_cell(v->out, kind, (int64_t)n, vertex, count, first);
        begin = end;
    }
    free(vertex);
    free(corners);
    free(offsets);
    return ok;
}

/* Reads an array of values of one piece, whose vertices begin at `first`. */
static bool read_values(vtp *v, size_t index, const point_values *one, size_t first, plain_values *to)
{
    const size_t rows = v->pieces[index].count[POINTS], width = one->components;
    number_type type = NUMBER_DOUBLE;
    bool swapped = false;
    unsigned char *bytes = read_array(v, &one->array, index, one->name, width * rows, &type, &swapped);
    bool ok = bytes != NULL;
    for (size_t n = 0; ok && n < rows; n++) {
        double row[MESH_VALUES_COMPONENTS];
        for (size_t c = 0; c < width; c++)
            row[c] = number_value(bytes + (width * n + c) * number_bytes(type), type, swapped);
        ok = plain_mesh_set_values(v->out, to, first + n, row);
    }
    free(bytes);
    return ok;
}

/* Reads the arrays of values that the first piece with points has. Each piece with points must have them. */
static bool add_all_values(vtp *v)
{
    size_t first = 0;
    while (first < v->piece_count && v->pieces[first].count[POINTS] == 0) first++;
    for (size_t k = 0; first < v->piece_count && k < v->pieces[first].value_count; k++) {
        const point_values *of_first = &v->pieces[first].values[k];
        size_t vertex = 0;
        plain_values *to =
            plain_mesh_add_values(v->out, of_first->name, of_first->kind, of_first->components);
        for (size_t n = first; to && n < v->piece_count; n++) {
            const piece *p = &v->pieces[n];
            size_t own = 0, named = 0;
            if (p->count[POINTS] == 0) continue;
            for (size_t m = 0; m < p->value_count; m++)
                named += strcmp(p->values[m].name, of_first->name) == 0;
            if (n > first && named > 1)
                return plain_mesh_refuse(v->out, ERROR_INPUT_DAMAGED,
                                         "piece %zu of the VTK file has the values \"%.40s\" twice", n,
                                         of_first->name);
            while (own < p->value_count && (strcmp(p->values[own].name, of_first->name) != 0 ||
                                            p->values[own].components != of_first->components))
                own++;
            if (own == p->value_count)
                return plain_mesh_refuse(
                    v->out, ERROR_INPUT_DAMAGED,
                    "piece %zu of the VTK file has no values \"%.40s\" of %zu components, which piece %zu has",
                    n, of_first->name, of_first->components, first);
            if (!read_values(v, n, &p->values[own], vertex, to)) return false;
            vertex += p->count[POINTS];
        }
    }
    return true;
}

static bool build(vtp *v)
{
    for (size_t n = 0; n < v->piece_count; n++) {
        const size_t first = v->out->vertices;
        if (!add_points(v, n)) return false;
        for (int k = 0; k < VTK_CELLS_KINDS; k++)
            if (!add_cells(v, n, (vtk_cells_kind)k, first)) return false;
    }
    return !v->out->keeps_values || add_all_values(v);
}

bool plain_mesh_read_vtp(const char *data, size_t size, plain_mesh *out)
{
    vtp v = {.data = data, .size = size, .out = out, .section = -1};
    v.document = (xml){.data = data, .size = size, .context = &v, .begin = begin_element, .end = end_element};
    const bool ok = plain_mesh_read_xml(out, &v.document, "the VTK file") && build(&v);
    for (size_t n = 0; n < v.piece_count; n++) free(v.pieces[n].values);
    free(v.pieces);
    return ok;
}
