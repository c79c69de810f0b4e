// SPDX-License-Identifier: Apache-2.0
/* The contents of OpenVDB files. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "job/inspect/contents.h"
#include "job/inspect/frame.h"
#include "job/inspect/suggestion.h"
#include "job/inspect/value_statistics.h"
#include "io/vdb/vdb.h"
#include "surface/volume/grid_selection.h"

/* Maximum number of values that are counted for a tile: one for each leaf that it replaces. */
static const int64_t MOST_OF_A_TILE = 4096;

static const char *const class_names[] = {"unknown", "level set", "fog volume", "staggered"};

static void add_active(const vdb_grid *g, values *v, int64_t low[3], int64_t high[3])
{
    for (size_t leaf = 0; leaf < g->leaf_count; leaf++)
        for (int i = 0; i < VDB_LEAF_VOXELS; i++) {
            if (!(g->leaf_active[leaf * 8 + (size_t)i / 64] >> (i % 64) & 1)) continue;
            const int at[3] = {i / 64, i / 8 % 8, i % 8};
            for (int k = 0; k < 3; k++) {
                int64_t index = g->leaf_origin[leaf][k] + at[k];
                if (index < low[k]) low[k] = index;
                if (index > high[k]) high[k] = index;
            }
            const double value = (double)g->leaf_values[leaf * VDB_LEAF_VOXELS + (size_t)i];
            value_statistics_add(v, &value, 1);
        }
    for (size_t t = 0; t < g->tile_count; t++) {
        const vdb_tile *tile = &g->tiles[t];
        const double value = (double)tile->value;
        int64_t side = tile->side / VDB_LEAF_SIDE, leaves = side * side * side;
        if (!tile->active) continue;
        for (int k = 0; k < 3; k++) {
            if (tile->origin[k] < low[k]) low[k] = tile->origin[k];
            if (tile->origin[k] + tile->side - 1 > high[k]) high[k] = tile->origin[k] + tile->side - 1;
        }
        for (int64_t k = 0; k < leaves && k < MOST_OF_A_TILE; k++) value_statistics_add(v, &value, 1);
    }
}

static json *surface_of(const contents_input *in, const char *name, const double *isovalue)
{
    json *shape = json_new_object(), *vdb = json_put_object(shape, "vdb");
    json_put_string(vdb, "path", in->path);
    json_put_string(vdb, "grid", name);
    if (isovalue) json_put_number(vdb, "isovalue", *isovalue);
    return shape;
}

/* The isovalue of a level set is 0; isovalues of other grids are chosen from the range of their values. */
static bool suggest(const contents_input *in, const char *name, const vdb_grid *g, values *v,
                    json *suggestions, error *e)
{
    const double voxels = (double)g->leaf_count * VDB_LEAF_VOXELS;
    double at[VALUE_STATISTICS_CANDIDATES];
    if (g->grid_class == VDB_LEVEL_SET)
        return suggestion_append(suggestions, surface_of(in, name, NULL), voxels, in->options, e);
    /* where the voxels end and the background begins there is a surface, too */
    const double background = (double)g->background;
    value_statistics_add(v, &background, 1);
    size_t count = value_statistics_candidates(v, at);
    for (size_t k = 0; k < count; k++)
        if (!suggestion_append(suggestions, surface_of(in, name, &at[k]), voxels, in->options, e))
            return false;
    return true;
}

static bool describe_grid(const contents_input *in, size_t index, const char *name, json *o,
                          json *suggestions, error *e)
{
    error fault = {0};
    vdb_grid *g = vdb_load_grid(in->fd, index, (vdb_loading){0}, run_options_memory(in->options, 0), &fault);
    if (!g) { /* a damaged grid does not prevent the description of the others */
        json *told = json_put_object(o, "error");
        json_put_string(told, "code", error_code_name(fault.code));
        json_put_string(told, "message", fault.message);
        return true;
    }
    values v = value_statistics_begin();
    int64_t low[3] = {INT64_MAX, INT64_MAX, INT64_MAX}, high[3] = {INT64_MIN, INT64_MIN, INT64_MIN};
    add_active(g, &v, low, high);
    json_put_integer(o, "active_voxels", (int64_t)g->active_voxels);
    json_put_number(o, "background", (double)g->background);
    frame_describe(g->index_to_world, low, high, o);
    value_statistics_describe(&v, o);
    bool ok = suggest(in, name, g, &v, suggestions, e);
    value_statistics_free(&v);
    vdb_grid_free(g);
    return ok;
}

bool contents_read_vdb(const contents_input *in, json *inspection, error *e)
{
    vdb_listing listing;
    if (!vdb_list_grids(in->fd, &listing, e)) return error_prefix(e, "%s", in->path);
    json *grids = json_put_array(inspection, "grids"), *suggestions = json_find(inspection, "/suggestions");
    bool ok = true;
    for (size_t k = 0; ok && k < listing.count; k++) {
        const vdb_entry *entry = &listing.entries[k];
        char name[VDB_NAME_SIZE];
        json *o = json_append_object(grids);
        grid_selection_name(&listing, k, name);
        json_put_string(o, "name", name);
        json_put_string(o, "type", entry->type);
        json_put_string(o, "class", class_names[entry->grid_class]);
        json_put_bool(o, "scalar", entry->scalar);
        if (entry->scalar) ok = describe_grid(in, k, name, o, suggestions, e);
    }
    vdb_listing_free(&listing);
    return ok;
}
