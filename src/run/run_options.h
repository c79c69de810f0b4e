/* run_options: what a job is given beside its spec. */
#ifndef HEXAD_RUN_RUN_OPTIONS_H
#define HEXAD_RUN_RUN_OPTIONS_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "run/sequence.h"
#include "store/root.h"

typedef struct run_options {
    const char *output;             /* directory; made if missing */
    const store_roots *roots;       /* where inputs may lie; NULL: anywhere */
    int64_t memory_mb;              /* when the spec does not say */
    int threads;                    /* at most, and when the spec does not say; 0: the processors there are */
    int frame;                      /* that is run, of a spec with queue.frames */
    const sequence_files *previous; /* of a coherent sequence the frame before; NULL: there is none */
    int progress_fd;                /* -1: no progress lines */
    bool progress_bar;              /* on standard error */
    const volatile sig_atomic_t *cancel; /* a signal's number: stop; SIGALRM: time is up. May be NULL */
    /* Says e and ends the process, called on a thread of its own when the job was told to stop and is busy
     * with what cannot be stopped; nothing half written is left then. NULL: it is waited for. */
    void (*leave)(const error *e);
} run_options;

#endif
