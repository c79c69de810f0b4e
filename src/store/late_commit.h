/* late_commit: writes, reads back, hashes and places a file (store_file_place) on a thread of its own, while the caller goes on with the
 * next. To hash a large file and to bring it to disk takes as long as to write it: the disk begins when it is written, and the hash may
 * be made beside the reading back. One caller, who flushes the directory; errors as store_file_place's, and those of the two callbacks. */
#ifndef HEXAD_STORE_LATE_COMMIT_H
#define HEXAD_STORE_LATE_COMMIT_H

#include "store/file.h"

typedef struct late_commit late_commit;

/* What the file is to hold: one writes it, to its end, and flushes the stream; the other reads it back. */
typedef bool (*late_commit_step)(FILE *stream, void *context, error *e);

/* Takes the file over: *file is empty then; `end` follows, and `context` stays until then. Not `beside`, or without a thread to be
 * had: it is done at once, by the calling thread. `hashes_beside`: a large file's hash has a thread of its own. */
late_commit *late_commit_begin(store_file *file, late_commit_step write, late_commit_step verify,
                               void *context, bool beside, bool hashes_beside);

/* Waits for it; frees it whatever comes of it. */
bool late_commit_end(late_commit *c, store_facts *out, error *e);

/* The same at once. */
bool late_commit_now(store_file *file, store_facts *out, error *e);

#endif
