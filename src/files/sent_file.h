// SPDX-License-Identifier: Apache-2.0
/* sent_file: the names of files that clients uploaded, each the SHA-256 of its content.
 *
 * The directory of uploads (service/uploads/upload_store) is an input root of jobs (files/root.h). A spec
 * names a file in it as "sha256:HEX", optionally with an extension: "sha256:HEX.obj". Pure functions, any
 * thread.
 */
#ifndef HEXAD_FILES_SENT_FILE_H
#define HEXAD_FILES_SENT_FILE_H

#include <stdbool.h>

#include "base/core/error.h"

#define STORE_INPUT_PREFIX "sha256:"
#define STORE_INPUT_HEX 64
#define STORE_INPUT_NAME_SIZE (sizeof STORE_INPUT_PREFIX + STORE_INPUT_HEX)
/* Digits of a hash that messages show, as in `bunny.obj (sha256:8a73d5b2...)`. */
#define STORE_INPUT_SHOWN 8

/* Whether the text is 64 hexadecimal digits in lower case. */
bool sent_file_is_hash(const char *hex);
/* Whether the text is "sha256:" and such digits. */
bool sent_file_is_name(const char *name);
/* Whether the path of a spec names an uploaded file. If so, `name` is the name without its extension. */
bool sent_file_match(const char *path, char name[STORE_INPUT_NAME_SIZE]);

/* Replaces the error of a file that a header names but that cannot be opened, if the header at `path` was
 * uploaded: other files do not lie beside it. */
void sent_file_explain_header(const char *path, error *e);

#endif
