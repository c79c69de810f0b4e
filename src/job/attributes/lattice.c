// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/lattice.h"

#include <math.h>
#include <string.h>

#include "geometry/space/affine.h"

void lattice_place(const attribute_request *request, const double index_to_file[16], lattice *out)
{
    double to_world[3][4];
    const double(*m)[4] = request->from_file;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) {
            to_world[i][j] = j == 3 ? m[i][3] : 0;
            for (int k = 0; k < 3; k++) to_world[i][j] += m[i][k] * index_to_file[4 * k + j];
        }
    affine_invert((const double(*)[4])to_world, out->to_index);
    memcpy(out->from_file, request->from_file, sizeof out->from_file);
    out->stencil = request->stencil;
}

void lattice_turn(point_attribute_kind kind, const double map[3][4], double *value)
{
    vec3 v = {value[0], kind == POINT_ATTRIBUTE_VECTOR || kind == POINT_ATTRIBUTE_NORMAL ? value[1] : 0, 0};
    if (kind == POINT_ATTRIBUTE_VECTOR) {
        v = affine_apply(map, value[0], value[1], value[2]);
        v = vec3_sub(v, vec3_make(map[0][3], map[1][3], map[2][3]));
    } else if (kind == POINT_ATTRIBUTE_NORMAL) {
        double back[3][4];
        affine_invert(map, back);
        v = vec3_unit(
            affine_pull_gradient((const double(*)[4])back, vec3_make(value[0], value[1], value[2])));
    } else {
        return;
    }
    for (int a = 0; a < 3; a++) value[a] = vec3_get(v, a);
}

/* Adds the weighted samples around a position. Returns whether one of them has data. */
static bool add_samples(const lattice *l, const stencil *s, double *sum)
{
    bool known = false;
    for (int c = 0; c < l->components; c++) sum[c] = 0;
    for (int x = 0; x < s->count; x++)
        for (int y = 0; y < s->count; y++)
            for (int z = 0; z < s->count; z++) {
                double weight = s->weight[0][x] * s->weight[1][y] * s->weight[2][z], value[4];
                const int32_t at[3] = {s->first[0] + x, s->first[1] + y, s->first[2] + z};
                if (weight == 0) continue;
                known |= l->read(l->context, at, value);
                for (int c = 0; c < l->components; c++) sum[c] += weight * value[c];
            }
    return known;
}

void lattice_value(const lattice *l, vec3 position, double *value, attribute_counts *counts)
{
    vec3 index = affine_apply(l->to_index, position.x, position.y, position.z);
    bool known = false, finite = true;
    for (int c = 0; c < l->components; c++) value[c] = 0;
    for (int c = 0; c < (l->staggered ? 3 : 1); c++) {
        vec3 at = index;
        double sum[4];
        stencil s;
        if (l->staggered) vec3_set(&at, c, vec3_get(index, c) + 0.5);
        if (!stencil_at(l->stencil, at, &s)) continue;
        known |= add_samples(l, &s, sum);
        if (l->staggered)
            value[c] = sum[c];
        else
            memcpy(value, sum, (size_t)l->components * sizeof *value);
    }
    for (int c = 0; c < l->components; c++) finite &= isfinite(value[c]);
    for (int c = 0; !finite && c < l->components; c++) value[c] = 0;
    if (finite) lattice_turn(l->kind, (const double(*)[4])l->from_file, value);
    counts->outside += !known;
    counts->not_finite += !finite;
}
