/* raw_volume: the values of an NRRD or NIfTI volume, read from their files slice by slice.
 *
 * The header comes from header.h. Data are unpacked and converted here, a buffer at a time, so that a volume
 * of any size takes no more memory than a slice; sizes that the header states are held against the files
 * before anything is read.
 */
#ifndef HEXAD_DENSE_RAW_VOLUME_H
#define HEXAD_DENSE_RAW_VOLUME_H

#include "dense/slices.h"

/* `fd`, `path` and `files` stay the caller's and outlive the slices; `program` as in header_read. Data files
 * that a header names are opened beside `path`. Errors: those of header_read, and of the opener. */
slices *raw_volume_open(int fd, const char *path, const char *program, int64_t index,
                        const slices_files *files, error *e);

/* The same of a file that may have several values at each sample. */
slices *raw_vectors_open(int fd, const char *path, const char *program, int64_t index,
                         const slices_files *files, error *e);

#endif
