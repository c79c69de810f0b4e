// SPDX-License-Identifier: Apache-2.0
/* glTF 2.0, as text or binary: the triangles of its scene in world space, by the transforms of its nodes in
 * doubles. Extensions that the file requires are known, or the file is refused by the name of one; Draco
 * alone is left to the library. */
#include <endian.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/hex.h"
#include "geometry/space/affine.h"
#include "base/core/number.h"
#include "base/json/json.h"
#include "io/meshes/base64.h"
#include "io/meshes/plain_textures.h"

enum { MAGIC_BYTES = 4, HEAD = 12, CHUNK_HEAD = 8, DEEPEST_NODE = 200 };
/* Maximum number of primitives that nodes place: many nodes may refer to one mesh with many primitives. */
enum { PRIMITIVES_MOST = 1000000 };
enum { TRIANGLES = 4, TRIANGLE_STRIP = 5, TRIANGLE_FAN = 6 };
/* Deviation of declared bounds that is not reported, as a fraction of the largest coordinate: programs write
 * them with six digits. */
static const double bounds_rounding = 1e-5;
static const uint32_t CHUNK_JSON = 0x4E4F534Au, CHUNK_BIN = 0x004E4942u;

/* An array of the document. */
typedef struct list {
    const json **item;
    size_t count;
} list;

typedef struct buffer {
    const char *data;
    size_t size;
    char *decoded; /* decoded contents of a data URI; owned */
} buffer;

typedef struct gltf {
    const char *bin; /* the binary chunk, or NULL */
    size_t bin_size;
    json *root;
    list nodes, meshes, accessors, views, buffers;
    buffer *loaded;                  /* one per buffer; data NULL: not loaded yet */
    bool *is_in_scene;               /* per mesh: it is in the scene */
    size_t visited, primitives;      /* visited nodes; placed primitives, counted for each node that refers
                                      * to them */
    size_t skins, morphs, instances; /* nodes with a skin, with morph targets, with instancing */
    size_t hidden;                   /* nodes that are not visible */
    /* if textures are read */
    list materials, textures, images, samplers;
    uint32_t *image_index; /* per image: its index in the textures; MESH_TEXTURES_NONE: it is not added yet */
    uint32_t
        *uv_set;   /* per material, and last of primitives without one: the set of coordinates of its image */
    size_t groups; /* number of visited nodes with a mesh */
    plain_mesh *out;
} gltf;

static bool damaged(gltf *g, const char *what, size_t index)
{
    return plain_mesh_refuse(g->out, ERROR_INPUT_DAMAGED, "the glTF file is damaged: %s %zu", what, index);
}

static bool no_memory(gltf *g)
{
    return plain_mesh_refuse(g->out, ERROR_LIMIT_MEMORY,
                             "reading it requires more memory than the limit: raise limits.memory_mb");
}

static bool list_items(gltf *g, const char *key, list *out)
{
    json_at root = json_root(g->root), array = json_member(&root, key);
    out->count = json_size(array);
    out->item = calloc(out->count + 1, sizeof *out->item);
    if (!out->item) return no_memory(g);
    out->count = json_elements(array, out->item, out->count);
    return true;
}

static json_at member(const json *node, const char *key)
{
    static json_at at; /* json_at without a path */
    at = json_root(node);
    return json_member(&at, key);
}

/* The item at an index. NULL: the index is not valid. */
static const json *item_at(const list *l, double index)
{
    return index >= 0 && index < (double)l->count && index == floor(index) ? l->item[(size_t)index] : NULL;
}

/* ---- buffers */

/* Decodes base64 data of a data URI, whose characters may be percent-encoded, and whose padding may be missing.
 * `what`: "base64 data of buffer" or of another object with this index, for messages. */
static bool decode(gltf *g, const char *uri, const char *what, size_t index, buffer *out)
{
    char *text = malloc(strlen(uri) + 4), *end = text;
    if (!text) return no_memory(g);
    for (const char *at = uri; *at;) *end++ = hex_next_of_uri(&at);
    while ((end - text) % 4) *end++ = '=';
    const char *from = text;
    out->size = base64_count(text, end);
    out->data = out->decoded = malloc(out->size + 1);
    const bool ok = out->decoded ? base64_read(&from, end, (unsigned char *)out->decoded, out->size) ||
                                       damaged(g, what, index)
                                 : no_memory(g);
    free(text);
    return ok;
}

static bool is_separate(const char *uri)
{
    return uri && strncmp(uri, "data:", 5) != 0;
}

static bool refuse_separate(gltf *g, const char *uri)
{
    return plain_mesh_refuse(
        g->out, ERROR_INPUT_MISSING,
        "its buffer \"%.200s\" is a separate file, which is not read. Save the mesh as .glb, which contains its data.",
        uri);
}

/* Leaves a mesh that is compressed with Draco to the library, which has no access to separate files. */
static bool leave(gltf *g)
{
    for (size_t k = 0; k < g->buffers.count; k++) {
        const char *uri = json_string(member(g->buffers.item[k], "uri"), NULL);
        if (is_separate(uri)) return refuse_separate(g, uri);
    }
    g->out->needs_library = true;
    return false;
}

static bool load(gltf *g, size_t index, buffer *out)
{
    const json *node = g->buffers.item[index];
    const char *uri = json_string(member(node, "uri"), NULL);
    const double bytes = json_number(member(node, "byteLength"), -1);
    if (uri && strncmp(uri, "data:", 5) == 0) {
        const char *text = strstr(uri, ";base64,");
        if (!text) return damaged(g, "no base64 data in buffer", index);
        if (!decode(g, text + strlen(";base64,"), "base64 data of buffer", index, out)) return false;
    } else if (uri) {
        return refuse_separate(g, uri);
    } else if (index == 0 && g->bin) {
        *out = (buffer){g->bin, g->bin_size, NULL};
    } else {
        return damaged(g, "no data in buffer", index);
    }
    if (!(bytes >= 0 && bytes <= (double)out->size)) return damaged(g, "too few bytes in buffer", index);
    out->size = (size_t)bytes;
    return true;
}

