// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/ply_values.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/ply_header.h"

/* What the library makes of places, colours and texture coordinates. */
static const char known[] = " x y z nx ny nz red green blue alpha r g b a s t u v texture_u texture_v ";

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

/* Whether the rows are all there. */
static bool read_rows(const char *data, size_t size, const ply_header *h, const int *slot, ply_values *out)
{
    const ply_element *vertex = h->element;
    const char *at = data + h->body, *end = data + size;
    if (h->layout != PLY_TEXT && vertex->count > (size - h->body) / vertex->row) return false;
    for (size_t row = 0; row < vertex->count; row++)
        for (int c = 0; c < vertex->properties; c++) {
            double value;
            if (h->layout == PLY_TEXT) {
                char word[64] = "";
                size_t n = 0;
                while (at < end && strchr(" \t\r\n", *at)) at++;
                while (at < end && !strchr(" \t\r\n", *at) && n < sizeof word - 1) word[n++] = *at++;
                if (n == 0) return false;
                value = strtod(word, NULL);
            } else {
                const ply_type *type = vertex->property[c].type;
                value = ply_number(at, type, h->layout);
                at += number_bytes(type->number);
            }
            if (slot[c] >= 0) out->value[slot[c]][row] = (float)value;
        }
    return true;
}

bool ply_values_read(const char *data, size_t size, ply_values *out)
{
    ply_header h;
    int slot[PLY_PROPERTIES_MOST];
    const ply_element *vertex = h.element;
    bool good = ply_header_read(data, size, &h) && h.elements > 0 &&
                vertex->count <= size && /* of a byte each at least */
                choose(vertex, slot, out);
    for (uint32_t k = 0; good && k < out->count; k++)
        if (!(out->value[k] = calloc(vertex->count, sizeof(float)))) return false;
    if (good && read_rows(data, size, &h, slot, out))
        out->vertices = vertex->count;
    else
        out->count = 0;
    return true;
}
