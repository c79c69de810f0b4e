// SPDX-License-Identifier: Apache-2.0
/* PLY: text and binary of both orders. Vertices come before the faces. A face is one list of indices; other
 * properties of an element are skipped. Triangle strips are faces before this reads them (ply_strips). */
#include <endian.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "io/meshes/plain_textures.h"
#include "io/meshes/ply_rows.h"

/* Refuses the file for the row that is faulty, unless it is refused already. */
static bool refuse_row(const ply_rows *r, plain_mesh *out)
{
    if (!r->fault) return false;
    out->is_binary = r->layout != PLY_TEXT;
    return plain_mesh_refuse_at(out, r->data, r->at,
                                "of the PLY file, row %llu of its element \"%s\", %s. Save it again.",
                                (unsigned long long)r->row, r->element->name, r->fault);
}

/* The number of rows to reserve memory for: 0 for text, whose rows have no fixed size. */
static size_t expected_rows(const ply_rows *r)
{
    return r->layout == PLY_TEXT ? 0 : ply_rows_at_most(r);
}

/* Texture coordinates of the file, if textures are read. */
typedef struct ply_textures {
    double (*vertex)[2]; /* of the vertices, if these have such properties; or NULL */
    size_t room;
    double (*corner)[2];         /* of the corners of a face */
    size_t corner_room, numbers; /* numbers: of the list "texcoord" of this face */
    size_t unknown;              /* number of faces whose texnumber is too large */
} ply_textures;

/* 0: the property of vertices is u; 1: v; -1: neither. */
static int coordinate_of(const ply_property *p)
{
    static const char *const names[][2] = {
        {"s", "t"}, {"u", "v"}, {"texture_u", "texture_v"}, {"texture_s", "texture_t"}};
    for (size_t k = 0; k < sizeof names / sizeof *names; k++)
        for (int c = 0; c < 2; c++)
            if (!p->length && strcmp(p->name, names[k][c]) == 0) return c;
    return -1;
}

static bool read_vertices(ply_rows *r, ply_textures *t, plain_mesh *out)
{
    const ply_element *element = r->element;
    int slot[PLY_PROPERTIES_MOST], axes = 0, coordinates = 0;
    for (int k = 0; k < element->properties; k++) {
        const char *name = element->property[k].name;
        const bool is_axis = name[0] >= 'x' && name[0] <= 'z' && !name[1] && !element->property[k].length;
        slot[k] = is_axis ? name[0] - 'x' : -1;
        if (slot[k] >= 0) axes |= 1 << slot[k];
        const int c = out->textures ? coordinate_of(&element->property[k]) : -1;
        if (c >= 0) slot[k] = 3 + c;
        if (c >= 0) coordinates |= 1 << c;
    }
    if ((axes & 3) != 3)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the vertices of the PLY file have no x or no y. Save it with x, y and z.");
    if (!plain_mesh_expect(out, expected_rows(r), 0)) return false;
    out->is_binary = r->layout != PLY_TEXT;
    for (; r->row < element->count; r->row++) {
        double at[5] = {0, 0, 0, 0, 0};
        out->vertex_at = r->layout == PLY_TEXT ? r->at + strspn(r->at, " \t\r\n") : r->at;
        if (!ply_rows_read(r, slot, at, NULL, NULL, NULL)) return refuse_row(r, out);
        if (!plain_mesh_add_vertex(out, at)) return false;
        if (coordinates != 3) continue;
        if (!plain_mesh_make_room(out, (void **)&t->vertex, &t->room, out->vertices, sizeof *t->vertex))
            return false;
        memcpy(t->vertex[out->vertices - 1], at + 3, sizeof *t->vertex);
    }
    return true;
}

typedef struct face {
    ply_rows *rows;
    plain_mesh *out; /* out->corner: the corners */
    size_t corners;
    ply_textures *textures;
} face;

static const char no_vertex[] = "refers to a vertex that does not exist";

static bool take_corner(void *context, size_t k, double number)
{
    face *f = context;
    plain_mesh *out = f->out;
    if (!(number >= 0 && number < (double)out->vertices && number == floor(number)))
        return ply_rows_refuse(f->rows, no_vertex);
    if (!plain_mesh_expect_corners(out, k + 1)) return false;
    out->corner[k] = (uint32_t)number;
    f->corners = k + 1;
    return true;
}