/* ---- accessors */

/* `count` elements with `components` numbers each, in a buffer. */
typedef struct elements {
    const char *at;
    size_t count, stride, components;
    int type; /* componentType of the file */
    bool is_normalised;
} elements;

/* Component types: the code in the file, the type, and the number that represents 1 if numbers are
 * normalised. */
typedef struct component_type {
    int name;
    number_type number;
    double one;
} component_type;

static const component_type *find_type(int name)
{
    static const component_type types[] = {{5120, NUMBER_INT8, 127},    {5121, NUMBER_UINT8, 255},
                                           {5122, NUMBER_INT16, 32767}, {5123, NUMBER_UINT16, 65535},
                                           {5125, NUMBER_UINT32, 1},    {5126, NUMBER_FLOAT, 1}};
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (types[k].name == name) return &types[k];
    return NULL;
}

static size_t bytes_of(int type)
{
    const component_type *t = find_type(type);
    return t ? number_bytes(t->number) : 0;
}

/* Whether numbers of this type may be indices: an unsigned byte, short or int. */
static bool is_index_type(int type)
{
    return type == 5121 || type == 5123 || type == 5125;
}

/* Reads a number of an element. e->type is valid. */
static double element(const elements *e, size_t index, size_t component)
{
    const component_type *t = find_type(e->type);
    const char *at = e->at + index * e->stride + component * number_bytes(t->number);
    const double value = number_value(at, t->number, NUMBER_LITTLE_SWAPPED);
    return e->is_normalised && t->one > 1 ? fmax(value / t->one, -1) : value;
}

/* Finds the elements in a view, from an offset. Set before: e->count, components and type. */
static bool find_elements(gltf *g, double view, double offset, size_t accessor, elements *e)
{
    const json *of = item_at(&g->views, view);
    const double in = of ? json_number(member(of, "buffer"), -1) : -1;
    if (!of || !item_at(&g->buffers, in) || !bytes_of(e->type))
        return damaged(g, "no data in accessor", accessor);
    buffer *b = &g->loaded[(size_t)in];
    if (!b->data && !load(g, (size_t)in, b)) return false;
    const double begin = json_number(member(of, "byteOffset"), 0),
                 length = json_number(member(of, "byteLength"), -1),
                 tight = (double)(bytes_of(e->type) * e->components),
                 stride = json_number(member(of, "byteStride"), tight),
                 end = offset + stride * ((double)e->count - 1) + tight;
    const bool is_within = begin >= 0 && offset >= 0 && length >= 0 && stride >= tight &&
                           stride <= 252 + tight && begin + length <= (double)b->size &&
                           (e->count == 0 || end <= length);
    if (!is_within) return damaged(g, "too few bytes for accessor", accessor);
    e->at = b->data + (size_t)begin + (size_t)offset;
    e->stride = (size_t)stride;
    return true;
}

/* Replaces the elements that the `sparse` member of an accessor lists. */
static bool put_sparse(gltf *g, const json *sparse, const elements *like, size_t accessor, double *values)
{
    json_at at = json_root(sparse), indices = json_member(&at, "indices"),
            replaced = json_member(&at, "values");
    const double count = json_number(json_member(&at, "count"), -1);
    if (!(count >= 0 && count <= (double)like->count))
        return damaged(g, "wrong sparse values of accessor", accessor);
    elements to = {.count = (size_t)count,
                   .components = 1,
                   .type = (int)json_number(json_member(&indices, "componentType"), 0)},
             from = *like;
    from.count = to.count;
    if (!is_index_type(to.type)) return damaged(g, "wrong type of the sparse indices of accessor", accessor);
    if (!find_elements(g, json_number(json_member(&indices, "bufferView"), -1),
                       json_number(json_member(&indices, "byteOffset"), 0), accessor, &to) ||
        !find_elements(g, json_number(json_member(&replaced, "bufferView"), -1),
                       json_number(json_member(&replaced, "byteOffset"), 0), accessor, &from))
        return false;
    for (size_t k = 0; k < to.count; k++) {
        const double index = element(&to, k, 0);
        if (!(index >= 0 && index < (double)like->count))
            return damaged(g, "wrong sparse values of accessor", accessor);
        for (size_t c = 0; c < like->components; c++)
            values[(size_t)index * like->components + c] = element(&from, k, c);
    }
    return true;
}

/* Warns if the declared bounds of positions differ from their bounds by more than rounding. */
static void check_bounds(gltf *g, const json *node, size_t accessor, const double *at, size_t count)
{
    double low[3] = {at[0], at[1], at[2]}, high[3] = {at[0], at[1], at[2]}, extent = 0, away = 0;
    for (size_t k = 3; k < 3 * count; k++) {
        low[k % 3] = fmin(low[k % 3], at[k]);
        high[k % 3] = fmax(high[k % 3], at[k]);
    }
    double min[3], max[3];
    if (json_numbers(member(node, "min"), min, 3) != 3 || json_numbers(member(node, "max"), max, 3) != 3)
        return;
    for (int k = 0; k < 3; k++) {
        extent = fmax(extent, fmax(fabs(low[k]), fabs(high[k])));
        away = fmax(away, fmax(fabs(min[k] - low[k]), fabs(max[k] - high[k])));
    }
    if (away > bounds_rounding * extent)
        plain_mesh_warn(g->out, "min and max of accessor %zu contradict its positions: the positions count",
                        accessor);
}

