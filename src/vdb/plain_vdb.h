/* plain_vdb: the usual OpenVDB files without the library, whose 52 000 symbols take the dynamic linker longer than a small
 * job, and whose tree is a second copy of the voxels.
 *
 * Usual are files of format versions 222 to 224 with offsets, and of their grids those of floats (whole or half), without a
 * tree shared with others, of an affine transform. Whatever else there is, or is wrong, the library is to look at: nothing
 * is an error here. What is read is what vdb.h's functions give; but voxels smaller than 1e-5, whose transform the library
 * takes for singular, and any identifier of a file are accepted. Lengths are checked against the file's before they are
 * believed. Threads: calls share no state; values are unpacked by those of a pool, which may be NULL and does not show.
 */
#ifndef HEXAD_VDB_PLAIN_VDB_H
#define HEXAD_VDB_PLAIN_VDB_H

#include "base/threads.h"
#include "vdb/vdb.h"

#ifdef __cplusplus
extern "C" {
#endif

/* As vdb_list_grids, where every grid's type is one that vdb_visit_grid takes; false: ask the library. */
bool plain_vdb_list_grids(int fd, vdb_listing *out);

/* As vdb_load_grid; NULL: ask the library. */
vdb_grid *plain_vdb_load_grid(int fd, size_t index, size_t memory_limit, threads *pool);

#ifdef __cplusplus
}
#endif

#endif
