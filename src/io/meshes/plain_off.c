// SPDX-License-Identifier: Apache-2.0
/* OFF: text and binary, with the prefixes ST, C, N and 4 for further numbers of vertices: normals, colours and
 * texture coordinates, in this order, which are values. In text, a vertex and a face have one line each, and a colour
 * has three or four numbers; what follows the numbers that are read, such as colours of faces, is skipped. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/number.h"
#include "io/meshes/plain_mesh.h"

/* Bytes of a number of a binary file. */
enum { NUMBER_SIZE = 4 };

typedef struct off {
    const char *at, *end;
    bool is_binary, has_w;
    size_t of_normal, of_color, of_uv; /* numbers of a vertex after its position; of_color: at most */
    plain_values *normals, *colors, *uvs;
} off;

/* Text: skips blanks, line breaks and comments up to the next number. */
static void skip_to_number(off *o)
{
    while ((o->at += strspn(o->at, " \t\r\n"), *o->at == '#')) o->at += strcspn(o->at, "\n");
}

static bool read_integer(off *o, long long *out)
{
    if (o->is_binary) {
        if (o->end - o->at < NUMBER_SIZE) return false;
        *out = number_whole(o->at, NUMBER_INT32, NUMBER_BIG_SWAPPED);
        o->at += NUMBER_SIZE;
        return true;
    }
    skip_to_number(o);
    char *end;
    *out = strtoll(o->at, &end, 10);
    if (end == o->at || !(strchr(" \t\r\n#", *end) || !*end)) return false;
    o->at = end;
    return true;
}

static bool read_number(off *o, double *out)
{
    if (o->is_binary) {
        if (o->end - o->at < NUMBER_SIZE) return false;
        *out = number_value(o->at, NUMBER_FLOAT, NUMBER_BIG_SWAPPED);
        o->at += NUMBER_SIZE;
        return true;
    }
    skip_to_number(o);
    return plain_mesh_number(&o->at, out);
}

static bool skip_bytes(off *o, size_t count)
{
    if ((size_t)(o->end - o->at) < count) return false;
    o->at += count;
    return true;
}

static bool end_row(off *o, size_t binary_bytes)
{
    if (o->is_binary) return skip_bytes(o, binary_bytes);
    o->at += strcspn(o->at, "\n");
    return true;
}

/* Reads the values of the last vertex. */
static bool read_values(off *o, plain_mesh *out)
{
    double number[9];
    const size_t most = o->of_normal + o->of_color + o->of_uv, n = out->vertices - 1;
    size_t count = 0;
    while (count < most &&
           (o->is_binary ? read_number(o, &number[count]) : plain_mesh_number(&o->at, &number[count])))
        count++;
    double *color = number + o->of_normal, *uv = number + count - (count < o->of_uv ? count : o->of_uv);
    if (count + (o->of_color && !o->is_binary ? 1 : 0) < most) return false;
    if (uv - color == 3) {
        const double opaque[4] = {color[0], color[1], color[2], (double)NAN};
        if (!plain_mesh_set_values(out, o->colors, n, opaque)) return false;
    } else if (o->of_color && !plain_mesh_set_values(out, o->colors, n, color)) {
        return false;
    }
    return (!o->of_normal || plain_mesh_set_values(out, o->normals, n, number)) &&
           (!o->of_uv || plain_mesh_set_values(out, o->uvs, n, uv));
}

static bool read_vertex(off *o, plain_mesh *out)
{
    double at[4] = {0, 0, 0, 1};
    for (int k = 0; k < (o->has_w ? 4 : 3); k++)
        if (!read_number(o, &at[k])) return false;
    for (int k = 0; k < 3; k++) at[k] /= at[3];
    out->vertex_at = o->at;
    const size_t more = out->keeps_values ? 0 : o->of_normal + o->of_color + o->of_uv;
    return plain_mesh_add_vertex(out, at) && (!out->keeps_values || read_values(o, out)) &&
           end_row(o, more * sizeof(float));
}

static bool read_face(off *o, plain_mesh *out)
{
    long long count, index, colors = 0;
    if (!read_integer(o, &count) || count < 0) return false;
    for (long long k = 0; k < count; k++) {
        if (!read_integer(o, &index) || index < 0 || index >= (long long)out->vertices ||
            !plain_mesh_expect_corners(out, (size_t)k + 1))
            return false;
        out->corner[k] = (uint32_t)index;
    }
    if (o->is_binary && (!read_integer(o, &colors) || colors < 0 || colors > 4)) return false;
    return end_row(o, (size_t)colors * sizeof(float)) &&
           plain_mesh_add_polygon(out, out->corner, (size_t)count);
}

static bool take(const char **at, const char *word)
{
    const size_t length = strlen(word);
    if (strncmp(*at, word, length) != 0) return false;
    *at += length;
    return true;
}

/* Reads the first word, and the number of dimensions of an nOFF file. */
static bool read_head(off *o, plain_mesh *out)
{
    long long dimensions;
    skip_to_number(o);
    if (take(&o->at, "ST")) o->of_uv = 2;
    if (take(&o->at, "C")) o->of_color = 4;
    if (take(&o->at, "N")) o->of_normal = 3;
    o->has_w = take(&o->at, "4");
    const bool has_dimensions = take(&o->at, "n");
    if (!take(&o->at, "OFF")) return false;
    const char *word = o->at + strspn(o->at, " \t");
    if (take(&word, "BINARY")) {
        o->is_binary = true;
        word += strcspn(word, "\n");
        if (*word != '\n') return false;
        o->at = word + 1;
    }
    if (!has_dimensions) return true;
    if (!read_integer(o, &dimensions)) return false;
    return dimensions == 3 ||
           plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                             "its vertices have %lld coordinates. Save it with three.", dimensions);
}

/* Refuses the file at the current place, unless it is refused already. */
static bool refuse(const off *o, const char *data, const char *what, long long number, plain_mesh *out)
{
    char text[100];
    snprintf(text, sizeof text, number < 0 ? "the %s of the OFF file" : "%s %lld of the OFF file", what,
             number);
    out->is_binary = o->is_binary;
    return plain_mesh_refuse_at(out, data, o->at,
                                "(%s) is damaged, or is not what the header declares. Save it again.", text);
}

bool plain_mesh_read_off(const char *data, size_t size, plain_mesh *out)
{
    off o = {.at = data,
             .end = data + size,
             .colors = plain_mesh_add_values(out, "color", MESH_VALUES_COLOR, 4),
             .uvs = plain_mesh_add_values(out, "uv", MESH_VALUES_UV, 2),
             .normals = plain_mesh_add_values(out, "normal", MESH_VALUES_NORMAL, 3)};
    long long vertices, faces, edges;
    if (!read_head(&o, out) || !read_integer(&o, &vertices) || !read_integer(&o, &faces) || vertices < 0 ||
        faces < 0 || (o.is_binary && !read_integer(&o, &edges)))
        return refuse(&o, data, "header", -1, out);
    /* skip the number of edges, which many files lack */
    if (!o.is_binary) o.at += strcspn(o.at, "\n");
    for (long long k = 0; k < vertices; k++)
        if (!read_vertex(&o, out)) return refuse(&o, data, "vertex", k, out);
    for (long long k = 0; k < faces; k++)
        if (!read_face(&o, out)) return refuse(&o, data, "face", k, out);
    if (!o.is_binary) skip_to_number(&o);
    out->end = o.at;
    return plain_mesh_scale_colors(out, o.colors, 0, "text");
}
