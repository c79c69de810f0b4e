// SPDX-License-Identifier: Apache-2.0
/* picture_readers: reads PNG and EXR files with libpng and OpenEXR's C core, and compares them with a
 * rendered picture. */
#ifndef HEXAD_TESTS_PICTURE_READERS_H
#define HEXAD_TESTS_PICTURE_READERS_H

#include "io/pictures/preview_exr.h"

/* Whether the file is complete and has the pixels of the picture, and nothing behind its end. */
bool png_shows(const char *path, const image *picture);

/* Whether the file is complete, has the channels and the compression of the options, and in each the
 * picture's values, bit for bit. */
bool exr_shows(const char *path, const image *picture, const preview_exr_options *options);

#endif
