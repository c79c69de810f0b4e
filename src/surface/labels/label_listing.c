// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_listing.h"

#include <stdlib.h>

#include "base/core/memory.h"

/* In a segmentation, at least this fraction of the voxels equals one of its next voxels along the three
 * axes; in noisy measurements few do. */
static const double alike_least = 0.8;
/* A label is connected if at least this fraction of its voxels equals a next voxel. The intermediate values
 * at the soft edge of a mask are not connected. */
static const double hangs_from = 0.5;

/* Whether the next voxel along an axis has the same label. */
static bool next_is_alike(const label_volume *v, int64_t x, int64_t y, int64_t z)
{
    const uint16_t *own = v->at + (z * v->size[1] + y) * v->size[0] + x;
    return (x + 1 < v->size[0] && own[1] == *own) || (y + 1 < v->size[1] && own[v->size[0]] == *own) ||
           (z + 1 < v->size[2] && own[v->size[0] * v->size[1]] == *own);
}

bool label_listing_suits(const label_volume *v)
{
    if (v->count < 2 || v->count > LABEL_LISTING_MOST) return false;
    size_t alike[LABEL_LISTING_MOST] = {0}, voxels = 0, all_alike = 0, hanging = 0;
    for (int64_t z = 0; z < v->size[2]; z++)
        for (int64_t y = 0; y < v->size[1]; y++)
            for (int64_t x = 0; x < v->size[0]; x++)
                alike[label_volume_at(v, x, y, z)] += next_is_alike(v, x, y, z);
    for (size_t k = 0; k < v->count; k++) {
        voxels += v->material[k].voxels;
        all_alike += alike[k];
        hanging += (double)alike[k] >= hangs_from * (double)v->material[k].voxels;
    }
    return (double)all_alike >= alike_least * (double)voxels && 2 * hanging > v->count;
}

/* Sets touching[a count + b] if a voxel of label a shares a face with a voxel of label b. */
static void find_neighbours(const label_volume *v, bool *touching)
{
    const int64_t step[3] = {1, v->size[0], v->size[0] * v->size[1]};
    for (int64_t z = 0; z < v->size[2]; z++)
        for (int64_t y = 0; y < v->size[1]; y++)
            for (int64_t x = 0; x < v->size[0]; x++) {
                const int64_t at[3] = {x, y, z};
                const uint16_t *own = v->at + z * step[2] + y * step[1] + x;
                for (int k = 0; k < 3; k++) {
                    if (at[k] + 1 == v->size[k] || own[step[k]] == *own) continue;
                    touching[*own * v->count + own[step[k]]] = true;
                    touching[own[step[k]] * v->count + *own] = true;
                }
            }
}

bool label_listing_describe(const label_volume *v, json *list, error *e)
{
    bool *touching = mem_array(v->count * v->count, sizeof *touching, "the neighbours of labels", e);
    if (!touching) return false;
    find_neighbours(v, touching);
    for (size_t a = 0; a < v->count; a++) {
        const label_material *m = &v->material[a];
        json *told = json_append_object(list);
        json_put_integer(told, "label", m->value);
        json_put_integer(told, "voxels", (int64_t)m->voxels);
        json *low = json_put_array(told, "low"), *high = json_put_array(told, "high"),
             *neighbours = json_put_array(told, "neighbours");
        for (int k = 0; k < 3; k++) {
            json_append_number(low, (double)m->low[k]);
            json_append_number(high, (double)m->high[k]);
        }
        for (size_t b = 0; b < v->count; b++)
            if (touching[a * v->count + b]) json_append_number(neighbours, (double)v->material[b].value);
    }
    free(touching);
    return true;
}
