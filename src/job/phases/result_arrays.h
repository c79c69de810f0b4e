// SPDX-License-Identifier: Apache-2.0
/* result_arrays: the points of a job as arrays in memory, and their transfer between processes. The arrays are those of
 * points.npz, and those of the mesh. */
#ifndef HEXAD_JOB_PHASES_RESULT_ARRAYS_H
#define HEXAD_JOB_PHASES_RESULT_ARRAYS_H

#include "base/core/number.h"
#include "job/phases/result_delivery.h"

enum { RESULT_ARRAY_NAME = 80 };

typedef struct result_array {
    char name[RESULT_ARRAY_NAME];
    number_type type; /* NUMBER_DOUBLE, NUMBER_INT64 or NUMBER_UINT32 */
    size_t rows;
    size_t components; /* consecutive numbers of a row */
    void *data;
} result_array;

typedef struct result_arrays {
    size_t count;
    result_array *item;
    char *report; /* JSON text; NULL: the result is not complete */
} result_arrays;

/* A delivery to *to, which is zeroed before the job, and outlives it. */
delivery results_in_memory(result_arrays *to);
void result_arrays_free(result_arrays *r); /* accepts a zeroed object */

/* Writes arrays and report, or (`why` not NULL) the error of the job. Error: internal (the other end is closed). */
bool result_arrays_write(const result_arrays *r, const error *why, int fd, error *e);

/* Waits until the descriptor can be read. False: stop. */
typedef bool result_arrays_wait(void *context);

/* Reads what result_arrays_write wrote; calls `wait` before each part. Free *out after failure, too. Errors: the one that
 * was written; internal (the other process ended before it had written all), limit_memory, cancelled (by `wait`). */
bool result_arrays_read(int fd, result_arrays_wait *wait, void *context, result_arrays *out, error *e);

#endif
