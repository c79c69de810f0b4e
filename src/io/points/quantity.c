// SPDX-License-Identifier: Apache-2.0
#include "io/points/quantity.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "geometry/space/bbox.h"

/* Title, type of scale, and smallest range that is significant. */
typedef struct quantity_display {
    const char *title;
    bool root;
    double least;
    enum { PLAIN, LENGTH, PER_LENGTH } unit; /* unit of `least`, in extents */
} quantity_display;

static const quantity_display display_of[] = {
    [QUANTITY_ALPHA] = {"alpha", false, 0.001, PLAIN},
    [QUANTITY_CURVATURE] = {"curvature", true, 0.01, PER_LENGTH}, /* smaller curvatures look flat */
    [QUANTITY_ENERGY] = {"energy", false, 0.001, PLAIN},
    [QUANTITY_SPACING] = {"spacing", false, 1e-6, LENGTH},
    [QUANTITY_DEGREE] = {"degree", false, 0, PLAIN},
    [QUANTITY_VALUES] = {"attribute", false, 1e-30, PLAIN}, /* any unit */
    [QUANTITY_COLOR] = {"color", false, 1, PLAIN},
    [QUANTITY_SHADING] = {"", false, 1, PLAIN},
};

/* Centred at six neighbours; any packing has defects with more and fewer. */
static const colormap_scale degree_scale = {4, 8, false, COLORMAP_VIRIDIS};

bool quantity_has_scale(quantity which)
{
    return which != QUANTITY_COLOR && which != QUANTITY_SHADING;
}

const double *quantity_values(const points *set, const quantity_look *look)
{
    switch (look->which) {
    case QUANTITY_ALPHA:
        return set->alpha;
    case QUANTITY_ENERGY:
        return set->energy;
    case QUANTITY_SPACING:
        return set->spacing_local;
    case QUANTITY_DEGREE:
        return set->degree;
    case QUANTITY_VALUES:
    case QUANTITY_COLOR:
        return look->values;
    case QUANTITY_SHADING:
        return NULL;
    default:
        return set->kappa;
    }
}

const char *quantity_title(const quantity_look *look)
{
    return look->title ? look->title : display_of[look->which].title;
}

const double quantity_undefined_color[3] = {0.55, 0.55, 0.55};

/* The scale of the defined values. */
static bool scale_of_defined(const points *set, const quantity_look *look, bool root, double least,
                             colormap_scale *out, error *e)
{
    const double *values = quantity_values(set, look);
    size_t count = 0;
    for (size_t i = 0; i < set->count; i++) count += quantity_is_defined(set, look, i);
    if (count == set->count) return colormap_scale_of(values, count, root, least, out, e);
    double *defined = mem_array(count, sizeof *defined, "the colour scale", e);
    count = 0;
    for (size_t i = 0; defined && i < set->count; i++)
        if (quantity_is_defined(set, look, i)) defined[count++] = values[i];
    const bool ok = defined && colormap_scale_of(defined, count, root, least, out, e);
    free(defined);
    return ok;
}

bool quantity_scale(const points *set, const quantity_look *look, double extent, colormap_scale *out,
                    error *e)
{
    const quantity_display *s = &display_of[look->which];
    double unit = s->unit == LENGTH ? extent : s->unit == PER_LENGTH ? 1 / extent : 1;
    colormap_scale scale = degree_scale;
    if (look->low < look->high)
        scale = (colormap_scale){look->low, look->high, s->root && look->low >= 0, look->map};
    else if (look->which != QUANTITY_DEGREE && quantity_has_scale(look->which) &&
             !scale_of_defined(set, look, s->root, s->least * unit, &scale, e))
        return false;
    scale.map = look->map;
    *out = scale;
    return true;
}

bool quantity_colors(const points *set, const quantity_look *look, vec3 *out, error *e)
{
    const double *values = quantity_values(set, look);
    const bbox box = bbox_of_points(set->position, set->count, NULL);
    colormap_scale scale;
    double extent = 0.5 * vec3_norm(vec3_sub(box.max, box.min)); /* as in pictures */
    if (!quantity_scale(set, look, extent, &scale, e)) return false;
    for (size_t i = 0; i < set->count; i++) {
        double srgb[3];
        colormap_color(scale.map, colormap_scale_place(&scale, values[i]), srgb);
        const double *color = quantity_is_defined(set, look, i) ? srgb : quantity_undefined_color;
        out[i] = vec3_make(color[0], color[1], color[2]);
    }
    return true;
}
