// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/ply_values.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/ply_rows.h"

/* What the library makes of places, colours and texture coordinates. */
static const char known[] = " x y z nx ny nz red green blue alpha r g b a s t u v texture_u texture_v ";

/* The component of a colour that a property has, or -1. */
static int component_of(const ply_property *p)
{
    static const char *const names[][2] = {{"red", "r"}, {"green", "g"}, {"blue", "b"}, {"alpha", "a"}};
    for (int c = 0; c < 4; c++)
        if (strcmp(p->name, names[c][0]) == 0 || strcmp(p->name, names[c][1]) == 0) return c;
    return -1;
}

/* The number that is full intensity; 0: it is not known. */
static double full_of(number_type type, double low, double high)
{
    if (type == NUMBER_UINT8 || type == NUMBER_UINT16) return type == NUMBER_UINT8 ? UINT8_MAX : UINT16_MAX;
    if (!(low >= 0 && high <= UINT8_MAX)) return 0;
    return number_is_whole(type) || high > 1 ? UINT8_MAX : 1;
}

/* Reads the colours of the vertices. False: no memory. */
static bool read_colors(const ply_header *h, const char *data, size_t size, ply_values *out)
{
    const ply_element *vertex = h->element;
    ply_rows r = ply_rows_begin(h, data, size);
    int slot[PLY_PROPERTIES_MOST], has = 0;
    const ply_type *type = NULL;
    for (int k = 0; k < vertex->properties; k++) {
        slot[k] = component_of(&vertex->property[k]);
        if (slot[k] >= 0) has |= 1 << slot[k];
        if (slot[k] >= 0 && slot[k] < 3) type = vertex->property[k].type;
    }
    if ((has & 7) != 7) return true;
    if (!(out->color = calloc(vertex->count, sizeof *out->color))) return false;
    double low = 0, high = 0;
    for (; r.row < vertex->count; r.row++) {
        double number[4] = {0, 0, 0, NAN};
        if (!ply_rows_read(&r, slot, number, NULL, NULL, NULL)) break;
        for (int c = 0; c < 4; c++) {
            low = fmin(low, number[c]);
            high = fmax(high, number[c]);
            out->color[r.row][c] = (float)number[c];
        }
    }
    const double full = full_of(type->number, low, high);
    if (full == 0) out->refused = type->name;
    for (size_t k = 0; k < vertex->count; k++)
        for (int c = 0; c < 4; c++)
            out->color[k][c] =
                c == 3 && !(has & 8) ? 1 : (float)((double)out->color[k][c] / (full > 0 ? full : 1));
    return true;
}

/* Where each property of a vertex goes in the answer, or -1. False: vertices are not first, or have lists. */
static bool choose(const ply_element *vertex, int slot[PLY_PROPERTIES_MOST], ply_values *out)
{
    if (strcmp(vertex->name, "vertex") != 0 || vertex->count == 0 || vertex->properties == 0 ||
        vertex->has_list)
        return false;
    for (int k = 0; k < vertex->properties; k++) {
        const char *name = vertex->property[k].name;
        char word[PLY_NAME_SIZE + 2];
        snprintf(word, sizeof word, " %s ", name);
        const bool wanted = !strstr(known, word) && out->count < MESH_VALUES_MOST;
        slot[k] = wanted ? (int)out->count : -1;
        if (wanted) snprintf(out->name[out->count++], sizeof out->name[0], "%s", name);
    }
    return true;
}

bool ply_values_read(const char *data, size_t size, ply_values *out)
{
    ply_header h;
    int slot[PLY_PROPERTIES_MOST];
    double number[MESH_VALUES_MOST];
    const ply_element *vertex = h.element;
    if (!ply_header_read(data, size, &h) || h.elements == 0) return true;
    ply_rows r = ply_rows_begin(&h, data, size);
    bool good = vertex->count <= ply_rows_at_most(&r) && choose(vertex, slot, out);
    for (uint32_t k = 0; good && k < out->count; k++)
        if (!(out->value[k] = calloc(vertex->count, sizeof(float)))) return false;
    for (; good && r.row < vertex->count; r.row++) {
        good = ply_rows_read(&r, slot, number, NULL, NULL, NULL);
        for (uint32_t k = 0; good && k < out->count; k++) out->value[k][r.row] = (float)number[k];
    }
    if (good && !read_colors(&h, data, size, out)) return false;
    if (good)
        out->vertices = vertex->count;
    else
        out->count = 0;
    return true;
}
