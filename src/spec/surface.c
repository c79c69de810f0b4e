#include "spec/surface.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

static const int most_number = 99999999;

bool surface_parse_slices(spec_exr *x)
{
    int first, last, step = 1, end = 0;
    int got = sscanf(x->slices, "%9d-%9d%nx%9d%n", &first, &last, &end, &step, &end);
    if (got < 2 || x->slices[end] || first < 0 || last <= first || last > most_number || step < 1)
        return false;
    int count = (last - first) / step + 1;
    if (count < 2 || count > SURFACE_MOST_SLICES) return false;
    x->count = (size_t)count;
    x->numbers = mem_alloc(x->count * sizeof *x->numbers);
    for (int k = 0; k < count; k++) x->numbers[k] = first + k * step;
    return true;
}

/* #### or %04d replaced by the number; NULL when the pattern has not just one of them. */
static char *name_of_slice(const char *pattern, int number)
{
    size_t marks = strcspn(pattern, "#"), count = strspn(pattern + marks, "#"),
           percent = strcspn(pattern, "%");
    size_t at = count ? marks : percent, rest = at + count;
    int width = (int)count;
    if (!pattern[at] || (count && percent < at)) return NULL;
    if (!count) {
        size_t digits = strspn(pattern + at + 1, "0123456789");
        rest = at + 1 + digits + 1;
        if (digits > 2 || pattern[rest - 1] != 'd') return NULL;
        width = pattern[at + 1] == '0' ? atoi(pattern + at + 1) : 0;
    }
    if (strpbrk(pattern + rest, "#%")) return NULL;
    return mem_printf("%.*s%0*d%s", (int)at, pattern, width, number, pattern + rest);
}

bool surface_name_slices(spec_exr *x)
{
    x->files = mem_alloc(x->count * sizeof *x->files);
    for (size_t k = 0; k < x->count; k++)
        if (!(x->files[k] = name_of_slice(x->path, x->numbers[k]))) return false;
    return true;
}

bool surface_input_at(const spec_surface *s, size_t *index, spec_input *out)
{
    const char *const single[] = {s->vdb.path, s->mesh.path, s->volume.path, s->bspline.path};
    for (size_t k = 0; k < sizeof single / sizeof single[0]; k++) {
        if (!single[k] || (*index)-- > 0) continue;
        *out = (spec_input){s->input_pointer, single[k]};
        return true;
    }
    if (*index < s->exr.count) {
        *out = (spec_input){s->input_pointer, s->exr.files[*index]};
        return true;
    }
    *index -= s->exr.count;
    for (size_t k = 0; k < s->part_count; k++)
        if (surface_input_at(s->parts[k], index, out)) return true;
    return false;
}

void surface_free_parts(spec_surface *s)
{
    free(s->input_pointer);
    free(s->vdb.path);
    free(s->vdb.grid);
    free(s->bspline.coefficients);
    free(s->bspline.path);
    free(s->mesh.path);
    free(s->volume.path);
    free(s->exr.path);
    free(s->exr.slices);
    free(s->exr.part);
    free(s->exr.channel);
    for (size_t k = 0; s->exr.files && k < s->exr.count; k++) free(s->exr.files[k]);
    free(s->exr.files);
    free(s->exr.numbers);
    for (size_t k = 0; k < s->part_count; k++) {
        surface_free_parts(s->parts[k]);
        free(s->parts[k]);
    }
    free(s->parts);
    free(s->matrix);
}
