#include "inspect/dense.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "dense/header.h"
#include "dense/raw_volume.h"
#include "inspect/frame.h"
#include "inspect/suggestion.h"
#include "inspect/values.h"
#include "labels/label_listing.h"
#include "store/root.h"

static const char *const type_names[HEADER_TYPE_COUNT] = {"int8",   "uint8", "int16",  "uint16", "int32",
                                                          "uint32", "int64", "uint64", "float",  "double"};

int dense_open_beside(void *context, const char *path, error *e)
{
    return store_open_input(((const contents_input *)context)->options->roots, path, e);
}

static bool add_slices(slices *s, size_t memory_limit, values *v, error *e)
{
    size_t count = (size_t)(s->size[0] * s->size[1]);
    if (count > memory_limit / sizeof(float))
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "a slice of %lld x %lld samples does not fit into the memory limit",
                         (long long)s->size[0], (long long)s->size[1]);
    float *slice = mem_array(count, sizeof *slice, "a slice of the volume", e);
    bool ok = slice && s->ops->begin(s, e);
    for (int64_t z = 0; ok && z < s->size[2]; z++) {
        ok = s->ops->next(s, slice, e);
        if (ok) values_add(v, slice, count);
    }
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
    if (*s->warning) json_put_string(o, "warning", s->warning);
    frame_describe(s->index_to_world, first, last, o);
}

bool dense_describe(const contents_input *in, slices *s, const json *shape, const char *isovalue, json *o,
                    json *suggestions, error *e)
{
    double at[VALUES_CANDIDATES];
    const double voxels = (double)s->size[0] * (double)s->size[1] * (double)s->size[2];
    values v = values_begin();
    describe_slices(s, o);
    bool ok = add_slices(s, (size_t)in->options->memory_mb << 20, &v, e) || error_prefix(e, "%s", in->path);
    if (ok) values_describe(&v, o);
    size_t count = ok ? values_candidates(&v, at) : 0;
    values_free(&v);
    for (size_t k = 0; ok && k < count; k++) {
        json *tried = json_copy(shape);
        json_set(tried, isovalue, json_new_number(at[k]));
        ok = suggestion_append(suggestions, tried, voxels, in->options, e);
    }
    return ok;
}

/* Labels are told, and their interfaces suggested; values that no label can have, or that do not fit into memory, are
 * none. */
static bool list_labels(const contents_input *in, slices *s, json *o, json *suggestions, error *e)
{
    const spec_labels all = {0};
    const double voxels = (double)s->size[0] * (double)s->size[1] * (double)s->size[2];
    label_volume v = {0};
    error unused = {0};
    bool ok = true;
    if (label_volume_read(s, &all, (size_t)in->options->memory_mb << 20, &v, &unused) &&
        label_listing_suits(&v)) {
        json *shape = json_new_object();
        json_put_string(json_put_object(shape, "labels"), "path", in->path);
        ok = label_listing_describe(&v, json_put_array(o, "labels"), e) || error_prefix(e, "%s", in->path);
        ok = ok ? suggestion_append(suggestions, shape, voxels, in->options, e) : (json_free(shape), false);
    }
    label_volume_free(&v);
    return ok;
}

bool contents_read_dense(const contents_input *in, json *inspection, error *e)
{
    header head;
    char *names = NULL;
    if (!header_read(in->fd, in->path, NULL, &head, &names, e)) return error_prefix(e, "%s", in->path);
    free(names);
    const slices_files files = {dense_open_beside, (void *)in};
    slices *s = raw_volume_open(in->fd, in->path, NULL, 0, &files, e);
    if (!s) return error_prefix(e, "%s", in->path);
    json *o = json_put_object(inspection, "volume");
    json_put_string(inspection, "format", head.format);
    json_put_string(o, "type", type_names[head.type]);
    json_put_integer(o, "volumes", head.volumes > 1 ? head.volumes : 1);
    describe_slices(s, o);
    json *shape = json_new_object();
    json *volume = json_put_object(shape, "volume");
    json_put_string(volume, "path", in->path);
    if (head.volumes > 1) json_put_integer(volume, "index", 0);
    json *suggestions = json_find(inspection, "/suggestions");
    bool ok = dense_describe(in, s, shape, "/volume/isovalue", o, suggestions, e) &&
              (head.volumes > 1 || list_labels(in, s, o, suggestions, e));
    json_free(shape);
    s->ops->close(s);
    return ok;
}
