// SPDX-License-Identifier: Apache-2.0
#include "job/phases/point_order.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/space/morton.h"
#include "sampling/measures/progressive_order.h"

static const char what[] = "the order of the points";

static bool is_progressive(const spec *s)
{
    return s->has_order && s->order == SPEC_ORDER_PROGRESSIVE;
}

bool point_order_prepare(const spec *s, size_t count, point_order_known *out, error *e)
{
    if (!is_progressive(s)) return true;
    out->piece = mem_array(count, sizeof *out->piece, what, e);
    out->spacing = mem_array(count, sizeof *out->spacing, what, e);
    return out->piece && out->spacing;
}

void point_order_free_known(point_order_known *known)
{
    free(known->piece);
    free(known->spacing);
    *known = (point_order_known){0};
}

static bool order_progressively(const solver_points *solved, const point_order_known *known,
                                const label_surface *labels, const threads *pool, uint32_t *order, error *e)
{
    const solver_patch_points *copies = &solved->patch_points;
    uint32_t(*patch_labels)[2] = NULL;
    if (labels && !(patch_labels = label_surface_materials(labels, what, e))) return false;
    const progressive_order_input in = {.count = solved->count,
                                        .position = solved->position,
                                        .spacing = known->spacing,
                                        .piece = known->piece,
                                        .copy_count = copies->count,
                                        .copy_normal = copies->normal,
                                        .copy_point = copies->point,
                                        .copy_patch = copies->patch,
                                        .copy_flags = copies->flags,
                                        .patch_labels = (const uint32_t(*)[2])patch_labels};
    const bool ok = progressive_order(&in, pool, order, e);
    free(patch_labels);
    return ok;
}

typedef struct numbered {
    uint32_t id, index;
} numbered;

static int compare_ids(const void *a, const void *b)
{
    const numbered *p = a, *q = b;
    return (p->id > q->id) - (p->id < q->id);
}

static bool order_by_id(const points *set, uint32_t *order, error *e)
{
    numbered *list = mem_array(set->count, sizeof *list, what, e);
    if (!list) return false;
    for (size_t i = 0; i < set->count; i++) list[i] = (numbered){set->id[i], (uint32_t)i};
    qsort(list, set->count, sizeof *list, compare_ids);
    for (size_t k = 0; k < set->count; k++) order[k] = list[k].index;
    free(list);
    return true;
}

/* Sorts the points that are kept by their rows, followed by the other points. `row` NULL: none is kept. */
static void order_by_row(const uint32_t *row, size_t count, uint32_t *order)
{
    size_t next = 0;
    for (size_t i = 0; row && i < count; i++) next += row[i] != GIVEN_POINTS_NEW;
    for (size_t i = 0; i < count; i++)
        order[row && row[i] != GIVEN_POINTS_NEW ? row[i] : next++] = (uint32_t)i;
}

static void leave_out(const bool *taken, point_order *out)
{
    size_t count = 0;
    for (size_t k = 0; k < out->count; k++)
        if (taken[out->order[k]]) out->order[count++] = out->order[k];
    out->count = count;
}

bool point_order_find(const spec *s, const points *set, const solver_points *solved,
                      const point_order_known *known, const label_surface *labels, const given_points *given,
                      const avoided_points *avoided, const threads *pool, point_order *out, error *e)
{
    bool ok = true;
    *out = (point_order){.count = set->count};
    if (!s->has_order && !given->row && !avoided->taken) return true;
    out->order = mem_array(set->count, sizeof *out->order, what, e);
    out->place = mem_array(set->count, sizeof *out->place, what, e);
    if (!out->order || !out->place) return false;
    if (!s->has_order)
        order_by_row(given->row, set->count, out->order);
    else
        ok = s->order == SPEC_ORDER_PROGRESSIVE
                 ? order_progressively(solved, known, labels, pool, out->order, e)
             : s->order == SPEC_ORDER_SPATIAL ? morton_order(set->position, set->count, NULL, out->order, e)
                                              : order_by_id(set, out->order, e);
    if (ok && avoided->taken) leave_out(avoided->taken, out);
    for (size_t i = 0; i < set->count; i++) out->place[i] = UINT32_MAX;
    for (size_t k = 0; ok && k < out->count; k++) out->place[out->order[k]] = (uint32_t)k;
    return ok;
}

/* The arrays of a set, with their bytes per element. The array with elements of 4 bytes is the last one, so
 * that all arrays are aligned. */
static const struct {
    size_t member, size;
} arrays[] = {
    {offsetof(points, position), sizeof(vec3)},  {offsetof(points, normal), sizeof(vec3)},
    {offsetof(points, velocity), sizeof(vec3)},  {offsetof(points, kappa), sizeof(double)},
    {offsetof(points, kappa1), sizeof(double)},  {offsetof(points, kappa2), sizeof(double)},
    {offsetof(points, alpha), sizeof(double)},   {offsetof(points, energy), sizeof(double)},
    {offsetof(points, spacing), sizeof(double)}, {offsetof(points, spacing_local), sizeof(double)},
    {offsetof(points, degree), sizeof(double)},  {offsetof(points, kappa_scale), sizeof(double)},
    {offsetof(points, id), sizeof(uint32_t)},
};
enum { ARRAYS = sizeof arrays / sizeof *arrays };

static const void *array_at(const points *set, size_t k)
{
    const void *array;
    memcpy(&array, (const char *)set + arrays[k].member, sizeof array);
    return array;
}

bool point_order_apply(point_order *order, points *set, attributes *a, error *e)
{
    size_t bytes = 0;
    if (!order->order) return true;
    for (size_t k = 0; k < ARRAYS; k++)
        if (array_at(set, k)) bytes += arrays[k].size;
    set->count = order->count;
    char *next = order->storage = mem_array(set->count, bytes, what, e);
    if (!next || !attributes_permute(a, order->order, set, e)) return false;
    for (size_t k = 0; k < ARRAYS; k++) {
        const char *from = array_at(set, k);
        const size_t size = arrays[k].size;
        if (!from) continue;
        memcpy((char *)set + arrays[k].member, &next, sizeof next);
        for (size_t i = 0; i < set->count; i++, next += size)
            memcpy(next, from + size * order->order[i], size);
    }
    return true;
}

void point_order_free(point_order *order)
{
    free(order->order);
    free(order->place);
    free(order->storage);
    *order = (point_order){0};
}
