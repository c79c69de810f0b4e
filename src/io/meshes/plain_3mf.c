/* 3MF: the items of the build with their transforms, in doubles and millimetres. Meshes, components and parts of other model files in
 * the package (the production extension) are read. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "geometry/space/affine.h"
#include "io/meshes/plain_mesh.h"
#include "io/meshes/xml_tags.h"
#include "io/meshes/zip_entry.h"

enum {
    DEEPEST_COMPONENT = 200,
    PARTS_MOST = 4096,
    NUMBER_TEXT_MAX = 64,
    PATH_MOST = 256,
    NUMBERS_OF_TRANSFORM = 12
};

/* Limits of what components repeat, since components that double at each level place 2^n objects: the objects that are
 * placed, and the bytes of their text, in addition to TEXT_PER_ELEMENT for each vertex and triangle, which the memory
 * limit bounds. */
enum { PLACED_MOST = 1000000, TEXT_PER_ELEMENT = 256 };
static const size_t TEXT_MOST = (size_t)1 << 30;

/* A model file of the package. */
typedef struct part {
    char *path, *text; /* to be freed */
} part;

/* An object: where its tag begins in its part. */
typedef struct object {
    size_t part;
    const char *at;
    bool is_built;
} object;

/* Numbers of words, each word within the part `of`: a hash table with open addressing. */
typedef struct name {
    size_t of, number;
    xml_word word; /* at NULL: an empty place */
} name;

typedef struct names {
    name *place;
    size_t count, size; /* size: a power of 2, more than twice the count; or 0 */
} names;

typedef struct package {
    const char *archive;
    size_t size;
    part *parts; /* the first is the root */
    size_t part_count;
    object *objects;
    size_t object_count, object_room;
    names part_names, object_names;
    size_t placed, text_bytes; /* see PLACED_MOST */
    size_t beam_lattices;
    plain_mesh *out;
} package;

static bool damaged(package *p, const char *what)
{
    return plain_mesh_refuse(p->out, ERROR_INPUT_DAMAGED, "the 3MF file is damaged: %s", what);
}

static bool no_memory(package *p)
{
    return plain_mesh_refuse(p->out, ERROR_LIMIT_MEMORY,
                             "reading it requires more memory than the limit: raise limits.memory_mb");
}

static bool read_entry(package *p, const char *path, char **out)
{
    size_t length;
    switch (zip_entry_read(p->archive, p->size, path + (*path == '/'), out, &length)) {
    case ZIP_ENTRY_READ:
        break;
    case ZIP_ENTRY_MISSING:
        return plain_mesh_refuse(p->out, ERROR_INPUT_DAMAGED,
                                 "the 3MF file is damaged: its part %.200s is missing", path);
    case ZIP_ENTRY_NO_MEMORY:
        return no_memory(p);
    default:
        return damaged(p, "a part of it cannot be decompressed");
    }
    if (!memchr(*out, 0, length)) return true;
    free(*out); /* UTF-16, which the standard allows */
    return plain_mesh_refuse(p->out, ERROR_INPUT_UNSUPPORTED, "its text is not UTF-8. Save it as UTF-8.");
}

/* ---- names */

/* The place of a word, or the empty place where it belongs. The table has a size. */
static name *find_place(const names *n, size_t of, xml_word word)
{
    uint64_t hash = 0xCBF29CE484222325u ^ of; /* FNV-1a */
    for (size_t k = 0; k < word.length; k++) hash = (hash ^ (unsigned char)word.at[k]) * 0x100000001B3u;
    for (size_t k = (hash ^ hash >> 32) & (n->size - 1);; k = (k + 1) & (n->size - 1)) {
        name *at = &n->place[k];
        if (!at->word.at || (at->of == of && at->word.length == word.length &&
                             memcmp(at->word.at, word.at, word.length) == 0))
            return at;
    }
}

static const name *find_name(const names *n, size_t of, xml_word word)
{
    const name *at = n->size && word.at ? find_place(n, of, word) : NULL;
    return at && at->word.at ? at : NULL;
}

