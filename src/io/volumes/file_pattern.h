// SPDX-License-Identifier: Apache-2.0
/* file_pattern: numbered names of data files, as headers of NRRD and MetaImage give them. Pure; any thread. */
#ifndef HEXAD_IO_VOLUMES_FILE_PATTERN_H
#define HEXAD_IO_VOLUMES_FILE_PATTERN_H

#include <stdbool.h>

/* Whether `s` is text with one integer conversion of printf and no other: %d, %4d, %04d or the same with u. */
bool file_pattern_is(const char *s);

#endif
