/* slices: a dense volume, one slice after the other: what dense.h makes bricks of.
 *
 * It is an interface: an implementation puts `slices` first in its own struct. Sample (i, j, k) is number
 * i + size[0] j of slice k; its place is index_to_world (i, j, k, 1). Threads: one at a time.
 */
#ifndef HEXAD_DENSE_SLICES_H
#define HEXAD_DENSE_SLICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

typedef struct slices slices;

typedef struct slices_ops {
    /* To the first slice, as often as one likes; then slice after slice. */
    bool (*begin)(slices *s, error *e);
    bool (*next)(slices *s, float *values, error *e);
    void (*close)(slices *s);
} slices_ops;

struct slices {
    const slices_ops *ops;
    int64_t size[3];           /* samples along each axis, at least 2 */
    double index_to_world[16]; /* row-major, column vectors */
    char format[8], space[64]; /* as in header.h */
    char warning[256];         /* something odd about them, or "" */
};

/* How a volume gets at files that are named in or beside another: a descriptor for reading, the caller's
 * then, or -1 and an error that names the path. */
typedef struct slices_files {
    int (*open)(void *context, const char *path, error *e);
    void *context;
} slices_files;

#endif
