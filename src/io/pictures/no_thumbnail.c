// SPDX-License-Identifier: Apache-2.0
/* Replaces thumbnail.c in a build without pictures. */
#include "base/core/build_part.h"
#include "io/pictures/thumbnail.h"

bool thumbnail_read(const char *program, int fd, const thumbnail_patience *patience, thumbnail *out, error *e)
{
    (void)program;
    (void)fd;
    (void)patience;
    (void)out;
    return error_set(e, ERROR_NOT_SUPPORTED, "%s", build_part_missing(BUILD_PART_PREVIEW));
}

int thumbnail_main(int argc, char **argv)
{
    (void)argc;
    (void)argv;
    return 2;
}
