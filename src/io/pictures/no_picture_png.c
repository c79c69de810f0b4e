// SPDX-License-Identifier: Apache-2.0
/* Replaces picture_png.c in a build without pictures. */
#include "base/core/build_part.h"
#include "io/pictures/picture_png.h"

bool picture_png_write(FILE *out, const canvas *picture, error *e)
{
    (void)out;
    (void)picture;
    return error_set(e, ERROR_NOT_SUPPORTED, "%s", build_part_missing(BUILD_PART_PREVIEW));
}
