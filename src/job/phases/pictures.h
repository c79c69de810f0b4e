// SPDX-License-Identifier: Apache-2.0
/* pictures: preview.png, the frames of a turntable, and preview.exr. Each is written,
 * verified (results.h), and added to `outputs`. A build without pictures has no_pictures.c instead of
 * pictures.c.
 */
#ifndef HEXAD_JOB_PHASES_PICTURES_H
#define HEXAD_JOB_PHASES_PICTURES_H

#include "io/points/quantity.h"
#include "job/phases/results_input.h"

/* Writes the pictures of output.preview, with this look or with the values of output.preview.attribute.
 * Errors: those of results_write; not_supported in a build without pictures. */
bool pictures_write_preview(const char *directory, const results_input *in, const quantity_look *look,
                            threads *pool, json *outputs, error *e);

#endif
