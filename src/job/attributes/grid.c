// SPDX-License-Identifier: Apache-2.0
#include "job/attributes/grid.h"

#include <string.h>

#include "job/attributes/lattice.h"
#include "io/vdb/vdb.h"
#include "surface/volume/grid_selection.h"

static bool find_entry(const attribute_request *request, size_t *index, vdb_entry *out, error *e)
{
    vdb_listing listing;
    if (!vdb_list_grids(request->fd, &listing, e)) return false;
    bool ok = grid_selection_find_numeric(&listing, request->name, index, e);
    if (ok) *out = listing.entries[*index];
    vdb_listing_free(&listing);
    return ok;
}

/* Converts the type of a grid to a kind and a number of components. */
static void describe(const char *type, point_attribute_kind *kind, int *components)
{
    bool vector = strncmp(type, "vec", 3) == 0;
    bool whole = strncmp(type, "int", 3) == 0 || strcmp(type, "bool") == 0;
    *components = vector ? 3 : 1;
    *kind = vector ? POINT_ATTRIBUTE_VECTOR : whole ? POINT_ATTRIBUTE_INT : POINT_ATTRIBUTE_FLOAT;
}

bool grid_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e)
{
    size_t index;
    vdb_entry entry;
    if (!find_entry(request, &index, &entry, e)) return false;
    describe(entry.type, kind, components);
    return true;
}

typedef struct value_job {
    const attribute_request *request;
    size_t count;
    const vec3 *position;
    double *values;
    attribute_counts *counts;
} value_job;

static bool read_voxel(const void *context, const int32_t at[3], double value[4])
{
    const vdb_voxels *voxels = context;
    return voxels->read(voxels, at, value);
}

static bool read_values(void *context, const vdb_voxels *voxels, error *e)
{
    const value_job *r = context;
    lattice l = {.components = voxels->components,
                 .staggered = voxels->grid_class == VDB_STAGGERED && voxels->components == 3,
                 .kind = r->request->kind,
                 .read = read_voxel,
                 .context = voxels};
    (void)e;
    lattice_place(r->request, voxels->index_to_world, &l);
    if (voxels->whole) l.stencil = STENCIL_NEAREST;
    for (size_t i = 0; i < r->count; i++)
        lattice_value(&l, r->position[i], r->values + (size_t)l.components * i, r->counts);
    return true;
}

bool grid_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
               attribute_counts *counts, error *e)
{
    size_t index;
    vdb_entry entry;
    value_job r = {request, count, position, values, counts};
    if (!find_entry(request, &index, &entry, e) ||
        !vdb_visit_grid(request->fd, index, request->memory_limit, read_values, &r, e))
        return false;
    /* voxels without data are false, not outside */
    if (strcmp(entry.type, "bool") == 0) counts->outside = 0;
    return true;
}
