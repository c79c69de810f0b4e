/* threads: a pool that runs loops. Workers sleep between loops; they look for the next one for some forty microseconds
 * before.
 *
 * threads_run splits 0 .. count into chunks of `grain`. Each worker begins with an equal share of them, a row, so that loops over the
 * same things find them in the caches of the same processors; then it takes what others have left. Which worker
 * runs a chunk is not determined, so a loop's result must not depend on it: write to places that
 * belong to the chunk, and reduce afterwards in a fixed order. One loop at a time per pool, started
 * by the thread that made the pool, which is worker 0.
 *
 * A pool may watch a flag that a signal handler sets. Once it is set, loops start no more chunks; after a loop
 * threads_stopped tells whether it is complete.
 */
#ifndef HEXAD_BASE_THREADS_H
#define HEXAD_BASE_THREADS_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

typedef struct threads threads;
typedef void (*threads_work)(void *context, int worker, size_t begin, size_t end);

#define THREADS_MAX 256

/* Grain for loops whose items take a tenth of a microsecond or longer. */
enum { THREADS_GRAIN = 256 };

/* `count` workers, 1 .. THREADS_MAX; 1 starts no thread at all. `stop` may be NULL. */
threads *threads_new(int count, const volatile sig_atomic_t *stop, error *e);
void threads_free(threads *t);
int threads_count(const threads *t); /* 1 for NULL */

/* Whether loops run on the calling thread alone from now on, which is faster for small ones; returns what was so before. NULL
 * is narrow. */
bool threads_narrow(threads *t, bool narrow);

/* The calling thread alone, which watches the same flag: for loops beside those of `t`. NULL for NULL. */
threads *threads_beside(const threads *t);

bool threads_stopped(const threads *t); /* false for NULL */

/* NULL: on the calling thread. */
void threads_run(threads *t, size_t count, size_t grain, threads_work work, void *context);

/* The same, and beside it `other` once, by one of the threads; not at all where loops are to stop. */
void threads_run_beside(threads *t, void (*other)(void *), void *others_context, size_t count, size_t grain,
                        threads_work work, void *context);

/* memcpy by all threads: of fresh memory most of the time is the first touch. Not complete where loops are to stop. */
void threads_copy(threads *t, void *to, const void *from, size_t bytes);

/* The processors that this process may run on. */
int threads_available(void);

#endif
