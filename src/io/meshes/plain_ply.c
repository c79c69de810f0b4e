// SPDX-License-Identifier: Apache-2.0
/* PLY: text and binary of both orders. Vertices come before the faces. A face is one list of indices, and "tristrips"
 * have lists of strips. Values: colours, texture coordinates, normals, and by their names the other properties of the
 * vertices that are numbers. */
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
    if (!out->is_binary && !plain_mesh_text(r->data, (size_t)(r->end - r->data), out)) return false;
    return plain_mesh_refuse_at(out, r->data, r->at,
                                "of the PLY file, row %llu of its element \"%s\", %s. Save it again.",
                                (unsigned long long)r->row, r->element->name, r->fault);
}

/* The number of rows to reserve memory for: 0 for text, whose rows have no fixed size. */
static size_t expected_rows(const ply_rows *r)
{
    return r->layout == PLY_TEXT ? 0 : ply_rows_at_most(r);
}

/* Texture coordinates of the faces, if values are kept. */
typedef struct ply_textures {
    size_t vertices;      /* of the element "vertex" */
    double (*corner)[2];  /* of the corners of a face */
    size_t room, numbers; /* numbers: of the list "texcoord" of this face */
    size_t unknown;       /* number of faces whose texnumber is too large */
} ply_textures;

/* ---- values of the vertices */

/* Properties that are an array of their own, if an element has those that are required. */
typedef struct ply_set {
    const char *name;
    mesh_values_kind kind;
    int components, required;
    const char *property[MESH_VALUES_COMPONENTS];
} ply_set;

static const ply_set sets[] = {{"color", MESH_VALUES_COLOR, 4, 3, {"red", "green", "blue", "alpha"}},
                               {"color", MESH_VALUES_COLOR, 4, 3, {"r", "g", "b", "a"}},
                               {"uv", MESH_VALUES_UV, 2, 2, {"s", "t"}},
                               {"uv", MESH_VALUES_UV, 2, 2, {"u", "v"}},
                               {"uv", MESH_VALUES_UV, 2, 2, {"texture_u", "texture_v"}},
                               {"uv", MESH_VALUES_UV, 2, 2, {"texture_s", "texture_t"}},
                               {"normal", MESH_VALUES_NORMAL, 3, 3, {"nx", "ny", "nz"}}};

/* The index of a number of the element by its name, or -1. */
static int find_property(const ply_element *element, const char *name)
{
    for (int k = 0; k < element->properties; k++)
        if (!element->property[k].length && strcmp(element->property[k].name, name) == 0) return k;
    return -1;
}

/* The axis of a coordinate of a position; -1: the property is none. */
static int axis_of(const ply_property *p)
{
    return p->name[0] >= 'x' && p->name[0] <= 'z' && !p->name[1] && !p->length ? p->name[0] - 'x' : -1;
}

/* An array, and the index of its first number among those of a row. */
typedef struct ply_array {
    plain_values *values;
    int first;
} ply_array;

typedef struct ply_arrays {
    ply_array list[MESH_VALUES_MOST];
    int count, numbers; /* arrays; numbers of a row */
    int slot[PLY_PROPERTIES_MOST];
    const ply_type *of_colors; /* NULL: there are none */
} ply_arrays;

static bool has_array(const ply_arrays *a, const char *name)
{
    for (int k = 0; k < a->count; k++)
        if (strcmp(a->list[k].values->head.name, name) == 0) return true;
    return false;
}

static void add_array(const char *name, mesh_values_kind kind, int components, ply_arrays *a, plain_mesh *out)
{
    plain_values *values = plain_mesh_add_values(out, name, kind, (size_t)components);
    if (!values) return;
    a->list[a->count++] = (ply_array){values, a->numbers};
    a->numbers += components;
}

/* Adds the array of a set that the element has, unless a property has its name. */
static void add_set(const ply_element *element, const ply_set *set, ply_arrays *a, plain_mesh *out)
{
    int has = 0, property[MESH_VALUES_COMPONENTS];
    for (int c = 0; c < set->components; c++) {
        property[c] = find_property(element, set->property[c]);
        has += c < set->required && property[c] >= 0;
    }
    if (has < set->required || has_array(a, set->name) || find_property(element, set->name) >= 0) return;
    const int first = a->numbers;
    add_array(set->name, set->kind, set->components, a, out);
    for (int c = 0; c < set->components && a->numbers > first; c++)
        if (property[c] >= 0) a->slot[property[c]] = first + c;
    if (set->kind == MESH_VALUES_COLOR) a->of_colors = element->property[property[0]].type;
}

/* Chooses the arrays of the element: sets, and the other properties but the position. */
static void choose_arrays(const ply_element *element, ply_arrays *a, plain_mesh *out)
{
    for (int k = 0; k < element->properties; k++) a->slot[k] = -1;
    for (size_t k = 0; k < sizeof sets / sizeof *sets; k++) add_set(element, &sets[k], a, out);
    for (int k = 0; k < element->properties && !out->textures; k++) {
        const ply_property *p = &element->property[k];
        const int first = a->numbers;
        if (p->length || axis_of(p) >= 0 || a->slot[k] >= 0) continue;
        add_array(p->name, MESH_VALUES_NUMBER, 1, a, out);
        if (a->numbers > first) a->slot[k] = first;
    }
}

