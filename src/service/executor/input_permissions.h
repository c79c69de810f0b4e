// SPDX-License-Identifier: Apache-2.0
/* input_permissions: the paths that a worker may read: the configured input roots, and those uploaded files
 * that the spec names.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_INPUT_PERMISSIONS_H
#define HEXAD_SERVICE_EXECUTOR_INPUT_PERMISSIONS_H

#include <stddef.h>

#include "service/uploads/upload_store.h"

/* Lists the paths: first the uploaded files with these names ("sha256:...") that exist, then the roots in
 * `given`. Listing an uploaded file counts as a use of it. `inputs` may be NULL: nothing was uploaded. The
 * caller frees the list with mem_free_texts. */
char **input_permissions_list(const char *const *names, size_t name_count, store_inputs *inputs,
                              const char *const *given, size_t given_count, size_t *count);

#endif
