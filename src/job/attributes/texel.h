// SPDX-License-Identifier: Apache-2.0
/* texel: the colour of an image at a position: linear between the centres of the texels.
 *
 * Texel (i, j) of an image of w x h texels has its centre at ((i + 1/2) / w, (j + 1/2) / h). Beyond the outermost
 * centres the wrap of each coordinate decides which texels are the neighbours. Pure functions.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_TEXEL_H
#define HEXAD_JOB_ATTRIBUTES_TEXEL_H

#include <stdbool.h>
#include <stdint.h>

#include "io/meshes/mesh_textures.h"

typedef struct texel_image {
    uint32_t width, height, bits; /* as image_facts */
    const void *pixels;
    const double *light; /* 256 numbers: linear light of 8 bits; NULL: numbers are not converted */
} texel_image;

/* The colour, 0 to 1, in linear light if image->light is set. False: the position is beyond the image, and a
 * wrap is MESH_WRAP_NOTHING. */
bool texel_at(const texel_image *image, const uint32_t wrap[2], const double uv[2], double color[4]);

#endif
