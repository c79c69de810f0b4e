// SPDX-License-Identifier: Apache-2.0
#include "surface/field/placement.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/affine.h"

struct placement {
    field base; /* first: the field's functions get this pointer */
    const field *part;
    double to_world[3][4], to_part[3][4];
    double scale;
};

static bool placement_sample(const field *f, vec3 x, field_order order, field_sample *out)
{
    const placement *p = (const placement *)f;
    field_sample s;
    if (!field_sample_at(p->part, affine_apply(p->to_part, x.x, x.y, x.z), order, &s)) return false;
    out->value = s.value;
    out->gradient = affine_pull_gradient(p->to_part, s.gradient);
    if (order == FIELD_HESSIAN) out->hessian = affine_pull_hessian(p->to_part, s.hessian);
    return true;
}

static size_t placement_cell_count(const field *f)
{
    const field *part = ((const placement *)f)->part;
    return part->ops->cell_count(part);
}

static void placement_cell(const field *f, size_t k, field_cell *out)
{
    const placement *p = (const placement *)f;
    p->part->ops->cell(p->part, k, out);
    for (int c = 0; c < 8; c++) {
        vec3 at = out->corner[c];
        out->corner[c] = affine_apply(p->to_world, at.x, at.y, at.z);
    }
}

static double placement_side(const field *f, vec3 x)
{
    const placement *p = (const placement *)f;
    return p->part->ops->side(p->part, affine_apply(p->to_part, x.x, x.y, x.z));
}

static const field_ops placement_ops = {.sample = placement_sample,
                                        .cell_count = placement_cell_count,
                                        .cell = placement_cell,
                                        .side = placement_side};

/* The faces of the mapped domain that cut the surface. False: the map does not map axes to axes. */
static bool map_boundary_faces(const placement *p, unsigned *faces)
{
    *faces = 0;
    for (int axis = 0; axis < 3; axis++) {
        int along = -1;
        for (int k = 0; k < 3; k++) {
            if (p->to_world[k][axis] == 0) continue;
            if (along >= 0) return false;
            along = k;
        }
        for (int high = 0; high < 2; high++) {
            const bbox *ends = &p->part->boundary_box;
            if (!isfinite(vec3_get(high ? ends->max : ends->min, axis))) continue;
            *faces |= 1u << (2 * along + ((p->to_world[along][axis] > 0) == high));
        }
    }
    return true;
}

/* The bounding box of the solid. Each side is mapped separately, since sides may be infinite. */
static bbox place_solid(const placement *p)
{
    const bbox box = field_solid_box(p->part);
    bbox placed;
    for (int i = 0; i < 3; i++) {
        double low = p->to_world[i][3], high = low;
        for (int k = 0; k < 3; k++) {
            const double by = p->to_world[i][k];
            if (by == 0) continue;
            low += by * vec3_get(by > 0 ? box.min : box.max, k);
            high += by * vec3_get(by > 0 ? box.max : box.min, k);
        }
        vec3_set(&placed.min, i, low);
        vec3_set(&placed.max, i, high);
    }
    return placed;
}

static void measure(placement *p)
{
    const bbox box = affine_box(p->to_world, p->part->domain);
    p->base.domain = box;
    field_set_solid_box(&p->base, place_solid(p));
    p->base.sharp = p->part->sharp;
    p->base.extent = p->part->extent * bbox_longest(box) / bbox_longest(p->part->domain);
    p->base.uneven = p->part->uneven;
    field_cell cell, placed; /* all cells of a field are similar */
    p->part->ops->cell(p->part, 0, &cell);
    placement_cell(&p->base, 0, &placed);
    p->base.cell_size = field_cell_edge(&placed);
    if (p->base.uneven) p->base.cell_size *= p->part->cell_size / field_cell_edge(&cell);
}

placement *placement_new_view(const field *part, const double matrix[16])
{
    placement *p = mem_alloc(sizeof *p);
    p->base.ops = &placement_ops;
    p->part = part;
    for (int k = 0; k < 12; k++) p->to_world[k / 4][k % 4] = matrix[k];
    p->scale = elementary_cbrt(fabs(affine_invert(p->to_world, p->to_part)));
    measure(p);
    field_set_boundary(&p->base, 0);
    return p;
}

placement *placement_new(const field *part, const double matrix[16], error *e)
{
    placement *p = placement_new_view(part, matrix);
    unsigned faces = 0;
    if (!part->open || map_boundary_faces(p, &faces)) {
        field_set_boundary(&p->base, faces);
        return p;
    }
    error_set(
        e, ERROR_NOT_SUPPORTED,
        "an open surface can only be transformed by a matrix that maps axes to axes: its boundaries lie "
        "along them");
    placement_free(p);
    return NULL;
}

void placement_free(placement *p)
{
    free(p);
}

const field *placement_field(const placement *p)
{
    return &p->base;
}

double placement_scale(const placement *p)
{
    return p->scale;
}

vec3 placement_to_part(const placement *p, vec3 x)
{
    return affine_apply(p->to_part, x.x, x.y, x.z);
}

vec3 placement_to_world(const placement *p, vec3 x)
{
    return affine_apply(p->to_world, x.x, x.y, x.z);
}

vec3 placement_turn_normal(const placement *p, vec3 normal)
{
    return vec3_unit(affine_pull_gradient(p->to_part, normal));
}

vec3 placement_turn_normal_to_part(const placement *p, vec3 normal)
{
    return vec3_unit(affine_pull_gradient(p->to_world, normal));
}

void placement_turn_sample(const placement *p, field_sample *s)
{
    s->gradient = affine_pull_gradient(p->to_part, s->gradient);
    s->hessian = affine_pull_hessian(p->to_part, s->hessian);
}
