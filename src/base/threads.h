/* threads: a pool that runs loops. Workers sleep between loops; nothing spins.
 *
 * threads_run splits 0 .. count into chunks of `grain`, which workers take as they come. Which worker
 * runs a chunk is not determined, so a loop's result must not depend on it: write to places that
 * belong to the chunk, and reduce afterwards in a fixed order. One loop at a time per pool, started
 * by the thread that made the pool (which works too, as worker 0).
 */
#ifndef HEXAD_BASE_THREADS_H
#define HEXAD_BASE_THREADS_H

#include <stddef.h>

#include "base/error.h"

typedef struct threads threads;
typedef void (*threads_work)(void *context, int worker, size_t begin, size_t end);

/* `count` workers, 1 .. 256; 1 starts no thread at all. */
threads *threads_new(int count, error *e);
void threads_free(threads *t);
int threads_count(const threads *t);

void threads_run(threads *t, size_t count, size_t grain, threads_work work, void *context);

/* The processors that this process may run on. */
int threads_available(void);

#endif
