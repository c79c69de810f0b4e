/* slices: a dense volume, read slice by slice (the source of volume/dense_grid.h).
 *
 * It is an interface: an implementation puts `slices` first in its own struct. Sample (i, j, k) is number
 * i + size[0] j of slice k, with `components` values; its place is index_to_world (i, j, k, 1). Threads: one at a time.
 */
#ifndef HEXAD_DENSE_SLICES_H
#define HEXAD_DENSE_SLICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "dense/warnings.h"

typedef struct slices slices;

typedef struct slices_ops {
    /* begin goes to the first slice and may be called again; next reads one slice after the other. */
    bool (*begin)(slices *s, error *e);
    bool (*next)(slices *s, double *values, error *e);
    void (*close)(slices *s);
} slices_ops;

struct slices {
    const slices_ops *ops;
    int64_t size[3]; /* samples along each axis, at least 2 */
    int components;  /* values at each sample, next to each other: 1, or up to 4 of raw_vectors_open */
    double vector_to_world[9];  /* those of a vector, row by row */
    double index_to_world[16];  /* row-major, column vectors */
    char format[12], space[64]; /* as in header.h */
    const char *type;           /* of the numbers in the file, "uint8" for example; NULL: unknown */
    int64_t volumes;            /* number of volumes in the file; 0 counts as 1 */
    bool fine;                  /* values may need more than the 24 bits of a float */
    char inexact[24]; /* the first whole number beyond PRECISION_WHOLE_MOST that was read, as text; or "" */
    dense_warnings warnings;
};

/* Checks the number of a volume in a file with s->volumes of s->size. *index -1: none was named, which becomes 0 if there is only one.
 * Errors: grid_ambiguous, grid_missing. */
bool slices_choose_volume(const slices *s, int64_t *index, error *e);

/* Gives the axes these lengths of a step, in the place of those of the file; their directions and the place of the first sample stay. */
void slices_set_voxel_size(slices *s, const double size[3]);

/* Opens files that a header names. Returns a descriptor for reading, which the caller closes, or -1 and an error
 * that names the path. */
typedef struct slices_files {
    int (*open)(void *context, const char *path, error *e);
    void *context;
} slices_files;

/* Opens files below a directory, without following links. Returns a descriptor for reading, which the caller closes, or -1: *is_missing,
 * or an error that names the path. */
typedef struct slices_directory {
    int (*open)(void *context, const char *path, bool *is_missing, error *e);
    void *context;
} slices_directory;

#endif
