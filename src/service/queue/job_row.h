// SPDX-License-Identifier: Apache-2.0
/* job_row: reads rows of the tables job and task into the structures of queue.h.
 *
 * Private to src/service/queue. The statement must select JOB_COLUMNS first, or TASK_COLUMNS starting at any
 * column.
 */
#ifndef HEXAD_SERVICE_QUEUE_JOB_ROW_H
#define HEXAD_SERVICE_QUEUE_JOB_ROW_H

#include "service/database/database.h"
#include "service/database/schema.h"
#include "service/queue/queue.h"

#define JOB_COLUMNS                                                                                          \
    "job.seq, job.id, job.revision, job.name, job.owner, job.labels, job.trace, job.state, job.outcome,"     \
    " job.is_paused, job.is_array, job.tasks, job.ready + job.delayed, job.running, job.succeeded,"          \
    " job.failed, job.cancelled, job.timed_out, job.attempts, job.priority, job.max_attempts, job.threads,"  \
    " job.memory_mb, job.created_ms, job.started_ms, job.finished_ms, job.retention_s, job.error_code,"      \
    " job.error_message, job.cached_from, job.copy_state, job.copy_code, job.copy_message, " SCHEMA_ACCEPTED \
    ", job.cached_shown"
#define JOB_COLUMN_COUNT 35

#define TASK_COLUMNS                                                                                   \
    "task.number, task.frame, task.state, task.outcome, task.attempt, task.spent, task.not_before_ms," \
    " task.started_ms, task.finished_ms, task.error_code, task.error_message, task.ran_ms,"            \
    " task.storage_faults, task.interrupted, task.waits, task.file"

#define TASK_COLUMN_COUNT 16

/* `at`: index of the first of the columns of a task. The spec is not read. Texts are allocated; queue_job_clear and
 * queue_task_clear free them. */
void job_row_read(sqlite3_stmt *s, queue_job *job);
void job_row_read_task(sqlite3_stmt *s, int at, queue_task *task);
queue_outcome job_row_outcome(sqlite3_stmt *s, int column);

#endif
