// SPDX-License-Identifier: Apache-2.0
/* plain_vdb: reads usual OpenVDB files without the library. The dynamic linker needs more time for its 52 000
 * symbols than a small job takes, and its tree is a second copy of the voxels.
 *
 * A usual file has a format version from 222 to 224 and offsets. A usual grid has floats (whole or half), an
 * affine transform and a tree of its own. All other files, and all faults, are left to the library: no
 * function returns an error. Results equal those of the functions of vdb.h, with two exceptions: voxels
 * smaller than 1e-5, whose transform the library considers singular, and any identifier of a file are
 * accepted. Lengths are checked against the length of the file before they are used. Calls share no state;
 * the threads of a pool, which may be NULL, unpack the values. Results do not depend on the pool.
 */
#ifndef HEXAD_IO_VDB_PLAIN_VDB_H
#define HEXAD_IO_VDB_PLAIN_VDB_H

#include "base/core/threads.h"
#include "io/vdb/vdb.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Like vdb_list_grids, if vdb_visit_grid accepts the type of every grid. False: use the library. */
bool plain_vdb_list_grids(int fd, vdb_listing *out);

/* Like vdb_load_grid. NULL: use the library. */
vdb_grid *plain_vdb_load_grid(int fd, size_t index, size_t memory_limit, threads *pool);

#ifdef __cplusplus
}
#endif

#endif
