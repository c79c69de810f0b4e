// SPDX-License-Identifier: Apache-2.0
/* 3MF: the items of the build with their transforms, in doubles and millimetres. Meshes, components and parts
 * of other model files in the package (the production extension) are read. Values: colours of base materials and of
 * groups, texture coordinates, the index of the first corner in its resource (material), and the number of the placed
 * object (group). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/xml/xml.h"
#include "geometry/space/affine.h"
#include "io/meshes/plain_textures.h"
#include "io/meshes/zip_entry.h"

enum { DEEPEST_COMPONENT = 200, PARTS_MOST = 4096, PATH_MOST = 256, NUMBERS_OF_TRANSFORM = 12 };

/* Maximum number of placed objects. Components that double at each of n levels place 2^n objects, which may
 * be empty. */
enum { PLACED_MOST = 1000000 };

/* A component of an object, or an item of the build. */
typedef struct reference {
    char *path, *id; /* path NULL: in the same part. id NULL: none is given */
    double transform[16];
} reference;

/* A growing array. */
typedef struct list {
    void *items;
    size_t count, room;
} list;

/* An object. Its vertices, triangles and components are ranges of the package's lists. */
typedef struct object {
    size_t part;
    /* index of the first one, and of the last one plus 1 */
    size_t vertex[2], triangle[2], component[2];
    bool is_built;
} object;

/* An entry of a hash table with open addressing that maps a word within the part `of` to a number. */
typedef struct named {
    size_t of, number;
    char *word; /* owned; NULL: the entry is free */
} named;

typedef struct name_table {
    named *place;
    size_t count, size; /* size: 0, or a power of 2 greater than twice the count */
} name_table;

/* What the attributes pid and p1, p2, p3 of a triangle, or pid and pindex of an object, name: a resource of the part
 * and indices in it. A triangle without one of the two has that of its object. */
typedef struct property {
    char *resource; /* owned; NULL: none */
    bool has_index; /* otherwise the indices are 0 */
    uint32_t index[3];
} property;

/* A resource that triangles can name: rows with a colour each, or with coordinates on an image. */
typedef enum resource_kind { OF_COLORS, OF_COORDINATES } resource_kind;

typedef struct resource {
    resource_kind kind;
    size_t row[2];     /* range of the package's rows */
    uint32_t material; /* or MESH_TEXTURES_NONE */
} resource;

typedef struct package {
    const char *archive;
    size_t size;
    size_t part_count; /* part 0 is the root */
    list objects;      /* of object */
    list vertices;     /* of double[3] */
    list triangles;    /* of uint32_t[3] */
    list components;   /* of reference */
    list items;        /* of reference: the items of the build */
    /* if values are kept */
    list properties; /* of property: one for each of `triangles` */
    list defaults;   /* of property: one for each of `objects` */
    list resources;  /* of resource */
    list rows;       /* of double[4]: colours, or u and v */
    list textures;   /* of mesh_material: each texture2d */
    name_table resource_names, texture_names;
    resource *filled; /* the resource whose rows are read, or NULL */
    uint32_t colors;  /* the material of colours, or MESH_TEXTURES_NONE */
    size_t others;    /* number of triangles that name a resource that is not read */
    plain_values *values_of[4];
    double group; /* number of placed objects with triangles */
    name_table part_names, object_names;
    size_t placed; /* number of placed objects, at most PLACED_MOST */
    size_t beam_lattices;
    double unit;      /* length of the root's unit, mm */
    char *root;       /* path of the root part, or NULL */
    size_t part;      /* the part that is being read */
    object *open;     /* the object that is being read, or NULL */
    bool is_building; /* the reader is within the root's <build> */
    plain_mesh *out;
} package;

/* Arrays of values: those of the kinds of resources, and two more. */
enum { OF_MATERIALS = OF_COORDINATES + 1, OF_GROUPS };

static bool damaged(package *p, const char *what)
{
    return plain_mesh_refuse(p->out, ERROR_INPUT_DAMAGED, "the 3MF file is damaged: %s", what);
}

