// SPDX-License-Identifier: Apache-2.0
/* late_hash: hashes an open file on its own thread, while the caller reads it. One thread calls. The file
 * must not change.
 */
#ifndef HEXAD_FILES_LATE_HASH_H
#define HEXAD_FILES_LATE_HASH_H

#include "files/file.h"

typedef struct late_hash late_hash;

/* Begins to hash. The caller keeps the descriptor and may close it. If `beside` is false, the file is small,
 * or no thread can be started, the calling thread hashes before this function returns. Never returns NULL.
 * The caller calls late_hash_end. */
late_hash *late_hash_begin(int fd, bool beside);

/* Waits for the hash and frees `h`, also on failure. Errors are those of store_file_hash. If `h` is NULL,
 * returns true. */
bool late_hash_end(late_hash *h, store_facts *out, error *e);

#endif
