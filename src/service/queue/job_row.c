// SPDX-License-Identifier: Apache-2.0
#include "service/queue/job_row.h"

#include <stdio.h>
#include <string.h>

queue_outcome job_row_outcome(sqlite3_stmt *s, int column)
{
    return queue_outcome_from_name((const char *)sqlite3_column_text(s, column));
}

void job_row_read(sqlite3_stmt *s, queue_job *job)
{
    *job = (queue_job){
        .seq = sqlite3_column_int64(s, 0),
        .revision = sqlite3_column_int64(s, 2),
        .name = database_text(s, 3),
        .owner = database_text(s, 4),
        .labels = database_text(s, 5),
        .trace = database_text(s, 6),
        .outcome = job_row_outcome(s, 8),
        .paused = sqlite3_column_int(s, 9),
        .array = sqlite3_column_int(s, 10),
        .tasks =
            {
                .all = sqlite3_column_int(s, 11),
                .waiting = sqlite3_column_int(s, 12),
                .running = sqlite3_column_int(s, 13),
                .succeeded = sqlite3_column_int(s, 14),
                .failed = sqlite3_column_int(s, 15),
                .cancelled = sqlite3_column_int(s, 16),
                .timed_out = sqlite3_column_int(s, 17),
            },
        .attempts = sqlite3_column_int(s, 18),
        .priority = sqlite3_column_int(s, 19),
        .max_attempts = sqlite3_column_int(s, 20),
        .threads = sqlite3_column_int(s, 21),
        .memory_mb = sqlite3_column_int64(s, 22),
        .created_ms = sqlite3_column_int64(s, 23),
        .started_ms = sqlite3_column_int64(s, 24),
        .finished_ms = sqlite3_column_int64(s, 25),
        .retention_s = sqlite3_column_int64(s, 26),
        .error_code = database_text(s, 27),
        .error_message = database_text(s, 28),
        .cached_from = database_text(s, 29),
        .copy_state = database_text(s, 30),
        .copy_code = database_text(s, 31),
        .copy_message = database_text(s, 32),
        .accepted = sqlite3_column_int(s, 33),
        .cached_shown = sqlite3_column_int(s, 34),
    };
    snprintf(job->id, sizeof job->id, "%s", (const char *)sqlite3_column_text(s, 1));
    queue_state_from_name((const char *)sqlite3_column_text(s, 7), &job->state);
}

void job_row_read_task(sqlite3_stmt *s, int at, queue_task *task)
{
    const char *state = (const char *)sqlite3_column_text(s, at + 2);
    *task = (queue_task){
        .number = sqlite3_column_int(s, at),
        .frame =
            sqlite3_column_type(s, at + 1) == SQLITE_NULL ? QUEUE_NO_FRAME : sqlite3_column_int(s, at + 1),
        .outcome = job_row_outcome(s, at + 3),
        .attempt = sqlite3_column_int(s, at + 4),
        .spent = sqlite3_column_int(s, at + 5),
        .not_before_ms = sqlite3_column_int64(s, at + 6),
        .started_ms = sqlite3_column_int64(s, at + 7),
        .finished_ms = sqlite3_column_int64(s, at + 8),
        .error_code = database_text(s, at + 9),
        .error_message = database_text(s, at + 10),
        .ran_ms = sqlite3_column_int64(s, at + 11),
        .storage_faults = sqlite3_column_int(s, at + 12),
        .interrupted = sqlite3_column_int(s, at + 13),
        .waits = sqlite3_column_int(s, at + 14),
        .file = database_text(s, at + 15),
    };
    /* "delayed" is internal: for callers such a task is queued */
    queue_state_from_name(strcmp(state, "delayed") == 0 ? "queued" : state, &task->state);
}