/* A row as most files have them: a byte, which says three, and three indices of four bytes of the lower
 * byte first. */
static bool read_triangle(ply_rows *r, uint32_t corner[3])
{
    enum { ROW = 13 };
    if (r->end - r->at < ROW || *r->at != 3) return false;
    memcpy(corner, r->at + 1, 3 * sizeof *corner);
    for (int k = 0; k < 3; k++) corner[k] = le32toh(corner[k]);
    r->at += ROW;
    return true;
}

static bool are_vertices(const uint32_t corner[3], face *f)
{
    const size_t count = f->out->vertices;
    return (corner[0] < count && corner[1] < count && corner[2] < count) ||
           ply_rows_refuse(f->rows, no_vertex);
}

static bool read_polygon(const ply_property *list, face *f)
{
    f->corners = 0;
    return ply_rows_read(f->rows, NULL, NULL, list, take_corner, f);
}

static bool take_coordinate(void *context, size_t k, double number)
{
    face *f = context;
    if (!plain_mesh_make_room(f->out, (void **)&f->textures->corner, &f->textures->corner_room, k / 2 + 1,
                              sizeof *f->textures->corner))
        return false;
    f->textures->corner[k / 2][k % 2] = number;
    f->textures->numbers = k + 1;
    return true;
}

/* Reads the texture coordinates and the number of the image of a face, whose row begins at `row` and has been read:
 * those of the list "texcoord", or of the vertices. */
static bool read_face_textures(face *f, const uint32_t *corner, const char *row)
{
    const ply_element *element = f->rows->element;
    const ply_property *list = NULL;
    ply_textures *t = f->textures;
    const char *end = f->rows->at;
    int slot[PLY_PROPERTIES_MOST];
    double number[1] = {0};
    for (int k = 0; k < element->properties; k++) {
        const ply_property *p = &element->property[k];
        if (p->length && strcmp(p->name, "texcoord") == 0) list = p;
        slot[k] = !p->length && strcmp(p->name, "texnumber") == 0 ? 0 : -1;
    }
    t->numbers = 0;
    f->rows->at = row;
    if (!ply_rows_read(f->rows, slot, number, list, list ? take_coordinate : NULL, f))
        return refuse_row(f->rows, f->out);
    f->rows->at = end;
    const bool has_own = t->numbers > 0 && t->numbers == 2 * f->corners, of_vertices = !has_own && t->vertex;
    if (of_vertices &&
        !plain_mesh_make_room(f->out, (void **)&t->corner, &t->corner_room, f->corners, sizeof *t->corner))
        return false;
    for (size_t k = 0; of_vertices && k < f->corners; k++)
        memcpy(t->corner[k], t->vertex[corner[k]], sizeof *t->corner);
    const bool is_known = number[0] >= 0 && number[0] < (double)f->out->textures->all.materials;
    t->unknown += !(is_known || number[0] < 0);
    return plain_textures_add_polygon(f->out, is_known ? (uint32_t)number[0] : MESH_TEXTURES_NONE,
                                      has_own || of_vertices ? (const double(*)[2])t->corner : NULL, NULL,
                                      f->corners);
}

static bool read_faces(ply_rows *r, ply_textures *t, plain_mesh *out)
{
    const ply_element *element = r->element;
    const ply_property *list = NULL;
    for (int k = 0; k < element->properties; k++)
        if (strcmp(element->property[k].name, "vertex_indices") == 0 ||
            strcmp(element->property[k].name, "vertex_index") == 0)
            list = &element->property[k];
    if (!list || !list->length)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the faces of the PLY file have no list \"vertex_indices\". Save it again.");
    if (!plain_mesh_expect(out, 0, out->triangles + expected_rows(r))) return false;
    const bool common = r->layout == PLY_LITTLE && element->properties == 1 &&
                        number_bytes(list->length->number) == 1 && number_bytes(list->type->number) == 4 &&
                        number_is_whole(list->type->number);
    for (; r->row < element->count; r->row++) {
        const char *row = r->at;
        face f = {r, out, 3, t};
        uint32_t triangle[3];
        const bool is_triangle = common && read_triangle(r, triangle);
        if (is_triangle ? !are_vertices(triangle, &f) : !read_polygon(list, &f)) return refuse_row(r, out);
        const uint32_t *corner = is_triangle ? triangle : out->corner;
        if (!plain_mesh_add_polygon(out, corner, f.corners)) return false;
        if (out->textures && !read_face_textures(&f, corner, row)) return false;
    }
    return true;
}

