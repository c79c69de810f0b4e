/* engine: an interface to run attempts, as a table of functions. The only engine is local processes (executor/local).
 *
 * The caller starts an attempt, waits for its descriptors, and polls it when one is ready. It may cancel the attempt.
 * It settles the attempt exactly once, after poll has returned true. No function waits. One thread makes all calls
 * for one attempt.
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
} engine_request;

typedef struct engine_attempt engine_attempt; /* each engine has its own */

typedef struct engine_ending {
    int exit_status, signal;   /* one of them -1 */
    int64_t peak_memory_bytes; /* 0: not known */
    bool out_of_memory;        /* the kernel ended it at its limit of memory */
    char *last_words;          /* last line of standard error, "" when there is none; to be freed */
} engine_ending;

typedef struct engine {
    const char *name;
    /* NULL and an error (internal) when the attempt did not start. */
    engine_attempt *(*start)(const engine_request *request, error *e);
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
