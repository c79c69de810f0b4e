#include "mesh/ply_strips.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LINE_MOST = 256, TEXT_TRIANGLE = 40, BINARY_TRIANGLE = 13 };
typedef enum layout { TEXT, LITTLE, BIG } layout;

/* What the header says, as far as strips need it. */
typedef struct header {
    layout layout;
    size_t body;            /* where the data begin */
    size_t strips_line;     /* where "element tristrips" begins */
    uint64_t strips, rows;  /* strips; rows of the elements before them */
    uint64_t bytes, count;  /* of the data before the strips, when binary; rows of the element at hand */
    int length_size, lists; /* of the number that begins a strip; lists among the strips' properties */
    bool is_last, known;    /* the strips are the last element; nothing strange was met */
} header;

static int size_of(const char *type)
{
    static const struct {
        const char *name;
        int size;
    } types[] = {{"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},  {"short", 2}, {"ushort", 2},
                 {"int16", 2}, {"uint16", 2},  {"int", 4},    {"uint", 4},   {"int32", 4}, {"uint32", 4},
                 {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
    for (size_t k = 0; k < sizeof types / sizeof *types; k++)
        if (strcmp(type, types[k].name) == 0) return types[k].size;
    return 0;
}

static void take_element(header *h, const char *name, uint64_t count, size_t at)
{
    if (h->strips_line) h->is_last = false;
    if (strcmp(name, "tristrips") == 0 && !h->strips_line) {
        h->strips_line = at;
        h->strips = count;
        h->is_last = true;
        return;
    }
    h->rows += count;
    h->count = count;
}

static void take_property(header *h, const char *first, const char *second, const char *third)
{
    bool list = strcmp(first, "list") == 0;
    if (h->strips_line) {
        h->length_size = list ? size_of(second) : 0;
        h->known = h->known && list && ++h->lists == 1 && h->length_size && size_of(third) == 4;
    } else if (list || !size_of(first)) {
        h->known = false;
    } else {
        h->bytes += h->count * (uint64_t)size_of(first);
    }
}

/* False: the header does not end. */
static bool read_header(const char *data, size_t size, header *h)
{
    *h = (header){.known = true};
    for (size_t at = 0; at < size;) {
        const char *end = memchr(data + at, '\n', size - at);
        size_t length = end ? (size_t)(end - data) - at : 0;
        char line[LINE_MOST], word[4][32] = {"", "", "", ""};
        unsigned long long count = 0;
        if (!end) return false;
        snprintf(line, sizeof line, "%.*s", (int)(length < sizeof line ? length : sizeof line - 1),
                 data + at);
        sscanf(line, "%31s %31s %31s %31s", word[0], word[1], word[2], word[3]);
        if (strcmp(word[0], "format") == 0)
            h->layout = strcmp(word[1], "ascii") == 0 ? TEXT : strstr(word[1], "big") ? BIG : LITTLE;
        else if (strcmp(word[0], "element") == 0 && sscanf(word[2], "%llu", &count) == 1)
            take_element(h, word[1], count < UINT32_MAX ? count : UINT32_MAX, at);
        else if (strcmp(word[0], "property") == 0)
            take_property(h, word[1], word[2], word[3]);
        at += length + 1;
        if (strcmp(word[0], "end_header") == 0) {
            h->body = at;
            return true;
        }
    }
    return false;
}

typedef struct cursor {
    const char *at, *end;
    layout layout;
} cursor;

static bool read_number(cursor *c, int size, int64_t *out)
{
    if (c->layout == TEXT) {
        char word[24];
        size_t length = 0;
        while (c->at < c->end && strchr(" \t\r\n", *c->at) && *c->at) c->at++;
        while (c->at < c->end && !(strchr(" \t\r\n", *c->at) && *c->at) && length + 1 < sizeof word)
            word[length++] = *c->at++;
        word[length] = 0;
        char *rest;
        *out = strtoll(word, &rest, 10);
        return length > 0 && !*rest;
    }
    uint32_t value = 0;
    if (c->end - c->at < size || size > 4) return false;
    for (int k = 0; k < size; k++) value = value << 8 | (uint8_t)c->at[c->layout == BIG ? k : size - 1 - k];
    c->at += size;
    *out = size == 4 ? (int64_t)(int32_t)value : (int64_t)value;
    return true;
}

static char *write_triangle(char *to, layout as, const int64_t corner[3])
{
    if (as == TEXT) return to + sprintf(to, "3 %d %d %d\n", (int)corner[0], (int)corner[1], (int)corner[2]);
    *to++ = 3;
    for (int k = 0; k < 12; k++) {
        int shift = 8 * (as == BIG ? 3 - k % 4 : k % 4);
        *to++ = (char)((uint32_t)corner[k / 4] >> shift & 0xFF);
    }
    return to;
}

/* Writes the triangles where `to` is not NULL. Returns how many; SIZE_MAX: the data end early, or are no numbers. */
static size_t expand(const header *h, cursor c, char *to)
{
    size_t count = 0;
    for (uint64_t strip = 0; strip < h->strips; strip++) {
        int64_t length, v[3] = {0, 0, 0};
        if (!read_number(&c, h->length_size, &length)) return SIZE_MAX;
        for (int64_t k = 0, held = 0; k < length; k++) {
            int64_t next;
            if (!read_number(&c, 4, &next) || next < -1 || next > INT32_MAX) return SIZE_MAX;
            held = next < 0 ? 0 : held + 1;
            v[0] = v[1];
            v[1] = v[2];
            v[2] = next;
            if (held < 3) continue;
            const int64_t turned[3] = {v[1], v[0], v[2]}; /* every second one runs the other way */
            if (to) to = write_triangle(to, h->layout, held % 2 ? v : turned);
            count++;
        }
    }
    return count;
}

/* Where the strips' data begin; NULL: beyond the end. */
static const char *find_strips(const header *h, const char *data, size_t size)
{
    const char *at = data + h->body, *end = data + size;
    if (h->layout != TEXT) return h->bytes <= (uint64_t)(end - at) ? at + h->bytes : NULL;
    for (uint64_t k = 0; at && k < h->rows; k++) {
        at = memchr(at, '\n', (size_t)(end - at));
        if (at) at++;
    }
    return at;
}

ply_strips ply_strips_expand(char **data, size_t *size)
{
    header h;
    if (*size < 4 || memcmp(*data, "ply", 3) != 0 || !read_header(*data, *size, &h) || !h.strips_line ||
        !h.is_last || !h.known || h.lists != 1)
        return PLY_STRIPS_READ;
    const char *strips = find_strips(&h, *data, *size);
    if (!strips) return PLY_STRIPS_DAMAGED;
    const cursor c = {strips, *data + *size, h.layout};
    size_t count = expand(&h, c, NULL), before = (size_t)(strips - *data) - h.body;
    if (count == SIZE_MAX) return PLY_STRIPS_DAMAGED;
    char *out = malloc(h.strips_line + LINE_MOST + before + count * TEXT_TRIANGLE + 1), *to = out;
    if (!out) return PLY_STRIPS_NO_MEMORY;
    memcpy(to, *data, h.strips_line);
    to += h.strips_line;
    to += sprintf(to, "element face %zu\nproperty list uchar int vertex_indices\nend_header\n", count);
    memcpy(to, *data + h.body, before);
    to += before;
    *to = 0; /* a file of no triangle */
    expand(&h, c, to);
    *size = (size_t)(to - out) + (h.layout == TEXT ? strlen(to) : count * BINARY_TRIANGLE);
    free(*data);
    *data = out;
    return PLY_STRIPS_READ;
}
