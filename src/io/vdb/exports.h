// SPDX-License-Identifier: Apache-2.0
/* exports: the functions of vdb.h as a table, for programs that load the shim as a module. */
#ifndef HEXAD_IO_VDB_EXPORTS_H
#define HEXAD_IO_VDB_EXPORTS_H

#include "io/vdb/vdb.h"

#define VDB_MODULE "hexad-vdb.so"
#define VDB_EXPORTS "hexad_vdb_exports"

typedef struct vdb_exports {
    bool (*list_grids)(int fd, vdb_listing *out, error *e);
    vdb_grid *(*load_grid)(int fd, size_t index, vdb_loading how, size_t memory_limit, error *e);
    bool (*visit_grid)(int fd, size_t index, size_t memory_limit, vdb_visitor *visit, void *context,
                       error *e);
    bool (*write_grids)(int fd, const vdb_draft *drafts, size_t count, vdb_layout layout, bool compressed,
                        error *e);
    bool (*write_points)(FILE *file, const vdb_points *points, error *e);
} vdb_exports;

/* The one symbol of the module. */
extern const vdb_exports hexad_vdb_exports;

#endif
