/* result: reads and checks the result that an attempt left in its directory.
 *
 * A directory is a result when it has a report.json, and its summary.json, or without a valid one its report.json, is valid JSON, has an
 * outcome and a count, and lists outputs that exist as regular files of the stated sizes. A worker wrote all of it, so it is checked like any other input. No
 * state; any thread.
 */
#ifndef HEXAD_RESULTS_RESULT_H
#define HEXAD_RESULTS_RESULT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "json/json.h"
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
    int64_t report_bytes; /* as a summary says; -1: it was not read from one */
    size_t output_count;
    result_output *output; /* as the report lists them; report.json is added by result_list only */
    char *notes;           /* what people should know of it, a JSON object: resolved_share,
                            * ratings, outcome_reasons, warnings, advice (doc/report.md) */
} result;

/* Reads and checks a result. The caller clears it. Errors: input_damaged tells what is wrong with the result. internal
 * tells why it could not be read (no descriptors, a disk error); the result may be good. */
bool result_read(const char *directory, result *r, error *e);

/* Like result_read, and returns the parsed report.json, to be freed; NULL on failure. Its sweeps are null: a long report
 * is never in memory as a whole. */
json *result_read_report(const char *directory, result *r, error *e);
/* Like result_read, and returns the document that it was read from, to be freed: summary.json, or the report as above.
 * NULL on failure. */
json *result_read_short(const char *directory, result *r, error *e);

/* Like result_read, when that takes no time to speak of: the report is short or has a summary. */
bool result_peek(const char *directory, result *r);

/* Like result_read, with report.json as the last of the outputs. A report may be long, so the list is stored in a
 * hidden file beside it, which later calls read. */
bool result_list(const char *directory, result *r, error *e);
/* Stores that list if the report is too long for result_peek, which then reads the list. For a report without a summary. */
void result_list_long(const char *directory);
/* Removes the list that result_list has stored. Call it before report.json is replaced. */
void result_forget_list(const char *directory);
void result_clear(result *r); /* accepts an empty one */

/* Opens a file of a result without following links. -1 and an error when it does not exist. `name` must be a plain file
 * name. */
int result_open_file(const char *directory, const char *name, int64_t *bytes, error *e);

/* The paths "WORK_DIR/results/ID" and "WORK_DIR/attempts/ID.N"; with a frame "ID.FRAME" replaces ID. To be freed.
 * `frame` is QUEUE_NO_FRAME when the job is no array. */
char *result_directory(const char *work_dir, const char *id, int frame);
char *result_attempt_directory(const char *work_dir, const char *id, int frame, int attempt);

/* The space that a directory of a result or an attempt takes on the disk: its blocks and those of its files, also of
 * files that other directories share by hard links. 0: there is no such directory. */
int64_t result_disk_bytes(const char *directory);

/* Removes all files of an attempt except its log. */
void result_remove_leftovers(const char *directory);

#endif
