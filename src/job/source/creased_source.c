// SPDX-License-Identifier: Apache-2.0
#include "job/source/creased_source.h"

#include <math.h>
#include <string.h>

#include "geometry/space/affine.h"

static const double HERE[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

typedef struct walk {
    solid *solid;
    solid_rule *rule;
    const field *open; /* a leaf whose surface is open; or NULL */
    double open_to_world[3][4];
    size_t leaves;
    bool ends_within; /* the region is a combination in which a surface is open */
} walk;

static void push_leaf(walk *w, const source_part *part, const double to_world[3][4], bool inverted)
{
    w->leaves++;
    if (part->field->open) {
        w->open = part->field;
        memcpy(w->open_to_world, to_world, sizeof w->open_to_world);
    }
    if (part->analytic)
        solid_push_shape(w->solid, w->rule, &part->analytic->params, to_world, inverted);
    else
        solid_push_field(w->solid, w->rule, part->field, to_world, inverted);
}

static void push(walk *w, const spec_surface *s, const source_part *part, const double to_world[3][4],
                 bool inverted)
{
    double placed[3][4];
    if (s->part_count == 0) {
        push_leaf(w, part, to_world, inverted);
        return;
    }
    memcpy(placed, to_world, sizeof placed);
    if (s->kind == SPEC_SURFACE_TRANSFORM) affine_compose(to_world, s->matrix, placed);
    bool some = false;
    for (size_t k = 0; k < s->part_count; k++) {
        if (part->parts[k].nothing) continue;
        bool taken = s->kind == SPEC_SURFACE_DIFFERENCE && k > 0;
        push(w, s->parts[k], &part->parts[k], (const double(*)[4])placed, inverted != taken);
        if (some) solid_join(w->solid, w->rule, (s->kind == SPEC_SURFACE_UNION) != inverted);
        some = true;
    }
}

static void push_region(solid *s, bbox box, const double to_world[3][4])
{
    const analytic_params shape = {.shape = ANALYTIC_BOX,
                                   .center = vec3_scale(vec3_add(box.min, box.max), 0.5),
                                   .half_size = vec3_scale(bbox_size(box), 0.5)};
    bool first = s->region.count == 0;
    solid_push_shape(s, &s->region, &shape, to_world, false);
    if (!first) solid_join(s, &s->region, false);
}

/* Replaces the error that nothing of the surface is left within region.inside. */
static void explain_miss(const field *surface_of, const field *solid_of, error *e)
{
    const bbox whole = surface_of->domain, within = solid_of->domain;
    error_set(
        e, ERROR_NO_SURFACE,
        "/region/inside: the solid, between (%.3g, %.3g, %.3g) and (%.3g, %.3g, %.3g), contains no part of the "
        "surface, which is between (%.3g, %.3g, %.3g) and (%.3g, %.3g, %.3g): move or enlarge the solid",
        within.min.x, within.min.y, within.min.z, within.max.x, within.max.y, within.max.z, whole.min.x,
        whole.min.y, whole.min.z, whole.max.x, whole.max.y, whole.max.z);
}

creased *creased_source_open(const spec *s, const source_part *part, const source_part *inside, error *e)
{
    if (part->field->patches) {
        error_set(e, ERROR_NOT_SUPPORTED,
                  "this mesh is already divided into patches: remove features, or use "
                  "surface.mesh.features");
        return NULL;
    }
    walk w = {.solid = solid_new(bbox_longest(part->field->domain))};
    w.rule = &w.solid->inside;
    bbox box = part->field->domain;
    push(&w, &s->surface, part, HERE, false);
    if (w.open) push_region(w.solid, w.open->domain, (const double(*)[4])w.open_to_world);
    if (s->region_inside) {
        walk of_region = {.solid = w.solid, .rule = &w.solid->region};
        bool first = w.solid->region.count == 0;
        box = inside->field->domain;
        push(&of_region, s->region_inside, inside, HERE, false);
        if (!first) solid_join(w.solid, &w.solid->region, false);
        if (of_region.open)
            push_region(w.solid, of_region.open->domain, (const double(*)[4])of_region.open_to_world);
        w.ends_within |= of_region.open && of_region.leaves > 1;
    } else if (s->has_region) {
        box = (bbox){s->region.min, s->region.max};
        push_region(w.solid, box, HERE);
    }
    if (w.solid->full)
        error_set(e, ERROR_NOT_SUPPORTED,
                  "the surface has more than %d smooth patches (a box has six): remove features",
                  SOLID_LEAVES);
    else if (w.ends_within || (w.open && w.leaves > 1))
        error_set(e, ERROR_NOT_SUPPORTED,
                  "one of the combined surfaces is open: remove features, or use a region");
    else {
        creased *made = creased_new(w.solid, part->field, box, e);
        if (!made && s->region_inside && e->code == ERROR_NO_SURFACE)
            explain_miss(part->field, inside->field, e);
        return made;
    }
    solid_free(w.solid);
    return NULL;
}
