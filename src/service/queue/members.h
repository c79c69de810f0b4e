// SPDX-License-Identifier: Apache-2.0
/* members: the struct of an open queue.
 *
 * Private to src/service/queue. `overtaken` and `changed` belong to the thread that makes changes; `stamp`
 * and `commits` to any thread.
 */
#ifndef HEXAD_SERVICE_QUEUE_MEMBERS_H
#define HEXAD_SERVICE_QUEUE_MEMBERS_H

#include <pthread.h>
#include <stdatomic.h>
#include <sys/queue.h>

#include "service/database/database.h"
#include "service/queue/queue.h"

/* Jobs whose seq differ by a multiple of this share a stamp. */
#define MEMBERS_STAMPS 4096

/* State between claims: the job that did not fit, and the number of times that others have overtaken it. */
typedef struct overtaken {
    int64_t seq;
    int times;
} overtaken;

struct queue {
    database *database;
    overtaken overtaken;
    queue_bounds bounds;
    running_time *running;
    char owner_of_piece[QUEUE_OWNER_SIZE]; /* of the last piece of queue_do_piece */
    pthread_mutex_t storing;               /* protects the next list */
    pthread_cond_t stored;
    LIST_HEAD(, submission_entry) entries;      /* submissions in progress (service/queue/submission.c) */
    atomic_uint_fast64_t stamp[MEMBERS_STAMPS]; /* stamps of jobs */
    atomic_uint_fast64_t commits;
    bool changed[MEMBERS_STAMPS]; /* stamps that the next commit increments */
};

/* Reads the periods of the last queue_store_running. */
bool running_read(queue *q, running_period periods[RUNNING_PERIODS_MOST], size_t *count, error *e);

#endif
