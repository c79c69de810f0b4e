// SPDX-License-Identifier: Apache-2.0
/* run_options: what a caller sets beside the spec. */
#ifndef HEXAD_JOB_PHASES_RUN_OPTIONS_H
#define HEXAD_JOB_PHASES_RUN_OPTIONS_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "job/phases/result_delivery.h"
#include "job/phases/progress.h"
#include "job/phases/sequence.h"
#include "files/root.h"

typedef struct run_options {
    const char *output;       /* directory of the results; NULL: there is none */
    delivery delivery;        /* where the points and the report go */
    const store_roots *roots; /* permitted locations of inputs; NULL: anywhere */
    const struct source_arrays
        *arrays; /* inputs in memory, by the names that the spec has as paths; or NULL */
    /* the job shares its process with other code: it opens no file of its own, and its memory is what the job
     * accounts for, not that of the process */
    bool is_hosted;
    int64_t memory_mb;                   /* if the spec has no limit, MB */
    int64_t most_memory_mb;              /* the largest limit that a job may have, MB; 0: unknown */
    int threads;                         /* maximum, and the default; 0: one per processor */
    int frame;                           /* the frame to run, if the spec has queue.frames */
    const sequence_files *previous;      /* previous frame of a coherent sequence, or NULL */
    int progress_fd;                     /* -1: no progress lines */
    bool exact_measures;                 /* see measures_input; for tests and measurements */
    bool progress_bar;                   /* also draw a bar on standard error */
    progress_listener listener;          /* also receives the progress; function NULL: none */
    const volatile sig_atomic_t *cancel; /* number of a signal: stop; SIGALRM: time limit; may be NULL */
    /* Prints e and ends the process. Called on another thread if the job must stop and is in a call that
     * cannot be interrupted; no incomplete file remains. NULL: the job waits for the call. */
    void (*leave)(const error *e);
} run_options;

/* The memory limit in bytes. `own_mb`: that of the spec; 0: it has none. */
static inline size_t run_options_memory(const run_options *options, int64_t own_mb)
{
    return (size_t)(own_mb > 0 ? own_mb : options->memory_mb) << 20;
}

/* The largest memory limit that a job may have, in bytes; 0: unknown. */
static inline size_t run_options_most_memory(const run_options *options)
{
    return (size_t)options->most_memory_mb << 20;
}

#endif