static bool read_bytes(package *p, const char *path, char **out, size_t *length)
{
    switch (zip_entry_read(p->archive, p->size, path + (*path == '/'), ZIP_NAMES_ANY_CASE, out, length)) {
    case ZIP_ENTRY_READ:
        return true;
    case ZIP_ENTRY_MISSING:
        return plain_mesh_refuse(p->out, ERROR_INPUT_DAMAGED,
                                 "the 3MF file is damaged: its part %.200s is missing", path);
    case ZIP_ENTRY_TWICE:
        return plain_mesh_refuse(p->out, ERROR_INPUT_DAMAGED,
                                 "the 3MF file is damaged: its part %.200s is there twice", path);
    case ZIP_ENTRY_NO_MEMORY:
        return plain_mesh_refuse_memory(p->out);
    default:
        return damaged(p, "a part of it cannot be decompressed");
    }
}

/* Reads a part that is text. */
static bool read_entry(package *p, const char *path, char **out, size_t *length)
{
    if (!read_bytes(p, path, out, length)) return false;
    char *text = xml_in_utf8(*out, length);
    if (text) {
        free(*out);
        *out = text;
    }
    if (!memchr(*out, 0, *length)) return true;
    free(*out);
    return damaged(p, "its text has bytes that are 0");
}

/* Returns the address for one more item. NULL: the file is refused. */
static void *append(package *p, list *l, size_t size)
{
    if (l->count == l->room) {
        const size_t room = l->room ? 2 * l->room : 64;
        void *grown = realloc(l->items, room * size);
        if (!grown) {
            plain_mesh_refuse_memory(p->out);
            return NULL;
        }
        l->items = grown;
        l->room = room;
    }
    return (char *)l->items + size * l->count++;
}

/* The number of a resource, as text. Blanks before numbers are not part of them. */
static const char *id_attribute(const char **attributes, const char *name)
{
    const char *text = xml_attribute(attributes, name);
    return text ? text + strspn(text, " \t\r\n") : NULL;
}

/* ---- names */

/* The entry of a word, or the free entry for it. n->size > 0. */
static named *find_place(const name_table *n, size_t of, const char *word)
{
    uint64_t hash = 0xCBF29CE484222325u ^ of; /* FNV-1a */
    for (const char *c = word; *c; c++) hash = (hash ^ (unsigned char)*c) * 0x100000001B3u;
    for (size_t k = (hash ^ hash >> 32) & (n->size - 1);; k = (k + 1) & (n->size - 1)) {
        named *at = &n->place[k];
        if (!at->word || (at->of == of && strcmp(at->word, word) == 0)) return at;
    }
}

static const named *find_name(const name_table *n, size_t of, const char *word)
{
    const named *at = n->size && word ? find_place(n, of, word) : NULL;
    return at && at->word ? at : NULL;
}

/* Adds a word unless the table has it. */
static bool add_name(package *p, name_table *n, size_t of, const char *word, size_t number)
{
    if (!word) return true;
    if (2 * (n->count + 1) >= n->size) {
        name_table grown = {.count = n->count, .size = n->size ? 2 * n->size : 64};
        if (!(grown.place = calloc(grown.size, sizeof *grown.place))) return plain_mesh_refuse_memory(p->out);
        for (size_t k = 0; k < n->size; k++)
            if (n->place[k].word) *find_place(&grown, n->place[k].of, n->place[k].word) = n->place[k];
        free(n->place);
        *n = grown;
    }
    named *at = find_place(n, of, word);
    if (at->word) return true;
    *at = (named){of, number, strdup(word)};
    if (!at->word) return plain_mesh_refuse_memory(p->out);
    n->count++;
    return true;
}

static void free_names(name_table *n)
{
    for (size_t k = 0; k < n->size; k++) free(n->place[k].word);
    free(n->place);
}

/* ---- numbers */

static bool read_number(const char **attributes, const char *name, double *out)
{
    const char *at = xml_attribute(attributes, name);
    return at && plain_mesh_number(&at, out) && !at[strspn(at, " \t\r\n")];
}

static bool read_index(const char **attributes, const char *name, uint32_t *out)
{
    double number;
    const bool ok = read_number(attributes, name, &number) && number >= 0 && number < UINT32_MAX;
    if (ok) *out = (uint32_t)number;
    return ok && number == (double)*out;
}

/* Reads a transform: three axes and a translation, twelve numbers. *m is row-major. Without the attribute it
 * is the identity. */
