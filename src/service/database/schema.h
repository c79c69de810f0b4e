// SPDX-License-Identifier: Apache-2.0
/* schema: the tables of the queue's database, and their version.
 *
 * The version is SQLite's user_version. An empty database gets all tables. Versions from SCHEMA_OLDEST on are
 * migrated. An older version is refused. A newer version is refused, because writing to it could lose data
 * that this program does not support. A database that is refused is unchanged.
 */
#ifndef HEXAD_SERVICE_DATABASE_SCHEMA_H
#define HEXAD_SERVICE_DATABASE_SCHEMA_H

#include <stdio.h>

#include <sqlite3.h>

#include "base/core/error.h"

#define SCHEMA_VERSION 22
/* The oldest version that is migrated: commit d10413d0. */
#define SCHEMA_OLDEST 11

/* Sort key for the order by name. */
#define SCHEMA_NAME_KEY "coalesce(name, '') COLLATE NOCASE"

#define SCHEMA_FINAL_STATES "'succeeded', 'failed', 'cancelled', 'timed_out'"

/* SQL condition on a row of job: one of its tasks may be claimed. In an ordered job a running or delayed task
 * blocks the later ones. max_running 0: any number of tasks may run. A held task waits for frames of other
 * jobs;
 * in an ordered job it blocks the later ones, too. chunks_busy: all tasks that are ready wait for the running
 * tasks of their chunks. target: the tasks are being changed. */
#define SCHEMA_CLAIMABLE                                      \
    "ready > held AND pending = 0 AND is_paused = 0 AND"      \
    " (is_ordered = 0 OR running + delayed + first_held = 0)" \
    " AND (max_running = 0 OR running < max_running) AND chunks_busy = 0 AND target IS NULL"

/* SQL condition on a row of job: the job is stored completely. A job without tasks is being stored (paused) or
 * deleted (cancelled), and no caller sees it. */
#define SCHEMA_WHOLE "job.tasks > 0"

/* SQL condition on a row of job: its tasks are being changed (service/queue/pieces). */
#define SCHEMA_HAS_PIECES "(target IS NOT NULL OR examine_from IS NOT NULL)"

/* SQL condition on a row of job: it has succeeded, and queue.accept contains the outcomes of all tasks.
 * `accept` has the bit 1 << queue_outcome for each accepted outcome. */
#define SCHEMA_ACCEPTED                                                                                       \
    "(job.state = 'succeeded' AND (job.accept & 2 OR job.succeeded = job.unresolved + job.not_converged) AND" \
    " (job.accept & 4 OR job.unresolved = 0) AND (job.accept & 8 OR job.not_converged = 0))"

/* The priority and the seq of the first job that the user of a row of owner may have claimed. */
#define SCHEMA_FIRST_JOB                                                                \
    " (SELECT priority, seq FROM job INDEXED BY job_ready WHERE job.owner = owner.name" \
    " AND " SCHEMA_CLAIMABLE " ORDER BY priority DESC, seq LIMIT 1)"

/* SQL conditions on a row of job: it has ended with results or logs to keep; their size is unknown. */
#define SCHEMA_KEPT "finished_ms IS NOT NULL AND succeeded + failed + timed_out > 0"
#define SCHEMA_UNMEASURED "result_bytes IS NULL AND finished_ms IS NOT NULL"

/* SQL condition on a row of job: results could not be copied to output.directory, and the owner has not
 * downloaded them. */
#define SCHEMA_UNDELIVERED "copy_state = 'failed' AND delivered_ms IS NULL"

/* Whether this program opens a database of this version; 0: an empty one. */
bool schema_check_version(int version, error *e);

/* Creates or migrates the tables and compares them with the expected schema. Error: database_damaged (they
 * cannot be read or differ; the message has the required actions). */
bool schema_prepare(sqlite3 *database, error *e);

/* Compares tables, columns and indexes with those of this version. Writes a line for each difference and
 * counts them. False when the schema could not be read. */
bool schema_compare(sqlite3 *database, FILE *findings, int *count, error *e);

/* Whether this SQLite result code means that the stored data is damaged. */
bool schema_error_is_damage(int code);
/* Whether this SQLite result code means that a file could not be read, which may be damage. */
bool schema_error_is_read_fault(int code);

#endif
