// SPDX-License-Identifier: Apache-2.0
/* The contents of OME-Zarr directories. */
#include <stdlib.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "io/volumes/numbers.h"
#include "io/volumes/volume_file.h"
#include "io/volumes/zarr_metadata.h"
#include "job/inspect/contents.h"
#include "job/inspect/dense_inspection.h"
#include "files/tree.h"

/* Maximum number of voxels, and of chunks, of the level whose values are read; the finest such level is
 * chosen. */
static const double most_voxels = 1 << 26;
static const int64_t most_chunks = 100000;

static int open_below(void *context, const char *path, bool *is_missing, error *e)
{
    return store_tree_open(context, path, is_missing, e);
}

/* Adds a level to the list. Returns its number of voxels. */
static double describe_level(const zarr_metadata *m, json *o)
{
    double voxels = 1;
    json *size = json_put_array(o, "size"), *step = json_put_array(o, "voxel_size"),
         *chunk = json_put_array(o, "chunk");
    json_put_string(o, "path", m->path);
    json_put_string(o, "type", numbers_name(m->type));
    for (int k = 2; k >= 0; k--) {
        const int axis = m->space[k];
        voxels *= (double)m->shape[axis];
        json_append_number(size, (double)m->shape[axis]);
        json_append_number(chunk, (double)m->chunk[axis]);
        json_append_number(step, m->scale[k]);
    }
    return voxels;
}

/* Describes all levels. *chosen: the level whose values are read. */
static bool describe_levels(const slices_directory *d, json *list, int64_t *chosen, bool *is_ome, error *e)
{
    double voxels = 0;
    zarr_metadata m;
    for (int64_t level = 0; zarr_metadata_read(d, level, &m, e); level++) {
        const double before = voxels;
        voxels = describe_level(&m, json_append_object(list));
        *is_ome = m.is_ome;
        if (level == 0 || before > most_voxels) *chosen = level;
        if (!m.is_ome) return true;
    }
    if (e->code != ERROR_GRID_MISSING || json_size(json_root(list)) == 0) return false;
    *e = (error){0};
    return true;
}

bool contents_read_zarr(const contents_input *in, json *inspection, error *e)
{
    store_tree *tree = store_tree_new(dup(in->fd), false);
    const slices_directory directory = {open_below, tree};
    error fault = {0};
    int64_t level = 0;
    bool is_ome = false;
    slices *s = NULL;
    bool ok = describe_levels(&directory, json_put_array(inspection, "levels"), &level, &is_ome, &fault);
    if (ok) {
        const volume_file file = {.path = in->path,
                                  .memory_limit = run_options_memory(in->options, 0),
                                  .directory = &directory,
                                  .level = level,
                                  .most_chunks = most_chunks};
        ok = (s = volume_file_open(&file, &fault)) != NULL;
    }
    if (!ok) error_prefix(&fault, "%s", in->path);
    if (ok) {
        json *file = json_new_object();
        json_put_string(file, "path", in->path);
        if (is_ome) json_put_integer(file, "level", level);
        ok = dense_inspection_describe_volume(in, s, file, inspection, &fault);
        json_free(file);
        s->ops->close(s);
    }
    store_facts facts;
    bool has_changed;
    store_tree_facts(tree, &facts, &has_changed);
    json_put_integer(inspection, "bytes", (int64_t)facts.bytes);
    store_tree_free(tree);
    if (!ok && e) *e = fault;
    return ok;
}
