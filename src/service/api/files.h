// SPDX-License-Identifier: Apache-2.0
/* files: lists the entries of directories below the input roots. For callers with the scope `submit` only. */
#ifndef HEXAD_SERVICE_API_FILES_H
#define HEXAD_SERVICE_API_FILES_H

#include "service/api/context.h"

http_handler files_list;

/* Finds the frames whose files exist, for a path with the place of a frame number. A relative path is
 * searched below each root. Ascending; the caller frees the numbers. Errors: those of store_open_directory;
 * input_missing (no file matches), spec_invalid (more than FRAMES_MOST match). */
bool files_find_frames(const http_context *c, const char *pattern, int **frames, size_t *count, error *e);

#endif
