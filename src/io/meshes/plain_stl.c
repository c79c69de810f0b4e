// SPDX-License-Identifier: Apache-2.0
/* STL: binary if the size is that which follows from its count of triangles, with or without attribute bytes behind
 * each; otherwise text, with one or more solids. */
#include <string.h>
#include <strings.h>

#include "io/meshes/content_end.h"
#include "io/meshes/plain_mesh.h"

enum { HEADER = 84, COUNT_AT = 80, TRIANGLE = 50, CORNERS_AT = 12 };

static uint32_t read_little(const unsigned char *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* `place`: of the corners in a text; or NULL. */
static bool add_triangle(const double at[3][3], const char *const place[3], plain_mesh *out)
{
    const uint32_t first = (uint32_t)out->vertices, corner[3] = {first, first + 1, first + 2};
    for (int k = 0; k < 3; k++) {
        out->vertex_at = place ? place[k] : NULL;
        if (!plain_mesh_add_vertex(out, at[k])) return false;
    }
    return plain_mesh_add_polygon(out, corner, 3);
}

/* `has_attributes`: each triangle is followed by as many bytes as its last field says. */
static bool read_binary(const unsigned char *data, size_t count, bool has_attributes, plain_mesh *out)
{
    const unsigned char *triangle = data + HEADER;
    for (size_t n = 0; n < count; n++) {
        const unsigned char *from = triangle + CORNERS_AT;
        double at[3][3];
        for (int k = 0; k < 9; k++, from += 4) {
            const uint32_t bits = read_little(from);
            float value;
            memcpy(&value, &bits, sizeof value);
            at[k / 3][k % 3] = (double)value;
        }
        if (!add_triangle((const double(*)[3])at, NULL, out)) return false;
        triangle += TRIANGLE;
        if (has_attributes) triangle += triangle[-2] | triangle[-1] << 8;
    }
    return true;
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
static bool read_facet(const char **at, plain_mesh *out, const char **expected)
{
    double normal[3], corner[3][3];
    const char *place[3];
    if (!take(at, *expected = "normal") || !(*expected = "a number", take_numbers(at, normal)) ||
        !take(at, *expected = "outer") || !take(at, *expected = "loop"))
        return false;
    for (int k = 0; k < 3; k++) {
        if (!take(at, *expected = "vertex")) return false;
        place[k] = *at;
        if (!(*expected = "a number", take_numbers(at, corner[k]))) return false;
    }
    return take(at, *expected = "endloop") && take(at, *expected = "endfacet") &&
           add_triangle((const double(*)[3])corner, place, out);
}

static bool read_text(const char *data, plain_mesh *out)
{
    const char *at = data, *expected = "solid";
    while (take(&at, "solid")) {
        at += strcspn(at, "\r\n"); /* skip the name */
        bool good = true;
        while (good && take(&at, "facet")) good = read_facet(&at, out, &expected);
        if (!good || !take(&at, expected = "endsolid")) {
            at += strspn(at, " \t\r\n");
            if (!*at)
                return plain_mesh_refuse_at(
                    out, data, at, "is where the STL file ends, in place of %s. Save it again.", expected);
            return plain_mesh_refuse_at(out, data, at,
                                        "of the STL file has \"%.*s\" in place of %s. Save it again.",
                                        (int)strcspn(at, " \t\r\n"), at, expected);
        }
        at += strcspn(at, "\r\n");
    }
    return at[strspn(at, " \t\r\n")] == 0 ||
           plain_mesh_refuse_at(out, data, at, "of the STL file is not of a solid");
}

bool plain_mesh_read_stl(const char *data, size_t size, plain_mesh *out)
{
    const unsigned char *bytes = (const unsigned char *)data;
    if (size >= HEADER) {
        const size_t count = read_little(bytes + COUNT_AT), by_size = (size - HEADER) / TRIANGLE;
        if (size - HEADER == count * TRIANGLE) return read_binary(bytes, count, false, out);
        if (content_has_stl_attributes(data, size)) return read_binary(bytes, count, true, out);
        if (count == 0 && (size - HEADER) % TRIANGLE == 0) {
            plain_mesh_warn(
                out, "its number of triangles is 0, and its length is that of %zu, which are read", by_size);
            return read_binary(bytes, by_size, false, out);
        }
    }
    const char *text = plain_mesh_text(data, size, out);
    if (text && strncasecmp(text + strspn(text, " \t\r\n"), "solid", strlen("solid")) == 0)
        return read_text(text, out);
    out->refused = ERROR_NONE;
    const unsigned long count = size < HEADER ? 0 : read_little(bytes + COUNT_AT);
    return plain_mesh_refuse(
        out, ERROR_INPUT_DAMAGED,
        "the STL file does not begin with \"solid\", and as a binary file of %lu triangles it "
        "has %zu of %llu bytes. Save it again.",
        count, size, (unsigned long long)HEADER + TRIANGLE * (unsigned long long)count);
}