static bool read_transform(package *p, const char *at, double out[16])
{
    double number[NUMBERS_OF_TRANSFORM] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    /* line breaks in attributes were converted to spaces */
    for (int k = 0; at && k < NUMBERS_OF_TRANSFORM; k++)
        if (!plain_mesh_number(&at, &number[k])) return damaged(p, "a transform is not twelve numbers");
    if (at && at[strspn(at, " ")]) return damaged(p, "a transform has more than twelve numbers");
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++) out[4 * i + k] = number[3 * k + i];
    for (int k = 0; k < 4; k++) out[12 + k] = k == 3;
    return true;
}

/* ---- the elements of a part */

/* Checks the extensions that a part requires. Known are those that do not change positions, and the
 * production extension, which is read. */
static bool check_extensions(package *p, const char **model)
{
    static const char *const known[] = {"/material/", "/production/", "/triangleset/", "/trianglesets/"};
    const char *required = xml_attribute(model, "requiredextensions");
    for (size_t length; required && *required; required += length + (required[length] != 0)) {
        char key[PATH_MOST];
        length = strcspn(required, " \t\r\n\"'");
        if (length == 0) continue;
        snprintf(key, sizeof key, "xmlns:%.*s", (int)(length < 200 ? length : 200), required);
        const char *space = xml_attribute(model, key);
        bool is_known = false;
        for (size_t k = 0; space && k < sizeof known / sizeof *known; k++)
            is_known |= strstr(space, known[k]) != NULL;
        if (!is_known)
            return plain_mesh_refuse(
                p->out, ERROR_INPUT_UNSUPPORTED,
                "it requires the 3MF extension %.120s, which is not supported. Save it without this extension.",
                space ? space : key);
    }
    return true;
}

/* Sets *millimetres to the length of the document's unit, with a warning unless it is 1. Without a name, the
 * unit is the millimetre. False: the unit is unknown, and the file is refused. */
static bool read_unit(const char *unit, plain_mesh *out, double *millimetres)
{
    static const struct {
        const char *name;
        double millimetres;
    } units[] = {{"micron", 0.001}, {"millimeter", 1}, {"centimeter", 10}, {"inch", 25.4},
                 {"foot", 304.8},   {"feet", 304.8},   {"meter", 1000}};
    *millimetres = 1;
    if (!unit) return true;
    for (size_t k = 0; k < sizeof units / sizeof *units; k++)
        if (strcmp(unit, units[k].name) == 0) {
            *millimetres = units[k].millimetres;
            if (*millimetres != 1)
                plain_mesh_warn(
                    out,
                    "the unit of the file is %s: coordinates are multiplied by %g, which makes them millimetres",
                    units[k].name, *millimetres);
            return true;
        }
    return plain_mesh_refuse(
        out, ERROR_INPUT_UNSUPPORTED,
        "its unit \"%.40s\" is unknown. Save it with micron, millimeter, centimeter, inch, "
        "foot or meter.",
        unit);
}

/* ---- colours and images */

/* Adds what an element names by `pid` and the attributes `index`. The other indices default to the first. */
static bool add_property(package *p, list *to, const char **attributes, const char *const index[3])
{
    const char *id = id_attribute(attributes, "pid");
    if (!p->out->keeps_values) return true;
    property *new = append(p, to, sizeof *new);
    if (!new) return false;
    *new = (property){.resource = id ? strdup(id) : NULL,
                      .has_index = xml_attribute(attributes, index[0]) != NULL};
    if (id && !new->resource) return plain_mesh_refuse_memory(p->out);
    for (int k = 0; k < 3; k++)
        if (!xml_attribute(attributes, index[k]))
            new->index[k] = k > 0 ? new->index[0] : 0;
        else if (!read_index(attributes, index[k], &new->index[k]))
            return damaged(p, "the index of a colour or a texture coordinate is not a number");
    return true;
}

/* Reads #RRGGBB, optionally with AA. */
static bool read_color(package *p, const char *text, double out[4])
{
    unsigned value[4] = {0, 0, 0, 255};
    const size_t digits = text && *text == '#' ? strspn(text + 1, "0123456789abcdefABCDEF") : 0;
    if ((digits != 6 && digits != 8) || text[1 + digits])
        return damaged(p, "a colour is not of the form #RRGGBB or #RRGGBBAA");
    sscanf(text + 1, "%2x%2x%2x%2x", &value[0], &value[1], &value[2], &value[3]);
    for (int k = 0; k < 4; k++) out[k] = value[k] / 255.0;
    return true;
}

