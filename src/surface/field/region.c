// SPDX-License-Identifier: Apache-2.0
#include "surface/field/region.h"

#include <stdlib.h>

#include "base/core/memory.h"

/* In cell sizes: distance by which a surface may extend beyond the cells that it crosses. */
static const double BULGE = 0.5;

struct region {
    field base; /* first: the field's functions get this pointer */
    const field *whole, *field;
    size_t *kept; /* numbers of the whole's cells */
    size_t count;
};

static bool region_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const field *whole = ((const region *)f)->whole;
    return whole->ops->sample(whole, x, order, out);
}

static size_t region_cell_count(const field *f)
{
    return ((const region *)f)->count;
}

static void region_cell(const field *f, size_t k, field_cell *out)
{
    const region *r = (const region *)f;
    r->whole->ops->cell(r->whole, r->kept[k], out);
}

static double region_side(const field *f, vec3 x)
{
    const field *whole = ((const region *)f)->whole;
    return whole->ops->side(whole, x);
}

static void region_sample_lanes(const field *f, const vec3_lanes *x, bool *defined, double *value,
                                vec3_lanes *gradient)
{
    field_sample_lanes(((const region *)f)->whole, x, defined, value, gradient);
}

static const field_ops region_ops = {.sample = region_sample,
                                     .cell_count = region_cell_count,
                                     .cell = region_cell,
                                     .side = region_side,
                                     .sample_lanes = region_sample_lanes};

static bbox box_of_cell(const field *f, size_t k)
{
    field_cell cell;
    bbox box = bbox_empty();
    f->ops->cell(f, k, &cell);
    for (int c = 0; c < 8; c++) box = bbox_include(box, cell.corner[c]);
    return box;
}

/* Keeps the cells that reach into the box. *all, *kept: the bounding boxes of all cells and of the kept
 * ones. */
static bool keep_cells(region *r, bbox box, bbox *all, bbox *kept, error *e)
{
    size_t cells = r->whole->ops->cell_count(r->whole);
    r->kept = mem_array(cells, sizeof *r->kept, "the cells of the region", e);
    if (!r->kept) return false;
    *all = *kept = bbox_empty();
    for (size_t k = 0; k < cells; k++) {
        bbox cell = box_of_cell(r->whole, k);
        *all = bbox_unite(*all, cell);
        if (!bbox_overlap(cell, box)) continue;
        *kept = bbox_unite(*kept, cell);
        r->kept[r->count++] = k;
    }
    return true;
}

/* A face of the domain cuts the surface if cells reach it and it is a face of the box or cuts the whole. */
static unsigned find_boundary_faces(const region *r, bbox box, bbox kept)
{
    bbox reached = bbox_grow(kept, BULGE * r->whole->cell_size), whole = r->whole->domain;
    unsigned faces = 0;
    for (int axis = 0; axis < 3; axis++) {
        double low = vec3_get(box.min, axis), high = vec3_get(box.max, axis);
        double first = vec3_get(whole.min, axis), last = vec3_get(whole.max, axis);
        bool low_open =
            low > first || (r->whole->open && vec3_get(r->whole->boundary_box.min, axis) == first);
        bool high_open =
            high < last || (r->whole->open && vec3_get(r->whole->boundary_box.max, axis) == last);
        if (low_open && vec3_get(reached.min, axis) < fmax(low, first)) faces |= 1u << 2 * axis;
        if (high_open && vec3_get(reached.max, axis) > fmin(high, last)) faces |= 2u << 2 * axis;
    }
    return faces;
}

static bool no_surface(bbox box, bbox all, error *e)
{
    return error_set(e, ERROR_NO_SURFACE,
                     "the region (%g, %g, %g) to (%g, %g, %g) contains no part of the surface, which is "
                     "between (%g, %g, %g) and (%g, %g, %g): move or enlarge the region",
                     box.min.x, box.min.y, box.min.z, box.max.x, box.max.y, box.max.z, all.min.x, all.min.y,
                     all.min.z, all.max.x, all.max.y, all.max.z);
}

region *region_new(const field *whole, bbox box, error *e)
{
    region *r = mem_alloc(sizeof *r);
    bbox all, kept;
    r->whole = r->field = whole;
    if (!keep_cells(r, box, &all, &kept, e)) goto fail;
    if (r->count == 0) {
        no_surface(box, all, e);
        goto fail;
    }
    r->base = *whole;
    r->base.ops = &region_ops;
    r->base.joined = false;
    r->base.domain = bbox_common(whole->domain, box);
    field_set_solid_box(&r->base, bbox_common(field_solid_box(whole), box));
    field_set_boundary(&r->base, find_boundary_faces(r, box, kept));
    bool all_kept = r->count == whole->ops->cell_count(whole);
    bbox inner = bbox_grow(box, -BULGE * whole->cell_size);
    bool holds_all = bbox_contains(inner, all.min) && bbox_contains(inner, all.max);
    bool holds_domain = bbox_contains(box, whole->domain.min) && bbox_contains(box, whole->domain.max);
    if (!all_kept || !(holds_all || holds_domain)) r->field = &r->base;
    return r;
fail:
    region_free(r);
    return NULL;
}

void region_free(region *r)
{
    if (!r) return;
    free(r->kept);
    free(r);
}

const field *region_field(const region *r)
{
    return r->field;
}

size_t region_bytes(const region *r)
{
    return r->whole->ops->cell_count(r->whole) * sizeof *r->kept;
}