static bool scale_colors(const ply_type *type, plain_values *v, plain_mesh *out)
{
    const double full = type->number == NUMBER_UINT16   ? UINT16_MAX
                        : number_is_whole(type->number) ? UINT8_MAX
                                                        : 0;
    return plain_mesh_scale_colors(out, v, full, type->name);
}

/* Reads the values of the vertices, from the first row of the element. */
static bool read_values(ply_rows r, plain_mesh *out)
{
    ply_arrays a = {.count = 0};
    double number[PLY_PROPERTIES_MOST + MESH_VALUES_COMPONENTS];
    choose_arrays(r.element, &a, out);
    for (int k = 0; k < a.numbers; k++) number[k] = (double)NAN;
    for (r.row = 0; a.count > 0 && r.row < r.element->count; r.row++) {
        if (!ply_rows_read(&r, a.slot, number, NULL, NULL, NULL)) return refuse_row(&r, out);
        for (int k = 0; k < a.count; k++)
            if (!plain_mesh_set_values(out, a.list[k].values, r.row, number + a.list[k].first)) return false;
    }
    for (int k = 0; k < a.count; k++)
        if (a.of_colors && a.list[k].values->head.kind == MESH_VALUES_COLOR &&
            !scale_colors(a.of_colors, a.list[k].values, out))
            return false;
    return true;
}

/* ---- elements */

static bool read_vertices(ply_rows *r, ply_textures *t, plain_mesh *out)
{
    const ply_element *element = r->element;
    int slot[PLY_PROPERTIES_MOST];
    for (int k = 0; k < element->properties; k++) slot[k] = axis_of(&element->property[k]);
    if (find_property(element, "x") < 0 || find_property(element, "y") < 0)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the vertices of the PLY file have no x or no y. Save it with x, y and z.");
    if (!plain_mesh_expect(out, expected_rows(r), 0)) return false;
    out->is_binary = r->layout != PLY_TEXT;
    const ply_rows first = *r;
    for (; r->row < element->count; r->row++) {
        double at[3] = {0, 0, 0};
        out->vertex_at = r->layout == PLY_TEXT ? r->at + strspn(r->at, " \t\r\n") : r->at;
        if (!ply_rows_read(r, slot, at, NULL, NULL, NULL)) return refuse_row(r, out);
        if (!plain_mesh_add_vertex(out, at)) return false;
    }
    t->vertices = out->vertices;
    return !out->keeps_values || read_values(first, out);
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
    if (!(number >= 0 && number < (double)f->textures->vertices && number == floor(number)))
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
    const size_t count = f->textures->vertices;
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
    if (!plain_mesh_make_room(f->out, (void **)&f->textures->corner, &f->textures->room, k / 2 + 1,
                              sizeof *f->textures->corner))
        return false;
    f->textures->corner[k / 2][k % 2] = number;
    f->textures->numbers = k + 1;
    return true;
}

/* Reads the list "texcoord" and the number of the image of a face, whose row begins at `row` and has been read. */
static bool read_face_textures(face *f, const char *row, double *texnumber)
{
    const ply_element *element = f->rows->element;
    const ply_property *list = NULL;
    const char *end = f->rows->at;
    int slot[PLY_PROPERTIES_MOST];
    for (int k = 0; k < element->properties; k++) {
        const ply_property *p = &element->property[k];
        if (p->length && strcmp(p->name, "texcoord") == 0) list = p;
        slot[k] = !p->length && strcmp(p->name, "texnumber") == 0 ? 0 : -1;
    }
    f->textures->numbers = 0;
    f->rows->at = row;
    if (!ply_rows_read(f->rows, slot, texnumber, list, list ? take_coordinate : NULL, f))
        return refuse_row(f->rows, f->out);
    f->rows->at = end;
    return true;
}

/* Makes the corners of a face vertices of their own, if the face has texture coordinates or textures are read. */
static bool split_corners(face *f, const char *row)
{
    plain_mesh *out = f->out;
    ply_textures *t = f->textures;
    double texnumber = 0, material = -1;
    if (!read_face_textures(f, row, &texnumber)) return false;
    const bool has_own = t->numbers > 0 && t->numbers == 2 * f->corners;
    if (!has_own && !out->textures) return true;
    if (out->textures && texnumber >= 0 && texnumber < (double)out->textures->all.materials)
        material = floor(texnumber);
    t->unknown += out->textures && material < 0 && !(texnumber < 0);
    plain_values *uvs = has_own ? plain_mesh_find_values(out, MESH_TEXTURES_UV, MESH_VALUES_UV, 2) : NULL,
                 *materials = out->textures
                                  ? plain_mesh_find_values(out, MESH_TEXTURES_MATERIAL, MESH_VALUES_WHOLE, 1)
                                  : NULL;
    for (size_t k = 0; k < f->corners; k++) {
        const size_t n = out->vertices;
        if (!plain_mesh_copy_vertex(out, out->corner[k]) ||
            (has_own && !plain_mesh_set_values(out, uvs, n, t->corner[k])) ||
            !plain_mesh_set_values(out, materials, n, &material))
            return false;
        out->corner[k] = (uint32_t)n;
    }
    return true;
}

