/* thread_pool: threads that run what would block the serving thread: work that waits for a disk or a worker.
 *
 * There are enough threads for many submissions to share one flush of the queue (its group commit). Users are served in
 * turn: next is the work of the user with the fewest pieces of work that run; among equals, of the user who was served
 * least recently. A user has at most `most_of_user` threads, so that a thread is left for others. The work of one user starts
 * in the order in which it was added. Work runs together only up to a sum of weights, and never overtakes work whose turn it
 * is. Work that has waited for `patience_ms` is refused as soon as a thread of the pool is free to do so. Any thread may add work.
 */
#ifndef HEXAD_HTTP_THREAD_POOL_H
#define HEXAD_HTTP_THREAD_POOL_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"

typedef struct thread_pool thread_pool;

typedef enum thread_pool_refusal { THREAD_POOL_STOPS, THREAD_POOL_IS_BUSY } thread_pool_refusal;

/* A piece of work, embedded in what it works on. The pool owns it from thread_pool_add until it calls `run` or `refuse`. */
typedef struct thread_pool_work {
    void (*run)(struct thread_pool_work *work);
    void (*refuse)(struct thread_pool_work *work, thread_pool_refusal why); /* instead of run */
    const char *user;                                                       /* lives as long as the work */
    size_t weight;
    int64_t since_ms; /* when it was added */
    struct thread_pool_work *next;
} thread_pool_work;

typedef struct thread_pool_settings {
    unsigned threads;
    unsigned most_of_user;
    size_t most_weight; /* work that weighs more runs when nothing else with a weight does */
    int nice; /* added to the nice value of the threads: what they compute gives way to other threads of the process */
    int64_t patience_ms;
} thread_pool_settings;

thread_pool *thread_pool_start(const thread_pool_settings *settings, error *e);

/* Refuses all work that has not begun, and all that is added from now on. Accepts NULL. */
void thread_pool_refuse(thread_pool *p);

/* Refuses as well, waits for the work that runs, and ends the threads. Accepts NULL. */
void thread_pool_stop(thread_pool *p);

void thread_pool_add(thread_pool *p, thread_pool_work *work);

#endif
