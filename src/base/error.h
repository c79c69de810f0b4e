/* error: the one error type of the project.
 *
 * A function that can fail returns bool (true is success) or a pointer (NULL is failure) and takes
 * an `error *` last, which may be NULL. The error is filled where the fault is found, in words that
 * say what is wrong, where, and what to do; a layer that knows more (the file, the grid) adds its
 * context once with error_prefix. Outputs of a failed call are untouched.
 *
 * Codes are the stable codes of the job contract: the same in REST, in the worker's last line and
 * in the attempt's record. Threads: no state is shared; one error belongs to one thread at a time.
 */
#ifndef HEXAD_BASE_ERROR_H
#define HEXAD_BASE_ERROR_H

#include <stdbool.h>

#include "base/words.h"

#define ERROR_LIST(ENTRY, prefix)                                                                       \
    ENTRY(prefix, NONE, "none")                                                                         \
    ENTRY(prefix, SPEC_INVALID, "spec_invalid")                                                         \
    ENTRY(prefix, NOT_SUPPORTED, "not_supported")                                                       \
    ENTRY(prefix, PATH_FORBIDDEN, "path_forbidden")                                                     \
    ENTRY(prefix, INPUT_MISSING, "input_missing")                                                       \
    ENTRY(prefix, INPUT_DAMAGED, "input_damaged")                                                       \
    ENTRY(prefix, INPUT_UNSUPPORTED, "input_unsupported")                                               \
    ENTRY(prefix, GRID_MISSING, "grid_missing")                                                         \
    ENTRY(prefix, GRID_AMBIGUOUS, "grid_ambiguous")                                                     \
    ENTRY(prefix, ATTRIBUTE_MISSING, "attribute_missing")                                               \
    ENTRY(prefix, ISOVALUE_REQUIRED, "isovalue_required")                                               \
    ENTRY(prefix, NO_SURFACE, "no_surface")                                                             \
    ENTRY(prefix, LIMIT_MEMORY, "limit_memory")                                                         \
    ENTRY(prefix, LIMIT_TIME, "limit_time")                                                             \
    ENTRY(prefix, LIMIT_FILE, "limit_file") /* a file is longer than allowed: file_mb */                \
    ENTRY(prefix, STALLED, "stalled")                                                                   \
    ENTRY(prefix, CANCELLED, "cancelled")                                                               \
    ENTRY(prefix, DEPENDENCY_FAILED, "dependency_failed")                                               \
    ENTRY(prefix, STORAGE_FULL, "storage_full")     /* no space is left on a disk, or within a quota */ \
    ENTRY(prefix, STORAGE_FAILED, "storage_failed") /* a disk does not read or write */                 \
    ENTRY(prefix, OUTPUT_TAKEN, "output_taken")     /* another user's result is in output.directory */  \
    ENTRY(prefix, OUTPUT_UNWRITABLE,                                                                    \
          "output_unwritable") /* the service may not write to output.directory */                      \
    ENTRY(prefix, INTERRUPTED, "interrupted")                                                           \
    ENTRY(prefix, DATABASE_DAMAGED, "database_damaged")                                                 \
    ENTRY(prefix, INTERNAL, "internal")

typedef enum error_code { ERROR_LIST(WORDS_ENUMERATOR, ERROR) ERROR_CODE_COUNT } error_code;

typedef struct error {
    error_code code;
    char message[1024]; /* UTF-8, no line break, never cut inside a character */
} error;

/* Fills *e (unless NULL) and returns false, so that a fault reads `return error_set(e, ...)`. */
bool error_set(error *e, error_code code, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* Puts "context: " before the message; returns false. A NULL or empty error is left alone. */
bool error_prefix(error *e, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* "spec_invalid", ...; "none" for ERROR_NONE. Never NULL. */
const char *error_code_name(error_code code);

/* What a failed system call on a file says: storage_full (ENOSPC, EDQUOT), storage_failed (EIO),
 * limit_file (EFBIG), internal. */
error_code error_code_of_errno(int why);

/* Whether a disk of the host is at fault, so that the same may succeed later. */
bool error_is_of_storage(error_code code);

/* The code of a name, ERROR_INTERNAL for a name that is not known. */
error_code error_code_from_name(const char *name);

#endif