static bool read_faces(ply_rows *r, ply_textures *t, plain_mesh *out)
{
    const ply_element *element = r->element;
    const ply_property *list = NULL;
    bool may_split = out->textures != NULL;
    for (int k = 0; k < element->properties; k++) {
        if (strcmp(element->property[k].name, "vertex_indices") == 0 ||
            strcmp(element->property[k].name, "vertex_index") == 0)
            list = &element->property[k];
        may_split |= out->keeps_values && strcmp(element->property[k].name, "texcoord") == 0;
    }
    if (!list || !list->length)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the faces of the PLY file have no list \"vertex_indices\". Save it again.");
    if (!plain_mesh_expect(out, 0, out->triangles + expected_rows(r))) return false;
    const bool common = !may_split && r->layout == PLY_LITTLE && element->properties == 1 &&
                        number_bytes(list->length->number) == 1 && number_bytes(list->type->number) == 4 &&
                        number_is_whole(list->type->number);
    for (; r->row < element->count; r->row++) {
        const char *row = r->at;
        face f = {r, out, 3, t};
        uint32_t triangle[3];
        const bool is_triangle = common && read_triangle(r, triangle);
        if (is_triangle ? !are_vertices(triangle, &f) : !read_polygon(list, &f)) return refuse_row(r, out);
        if (may_split && !split_corners(&f, row)) return false;
        if (!plain_mesh_add_polygon(out, is_triangle ? triangle : out->corner, f.corners)) return false;
    }
    return true;
}

/* The strip that is being read: its last vertices, and the number of vertices that follow one another. */
typedef struct strip {
    face of;
    uint32_t v[3];
    size_t length;
} strip;

/* Takes a vertex of strips; -1, also as an integer without a sign, ends a strip. Every second triangle is turned. */
static bool take_vertex(void *context, size_t k, double number)
{
    strip *s = context;
    if (k == 0 || number == -1 || number == UINT32_MAX) s->length = 0;
    if (number == -1 || number == UINT32_MAX) return true;
    if (!(number >= 0 && number < (double)s->of.textures->vertices && number == floor(number)))
        return ply_rows_refuse(s->of.rows, no_vertex);
    s->v[0] = s->v[1];
    s->v[1] = s->v[2];
    s->v[2] = (uint32_t)number;
    if (++s->length < 3) return true;
    const uint32_t turned[3] = {s->v[1], s->v[0], s->v[2]};
    return plain_mesh_add_polygon(s->of.out, s->length % 2 ? s->v : turned, 3);
}

/* Reads rows of triangle strips, each in its first list. */
static bool read_strips(ply_rows *r, ply_textures *t, plain_mesh *out)
{
    const ply_element *element = r->element;
    strip s = {.of = {r, out, 0, t}};
    int k = 0;
    while (k < element->properties && !element->property[k].length) k++;
    if (k == element->properties)
        return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED,
                                 "the triangle strips of the PLY file are no lists. Save it with faces.");
    for (; r->row < element->count; r->row++)
        if (!ply_rows_read(r, NULL, NULL, &element->property[k], take_vertex, &s)) return refuse_row(r, out);
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
    if (strcmp(element->name, "vertex") == 0) {
        if (out->vertices == 0) return read_vertices(r, t, out);
        return plain_mesh_refuse(out, ERROR_INPUT_UNSUPPORTED,
                                 "the PLY file has two elements \"vertex\". Save it with one.");
    }
    const bool has_strips = strcmp(element->name, "tristrips") == 0;
    if (has_strips || strcmp(element->name, "face") == 0) {
        if (element->count > 0 && out->vertices == 0)
            return plain_mesh_refuse(
                out, ERROR_INPUT_UNSUPPORTED,
                "the PLY file has its element \"%s\" before its element \"vertex\". Save it with "
                "the vertices first.",
                element->name);
        return has_strips ? read_strips(r, t, out) : read_faces(r, t, out);
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
    ply_rows r = ply_rows_begin(&h, data, size);
    ply_textures t = {0};
    bool ok = !out->textures || read_comments(data, h.body, out);
    for (int k = 0; ok && k < h.elements; k++) ok = read_element(&r, &h.element[k], &t, out);
    free(t.corner);
    if (!ok) return false;
    if (t.unknown > 0 && out->textures->all.materials > 0)
        plain_textures_warn(
            out, "%zu faces have a texnumber for which there is no TextureFile: they are white", t.unknown);
    if (h.layout == PLY_TEXT) r.at += strspn(r.at, " \t\r\n");
    out->end = r.at;
    return true;
}
