// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/texel.h"

#include <math.h>

/* The index of a texel within an image of n texels. */
static uint32_t wrapped(double index, uint32_t n, uint32_t wrap)
{
    const double period = wrap == MESH_WRAP_MIRROR ? 2.0 * n : n;
    if (wrap == MESH_WRAP_CLAMP || wrap == MESH_WRAP_NOTHING) return (uint32_t)fmin(fmax(index, 0), n - 1.0);
    index -= period * floor(index / period);
    if (!(index >= 0 && index < period)) index = 0; /* rounding of large coordinates */
    return (uint32_t)(index < n ? index : period - 1 - index);
}

static double component(const texel_image *image, size_t texel, int c)
{
    if (image->bits == 8) {
        const uint8_t byte = ((const uint8_t *)image->pixels)[4 * texel + (size_t)c];
        return image->light && c < 3 ? image->light[byte] : byte / 255.0;
    }
    const double value = ((const uint16_t *)image->pixels)[4 * texel + (size_t)c] / 65535.0;
    return image->light && c < 3 ? mesh_textures_decode(value) : value;
}

bool texel_at(const texel_image *image, const uint32_t wrap[2], const double uv[2], double color[4])
{
    const uint32_t size[2] = {image->width, image->height};
    uint32_t at[2][2];
    double weight[2];
    for (int k = 0; k < 2; k++) {
        if (wrap[k] == MESH_WRAP_NOTHING && !(uv[k] >= 0 && uv[k] <= 1)) return false;
        const double x = uv[k] * size[k] - 0.5, low = floor(x);
        weight[k] = x - low;
        at[k][0] = wrapped(low, size[k], wrap[k]);
        at[k][1] = wrapped(low + 1, size[k], wrap[k]);
    }
    for (int c = 0; c < 4; c++) {
        color[c] = 0;
        for (int k = 0; k < 4; k++) {
            const double share = (k & 1 ? weight[0] : 1 - weight[0]) * (k & 2 ? weight[1] : 1 - weight[1]);
            if (share > 0)
                color[c] += share * component(image, (size_t)at[1][k >> 1] * size[0] + at[0][k & 1], c);
        }
    }
    return true;
}
