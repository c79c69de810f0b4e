// SPDX-License-Identifier: Apache-2.0
#include "io/points/glb.h"

#include <ctype.h>
#include <endian.h>
#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/memory.h"
#include "io/points/colormap.h"
#include "io/points/property.h"
#include "base/json/json.h"

#define MAGIC 0x46546C67u /* "glTF" */
#define CHUNK_JSON 0x4E4F534Au
#define CHUNK_BIN 0x004E4942u
enum {
    VERSION_2 = 2,
    FLOAT_NUMBERS = 5126,
    VERTICES = 34962,
    POINTS_MODE = 0,
    HEAD_WORDS = 3,
    CHUNK_WORDS = 2
};

/* glTF has floats for attributes, which represent integers exactly up to this value. */
static const double most_whole = 16777216;

/* The distinct values of integers that floats do not represent, ascending. The attribute then has the index
 * of each value in this table, which is stored in `extras` of the primitive under the name of the
 * attribute. */
typedef struct table {
    size_t count; /* 0: the attribute has the values themselves */
    double *value;
} table;

/* The properties of the set, with their names in the file. */
typedef struct arrays {
    size_t count, points;
    property *list;
    char (*name)[80];
    table *tables;
} arrays;

static void name_array(const property *p, char name[80])
{
    static const char *const own[] = {[PROPERTY_POSITION] = "POSITION",
                                      [PROPERTY_NORMAL] = "NORMAL",
                                      [PROPERTY_COLOR] = "COLOR_0",
                                      [PROPERTY_UV] = "TEXCOORD_0"};
    if (p->role != PROPERTY_OTHER && p->role <= PROPERTY_UV) {
        strcpy(name, own[p->role]);
        return;
    }
    snprintf(name, 80, "_%s", p->name);
    for (char *c = name; *c; c++) *c = (char)toupper((unsigned char)*c);
}

static table make_table(const property *p, size_t rows)
{
    table t = {0};
    if (p->largest <= most_whole) return t;
    const size_t all = rows * (size_t)p->components;
    t.value = mem_alloc(all * sizeof *t.value);
    for (size_t k = 0; k < all; k++)
        t.value[k] = property_value(p, k / (size_t)p->components, (int)(k % (size_t)p->components));
    qsort(t.value, all, sizeof *t.value, compare_doubles);
    for (size_t k = 0; k < all; k++)
        if (t.count == 0 || t.value[k] != t.value[t.count - 1]) t.value[t.count++] = t.value[k];
    return t;
}

static arrays list_arrays(const points *set)
{
    arrays a = {.points = set->count};
    a.list = mem_alloc((PROPERTIES_OWN + set->attribute_count) * sizeof *a.list);
    a.count = property_list(set, a.list);
    a.name = mem_alloc(a.count * sizeof *a.name);
    a.tables = mem_alloc(a.count * sizeof *a.tables);
    for (size_t k = 0; k < a.count; k++) {
        name_array(&a.list[k], a.name[k]);
        a.tables[k] = make_table(&a.list[k], set->count);
    }
    return a;
}

static void free_arrays(arrays *a)
{
    for (size_t k = 0; k < a->count; k++) free(a->tables[k].value);
    free(a->list);
    free(a->name);
    free(a->tables);
}

/* A number as stored: positions relative to the origin; normals are unit vectors in single precision; colors
 * in linear light. */
static float number(const arrays *a, size_t k, vec3 origin, size_t point, int c)
{
    const property *p = &a->list[k];
    const table *t = &a->tables[k];
    double value = property_value(p, point, c);
    if (p->role == PROPERTY_POSITION) value -= vec3_get(origin, c);
    if (t->count > 0)
        value = (double)((const double *)bsearch(&value, t->value, t->count, sizeof value, compare_doubles) -
                         t->value);
    if (p->role == PROPERTY_COLOR) value = colormap_linear(fmin(fmax(value, 0), 1));
    return (float)value;
}

static const char *type_of(int components)
{
    static const char *const types[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    return types[components - 1];
}

static void put_bounds(json *accessor, const arrays *a, size_t k, vec3 origin)
{
    json *least = json_put_array(accessor, "min"), *most = json_put_array(accessor, "max");
    for (int c = 0; c < a->list[k].components; c++) {
        float low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < a->points; i++) {
            low = fminf(low, number(a, k, origin, i, c));
            high = fmaxf(high, number(a, k, origin, i, c));
        }
        json_append_number(least, (double)low);
        json_append_number(most, (double)high);
    }
}

/* Adds the nodes. Translation and rotation have separate nodes: the translation is in the axes of the set,
 * and the node above rotates these. */