/* Reads all numbers of an accessor. The caller frees them. NULL: the file is refused. */
static double *read_accessor(gltf *g, double index, const char *type, size_t components, size_t *count)
{
    const json *node = item_at(&g->accessors, index);
    const double rows = node ? json_number(member(node, "count"), -1) : -1;
    const size_t number = node ? (size_t)index : 0;
    if (!(rows >= 1 && rows < UINT32_MAX) || strcmp(json_string(member(node, "type"), ""), type) != 0) {
        damaged(g, "wrong type or count of accessor", number);
        return NULL;
    }
    elements e = {.count = (size_t)rows,
                  .components = components,
                  .type = (int)json_number(member(node, "componentType"), 0),
                  .is_normalised = json_bool(member(node, "normalized"), false)};
    const double view = json_number(member(node, "bufferView"), -1);
    const json *sparse = member(node, "sparse").node;
    if (view >= 0 && !find_elements(g, view, json_number(member(node, "byteOffset"), 0), number, &e))
        return NULL;
    double *values = calloc(e.count * components + 1, sizeof *values);
    if (!values) no_memory(g);
    for (size_t k = 0; values && view >= 0 && k < e.count * components; k++)
        values[k] = element(&e, k / components, k % components);
    if (values && sparse && !put_sparse(g, sparse, &e, number, values)) {
        free(values);
        return NULL;
    }
    *count = e.count;
    return values;
}

/* Reads positions. The caller frees them. NULL: the file is refused. */
static double *read_positions(gltf *g, double index, size_t *count)
{
    const json *node = item_at(&g->accessors, index);
    const double type = node ? json_number(member(node, "componentType"), 0) : 0;
    if (type == 5125) {
        damaged(g, "wrong componentType of positions in accessor", (size_t)index);
        return NULL;
    }
    double *values = read_accessor(g, index, "VEC3", 3, count);
    if (values && type == 5126) check_bounds(g, node, (size_t)index, values, *count);
    return values;
}

/* ---- meshes and nodes */

/* Reads the indices of a primitive. The caller frees them. NULL: the file is refused. */
static double *read_indices(gltf *g, double accessor, size_t *count)
{
    const json *node = item_at(&g->accessors, accessor);
    if (node && (!is_index_type((int)json_number(member(node, "componentType"), 0)) ||
                 json_bool(member(node, "normalized"), false))) {
        damaged(g, "the indices are not unsigned integers, in accessor", (size_t)accessor);
        return NULL;
    }
    return read_accessor(g, accessor, "SCALAR", 1, count);
}

/* The corners of triangle n of a primitive, as indices in its list of corners. The odd triangles of a strip
 * have opposite orientation. */
static void corners_of(int mode, size_t n, size_t out[3])
{
    out[0] = mode == TRIANGLES ? 3 * n : mode == TRIANGLE_FAN ? 0 : n;
    out[1] = mode == TRIANGLES ? 3 * n + 1 : mode == TRIANGLE_FAN || n % 2 == 0 ? n + 1 : n + 2;
    out[2] = mode == TRIANGLES ? 3 * n + 2 : mode == TRIANGLE_FAN || n % 2 == 0 ? n + 2 : n + 1;
}

/* Adds the triangles of a primitive. index NULL: corner k is vertex k. */
static bool add_triangles(gltf *g, int mode, const double *index, size_t corners, size_t first,
                          bool is_mirrored)
{
    const size_t vertices = g->out->vertices - first, count = mode == TRIANGLES ? corners / 3
                                                              : corners < 3     ? 0
                                                                                : corners - 2;
    for (size_t n = 0; n < count; n++) {
        size_t place[3];
        uint32_t corner[3];
        corners_of(mode, n, place);
        for (int k = 0; k < 3; k++) {
            const double at = index ? index[place[k]] : (double)place[k];
            if (!(at < (double)vertices)) return damaged(g, "a corner is not a vertex, in triangle", n);
            corner[k] = (uint32_t)(first + (size_t)at);
        }
        if (!plain_mesh_add_triangle(g->out, corner[0], corner[1], corner[2], is_mirrored))
            return no_memory(g);
    }
    return true;
}

static bool add_vertices(gltf *g, const double *position, size_t count, const double m[3][4])
{
    for (size_t k = 0; k < count; k++) {
        const vec3 at = affine_apply(m, position[3 * k], position[3 * k + 1], position[3 * k + 2]);
        if (!plain_mesh_add_vertex(g->out, (const double[3]){at.x, at.y, at.z})) return no_memory(g);
    }
    return true;
}

/* Sets values of the vertices from `first` on to the numbers of an accessor. Normals are transformed by the cofactor
 * matrix of m. Unless textures are read, colours are converted from linear light to sRGB, and coordinates to v upwards. */