static bool add_row(package *p, const double row[4])
{
    double(*at)[4] = append(p, &p->rows, sizeof *at);
    if (!at) return false;
    memcpy(*at, row, sizeof *at);
    p->filled->row[1]++;
    return true;
}

static bool read_wrap(package *p, const char **attributes, const char *name, uint32_t *out)
{
    static const char *const styles[] = {[MESH_WRAP_REPEAT] = "wrap",
                                         [MESH_WRAP_MIRROR] = "mirror",
                                         [MESH_WRAP_CLAMP] = "clamp",
                                         [MESH_WRAP_NOTHING] = "none"};
    const char *style = xml_attribute(attributes, name);
    for (*out = 0; *out < MESH_WRAPS; ++*out)
        if (!style || strcmp(style, styles[*out]) == 0) return true;
    return damaged(p, "a tile style is none of wrap, mirror, clamp and none");
}

/* Reads a texture2d: its image is a part of the package. */
static bool add_texture(package *p, const char **attributes)
{
    const char *path = xml_attribute(attributes, "path"), *id = id_attribute(attributes, "id");
    mesh_material new = mesh_textures_white();
    char *data = NULL;
    size_t length = 0;
    if (!path) return damaged(p, "a texture has no path");
    if (find_name(&p->texture_names, p->part, id)) return damaged(p, "two textures have the same id");
    if (!read_wrap(p, attributes, "tilestyleu", &new.wrap[0]) ||
        !read_wrap(p, attributes, "tilestylev", &new.wrap[1]))
        return false;
    if (p->out->textures && !read_bytes(p, path, &data, &length)) return false;
    new.is_opaque = true;
    const bool ok =
        !p->out->textures || (length > 0 ? plain_textures_add_image(p->out, path, data, length, &new.image)
                                         : damaged(p, "an image is empty"));
    free(data);
    mesh_material *at = ok ? append(p, &p->textures, sizeof *at) : NULL;
    if (!at) return false;
    *at = new;
    return add_name(p, &p->texture_names, p->part, id, p->textures.count - 1);
}

/* Begins a resource. */
static bool add_resource(package *p, resource_kind kind, const char **attributes)
{
    static const char what[] = "it refers to a texture that is missing";
    const char *id = id_attribute(attributes, "id");
    resource new = {kind, {p->rows.count, p->rows.count}, MESH_TEXTURES_NONE};
    if (find_name(&p->resource_names, p->part, id)) return damaged(p, "two resources have the same id");
    if (kind == OF_COORDINATES) {
        const named *found = find_name(&p->texture_names, p->part, id_attribute(attributes, "texid"));
        if (!found) return damaged(p, what);
        if (p->out->textures &&
            !plain_textures_add_material(p->out, &((mesh_material *)p->textures.items)[found->number],
                                         &new.material))
            return false;
    }
    if (kind == OF_COLORS && p->out->textures) {
        const mesh_material white = mesh_textures_white();
        if (p->colors == MESH_TEXTURES_NONE && !plain_textures_add_material(p->out, &white, &p->colors))
            return false;
        new.material = p->colors;
    }
    resource *at = append(p, &p->resources, sizeof *at);
    if (!at) return false;
    *at = new;
    p->filled = at;
    return add_name(p, &p->resource_names, p->part, id, p->resources.count - 1);
}

/* Handles the begin of an element outside of objects that colours or images depend on. */
static bool begin_resource(package *p, const char *name, const char **attributes)
{
    double row[4] = {0, 0, 0, 0};
    if (strcmp(name, "texture2d") == 0) return add_texture(p, attributes);
    if (strcmp(name, "basematerials") == 0 || strcmp(name, "colorgroup") == 0)
        return add_resource(p, OF_COLORS, attributes);
    if (strcmp(name, "texture2dgroup") == 0) return add_resource(p, OF_COORDINATES, attributes);
    if (!p->filled) return true;
    if (strcmp(name, "base") == 0 && p->filled->kind == OF_COLORS)
        return read_color(p,
                          xml_attribute(attributes, "displaycolor")
                              ? xml_attribute(attributes, "displaycolor")
                              : "#FFFFFF",
                          row) &&
               add_row(p, row);
    if (strcmp(name, "color") == 0 && p->filled->kind == OF_COLORS) {
        if (!read_color(p, xml_attribute(attributes, "color"), row)) return false;
        row[3] = 1; /* colours of groups are opaque */
        return add_row(p, row);
    }
    if (strcmp(name, "tex2coord") == 0 && p->filled->kind == OF_COORDINATES)
        return ((read_number(attributes, "u", &row[0]) && read_number(attributes, "v", &row[1])) ||
                damaged(p, "a texture coordinate is not two numbers")) &&
               add_row(p, row);
    return true;
}

