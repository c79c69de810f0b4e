// SPDX-License-Identifier: Apache-2.0
/* build_part: the parts of hexad that configure can leave out.
 *
 * A build without a part still parses the members of a spec and the settings that belong to it. A request for
 * the part fails with not_supported and a message that names the option of configure. Any thread.
 */
#ifndef HEXAD_BASE_CORE_BUILD_PART_H
#define HEXAD_BASE_CORE_BUILD_PART_H

typedef enum build_part {
    BUILD_PART_ALWAYS,  /* always built */
    BUILD_PART_PREVIEW, /* --disable-preview: preview.png, preview.exr, thumbnails */
    BUILD_PART_SLURM,   /* --without-slurm */
    BUILD_PART_PAGE     /* --without-page */
} build_part;

/* The reason why a request for the part fails, such as "hexad was built without pictures (configure
 * --disable-preview)". NULL: the part is built. */
const char *build_part_missing(build_part part);

#endif
