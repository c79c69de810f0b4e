/* attempt_files: the files by which the service and a node of the farm speak about an attempt.
 *
 * They are in work_dir/farm/NAME, with NAME as the attempt's directory (ID.N, ID.FRAME.N). The file system is shared:
 * a node may see a change late, and may go on after the service has given it up. So one file decides who has the
 * attempt: `claim`, which only one process can create. A node runs an attempt only if it has created its claim, hence
 * at most once. The service gives an attempt back only if it has created the claim, or if Slurm says that the node's
 * job is over; then a node that runs on finds the directory gone, and nobody reads what it writes.
 *
 *     request.json   the service, before it submits: what to run
 *     batch          the service, before it submits: the name of the Slurm job, and the number in its array
 *     claim          whoever decides; its contents do not matter
 *     out/           the worker: what becomes attempts/NAME when the attempt has an ending
 *     progress       the node: progress lines, appended
 *     cancel         the service: the worker is to end
 *     ending.json    the node, last of all and by rename
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
#define ATTEMPT_FILES_PROGRESS "progress"
#define ATTEMPT_FILES_OUT "out"

/* Creates the directory with request.json. */
bool attempt_files_begin(const char *directory, const engine_request *request, error *e);

/* Whether there is a request. */
bool attempt_files_exist(const char *directory);

/* Reads request.json; `directory` of the request is out/ of `directory`. To be cleared. */
bool attempt_files_read_request(const char *directory, engine_request *request, error *e);
void attempt_files_clear_request(engine_request *request);

/* The Slurm job that runs the attempt. */
typedef struct attempt_files_batch {
    char name[192];
    int task;
} attempt_files_batch;

bool attempt_files_write_batch(const char *directory, const attempt_files_batch *batch, error *e);
bool attempt_files_read_batch(const char *directory, attempt_files_batch *batch);

typedef enum attempt_files_claim {
    ATTEMPT_FILES_WON,
    ATTEMPT_FILES_TAKEN,  /* somebody else has it */
    ATTEMPT_FILES_GONE,   /* there is no such attempt any more */
    ATTEMPT_FILES_UNCLEAR /* the file system fails: ask again */
} attempt_files_claim;

attempt_files_claim attempt_files_take(const char *directory);
bool attempt_files_is_taken(const char *directory);

/* By a node that Slurm started again with an attempt that was taken before. */
bool attempt_files_note_requeue(const char *directory, error *e);
bool attempt_files_is_requeued(const char *directory);

bool attempt_files_cancel(const char *directory, error *e);
/* Also when the directory is gone. */
bool attempt_files_is_cancelled(const char *directory);

/* Of a worker that has ended. */
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
