/* storage: how much room is left on the disks of the state directory, and how much there has to be before an attempt
 * is started.
 *
 * Looks at the file systems of the directory and of its parts, which may be others, and tells of the one that has
 * least. A look is a few system calls. Any thread may look; storage_has_room is the supervisor's.
 */
#ifndef HEXAD_EXECUTOR_STORAGE_H
#define HEXAD_EXECUTOR_STORAGE_H

#include <stdbool.h>
#include <stdint.h>

typedef struct storage {
    const char *state_dir; /* outlives it */
    int64_t floor_bytes;   /* 0: none */
    bool low;              /* what storage_has_room found last */
} storage;

/* For the service's processes, root or not (f_bavail); INT64_MAX when it cannot be found out. */
int64_t storage_free_bytes(const storage *s);

/* Whether as much is free as there has to be. Says in the log when that has changed. */
bool storage_has_room(storage *s);

#endif
