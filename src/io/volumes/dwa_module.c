// SPDX-License-Identifier: Apache-2.0
/* dwa_image.h for a program that loads the library when an image first needs it. */
#include "base/core/module.h"
#include "io/volumes/dwa_image.h"

typedef bool read_function(int, int, const char *, bool, const int32_t *, const int32_t *, uint32_t *,
                           error *);

bool dwa_image_read(int fd, int part, const char *channel, bool whole, const int32_t low[2],
                    const int32_t high[2], uint32_t *values, error *e)
{
    read_function *read = (read_function *)module_symbol(DWA_IMAGE_MODULE, "dwa_image_read", e);
    return read && read(fd, part, channel, whole, low, high, values, e);
}
