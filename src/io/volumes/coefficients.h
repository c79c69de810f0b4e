// SPDX-License-Identifier: Apache-2.0
/* coefficients: reads the file of a B-spline's coefficients.
 *
 * The file holds only dims[0] dims[1] dims[2] little-endian floating-point numbers, x fastest, then y. Its
 * size determines whether they have 32 or 64 bits.
 */
#ifndef HEXAD_IO_VOLUMES_COEFFICIENTS_H
#define HEXAD_IO_VOLUMES_COEFFICIENTS_H

#include <stddef.h>

#include "base/core/error.h"

/* Reads the coefficients from `fd`, which the caller closes; `path` is for messages. The caller frees the
 * result. Errors, with the file: input_damaged (the size fits neither width, or a number is not finite or
 * beyond 1e30, as in a job's spec), limit_memory (more than `memory_limit` bytes). */
double *coefficients_read(int fd, const char *path, const int dims[3], size_t memory_limit, error *e);

#endif
