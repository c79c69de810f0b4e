// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_volume.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/precision.h"
#include "geometry/space/affine.h"
#include "geometry/space/block_map.h"

static const char what[] = "the labels of the volume";

/* The labels found so far: their values, numbered in the order of their occurrence. */
typedef struct label_read {
    block_map numbers; /* key: the low and the high 32 bits of the value, and 0 */
    const slices *from;
    label_volume *out;
    size_t room;
} label_read;

static bool number_of(label_read *r, double value, uint16_t *number, error *e)
{
    if (!(fabs(value) <= (double)PRECISION_WHOLE_MOST) || value != rint(value)) {
        char text[32];
        snprintf(text, sizeof text, "%.17g", value);
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the value %s is not a label (a whole number up to %" PRId64
                         "): for a volume of other values, use surface.volume with an isovalue",
                         value == rint(value) && *r->from->inexact ? r->from->inexact : text,
                         PRECISION_WHOLE_MOST);
    }
    const uint64_t bits = (uint64_t)(int64_t)value;
    uint32_t n;
    if (!block_map_find_or_add(&r->numbers, (int32_t)(uint32_t)bits, (int32_t)(uint32_t)(bits >> 32), 0, &n,
                               e))
        return false;
    label_volume *v = r->out;
    if (n == v->count) {
        if (v->count == LABEL_VOLUME_MOST)
            return error_set(
                e, ERROR_INPUT_UNSUPPORTED,
                "the volume has more than %d labels: for an image, use surface.volume with an isovalue",
                LABEL_VOLUME_MOST);
        if (!MEM_GROW(v->material, v->count, &r->room, what, e)) return false;
        v->material[v->count] = (label_material){.value = (int64_t)value};
        label_material_clear(&v->material[v->count++]);
    }
    *number = (uint16_t)n;
    return true;
}

/* Reads the slices into the array, `around` voxels away from its faces. */
static bool read_voxels(label_read *r, slices *from, int64_t around, error *e)
{
    const int64_t *size = from->size;
    label_volume *v = r->out;
    double *values = mem_array((size_t)(size[0] * size[1]), sizeof *values, "a slice of the volume", e);
    bool ok = values != NULL;
    for (int64_t z = 0; ok && z < size[2]; z++) {
        ok = from->ops->read(from, z, values, e);
        for (int64_t y = 0; ok && y < size[1]; y++) {
            const double *row = values + y * size[0];
            uint16_t *to = v->at + ((z + around) * v->size[1] + y + around) * v->size[0] + around;
            for (int64_t x = 0; ok && x < size[0]; x++) {
                if (x > 0 && row[x] == row[x - 1])
                    to[x] = to[x - 1];
                else
                    ok = number_of(r, row[x], &to[x], e);
                if (ok) label_material_note(&v->material[to[x]], (const int64_t[3]){x, y, z});
            }
        }
    }
    free(values);
    return ok;
}

/* ---- conversion of labels to materials */

static bool contains(const spec_list *l, int64_t value)
{
    for (size_t k = 0; k < l->count; k++)
        if (l->number[k] == (double)value) return true;
    return false;
}

/* The value that a label of the file is mapped to: the first one of its group, or the background if it is
 * not chosen. */
static int64_t counts_as(const spec_labels *c, int64_t value, int64_t background)
{
    for (size_t g = 0; g < c->group_count; g++)
        if (contains(&c->groups[g], value)) value = (int64_t)c->groups[g].number[0];
    return c->only.count > 0 && !contains(&c->only, value) ? background : value;
}

static bool is_there(const label_volume *v, double value)
{
    for (size_t k = 0; k < v->count; k++)
        if ((double)v->material[k].value == value) return true;
    return false;
}

static bool check_choice(const label_volume *v, const spec_labels *c, error *e)
{
    for (size_t k = 0; k < c->only.count; k++)
        if (!is_there(v, c->only.number[k]))
            return error_set(
                e, ERROR_SPEC_INVALID,
                "/surface/labels/labels: no voxel has the label %.0f: run hexadctl inspect for the "
                "labels of the file",
                c->only.number[k]);
    return true;
}

/* The background: the value that is specified; else 0 if labels are chosen and 0 is not one of them; else
 * one less than all values. */
static int64_t background_of(const label_volume *v, const spec_labels *c)
{
    int64_t least = 0;
    if (c->has_background) return (int64_t)c->background;
    if (c->only.count > 0 && !contains(&c->only, 0)) return 0;
    for (size_t k = 0; k < v->count; k++)
        if (v->material[k].value < least) least = v->material[k].value;
    return least - 1;
}

static bool is_asked(const spec_labels *c, const label_material *m)
{
    bool asked = c->interface_count == 0;
    for (size_t k = 0; k < c->interface_count; k++) asked |= contains(&c->interfaces[k], m->value);
    return asked && !m->background;
}

