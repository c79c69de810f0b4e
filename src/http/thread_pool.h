/* thread_pool: threads that run what would block the serving thread: work that waits for a disk or a worker.
 *
 * There are enough threads for many submissions to share one flush of the queue (its group commit). Work
 * starts in the order in which it was added. Any thread may add work.
 */
#ifndef HEXAD_HTTP_THREAD_POOL_H
#define HEXAD_HTTP_THREAD_POOL_H

#include "base/error.h"

typedef struct thread_pool thread_pool;

/* A piece of work, embedded in what it works on. The pool owns it from thread_pool_add until it calls `run`. */
typedef struct thread_pool_work {
    void (*run)(struct thread_pool_work *work);
    struct thread_pool_work *next;
} thread_pool_work;

thread_pool *thread_pool_start(unsigned threads, error *e);

/* Runs all work that was added, and ends the threads. Accepts NULL. */
void thread_pool_stop(thread_pool *p);

void thread_pool_add(thread_pool *p, thread_pool_work *work);

#endif
