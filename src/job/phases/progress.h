// SPDX-License-Identifier: Apache-2.0
/* progress: a running job's progress, as JSON lines on a descriptor, or through a function.
 *
 * At most ten lines per second; the first line of a phase is always written. A line that the reader cannot
 * accept at once is dropped. doc/worker.md lists the members. One thread runs the job; another one may call
 * progress_tick.
 */
#ifndef HEXAD_JOB_PHASES_PROGRESS_H
#define HEXAD_JOB_PHASES_PROGRESS_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/words.h"

#define PROGRESS_LIST(ENTRY, prefix)      \
    ENTRY(prefix, LOAD, "load")           \
    ENTRY(prefix, START, "start")         \
    ENTRY(prefix, RELAX, "relax")         \
    ENTRY(prefix, MEASURE, "measure")     \
    ENTRY(prefix, CURVATURE, "curvature") \
    ENTRY(prefix, WEIGHTS, "weights")     \
    ENTRY(prefix, WRITE, "write")

typedef enum progress_phase { PROGRESS_LIST(WORDS_ENUMERATOR, PROGRESS) PROGRESS_PHASES } progress_phase;

extern const char *const progress_phase_names[PROGRESS_PHASES];

/* Numbers of the relaxation; zero in other phases. */
typedef struct progress_numbers {
    double fraction; /* 0 .. 1 of the relaxation */
    size_t round, sweep, count;
    double energy_excess, rms_step, mean_log10_lambda;
} progress_numbers;

/* Receives the progress: at most ten times per second, and when a phase begins. Called by the thread of the job or
 * by the one that calls progress_tick, one at a time. `fraction`: 0 .. 1 of the job. */
typedef struct progress_listener {
    void (*hear)(void *context, progress_phase phase, double fraction, const progress_numbers *numbers);
    void *context;
} progress_listener;

typedef struct progress {
    int fd;                            /* lines are written here; -1: no lines */
    bool bar;                          /* also draw a bar on standard error */
    progress_listener listener;        /* its function may be NULL */
    int64_t start_ms;                  /* of the job, monotonic */
    int64_t phase_ms[PROGRESS_PHASES]; /* time spent in each phase so far */
    int64_t entered_ms, written_ms;
    int phase;                /* -1 before the first and after the last */
    double fraction, entered; /* 0 .. 1 of the job: now, and at the start of the phase */
    progress_numbers last;    /* of this phase */
    pthread_mutex_t lock;
} progress;

void progress_begin(progress *p, int fd, bool bar, progress_listener listener);
void progress_enter(progress *p, progress_phase phase);
void progress_update(progress *p, const progress_numbers *numbers);

/* Repeats the last line if it is old enough. Returns the milliseconds until the next repetition, > 0. */
int64_t progress_tick(progress *p);

void progress_end(progress *p); /* closes the last phase; phase_ms is then complete */

#endif
