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

typedef enum error_code {
    ERROR_NONE = 0,
    ERROR_SPEC_INVALID,
    ERROR_NOT_SUPPORTED,
    ERROR_PATH_FORBIDDEN,
    ERROR_INPUT_MISSING,
    ERROR_INPUT_DAMAGED,
    ERROR_INPUT_UNSUPPORTED,
    ERROR_GRID_MISSING,
    ERROR_GRID_AMBIGUOUS,
    ERROR_ISOVALUE_REQUIRED,
    ERROR_NO_SURFACE,
    ERROR_LIMIT_MEMORY,
    ERROR_LIMIT_TIME,
    ERROR_STALLED,
    ERROR_CANCELLED,
    ERROR_DEPENDENCY_FAILED,
    ERROR_STORAGE_FULL,   /* no space is left on a disk, or within a quota */
    ERROR_STORAGE_FAILED, /* a disk does not read or write */
    ERROR_INTERRUPTED,
    ERROR_DATABASE_DAMAGED,
    ERROR_INTERNAL,
    ERROR_CODE_COUNT
} error_code;

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

/* What a failed system call on a file says: storage_full (ENOSPC, EDQUOT), storage_failed (EIO), internal. */
error_code error_code_of_errno(int why);

/* Whether a disk of the host is at fault, so that the same may succeed later. */
bool error_is_of_storage(error_code code);

/* The code of a name, ERROR_INTERNAL for a name that is not known. */
error_code error_code_from_name(const char *name);

#endif
