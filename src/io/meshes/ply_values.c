// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/ply_values.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/meshes/ply_rows.h"

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
    if (good)
        out->vertices = vertex->count;
    else
        out->count = 0;
    return true;
}
