// SPDX-License-Identifier: Apache-2.0
/* data_set: the files of a job with one frame for each file (queue.files).
 *
 * The names of a list stay as they are, except for the setting path_mappings. A pattern, which requires the scope submit, becomes the names of
 * the files that exist now, sorted by their bytes. Files other than uploads are not opened. For the threads
 * of a pool: listing a directory of 100 000 files takes a tenth of a second.
 */
#ifndef HEXAD_SERVICE_API_DATA_SET_H
#define HEXAD_SERVICE_API_DATA_SET_H

#include "service/api/context.h"
#include "spec/spec.h"

typedef struct data_set {
    size_t count; /* 0: the spec has no files */
    char **name;
    int *frame;
    char **sent; /* names of the uploaded files among them */
    size_t sent_count;
} data_set;

/* Finds the files of a valid spec. On failure *fault has the place, and *e the reason: spec_invalid (there are
 * too many, an upload is not named by the whole path), input_missing (no file matches; an upload does not exist or belongs to another user), or those of
 * store_open_directory. The caller clears the set in any case. */
bool data_set_find(const http_context *c, const access_caller *caller, const spec *s, data_set *set,
                   char pointer[64], error *e);
void data_set_clear(data_set *set);

#endif
