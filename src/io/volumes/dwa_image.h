// SPDX-License-Identifier: Apache-2.0
/* dwa_image: reads one channel of an image whose compression (DWAA, DWAB) OpenEXR's C core does not decode,
 * with the C++ library. Only for the process that reads images (exr_reader.h), because the library gets
 * unchecked bytes.
 */
#ifndef HEXAD_IO_VOLUMES_DWA_IMAGE_H
#define HEXAD_IO_VOLUMES_DWA_IMAGE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "base/core/error.h"

#define DWA_IMAGE_MODULE "hexad-exr.so"

/* Reads the values of the data window `low` to `high`, row by row: uint32_t if the channel has whole numbers,
 * otherwise floats. `part` is an existing part, of rows or of tiles, with this window, and the channel has a
 * sample for each pixel. Errors: input_damaged, internal (the module). */
bool dwa_image_read(int fd, int part, const char *channel, bool whole, const int32_t low[2],
                    const int32_t high[2], uint32_t *values, error *e);

#ifdef __cplusplus
}
#endif

#endif
