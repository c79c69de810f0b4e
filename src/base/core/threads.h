// SPDX-License-Identifier: Apache-2.0
/* threads: a pool that runs loops in parallel. Between loops workers spin for about 40 microseconds, then
 * sleep.
 *
 * threads_run splits 0 .. count into chunks of `grain`. Each worker starts with an equal, contiguous share,
 * so that loops over the same data find it in the caches of the same processors; then it takes chunks that
 * others have left. The worker of a chunk is not determined, so that a loop's result must not depend on it:
 * write to memory that belongs to the chunk, and reduce afterwards in a fixed order. A pool runs one loop at
 * a time, started by the thread that created the pool, which is worker 0.
 *
 * A pool may watch a flag that a signal handler sets. Once it is set, loops start no further chunks; after a
 * loop, threads_stopped returns whether it may be incomplete.
 */
#ifndef HEXAD_BASE_CORE_THREADS_H
#define HEXAD_BASE_CORE_THREADS_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

typedef struct threads threads;
typedef void (*threads_work)(void *context, int worker, size_t begin, size_t end);

#define THREADS_MAX 256

/* Grain for loops whose items take 0.1 microseconds or longer. */
enum { THREADS_GRAIN = 256 };
/* Maximum number of parts of a sum. They depend on the number of items only, so that the sum does not depend
 * on the number of threads. */
enum { THREADS_SUM_PARTS = 256 };

/* `count` workers, 1 .. THREADS_MAX; 1 starts no thread. `stop` may be NULL. Free it with threads_free.
 * Error: internal. */
threads *threads_new(int count, const volatile sig_atomic_t *stop, error *e);
void threads_free(threads *t);
int threads_count(const threads *t); /* 1 for NULL */

/* Sets whether loops run on the calling thread only, which is faster for small ones. Returns the previous
 * value; true for NULL. */
bool threads_narrow(threads *t, bool narrow);

/* A pool of the calling thread only, with the same flag: for loops concurrent with those of `t`. NULL for
 * NULL. */
threads *threads_beside(const threads *t);

bool threads_stopped(const threads *t); /* false for NULL */

/* False and the error cancelled if the loops are stopped. */
bool threads_may_go_on(const threads *t, error *e);

/* NULL: runs on the calling thread. */
void threads_run(threads *t, size_t count, size_t grain, threads_work work, void *context);

/* threads_run, and a single call of `other` by one of the threads at the same time. No call if loops are
 * stopped. */
void threads_run_beside(threads *t, void (*other)(void *), void *others_context, size_t count, size_t grain,
                        threads_work work, void *context);

/* memcpy by all threads: for new memory most of the time is spent on page faults. Incomplete if loops are
 * stopped. */
void threads_copy(threads *t, void *to, const void *from, size_t bytes);

/* The number of processors on which this process may run. */
int threads_available(void);

#endif
