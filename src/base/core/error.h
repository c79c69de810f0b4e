// SPDX-License-Identifier: Apache-2.0
/* error: the error type of the project.
 *
 * A function that can fail returns bool (true: success) or a pointer (NULL: failure) and has an `error *` as
 * its last parameter, which may be NULL. The error is set where the fault is found; its message says what is
 * wrong, where, and what to do. A caller that knows more (the file, the grid) adds its context once with
 * error_prefix. Outputs of a failed call are unchanged.
 *
 * Codes are stable: they are the same in REST, in the worker's last line and in the record of the attempt. An
 * error belongs to one thread at a time.
 */
#ifndef HEXAD_BASE_CORE_ERROR_H
#define HEXAD_BASE_CORE_ERROR_H

#include <stdbool.h>

#include "base/core/words.h"

#define ERROR_LIST(ENTRY, prefix)                                                                      \
    ENTRY(prefix, NONE, "none")                                                                        \
    ENTRY(prefix, SPEC_INVALID, "spec_invalid")                                                        \
    ENTRY(prefix, NOT_SUPPORTED, "not_supported")                                                      \
    ENTRY(prefix, PATH_FORBIDDEN, "path_forbidden")                                                    \
    ENTRY(prefix, INPUT_MISSING, "input_missing")                                                      \
    ENTRY(prefix, INPUT_DAMAGED, "input_damaged")                                                      \
    ENTRY(prefix, INPUT_UNSUPPORTED, "input_unsupported")                                              \
    ENTRY(prefix, GRID_MISSING, "grid_missing")                                                        \
    ENTRY(prefix, GRID_AMBIGUOUS, "grid_ambiguous")                                                    \
    ENTRY(prefix, ATTRIBUTE_MISSING, "attribute_missing")                                              \
    ENTRY(prefix, ISOVALUE_REQUIRED, "isovalue_required")                                              \
    ENTRY(prefix, NO_SURFACE, "no_surface")                                                            \
    ENTRY(prefix, LIMIT_MEMORY, "limit_memory")                                                        \
    ENTRY(prefix, LIMIT_TIME, "limit_time")                                                            \
    ENTRY(prefix, LIMIT_FILE, "limit_file") /* a file exceeds the limit file_mb */                     \
    ENTRY(prefix, STALLED, "stalled")                                                                  \
    ENTRY(prefix, CANCELLED, "cancelled")                                                              \
    ENTRY(prefix, DEPENDENCY_FAILED, "dependency_failed")                                              \
    ENTRY(prefix, STORAGE_FULL, "storage_full")     /* no space on a disk or within a quota */         \
    ENTRY(prefix, STORAGE_FAILED, "storage_failed") /* a disk cannot be read or written */             \
    ENTRY(prefix, OUTPUT_TAKEN, "output_taken")     /* another user's result is in output.directory */ \
    ENTRY(prefix, OUTPUT_UNWRITABLE,                                                                   \
          "output_unwritable") /* the service may not write to output.directory */                     \
    ENTRY(prefix, INTERRUPTED, "interrupted")                                                          \
    ENTRY(prefix, DATABASE_DAMAGED, "database_damaged")                                                \
    ENTRY(prefix, STATE_LOST, "state_lost") /* the state directory is not at its path */               \
    ENTRY(prefix, INTERNAL, "internal")

typedef enum error_code { ERROR_LIST(WORDS_ENUMERATOR, ERROR) ERROR_CODE_COUNT } error_code;

typedef struct error {
    error_code code;
    char message[1024]; /* UTF-8, no line break, never truncated within a character */
} error;

/* Sets *e (unless NULL) and returns false: `return error_set(e, ...)`. */
bool error_set(error *e, error_code code, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* Prepends "context: " to the message; returns false. A NULL or empty error is unchanged. */
bool error_prefix(error *e, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* "spec_invalid", ...; "none" for ERROR_NONE. Never NULL. */
const char *error_code_name(error_code code);

/* The code for errno after a failed system call on a file: storage_full (ENOSPC, EDQUOT), storage_failed
 * (EIO), limit_file (EFBIG), internal. */
error_code error_code_of_errno(int why);

/* Whether the cause is a disk of the host, so that a retry may succeed. */
bool error_is_of_storage(error_code code);

/* The code with this name; ERROR_INTERNAL if the name is unknown. */
error_code error_code_from_name(const char *name);

#endif
