/* storage: free space on the disks of the state directory, and the minimum that an attempt needs to start.
 *
 * The subdirectories may be on other file systems: the one with the least free space counts. A check costs a few system
 * calls. Any thread may call storage_free_bytes; only the supervisor calls storage_has_space.
 */
#ifndef HEXAD_EXECUTOR_STORAGE_H
#define HEXAD_EXECUTOR_STORAGE_H

#include <stdbool.h>
#include <stdint.h>

typedef struct storage {
    const char *state_dir, *work_dir; /* outlive the struct; may be the same directory */
    int64_t floor_bytes;              /* 0: none */
    bool low;                         /* the last answer of storage_has_space was false */
} storage;

/* The bytes that the service may use (f_bavail), INT64_MAX if they cannot be determined, and the size of that disk, 0
 * if it cannot be determined. *directory is that of the two directories that is on this disk. */
int64_t storage_free_bytes(const storage *s, int64_t *size_bytes, const char **directory);

/* Whether at least floor_bytes are free. Logs when that changes. */
bool storage_has_space(storage *s);

#endif