static int by_value(const void *left, const void *right)
{
    const label_material *a = left, *b = right;
    if (a->background != b->background) return a->background - b->background;
    return (a->value > b->value) - (a->value < b->value);
}

static void unite(label_material *to, const label_material *from)
{
    to->voxels += from->voxels;
    for (int k = 0; k < 3; k++) {
        if (from->low[k] < to->low[k]) to->low[k] = from->low[k];
        if (from->high[k] > to->high[k]) to->high[k] = from->high[k];
    }
}

/* The index of a value in the list. Appends it if it is missing. */
static size_t place_of(label_material *list, size_t *count, int64_t value)
{
    for (size_t k = 0; k < *count; k++)
        if (list[k].value == value) return k;
    list[*count] = (label_material){.value = value};
    label_material_clear(&list[*count]);
    return (*count)++;
}

/* Maps labels to materials in ascending order, and replaces the voxels. `outside`: the number of voxels of
 * the layer around the volume. */
static bool make_materials(label_volume *v, const spec_labels *c, bool is_background_needed, error *e)
{
    const int64_t background = background_of(v, c);
    const size_t labels = v->count;
    label_material *made = mem_array(labels + 1, sizeof *made, what, e);
    int64_t *as = mem_array(labels + 1, sizeof *as, what, e);
    uint16_t *to = mem_array((size_t)LABEL_VOLUME_MOST + 1, sizeof *to, what, e);
    size_t count = 0;
    bool ok = made && as && to;
    for (size_t k = 0; ok && k < labels; k++) {
        as[k] = counts_as(c, v->material[k].value, background);
        unite(&made[place_of(made, &count, as[k])], &v->material[k]);
    }
    if (ok && is_background_needed) place_of(made, &count, background);
    for (size_t k = 0; ok && k < count; k++) {
        made[k].background =
            made[k].value == background && (c->has_background || c->only.count > 0 || is_background_needed);
        made[k].asked = is_asked(c, &made[k]);
    }
    if (ok) {
        qsort(made, count, sizeof *made, by_value);
        for (size_t k = 0; k < labels; k++) to[k] = (uint16_t)place_of(made, &count, as[k]);
        to[LABEL_VOLUME_MOST] = (uint16_t)(is_background_needed ? count - 1 : 0);
        const size_t voxels = (size_t)(v->size[0] * v->size[1] * v->size[2]);
        for (size_t k = 0; k < voxels; k++) v->at[k] = to[v->at[k]];
        free(v->material);
        v->material = made;
        v->count = count;
    } else {
        free(made);
    }
    free(as);
    free(to);
    return ok;
}

static bool make_room(label_volume *v, const slices *from, int64_t around, size_t memory_limit, error *e)
{
    double voxels = 1;
    v->around = around;
    for (int k = 0; k < 3; k++) {
        v->size[k] = from->size[k] + 2 * around;
        voxels *= (double)v->size[k];
        for (int j = 0; j < 4; j++) v->index_to_world[k][j] = from->index_to_world[4 * k + j];
    }
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++)
            v->index_to_world[k][3] -= (double)around * from->index_to_world[4 * k + j];
    const double needed = voxels * sizeof *v->at;
    if (needed > (double)memory_limit)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "its %.0f voxels require %.0f MiB, and %zu MiB of the limit are left: raise "
                         "limits.memory_mb by at least %.0f",
                         voxels, ceil(needed / (1 << 20)), memory_limit >> 20,
                         ceil((needed - (double)memory_limit) / (1 << 20)));
    v->at = mem_array((size_t)voxels, sizeof *v->at, what, e);
    if (v->at && around) /* all voxels become LABEL_VOLUME_MOST: outside the volume */
        memset(v->at, 0xff, (size_t)voxels * sizeof *v->at);
    return v->at != NULL;
}

double label_volume_sides(const label_volume *v, double side[3])
{
    double least = INFINITY;
    for (int k = 0; k < 3; k++) {
        side[k] = vec3_norm(affine_axis(v->index_to_world, k));
        least = fmin(least, side[k]);
    }
    return least;
}

bool label_volume_read(slices *from, const spec_labels *choice, size_t memory_limit, label_volume *out,
                       error *e)
{
    label_volume made = {0};
    label_read r = {.out = &made, .from = from};
    const int64_t around = choice->closed;
    bool ok = make_room(&made, from, around, memory_limit, e) && block_map_init(&r.numbers, 64, e) &&
              read_voxels(&r, from, around, e) && check_choice(&made, choice, e) &&
              make_materials(&made, choice, choice->closed, e);
    block_map_free(&r.numbers);
    if (ok)
        *out = made;
    else
        label_volume_free(&made);
    return ok;
}

void label_volume_free(label_volume *v)
{
    free(v->at);
    free(v->material);
    *v = (label_volume){0};
}

size_t label_volume_bytes(const label_volume *v)
{
    return (size_t)(v->size[0] * v->size[1] * v->size[2]) * sizeof *v->at + v->count * sizeof *v->material;
}
