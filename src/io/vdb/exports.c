// SPDX-License-Identifier: Apache-2.0
#include "io/vdb/exports.h"

__attribute__((visibility("default"))) const vdb_exports hexad_vdb_exports = {
    vdb_list_grids, vdb_load_grid, vdb_visit_grid, vdb_write_grids, vdb_write_points};
