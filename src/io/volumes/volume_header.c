// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/volume_header.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/reader.h"

/* To parse a page of text, or to unpack one. */
static const size_t memory_limit = (size_t)256 << 20;
static const unsigned seconds = 10;

/* A side longer than this is a header that lies. */
static const int64_t largest_side = 1 << 20;
/* And so is one with more samples; their bytes are far from the limits of 64 bits. */
static const int64_t most_samples = (int64_t)1 << 50;

/* Maximum ratio of the sides of a voxel. Larger: parts of the surface that are one spacing wide are narrower than
 * the rounding of their coordinates. */
static const double largest_ratio = 1e6;
/* Maximum distance of the origin, in sides of a voxel. Larger: rounding moves samples by more than a thousandth of a
 * side. */
static const double farthest_origin = 1e12;

/* Whether the samples have distinct positions. */
static bool check_places(const volume_header *h, error *e)
{
    const double *m = h->index_to_world;
    double shortest = INFINITY, longest = 0;
    for (int k = 0; k < 3; k++) {
        const double side = elementary_hypot(elementary_hypot(m[k], m[4 + k]), m[8 + k]);
        shortest = fmin(shortest, side);
        longest = fmax(longest, side);
    }
    if (longest > largest_ratio * shortest && shortest > 0)
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "the sides of its voxels are %g to %g, and a ratio of %g is read: correct its header", shortest,
            longest, largest_ratio);
    const double away = elementary_hypot(elementary_hypot(m[3], m[7]), m[11]);
    return !(away > farthest_origin * shortest && shortest > 0) ||
           error_set(e, ERROR_INPUT_DAMAGED,
                     "its origin is %g away and the sides of its voxels are from %g on: their positions are "
                     "rounded. Correct its header, or move its origin nearer to 0.",
                     away, shortest);
}

static bool check_values(const volume_header *h, error *e)
{
    for (int k = 0; k < 3; k++) {
        if (h->size[k] < 1 || h->size[k] > largest_side)
            return error_set(
                e, ERROR_INPUT_DAMAGED,
                "claims %lld samples along axis %d, and at most %lld are read: correct its header",
                (long long)h->size[k], k, (long long)largest_side);
        if (h->size[k] == 1)
            return error_set(
                e, ERROR_NO_SURFACE,
                "the volume has %lld x %lld x %lld samples: give one with at least two along each axis",
                (long long)h->size[0], (long long)h->size[1], (long long)h->size[2]);
    }
    if (h->size[0] * h->size[1] > most_samples / h->size[2])
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "claims %lld x %lld x %lld samples, and at most %lld are read: correct its header",
                         (long long)h->size[0], (long long)h->size[1], (long long)h->size[2],
                         (long long)most_samples);
    if (h->volumes < 0 || h->volumes > most_samples / (h->size[0] * h->size[1] * h->size[2]))
        return error_set(e, ERROR_INPUT_DAMAGED, "claims %lld volumes: correct its header",
                         (long long)h->volumes);
    if (h->components < 0 || h->components > 4)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "claims %lld values at each sample, and at most 4 are read: correct its header",
                         (long long)h->components);
    if (h->byte_skip > most_samples || h->byte_skip < -most_samples)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "claims that its data begin after %lld bytes: correct its header",
                         (long long)h->byte_skip);
    for (int k = 0; k < 16; k++)
        if (!isfinite(h->index_to_world[k]))
            return error_set(
                e, ERROR_INPUT_DAMAGED,
                "the file has an orientation with numbers that are not finite: correct its header");
    if (!check_places(h, e)) return false;
    if (!isfinite(h->slope) || !isfinite(h->intercept))
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "its values are scaled by numbers that are not finite: correct its header");
    bool ended = h->warnings.count < DENSE_WARNINGS_MOST; /* a later one has room */
    for (uint32_t k = 0; ended && k < h->warnings.count; k++)
        ended = memchr(h->warnings.text[k], 0, sizeof h->warnings.text[k]) != NULL;
    return (ended && h->type < NUMBER_TYPES && h->encoding < VOLUME_HEADER_ENCODING_COUNT && h->offset >= 0 &&
            memchr(h->format, 0, sizeof h->format) && memchr(h->space, 0, sizeof h->space)) ||
           reader_invalid(e);
}

bool volume_header_read(int fd, const char *path, const char *program, volume_header *out, char **files,
                        error *e)
{
    const char *slash = strrchr(path, '/');
    const reader_params params = {program, VOLUME_HEADER_COMMAND, slash ? slash + 1 : path,
                                  fd,      memory_limit,          seconds};
    volume_header h = {0};
    char *text = NULL;
    reader r;
    off_t size;
    lseek(fd, 0, SEEK_SET); /* where the reader begins */
    if (!reader_check_file(fd, "volume", &size, e) || !reader_start(&params, &r, e)) return false;
    bool ok = reader_get_answer(&r, &h, sizeof h, &text, VOLUME_HEADER_TEXT_MAX, e) && check_values(&h, e);
    ok = reader_end(&r, ok, e);
    if (!ok) {
        free(text);
        return false;
    }
    *out = h;
    *files = text;
    return true;
}
