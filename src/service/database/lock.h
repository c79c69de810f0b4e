// SPDX-License-Identifier: Apache-2.0
/* lock: the exclusive lock of a process on a state directory. An open descriptor holds it, so that it ends
 * with the process. The lock file contains the process id, for messages only.
 */
#ifndef HEXAD_SERVICE_DATABASE_LOCK_H
#define HEXAD_SERVICE_DATABASE_LOCK_H

#include <stdbool.h>

#include "base/core/error.h"

/* Returns the descriptor, which the caller closes, or -1 and an error. *in_use: another process holds the
 * lock. With in_use NULL the call waits up to a second for the lock: the kernel needs time to release a
 * killed process. */
int lock_take(const char *state_dir, bool *in_use, error *e);

#endif
