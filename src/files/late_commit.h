// SPDX-License-Identifier: Apache-2.0
/* late_commit: writes, verifies and places a file (store_file_place_verified) on its own thread, while the
 * caller continues: flushing a large file to disk and reading it again take longer than writing it. One
 * thread calls; it flushes the directory. Errors are those of store_file_place_verified and of the callback.
 */
#ifndef HEXAD_FILES_LATE_COMMIT_H
#define HEXAD_FILES_LATE_COMMIT_H

#include "files/file.h"

typedef struct late_commit late_commit;

/* Writes the whole file. */
typedef bool (*late_commit_step)(FILE *stream, void *context, error *e);

/* Takes over a file of store_file_begin_hashed; *file is empty afterwards. `context` must remain valid until
 * late_commit_end, which the caller must call. If `beside` is false, or no thread can be started, the calling
 * thread does the work before this function returns. */
late_commit *late_commit_begin(store_file *file, late_commit_step write, void *context, bool beside);

/* Waits for the thread and frees `c`, also on failure. */
bool late_commit_end(late_commit *c, store_facts *out, error *e);

#endif
