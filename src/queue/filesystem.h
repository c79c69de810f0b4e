/* filesystem: whether files can be trusted with SQLite where they lie.
 *
 * Private to src/queue. Over a network locks and flushes are not what they seem, and WAL needs shared memory.
 */
#ifndef HEXAD_QUEUE_FILESYSTEM_H
#define HEXAD_QUEUE_FILESYSTEM_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"

/* The name of a network file system by the number that statfs(2) gives, NULL for any other. */
const char *filesystem_network_name(uint64_t type);

/* An error when the directory lies on one. */
bool filesystem_check(const char *directory, error *e);

#endif
