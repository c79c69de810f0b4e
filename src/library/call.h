// SPDX-License-Identifier: Apache-2.0
/* call: a job of the library (hexad.h), and the two ways to run it: in this process, or in a child. */
#ifndef HEXAD_LIBRARY_CALL_H
#define HEXAD_LIBRARY_CALL_H

#include <signal.h>

#include <hexad.h>

#include "base/core/numeric_state.h"
#include "base/json/json.h"
#include "job/phases/result_arrays.h"
#include "job/source/source_arrays.h"
#include "spec/spec.h"

struct hexad_job {
    char *text; /* of the spec */
    source_arrays arrays;
    char *directory; /* of relative paths; NULL: the working directory */
    char **roots;
    size_t root_count;
    hexad_progress *progress;
    void *progress_context;
    bool has_run;
    volatile sig_atomic_t stop; /* see run_options.cancel; accessed atomically */
    numeric_state host;         /* state of the thread that calls, during the call */
    result_arrays results;
};

/* Interval of the calls of the progress function, and of the checks of time. */
enum { CALL_TICK_MS = 50 };

/* Memory limit of a job without limits.memory_mb, as that of hexad-worker. */
enum { CALL_MEMORY_MB = 4096 };

/* Calls the progress function in the state that the host has set. False: it cancels the job. */
static inline bool call_report_progress(hexad_job *job, const char *phase, double fraction)
{
    if (!job->progress) return true;
    numeric_state_leave(&job->host);
    const int stop = job->progress(job->progress_context, phase, fraction);
    numeric_state_enter(&job->host);
    return stop == 0;
}

/* Runs a spec without files, on threads of this process. */
bool call_in_process(hexad_job *job, const spec *s, error *e);

/* Runs a spec in hexad-worker. `document`: the spec as JSON. */
bool call_in_child(hexad_job *job, const json *document, const spec *s, error *e);

#endif