static void put_scene(json *root, const scene *place)
{
    static const double from_z[] = {-M_SQRT1_2, 0, 0, M_SQRT1_2}; /* a quarter turn about x */
    const bool is_moved = vec3_norm(place->origin) > 0;
    json *asset = json_put_object(root, "asset");
    json_put_string(asset, "version", "2.0");
    json_put_string(asset, "generator", "hexad");
    json_put_integer(root, "scene", 0);
    json *top = json_put_array(json_append_object(json_put_array(root, "scenes")), "nodes");
    json *nodes = json_put_array(root, "nodes"), *node = json_append_object(nodes);
    json_put_integer(node, "mesh", 0);
    json_put_string(node, "name", "points");
    json *translation = is_moved ? json_put_array(node, "translation") : NULL;
    for (int k = 0; is_moved && k < 3; k++) json_append_number(translation, vec3_get(place->origin, k));
    json_append_number(top, is_moved && !place->y_up ? 1 : 0);
    if (place->y_up) return;
    if (is_moved) {
        node = json_append_object(nodes);
        json_append_number(json_put_array(node, "children"), 0);
    }
    json *rotation = json_put_array(node, "rotation");
    for (int k = 0; k < 4; k++) json_append_number(rotation, from_z[k]);
}

static void put_tables(json *primitive, const arrays *a)
{
    json *extras = NULL;
    for (size_t k = 0; k < a->count; k++) {
        const table *t = &a->tables[k];
        if (t->count == 0) continue;
        if (!extras) extras = json_put_object(primitive, "extras");
        json *values = json_put_array(extras, a->name[k]);
        for (size_t i = 0; i < t->count; i++) json_append_number(values, t->value[i]);
    }
}

static json *describe(const arrays *a, const scene *place, size_t *bytes)
{
    json *root = json_new_object();
    put_scene(root, place);
    json *primitive =
        json_append_object(json_put_array(json_append_object(json_put_array(root, "meshes")), "primitives"));
    json_put_integer(primitive, "mode", POINTS_MODE);
    json *attributes = json_put_object(primitive, "attributes");
    json *views = json_new_array(), *accessors = json_new_array();
    *bytes = 0;
    for (size_t k = 0; k < a->count; k++) {
        const property *p = &a->list[k];
        json *view = json_append_object(views), *accessor = json_append_object(accessors);
        size_t length = a->points * (size_t)p->components * sizeof(float);
        json_put_integer(attributes, a->name[k], (int64_t)k);
        json_put_integer(view, "buffer", 0);
        json_put_integer(view, "byteOffset", (int64_t)*bytes);
        json_put_integer(view, "byteLength", (int64_t)length);
        json_put_integer(view, "target", VERTICES);
        json_put_integer(accessor, "bufferView", (int64_t)k);
        json_put_integer(accessor, "componentType", FLOAT_NUMBERS);
        json_put_integer(accessor, "count", (int64_t)a->points);
        json_put_string(accessor, "type", type_of(p->components));
        if (p->role == PROPERTY_POSITION) put_bounds(accessor, a, k, place->origin);
        *bytes += length;
    }
    put_tables(primitive, a);
    json_put_integer(json_append_object(json_put_array(root, "buffers")), "byteLength", (int64_t)*bytes);
    json_put(root, "bufferViews", views);
    json_put(root, "accessors", accessors);
    return root;
}

static bool write_words(FILE *file, const uint32_t *words, size_t count)
{
    bool good = true;
    for (size_t k = 0; k < count; k++) {
        uint32_t little = htole32(words[k]);
        good = good && fwrite(&little, sizeof little, 1, file) == 1;
    }
    return good;
}

static bool write_numbers(FILE *file, const arrays *a, vec3 origin)
{
    bool good = true;
    for (size_t k = 0; k < a->count; k++)
        for (size_t i = 0; good && i < a->points; i++)
            for (int c = 0; c < a->list[k].components; c++) {
                float value = number(a, k, origin, i, c);
                uint32_t bits;
                memcpy(&bits, &value, sizeof bits);
                good = good && write_words(file, &bits, 1);
            }
    return good;
}

bool glb_write(FILE *file, const points *set, const scene *place, error *e)
{
    arrays a = list_arrays(set);
    size_t bytes;
    json *root = describe(&a, place, &bytes);
    char *text = json_print(root);
    size_t length = strlen(text), padded = (length + 3) & ~(size_t)3;
    size_t whole = 4 * (HEAD_WORDS + 2 * CHUNK_WORDS) + padded + bytes;
    bool good =
        whole <= UINT32_MAX ||
        error_set(e, ERROR_NOT_SUPPORTED, "glb: %zu bytes exceed the format: ask for fewer points", whole);
    if (good) {
        const uint32_t head[] = {MAGIC, VERSION_2, (uint32_t)whole, (uint32_t)padded, CHUNK_JSON};
        const uint32_t chunk[] = {(uint32_t)bytes, CHUNK_BIN};
        good = write_words(file, head, 5) && fwrite(text, 1, length, file) == length &&
               fwrite("   ", 1, padded - length, file) == padded - length && write_words(file, chunk, 2) &&
               write_numbers(file, &a, place->origin) && fflush(file) == 0;
        if (!good)
            error_set(e, error_code_of_errno(errno), "cannot write the glTF file: %s", strerror(errno));
    }
    free(text);
    json_free(root);
    free_arrays(&a);
    return good;
}
