// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/ply_strips.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/ply_rows.h"

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

typedef struct strip {
    ply_rows rows;
    int64_t v[3], held; /* the last vertices, and how many of them follow one another */
    size_t triangles;
    char *to; /* of the triangles, or NULL */
} strip;

static bool take_vertex(void *context, size_t k, double number)
{
    strip *s = context;
    int64_t *v = s->v;
    if (number == UINT32_MAX) number = -1; /* as an integer without a sign */
    if (!(number >= -1 && number <= INT32_MAX && number == floor(number))) return false;
    v[0] = v[1];
    v[1] = v[2];
    v[2] = (int64_t)number;
    s->held = v[2] < 0 ? 0 : k == 0 ? 1 : s->held + 1;
    if (s->held < 3) return true;
    const int64_t turned[3] = {v[1], v[0], v[2]}; /* every second one runs the other way */
    if (s->to) s->to = write_triangle(s->to, s->rows.layout, s->held % 2 ? v : turned);
    s->triangles++;
    return true;
}

/* Writes the triangles of the strips at r, if `to` is not NULL. Returns their number; SIZE_MAX: the data end
 * early, or are not numbers. */
static size_t expand(const ply_rows *r, char *to)
{
    strip s = {.rows = *r, .to = to};
    for (const ply_element *strips = r->element; s.rows.row < strips->count; s.rows.row++)
        if (!ply_rows_read(&s.rows, NULL, NULL, strips->property, take_vertex, &s)) return SIZE_MAX;
    return s.triangles;
}

ply_strips ply_strips_expand(char **data, size_t *size)
{
    ply_header h;
    const ply_element *strips = ply_header_read(*data, *size, &h) ? find_strips(&h) : NULL;
    if (!strips) return PLY_STRIPS_READ;
    ply_rows r = ply_rows_begin(&h, *data, *size);
    for (const ply_element *element = h.element; element < strips; element++) {
        ply_rows_enter(&r, element);
        if (!ply_rows_skip(&r)) return PLY_STRIPS_DAMAGED;
    }
    ply_rows_enter(&r, strips);
    const size_t count = expand(&r, NULL), before = (size_t)(r.at - *data) - h.body;
    if (count == SIZE_MAX) return PLY_STRIPS_DAMAGED;
    char *out = malloc(strips->line + LINE_MOST + before + count * TEXT_TRIANGLE + 1), *to = out;
    if (!out) return PLY_STRIPS_NO_MEMORY;
    memcpy(to, *data, strips->line);
    to += strips->line;
    to += sprintf(to, "element face %zu\nproperty list uchar int vertex_indices\nend_header\n", count);
    memcpy(to, *data + h.body, before);
    to += before;
    *to = 0; /* a file of no triangle */
    expand(&r, to);
    *size = (size_t)(to - out) + (h.layout == PLY_TEXT ? strlen(to) : count * BINARY_TRIANGLE);
    free(*data);
    *data = out;
    return PLY_STRIPS_READ;
}
