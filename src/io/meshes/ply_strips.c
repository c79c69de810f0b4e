// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/ply_strips.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/ply_header.h"

enum { LINE_MOST = 256, TEXT_TRIANGLE = 40, BINARY_TRIANGLE = 13 };

/* The strips, if they are the last element of the file and the elements before them have a known size;
 * else NULL. */
static const ply_element *find_strips(const ply_header *h)
{
    if (h->elements == 0) return NULL;
    const ply_element *last = &h->element[h->elements - 1];
    if (strcmp(last->name, "tristrips") != 0 || last->properties != 1 || !last->has_list ||
        number_bytes(last->property->type->number) != 4)
        return NULL;
    for (const ply_element *before = h->element; before < last; before++)
        if (before->has_list || strcmp(before->name, "tristrips") == 0) return NULL;
    return last;
}

typedef struct cursor {
    const char *at, *end;
    ply_layout layout;
} cursor;

static bool read_number(cursor *c, int size, int64_t *out)
{
    if (c->layout == PLY_TEXT) {
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
    for (int k = 0; k < size; k++)
        value = value << 8 | (uint8_t)c->at[c->layout == PLY_BIG ? k : size - 1 - k];
    c->at += size;
    *out = size == 4 ? (int64_t)(int32_t)value : (int64_t)value;
    return true;
}

static char *write_triangle(char *to, ply_layout as, const int64_t corner[3])
{
    if (as == PLY_TEXT)
        return to + sprintf(to, "3 %d %d %d\n", (int)corner[0], (int)corner[1], (int)corner[2]);
    *to++ = 3;
    for (int k = 0; k < 12; k++) {
        int shift = 8 * (as == PLY_BIG ? 3 - k % 4 : k % 4);
        *to++ = (char)((uint32_t)corner[k / 4] >> shift & 0xFF);
    }
    return to;
}

/* Writes the triangles where `to` is not NULL. Returns how many; SIZE_MAX: the data end early, or are not
 * numbers. */
static size_t expand(const ply_element *strips, cursor c, char *to)
{
    size_t count = 0;
    for (uint64_t strip = 0; strip < strips->count; strip++) {
        int64_t length, v[3] = {0, 0, 0};
        if (!read_number(&c, (int)number_bytes(strips->property->length->number), &length)) return SIZE_MAX;
        for (int64_t k = 0, held = 0; k < length; k++) {
            int64_t next;
            if (!read_number(&c, 4, &next) || next < -1 || next > INT32_MAX) return SIZE_MAX;
            held = next < 0 ? 0 : held + 1;
            v[0] = v[1];
            v[1] = v[2];
            v[2] = next;
            if (held < 3) continue;
            const int64_t turned[3] = {v[1], v[0], v[2]}; /* every second one runs the other way */
            if (to) to = write_triangle(to, c.layout, held % 2 ? v : turned);
            count++;
        }
    }
    return count;
}

/* Where the strips' data begin; NULL: beyond the end. */
static const char *find_data(const ply_header *h, const char *data, size_t size)
{
    const char *at = data + h->body, *end = data + size;
    for (int k = 0; k + 1 < h->elements; k++) {
        const ply_element *element = &h->element[k];
        if (h->layout != PLY_TEXT) {
            if (element->row && element->count > (uint64_t)(end - at) / element->row) return NULL;
            at += element->count * element->row;
        }
        for (uint64_t row = 0; at && h->layout == PLY_TEXT && row < element->count; row++) {
            at = memchr(at, '\n', (size_t)(end - at));
            if (at) at++;
        }
        if (!at) return NULL;
    }
    return at;
}

ply_strips ply_strips_expand(char **data, size_t *size)
{
    ply_header h;
    const ply_element *strips = ply_header_read(*data, *size, &h) ? find_strips(&h) : NULL;
    if (!strips) return PLY_STRIPS_READ;
    const char *from = find_data(&h, *data, *size);
    if (!from) return PLY_STRIPS_DAMAGED;
    const cursor c = {from, *data + *size, h.layout};
    size_t count = expand(strips, c, NULL), before = (size_t)(from - *data) - h.body;
    if (count == SIZE_MAX) return PLY_STRIPS_DAMAGED;
    char *out = malloc(strips->line + LINE_MOST + before + count * TEXT_TRIANGLE + 1), *to = out;
    if (!out) return PLY_STRIPS_NO_MEMORY;
    memcpy(to, *data, strips->line);
    to += strips->line;
    to += sprintf(to, "element face %zu\nproperty list uchar int vertex_indices\nend_header\n", count);
    memcpy(to, *data + h.body, before);
    to += before;
    *to = 0; /* a file of no triangle */
    expand(strips, c, to);
    *size = (size_t)(to - out) + (h.layout == PLY_TEXT ? strlen(to) : count * BINARY_TRIANGLE);
    free(*data);
    *data = out;
    return PLY_STRIPS_READ;
}
