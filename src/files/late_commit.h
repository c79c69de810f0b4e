/* late_commit: writes, reads back, hashes and places a file (store_file_place) on its own thread, while the caller
 * continues.
 *
 * Hashing a large file and flushing it to disk take as long as writing it. The flush therefore begins as soon as the
 * file is written, and the hash can be computed in parallel with the reading back. One thread calls; it flushes the
 * directory. Errors are those of store_file_place and of the two callbacks.
 */
#ifndef HEXAD_FILES_LATE_COMMIT_H
#define HEXAD_FILES_LATE_COMMIT_H

#include "files/file.h"

typedef struct late_commit late_commit;

/* `write` writes the whole file and flushes the stream. `verify` reads the file back. */
typedef bool (*late_commit_step)(FILE *stream, void *context, error *e);

/* Takes over the file; *file is empty afterwards. `context` must remain valid until late_commit_end, which the
 * caller must call. If `beside` is false, or no thread can be started, the calling thread does the work before this
 * function returns. If `hashes_beside` is true, a large file is hashed on another thread. */
late_commit *late_commit_begin(store_file *file, late_commit_step write, late_commit_step verify,
                               void *context, bool beside, bool hashes_beside);

/* Waits for the thread and frees `c`, also on failure. */
bool late_commit_end(late_commit *c, store_facts *out, error *e);

/* Hashes and places a file on the calling thread. */
bool late_commit_now(store_file *file, store_facts *out, error *e);

#endif