static bool add_values(gltf *g, double accessor, const char *name, mesh_values_kind kind, size_t first,
                       const double m[3][4])
{
    const json *node = item_at(&g->accessors, accessor);
    const char *type = kind == MESH_VALUES_UV ? "VEC2" : "VEC3";
    if (kind == MESH_VALUES_COLOR && node && strcmp(json_string(member(node, "type"), ""), "VEC4") == 0)
        type = "VEC4";
    const size_t components = (size_t)(type[3] - '0'), vertices = g->out->vertices - first;
    size_t count = 0;
    double *number = read_accessor(g, accessor, type, components, &count);
    if (!number) return false;
    const vec3 row[3] = {
        {m[0][0], m[0][1], m[0][2]}, {m[1][0], m[1][1], m[1][2]}, {m[2][0], m[2][1], m[2][2]}};
    plain_values *v = plain_mesh_find_values(g->out, name, kind, kind == MESH_VALUES_COLOR ? 4 : components);
    bool ok = count == vertices || damaged(g, "wrong count of values in accessor", (size_t)accessor);
    for (size_t k = 0; ok && k < vertices; k++) {
        const double *from = number + components * k;
        double value[4] = {from[0], from[1], components > 2 ? from[2] : 0, components > 3 ? from[3] : 1};
        if (kind == MESH_VALUES_UV && !g->out->textures) value[1] = 1 - value[1];
        for (int c = 0; kind == MESH_VALUES_COLOR && !g->out->textures && c < 3; c++)
            value[c] = mesh_textures_encode(value[c]);
        for (int c = 0; kind == MESH_VALUES_NORMAL && c < 3; c++)
            value[c] =
                vec3_dot(vec3_cross(row[(c + 1) % 3], row[(c + 2) % 3]), (vec3){from[0], from[1], from[2]});
        ok = plain_mesh_set_values(g->out, v, first + k, value);
    }
    free(number);
    return ok;
}

/* Adds values of the vertices, if the primitive has the attribute. */
static bool add_attribute(gltf *g, const json *primitive, const char *attribute, const char *name,
                          mesh_values_kind kind, size_t first, const double m[3][4])
{
    json_at attributes = member(primitive, "attributes");
    const double accessor = json_number(json_member(&attributes, attribute), -1);
    return accessor < 0 || add_values(g, accessor, name, kind, first, m);
}

/* Adds the values of the vertices of a primitive, which begin at `first`. */
static bool add_all_values(gltf *g, const json *primitive, size_t first, const double m[3][4])
{
    enum { SETS_MOST = 8 };
    static const struct {
        const char *attribute, *name;
        mesh_values_kind kind;
        int sets; /* most sets, which are numbered; 0: there is one, without a number */
    } kinds[] = {{"COLOR_", "color", MESH_VALUES_COLOR, SETS_MOST},
                 {"TEXCOORD_", "uv", MESH_VALUES_UV, SETS_MOST},
                 {"NORMAL", "normal", MESH_VALUES_NORMAL, 0}};
    const double of = json_number(member(primitive, "material"), -1),
                 material = item_at(&g->materials, of) ? of : (double)g->materials.count,
                 group = (double)g->groups;
    char attribute[32], name[16];
    if (g->out->textures) {
        snprintf(attribute, sizeof attribute, "TEXCOORD_%u", g->uv_set[(size_t)material]);
        if (!add_attribute(g, primitive, attribute, MESH_TEXTURES_UV, MESH_VALUES_UV, first, m) ||
            !add_attribute(g, primitive, "COLOR_0", MESH_TEXTURES_TINT, MESH_VALUES_COLOR, first, m))
            return false;
    }
    for (size_t k = 0; !g->out->textures && k < sizeof kinds / sizeof *kinds; k++)
        for (int set = 0; set == 0 || set < kinds[k].sets; set++) {
            snprintf(attribute, sizeof attribute, kinds[k].sets > 0 ? "%s%d" : "%s", kinds[k].attribute, set);
            snprintf(name, sizeof name, set > 0 ? "%s%d" : "%s", kinds[k].name, set);
            if (!add_attribute(g, primitive, attribute, name, kinds[k].kind, first, m)) return false;
        }
    plain_values *materials = plain_mesh_find_values(g->out, "material", MESH_VALUES_WHOLE, 1),
                 *groups = plain_mesh_find_values(g->out, "group", MESH_VALUES_WHOLE, 1);
    for (size_t k = first; k < g->out->vertices; k++)
        if (!plain_mesh_set_values(g->out, materials, k, &material) ||
            !plain_mesh_set_values(g->out, groups, k, &group))
            return false;
    return true;
}

static bool add_primitive(gltf *g, const json *primitive, const double m[3][4])
{
    if (g->primitives++ == PRIMITIVES_MOST)
        return plain_mesh_refuse(
            g->out, ERROR_INPUT_UNSUPPORTED,
            "its nodes place more than %d primitives. Save it with fewer primitives, or as one mesh.",
            PRIMITIVES_MOST);
    const double mode = json_number(member(primitive, "mode"), TRIANGLES),
                 of = json_number(member(primitive, "indices"), -1);
    json_at attributes = member(primitive, "attributes"), extensions = member(primitive, "extensions");
    const double places = json_number(json_member(&attributes, "POSITION"), -1);
    if (!(mode >= TRIANGLES && mode <= TRIANGLE_FAN)) {
        g->out->others++;
        return true;
    }
    const json *accessor = item_at(&g->accessors, places);
    if (json_member(&extensions, "KHR_draco_mesh_compression").node &&
        (!accessor || !member(accessor, "bufferView").node))
        return leave(g);
    if (places < 0) return true; /* no positions: the primitive is not drawn */
    size_t vertices = 0, corners = 0;
    const size_t first = g->out->vertices;
    double *position = read_positions(g, places, &vertices),
           *index = position && of >= 0 ? read_indices(g, of, &corners) : NULL;
    bool ok = position && (index || of < 0);
    vec3 axis[3];
    for (int k = 0; k < 3; k++) axis[k] = affine_axis(m, k);
    ok = ok && add_vertices(g, position, vertices, m) &&
         (!g->out->keeps_values || add_all_values(g, primitive, first, m)) &&
         add_triangles(g, (int)mode, index, index ? corners : vertices, first,
                       vec3_dot(vec3_cross(axis[0], axis[1]), axis[2]) < 0);
    free(position);
    free(index);
    return ok;
}

