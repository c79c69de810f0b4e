/* result: what an attempt left in its directory, as far as the service looks into it.
 *
 * A directory is a result when it holds a report.json that parses, names an outcome and a count,
 * and lists outputs that are there as regular files of the stated sizes. Everything in it was
 * written by a worker and is checked like any input from outside. No state; any thread.
 */
#ifndef HEXAD_EXECUTOR_RESULT_H
#define HEXAD_EXECUTOR_RESULT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "queue/queue.h"

#define RESULT_LOG_NAME "worker.log" /* written by the engine: what the worker wrote to standard error */

typedef struct result_output {
    char *name; /* a plain file name */
    int64_t bytes;
    char sha256[65];
} result_output;

typedef struct result {
    queue_outcome outcome;
    int64_t count;
    size_t output_count;
    result_output *output; /* as the report lists them; report.json is not among them, but for result_list */
} result;

/* Reads and checks. Errors: input_damaged says what is wrong with the result; internal says why it could
 * not be looked at (no descriptors, a fault of the disk), which tells nothing of the result. The caller
 * clears. */
bool result_read(const char *directory, result *r, error *e);

/* As result_read, with report.json among the outputs, last. A report may be long, so what is found is kept beside
 * it, in a file that is no output, and the next one who asks reads that. */
bool result_list(const char *directory, result *r, error *e);
void result_clear(result *r); /* accepts an empty one */

/* Opens a file of a result, following no link; -1 and an error when it is not there. `name` must be
 * a plain file name that the caller took from the listing (or the report's). */
int result_open_file(const char *directory, const char *name, int64_t *bytes, error *e);

/* "STATE_DIR/results/ID" and "STATE_DIR/attempts/ID.N", of a frame "ID.FRAME" in place of ID; to be freed.
 * `frame` is QUEUE_NO_FRAME where the job is no array. */
char *result_directory(const char *state_dir, const char *id, int frame);
char *result_attempt_directory(const char *state_dir, const char *id, int frame, int attempt);

#endif
