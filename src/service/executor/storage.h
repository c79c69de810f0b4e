// SPDX-License-Identifier: Apache-2.0
/* storage: whether the disks of the state directory have space, and whether files can be written there.
 *
 * The subdirectories may be on other file systems: the one with the least free space counts. Whether a file
 * can be written is found by writing one: permissions do not show a read-only or failing disk, a quota, or a
 * directory that is missing. The supervisor calls storage_check and storage_may_start, which cost some system
 * calls; any thread may call the other functions.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_STORAGE_H
#define HEXAD_SERVICE_EXECUTOR_STORAGE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"

/* The directories of work_dir that are written to. No attempt starts if one of the first two cannot be
 * written. With floor_bytes 0, attempts start even on a full disk. */
enum { STORAGE_ATTEMPTS, STORAGE_RESULTS, STORAGE_INPUTS, STORAGE_PARTS };

typedef struct storage {
    const char *state_dir, *work_dir; /* outlive the struct; may be the same directory */
    int64_t floor_bytes;              /* 0: none */
    bool low;                         /* the last check found less free space than floor_bytes */
    int64_t probed_ms;                /* time of the last probe, monotonic; 0: none */
    atomic_bool suspect;              /* a write has failed since the last probe */
    atomic_int fault[STORAGE_PARTS];  /* errno of the last write; 0: it succeeded */
} storage;

/* The bytes that the service may use (f_bavail), INT64_MAX if they cannot be determined, and the size of that
 * disk, 0 if it cannot be determined. *directory is that of the two directories that is on this disk. */
int64_t storage_free_bytes(const storage *s, int64_t *size_bytes, const char **directory);

/* Compares the free space with floor_bytes and writes a file to each part, at most once a second unless a
 * write has failed. On a full disk nothing is written. Logs what has changed. */
void storage_check(storage *s);

/* storage_check, and whether an attempt may start. */
bool storage_may_start(storage *s);

/* Call it after a write failed: the next storage_check writes at once, and flushes the files. */
void storage_suspect(storage *s);

/* Whether the last write to each part succeeded. Otherwise the error names the part. */
bool storage_can_write(const storage *s, error *e);

#endif
