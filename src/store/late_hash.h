/* late_hash: hashes an open file on a thread of its own, while the caller reads it. One caller; the file is not to change. */
#ifndef HEXAD_STORE_LATE_HASH_H
#define HEXAD_STORE_LATE_HASH_H

#include "store/file.h"

typedef struct late_hash late_hash;

/* The caller keeps the descriptor, and may close it. Not `beside`, of a small file, or without a thread to be had: it is hashed at
 * once, by the calling thread. Never NULL; `end` follows. */
late_hash *late_hash_begin(int fd, bool beside);

/* Waits for it; frees it whatever comes of it. Errors as store_file_hash's. NULL: there is
 * nothing to wait for, true. */
bool late_hash_end(late_hash *h, store_facts *out, error *e);

#endif
