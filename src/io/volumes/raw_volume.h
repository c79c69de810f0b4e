// SPDX-License-Identifier: Apache-2.0
/* raw_volume: reads the values of an NRRD or NIfTI volume from their files, slice by slice.
 *
 * The header is read by volume_header.h. Data are unpacked and converted here, a buffer at a time, so that a volume
 * of any size takes no more memory than a slice. Sizes in the header are compared with the files before
 * anything is read.
 */
#ifndef HEXAD_IO_VOLUMES_RAW_VOLUME_H
#define HEXAD_IO_VOLUMES_RAW_VOLUME_H

#include "io/volumes/slices.h"

/* Opens a volume with one value per sample. `fd`, `path` and `files` remain the caller's and must outlive the
 * slices; `program` as in volume_header_read. Data files that a header names are opened beside `path`.
 * Errors: those of volume_header_read and of the opener. */
slices *raw_volume_open(int fd, const char *path, const char *program, int64_t index,
                        const slices_files *files, error *e);

/* As raw_volume_open, for a file that may have several values per sample. */
slices *raw_vectors_open(int fd, const char *path, const char *program, int64_t index,
                         const slices_files *files, error *e);

#endif
