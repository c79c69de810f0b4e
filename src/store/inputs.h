/* inputs: files that clients uploaded, each named by the SHA-256 of its content.
 *
 * The directory holds files named `sha256:HEX`. It can be an input root of jobs (store/root.h): a spec names a file as
 * "sha256:HEX", optionally with an extension, "sha256:HEX.obj". A stored file was verified and never changes. A file
 * that is uploaded again is stored once. Its modification time is the time of its last use. A user that has sent a file
 * is recorded as an empty file beside it, `sender:HEX:USER` with the SHA-256 of the user's name; it goes with the file.
 * Opening the directory removes unfinished uploads that a crash left. One process owns the directory. Any thread may
 * call; an upload belongs to one thread at a time.
 */
#ifndef HEXAD_STORE_INPUTS_H
#define HEXAD_STORE_INPUTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

#define STORE_INPUT_PREFIX "sha256:"
#define STORE_INPUT_HEX 64
#define STORE_INPUT_NAME_SIZE (sizeof STORE_INPUT_PREFIX + STORE_INPUT_HEX)

typedef struct store_inputs store_inputs;

/* Makes the directory when it is missing. A file may have `most_bytes`, all of them `total_bytes`. */
store_inputs *store_inputs_open(const char *directory, int64_t most_bytes, int64_t total_bytes, error *e);
void store_inputs_close(store_inputs *s); /* accepts NULL */
const char *store_inputs_directory(const store_inputs *s);

/* 64 digits, lower case. */
bool store_inputs_is_hash(const char *hex);
/* Whether a spec's path names such a file; then its name, without the ending. */
bool store_inputs_is_sent(const char *path, char name[STORE_INPUT_NAME_SIZE]);

typedef struct store_inputs_space {
    int64_t used_bytes, limit_bytes; /* of all files */
} store_inputs_space;

store_inputs_space store_inputs_get_space(store_inputs *s);

/* Its length in bytes, -1 when it is not there. */
int64_t store_inputs_find(store_inputs *s, const char *hex);
/* The same, as a use of the file. */
int64_t store_inputs_use(store_inputs *s, const char *hex);
/* Removes files that `may_go` does not keep; used_ms is their last use, wall clock. *gone is their number. `may_go` must
 * not call back. */
bool store_inputs_collect(store_inputs *s, bool (*may_go)(void *context, const char *name, int64_t used_ms),
                          void *context, size_t *gone, error *e);
/* *found false: there is none. A job that names it will not find it. */
bool store_inputs_remove(store_inputs *s, const char *hex, bool *found, error *e);

/* Notes that the user has sent these bytes. */
bool store_inputs_note_sender(store_inputs *s, const char *hex, const char *user, error *e);
/* Whether the user has, and the file is there. */
bool store_inputs_was_sent_by(store_inputs *s, const char *hex, const char *user);

/* Bounds what one user has: the bytes of the files that this user has sent and of those on their way, and the number of files on
 * their way at once. 0: any number. A file that several users have sent counts for each. */
void store_inputs_bound_users(store_inputs *s, int64_t bytes, int uploads);

typedef enum store_upload_verdict {
    STORE_UPLOAD_GOOD,
    STORE_UPLOAD_TOO_LARGE, /* over most_bytes */
    STORE_UPLOAD_NO_ROOM,   /* over total_bytes, or the disk is full */
    STORE_UPLOAD_USER_FULL, /* over the bytes of the user */
    STORE_UPLOAD_TOO_MANY,  /* the user has the most uploads on their way */
    STORE_UPLOAD_MISMATCH,  /* the bytes have another hash */
    STORE_UPLOAD_FAILED     /* *e has the error */
} store_upload_verdict;

typedef struct store_upload store_upload;

/* `announced` bytes of this user will come, -1: not known. Room is taken as bytes arrive, and none for those that are
 * announced; if there is none for them now, the upload is refused. On GOOD *upload is to be ended. */
store_upload_verdict store_upload_begin(store_inputs *s, const char *hex, const char *user, int64_t announced,
                                        store_upload **upload, error *e);
/* After a result other than GOOD the caller may pass the remaining bytes; they are discarded. */
store_upload_verdict store_upload_write(store_upload *u, const void *bytes, size_t count, error *e);
/* Verifies, flushes and puts in place, unless the same file is there. */
store_upload_verdict store_upload_commit(store_upload *u, error *e);
void store_upload_end(store_upload *u); /* what was not committed is gone; accepts NULL */

#endif
