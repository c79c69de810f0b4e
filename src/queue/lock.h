/* lock: who owns a state directory. The lock is held by an open descriptor, so that it ends with its process; the
 * file has the number of that process, for messages only. */
#ifndef HEXAD_QUEUE_LOCK_H
#define HEXAD_QUEUE_LOCK_H

#include <stdbool.h>

#include "base/error.h"

/* The descriptor, which close(2) gives up; or -1 and an error. *in_use (may be NULL) says whether the reason is that
 * another process holds the lock. */
int lock_take(const char *state_dir, bool *in_use, error *e);

#endif
