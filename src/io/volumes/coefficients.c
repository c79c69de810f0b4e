// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/coefficients.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/transfer.h"

/* Same limit as for coefficients in a spec: squares of derivatives stay finite. */
static const double COEFFICIENT_MAX = 1e30;

/* Reads `bytes` bytes from the start of the file. */
static bool read_bytes(int fd, void *out, size_t bytes, error *e)
{
    const int64_t done = transfer_read_at(fd, out, bytes, 0);
    if (done < 0) return error_set(e, ERROR_INPUT_DAMAGED, "the file cannot be read: %m");
    return (size_t)done == bytes ||
           error_set(e, ERROR_INPUT_DAMAGED, "the file ended after %zu of %zu bytes", (size_t)done, bytes);
}

static double decode(const unsigned char *at, size_t width)
{
    uint64_t bits = 0;
    for (size_t k = 0; k < width; k++) bits |= (uint64_t)at[k] << 8 * k;
    if (width == 8) {
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }
    uint32_t low = (uint32_t)bits;
    float value;
    memcpy(&value, &low, sizeof value);
    return (double)value;
}

/* Converts in place: 32-bit numbers occupy the front of the array and are widened from the last to the
 * first. */
static bool decode_all(double *numbers, size_t count, size_t width, const int dims[3], error *e)
{
    const unsigned char *bytes = (const unsigned char *)numbers;
    for (size_t i = count; i-- > 0;) {
        double value = decode(bytes + i * width, width);
        if (!(fabs(value) <= COEFFICIENT_MAX)) {
            size_t nx = (size_t)dims[0], ny = (size_t)dims[1];
            return error_set(
                e, ERROR_INPUT_DAMAGED,
                "coefficient %zu, at (%zu, %zu, %zu), is %g: it must be finite and at most %g in size", i,
                i % nx, i / nx % ny, i / nx / ny, value, COEFFICIENT_MAX);
        }
        numbers[i] = value;
    }
    return true;
}

static bool find_width(int fd, size_t count, const int dims[3], size_t *width, error *e)
{
    struct stat status;
    if (fstat(fd, &status) != 0) return error_set(e, ERROR_INPUT_DAMAGED, "the file cannot be examined: %m");
    *width = (size_t)status.st_size == 8 * count ? 8 : 4;
    if ((size_t)status.st_size == *width * count) return true;
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "the file has %lld bytes, but %d x %d x %d coefficients are %zu bytes as 32-bit "
                     "floats or %zu as 64-bit ones: correct dims, or the file",
                     (long long)status.st_size, dims[0], dims[1], dims[2], 4 * count, 8 * count);
}

double *coefficients_read(int fd, const char *path, const int dims[3], size_t memory_limit, error *e)
{
    size_t count = (size_t)dims[0] * (size_t)dims[1] * (size_t)dims[2], width;
    double *numbers = NULL;
    if (!find_width(fd, count, dims, &width, e)) goto fail;
    if (count > memory_limit / sizeof *numbers) {
        error_set(
            e, ERROR_LIMIT_MEMORY,
            "the file requires %zu MiB, and %zu MiB of the limit are left: raise limits.memory_mb by at least %zu",
            (count * sizeof *numbers >> 20) + 1, memory_limit >> 20,
            (count * sizeof *numbers >> 20) + 1 - (memory_limit >> 20));
        goto fail;
    }
    numbers = mem_array(count, sizeof *numbers, "the coefficients", e);
    if (!numbers || !read_bytes(fd, numbers, width * count, e) || !decode_all(numbers, count, width, dims, e))
        goto fail;
    return numbers;
fail:
    error_prefix(e, "%s", path);
    free(numbers);
    return NULL;
}
