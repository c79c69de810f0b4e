// SPDX-License-Identifier: Apache-2.0
/* Replaces pictures.c in a build without pictures. The parser of the spec refuses jobs that would call
 * it. */
#include "base/core/build_part.h"
#include "job/phases/pictures.h"

bool pictures_write_preview(const char *directory, const results_input *in, const quantity_look *look,
                            threads *pool, json *outputs, error *e)
{
    (void)directory;
    (void)in;
    (void)look;
    (void)pool;
    (void)outputs;
    return error_set(e, ERROR_NOT_SUPPORTED, "%s", build_part_missing(BUILD_PART_PREVIEW));
}