static bool has_weight(const json *node)
{
    json_at weights = member(node, "weights");
    bool found = false;
    for (json_at weight = json_first(&weights); weight.node; weight = json_next(&weight))
        found |= json_number(weight, 0) != 0;
    return found;
}

static const double no_transform[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

static bool add_mesh(gltf *g, const json *node, double index, const double m[3][4])
{
    const json *mesh = item_at(&g->meshes, index);
    json_at extensions = member(node, "extensions");
    if (!mesh)
        return damaged(g, "a node refers to a mesh that is missing, number",
                       index >= 0 && index < 1e9 ? (size_t)index : 0);
    json_at primitives = member(mesh, "primitives");
    g->is_in_scene[(size_t)index] = true;
    g->skins += json_number(member(node, "skin"), -1) >= 0;
    g->morphs += member(node, "weights").node ? has_weight(node) : has_weight(mesh);
    g->instances += json_member(&extensions, "EXT_mesh_gpu_instancing").node != NULL;
    /* a skin's joints place the mesh, and not its node (3.7.3.1 of the standard) */
    if (json_number(member(node, "skin"), -1) >= 0) m = no_transform;
    for (json_at primitive = json_first(&primitives); primitive.node; primitive = json_next(&primitive))
        if (!add_primitive(g, primitive.node, m)) return false;
    g->groups++;
    return true;
}

/* Sets the matrix, row-major, of a node's translation t, rotation q and scale s: R diag(s). */
static void compose_trs(const double t[3], const double q[4], const double s[3], double out[16])
{
    const double x = q[0], y = q[1], z = q[2], w = q[3], n = x * x + y * y + z * z + w * w,
                 two = n > 0 ? 2 / n : 0;
    const double r[3][3] = {{1 - two * (y * y + z * z), two * (x * y - z * w), two * (x * z + y * w)},
                            {two * (x * y + z * w), 1 - two * (x * x + z * z), two * (y * z - x * w)},
                            {two * (x * z - y * w), two * (y * z + x * w), 1 - two * (x * x + y * y)}};
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) out[4 * i + k] = r[i][k] * s[k];
        out[4 * i + 3] = t[i];
    }
}

/* Reads `count` numbers. *out is unchanged if there are none. */
static bool read_given(gltf *g, json_at at, double *out, size_t count, const char *what, size_t index)
{
    if (!at.node) return true;
    return (json_size(at) == count && json_numbers(at, out, count) == count) || damaged(g, what, index);
}

static bool read_numbers(gltf *g, const json *node, const char *key, double *out, size_t count, size_t index)
{
    return read_given(g, member(node, key), out, count, "wrong transform of node", index);
}

