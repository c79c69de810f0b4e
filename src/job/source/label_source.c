// SPDX-License-Identifier: Apache-2.0
#include "job/source/label_source.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/core/file_format.h"
#include "base/core/precision.h"
#include "io/volumes/volume_file.h"
#include "surface/volume/grid_selection.h"

/* A grid as slices: the box of its active voxels, with a layer of the background around it. */
typedef struct grid_slices {
    slices base; /* first: the slices' functions get this pointer */
    const vdb_voxels *voxels;
    int32_t origin[3];
} grid_slices;

static bool grid_read(slices *base, int64_t k, double *values, error *e)
{
    grid_slices *s = (grid_slices *)base;
    (void)e;
    for (int32_t y = 0; y < base->size[1]; y++)
        for (int32_t x = 0; x < base->size[0]; x++) {
            const int32_t at[3] = {s->origin[0] + x, s->origin[1] + y, s->origin[2] + (int32_t)k};
            double value[3];
            s->voxels->read(s->voxels, at, value);
            if (fabs(value[0]) > (double)PRECISION_WHOLE_MOST && !*base->inexact)
                snprintf(base->inexact, sizeof base->inexact, "%" PRId64,
                         s->voxels->read_whole(s->voxels, at));
            *values++ = value[0];
        }
    return true;
}

static void grid_close(slices *base)
{
    (void)base;
}

static const slices_ops grid_ops = {grid_read, grid_close};

typedef struct visit {
    const label_source_request *request;
    label_surface *opened;
} visit;

static bool open_voxels(void *context, const vdb_voxels *voxels, error *e)
{
    visit *v = context;
    grid_slices s = {.base = {.ops = &grid_ops, .components = 1, .format = "VDB", .fine = true},
                     .voxels = voxels};
    if (!voxels->whole)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the grid does not hold whole numbers: give a grid of type int32 or int64");
    memcpy(s.base.index_to_world, voxels->index_to_world, sizeof s.base.index_to_world);
    for (int k = 0; k < 3; k++) {
        if (voxels->low[k] > voxels->high[k])
            return error_set(e, ERROR_NO_SURFACE, "the grid is empty (no active voxel): give another grid");
        s.origin[k] = voxels->low[k] - 1;
        s.base.size[k] = (int64_t)voxels->high[k] - voxels->low[k] + 3;
    }
    for (int row = 0; row < 3; row++)
        for (int k = 0; k < 3; k++)
            s.base.index_to_world[4 * row + 3] += voxels->index_to_world[4 * row + k] * s.origin[k];
    label_surface_request how = v->request->how;
    how.from = &s.base;
    v->opened = label_surface_open(&how, e);
    return v->opened != NULL;
}

/* Finds the named grid, or the only grid of whole numbers. */
static bool find_grid(const vdb_listing *l, const char *name, size_t *index, error *e)
{
    size_t found = 0;
    if (name) return grid_selection_find_numeric(l, name, index, e);
    for (size_t k = 0; k < l->count; k++)
        if (strcmp(l->entries[k].type, "int32") == 0 || strcmp(l->entries[k].type, "int64") == 0) {
            *index = k;
            found++;
        }
    if (found == 1) return true;
    return found == 0
               ? error_set(
                     e, ERROR_GRID_MISSING,
                     "the file has no grid of whole numbers: give a file with a grid of type int32 or int64")
               : error_set(e, ERROR_GRID_AMBIGUOUS,
                           "the file has %zu grids of whole numbers: choose one with surface.labels.grid",
                           found);
}

static label_surface *open_vdb(const label_source_request *r, error *e)
{
    vdb_listing listing;
    visit v = {.request = r};
    size_t index = 0;
    if (!vdb_list_grids(r->fd, &listing, e)) return NULL;
    if (find_grid(&listing, r->how.spec->grid, &index, e) &&
        !vdb_visit_grid(r->fd, index, r->how.memory_limit, open_voxels, &v, e) && v.opened) {
        label_surface_close(v.opened);
        v.opened = NULL;
    }
    vdb_listing_free(&listing);
    return v.opened;
}

static label_surface *refuse_members(error *e)
{
    error_set(e, ERROR_NOT_SUPPORTED,
              "an OpenVDB file has the size of its voxels and one resolution: remove voxel_size and level");
    return NULL;
}

label_surface *label_source_open(const label_source_request *request, error *e)
{
    const spec_labels *l = request->how.spec;
    const bool is_vdb = l->path && file_format_of_name(l->path) == FILE_FORMAT_VDB;
    if (request->array) {
        label_surface_request of_array = request->how;
        of_array.from = request->array;
        return label_surface_open(&of_array, e);
    }
    if (!request->stack && !request->directory && (l->grid || is_vdb))
        return request->voxel_size || l->has_level ? refuse_members(e) : open_vdb(request, e);
    const volume_file file = {.fd = request->fd,
                              .path = l->path,
                              .index = l->has_index ? l->index : -1,
                              .files = request->files,
                              .memory_limit = request->how.memory_limit,
                              .directory = request->directory,
                              .has_level = l->has_level,
                              .level = l->level,
                              .most_chunks = request->most_chunks,
                              .voxel_size = request->voxel_size};
    slices *from = request->stack ? volume_file_open_stack(request->stack, e) : volume_file_open(&file, e);
    if (!from) return NULL;
    label_surface_request how = request->how;
    how.from = from;
    label_surface *opened = label_surface_open(&how, e);
    from->ops->close(from);
    return opened;
}
