// SPDX-License-Identifier: Apache-2.0
/* attempt_files: the files through which the service and a node of the farm communicate about an attempt.
 *
 * They are in work_dir/farm/NAME; NAME is the name of the attempt's directory (ID.N, ID.FRAME.N). The file
 * system is shared: a node may see a change late, and may continue after the service has abandoned the
 * attempt. Therefore one file determines the owner of the attempt: `claim`, which only one process can
 * create. A node runs an attempt only if it has created its claim, so an attempt runs at most once. The
 * service returns an attempt to the queue only if it has created the claim, or if Slurm reports that the
 * node's job has ended. A node that still runs then finds the directory removed, and its output is not read.
 *
 *     request.json   by the service, before it submits: the attempt to run
 *     batch          by the service, before it submits: the Slurm job, and the task of its array for the
 *                    attempt
 *     claim          by the owner; of a node: the Slurm job and the task that run the attempt
 *     out/           by the worker: becomes attempts/NAME when the attempt has an ending
 *     progress       by the node: progress lines, appended
 *     cancel         by the service: the worker must end
 *     requeued       by a node that Slurm has restarted with the attempt
 *     ending.json    by the node: written last, by rename
 *
 * work_dir/farm/.list-HEX is a list of small attempts that need the same resources. It has the attempts that
 * no node was known to have claimed when the service submitted the last of them. The list is a hint; the
 * claims decide.
 *
 * Only the ending is flushed to disk. If a power failure destroys other files, an attempt is lost but no
 * result.
 *
 * No state; any thread.
 */
#ifndef HEXAD_SERVICE_SLURM_ATTEMPT_FILES_H
#define HEXAD_SERVICE_SLURM_ATTEMPT_FILES_H

#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "service/executor/engine.h"

#define ATTEMPT_FILES_FARM "farm"
#define ATTEMPT_FILES_LIST ".list-"
#define ATTEMPT_FILES_PROGRESS "progress"
#define ATTEMPT_FILES_OUT "out"

/* Creates the directory with request.json. */
bool attempt_files_begin(const char *directory, const engine_request *request, error *e);

/* Whether the directory has request.json. */
bool attempt_files_exist(const char *directory);

/* Reads request.json. The member `directory` of the request is out/ of `directory`. The caller releases the
 * request with attempt_files_clear_request. */
bool attempt_files_read_request(const char *directory, engine_request *request, error *e);
void attempt_files_clear_request(engine_request *request);

/* A task of a Slurm job. Each job is an array. */
typedef struct attempt_files_batch {
    char name[192]; /* of the job */
    int task;
    /* in `batch`: 1 if any task of the job may run the attempt, otherwise 0. In `claim`: the number of
     * attempts that this task had run before. */
    int number;
} attempt_files_batch;

bool attempt_files_write_batch(const char *directory, const attempt_files_batch *batch, error *e);
bool attempt_files_read_batch(const char *directory, attempt_files_batch *batch);

/* Names of attempts. attempt_files_clear_names frees them. */
typedef struct attempt_files_names {
    char **name;
    size_t count;
} attempt_files_names;

void attempt_files_add_name(attempt_files_names *names, const char *name, size_t length);
void attempt_files_clear_names(attempt_files_names *names);
bool attempt_files_write_list(const char *farm, const char *list, const attempt_files_names *names, error *e);
/* The names in the list. Empty if the list cannot be read. */
attempt_files_names attempt_files_read_list(const char *farm, const char *list);

typedef enum attempt_files_claim {
    ATTEMPT_FILES_WON,
    ATTEMPT_FILES_TAKEN,  /* another process has created the claim */
    ATTEMPT_FILES_GONE,   /* the attempt no longer exists */
    ATTEMPT_FILES_UNCLEAR /* the file system failed: try again */
} attempt_files_claim;

/* Tries to create the claim. `by` is the task of the node, or NULL for the service. */
attempt_files_claim attempt_files_take(const char *directory, const attempt_files_batch *by);
/* Whether there is a claim. *by is the task that created it. If its name is empty, the creator is the
 * service, or a node that has not written the text of the claim. */
bool attempt_files_read_claim(const char *directory, attempt_files_batch *by);

/* Records that Slurm has restarted a node with an attempt that the node had claimed before. */
bool attempt_files_note_requeue(const char *directory, error *e);
bool attempt_files_is_requeued(const char *directory);

bool attempt_files_cancel(const char *directory, error *e);
/* Whether the worker must end. Also true if the directory was removed. */
bool attempt_files_is_cancelled(const char *directory);

/* Writes the ending of a worker. */
bool attempt_files_write_ending(const char *directory, const engine_ending *ending, error *e);
/* Reads the ending. *found is false if there is none yet. The caller frees last_words. */
bool attempt_files_read_ending(const char *directory, engine_ending *ending, bool *found, error *e);

/* Appends lines to `progress`. */
bool attempt_files_add_progress(const char *directory, const char *lines);
/* The last complete line after *offset, which is advanced past it; the caller frees it. NULL: there is
 * none. */
char *attempt_files_read_progress(const char *directory, int64_t *offset);

/* Renames the output to `to`, the attempt's own directory, which is empty or missing. If there is no output,
 * returns true. */
bool attempt_files_deliver(const char *directory, const char *to, error *e);

#endif
