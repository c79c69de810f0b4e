// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/ply_rows.h"

#include <math.h>

#include "io/meshes/plain_mesh.h"

static const char early[] = "ends before the values that its header declares";

ply_rows ply_rows_begin(const ply_header *h, const char *data, size_t size)
{
    return (ply_rows){data, data + h->body, data + size, h->layout, h->element, 0, NULL};
}

void ply_rows_enter(ply_rows *r, const ply_element *element)
{
    r->element = element;
    r->row = 0;
}

bool ply_rows_refuse(ply_rows *r, const char *fault)
{
    r->fault = fault;
    return false;
}

static size_t bytes_left(const ply_rows *r)
{
    return (size_t)(r->end - r->at);
}

size_t ply_rows_at_most(const ply_rows *r)
{
    const size_t row = r->layout != PLY_TEXT && r->element->row > 0 ? r->element->row : 1,
                 most = bytes_left(r) / row;
    return r->element->count < most ? r->element->count : most;
}

static bool is_line_end(char c)
{
    return c == '\n' || c == '\r' || c == 0;
}

static bool read_number(ply_rows *r, const ply_type *type, double *out)
{
    if (r->layout == PLY_TEXT)
        return plain_mesh_number(&r->at, out) ||
               ply_rows_refuse(r, is_line_end(*r->at) ? early : "has a word in place of a number");
    if (bytes_left(r) < number_bytes(type->number)) return ply_rows_refuse(r, early);
    *out =
        number_value(r->at, type->number, r->layout == PLY_BIG ? NUMBER_BIG_SWAPPED : NUMBER_LITTLE_SWAPPED);
    r->at += number_bytes(type->number);
    return true;
}

static bool read_list(ply_rows *r, const ply_property *p, ply_rows_take *take, void *context)
{
    double length, number;
    if (!read_number(r, p->length, &length)) return false;
    if (!(length >= 0 && length <= UINT32_MAX && length == floor(length)))
        return ply_rows_refuse(r, "has a list whose length is not a number from 0 on");
    if (!take && r->layout != PLY_TEXT) {
        const size_t bytes = (size_t)length * number_bytes(p->type->number);
        if (bytes > bytes_left(r)) return ply_rows_refuse(r, early);
        r->at += bytes;
        return true;
    }
    for (size_t k = 0; k < (size_t)length; k++)
        if (!read_number(r, p->type, &number) || (take && !take(context, k, number))) return false;
    return true;
}

static void begin_line(ply_rows *r)
{
    while (*r->at == '\n' || *r->at == '\r' || *r->at == ' ' || *r->at == '\t') r->at++;
}

bool ply_rows_read(ply_rows *r, const int *slot, double *number, const ply_property *list,
                   ply_rows_take *take, void *context)
{
    if (r->layout == PLY_TEXT) begin_line(r);
    for (int k = 0; k < r->element->properties; k++) {
        const ply_property *p = &r->element->property[k];
        double value;
        if (p->length ? !read_list(r, p, p == list ? take : NULL, context) : !read_number(r, p->type, &value))
            return false;
        if (!p->length && slot && slot[k] >= 0) number[slot[k]] = value;
    }
    if (r->layout != PLY_TEXT) return true;
    while (*r->at == ' ' || *r->at == '\t') r->at++;
    return is_line_end(*r->at) || ply_rows_refuse(r, "has more values than its header declares");
}

/* Skips a line with its line break. */
static bool skip_line(ply_rows *r)
{
    begin_line(r);
    if (r->at == r->end) return ply_rows_refuse(r, early);
    while (r->at < r->end && *r->at != '\n' && *r->at != '\r') r->at++;
    if (r->at[0] == '\r' && r->at[1] == '\n') r->at++;
    if (r->at < r->end) r->at++;
    return true;
}

bool ply_rows_skip(ply_rows *r)
{
    const ply_element *e = r->element;
    if (r->layout != PLY_TEXT && !e->has_list) {
        if (e->row > 0 && e->count > bytes_left(r) / e->row) return ply_rows_refuse(r, early);
        r->at += e->count * e->row;
        return true;
    }
    for (; e->properties > 0 && r->row < e->count; r->row++)
        if (!(r->layout == PLY_TEXT ? skip_line(r) : ply_rows_read(r, NULL, NULL, NULL, NULL, NULL)))
            return false;
    return true;
}