/* Adds a word unless it is there. The text of the word stays where it is. */
static bool add_name(package *p, names *n, size_t of, xml_word word, size_t number)
{
    if (!word.at) return true;
    if (2 * (n->count + 1) >= n->size) {
        names grown = {.count = n->count, .size = n->size ? 2 * n->size : 64};
        if (!(grown.place = calloc(grown.size, sizeof *grown.place))) return no_memory(p);
        for (size_t k = 0; k < n->size; k++)
            if (n->place[k].word.at) *find_place(&grown, n->place[k].of, n->place[k].word) = n->place[k];
        free(n->place);
        *n = grown;
    }
    name *at = find_place(n, of, word);
    if (at->word.at) return true;
    *at = (name){of, number, word};
    n->count++;
    return true;
}

/* ---- numbers */

static bool read_number(xml_word word, double *out)
{
    char text[NUMBER_TEXT_MAX];
    const char *at = text;
    if (!word.at || word.length >= sizeof text) return false;
    memcpy(text, word.at, word.length);
    text[word.length] = 0;
    return plain_mesh_number(&at, out) && !at[strspn(at, " \t\r\n")];
}

static bool read_index(xml_word word, double count, double *out)
{
    return read_number(word, out) && *out >= 0 && *out < count && *out == (double)(uint32_t)*out;
}

/* The twelve numbers of a transform are three axes and a translation; the matrix comes out row by row. No attribute is the identity. */
static bool read_transform(package *p, xml_word word, double out[16])
{
    double number[NUMBERS_OF_TRANSFORM] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    char text[NUMBERS_OF_TRANSFORM * NUMBER_TEXT_MAX] = "";
    const char *at = text;
    if (word.length >= sizeof text) return damaged(p, "a transform is too long");
    if (word.at) memcpy(text, word.at, word.length);
    text[word.length] = 0;
    for (char *c = text; *c; c++)
        if (*c == '\n' || *c == '\r') *c = ' ';
    for (int k = 0; word.at && k < NUMBERS_OF_TRANSFORM; k++)
        if (!plain_mesh_number(&at, &number[k])) return damaged(p, "a transform is not twelve numbers");
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++) out[4 * i + k] = number[3 * k + i];
    for (int k = 0; k < 4; k++) out[12 + k] = k == 3;
    return true;
}

/* ---- parts and objects */

static bool add_object(package *p, size_t of, const xml_tag *tag, const char *at)
{
    if (p->object_count == p->object_room) {
        const size_t room = p->object_room ? 2 * p->object_room : 64;
        object *grown = realloc(p->objects, room * sizeof *grown);
        if (!grown) return no_memory(p);
        p->objects = grown;
        p->object_room = room;
    }
    const xml_word id = xml_attribute(tag, "id");
    p->objects[p->object_count] = (object){of, at, false};
    return add_name(p, &p->object_names, of, id, p->object_count++);
}

/* Extensions that a part requires by prefix: those that change no place of a mesh, and that which is read, are known. */
static bool check_extensions(package *p, const xml_tag *model)
{
    static const char *const known[] = {"/material/", "/production/", "/triangleset/", "/trianglesets/"};
    const xml_word required = xml_attribute(model, "requiredextensions");
    for (size_t at = 0; at < required.length;) {
        char key[PATH_MOST];
        const size_t length = strcspn(required.at + at, " \t\r\n\"'");
        snprintf(key, sizeof key, "xmlns:%.*s", (int)(length < 200 ? length : 200), required.at + at);
        at += length + 1;
        if (length == 0) continue;
        const xml_word space = xml_attribute(model, key);
        bool is_known = false;
        for (size_t k = 0; k < sizeof known / sizeof *known; k++) {
            char text[PATH_MOST] = "";
            if (space.at && space.length < sizeof text) memcpy(text, space.at, space.length);
            is_known |= strstr(text, known[k]) != NULL;
        }
        if (!is_known)
            return plain_mesh_refuse(
                p->out, ERROR_INPUT_UNSUPPORTED,
                "it requires the 3MF extension %.*s, which is not supported. Save it without this "
                "extension.",
                space.at ? (int)(space.length < 120 ? space.length : 120) : (int)strlen(key),
                space.at ? space.at : key);
    }
    return true;
}

