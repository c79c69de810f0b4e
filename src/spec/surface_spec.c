// SPDX-License-Identifier: Apache-2.0
#include "spec/surface_spec.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/frames.h"
#include "base/core/memory.h"

bool surface_spec_parse_slices(spec_exr *x, int *from, int *step)
{
    int first, last, by = 1, end = 0;
    int got = sscanf(x->slices, "%8d-%8d%nx%8d%n", &first, &last, &end, &by, &end);
    if (got < 2 || x->slices[end] || first < 0 || last <= first || by < 1) return false;
    int count = (last - first) / by + 1;
    if (count < 2 || count > SURFACE_SPEC_MOST_SLICES) return false;
    x->count = (size_t)count;
    *from = first;
    *step = by;
    return true;
}

bool surface_spec_name_slices(spec_exr *x, int from, int step)
{
    if (!frames_is_pattern(x->path)) return false;
    x->numbers = mem_alloc(x->count * sizeof *x->numbers);
    for (size_t k = 0; k < x->count; k++) x->numbers[k] = from + (int)k * step;
    x->files = frames_paths(x->path, x->numbers, x->count);
    return !frames_is_pattern(x->files[0]);
}

/* The number in the path of a stack is that of the slice, so it is not replaced. */
void surface_spec_rename(spec_surface *s, surface_spec_renamer *rename, const void *by)
{
    char **const single[] = {&s->vdb.path, &s->mesh.path, &s->volume.path, &s->bspline.path, &s->labels.path};
    for (size_t k = 0; k < sizeof single / sizeof single[0]; k++) {
        char *old = *single[k];
        if (!old) continue;
        *single[k] = rename(old, by);
        free(old);
    }
    for (size_t k = 0; k < s->part_count; k++) surface_spec_rename(s->parts[k], rename, by);
}

bool surface_spec_input_at(const spec_surface *s, size_t *index, spec_input *out)
{
    const char *const single[] = {s->vdb.path, s->mesh.path, s->volume.path, s->bspline.path, s->labels.path};
    for (size_t k = 0; k < sizeof single / sizeof single[0]; k++) {
        if (!single[k] || (*index)-- > 0) continue;
        *out = (spec_input){s->input_pointer, single[k], false};
        return true;
    }
    if (*index < s->exr.count) {
        *out = (spec_input){s->input_pointer, s->exr.files[*index], true};
        return true;
    }
    *index -= s->exr.count;
    for (size_t k = 0; k < s->part_count; k++)
        if (surface_spec_input_at(s->parts[k], index, out)) return true;
    return false;
}

static void free_lists(spec_list *list, size_t count)
{
    for (size_t k = 0; k < count; k++) free(list[k].number);
    free(list);
}

void surface_spec_free_parts(spec_surface *s)
{
    free(s->input_pointer);
    free(s->vdb.path);
    free(s->vdb.grid);
    free(s->bspline.coefficients);
    free(s->bspline.path);
    free(s->mesh.path);
    free(s->volume.path);
    free(s->labels.path);
    free(s->labels.grid);
    free(s->labels.only.number);
    free_lists(s->labels.groups, s->labels.group_count);
    free_lists(s->labels.interfaces, s->labels.interface_count);
    free(s->exr.path);
    free(s->exr.slices);
    free(s->exr.part);
    free(s->exr.channel);
    mem_free_texts(s->exr.files, s->exr.count);
    free(s->exr.numbers);
    for (size_t k = 0; k < s->part_count; k++) {
        surface_spec_free_parts(s->parts[k]);
        free(s->parts[k]);
    }
    free(s->parts);
    free(s->matrix);
}
