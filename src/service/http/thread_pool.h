// SPDX-License-Identifier: Apache-2.0
/* thread_pool: threads for work that would block the serving thread because it waits for a disk or a worker.
 *
 * There are enough threads for many submissions to share one flush of the queue (its group commit). Users are
 * served in turn: the next work is that of the user with the fewest running pieces of work; among equals, of
 * the user that was served least recently. The ledger limits the threads of a user, so that threads remain
 * for other users. The work of one user starts in the order in which it was added. Pieces of work run
 * together only up to a sum of weights. No work overtakes the work whose turn it is. Work that has waited for
 * `patience_ms` is refused as soon as a thread of the pool is free. Any thread may add work.
 */
#ifndef HEXAD_SERVICE_HTTP_THREAD_POOL_H
#define HEXAD_SERVICE_HTTP_THREAD_POOL_H

#include <stddef.h>
#include <stdint.h>
#include <sys/queue.h>

#include "base/core/error.h"
#include "service/ledger/ledger.h"

typedef struct thread_pool thread_pool;

typedef enum thread_pool_refusal { THREAD_POOL_STOPS, THREAD_POOL_IS_BUSY } thread_pool_refusal;

/* A piece of work, embedded in the object that it works on. The pool owns it from thread_pool_add until it
 * calls `run` or `refuse`. */
typedef struct thread_pool_work {
    void (*run)(struct thread_pool_work *work);
    void (*refuse)(struct thread_pool_work *work, thread_pool_refusal why); /* instead of run */
    /* remains valid as long as the work */
    const char *user;
    size_t weight;
    int64_t since_ms; /* time at which it was added */
    STAILQ_ENTRY(thread_pool_work) link;
} thread_pool_work;

typedef struct thread_pool_settings {
    unsigned threads;
    ledger *counts;       /* must outlive the pool */
    ledger_resource kind; /* its threads in the ledger; of no other pool */
    size_t most_weight;   /* limit of the sum; heavier work runs while no other work with a weight runs */
    int nice; /* added to the nice value of the threads, so that other threads of the process have priority */
    int64_t patience_ms;
} thread_pool_settings;

thread_pool *thread_pool_start(const thread_pool_settings *settings, error *e);

/* Refuses all work that has not begun, and all work that is added later. Accepts NULL. */
void thread_pool_refuse(thread_pool *p);

/* As thread_pool_refuse; then waits for running work and ends the threads. Accepts NULL. */
void thread_pool_stop(thread_pool *p);

void thread_pool_add(thread_pool *p, thread_pool_work *work);

#endif