/* Makes the corners of triangle t of an object vertices of their own, with their values. */
static bool add_triangle_values(package *p, const object *o, size_t number, size_t t, uint32_t corner[3])
{
    const property *own = &((property *)p->properties.items)[t],
                   *of_object = &((property *)p->defaults.items)[number];
    const char *name = own->resource ? own->resource : of_object->resource;
    const uint32_t *index = own->has_index ? own->index : of_object->index;
    const named *found = find_name(&p->resource_names, o->part, name);
    const resource *r = found ? &((resource *)p->resources.items)[found->number] : NULL;
    double material = r ? index[0] : 0;
    if (p->out->textures) material = r ? r->material : -1.0;
    p->others += name && !r;
    for (int k = 0; k < 3; k++) {
        const size_t n = p->out->vertices;
        if (r && index[k] >= r->row[1] - r->row[0])
            return damaged(p, "a triangle names a colour or a texture coordinate that is missing");
        if (!plain_mesh_copy_vertex(p->out, corner[k]) ||
            (r && !plain_mesh_set_values(p->out, p->values_of[r->kind], n,
                                         ((double(*)[4])p->rows.items)[r->row[0] + index[k]])) ||
            !plain_mesh_set_values(p->out, p->values_of[OF_MATERIALS], n, &material) ||
            !plain_mesh_set_values(p->out, p->values_of[OF_GROUPS], n, &p->group))
            return false;
        corner[k] = (uint32_t)n;
    }
    return true;
}

/* ---- objects */

static bool add_object(package *p, const char **attributes)
{
    object *o = append(p, &p->objects, sizeof *o);
    if (!o) return false;
    const size_t vertex = p->vertices.count, triangle = p->triangles.count, component = p->components.count;
    *o = (object){.part = p->part,
                  .vertex = {vertex, vertex},
                  .triangle = {triangle, triangle},
                  .component = {component, component}};
    static const char *const index[3] = {"pindex", "pindex", "pindex"};
    p->open = o;
    p->filled = NULL;
    if (!add_property(p, &p->defaults, attributes, index)) return false;
    const char *id = id_attribute(attributes, "id");
    if (find_name(&p->object_names, p->part, id))
        return plain_mesh_refuse(p->out, ERROR_INPUT_DAMAGED,
                                 "two of its objects have the id \"%.40s\". Give each an id of its own.", id);
    return add_name(p, &p->object_names, p->part, id, p->objects.count - 1);
}

static bool add_vertex(package *p, const char **attributes)
{
    double(*at)[3] = append(p, &p->vertices, sizeof *at);
    if (!at) return false;
    p->open->vertex[1]++;
    return (read_number(attributes, "x", &(*at)[0]) && read_number(attributes, "y", &(*at)[1]) &&
            read_number(attributes, "z", &(*at)[2])) ||
           damaged(p, "a vertex is not three numbers");
}

static bool add_triangle(package *p, const char **attributes)
{
    static const char *const names[] = {"v1", "v2", "v3"};
    const size_t count = p->open->vertex[1] - p->open->vertex[0];
    uint32_t(*corner)[3] = append(p, &p->triangles, sizeof *corner);
    if (!corner) return false;
    p->open->triangle[1]++;
    for (int k = 0; k < 3; k++)
        if (!read_index(attributes, names[k], &(*corner)[k]) || (*corner)[k] >= count)
            return damaged(p, "a triangle is not three vertices of its mesh");
    static const char *const index[3] = {"p1", "p2", "p3"};
    return add_property(p, &p->properties, attributes, index);
}

static char *copy_text(const char *text)
{
    return text ? strdup(text) : NULL;
}

static bool add_reference(package *p, list *to, const char **attributes)
{
    const char *path = xml_attribute(attributes, ":path"), *id = id_attribute(attributes, "objectid");
    reference *r = append(p, to, sizeof *r);
    if (!r) return false;
    *r = (reference){.path = copy_text(path), .id = copy_text(id)};
    if ((path && !r->path) || (id && !r->id)) return plain_mesh_refuse_memory(p->out);
    return read_transform(p, xml_attribute(attributes, "transform"), r->transform);
}

