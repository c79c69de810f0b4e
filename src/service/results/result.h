// SPDX-License-Identifier: Apache-2.0
/* result: reads and checks the result that an attempt left in its directory.
 *
 * A directory is a complete result if it has a report.json, and a document that describes the result: its
 * summary.json, or its report.json if the summary is missing, invalid or of another report. The document must
 * be valid JSON, have an outcome and a count, and list outputs that exist as regular files of the stated
 * sizes. A worker wrote all of it, so it is checked like any other input. No state; any thread.
 */
#ifndef HEXAD_SERVICE_RESULTS_RESULT_H
#define HEXAD_SERVICE_RESULTS_RESULT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/json/json.h"
#include "service/queue/queue.h"
#include "files/file.h"

#define RESULT_LOG_NAME "worker.log" /* written by the engine: the standard error of the worker */

typedef struct result_output {
    char *name; /* file name without directories; does not begin with '.' */
    int64_t bytes;
    char sha256[65]; /* 64 lower-case hexadecimal digits */
} result_output;

typedef struct result {
    queue_outcome outcome;
    int64_t count; /* of points */
    /* length of report.json by the summary; -1: the result was not read from a summary */
    int64_t report_bytes;
    char report_sha256[65]; /* by the summary or a stored list; "": unknown */
    size_t output_count;
    result_output *output; /* in the order of the report; only result_list adds report.json */
    char *notes; /* JSON object of what users should read before they use the result: count, spacing,
                  * ratings, outcome_reasons, warnings, advice (doc/report.md) */
} result;

/* Reads and checks a result. On success the caller calls result_clear. Errors: input_damaged: the result is
 * not complete or not valid. internal: it could not be read (no descriptors, a disk error); it may be
 * valid. */
bool result_read(const char *directory, result *r, error *e);

/* Compares the bytes of each file of a result that was read, also of report.json if its hash is known, with
 * the hash that was stored when the result was made. Reads all files: for threads that no other user waits
 * for. Errors: input_damaged names the file that differs or is missing; those of store_file_hash_until; internal. */
bool result_compare(const char *directory, const result *r, const store_deadline *end, error *e);

/* As result_compare, before the service is ready: has the service manager wait for it. */
bool result_compare_at_start(const char *directory, const result *r, error *e);

/* Reads like result_read, but always report.json, and returns the parsed report, to be freed; NULL on
 * failure. Its member `sweeps` is null, so that a long report is never in memory as a whole. */
json *result_read_report(const char *directory, result *r, error *e);
/* Reads like result_read and returns the document that was read, to be freed: summary.json, or the report as
 * result_read_report returns it. NULL on failure. */
json *result_read_short(const char *directory, result *r, error *e);

/* Reads like result_read if at most 1 MiB must be parsed: there is a stored list, a summary or a short
 * report. Otherwise, and on every error, false. Outputs that are read from a stored list include
 * report.json. */
bool result_peek(const char *directory, result *r);

/* Removes the temporary files of lists and reports that were changed last before `before_ms` (wall clock): a
 * killed process left them. If one is in use after a step of the clock, only storing this list fails, and
 * the next call repeats it. */
void result_clear_temporary(const char *directory, int64_t before_ms);

/* Reads like result_read and adds report.json to the outputs, as the last one. Its hash requires reading a
 * report that may be long, so the list is stored in a hidden file beside it, which later calls read. If it
 * cannot be stored, logs a warning and succeeds. */
bool result_list(const char *directory, result *r, error *e);
/* Stores the list of result_list if report.json is longer than 1 MiB, so that result_peek can read it. Call
 * it for a report without a summary. Errors are ignored. */
void result_list_long(const char *directory);
/* Removes the stored list of result_list, and the summary: both have the hash of report.json. Call it before
 * report.json is replaced. */
void result_forget_list(const char *directory);
void result_clear(result *r); /* accepts an empty one */

/* Opens a file of a result without following symbolic links; *bytes is its length. Returns the descriptor,
 * or -1. `name` must be without directories. Errors: input_damaged: it does not exist or is not a regular
 * file; internal. */
int result_open_file(const char *directory, const char *name, int64_t *bytes, error *e);

/* Hashes a file of a result; *bytes is its length. Errors: those of result_open_file and store_file_hash. */
bool result_hash_file(const char *directory, const char *name, char hex[STORE_HASH_SIZE], int64_t *bytes,
                      error *e);

/* The paths "WORK_DIR/results/ID" and "WORK_DIR/attempts/ID.N"; with a frame "ID.FRAME" replaces ID. To be
 * freed. `frame` is QUEUE_NO_FRAME if the job is not an array. */
char *result_directory(const char *work_dir, const char *id, int frame);
char *result_attempt_directory(const char *work_dir, const char *id, int frame, int attempt);

/* The disk space of a directory of a result or an attempt, in bytes: its blocks and the blocks of its files.
 * Files that other directories share by hard links count in full. 0: the directory does not exist or
 * cannot be read. */
int64_t result_disk_bytes(const char *directory);

/* Removes the directory of an attempt except its log, of at most 1 MiB. Failures are logged. */
void result_remove_leftovers(const char *directory);

#endif
