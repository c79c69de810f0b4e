// SPDX-License-Identifier: Apache-2.0
/* PLY: text and binary of both orders. Vertices come before the faces. A face is one list of indices; other
 * properties of an element are skipped. Triangle strips are faces before this reads them (ply_strips). */
#include <endian.h>
#include <math.h>
#include <string.h>
#include <strings.h>

#include "io/meshes/plain_mesh.h"
#include "io/meshes/ply_header.h"

typedef struct cursor {
    const char *data, *at, *end;
    ply_layout layout;
    const ply_element *element; /* which is read, and its row */
    uint64_t row;
    plain_mesh *out;
} cursor;

/* Refuses the file for what is at the cursor. */
static bool refuse_row(cursor *c, const char *why)
{
    if (c->layout == PLY_TEXT)
        return plain_mesh_refuse_line(c->out, c->data, c->at,
                                      "of the PLY file, row %llu of its element \"%s\", %s. Save it again.",
                                      (unsigned long long)c->row, c->element->name, why);
    return plain_mesh_refuse(c->out, ERROR_INPUT_DAMAGED,
                             "row %llu of the element \"%s\" of the PLY file %s. Save it again.",
                             (unsigned long long)c->row, c->element->name, why);
}

static bool is_line_end(char c)
{
    return c == '\n' || c == '\r' || c == 0;
}

static bool read_number(cursor *c, const ply_type *type, double *out)
{
    static const char early[] = "ends before the values that its header declares";
    if (c->layout == PLY_TEXT)
        return plain_mesh_number(&c->at, out) ||
               refuse_row(c, is_line_end(*c->at) ? early : "has a word in place of a number");
    if ((size_t)(c->end - c->at) < number_bytes(type->number)) return refuse_row(c, early);
    *out = ply_number(c->at, type, c->layout);
    c->at += number_bytes(type->number);
    return true;
}

/* In text a row is a line; lines may be empty. */
static void begin_row(cursor *c)
{
    if (c->layout != PLY_TEXT) return;
    while (*c->at == '\n' || *c->at == '\r' || *c->at == ' ' || *c->at == '\t') c->at++;
}

static bool end_row(cursor *c)
{
    if (c->layout != PLY_TEXT) return true;
    while (*c->at == ' ' || *c->at == '\t') c->at++;
    return is_line_end(*c->at) || refuse_row(c, "has more values than its header declares");
}

/* The numbers of a list. Those of corners of a face, whole and less than the number of vertices, go to
 * out->corner; NULL: they are passed over. */
static bool read_list(cursor *c, const ply_property *p, plain_mesh *out, size_t *count)
{
    double length, number;
    if (!read_number(c, p->length, &length)) return false;
    if (!(length >= 0 && length <= UINT32_MAX && length == floor(length)))
        return refuse_row(c, "has a list whose length is not a number from 0 on");
    *count = (size_t)length;
    for (size_t k = 0; k < *count; k++) {
        if (!read_number(c, p->type, &number)) return false;
        if (!out) continue;
        if (!(number >= 0 && number < (double)out->vertices && number == floor(number)))
            return refuse_row(c, "refers to a vertex that does not exist");
        if (!plain_mesh_expect_corners(out, k + 1)) return false;
        out->corner[k] = (uint32_t)number;
    }
    return true;
}

/* Numbers of the row go to number[slot[k]] when slot[k] >= 0, those of the list `corners` to out->corner. */
static bool read_row(cursor *c, const ply_element *element, const int *slot, double *number,
                     const ply_property *corners, plain_mesh *out, size_t *count)
{
    begin_row(c);
    for (int k = 0; k < element->properties; k++) {
        const ply_property *p = &element->property[k];
        size_t skipped;
        double value;
        if (p->length) {
            if (!read_list(c, p, p == corners ? out : NULL, p == corners ? count : &skipped)) return false;
        } else {
            if (!read_number(c, p->type, &value)) return false;
            if (slot && slot[k] >= 0) number[slot[k]] = value;
        }
    }
    return end_row(c);
}

/* Upper bound on the rows of a binary element, by the bytes left; 0 for text, whose rows have no fixed
 * size. */
static size_t rows_at_most(const cursor *c, const ply_element *element)
{
    const size_t left = (size_t)(c->end - c->at), row = element->row > 0 ? element->row : 1;
    if (c->layout == PLY_TEXT) return 0;
    return element->count < left / row ? element->count : left / row;
}

