// SPDX-License-Identifier: Apache-2.0
/* engine: an interface to run attempts, as a table of functions. There are two implementations: processes of
 * this machine (service/executor/local), and jobs of Slurm (service/slurm/slurm).
 *
 * The caller starts an attempt, waits for its descriptors or for the request's wake_fd, and then polls it. It
 * may cancel the attempt. It settles the attempt exactly once after poll has returned true, or leaves it. No
 * function waits. One thread makes all calls for one attempt.
 */
#ifndef HEXAD_SERVICE_EXECUTOR_ENGINE_H
#define HEXAD_SERVICE_EXECUTOR_ENGINE_H

#include <poll.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/control_group.h"
#include "base/core/error.h"
#include "base/core/sandbox.h"
#include "service/queue/queue.h"

#define ENGINE_MAX_FDS 3

typedef struct engine_request {
    const char *worker;    /* path of the worker program */
    const char *command;   /* "run", "estimate" or "inspect" */
    const char *directory; /* directory of the attempt, which exists and is empty; receives the output */
    const char *spec;      /* JSON text */
    const char *const *input_roots;
    size_t input_root_count; /* 0: no file may be read */
    int64_t memory_mb;       /* > 0 */
    int64_t most_memory_mb;  /* the largest memory_mb that a job may have */
    control_groups *groups;  /* the kernel enforces the memory limit in these; NULL: the worker does */
    int64_t file_mb;         /* maximum size of a file that the worker writes; 0: no limit */
    sandbox_mode sandbox;    /* sandbox that the worker enters */
    int threads;             /* > 0 */
    int frame;               /* QUEUE_NO_FRAME: none */
    int chunk; /* attempts of a job with the same number run one after another on one host; -1: none */
    bool more; /* another attempt of the chunk is started next */
    const char *trace;    /* traceparent of the submission, passed to the worker as TRACEPARENT; NULL: none */
    const char *previous; /* directory of the results from which this frame starts; NULL: none */
    const char *instance; /* id of this service; "": no attempt, such as an estimate */
    const char *owner;    /* of the job; NULL: none */
    int priority;         /* of the job */
    double timeout_s;     /* remaining time; 0: no limit */
    int wake_fd; /* eventfd that is written to when poll has news; unused by engines with descriptors */
} engine_request;

typedef struct engine_attempt engine_attempt; /* defined by each engine */

/* Size of the name of a host, with the terminating 0. */
#define ENGINE_HOST_SIZE 65

/* The cause, known to the engine, of an attempt without a regular end. */
typedef enum engine_loss {
    ENGINE_NOT_LOST,
    ENGINE_GIVEN_BACK,  /* the worker never started, or was preempted; the attempt does not count */
    ENGINE_INTERRUPTED, /* ended together with its node, like attempts of a daemon whose host ends */
    ENGINE_CRASHED,     /* killed by another process, or it could not run on the node; the attempt counts */
    ENGINE_OUT_OF_TIME, /* exceeded a limit of the engine */
    ENGINE_REFUSED      /* the engine permanently refuses it */
} engine_loss;

typedef struct engine_ending {
    int exit_status, signal; /* one of them -1; both when the attempt is lost */
    engine_loss loss;
    char why[256];               /* description of a loss */
    char host[ENGINE_HOST_SIZE]; /* host of the worker; "": this host, or unknown */
    int64_t ran_ms;              /* running time of the worker; 0: use the caller's measurement */
    int64_t waited_ms;           /* in the engine's queue before the worker started; 0: none, or unknown */
    int64_t processor_ms;        /* of the worker and its readers; 0: not known */
    int64_t peak_memory_bytes;   /* 0: not known */
    bool out_of_memory;          /* the kernel killed the worker at its memory limit */
    char *last_words;            /* last line of standard error, "" if there is none; to be freed */
} engine_ending;

typedef struct engine {
    const char *name;
    /* Starts an attempt. Error: internal, NULL. `place`: data of the engine (executor_settings). */
    engine_attempt *(*start)(void *place, const engine_request *request, error *e);
    /* Resumes an attempt that an earlier daemon started and that still runs. NULL: attempts end with the
     * daemon. */
    engine_attempt *(*resume)(void *place, const engine_request *request, error *e);
    /* Whether the attempt in this directory can be resumed. NULL like resume. */
    bool (*runs_on)(void *place, const char *directory);
    /* Frees an attempt that the next daemon will resume; it continues to run. NULL like resume. */
    void (*leave)(engine_attempt *attempt);
    /* Removes data of all attempts that were not resumed. NULL like resume. */
    void (*sweep)(void *place);
    /* Start of the worker, monotonic clock; INT64_MAX: it waits. */
    int64_t (*began_ms)(const engine_attempt *attempt);
    /* Writes the name of the host on which the worker runs; "": not known yet. */
    void (*find_host)(const engine_attempt *attempt, char host[ENGINE_HOST_SIZE]);
    /* The name of the worker for the log. */
    const char *(*identify)(const engine_attempt *attempt);
    /* Writes the descriptors to wait for and returns their number. */
    size_t (*watch)(const engine_attempt *attempt, struct pollfd fds[ENGINE_MAX_FDS]);
    /* Reads the output of the worker. *progress: the newest complete line since the last call, or NULL; valid
     * until the next call. True: the attempt has ended. */
    bool (*poll)(engine_attempt *attempt, const char **progress);
    /* Requests the end of the attempt, or with `force` kills it. */
    void (*cancel)(engine_attempt *attempt, bool force);
    /* Writes worker.log to the attempt's directory, sets *ending and frees the attempt. */
    void (*settle)(engine_attempt *attempt, engine_ending *ending);
} engine;

#endif
