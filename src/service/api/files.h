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

/* Finds the files of a data set: the names that `pattern` (spec/file_names.h) stands for in the place {file}
 * of the path. A relative path is searched below each root. Hidden files are skipped, and directories that are not
 * volumes. Sorted by bytes; the caller frees the names. Errors: those of store_open_directory; input_missing
 * (no file matches), spec_invalid (more than `most` match, or the path has a further place beside the
 * first). */
bool files_find_names(const http_context *c, const char *path, const char *pattern, size_t most, char ***out,
                      size_t *count, error *e);

#endif