/* Handles the begin of an element within an object. */
static bool begin_in_object(package *p, const char *name, const char **attributes)
{
    if (strcmp(name, "vertex") == 0) return add_vertex(p, attributes);
    if (strcmp(name, "triangle") == 0 && xml_attribute(attributes, "v1")) return add_triangle(p, attributes);
    if (strcmp(name, "component") != 0) return true;
    p->open->component[1]++;
    return add_reference(p, &p->components, attributes);
}

static bool begin_element(void *context, const char *name, const char **attributes)
{
    package *p = context;
    const bool is_root = p->part == 0;
    name = xml_local_name(name);
    if (strcmp(name, "model") == 0)
        return check_extensions(p, attributes) &&
               (!is_root || read_unit(xml_attribute(attributes, "unit"), p->out, &p->unit));
    if (strcmp(name, "object") == 0) return add_object(p, attributes);
    if (strcmp(name, "build") == 0) p->is_building = is_root;
    if (strcmp(name, "item") == 0 && p->is_building) return add_reference(p, &p->items, attributes);
    p->beam_lattices += strcmp(name, "beamlattice") == 0;
    if (p->out->keeps_values && !p->open && !begin_resource(p, name, attributes)) return false;
    return !p->open || begin_in_object(p, name, attributes);
}

static void end_element(void *context, const char *name)
{
    package *p = context;
    name = xml_local_name(name);
    if (strcmp(name, "object") == 0) p->open = NULL;
    if (strcmp(name, "build") == 0) p->is_building = false;
}

static bool read_xml(package *p, const char *path, xml document)
{
    char *text;
    if (!read_entry(p, path, &text, &document.size)) return false;
    document.data = text;
    document.context = p;
    const bool ok = plain_mesh_read_xml(p->out, &document, "the 3MF file");
    free(text);
    return ok;
}

/* The part with a path. It is read when it is first named. */
static bool find_part(package *p, const char *path, size_t *out)
{
    const named *known = find_name(&p->part_names, 0, path);
    if (known) {
        *out = known->number;
        return true;
    }
    if (p->part_count == PARTS_MOST) return damaged(p, "it has too many parts");
    *out = p->part = p->part_count++;
    p->open = NULL;
    return add_name(p, &p->part_names, 0, path, *out) &&
           read_xml(p, path, (xml){.begin = begin_element, .end = end_element});
}

/* ---- meshes */

/* The index of the object that a component or an item names. */
static bool find_object(package *p, size_t of, const reference *r, size_t *out)
{
    if (r->path && !find_part(p, r->path, &of)) return false;
    const named *found = find_name(&p->object_names, of, r->id);
    if (!found) return damaged(p, "it refers to an object that is missing");
    *out = found->number;
    return true;
}

static bool add_mesh(package *p, const object *o, size_t number, const double m[3][4])
{
    const double(*vertex)[3] = p->vertices.items;
    const uint32_t(*corner)[3] = p->triangles.items;
    const size_t first = p->out->vertices;
    vec3 axis[3];
    for (int k = 0; k < 3; k++) axis[k] = affine_axis(m, k);
    const bool is_mirrored = vec3_dot(vec3_cross(axis[0], axis[1]), axis[2]) < 0;
    for (size_t k = o->vertex[0]; k < o->vertex[1]; k++) {
        const vec3 v = affine_apply(m, vertex[k][0], vertex[k][1], vertex[k][2]);
        if (!plain_mesh_add_vertex(p->out, (const double[3]){v.x, v.y, v.z})) return false;
    }
    for (size_t k = o->triangle[0]; k < o->triangle[1]; k++) {
        uint32_t c[3] = {(uint32_t)first + corner[k][0], (uint32_t)first + corner[k][1],
                         (uint32_t)first + corner[k][2]};
        if ((p->out->keeps_values && !add_triangle_values(p, o, number, k, c)) ||
            !plain_mesh_add_triangle(p->out, c[0], c[1], c[2], is_mirrored))
            return false;
    }
    p->group += o->triangle[1] > o->triangle[0];
    return true;
}

/* Adds the object that a component or an item of part `of` names, with its components. May reallocate the
 * lists. */
