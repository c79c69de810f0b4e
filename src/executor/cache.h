/* cache: results that were made before, for jobs that ask for the same again.
 *
 * The key is a hash of the program's version and of all in the spec that a result depends on; a job with a
 * time for its target has none. An entry holds what every input was when its result was made: path, size,
 * device, inode, times of change, and SHA-256. It answers only while all of that still is so, which needs
 * no file to be read. Jobs with a task per frame are not cached. No state; any thread.
 */
#ifndef HEXAD_EXECUTOR_CACHE_H
#define HEXAD_EXECUTOR_CACHE_H

#include <stdbool.h>
#include <stdint.h>

#include "store/file.h"
#include "store/root.h"

/* False: such a job is never cached. */
bool cache_key(const char *spec, char key[STORE_HASH_SIZE]);

/* What the inputs that the report of a result names are now, as text to be freed. NULL: one of them was
 * changed after `since_ms` (wall clock), when the attempt began, or cannot be looked at: no entry can be
 * made. */
char *cache_describe_inputs(const store_roots *roots, const char *directory, int64_t since_ms);

/* Whether every input still is what it was. */
bool cache_is_fresh(const store_roots *roots, const char *inputs);

/* Makes a directory with the files of a result in another, by links. */
bool cache_link_result(const char *from, const char *to, error *e);

#endif
