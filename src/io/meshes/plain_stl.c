// SPDX-License-Identifier: Apache-2.0
/* STL: binary if the size is that which follows from its count of triangles, with or without attribute bytes behind
 * each; otherwise text, with one or more solids, if it begins with "solid"; otherwise binary with other data behind
 * the triangles. Values: the normals, the numbers of the solids, and the colours of binary files, as Magics writes
 * them if the header has "COLOR=", otherwise as VisCAM does. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core/number.h"
#include "io/meshes/plain_mesh.h"

enum { HEADER = 84, COUNT_AT = 80, TRIANGLE = 50, CORNERS_AT = 12 };

/* Arrays of the values of the vertices, and what those of a triangle have. */
typedef struct stl_values {
    plain_values *normals, *colors, *groups;
    double normal[3], color[4], group;
    bool has_color;
} stl_values;

/* `place`: of the corners in a text; or NULL. */
static bool add_triangle(const double at[3][3], const char *const place[3], const stl_values *v,
                         plain_mesh *out)
{
    const uint32_t first = (uint32_t)out->vertices, corner[3] = {first, first + 1, first + 2};
    for (int k = 0; k < 3; k++) {
        out->vertex_at = place ? place[k] : NULL;
        if (!plain_mesh_add_vertex(out, at[k]) ||
            !plain_mesh_set_values(out, v->normals, corner[k], v->normal) ||
            (v->has_color && !plain_mesh_set_values(out, v->colors, corner[k], v->color)) ||
            !plain_mesh_set_values(out, v->groups, corner[k], &v->group))
            return false;
    }
    return plain_mesh_add_polygon(out, corner, 3);
}

/* The colour of a triangle, of which red, green and blue have 5 bits each. Magics: the highest bit is 0, or the
 * colour is that of the header. VisCAM: the highest bit is 1, or there is no colour. */
static void read_color(unsigned bits, const unsigned char *of_header, stl_values *v)
{
    const bool is_marked = (bits >> 15) & 1;
    v->has_color = of_header || is_marked;
    for (int k = 0; k < 3; k++)
        v->color[k] = of_header && is_marked ? of_header[k] / 255.0
                                             : ((bits >> (5 * (of_header ? k : 2 - k))) & 31) / 31.0;
    v->color[3] = of_header && is_marked ? of_header[3] / 255.0 : 1;
}

/* `has_attributes`: each triangle is followed by as many bytes as its last field says. */
static bool read_binary(const char *data, size_t count, bool has_attributes, stl_values *v, plain_mesh *out)
{
    const char *triangle = data + HEADER, *mark = memmem(data, COUNT_AT, "COLOR=", strlen("COLOR="));
    const bool has_color = mark && mark + strlen("COLOR=") + 4 <= data + COUNT_AT;
    const unsigned char *of_header = has_color ? (const unsigned char *)mark + strlen("COLOR=") : NULL;
    for (size_t n = 0; n < count; n++) {
        double at[4][3];
        for (int k = 0; k < 12; k++)
            at[k / 3][k % 3] = number_value(triangle + 4 * k, NUMBER_FLOAT, NUMBER_LITTLE_SWAPPED);
        const unsigned attributes =
            (unsigned)number_whole(triangle + TRIANGLE - 2, NUMBER_UINT16, NUMBER_LITTLE_SWAPPED);
        memcpy(v->normal, at[0], sizeof v->normal);
        if (!has_attributes) read_color(attributes, of_header, v);
        if (!add_triangle((const double(*)[3])at + 1, NULL, v, out)) return false;
        triangle += TRIANGLE + (has_attributes ? attributes : 0);
    }
    out->end = triangle;
    return true;
}

/* Whether the triangles are followed by as many bytes as their counts of attribute bytes say, and these end where the
 * file ends. */
static bool has_attribute_bytes(const char *data, size_t size, size_t count)
{
    size_t at = HEADER, more = 0;
    for (size_t k = 0; k < count; k++, at += TRIANGLE + more) {
        if (size - at < TRIANGLE) return false;
        more = (size_t)number_whole(data + at + TRIANGLE - 2, NUMBER_UINT16, NUMBER_LITTLE_SWAPPED);
        if (size - at - TRIANGLE < more) return false;
    }
    return at == size && size > HEADER + TRIANGLE * count;
}

