/* dwa_image: one channel of an image whose compression OpenEXR's C core does not decode (DWAA, DWAB), by the C++ library. For
 * the process that reads images (exr_reader.h): the library gets unchecked bytes.
 */
#ifndef HEXAD_DENSE_DWA_IMAGE_H
#define HEXAD_DENSE_DWA_IMAGE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#include "base/error.h"

#define DWA_IMAGE_MODULE "hexad-exr.so"

/* Fills in the values of the data window `low` to `high`, row by row: uint32_t if the channel has whole numbers, else
 * floats. `part` is a number that the file has, of rows or of tiles, the window is that part's, and the channel has a
 * sample for each pixel. Errors: input_damaged, internal (the module). */
bool dwa_image_read(int fd, int part, const char *channel, bool whole, const int32_t low[2],
                    const int32_t high[2], uint32_t *values, error *e);

#ifdef __cplusplus
}
#endif

#endif
