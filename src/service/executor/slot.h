// SPDX-License-Identifier: Apache-2.0
/* slot: processes a claimed task from its claim to its settlement.
 *
 * A slot is a state machine. slot_take starts it, slot_step drives it, and slot_due and slot_watch return
 * when the next step is useful:
 *
 *     free -> starting -> (reusing) -> running -> (stopping) -> deciding -> (publishing) -> settling -> free
 *                |           |                                     |           ^               ^
 *                +-----------+-- the result exists already --------|-----------+               |
 *                +-----------+-- no worker is started -------------|---------------------------+
 *                                                                  +- (checking uploads) ------+
 *
 * deciding and settling are repeated after a delay if the disk or the database is at fault, or the state
 * directory is lost (service/database/place). The supervisor thread calls these functions, except for those
 * at the end of this file.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_SLOT_H
#define HEXAD_SERVICE_EXECUTOR_SLOT_H

#include <poll.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/sandbox.h"
#include "service/executor/engine.h"
#include "service/executor/progress_ring.h"
#include "service/executor/settlement.h"
#include "service/queue/queue.h"
#include "service/results/output_place.h"
#include "service/uploads/upload_store.h"
#include "files/root.h"

typedef enum slot_phase {
    SLOT_FREE,
    /* a task was taken; its worker must be started, unless the result exists or no worker can be started */
    SLOT_STARTING,
    SLOT_REUSING,    /* a thread compares and links the result of an equal job */
    SLOT_RUNNING,    /* the worker runs */
    SLOT_STOPPING,   /* the worker was signalled to end, and is killed after the grace time */
    SLOT_DECIDING,   /* the worker has ended; its output must be read */
    SLOT_CHECKING,   /* the worker found a damaged input; a thread compares the uploads with their hashes */
    SLOT_PUBLISHING, /* the result is copied to output.directory */
    SLOT_SETTLING    /* the decision must be carried out and stored in the queue */
} slot_phase;

/* Data shared by all slots. The supervisor may change the second part between two steps. All objects that
 * pointers refer to must outlive the slots. */
typedef struct slot_context {
    const settlement_place *place; /* the queue and the state directory */
    const engine *engine;
    void *engine_place;   /* see executor_settings */
    const char *instance; /* id of this service */
    const char *worker;   /* path of hexad-worker */
    const char *const *input_roots;
    size_t input_root_count;
    const store_roots *roots; /* the input roots and the directory of uploads, open */
    store_inputs *inputs;     /* uploads; NULL: none */
    output_place *outputs;    /* destinations of copies of results */
    progress_ring *progress;
    sandbox_mode sandbox;
    control_groups *groups; /* of the attempts; NULL: none */
    bool cache;             /* jobs get the results of equal jobs */
    int64_t memory_mb;      /* limit of all attempts together */
    int wake_fd;            /* an eventfd; it is written to when a step has become useful */

    int64_t file_mb;           /* maximum size of a file that a worker writes; 0: no limit */
    double timeout_s, stall_s; /* of jobs without limits; 0: none */
    double grace_s;            /* between SIGTERM and SIGKILL */
    int64_t drain_ms;          /* time at which running workers are stopped because of a drain, monotonic */
    bool draining, forcing;    /* forcing: without the grace time */
} slot_context;

/* What slot_step did, as a set of bits. */
typedef enum slot_news {
    SLOT_NO_NEWS = 0,
    SLOT_STARTED = 1,     /* a worker was started */
    SLOT_NOT_STARTED = 2, /* a worker could not be started; the next one probably cannot be started, either */
    SLOT_FREED = 4,       /* the task is settled (in a drain: left to the next start), the slot is free */
    SLOT_NOT_WRITTEN = 8  /* a file of the attempt or its result could not be written */
} slot_news;

typedef struct slot slot;

slot *slot_new(const slot_context *context);
void slot_free(slot *s); /* it must be free; accepts NULL */

bool slot_is_free(const slot *s);

/* A free slot takes over the claim. The attempt uses `width` threads and `memory_mb` of the host. */
void slot_take(slot *s, const queue_claimed *claimed, int width, int64_t memory_mb);

/* slot_take for a job with the result of an equal one: it uses no resources of the host, and is queued again
 * if the result no longer exists. */
void slot_take_repeat(slot *s, const queue_claimed *claimed);

/* slot_take for a task whose attempt an earlier daemon started and which still runs (engine.h, resume). */
void slot_take_resumed(slot *s, const queue_claimed *claimed, int width, int64_t memory_mb);

/* Executes all phases that need no waiting. Returns a set of slot_news. */
unsigned slot_step(slot *s);

/* Time of the next step if no descriptor becomes ready, monotonic; INT64_MAX: never. */
int64_t slot_due(const slot *s);

/* Writes the descriptors to wait for; returns their number. */
size_t slot_watch(const slot *s, struct pollfd fds[ENGINE_MAX_FDS]);

/* ---- any thread */

/* Requests the stop of the worker if the slot has a task of this job; the next step does it. */
void slot_cancel(slot *s, const char *id);

/* Queues the task again if it belongs to this job and its worker has not started, unless the request is
 * withdrawn (`paused` false) in time. */
void slot_pause(slot *s, const char *id, bool paused);

/* If this job was claimed with another priority and its worker has not started, queues the task again. The
 * next claim passes the new priority to the engine. */
void slot_move(slot *s, const char *id, int priority);

/* The newest progress if the slot holds a task of this job, to be freed; NULL: none. */
char *slot_progress(slot *s, const char *id);

/* Writes the host of the worker, see engine.find_host, if the slot holds this task and the worker has started. */
bool slot_host(slot *s, const char *id, int task, char host[ENGINE_HOST_SIZE]);

/* Resources that the attempt in the slot uses; all zero if the slot is free. */
typedef struct slot_usage {
    int attempts; /* 0 or 1 */
    int threads;
    int64_t memory_mb;
} slot_usage;

slot_usage slot_get_usage(slot *s);

#endif
