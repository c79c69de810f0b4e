/* lock: the lock by which one process owns a state directory. An open descriptor holds it, so it ends with the process.
 * The lock file contains the process id, for messages only. */
#ifndef HEXAD_DATABASE_LOCK_H
#define HEXAD_DATABASE_LOCK_H

#include <stdbool.h>

#include "base/error.h"

/* Returns the descriptor, to be released with close(2), or -1 and an error. *in_use is true when another process holds the
 * lock. With in_use NULL the lock is waited for, for a second: the kernel needs time to take a killed process apart. */
int lock_take(const char *state_dir, bool *in_use, error *e);

#endif
