// SPDX-License-Identifier: Apache-2.0
/* slices: reads a dense volume slice by slice (the source of surface/volume/dense_grid.h).
 *
 * It is an interface: an implementation puts `slices` first in its own struct. Sample (i, j, k) is number i +
 * size[0] j of slice k, with `components` values; its position is index_to_world (i, j, k, 1). One thread at
 * a time.
 */
#ifndef HEXAD_IO_VOLUMES_SLICES_H
#define HEXAD_IO_VOLUMES_SLICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "io/volumes/warnings.h"

typedef struct slices slices;

typedef struct slices_ops {
    /* Reads slice k. Slices are read in ascending order; slice 0 may be read again, then the others. */
    bool (*read)(slices *s, int64_t k, double *values, error *e);
    void (*close)(slices *s);
} slices_ops;

struct slices {
    const slices_ops *ops;
    int64_t size[3]; /* samples along each axis, at least 2 */
    /* number of values per sample, stored consecutively: 1, or up to 4 for raw_vectors_open */
    int components;
    double vector_to_world[9];  /* rotation of vectors, row by row */
    double index_to_world[16];  /* row-major, column vectors */
    char format[12], space[64]; /* as in volume_header.h */
    const char *type;           /* of the numbers in the file, "uint8" for example; NULL: unknown */
    int64_t volumes;            /* number of volumes in the file; 0 counts as 1 */
    bool fine;                  /* values may need more than the 24 bits of a float */
    char inexact[24]; /* the first whole number beyond PRECISION_WHOLE_MOST that was read, as text; or "" */
    dense_warnings warnings;
};

/* Checks the number of a volume in a file with s->volumes volumes. *index -1: none was requested, which
 * becomes 0 if there is only one. Errors: grid_ambiguous, grid_missing. */
bool slices_choose_volume(const slices *s, int64_t *index, error *e);

/* Replaces the step lengths of the axes by these; directions and the position of the first sample do not
 * change. */
void slices_set_voxel_size(slices *s, const double size[3]);

/* Opens files that a header names. Returns a descriptor for reading, which the caller closes, or -1 and an
 * error that names the path. */
typedef struct slices_files {
    int (*open)(void *context, const char *path, error *e);
    void *context;
} slices_files;

/* Opens files below a directory without following links. Returns a descriptor for reading, which the caller
 * closes, or -1: *is_missing is true, or *e is set and names the path. */
typedef struct slices_directory {
    int (*open)(void *context, const char *path, bool *is_missing, error *e);
    void *context;
} slices_directory;

#endif
