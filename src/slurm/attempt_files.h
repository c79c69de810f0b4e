/* attempt_files: the files by which the service and a node of the farm speak about an attempt.
 *
 * They are in work_dir/farm/NAME, with NAME as the attempt's directory (ID.N, ID.FRAME.N). The file system is shared:
 * a node may see a change late, and may continue after the service has abandoned it. So one file determines the
 * owner of the attempt: `claim`, which only one process can create. A node runs an attempt only if it has created its claim, hence
 * at most once. The service returns an attempt to the queue only if it has created the claim, or if Slurm reports
 * that the node's job is over. A node that still runs then finds the directory removed, and its output is not read.
 *
 *     request.json   the service, before it submits: what to run
 *     batch          the service, before it submits: the Slurm job, and the task of its array that is to run the attempt
 *     claim          the side that decides; of a node: the Slurm job and the task that run it
 *     out/           the worker: what becomes attempts/NAME when the attempt has an ending
 *     progress       the node: progress lines, appended
 *     cancel         the service: the worker is to end
 *     ending.json    the node, last of all and by rename
 *
 * Beside them, work_dir/farm/.list-HEX is a list of small attempts that need the same of a node: those that no node was
 * known to have when the service submitted the last of them. It is a hint; the claims decide.
 *
 * Only the ending is flushed to disk: what a power failure takes of the others costs an attempt and no result.
 *
 * No state; any thread.
 */
#ifndef HEXAD_SLURM_ATTEMPT_FILES_H
#define HEXAD_SLURM_ATTEMPT_FILES_H

#include <stdbool.h>
#include <stdint.h>

#include "base/error.h"
#include "executor/engine.h"

#define ATTEMPT_FILES_FARM "farm"
#define ATTEMPT_FILES_LIST ".list-"
#define ATTEMPT_FILES_PROGRESS "progress"
#define ATTEMPT_FILES_OUT "out"

/* Creates the directory with request.json. */
bool attempt_files_begin(const char *directory, const engine_request *request, error *e);

/* Whether there is a request. */
bool attempt_files_exist(const char *directory);

/* Reads request.json; `directory` of the request is out/ of `directory`. To be cleared. */
bool attempt_files_read_request(const char *directory, engine_request *request, error *e);
void attempt_files_clear_request(engine_request *request);

/* A task of a Slurm job, which is an array. */
typedef struct attempt_files_batch {
    char name[192]; /* of the job */
    int task;
    int number; /* in `batch`: 1 if any task of the job may run the attempt, else 0; in `claim`: how many attempts this
                   task had run before */
} attempt_files_batch;

bool attempt_files_write_batch(const char *directory, const attempt_files_batch *batch, error *e);
bool attempt_files_read_batch(const char *directory, attempt_files_batch *batch);

/* Names of attempts, each of which, and the array, is to be freed. */
typedef struct attempt_files_names {
    char **name;
    size_t count;
} attempt_files_names;

void attempt_files_add_name(attempt_files_names *names, const char *name, size_t length);
void attempt_files_clear_names(attempt_files_names *names);
bool attempt_files_write_list(const char *farm, const char *list, const attempt_files_names *names, error *e);
/* Empty when it cannot be read. */
attempt_files_names attempt_files_read_list(const char *farm, const char *list);

typedef enum attempt_files_claim {
    ATTEMPT_FILES_WON,
    ATTEMPT_FILES_TAKEN,  /* another process has it */
    ATTEMPT_FILES_GONE,   /* there is no such attempt any more */
    ATTEMPT_FILES_UNCLEAR /* the file system fails: ask again */
} attempt_files_claim;

/* `by` is NULL: the service. */
attempt_files_claim attempt_files_take(const char *directory, const attempt_files_batch *by);
/* Whether there is a claim. *by is the task that has it; without a name: the service, or a node that could not write
 * more, or has not yet. */
bool attempt_files_read_claim(const char *directory, attempt_files_batch *by);

/* By a node that Slurm started again with an attempt that was taken before. */
bool attempt_files_note_requeue(const char *directory, error *e);
bool attempt_files_is_requeued(const char *directory);

bool attempt_files_cancel(const char *directory, error *e);
/* Also when the directory is gone. */
bool attempt_files_is_cancelled(const char *directory);

/* Reads the ending of a worker. */
bool attempt_files_write_ending(const char *directory, const engine_ending *ending, error *e);
/* *found is false when there is none yet. last_words is to be freed. */
bool attempt_files_read_ending(const char *directory, engine_ending *ending, bool *found, error *e);

/* Adds lines to `progress`. */
bool attempt_files_add_progress(const char *directory, const char *lines);
/* The last complete line after *offset, which moves on; NULL: none; to be freed. */
char *attempt_files_read_progress(const char *directory, int64_t *offset);

/* Puts the output in place of the attempt's own directory, which is empty or gone. Nothing there is no error. */
bool attempt_files_deliver(const char *directory, const char *to, error *e);

#endif