/* Skips `word` if it is the next word. Returns whether it was. */
static bool take(const char **at, const char *word)
{
    const size_t length = strlen(word);
    *at += strspn(*at, " \t\r\n");
    if (strncasecmp(*at, word, length) != 0 || !strchr(" \t\r\n", (*at)[length])) return false;
    *at += length;
    return true;
}

static bool take_numbers(const char **at, double out[3])
{
    return plain_mesh_number(at, &out[0]) && plain_mesh_number(at, &out[1]) && plain_mesh_number(at, &out[2]);
}

/* Reads what follows "facet". On failure *expected is the expected word that is not at *at. */
static bool read_facet(const char **at, stl_values *v, plain_mesh *out, const char **expected)
{
    double corner[3][3];
    const char *place[3];
    if (!take(at, *expected = "normal") || !(*expected = "a number", take_numbers(at, v->normal)) ||
        !take(at, *expected = "outer") || !take(at, *expected = "loop"))
        return false;
    for (int k = 0; k < 3; k++) {
        if (!take(at, *expected = "vertex")) return false;
        place[k] = *at;
        if (!(*expected = "a number", take_numbers(at, corner[k]))) return false;
    }
    return take(at, *expected = "endloop") && take(at, *expected = "endfacet") &&
           add_triangle((const double(*)[3])corner, place, v, out);
}

static bool read_text(const char *data, size_t size, stl_values *v, plain_mesh *out)
{
    const char *at = data, *expected = "solid";
    for (; take(&at, "solid"); v->group++) {
        at += strcspn(at, "\r\n"); /* skip the name */
        bool good = true;
        while (good && take(&at, "facet")) good = read_facet(&at, v, out, &expected);
        if (!good || !take(&at, expected = "endsolid")) {
            at += strspn(at, " \t\r\n");
            if (!*at && at < data + size && !plain_mesh_text(data, size, out)) return false;
            if (!*at)
                return plain_mesh_refuse_at(
                    out, data, at, "is where the STL file ends, in place of %s. Save it again.", expected);
            return plain_mesh_refuse_at(out, data, at,
                                        "of the STL file has \"%.*s\" in place of %s. Save it again.",
                                        (int)strcspn(at, " \t\r\n"), at, expected);
        }
        at += strcspn(at, "\r\n");
        out->end = at + strspn(at, " \t\r\n");
    }
    return out->end || plain_mesh_refuse_at(out, data, at, "of the STL file is not of a solid");
}

bool plain_mesh_read_stl(const char *data, size_t size, plain_mesh *out)
{
    const char *text = data + strspn(data, " \t\r\n");
    /* the header of a binary file may begin with "solid", too */
    const bool is_text =
        strncasecmp(text, "solid", strlen("solid")) == 0 && (size < HEADER || !memchr(data, 0, HEADER));
    size_t count = 0;
    stl_values v = {.normals = plain_mesh_add_values(out, "normal", MESH_VALUES_NORMAL, 3),
                    .colors = plain_mesh_add_values(out, "color", MESH_VALUES_COLOR, 4),
                    .groups = plain_mesh_add_values(out, "group", MESH_VALUES_WHOLE, 1)};
    if (size >= HEADER) {
        const size_t by_size = (size - HEADER) / TRIANGLE;
        count = (size_t)number_whole(data + COUNT_AT, NUMBER_UINT32, NUMBER_LITTLE_SWAPPED);
        const bool has_attributes = has_attribute_bytes(data, size, count);
        if (size - HEADER == count * TRIANGLE || has_attributes)
            return read_binary(data, count, has_attributes, &v, out);
        if (count == 0 && (size - HEADER) % TRIANGLE == 0) {
            plain_mesh_warn(
                out, "its number of triangles is 0, and its length is that of %zu, which are read", by_size);
            return read_binary(data, by_size, false, &v, out);
        }
        if (!is_text && count > 0 && count * TRIANGLE < size - HEADER)
            return read_binary(data, count, false, &v, out);
    }
    if (is_text) return read_text(text, size - (size_t)(text - data), &v, out);
    return plain_mesh_refuse(
        out, ERROR_INPUT_DAMAGED,
        "the STL file does not begin with \"solid\", and as a binary file of %zu triangles it "
        "has %zu of %llu bytes. Save it again.",
        count, size, (unsigned long long)HEADER + TRIANGLE * (unsigned long long)count);
}
