// SPDX-License-Identifier: Apache-2.0
#include "base/core/build_part.h"

#include <stddef.h>

#include "config.h"

const char *build_part_missing(build_part part)
{
    switch (part) {
    case BUILD_PART_ALWAYS:
        return NULL;
    case BUILD_PART_PREVIEW:
        return HEXAD_WITH_PREVIEW ? NULL : "hexad was built without pictures (configure --disable-preview)";
    case BUILD_PART_SLURM:
        return HEXAD_WITH_SLURM ? NULL : "hexad was built without Slurm (configure --without-slurm)";
    case BUILD_PART_PAGE:
        return HEXAD_WITH_PAGE ? NULL : "hexad was built without its web page (configure --without-page)";
    }
    return NULL;
}
