/* engine: an interface to run attempts, as a table of functions. There are two: processes of this machine
 * (executor/local), and jobs of Slurm (slurm/slurm).
 *
 * The caller starts an attempt, waits for its descriptors or for the request's wake_fd, and polls it then. It may cancel
 * the attempt. It settles the attempt exactly once, after poll has returned true, or leaves it. No function waits. One thread makes
 * all calls for one attempt.
 */
#ifndef HEXAD_EXECUTOR_ENGINE_H
#define HEXAD_EXECUTOR_ENGINE_H

#include <poll.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/control_group.h"
#include "base/error.h"
#include "base/sandbox.h"
#include "queue/queue.h"

#define ENGINE_MAX_FDS 3

typedef struct engine_request {
    const char *worker;    /* path of the worker program */
    const char *command;   /* "run", "estimate" or "inspect" */
    const char *directory; /* the attempt's own directory, which exists and is empty; takes the output */
    const char *spec;      /* JSON text */
    const char *const *input_roots;
    size_t input_root_count; /* 0: no file may be read */
    int64_t memory_mb;       /* > 0 */
    control_groups *groups;  /* in which the kernel keeps this limit; NULL: the worker keeps it itself */
    int64_t file_mb;         /* the longest file that the worker may write; 0: no limit */
    sandbox_mode sandbox;    /* the sandbox that the worker has to enter */
    int threads;             /* > 0 */
    int frame;               /* QUEUE_NO_FRAME: none */
    const char *trace; /* traceparent of the submission, which the worker finds as TRACEPARENT; NULL: none */
    const char *previous; /* directory of the results that this frame begins with; NULL: none */
    const char *instance; /* id of this service; "": of no attempt, as for an estimate */
    const char *owner;    /* of the job; NULL: nobody */
    int priority;         /* of the job */
    double timeout_s;     /* what is left of its time; 0: no limit */
    int wake_fd; /* an eventfd to be written to when poll has news; an engine with descriptors leaves it alone */
} engine_request;

typedef struct engine_attempt engine_attempt; /* each engine has its own */

/* Why an attempt has no ending of its own, or one that the engine knows the cause of. */
typedef enum engine_loss {
    ENGINE_NOT_LOST,
    ENGINE_GIVEN_BACK,  /* its worker was never started, or was stopped to make room: it does not count */
    ENGINE_INTERRUPTED, /* it ended with its node: as with the daemon's host */
    ENGINE_CRASHED,     /* stopped from outside, or it could not be run there: it counts */
    ENGINE_OUT_OF_TIME, /* at a limit of the engine */
    ENGINE_REFUSED      /* the engine does not take it, and would not take it later */
} engine_loss;

typedef struct engine_ending {
    int exit_status, signal; /* one of them -1; both when the attempt is lost */
    engine_loss loss;
    char why[256];     /* of a loss, in words */
    char host[65];     /* where it ran; "": here, or not known */
    int64_t ran_ms;    /* how long the worker ran; 0: as the caller measured */
    int64_t waited_ms; /* in the engine's queue before the worker began; 0: it has none, or it is not known */
    int64_t processor_ms;      /* of the worker and its readers; 0: not known */
    int64_t peak_memory_bytes; /* 0: not known */
    bool out_of_memory;        /* the kernel ended it at its limit of memory */
    char *last_words;          /* last line of standard error, "" when there is none; to be freed */
} engine_ending;

typedef struct engine {
    const char *name;
    /* NULL and an error (internal) when the attempt did not start. `place` is the engine's own (executor_settings). */
    engine_attempt *(*start)(void *place, const engine_request *request, error *e);
    /* Takes up an attempt that an earlier daemon started and that runs on. NULL: attempts end with the daemon. */
    engine_attempt *(*resume)(void *place, const engine_request *request, error *e);
    /* Whether the attempt in this directory may be resumed; as resume. */
    bool (*runs_on)(void *place, const char *directory);
    /* Frees an attempt that the next daemon is to resume; it runs on. As resume. */
    void (*leave)(engine_attempt *attempt);
    /* After all were resumed: removes what the engine has of other attempts. As resume. */
    void (*sweep)(void *place);
    /* When the worker began, by the monotonic clock; INT64_MAX: it waits. */
    int64_t (*began_ms)(const engine_attempt *attempt);
    /* The name of the worker for the log. */
    const char *(*identify)(const engine_attempt *attempt);
    /* Writes the descriptors to wait for and returns their number. */
    size_t (*watch)(const engine_attempt *attempt, struct pollfd fds[ENGINE_MAX_FDS]);
    /* Reads what the worker has written. *progress is the newest complete line since the last call, or NULL. It is
     * valid until the next call. True when the attempt has ended. */
    bool (*poll)(engine_attempt *attempt, const char **progress);
    /* Asks the attempt to end, or with `force` kills it. */
    void (*cancel)(engine_attempt *attempt, bool force);
    /* Writes worker.log into the attempt's directory, fills *ending and frees the attempt. */
    void (*settle)(engine_attempt *attempt, engine_ending *ending);
} engine;

#endif