static bool place(package *p, size_t of, reference r, const double m[3][4], int depth)
{
    size_t number;
    double placed[3][4];
    if (depth > DEEPEST_COMPONENT) return damaged(p, "its components contain each other");
    if (++p->placed > PLACED_MOST)
        return plain_mesh_refuse(p->out, ERROR_INPUT_UNSUPPORTED,
                                 "its components repeat objects too often: more than %d objects. "
                                 "Save it with fewer components, or as one mesh.",
                                 PLACED_MOST);
    if (!find_object(p, of, &r, &number)) return false;
    affine_compose(m, r.transform, placed);
    ((object *)p->objects.items)[number].is_built = true;
    const object o = ((object *)p->objects.items)[number];
    bool ok = add_mesh(p, &o, number, (const double(*)[4])placed);
    for (size_t k = o.component[0]; ok && k < o.component[1]; k++)
        ok = place(p, o.part, ((reference *)p->components.items)[k], (const double(*)[4])placed, depth + 1);
    return ok;
}

/* ---- the package */

static bool begin_relation(void *context, const char *name, const char **attributes)
{
    static const char type[] = "/3dmodel";
    package *p = context;
    const char *kind = xml_attribute(attributes, "Type"), *target = xml_attribute(attributes, "Target");
    (void)name;
    if (!kind || !target || strlen(target) >= PATH_MOST || strlen(kind) < strlen(type) ||
        strcmp(kind + strlen(kind) - strlen(type), type) != 0)
        return true;
    p->root = strdup(target);
    return false;
}

static bool build(package *p)
{
    const double unit = p->unit, m[3][4] = {{unit}, {0, unit}, {0, 0, unit}};
    for (size_t k = 0; k < p->items.count; k++)
        if (!place(p, 0, ((reference *)p->items.items)[k], m, 0)) return false;
    return true;
}

static void warn(package *p)
{
    size_t left = 0;
    for (size_t k = 0; k < p->objects.count; k++) left += !((object *)p->objects.items)[k].is_built;
    if (left > 0)
        plain_mesh_warn(p->out, "%zu of %zu objects are not in the build of the file: they are skipped", left,
                        p->objects.count);
    if (p->others > 0 && p->out->textures)
        plain_textures_warn(
            p->out,
            "%zu triangles are white: their pid names multiproperties, composite materials or another resource "
            "that is not read",
            p->others);
    if (p->beam_lattices > 0) plain_mesh_warn(p->out, "%zu beam lattices are skipped", p->beam_lattices);
}

static void free_references(list *l)
{
    for (size_t k = 0; k < l->count; k++) {
        free(((reference *)l->items)[k].path);
        free(((reference *)l->items)[k].id);
    }
    free(l->items);
}

static void free_properties(list *l)
{
    for (size_t k = 0; k < l->count; k++) free(((property *)l->items)[k].resource);
    free(l->items);
}

bool plain_mesh_read_3mf(const char *data, size_t size, plain_mesh *out)
{
    package p = {.archive = data,
                 .size = size,
                 .out = out,
                 .unit = 1,
                 .colors = MESH_TEXTURES_NONE,
                 .values_of = {plain_mesh_add_values(out, out->textures ? MESH_TEXTURES_TINT : "color",
                                                     MESH_VALUES_COLOR, 4),
                               plain_mesh_add_values(out, MESH_TEXTURES_UV, MESH_VALUES_UV, 2),
                               plain_mesh_add_values(out, MESH_TEXTURES_MATERIAL, MESH_VALUES_WHOLE, 1),
                               plain_mesh_add_values(out, "group", MESH_VALUES_WHOLE, 1)}};
    size_t root;
    if (size < 2 || memcmp(data, "PK", 2) != 0) return damaged(&p, "it is no ZIP archive");
    const bool ok = read_xml(&p, "_rels/.rels", (xml){.begin = begin_relation}) &&
                    (p.root || damaged(&p, "it refers to no model")) && find_part(&p, p.root, &root) &&
                    build(&p);
    if (ok) warn(&p);
    free(p.root);
    free(p.objects.items);
    free(p.vertices.items);
    free(p.triangles.items);
    free_references(&p.components);
    free_references(&p.items);
    free_names(&p.part_names);
    free_names(&p.object_names);
    free_properties(&p.properties);
    free_properties(&p.defaults);
    free(p.resources.items);
    free(p.rows.items);
    free(p.textures.items);
    free_names(&p.resource_names);
    free_names(&p.texture_names);
    return ok;
}
