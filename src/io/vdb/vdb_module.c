// SPDX-License-Identifier: Apache-2.0
/* vdb.h for a program that loads the shim when a file is first opened. */
#include "io/vdb/exports.h"

#include "base/core/module.h"

static const vdb_exports *load(error *e)
{
    return module_symbol(VDB_MODULE, VDB_EXPORTS, e);
}

bool vdb_list_grids(int fd, vdb_listing *out, error *e)
{
    const vdb_exports *shim = load(e);
    return shim && shim->list_grids(fd, out, e);
}

vdb_grid *vdb_load_grid(int fd, size_t index, vdb_loading how, size_t memory_limit, error *e)
{
    const vdb_exports *shim = load(e);
    return shim ? shim->load_grid(fd, index, how, memory_limit, e) : NULL;
}

bool vdb_visit_grid(int fd, size_t index, size_t memory_limit, vdb_visitor *visit, void *context, error *e)
{
    const vdb_exports *shim = load(e);
    return shim && shim->visit_grid(fd, index, memory_limit, visit, context, e);
}

bool vdb_write_grids(int fd, const vdb_draft *drafts, size_t count, vdb_layout layout, bool compressed,
                     error *e)
{
    const vdb_exports *shim = load(e);
    return shim && shim->write_grids(fd, drafts, count, layout, compressed, e);
}

bool vdb_write_points(FILE *file, const vdb_points *points, error *e)
{
    const vdb_exports *shim = load(e);
    return shim && shim->write_points(file, points, e);
}
