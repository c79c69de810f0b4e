// SPDX-License-Identifier: Apache-2.0
#include "sampling/measures/sites.h"

#include <string.h>

#include "sampling/packing/point_flags.h"

static uint32_t point_of(const sites_copies *c, size_t copy)
{
    return c->point ? c->point[copy] : (uint32_t)copy;
}

void sites_gather(const sites_copies *c, size_t points, uint32_t *side, vec3 *normal, bool *one_sided,
                  uint32_t *patch)
{
    for (size_t k = 0; k < c->count; k++) side[point_of(c, k) + 1]++;
    for (size_t i = 0; i < points; i++) side[i + 1] += side[i];
    for (size_t k = c->count; k-- > 0;) { /* fills each range from its end; side[i + 1] becomes its begin */
        const uint32_t at = --side[point_of(c, k) + 1];
        patch[at] = c->patch ? c->patch[k] : 0;
        if (c->normal) normal[at] = c->normal[k];
        one_sided[at] = c->flags && c->flags[k] & PACKING_ONE_SIDED;
    }
    memmove(side, side + 1, points * sizeof *side);
    side[points] = (uint32_t)c->count;
}