static bool read_vertices(cursor *c, const ply_element *element, plain_mesh *out)
{
    int slot[PLY_PROPERTIES_MOST], axes = 0;
    for (int k = 0; k < element->properties; k++) {
        const char *name = element->property[k].name;
        const bool is_axis = name[0] >= 'x' && name[0] <= 'z' && !name[1] && !element->property[k].length;
        slot[k] = is_axis ? name[0] - 'x' : -1;
        if (slot[k] >= 0) axes |= 1 << slot[k];
    }
    if ((axes & 3) != 3)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the vertices of the PLY file have no x or no y. Save it with x, y and z.");
    if (!plain_mesh_expect(out, rows_at_most(c, element), 0)) return false;
    for (c->row = 0; c->row < element->count; c->row++) {
        double at[3] = {0, 0, 0};
        if (!read_row(c, element, slot, at, NULL, NULL, NULL) || !plain_mesh_add_vertex(out, at))
            return false;
    }
    return true;
}

/* A row as most files have them: a byte, which says three, and three indices of four bytes of the lower
 * byte first. */
static bool read_triangle(cursor *c, uint32_t corner[3])
{
    enum { ROW = 13 };
    if (c->end - c->at < ROW || *c->at != 3) return false;
    memcpy(corner, c->at + 1, 3 * sizeof *corner);
    for (int k = 0; k < 3; k++) corner[k] = le32toh(corner[k]);
    c->at += ROW;
    return true;
}

static bool read_faces(cursor *c, const ply_element *element, plain_mesh *out)
{
    const ply_property *list = NULL;
    for (int k = 0; k < element->properties; k++)
        if (strcmp(element->property[k].name, "vertex_indices") == 0 ||
            strcmp(element->property[k].name, "vertex_index") == 0)
            list = &element->property[k];
    if (!list || !list->length)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the faces of the PLY file have no list \"vertex_indices\". Save it again.");
    if (!plain_mesh_expect(out, 0, out->triangles + rows_at_most(c, element))) return false;
    const bool common = c->layout == PLY_LITTLE && element->properties == 1 &&
                        number_bytes(list->length->number) == 1 && number_bytes(list->type->number) == 4 &&
                        number_is_whole(list->type->number);
    for (c->row = 0; c->row < element->count; c->row++) {
        uint32_t corner[3];
        size_t count = 0;
        if (common && read_triangle(c, corner)) {
            for (int k = 0; k < 3; k++)
                if (corner[k] >= out->vertices)
                    return refuse_row(c, "refers to a vertex that does not exist");
            if (!plain_mesh_add_polygon(out, corner, 3)) return false;
            continue;
        }
        if (!read_row(c, element, NULL, NULL, list, out, &count) ||
            !plain_mesh_add_polygon(out, out->corner, count))
            return false;
    }
    return true;
}

static bool pass_over(cursor *c, const ply_element *element)
{
    size_t count;
    for (c->row = 0; element->properties > 0 && c->row < element->count; c->row++)
        if (!read_row(c, element, NULL, NULL, NULL, NULL, &count)) return false;
    return true;
}

static bool read_element(cursor *c, const ply_element *element, plain_mesh *out)
{
    c->element = element;
    if (strcmp(element->name, "tristrips") == 0)
        return plain_mesh_refuse(
            out, ERROR_INPUT_UNSUPPORTED,
            "triangle strips of PLY files are read where they are the last element, one list of "
            "32-bit integers, and no element before them has lists. Save it as triangles.");
    if (strcmp(element->name, "vertex") == 0) {
        if (out->vertices == 0) return read_vertices(c, element, out);
        return plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                                 "the PLY file has two elements \"vertex\". Save it with one.");
    }
    if (strcmp(element->name, "face") == 0) return read_faces(c, element, out);
    if (strcmp(element->name, "camera") == 0 && element->count > 0)
        plain_mesh_warn(out, "the file has a camera: vertices are not moved by it");
    return pass_over(c, element);
}

bool plain_mesh_read_ply(const char *data, size_t size, plain_mesh *out)
{
    ply_header h;
    if (!ply_header_read(data, size, &h)) {
        if (size < 3 || strncasecmp(data, "ply", 3) != 0)
            return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                     "the file does not begin with \"ply\", as PLY files do. Check that its "
                                     "ending names its format.");
        return plain_mesh_refuse_line(
            out, data, data + h.fault,
            "of the header of the PLY file is unknown, or where the file ends. Save it again.");
    }
    if (h.layout == PLY_TEXT && !plain_mesh_text(data, size, out)) return false;
    cursor c = {data, data + h.body, data + size, h.layout, NULL, 0, out};
    for (int k = 0; k < h.elements; k++)
        if (!read_element(&c, &h.element[k], out)) return false;
    if (h.layout == PLY_TEXT) c.at += strspn(c.at, " \t\r\n");
    return c.at == c.end || (h.layout == PLY_TEXT && !*c.at) ||
           plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                             "other data follow behind the last row of the PLY file");
}