/* The part of a path, read when it is first named; its objects are listed. */
static bool find_part(package *p, const char *path, size_t *out)
{
    const name *known = find_name(&p->part_names, 0, (xml_word){path, strlen(path)});
    if (known) {
        *out = known->number;
        return true;
    }
    part *grown = p->part_count < PARTS_MOST ? realloc(p->parts, (p->part_count + 1) * sizeof *grown) : NULL;
    if (!grown) return no_memory(p);
    p->parts = grown;
    part *new = &p->parts[p->part_count];
    *new = (part){.path = strdup(path)};
    if (!new->path) return no_memory(p);
    *out = p->part_count++;
    if (!read_entry(p, path, &new->text) ||
        !add_name(p, &p->part_names, 0, (xml_word){new->path, strlen(new->path)}, *out))
        return false;
    xml_tag tag;
    const char *at = new->text, *begin = at;
    for (; xml_next_tag(&at, &tag); begin = at) {
        if (tag.is_end) continue;
        if (xml_is(tag.name, "model") && !check_extensions(p, &tag)) return false;
        if (xml_is(tag.name, "object") && !add_object(p, *out, &tag, begin)) return false;
        p->beam_lattices += xml_is(tag.name, "beamlattice");
    }
    return !*at || damaged(p, "a tag does not end");
}

/* The object that a component or an item names. */
static bool find_object(package *p, size_t of, const xml_tag *tag, object **out)
{
    const xml_word id = xml_attribute(tag, "objectid"), path = xml_attribute(tag, ":path");
    char other[PATH_MOST];
    if (path.length >= sizeof other) return damaged(p, "a path is too long");
    if (path.at) {
        snprintf(other, sizeof other, "%.*s", (int)path.length, path.at);
        if (!find_part(p, other, &of)) return false;
    }
    const name *named = find_name(&p->object_names, of, id);
    if (!named) return damaged(p, "it refers to an object that is missing");
    *out = &p->objects[named->number];
    return true;
}

/* ---- meshes */

static bool add_vertex(package *p, const xml_tag *tag, const double m[3][4])
{
    double at[3];
    if (!read_number(xml_attribute(tag, "x"), &at[0]) || !read_number(xml_attribute(tag, "y"), &at[1]) ||
        !read_number(xml_attribute(tag, "z"), &at[2]))
        return damaged(p, "a vertex is not three numbers");
    const vec3 v = affine_apply(m, at[0], at[1], at[2]);
    return plain_mesh_add_vertex(p->out, (const double[3]){v.x, v.y, v.z}) || no_memory(p);
}

static bool add_triangle(package *p, const xml_tag *tag, size_t first, bool is_mirrored)
{
    const double count = (double)(p->out->vertices - first);
    double a, b, c;
    if (!read_index(xml_attribute(tag, "v1"), count, &a) ||
        !read_index(xml_attribute(tag, "v2"), count, &b) || !read_index(xml_attribute(tag, "v3"), count, &c))
        return damaged(p, "a triangle is not three vertices of its mesh");
    return plain_mesh_add_triangle(p->out, (uint32_t)first + (uint32_t)a, (uint32_t)first + (uint32_t)b,
                                   (uint32_t)first + (uint32_t)c, is_mirrored) ||
           no_memory(p);
}

static bool check_repetition(package *p)
{
    const size_t elements = p->out->vertices + p->out->triangles;
    if (++p->placed <= PLACED_MOST && p->text_bytes <= TEXT_MOST + TEXT_PER_ELEMENT * elements) return true;
    return plain_mesh_refuse(
        p->out, ERROR_INPUT_UNSUPPORTED,
        "its components repeat objects too often: more than %d objects, or %zu MiB of text. "
        "Save it with fewer components, or as one mesh.",
        PLACED_MOST, TEXT_MOST >> 20);
}

static bool add_object_at(package *p, object *o, const double m[3][4], int depth);

/* A component of an object, or an item of the build. */
static bool add_reference(package *p, size_t of, const xml_tag *tag, const double m[3][4], int depth)
{
    object *named = NULL;
    double own[16] = {0}, placed[3][4];
    if (depth > DEEPEST_COMPONENT) return damaged(p, "its components contain each other");
    if (!check_repetition(p) || !find_object(p, of, tag, &named) ||
        !read_transform(p, xml_attribute(tag, "transform"), own))
        return false;
    affine_compose(m, own, placed);
    return add_object_at(p, named, (const double(*)[4])placed, depth);
}

