// SPDX-License-Identifier: Apache-2.0
/* meta_image: parses the header of a MetaImage file (.mha, or .mhd with a separate data file). Runs in the
 * process that reads headers. Source: the documentation and the reader of MetaIO.
 */
#ifndef HEXAD_IO_VOLUMES_META_IMAGE_H
#define HEXAD_IO_VOLUMES_META_IMAGE_H

#include <stdbool.h>

#include "io/volumes/volume_header.h"

enum { META_IMAGE_NAME_SIZE = 512, META_IMAGE_FAULT_SIZE = 256 };

/* Sets the members of *out that describe a volume, including warnings. `name`: the file that holds the data;
 * "" if they follow the header. False: `fault` has the reason why the file is not read, and *code whether it
 * is damaged or not supported. */
bool meta_image_parse(const char *text, volume_header *out, char name[META_IMAGE_NAME_SIZE],
                      char fault[META_IMAGE_FAULT_SIZE], error_code *code);

#endif