/* Reads the transform of a node, row-major. */
static bool read_transform(gltf *g, const json *node, size_t index, double out[16])
{
    double columns[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, t[3] = {0, 0, 0},
           q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
    if (!read_numbers(g, node, "matrix", columns, 16, index) ||
        !read_numbers(g, node, "translation", t, 3, index) ||
        !read_numbers(g, node, "rotation", q, 4, index) || !read_numbers(g, node, "scale", s, 3, index))
        return false;
    if (member(node, "matrix").node &&
        (member(node, "translation").node || member(node, "rotation").node || member(node, "scale").node))
        return damaged(g, "a matrix beside a translation, rotation or scale in node", index);
    for (int k = 0; k < 16; k++) out[k] = columns[4 * (k % 4) + k / 4];
    if (!member(node, "matrix").node) compose_trs(t, q, s, out);
    return (out[12] == 0 && out[13] == 0 && out[14] == 0 && out[15] == 1) ||
           damaged(g, "wrong matrix of node", index);
}

/* KHR_node_visibility: a node that is not visible hides the nodes below it. */
static bool is_visible(const json *node)
{
    json_at extensions = member(node, "extensions"),
            visibility = json_member(&extensions, "KHR_node_visibility");
    return json_bool(json_member(&visibility, "visible"), true);
}

static bool visit(gltf *g, double index, const double to_world[3][4], int depth)
{
    const json *node = item_at(&g->nodes, index);
    double own[16] = {0}, m[3][4];
    /* nodes form trees: more visits than nodes mean that a node is its own descendant, or has several
     * parents */
    if (!node || depth > DEEPEST_NODE || g->visited++ >= g->nodes.count)
        return damaged(g, "its nodes are not a tree, at node", node ? (size_t)index : 0);
    if (!is_visible(node)) {
        g->hidden++;
        return true;
    }
    if (!read_transform(g, node, (size_t)index, own)) return false;
    affine_compose(to_world, own, m);
    json_at mesh = member(node, "mesh"), children = member(node, "children");
    if (mesh.node && !add_mesh(g, node, json_number(mesh, -1), (const double(*)[4])m)) return false;
    const size_t count = json_size(children);
    const json **child = calloc(count + 1, sizeof *child);
    if (!child) return no_memory(g);
    json_elements(children, child, count);
    bool ok = true;
    for (size_t k = 0; ok && k < count; k++)
        ok = visit(g, json_number(json_root(child[k]), -1), (const double(*)[4])m, depth + 1);
    free(child);
    return ok;
}

/* Visits the nodes of the scene. Without scenes: the nodes that have no parent. */
static bool visit_scene(gltf *g)
{
    json_at root = json_root(g->root), scenes = json_member(&root, "scenes");
    const double index = json_number(json_member(&root, "scene"), 0);
    if (json_size(scenes) > 0) {
        json_at scene = json_first(&scenes);
        while (scene.node && (double)scene.index < index && index < 1e9) scene = json_next(&scene);
        json_at nodes = json_member(&scene, "nodes");
        bool ok = true;
        for (json_at node = json_first(&nodes); node.node && ok; node = json_next(&node))
            ok = visit(g, json_number(node, -1), no_transform, 0);
        return ok;
    }
    bool *is_below = calloc(g->nodes.count + 1, sizeof *is_below), ok = is_below != NULL;
    for (size_t k = 0; ok && k < g->nodes.count; k++) {
        json_at children = member(g->nodes.item[k], "children");
        for (json_at child = json_first(&children); child.node; child = json_next(&child)) {
            const double below = json_number(child, -1);
            if (item_at(&g->nodes, below)) is_below[(size_t)below] = true;
        }
    }
    if (!is_below) return no_memory(g);
    for (size_t k = 0; ok && k < g->nodes.count; k++)
        if (!is_below[k]) ok = visit(g, (double)k, no_transform, 0);
    free(is_below);
    return ok;
}

/* ---- materials */

/* Decodes the data of a data URI, and adds it as an image. */
static bool add_data_uri(gltf *g, const char *uri, size_t index, const char *name)
{
    buffer b = {0};
    const char *text = strstr(uri, ";base64,");
    if (!text) return damaged(g, "no base64 data in image", index);
    const bool ok = decode(g, text + strlen(";base64,"), "base64 data of image", index, &b) &&
                    plain_textures_add_image(g->out, name, b.data, b.size, &g->image_index[index]);
    free(b.decoded);
    return ok;
}

/* Adds the image of a bufferView. */
static bool add_view(gltf *g, double view, size_t index, const char *name)
{
    const json *of = item_at(&g->views, view);
    const double length = of ? json_number(member(of, "byteLength"), 0) : 0;
    elements e = {.count = length > 0 && length < 1e15 ? (size_t)length : 0, .components = 1, .type = 5121};
    if (e.count == 0) return damaged(g, "no data in image", index);
    if (member(of, "byteStride").node) return damaged(g, "a byteStride in the bufferView of image", index);
    return find_elements(g, view, 0, index, &e) &&
           plain_textures_add_image(g->out, name, e.at, e.count, &g->image_index[index]);
}

/* Adds an image to the textures, once. */
static bool add_image(gltf *g, size_t index)
{
    const json *node = g->images.item[index];
    const char *uri = json_string(member(node, "uri"), NULL);
    char name[MESH_IMAGE_NAME_SIZE];
    size_t length = 0;
    if (g->image_index[index] != MESH_TEXTURES_NONE) return true;
    snprintf(name, sizeof name, "%.200s%s%zu", json_string(member(node, "name"), ""),
             member(node, "name").node ? ", image " : "image ", index);
    if (!uri) return add_view(g, json_number(member(node, "bufferView"), -1), index, name);
    if (strncmp(uri, "data:", 5) == 0) return add_data_uri(g, uri, index, name);
    for (const char *at = uri; *at && length + 1 < sizeof name;) name[length++] = hex_next_of_uri(&at);
    name[length] = 0;
    return plain_textures_add_image(g->out, name, NULL, 0, &g->image_index[index]);
}

static bool read_wrap(gltf *g, json_at mode, size_t material, uint32_t *out)
{
    static const struct {
        double name;
        mesh_wrap wrap;
    } modes[] = {{10497, MESH_WRAP_REPEAT}, {33648, MESH_WRAP_MIRROR}, {33071, MESH_WRAP_CLAMP}};
    for (size_t k = 0; k < sizeof modes / sizeof *modes; k++)
        if (!mode.node || json_number(mode, 0) == modes[k].name) {
            *out = modes[k].wrap;
            return true;
        }
    return damaged(g, "wrong sampler of material", material);
}

/* Reads the number of a set of texture coordinates. */
static bool read_set(gltf *g, json_at at, size_t material)
{
    const double set = json_number(at, -1);
    if (!at.node) return true;
    if (!(set >= 0 && set < 1e6 && set == floor(set)))
        return damaged(g, "wrong texCoord of material", material);
    g->uv_set[material] = (uint32_t)set;
    return true;
}

/* The index of the image of a texture; -1: it has none. An extension may name an image of another format. */
static double source_of(const json *texture)
{
    static const char *const others[] = {"EXT_texture_webp", "KHR_texture_basisu", "MSFT_texture_dds",
                                         "EXT_texture_avif"};
    json_at extensions = member(texture, "extensions");
    double source = json_number(member(texture, "source"), -1);
    for (size_t k = 0; source < 0 && k < sizeof others / sizeof *others; k++) {
        json_at other = json_member(&extensions, others[k]);
        source = json_number(json_member(&other, "source"), -1);
    }
    return source;
}

/* KHR_texture_transform: scale, then rotation, counter-clockwise seen with v downwards, then offset. */
static bool read_texture_transform(gltf *g, json_at at, size_t material, mesh_material *m)
{
    static const char wrong[] = "wrong KHR_texture_transform of material";
    double offset[2] = {0, 0}, scale[2] = {1, 1};
    json_at rotation = json_member(&at, "rotation");
    const double turn = json_number(rotation, rotation.node ? (double)NAN : 0), c = elementary_cos(turn),
                 s = elementary_sin(turn);
    if (!isfinite(turn)) return damaged(g, wrong, material);
    if (!read_given(g, json_member(&at, "offset"), offset, 2, wrong, material) ||
        !read_given(g, json_member(&at, "scale"), scale, 2, wrong, material))
        return false;
    const double m2[2][3] = {{c * scale[0], s * scale[1], offset[0]},
                             {-s * scale[0], c * scale[1], offset[1]}};
    memcpy(m->transform, m2, sizeof m2);
    return read_set(g, json_member(&at, "texCoord"), material);
}

/* Reads a textureInfo. */
static bool read_texture(gltf *g, json_at info, size_t material, mesh_material *m)
{
    const json *texture = item_at(&g->textures, json_number(json_member(&info, "index"), -1));
    json_at extensions = json_member(&info, "extensions"),
            transform = json_member(&extensions, "KHR_texture_transform");
    if (!texture) return damaged(g, "no texture of material", material);
    if (!read_set(g, json_member(&info, "texCoord"), material) ||
        (transform.node && !read_texture_transform(g, transform, material, m)))
        return false;
    const json *sampler = item_at(&g->samplers, json_number(member(texture, "sampler"), -1));
    if (member(texture, "sampler").node && !sampler) return damaged(g, "no sampler of material", material);
    if (sampler && (!read_wrap(g, member(sampler, "wrapS"), material, &m->wrap[0]) ||
                    !read_wrap(g, member(sampler, "wrapT"), material, &m->wrap[1])))
        return false;
    const double source = source_of(texture);
    if (source < 0) {
        plain_textures_warn(g->out, "the texture of material %zu has no image", material);
        return true;
    }
    if (!item_at(&g->images, source)) return damaged(g, "no image of material", material);
    if (!add_image(g, (size_t)source)) return false;
    m->image = g->image_index[(size_t)source];
    return true;
}

/* A white material, in the space of glTF. */
static mesh_material plain_material(void)
{
    mesh_material m = mesh_textures_white();
    memcpy(m.transform, (const double[2][3]){{1, 0, 0}, {0, 1, 0}}, sizeof m.transform);
    m.is_linear = m.is_opaque = true;
    return m;
}

static bool read_material(gltf *g, size_t index)
{
    const json *node = g->materials.item[index];
    json_at extensions = member(node, "extensions"), pbr = member(node, "pbrMetallicRoughness"),
            older = json_member(&extensions, "KHR_materials_pbrSpecularGlossiness");
    mesh_material m = plain_material();
    uint32_t unused;
    const bool is_older = older.node && !json_member(&pbr, "baseColorTexture").node;
    json_at from = is_older ? older : pbr;
    json_at texture = json_member(&from, is_older ? "diffuseTexture" : "baseColorTexture");
    snprintf(m.name, sizeof m.name, "%.200s", json_string(member(node, "name"), ""));
    const char *mode = json_string(member(node, "alphaMode"), member(node, "alphaMode").node ? "" : "OPAQUE");
    m.is_opaque = strcmp(mode, "OPAQUE") == 0;
    if (!m.is_opaque && strcmp(mode, "MASK") != 0 && strcmp(mode, "BLEND") != 0)
        return damaged(g, "wrong alphaMode of material", index);
    return read_given(g, json_member(&from, is_older ? "diffuseFactor" : "baseColorFactor"), m.factor, 4,
                      "wrong factor of material", index) &&
           (!texture.node || read_texture(g, texture, index, &m)) &&
           plain_textures_add_material(g->out, &m, &unused);
}

/* Reads all materials; the last one is that of primitives without a material. */
static bool read_materials(gltf *g)
{
    const mesh_material last = plain_material();
    uint32_t unused;
    if (!list_items(g, "textures", &g->textures) || !list_items(g, "images", &g->images) ||
        !list_items(g, "samplers", &g->samplers))
        return false;
    g->image_index = malloc((g->images.count + 1) * sizeof *g->image_index);
    g->uv_set = calloc(g->materials.count + 1, sizeof *g->uv_set);
    if (!g->image_index || !g->uv_set) return no_memory(g);
    for (size_t k = 0; k < g->images.count; k++) g->image_index[k] = MESH_TEXTURES_NONE;
    for (size_t k = 0; k < g->materials.count; k++)
        if (!read_material(g, k)) return false;
    return g->materials.count == 0 || plain_textures_add_material(g->out, &last, &unused);
}

/* ---- the document */

/* Whether an extension is read, or does not change positions of the mesh. */
static bool is_known(const char *extension)
{
    static const char *const known[] = {"KHR_mesh_quantization",
                                        "KHR_texture_transform",
                                        "KHR_texture_basisu",
                                        "KHR_lights_punctual",
                                        "KHR_xmp_json_ld",
                                        "KHR_xmp",
                                        "KHR_draco_mesh_compression",
                                        "EXT_texture_webp",
                                        "EXT_texture_avif",
                                        "KHR_animation_pointer",
                                        "KHR_node_visibility",
                                        "MSFT_texture_dds",
                                        "EXT_mesh_features",
                                        "EXT_structural_metadata",
                                        "EXT_instance_features",
                                        "EXT_lights_ies",
                                        "EXT_lights_image_based"};
    for (size_t k = 0; k < sizeof known / sizeof *known; k++)
        if (strcmp(extension, known[k]) == 0) return true;
    return strncmp(extension, "KHR_materials_", strlen("KHR_materials_")) == 0;
}

/* Extensions that the file uses and that have warnings of their own, or whose fallback is read. */
static bool is_warned(const char *extension)
{
    return strcmp(extension, "EXT_mesh_gpu_instancing") == 0 ||
           strcmp(extension, "EXT_meshopt_compression") == 0;
}

/* Names the extensions that are not known: they may move or replace parts of the mesh. */
static void warn_of_extensions(gltf *g)
{
    json_at root = json_root(g->root), used = json_member(&root, "extensionsUsed");
    for (json_at extension = json_first(&used); extension.node; extension = json_next(&extension)) {
        const char *name = json_string(extension, "");
        if (!is_known(name) && !is_warned(name))
            plain_mesh_warn(g->out,
                            "the glTF extension %.80s is not read: if it changes positions, they are wrong",
                            name);
    }
}

static bool refuse_first(plain_mesh *m)
{
    return plain_mesh_refuse(
        m, ERROR_INPUT_UNSUPPORTED,
        "it is glTF 1.0, which is not read. Convert it to glTF 2.0 (gltf-pipeline -i FILE -o FILE.glb).");
}

static bool check_document(gltf *g)
{
    json_at root = json_root(g->root), asset = json_member(&root, "asset"),
            required = json_member(&root, "extensionsRequired");
    const char *version = json_string(json_member(&asset, "version"), ""),
               *least = json_string(json_member(&asset, "minVersion"), "2.0");
    if (version[0] == '1') return refuse_first(g->out);
    if (version[0] != '2' || strcmp(least, "2.0") != 0)
        return plain_mesh_refuse(g->out, ERROR_INPUT_UNSUPPORTED,
                                 "it requires glTF %.20s. Save it as glTF 2.0.",
                                 version[0] != '2' ? version : least);
    for (json_at extension = json_first(&required); extension.node; extension = json_next(&extension)) {
        const char *name = json_string(extension, "");
        if (!is_known(name))
            return plain_mesh_refuse(
                g->out, ERROR_INPUT_UNSUPPORTED,
                "it requires the glTF extension %.80s, which is not supported. Save it without this "
                "extension.",
                name);
    }
    return true;
}

static void warn(gltf *g)
{
    size_t left = 0;
    for (size_t k = 0; k < g->meshes.count; k++) left += !g->is_in_scene[k];
    if (left > 0)
        plain_mesh_warn(g->out, "%zu of %zu meshes are not in the scene of the file: they are skipped", left,
                        g->meshes.count);
    if (g->hidden > 0)
        plain_mesh_warn(
            g->out, "%zu nodes are not visible (KHR_node_visibility): they and the nodes below are skipped",
            g->hidden);
    if (g->skins > 0)
        plain_mesh_warn(g->out,
                        "%zu meshes have a skin, which is not applied: export the posed mesh to sample it",
                        g->skins);
    warn_of_extensions(g);
    if (g->morphs > 0)
        plain_mesh_warn(g->out,
                        "%zu meshes have weights of morph targets, which are not applied: export the morphed "
                        "mesh to sample it",
                        g->morphs);
    if (g->instances > 0)
        plain_mesh_warn(g->out, "%zu meshes have instances (EXT_mesh_gpu_instancing): one of each is read",
                        g->instances);
}

static bool read_document(gltf *g)
{
    bool ok = check_document(g) && list_items(g, "nodes", &g->nodes) && list_items(g, "meshes", &g->meshes) &&
              list_items(g, "accessors", &g->accessors) && list_items(g, "bufferViews", &g->views) &&
              list_items(g, "buffers", &g->buffers) && list_items(g, "materials", &g->materials);
    if (ok) {
        g->loaded = calloc(g->buffers.count + 1, sizeof *g->loaded);
        g->is_in_scene = calloc(g->meshes.count + 1, sizeof *g->is_in_scene);
        ok = (g->loaded && g->is_in_scene) || no_memory(g);
    }
    ok = ok && (!g->out->textures || read_materials(g)) && visit_scene(g);
    if (ok) warn(g);
    for (size_t k = 0; g->loaded && k < g->buffers.count; k++) free(g->loaded[k].decoded);
    free(g->loaded);
    free(g->is_in_scene);
    free(g->nodes.item);
    free(g->meshes.item);
    free(g->accessors.item);
    free(g->views.item);
    free(g->buffers.item);
    free(g->materials.item);
    free(g->textures.item);
    free(g->images.item);
    free(g->samplers.item);
    free(g->image_index);
    free(g->uv_set);
    return ok;
}

static uint32_t word_at(const char *at)
{
    uint32_t bits;
    memcpy(&bits, at, sizeof bits);
    return le32toh(bits);
}

/* Finds the two parts of a binary file. False: the file is refused. */
static bool split(const char *data, size_t size, const char **text, size_t *length, gltf *g)
{
    if (size < HEAD + CHUNK_HEAD || word_at(data + 4) != 2 || word_at(data + HEAD + 4) != CHUNK_JSON ||
        word_at(data + HEAD) > size - HEAD - CHUNK_HEAD)
        return damaged(g, "its header or its first chunk is wrong, at byte", size < HEAD ? size : HEAD);
    *text = data + HEAD + CHUNK_HEAD;
    *length = word_at(data + HEAD);
    const char *bin = *text + *length;
    const size_t left = size - (size_t)(bin - data);
    if (left < CHUNK_HEAD || word_at(bin + 4) != CHUNK_BIN) return true;
    g->bin_size = word_at(bin);
    g->bin = bin + CHUNK_HEAD;
    return g->bin_size <= left - CHUNK_HEAD || damaged(g, "it is truncated, at byte", size);
}

bool plain_mesh_read_gltf(const char *data, size_t size, plain_mesh *out)
{
    gltf g = {.out = out};
    error e = {0};
    const char *text = data;
    size_t length = size;
    const bool is_binary = size >= MAGIC_BYTES && memcmp(data, "glTF", MAGIC_BYTES) == 0;
    if (is_binary && size >= HEAD && word_at(data + MAGIC_BYTES) == 1) return refuse_first(out);
    if (is_binary && !split(data, size, &text, &length, &g)) return false;
    /* remove padding */
    while (length > 0 && (text[length - 1] == ' ' || text[length - 1] == 0)) length--;
    g.root = json_parse(text, length, &e);
    if (!g.root) return plain_mesh_refuse(out, ERROR_INPUT_DAMAGED, "its JSON is damaged: %.300s", e.message);
    const bool ok = read_document(&g);
    json_free(g.root);
    return ok;
}
