// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/mesh_textures.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"

void mesh_textures_free(mesh_textures *t)
{
    for (size_t k = 0; t->data && k < t->images; k++) free(t->data[k]);
    free(t->data);
    free(t->material);
    free(t->image);
    free(t->library);
    *t = (mesh_textures){0};
}

double mesh_textures_decode(double encoded)
{
    const double c = fmin(fmax(encoded, 0), 1);
    return c <= 0.04045 ? c / 12.92 : elementary_pow((c + 0.055) / 1.055, 2.4);
}

double mesh_textures_encode(double linear)
{
    const double c = fmin(fmax(linear, 0), 1);
    return c <= 0.0031308 ? 12.92 * c : 1.055 * elementary_pow(c, 1 / 2.4) - 0.055;
}

mesh_material mesh_textures_white(void)
{
    return (mesh_material){
        .factor = {1, 1, 1, 1}, .transform = {{1, 0, 0}, {0, -1, 1}}, .image = MESH_TEXTURES_NONE};
}
