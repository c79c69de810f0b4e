// SPDX-License-Identifier: Apache-2.0
/* upload_store: files that clients uploaded, each named by the SHA-256 of its content.
 *
 * The directory holds files named `sha256:HEX` (files/sent_file). A stored file was verified and never
 * changes. A file that is uploaded again is stored once; if the stored one is damaged, it is replaced. Its
 * modification time is the time of its last use. The queue has a row for each user that holds a file, since it
 * sent the file and has not deleted it, with the name that the user gave the file; only this user may learn it
 * (queue_upload). A file without rows, of a database that was lost, is kept until it is unused, and held by each
 * user that sends its bytes again. Opening the directory removes unfinished uploads that a crash left. One process owns the
 * directory. Any thread may call; an upload belongs to one thread at a time.
 */
#ifndef HEXAD_SERVICE_UPLOADS_UPLOAD_STORE_H
#define HEXAD_SERVICE_UPLOADS_UPLOAD_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "files/file.h"
#include "files/sent_file.h"
#include "service/ledger/ledger.h"
#include "service/queue/queue.h"

typedef struct store_inputs store_inputs;

/* Makes the directory if it is missing. One file may have at most `most_bytes`, all files together
 * `total_bytes`. The ledger, in which no other store counts, limits each user: LEDGER_UPLOAD_BYTES are the files
 * that the user holds and the arrived bytes of unfinished uploads, LEDGER_UPLOADS the simultaneous uploads. A file
 * that several users hold counts for each of them. Queue and ledger must outlive the store. Records of older builds
 * are moved to the queue. */
store_inputs *store_inputs_open(const char *directory, int64_t most_bytes, int64_t total_bytes, queue *q,
                                ledger *counts, error *e);
void store_inputs_close(store_inputs *s); /* accepts NULL */
const char *store_inputs_directory(const store_inputs *s);

typedef struct store_inputs_space {
    int64_t used_bytes, limit_bytes; /* of all files */
    int64_t file_limit_bytes;        /* of one file */
} store_inputs_space;

store_inputs_space store_inputs_get_space(store_inputs *s);

/* The length of the file in bytes; -1 if it does not exist. *used_ms: the time of its last use, on the wall clock; may
 * be NULL. */
int64_t store_inputs_find(const store_inputs *s, const char *hex, int64_t *used_ms);
/* As store_inputs_find, and sets the time of the last use to now. */
int64_t store_inputs_use(store_inputs *s, const char *hex);
/* Removes the files that no unfinished job reads, and that were not used for keep_ms of running time (0: without limit) or
 * that all users have released. *gone is the number of removed files. */
bool store_inputs_collect(store_inputs *s, int64_t keep_ms, size_t *gone, error *e);
/* Removes a file, also one that users hold. *found: the file existed. Jobs that name the file fail from then on. */
bool store_inputs_remove(store_inputs *s, const char *hex, bool *found, error *e);

/* Removes the file "sha256:HEX" if its bytes have another hash: any user may then send it again. No user holds it
 * any more; the names that users gave it stay for messages. Reads the whole file, until the deadline. */
void store_inputs_discard_damaged(store_inputs *s, const char *name, const store_deadline *end);

/* Whether the file "sha256:HEX" of a directory has the bytes of its name. Errors: input_damaged: it has others; otherwise
 * it cannot be read. */
bool store_inputs_compare(const char *directory, const char *name, error *e);

/* Since when the user holds the file, on the wall clock, or QUEUE_NOT_HELD; and the name that the user gave it, which
 * the caller frees. NULL: none. */
int64_t store_inputs_find_sent(const store_inputs *s, const char *hex, const char *user, char **name);
/* Whether the user holds the file, and (`name` not NULL) has given it this name. */
bool store_inputs_holds(const store_inputs *s, const char *hex, const char *user, const char *name);
/* Ends the hold of the user, with the name that the user gave the file. *found: the user held the file. The file is removed
 * if no other user holds it and no unfinished job reads it; if one does, by a collection afterwards. */
bool store_inputs_release(store_inputs *s, const char *hex, const char *user, bool *found, error *e);
/* The bytes of the files that the user holds, and the arrived bytes of its unfinished uploads. */
int64_t store_inputs_count_bytes(store_inputs *s, const char *user);
/* As queue_list_uploads, with the name of the user. */
bool store_inputs_list(store_inputs *s, const char *user, const queue_upload *after, int limit,
                       queue_upload **list, size_t *count, error *e);

/* Maximum length of the name of a file, in bytes. */
#define STORE_INPUT_FILE_NAME_MOST 255

typedef enum store_upload_outcome {
    STORE_UPLOAD_GOOD,
    STORE_UPLOAD_TOO_LARGE, /* over most_bytes */
    STORE_UPLOAD_ALL_FULL,  /* over total_bytes */
    STORE_UPLOAD_DISK_FULL, /* no space on the disk, or within a quota */
    STORE_UPLOAD_USER_FULL, /* over the user's limit of bytes */
    STORE_UPLOAD_TOO_MANY,  /* over the user's limit of simultaneous uploads */
    STORE_UPLOAD_MISMATCH,  /* the bytes have another hash */
    STORE_UPLOAD_GONE,      /* the file was removed during the request */
    STORE_UPLOAD_FAILED     /* *e has the error */
} store_upload_outcome;

typedef struct store_upload store_upload;

/* Begins an upload of `announced` bytes; -1: the length is not known. Space is reserved as bytes arrive.
 * Announced bytes reserve no space, but the upload is refused if there is no space for them now. On GOOD the
 * caller opens and ends *upload. */
store_upload_outcome store_upload_begin(store_inputs *s, const char *hex, const char *user, int64_t announced,
                                        store_upload **upload);
/* Creates the file, before the first bytes. */
store_upload_outcome store_upload_open(store_upload *u, error *e);
/* Adds bytes. After a result other than GOOD the caller may pass the remaining bytes; they are discarded. */
store_upload_outcome store_upload_write(store_upload *u, const void *bytes, size_t count, error *e);
/* Verifies the hash, flushes the file and renames it to its name. The user then holds the file, by this name unless it is
 * NULL. If the same file is already stored and not damaged, the upload is discarded. */
store_upload_outcome store_upload_commit(store_upload *u, const char *name, error *e);
void store_upload_end(store_upload *u); /* removes what was not committed; accepts NULL */

/* The user holds a stored file from now on, by this name unless it is NULL, without an upload. Results: GOOD, also if the
 * user holds it already; USER_FULL, GONE, FAILED. */
store_upload_outcome store_inputs_hold(store_inputs *s, const char *hex, const char *user, const char *name,
                                       error *e);

#endif
