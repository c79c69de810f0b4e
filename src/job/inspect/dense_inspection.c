// SPDX-License-Identifier: Apache-2.0
#include "job/inspect/dense_inspection.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "io/volumes/volume_file.h"
#include "job/inspect/frame.h"
#include "job/inspect/suggestion.h"
#include "job/inspect/value_statistics.h"
#include "surface/labels/label_listing.h"
#include "files/sent_file.h"
#include "files/root.h"

int dense_inspection_open_beside(void *context, const char *path, error *e)
{
    return store_open_input(((const contents_input *)context)->options->roots, path, e);
}

/* Slices that count the values while they are read by other code. */
typedef struct counting_slices {
    slices base; /* first: the slices' functions get this pointer */
    slices *from;
    values *values;
    int64_t passed; /* number of slices that were counted */
    error fault;    /* error of reading */
} counting_slices;

static bool counted_read(slices *base, int64_t k, double *number, error *e)
{
    counting_slices *c = (counting_slices *)base;
    const bool ok = c->from->ops->read(c->from, k, number, &c->fault);
    c->passed = k + 1;
    memcpy(base->inexact, c->from->inexact, sizeof base->inexact);
    if (ok)
        value_statistics_add(c->values, number, (size_t)(base->size[0] * base->size[1]));
    else if (e)
        *e = c->fault;
    return ok;
}

static const slices_ops counted_ops = {.read = counted_read};

static counting_slices counted_of(slices *s, values *v)
{
    counting_slices c = {.base = *s, .from = s, .values = v};
    c.base.ops = &counted_ops;
    return c;
}

/* Reads and counts the slices that were not read yet. */
static bool count_rest(counting_slices *c, size_t memory_limit, error *e)
{
    const int64_t *size = c->base.size;
    const size_t count = (size_t)(size[0] * size[1]);
    if (c->fault.code) {
        if (e) *e = c->fault;
        return false;
    }
    if (count > memory_limit / sizeof(double))
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "a slice of %lld x %lld samples exceeds the memory limit: raise it",
                         (long long)size[0], (long long)size[1]);
    double *slice = mem_array(count, sizeof *slice, "a slice of the volume", e);
    bool ok = slice != NULL;
    while (ok && c->passed < size[2]) ok = counted_read(&c->base, c->passed, slice, e);
    free(slice);
    return ok;
}

static void describe_slices(const slices *s, json *o)
{
    static const int64_t first[3];
    const int64_t last[3] = {s->size[0] - 1, s->size[1] - 1, s->size[2] - 1};
    json *size = json_put_array(o, "size");
    for (int k = 0; k < 3; k++) json_append_number(size, (double)s->size[k]);
    json_put_string(o, "space", *s->space ? s->space : NULL);
    json *warnings = s->warnings.count > 0 ? json_put_array(o, "warnings") : NULL;
    for (uint32_t k = 0; k < s->warnings.count; k++) json_append_string(warnings, s->warnings.text[k]);
    frame_describe(s->index_to_world, first, last, o);
}

/* The object `surface` of a spec for the file. */
static json *shape_of(const char *kind, const json *file)
{
    json *shape = json_new_object();
    json_put(shape, kind, json_copy(file));
    return shape;
}

static bool suggest_isovalues(const contents_input *in, values *v, double voxels, const char *kind,
                              const json *file, json *suggestions, error *e)
{
    double at[VALUE_STATISTICS_CANDIDATES];
    const size_t count = value_statistics_candidates(v, at);
    char *isovalue = mem_printf("/%s/isovalue", kind);
    bool ok = true;
    for (size_t k = 0; ok && k < count; k++) {
        json *tried = shape_of(kind, file);
        json_set(tried, isovalue, json_new_number(at[k]));
        ok = suggestion_append(suggestions, tried, voxels, in->options, e);
    }
    free(isovalue);
    return ok;
}

/* Labels are not suggested for values that cannot be labels, or that do not fit into memory. */
bool dense_inspection_describe(const contents_input *in, slices *s, const char *kind, const json *file,
                               json *o, json *suggestions, error *e)
{
    enum {
        FEW = 2
    }; /* maximum number of labels of a volume that may be a mask; its isovalue is suggested first */
    const spec_labels all = {0};
    const size_t memory = run_options_memory(in->options, 0);
    const double voxels = (double)s->size[0] * (double)s->size[1] * (double)s->size[2];
    values v = value_statistics_begin();
    label_volume labels = {0};
    error unused = {0};
    counting_slices passing = counted_of(s, &v);
    describe_slices(s, o);
    const bool are_labels =
        label_volume_read(&passing.base, &all, memory, &labels, &unused) && label_listing_suits(&labels);
    bool ok = count_rest(&passing, memory, e);
    if (ok) value_statistics_describe(&v, o);
    if (ok && are_labels) ok = label_listing_describe(&labels, json_put_array(o, "labels"), e);
    if (!ok) error_prefix(e, "%s", in->path);
    const bool first = are_labels && labels.count > FEW;
    label_volume_free(&labels);
    if (ok && first) ok = suggestion_append(suggestions, shape_of("labels", file), voxels, in->options, e);
    ok = ok && suggest_isovalues(in, &v, voxels, kind, file, suggestions, e);
    if (ok && are_labels && !first)
        ok = suggestion_append(suggestions, shape_of("labels", file), voxels, in->options, e);
    value_statistics_free(&v);
    return ok;
}

bool dense_inspection_describe_volume(const contents_input *in, slices *s, json *file, json *inspection,
                                      error *e)
{
    json *o = json_put_object(inspection, "volume");
    json_put_string(inspection, "format", s->format);
    json_put_string(o, "type", s->type);
    json_put_integer(o, "volumes", s->volumes > 1 ? s->volumes : 1);
    if (s->volumes > 1) json_put_integer(file, "index", 0);
    return dense_inspection_describe(in, s, "volume", file, o, json_find(inspection, "/suggestions"), e);
}

slices *dense_inspection_open(const contents_input *in, const slices_files *files, error *e)
{
    const volume_file file = {
        .fd = in->fd, .path = in->path, .files = files, .memory_limit = run_options_memory(in->options, 0)};
    return volume_file_open(&file, e);
}

bool contents_read_dense(const contents_input *in, json *inspection, error *e)
{
    const slices_files files = {dense_inspection_open_beside, (void *)in};
    slices *s = dense_inspection_open(in, &files, e);
    if (!s) {
        sent_file_explain_header(in->path, e);
        return error_prefix(e, "%s", in->path);
    }
    json *file = json_new_object();
    json_put_string(file, "path", in->path);
    const bool ok = dense_inspection_describe_volume(in, s, file, inspection, e);
    json_free(file);
    s->ops->close(s);
    return ok;
}
