/* coefficients: the file of a B-spline's coefficients, read.
 *
 * The file holds nothing but dims[0] dims[1] dims[2] little-endian floating-point numbers, x fastest, then y;
 * of 32 or of 64 bits, which follows from its size.
 */
#ifndef HEXAD_DENSE_COEFFICIENTS_H
#define HEXAD_DENSE_COEFFICIENTS_H

#include <stddef.h>

#include "base/error.h"

/* Reads them from `fd`, which stays the caller's; `path` is for messages. Released with free(). Errors:
 * input_damaged (another size than either, a number that is not finite or beyond 1e30, as in the job's spec),
 * limit_memory (more than `memory_limit` bytes), each naming the file. */
double *coefficients_read(int fd, const char *path, const int dims[3], size_t memory_limit, error *e);

#endif