static bool pass_over(ply_rows *r, plain_mesh *out)
{
    for (; r->element->properties > 0 && r->row < r->element->count; r->row++)
        if (!ply_rows_read(r, NULL, NULL, NULL, NULL, NULL)) return refuse_row(r, out);
    return true;
}

static bool read_element(ply_rows *r, const ply_element *element, ply_textures *t, plain_mesh *out)
{
    ply_rows_enter(r, element);
    if (strcmp(element->name, "tristrips") == 0)
        return plain_mesh_refuse(
            out, ERROR_INPUT_UNSUPPORTED,
            "triangle strips of PLY files are read where they are the last element, one list of "
            "32-bit integers, and no element before them has lists. Save it as triangles.");
    if (strcmp(element->name, "vertex") == 0) {
        if (out->vertices == 0) return read_vertices(r, t, out);
        return plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                                 "the PLY file has two elements \"vertex\". Save it with one.");
    }
    if (strcmp(element->name, "face") == 0) {
        if (element->count > 0 && out->vertices == 0)
            return plain_mesh_refuse(
                out, ERROR_INPUT_UNSUPPORTED,
                "the PLY file has its element \"face\" before its element \"vertex\". Save it with "
                "the vertices first.");
        return read_faces(r, t, out);
    }
    if (strcmp(element->name, "camera") == 0 && element->count > 0)
        plain_mesh_warn(out, "the file has a camera: vertices are not moved by it");
    return pass_over(r, out);
}

static bool is_blank(char c)
{
    return c == ' ' || c == '\t';
}

/* Adds a material for each comment "TextureFile NAME" of the header. Blanks around the name do not belong to it. */
static bool read_comments(const char *data, size_t body, plain_mesh *out)
{
    static const char mark[] = "comment TextureFile";
    for (const char *at = data; at < data + body;) {
        const size_t length = strcspn(at, "\r\n");
        if (length > strlen(mark) && strncmp(at, mark, strlen(mark)) == 0 && is_blank(at[strlen(mark)])) {
            const char *name = at + strlen(mark), *end = at + length;
            while (name < end && is_blank(*name)) name++;
            while (end > name && is_blank(end[-1])) end--;
            char *copy = strndup(name, (size_t)(end - name));
            mesh_material m = mesh_textures_white();
            uint32_t unused;
            if (!copy) return plain_mesh_refuse_memory(out);
            const bool ok = plain_textures_add_image(out, copy, NULL, 0, &m.image) &&
                            plain_textures_add_material(out, &m, &unused);
            free(copy);
            if (!ok) return false;
        }
        at += length + 1;
    }
    return true;
}

bool plain_mesh_read_ply(const char *data, size_t size, plain_mesh *out)
{
    ply_header h;
    if (!ply_header_read(data, size, &h)) {
        if (size < 3 || strncasecmp(data, "ply", 3) != 0)
            return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                     "the file does not begin with \"ply\", as PLY files do. Check that its "
                                     "ending names its format.");
        return plain_mesh_refuse_at(
            out, data, data + h.fault,
            "of the header of the PLY file is unknown, is there twice, or is where the file ends. Save it again.");
    }
    if (h.layout == PLY_TEXT && !plain_mesh_text(data, size, out)) return false;
    ply_rows r = ply_rows_begin(&h, data, size);
    ply_textures t = {0};
    bool ok = !out->textures || read_comments(data, h.body, out);
    for (int k = 0; ok && k < h.elements; k++) ok = read_element(&r, &h.element[k], &t, out);
    free(t.vertex);
    free(t.corner);
    if (!ok) return false;
    if (t.unknown > 0 && out->textures->all.materials > 0)
        plain_textures_warn(
            out, "%zu faces have a texnumber for which there is no TextureFile: they are white", t.unknown);
    if (h.layout == PLY_TEXT) r.at += strspn(r.at, " \t\r\n");
    return r.at == r.end || (h.layout == PLY_TEXT && !*r.at) ||
           plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                             "other data follow behind the last row of the PLY file");
}
