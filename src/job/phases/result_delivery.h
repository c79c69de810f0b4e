// SPDX-License-Identifier: Apache-2.0
/* result_delivery: where the points and the report of a job go: files of a directory (results.h), or arrays in
 * memory (result_arrays.h). */
#ifndef HEXAD_JOB_PHASES_RESULT_DELIVERY_H
#define HEXAD_JOB_PHASES_RESULT_DELIVERY_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/threads.h"
#include "base/json/json.h"

struct results_input;
struct report_outputs;

typedef struct delivery {
    void *context; /* argument of the functions */
    /* Removes an earlier result. Called before the job opens its inputs. */
    bool (*begin)(void *context, error *e);
    /* Takes the points, and appends {name, bytes, sha256} of each file to `outputs`. Errors: storage_full, storage_failed,
     * internal, limit_memory, cancelled. */
    bool (*points)(void *context, const struct results_input *in, threads *pool, json *outputs,
                   struct report_outputs *out, error *e);
    /* Takes the report: the result is then complete. */
    bool (*report)(void *context, const json *report, error *e);
    /* Removes what an interrupted job leaves. Any thread. */
    void (*clear)(void *context);
} delivery;

#endif