static bool add_object_at(package *p, object *o, const double m[3][4], int depth)
{
    xml_tag tag;
    const char *at = o->at;
    const size_t first = p->out->vertices, of = o->part;
    vec3 axis[3];
    for (int k = 0; k < 3; k++) axis[k] = affine_axis(m, k);
    const bool is_mirrored = vec3_dot(vec3_cross(axis[0], axis[1]), axis[2]) < 0;
    o->is_built = true; /* *o may move from here on */
    for (const char *before = at; xml_next_tag(&at, &tag) && !(tag.is_end && xml_is(tag.name, "object"));
         before = at) {
        p->text_bytes += (size_t)(at - before);
        if (tag.is_end) continue;
        if (xml_is(tag.name, "vertex") && !add_vertex(p, &tag, m)) return false;
        if (xml_is(tag.name, "triangle") && xml_attribute(&tag, "v1").at &&
            !add_triangle(p, &tag, first, is_mirrored))
            return false;
        if (xml_is(tag.name, "component") && !add_reference(p, of, &tag, m, depth + 1)) return false;
    }
    return true;
}

/* ---- the package */

/* The path of the model that the package begins with; to be freed. */
static char *find_root(package *p)
{
    static const char type[] = "/3dmodel";
    char *relations = NULL, *path = NULL;
    xml_tag tag;
    if (!read_entry(p, "_rels/.rels", &relations)) return NULL;
    for (const char *at = relations; !path && xml_next_tag(&at, &tag);) {
        const xml_word kind = xml_attribute(&tag, "Type"), target = xml_attribute(&tag, "Target");
        if (!kind.at || !target.at || target.length >= PATH_MOST || kind.length < strlen(type) ||
            memcmp(kind.at + kind.length - strlen(type), type, strlen(type)) != 0)
            continue;
        if ((path = calloc(target.length + 1, 1))) memcpy(path, target.at, target.length);
    }
    free(relations);
    if (!path) damaged(p, "it refers to no model");
    return path;
}

/* Sets *millimetres to the length of the document's unit, with a warning unless it is 1. Without a name, the unit is the
 * millimetre. False: the unit is unknown, and the file is refused. */
static bool read_unit(xml_word unit, plain_mesh *out, double *millimetres)
{
    static const struct {
        const char *name;
        double millimetres;
    } units[] = {{"micron", 0.001}, {"millimeter", 1}, {"centimeter", 10}, {"inch", 25.4},
                 {"foot", 304.8},   {"feet", 304.8},   {"meter", 1000}};
    *millimetres = 1;
    if (!unit.at) return true;
    for (size_t k = 0; k < sizeof units / sizeof *units; k++)
        if (xml_is(unit, units[k].name)) {
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
        "its unit \"%.*s\" is unknown. Save it with micron, millimeter, centimeter, inch, "
        "foot or meter.",
        (int)(unit.length < 40 ? unit.length : 40), unit.at);
}

static bool build(package *p)
{
    double unit = 1, m[3][4] = {{0}};
    xml_tag tag;
    const char *at = p->parts[0].text;
    bool is_building = false;
    while (xml_next_tag(&at, &tag)) {
        if (!tag.is_end && xml_is(tag.name, "model") &&
            !read_unit(xml_attribute(&tag, "unit"), p->out, &unit))
            return false;
        if (xml_is(tag.name, "build")) is_building = !tag.is_end && !tag.is_empty;
        if (tag.is_end || !is_building || !xml_is(tag.name, "item")) continue;
        for (int k = 0; k < 3; k++) m[k][k] = unit;
        if (!add_reference(p, 0, &tag, (const double(*)[4])m, 0)) return false;
    }
    p->out->unit = unit;
    return true;
}

static void warn(package *p)
{
    size_t left = 0;
    for (size_t k = 0; k < p->object_count; k++) left += !p->objects[k].is_built;
    if (left > 0)
        plain_mesh_warn(p->out, "%zu of %zu objects are not in the build of the file: they are skipped", left,
                        p->object_count);
    if (p->beam_lattices > 0) plain_mesh_warn(p->out, "%zu beam lattices are skipped", p->beam_lattices);
}

bool plain_mesh_read_3mf(const char *data, size_t size, plain_mesh *out)
{
    package p = {.archive = data, .size = size, .out = out};
    size_t root;
    if (size < 2 || memcmp(data, "PK", 2) != 0) return false;
    char *path = find_root(&p);
    const bool ok = path && find_part(&p, path, &root) && build(&p);
    if (ok) warn(&p);
    free(path);
    for (size_t k = 0; k < p.part_count; k++) {
        free(p.parts[k].text);
        free(p.parts[k].path);
    }
    free(p.parts);
    free(p.part_names.place);
    free(p.object_names.place);
    free(p.objects);
    return ok;
}
