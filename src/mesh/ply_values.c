#include "mesh/ply_values.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LINE_MOST = 256, PROPERTIES_MOST = 256 };
typedef enum layout { TEXT, LITTLE, BIG } layout;

static const struct type {
    const char *name;
    int size;
    enum { SIGNED, UNSIGNED, REAL } kind;
} types[] = {{"char", 1, SIGNED},  {"uchar", 1, UNSIGNED},  {"int8", 1, SIGNED},  {"uint8", 1, UNSIGNED},
             {"short", 2, SIGNED}, {"ushort", 2, UNSIGNED}, {"int16", 2, SIGNED}, {"uint16", 2, UNSIGNED},
             {"int", 4, SIGNED},   {"uint", 4, UNSIGNED},   {"int32", 4, SIGNED}, {"uint32", 4, UNSIGNED},
             {"float", 4, REAL},   {"float32", 4, REAL},    {"double", 8, REAL},  {"float64", 8, REAL}};

/* What the library makes of places, colours and texture coordinates. */
static const char known[] = " x y z nx ny nz red green blue alpha r g b a s t u v texture_u texture_v ";

/* The header, as far as vertices need it. */
typedef struct header {
    layout layout;
    size_t body, vertices, row; /* bytes of a binary row */
    int count;
    const struct type *type[PROPERTIES_MOST];
    int slot[PROPERTIES_MOST]; /* in the answer, or -1 */
} header;

static const struct type *find_type(const char *name)
{
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (strcmp(types[k].name, name) == 0) return &types[k];
    return NULL;
}

static bool take_property(header *h, const char *type, const char *name, ply_values *out)
{
    char word[MESH_VALUES_NAME_SIZE + 2];
    if (h->count == PROPERTIES_MOST || !(h->type[h->count] = find_type(type))) return false;
    h->row += (size_t)h->type[h->count]->size;
    snprintf(word, sizeof word, " %s ", name);
    bool wanted = !strstr(known, word) && out->count < MESH_VALUES_MOST;
    h->slot[h->count++] = wanted ? (int)out->count : -1;
    if (wanted) snprintf(out->name[out->count++], sizeof out->name[0], "%s", name);
    return true;
}

/* Whether the header is one that is read here; it ends before *body. */
static bool read_header(const char *data, size_t size, header *h, ply_values *out)
{
    bool in_vertices = false, is_ply = false;
    for (size_t at = 0; at < size;) {
        const char *end = memchr(data + at, '\n', size - at);
        char line[LINE_MOST] = "", first[64] = "", second[64] = "", third[64] = "";
        if (!end || (size_t)(end - data) - at >= sizeof line) return false;
        memcpy(line, data + at, (size_t)(end - data) - at);
        at = (size_t)(end - data) + 1;
        int words = sscanf(line, "%63s %63s %63s", first, second, third);
        if (!is_ply && strcmp(first, "ply") != 0) return false;
        is_ply = true;
        if (strcmp(first, "end_header") == 0) {
            h->body = at;
            return h->vertices > 0 && h->count > 0;
        }
        if (strcmp(first, "format") == 0)
            h->layout = strcmp(second, "ascii") == 0                  ? TEXT
                        : strcmp(second, "binary_little_endian") == 0 ? LITTLE
                                                                      : BIG;
        if (strcmp(first, "element") == 0) {
            in_vertices = strcmp(second, "vertex") == 0;
            if (!in_vertices && h->vertices == 0) return false;
            if (in_vertices) h->vertices = strtoull(third, NULL, 10);
        }
        if (strcmp(first, "property") == 0 && in_vertices &&
            (words != 3 || !take_property(h, second, third, out)))
            return false;
    }
    return false;
}

static double number_at(const char *at, const struct type *t, layout order)
{
    unsigned char bytes[8];
    uint64_t bits = 0;
    for (int k = 0; k < t->size; k++) bytes[k] = (unsigned char)at[order == BIG ? k : t->size - 1 - k];
    for (int k = 0; k < t->size; k++) bits = bits << 8 | bytes[k];
    if (t->kind == REAL && t->size == 8) {
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }
    if (t->kind == REAL) {
        uint32_t half = (uint32_t)bits;
        float value;
        memcpy(&value, &half, sizeof value);
        return (double)value;
    }
    uint64_t sign = (uint64_t)1 << (8 * t->size - 1);
    return t->kind == SIGNED && bits & sign ? -(double)(2 * sign - bits) : (double)bits;
}

/* Whether the rows are all there. */
static bool read_rows(const char *data, size_t size, const header *h, ply_values *out)
{
    const char *at = data + h->body, *end = data + size;
    if (h->layout != TEXT && h->vertices > (size - h->body) / h->row) return false;
    for (size_t row = 0; row < h->vertices; row++)
        for (int c = 0; c < h->count; c++) {
            double value;
            if (h->layout == TEXT) {
                char word[64] = "";
                size_t n = 0;
                while (at < end && strchr(" \t\r\n", *at)) at++;
                while (at < end && !strchr(" \t\r\n", *at) && n < sizeof word - 1) word[n++] = *at++;
                if (n == 0) return false;
                value = strtod(word, NULL);
            } else {
                value = number_at(at, h->type[c], h->layout);
                at += h->type[c]->size;
            }
            if (h->slot[c] >= 0) out->value[h->slot[c]][row] = (float)value;
        }
    return true;
}

bool ply_values_read(const char *data, size_t size, ply_values *out)
{
    header h = {0};
    bool good = read_header(data, size, &h, out) && h.vertices <= size; /* of a byte each at least */
    for (uint32_t k = 0; good && k < out->count; k++)
        if (!(out->value[k] = calloc(h.vertices, sizeof(float)))) return false;
    if (good && read_rows(data, size, &h, out))
        out->vertices = h.vertices;
    else
        out->count = 0;
    return true;
}
