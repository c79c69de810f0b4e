// SPDX-License-Identifier: Apache-2.0
#include "service/database/schema.h"

#include <stdlib.h>
#include <string.h>

#include "service/database/health.h"

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

/* The uploaded files that jobs read, and whether only one task of the job reads the file (`file` of a task). */
#define OF_TASK "of_task INTEGER NOT NULL DEFAULT 0"
#define INPUTS_OF_ALL "CREATE INDEX input_of_all ON input (job, name) WHERE of_task = 0;"
#define INPUTS                                                       \
    "CREATE TABLE input ("                                           \
    "  name TEXT NOT NULL,"                                          \
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE," \
    "  " OF_TASK ","                                                 \
    "  PRIMARY KEY (name, job)"                                      \
    ") STRICT, WITHOUT ROWID;"                                       \
    "CREATE INDEX input_by_job ON input (job);" INPUTS_OF_ALL

/* What users have to do with uploaded files; both are named by SHA-256 hashes. sent_ms: since when the user holds the file;
 * NULL: it does not. Each file has a row of the user '' as well: a file without it is of a database that was lost. */
#define UPLOADS                                                        \
    "CREATE TABLE upload ("                                            \
    "  hash TEXT NOT NULL,"                                            \
    "  user TEXT NOT NULL,"                                            \
    "  bytes INTEGER NOT NULL,"                                        \
    "  sent_ms INTEGER,"                                               \
    "  name TEXT,"                                                     \
    "  PRIMARY KEY (hash, user)"                                       \
    ") STRICT, WITHOUT ROWID;"                                         \
    "CREATE INDEX upload_by_user ON upload (user, sent_ms DESC, hash)" \
    "  WHERE sent_ms IS NOT NULL;"

/* Values that the executor needs of a spec. They are read from the spec once, at the submission. Limits of 0:
 * the service's own. */
#define TIMEOUT "timeout_ms INTEGER NOT NULL DEFAULT 0"
#define STALL "stall_ms INTEGER NOT NULL DEFAULT 0"
#define DIRECTORY "directory TEXT"
#define CACHE_KEY "cache_key TEXT"
#define EXECUTION ", " TIMEOUT ", " STALL ", " DIRECTORY ", " CACHE_KEY

/* The highest number of a deleted event, in one row. */
#define REMOVED_EVENTS                           \
    "CREATE TABLE removed_events ("              \
    "  one INTEGER PRIMARY KEY CHECK (one = 1)," \
    "  up_to INTEGER NOT NULL"                   \
    ") STRICT;"

/* Temporary files of result copies in output directories. The row is stored before the file is created. */
#define COPIES                  \
    "CREATE TABLE copy ("       \
    "  name TEXT PRIMARY KEY,"  \
    "  directory TEXT NOT NULL" \
    ") STRICT, WITHOUT ROWID;"

/* The user for whom the last report was delivered to an output directory. */
#define OUTPUTS                     \
    "CREATE TABLE output ("         \
    "  directory TEXT PRIMARY KEY," \
    "  owner TEXT NOT NULL"         \
    ") STRICT, WITHOUT ROWID;"

/* The service instance (one row), and the deleted tasks whose directories must be removed: the directory of
 * the result, and the directories of the attempts up to the stored number. */
#define REMOVAL_OF_TASK "CREATE INDEX removal_of_task ON removal (id, frame);"
#define INSTANCE                    \
    "CREATE TABLE instance ("       \
    "  id TEXT NOT NULL,"           \
    "  boot_id TEXT NOT NULL"       \
    ") STRICT;"                     \
    "CREATE TABLE removal ("        \
    "  number INTEGER PRIMARY KEY," \
    "  id TEXT NOT NULL,"           \
    "  frame INTEGER,"              \
    "  attempts INTEGER NOT NULL"   \
    ") STRICT;"                     \
    "CREATE INDEX removal_by_id ON removal (id);" REMOVAL_OF_TASK

/* Number of jobs in each state, for frequent measurements; without those that no caller sees (SCHEMA_WHOLE). */
#define STATE_COUNT                             \
    "CREATE TABLE state_count ("                \
    "  state TEXT PRIMARY KEY,"                 \
    "  jobs INTEGER NOT NULL CHECK (jobs >= 0)" \
    ") STRICT, WITHOUT ROWID;" STATE_COUNT_CHANGES
#define STATE_COUNT_CHANGES                                                                      \
    "CREATE TRIGGER job_comes AFTER INSERT ON job WHEN new.tasks > 0 BEGIN"                      \
    "  INSERT INTO state_count VALUES (new.state, 1) ON CONFLICT DO UPDATE SET jobs = jobs + 1;" \
    "END;"                                                                                       \
    "CREATE TRIGGER job_turns AFTER UPDATE OF state, tasks ON job"                               \
    "  WHEN new.state != old.state OR new.tasks != old.tasks BEGIN"                              \
    "  UPDATE state_count SET jobs = jobs - 1 WHERE state = old.state AND old.tasks > 0;"        \
    "  INSERT INTO state_count SELECT new.state, 1 WHERE new.tasks > 0"                          \
    "    ON CONFLICT DO UPDATE SET jobs = jobs + 1;"                                             \
    "END;"                                                                                       \
    "CREATE TRIGGER job_goes AFTER DELETE ON job WHEN old.tasks > 0 BEGIN"                       \
    "  UPDATE state_count SET jobs = jobs - 1 WHERE state = old.state;"                          \
    "END;"

#define OUTCOME "outcome TEXT CHECK (outcome IN ('converged', 'unresolved', 'not_converged'))"
#define UNRESOLVED "unresolved INTEGER NOT NULL DEFAULT 0"

/* The id of a notification, and the end of the job that it reports. */
#define OUTBOX_EVENT "event TEXT NOT NULL DEFAULT ''"
#define OUTBOX_ENDED "ended_ms INTEGER NOT NULL DEFAULT 0"

/* Users that have unfinished jobs or owe a turn, in the order of their turns (service/queue/owner). The table
 * service has one row with the values of the whole queue. */
#define OWNER_TASKS "tasks INTEGER NOT NULL DEFAULT 0" /* unfinished ones */
#define OWNER                                                       \
    "CREATE TABLE owner ("                                          \
    "  name TEXT PRIMARY KEY,"                                      \
    "  unfinished INTEGER NOT NULL CHECK (unfinished >= 0),"        \
    "  running INTEGER NOT NULL CHECK (running >= 0),"              \
    "  pass REAL NOT NULL,"                                         \
    "  priority INTEGER,"                                           \
    "  first INTEGER, " OWNER_TASKS ") STRICT, WITHOUT ROWID;"      \
    "CREATE INDEX owner_turn ON owner (priority DESC, pass, first)" \
    "  WHERE priority IS NOT NULL;"                                 \
    "CREATE TABLE service ("                                        \
    "  one INTEGER PRIMARY KEY CHECK (one = 1),"                    \
    "  turn REAL NOT NULL,"                                         \
    "  is_held INTEGER NOT NULL"                                    \
    ") STRICT;"                                                     \
    "INSERT INTO service VALUES (1, 0, 0);"

/* Whether a dependent job waits for the end only, and not for success. */
#define ANY_END "any_end INTEGER NOT NULL DEFAULT 0"

/* Whether the owner of a job may learn of the job `cached_from` (service/queue/relation). */
#define CACHED_SHOWN "cached_shown INTEGER NOT NULL DEFAULT 0"

/* Jobs are found and sorted by name and priority, and found by the time of their submission. */
#define SORTED                                                    \
    "CREATE INDEX job_by_name ON job (" SCHEMA_NAME_KEY ", seq);" \
    "CREATE INDEX job_by_priority ON job (priority, seq);"
#define FOUND SORTED "CREATE INDEX job_by_time ON job (created_ms);"

/* The results of ended jobs: the sums of each user, and the sums of all users in the table service. The
 * indexes have the order in which jobs are deleted when a bound is reached (service/queue/usage). */
#define ADD_TO_USAGE \
    " ON CONFLICT DO UPDATE SET results = results + excluded.results, bytes = bytes + excluded.bytes;"
#define USAGE                                                                                            \
    "CREATE TABLE usage ("                                                                               \
    "  owner TEXT PRIMARY KEY,"                                                                          \
    "  results INTEGER NOT NULL,"                                                                        \
    "  bytes INTEGER NOT NULL"                                                                           \
    ") STRICT, WITHOUT ROWID;"                                                                           \
    "ALTER TABLE service ADD COLUMN results INTEGER NOT NULL DEFAULT 0;"                                 \
    "ALTER TABLE service ADD COLUMN result_bytes INTEGER NOT NULL DEFAULT 0;"                            \
    "CREATE TRIGGER usage_begins AFTER INSERT ON usage BEGIN"                                            \
    "  UPDATE service SET results = results + new.results, result_bytes = result_bytes + new.bytes;"     \
    "END;"                                                                                               \
    "CREATE TRIGGER usage_changes AFTER UPDATE ON usage BEGIN"                                           \
    "  UPDATE service SET results = results + new.results - old.results,"                                \
    "    result_bytes = result_bytes + new.bytes - old.bytes;"                                           \
    "END;"                                                                                               \
    "CREATE TRIGGER job_leaves AFTER UPDATE OF succeeded, failed, timed_out, result_bytes ON job"        \
    "  WHEN new.result_bytes IS NOT old.result_bytes OR"                                                 \
    "    new.succeeded + new.failed + new.timed_out != old.succeeded + old.failed + old.timed_out BEGIN" \
    "  INSERT INTO usage VALUES (new.owner,"                                                             \
    "    new.succeeded + new.failed + new.timed_out - old.succeeded - old.failed - old.timed_out,"       \
    "    coalesce(new.result_bytes, 0) - coalesce(old.result_bytes, 0))" ADD_TO_USAGE "END;"             \
    "CREATE TRIGGER job_is_adopted AFTER INSERT ON job WHEN new.succeeded > 0 BEGIN"                     \
    "  INSERT INTO usage VALUES (new.owner, new.succeeded, 0)" ADD_TO_USAGE "END;"                       \
    "CREATE TRIGGER job_is_deleted AFTER DELETE ON job BEGIN"                                            \
    "  UPDATE usage SET results = results - old.succeeded - old.failed - old.timed_out,"                 \
    "    bytes = bytes - coalesce(old.result_bytes, 0) WHERE owner = old.owner;"                         \
    "  DELETE FROM usage WHERE owner = old.owner AND results = 0 AND bytes = 0;"                         \
    "END;"                                                                                               \
    "CREATE INDEX job_leaving ON job ((delivered_ms IS NULL), coalesce(delivered_ms, finished_ms))"      \
    "  WHERE " SCHEMA_KEPT ";"                                                                           \
    "CREATE INDEX job_leaving_of ON job"                                                                 \
    "  (owner, (delivered_ms IS NULL), coalesce(delivered_ms, finished_ms)) WHERE " SCHEMA_KEPT ";"      \
    "CREATE INDEX job_unmeasured ON job (seq) WHERE " SCHEMA_UNMEASURED ";"
#define WAITED_MS "waited_ms INTEGER"
#define PROCESSOR_MS "processor_ms INTEGER"
#define RESULT_BYTES "result_bytes INTEGER DEFAULT 0"    /* NULL: not known yet */
#define DELIVERED "delivered INTEGER NOT NULL DEFAULT 0" /* tasks */
#define DELIVERED_MS "delivered_ms INTEGER"
#define IS_DELIVERED "is_delivered INTEGER NOT NULL DEFAULT 0"

/* The wait of a delayed task or a notification that was set when its last try ended
 * (service/queue/running). */
#define WAIT_MS "wait_ms INTEGER NOT NULL DEFAULT 0"
/* The periods in which the daemon ran (base/core/running_time), oldest first. */
#define RUNNING                     \
    "CREATE TABLE running ("        \
    "  number INTEGER PRIMARY KEY," \
    "  from_ms INTEGER NOT NULL,"   \
    "  length_ms INTEGER NOT NULL"  \
    ") STRICT;"
/* copy_state of a job: state of the copy to output.directory. copy_code and copy_message: reason of a
 * failure. A task has a copy_code if its result could not be copied or must still be copied ('pending'). */
#define COPY_STATE "copy_state TEXT CHECK (copy_state IN ('delivered', 'failed', 'pending'))"
#define COPY_CODE "copy_code TEXT"
#define COPY_MESSAGE "copy_message TEXT"
#define COPYING "CREATE INDEX job_copying ON job (seq) WHERE copy_state = 'pending';"
#define UNDELIVERED "CREATE INDEX job_undelivered ON job (seq) WHERE " SCHEMA_UNDELIVERED ";"

/* The outcomes for which dependent jobs start (SCHEMA_ACCEPTED). Default: all. */
#define ACCEPT "accept INTEGER NOT NULL DEFAULT 14"

/* The maximum number of tasks of a job that run at the same time; 0: any number. */
#define MAX_RUNNING "max_running INTEGER NOT NULL DEFAULT 0"
/* Number of tasks that wait for frames of other jobs (service/queue/frame_needs), and whether the first
 * queued task of an ordered job waits so. */
#define HELD "held INTEGER NOT NULL DEFAULT 0 CHECK (held >= 0)"
#define FIRST_HELD "first_held INTEGER NOT NULL DEFAULT 0"
/* Number of tasks of a chunk, and whether every task that is ready is in a chunk with a running task
 * (service/queue/chunks). */
#define CHUNK "chunk INTEGER NOT NULL DEFAULT 1 CHECK (chunk >= 1)"
#define CHUNKS_BUSY "chunks_busy INTEGER NOT NULL DEFAULT 0"
#define WAITS "waits INTEGER NOT NULL DEFAULT 0"
/* The name of the task's file (queue.files). */
#define FILE_NAME "file TEXT"
#define BY_FRAME "by_frame INTEGER NOT NULL DEFAULT 0"

/* Changes of many tasks of a job, in several transactions (service/queue/pieces). target: the state that the tasks
 * get, from the number target_from on, with target_message. examine_from: the number from which held tasks are
 * examined. */
#define TARGET "target TEXT CHECK (target IN ('queued', 'failed', 'cancelled'))"
#define TARGET_FROM "target_from INTEGER NOT NULL DEFAULT 0"
#define TARGET_MESSAGE "target_message TEXT"
#define EXAMINE_FROM "examine_from INTEGER"
/* The number from which the results of all tasks must still be copied to output.directory; NULL: none. */
#define COPY_FROM "copy_from INTEGER"
/* Jobs and frames that have ended (job_state.ended), while jobs with a seq above `after` that wait for them are
 * not updated. */
#define ENDED                                                              \
    "CREATE TABLE ended ("                                                 \
    "  number INTEGER PRIMARY KEY,"                                        \
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"       \
    "  is_whole INTEGER NOT NULL,"                                         \
    "  frame INTEGER NOT NULL,"                                            \
    "  after INTEGER NOT NULL"                                             \
    ") STRICT;"                                                            \
    "CREATE INDEX ended_by_job ON ended (job);"                            \
    "CREATE INDEX job_pieces ON job (owner, seq) WHERE " SCHEMA_HAS_PIECES \
    ";CREATE INDEX job_hidden ON job (seq) WHERE tasks = 0;"
#define UNCOPIED "CREATE INDEX task_uncopied ON task (job, number) WHERE copy_code IS NOT NULL;"
#define TASK_READY                                                                        \
    "CREATE INDEX task_ready ON task (job, number) WHERE state = 'queued' AND waits = 0;" \
    "CREATE INDEX task_held ON task (job, number) WHERE state = 'queued' AND waits > 0;"
#define READY                                                                       \
    "CREATE INDEX job_ready ON job (owner, priority DESC, seq, threads, memory_mb)" \
    "  WHERE " SCHEMA_CLAIMABLE ";"

/* Whether reports of jobs that reuse a result may be hard links to the reports of other jobs. */
#define LINKED_REPORTS "linked_reports INTEGER NOT NULL DEFAULT 0"
#define REPORTS "ALTER TABLE service ADD COLUMN " LINKED_REPORTS ";"

/* A job has the counts of its tasks, so that its state follows from one row. `pending` counts the jobs it
 * waits for. The spec has a table of its own, because it is long and never changes, while the row changes
 * often. */
static const char tables[] =
    "CREATE TABLE job ("
    "  seq INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  id TEXT NOT NULL UNIQUE,"
    "  revision INTEGER NOT NULL DEFAULT 1,"
    "  owner TEXT NOT NULL,"
    "  state TEXT NOT NULL CHECK (state IN ('queued', 'blocked', 'paused', 'running', 'cancelling',"
    "    " SCHEMA_FINAL_STATES ")),"
    "  " OUTCOME ","
    "  priority INTEGER NOT NULL,"
    "  threads INTEGER NOT NULL,"
    "  memory_mb INTEGER NOT NULL,"
    "  max_attempts INTEGER NOT NULL,"
    "  retention_s INTEGER NOT NULL DEFAULT 0,"
    "  is_array INTEGER NOT NULL DEFAULT 0,"
    "  is_ordered INTEGER NOT NULL DEFAULT 0,"
    "  is_paused INTEGER NOT NULL DEFAULT 0,"
    "  is_cancelled INTEGER NOT NULL DEFAULT 0,"
    "  pending INTEGER NOT NULL DEFAULT 0 CHECK (pending >= 0),"
    "  tasks INTEGER NOT NULL,"
    "  ready INTEGER NOT NULL,"
    "  delayed INTEGER NOT NULL DEFAULT 0,"
    "  running INTEGER NOT NULL DEFAULT 0,"
    "  succeeded INTEGER NOT NULL DEFAULT 0,"
    "  failed INTEGER NOT NULL DEFAULT 0,"
    "  cancelled INTEGER NOT NULL DEFAULT 0,"
    "  timed_out INTEGER NOT NULL DEFAULT 0,"
    "  " UNRESOLVED ","
    "  not_converged INTEGER NOT NULL DEFAULT 0,"
    "  attempts INTEGER NOT NULL DEFAULT 0,"
    "  created_ms INTEGER NOT NULL,"
    "  started_ms INTEGER,"
    "  finished_ms INTEGER,"
    "  expires_ms INTEGER,"
    "  name TEXT,"
    "  labels TEXT NOT NULL,"
    "  trace TEXT,"
    "  webhook TEXT,"
    "  error_code TEXT,"
    "  error_message TEXT,"
    "  cached_from TEXT,"
    "  " CACHED_SHOWN ","
    "  key TEXT,"
    "  body_hash TEXT,"
    "  " RESULT_BYTES ", " DELIVERED ", " DELIVERED_MS ","
    "  " COPY_STATE ", " COPY_CODE ", " COPY_MESSAGE ", " ACCEPT ", " MAX_RUNNING ","
    "  " HELD ", " FIRST_HELD ", " CHUNK ", " CHUNKS_BUSY ","
    "  " TARGET ", " TARGET_FROM ", " TARGET_MESSAGE ", " EXAMINE_FROM ", " COPY_FROM ","
    "  CHECK (ready >= 0 AND delayed >= 0 AND running >= 0 AND"
    "    ready + delayed + running + succeeded + failed + cancelled + timed_out = tasks)"
    ") STRICT;"
    "CREATE INDEX job_by_state ON job (state, seq);"
    "CREATE INDEX job_by_owner ON job (owner, seq);" FOUND COPYING UNDELIVERED
    "CREATE UNIQUE INDEX job_by_key ON job (owner, key) WHERE key IS NOT NULL;" STATE_COUNT
    "CREATE INDEX job_expiring ON job (expires_ms) WHERE expires_ms IS NOT NULL;" READY ENDED

    "CREATE TABLE spec ("
    "  job INTEGER PRIMARY KEY REFERENCES job (seq) ON DELETE CASCADE,"
    "  spec TEXT NOT NULL,"
    "  paths TEXT" EXECUTION ") STRICT;"

    "CREATE TABLE task ("
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  number INTEGER NOT NULL,"
    "  frame INTEGER,"
    "  state TEXT NOT NULL DEFAULT 'queued' CHECK (state IN ('queued', 'delayed', 'running', " SCHEMA_FINAL_STATES
    ")),"
    "  " OUTCOME ","
    "  attempt INTEGER NOT NULL DEFAULT 0,"
    "  spent INTEGER NOT NULL DEFAULT 0,"
    "  interrupted INTEGER NOT NULL DEFAULT 0,"
    "  ran_ms INTEGER NOT NULL DEFAULT 0,"
    "  storage_faults INTEGER NOT NULL DEFAULT 0,"
    "  not_before_ms INTEGER,"
    "  " WAIT_MS ","
    "  started_ms INTEGER,"
    "  finished_ms INTEGER,"
    "  error_code TEXT,"
    "  error_message TEXT,"
    "  " IS_DELIVERED ", " COPY_CODE ", " COPY_MESSAGE ", " WAITS ", " FILE_NAME ","
    "  PRIMARY KEY (job, number)"
    ") STRICT, WITHOUT ROWID;"
    "CREATE UNIQUE INDEX task_by_frame ON task (job, frame) WHERE frame IS NOT NULL;" TASK_READY
    "CREATE INDEX task_running ON task (job, number) WHERE state = 'running';"
    "CREATE INDEX task_delayed ON task (not_before_ms) WHERE state = 'delayed';" UNCOPIED

    "CREATE TABLE attempt ("
    "  job INTEGER NOT NULL,"
    "  task INTEGER NOT NULL,"
    "  number INTEGER NOT NULL,"
    "  started_ms INTEGER NOT NULL,"
    "  finished_ms INTEGER,"
    "  exit_status INTEGER,"
    "  signal INTEGER,"
    "  peak_memory_bytes INTEGER,"
    "  host TEXT,"
    "  reason TEXT,"
    "  " WAITED_MS ","
    "  " PROCESSOR_MS ","
    "  PRIMARY KEY (job, task, number),"
    "  FOREIGN KEY (job, task) REFERENCES task (job, number) ON DELETE CASCADE"
    ") STRICT, WITHOUT ROWID;"

    OWNER USAGE REPORTS

    "CREATE TABLE label ("
    "  label TEXT NOT NULL,"
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  PRIMARY KEY (label, job)"
    ") STRICT, WITHOUT ROWID;"
    "CREATE INDEX label_by_job ON label (job);"

    "CREATE TABLE dependency ("
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  needs INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE, " ANY_END ", " BY_FRAME ","
    "  PRIMARY KEY (job, needs)"
    ") STRICT, WITHOUT ROWID;"
    "CREATE INDEX dependency_by_need ON dependency (needs, job);"

    INPUTS UPLOADS COPIES OUTPUTS INSTANCE RUNNING "CREATE TABLE event ("
    "  seq INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  at_ms INTEGER NOT NULL,"
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  type TEXT NOT NULL CHECK (type IN ('state', 'task', 'started', 'ended', 'edited')),"
    "  state TEXT NOT NULL,"
    "  outcome TEXT,"
    "  frame INTEGER,"
    "  attempt INTEGER"
    ") STRICT;"
    "CREATE INDEX event_by_job ON event (job, seq);" REMOVED_EVENTS
    "INSERT INTO removed_events VALUES (1, 0);"

    "CREATE TABLE cache ("
    "  key TEXT PRIMARY KEY,"
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  inputs TEXT NOT NULL"
    ") STRICT, WITHOUT ROWID;"
    "CREATE INDEX cache_by_job ON cache (job);"

    "CREATE TABLE outbox ("
    "  number INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  webhook TEXT NOT NULL,"
    "  state TEXT NOT NULL,"
    "  outcome TEXT,"
    "  tries INTEGER NOT NULL DEFAULT 0,"
    "  due_ms INTEGER NOT NULL, " OUTBOX_EVENT ", " OUTBOX_ENDED ", " WAIT_MS ") STRICT;"
    "CREATE INDEX outbox_by_time ON outbox (due_ms, number);"
    "CREATE INDEX outbox_by_job ON outbox (job);";

static const char set_version[] = "PRAGMA user_version = " TEXT(SCHEMA_VERSION);

/* Migration from version 11, in which only the wall clock determined the end of a retention or a wait. A
 * delayed task then starts at once after the clock was set back. */
static const char add_running[] =
    RUNNING "ALTER TABLE task ADD COLUMN " WAIT_MS ";ALTER TABLE outbox ADD COLUMN " WAIT_MS ";";
/* Migration from version 11, in which a job that reused a result had the report of the other job, and a
 * result replaced the results of all other users in its output directory. */
static const char add_reports[] = REPORTS OUTPUTS "ALTER TABLE job ADD COLUMN " COPY_STATE ";"
                                                  "ALTER TABLE job ADD COLUMN " COPY_CODE ";"
                                                  "ALTER TABLE job ADD COLUMN " COPY_MESSAGE ";"
                                                  "ALTER TABLE task ADD COLUMN " COPY_CODE ";"
                                                  "ALTER TABLE task ADD COLUMN " COPY_MESSAGE ";" COPYING;
/* Migration from version 12, in which jobs whose results were not delivered were not counted. */
static const char add_undelivered[] = UNDELIVERED;
/* Migration from version 13, in which dependent jobs started with any outcome. */
static const char add_accept[] = "ALTER TABLE job ADD COLUMN " ACCEPT ";";
/* Migration from version 14, in which any number of tasks of a job could run. */
static const char add_max_running[] = "ALTER TABLE job ADD COLUMN " MAX_RUNNING ";";
/* Migration from version 15, in which no task waited for a frame of another job. */
static const char add_frame_needs[] = "ALTER TABLE job ADD COLUMN " HELD ";"
                                      "ALTER TABLE job ADD COLUMN " FIRST_HELD ";"
                                      "ALTER TABLE task ADD COLUMN " WAITS ";"
                                      "ALTER TABLE dependency ADD COLUMN " BY_FRAME ";"
                                      "DROP INDEX job_ready; DROP INDEX task_ready;" READY TASK_READY;
/* Migration from version 16, in which arrays had no chunks. The condition of job_ready changed again after 20. */
static const char add_chunks[] = "ALTER TABLE job ADD COLUMN " CHUNK ";"
                                 "ALTER TABLE job ADD COLUMN " CHUNKS_BUSY ";";
static const char renew_ready[] = "DROP INDEX job_ready;" READY;
/* Migration from version 17, in which the owner learned of every job whose result was reused. Jobs that were
 * deleted may have been of another user. */
static const char add_cached_shown[] =
    "ALTER TABLE job ADD COLUMN " CACHED_SHOWN ";"
    "UPDATE job SET cached_shown = coalesce((SELECT maker.owner = job.owner FROM job AS maker"
    "  WHERE maker.id = job.cached_from), 0) WHERE cached_from IS NOT NULL;"
    "UPDATE attempt SET reason = 'the result of an equal job' WHERE reason GLOB 'the result of *' AND"
    "  job IN (SELECT seq FROM job WHERE cached_from IS NOT NULL);";
/* Migration from version 19, in which no task had a file. */
static const char add_files[] = "ALTER TABLE task ADD COLUMN " FILE_NAME ";"
                                "ALTER TABLE input ADD COLUMN " OF_TASK ";" INPUTS_OF_ALL;
/* Migration from versions in which a job failed if its result could not be copied. */
static const char find_copies[] = "UPDATE job SET copy_state = 'delivered' WHERE succeeded > 0 AND"
                                  "  seq IN (SELECT job FROM spec WHERE directory IS NOT NULL);";
/* Migration from version 20, in which each change was one transaction. */
static const char add_pieces[] =
    "ALTER TABLE job ADD COLUMN " TARGET ";"
    "ALTER TABLE job ADD COLUMN " TARGET_FROM ";"
    "ALTER TABLE job ADD COLUMN " TARGET_MESSAGE ";"
    "ALTER TABLE job ADD COLUMN " EXAMINE_FROM ";"
    "ALTER TABLE job ADD COLUMN " COPY_FROM ";"
    "ALTER TABLE owner ADD COLUMN " OWNER_TASKS ";"
    "UPDATE owner SET tasks ="
    "  (SELECT coalesce(sum(ready + delayed + running), 0) FROM job WHERE job.owner = owner.name);"
    "DROP TRIGGER job_comes; DROP TRIGGER job_turns; DROP TRIGGER job_goes;" STATE_COUNT_CHANGES ENDED;
static const char add_uncopied[] = UNCOPIED REMOVAL_OF_TASK;
/* Migration from version 20, in which points had all properties by default. */
static const char keep_properties[] =
    "UPDATE spec SET spec = json_set(spec, '$.output.ply.properties', json('[\"all\"]'))"
    "  WHERE json_valid(spec) AND json_extract(spec, '$.output.ply.properties') IS NULL;";
/* Migration from version 21, in which files beside the uploads recorded which users hold them
 * (service/uploads/upload_store). */
static const char add_uploads[] = UPLOADS;
/* Migration from version 11, see add_reports, and from versions whose builds copied the hash of a report with its
 * summary to other reports. */
static const char find_linked_reports[] = "UPDATE service SET linked_reports = 1";

/* The cache keys of some of these builds have no commit, so no result of them is reused. Attempts that still run have keys of
 * the earlier build. */
static const char forget_results[] = "DELETE FROM cache; UPDATE spec SET cache_key = NULL;";

/* The migrations from the versions `first` to `last`, in this order. Version 0: an empty database. A stored
 * spec has every default of the build that stored it. A step for a renamed member or a removed word rewrites
 * the table spec, so that jobs that wait still run. */
static const struct step {
    int first, last;
    const char *sql;
} steps[] = {
    {0, 0, tables},
    {11, 20, add_pieces}, /* these four before the index job_ready, whose condition has their columns */
    {11, 14, add_max_running},
    {11, 16, add_chunks},
    {11, 15, add_frame_needs},
    {16, 20, renew_ready},
    {11, 11, add_running},
    {11, 11, add_reports},
    {11, 12, add_undelivered},
    {11, 13, add_accept},
    {11, 17, add_cached_shown},
    {11, 19, add_files},
    {11, 18, forget_results},
    {11, 20, find_linked_reports},
    {11, 11, find_copies},
    {11, 20, add_uncopied},
    {11, 20, keep_properties},
    {11, 21, add_uploads},
};

bool schema_error_is_damage(int code)
{
    int primary = code & 0xFF;
    return primary == SQLITE_CORRUPT || primary == SQLITE_NOTADB || code == SQLITE_IOERR_DATA ||
           code == SQLITE_IOERR_SHORT_READ; /* a truncated file */
}

bool schema_error_is_read_fault(int code)
{
    return code == SQLITE_IOERR_READ || code == SQLITE_IOERR_CORRUPTFS; /* SQLite maps EIO to this one, too */
}

static bool fail(sqlite3 *database, error *e)
{
    const char *why = sqlite3_errmsg(database);
    if (schema_error_is_damage(sqlite3_extended_errcode(database)))
        return error_set(e, ERROR_DATABASE_DAMAGED, "the database is damaged (%s): %s", why, HEALTH_WAY_OUT);
    return error_set(e, ERROR_INTERNAL, "the queue's database: %s", why);
}

static bool run(sqlite3 *database, const char *sql, error *e)
{
    return sqlite3_exec(database, sql, NULL, NULL, NULL) == SQLITE_OK || fail(database, e);
}

static bool read_version(sqlite3 *database, int *version, error *e)
{
    sqlite3_stmt *statement = NULL;
    bool ok = sqlite3_prepare_v2(database, "PRAGMA user_version", -1, &statement, NULL) == SQLITE_OK &&
              sqlite3_step(statement) == SQLITE_ROW;
    if (ok)
        *version = sqlite3_column_int(statement, 0);
    else
        fail(database, e);
    sqlite3_finalize(statement);
    return ok;
}

static bool make_tables(sqlite3 *database, int version, error *e)
{
    error why = {0};
    bool ok = run(database, "BEGIN IMMEDIATE", &why);
    for (size_t i = 0; ok && i < sizeof steps / sizeof *steps; i++)
        if (version >= steps[i].first && version <= steps[i].last) ok = run(database, steps[i].sql, &why);
    ok = ok && run(database, set_version, &why) && run(database, "COMMIT", &why);
    if (ok) return true;
    /* SQLite cannot prepare a statement: the tables are not those of this version */
    if (sqlite3_errcode(database) == SQLITE_ERROR)
        error_set(e, ERROR_DATABASE_DAMAGED,
                  "the database is damaged (its tables are not those of version %d: %s): %s", version,
                  sqlite3_errmsg(database), HEALTH_WAY_OUT);
    else if (e)
        *e = why;
    run(database, "ROLLBACK", NULL);
    return false;
}

/* ---- comparison with the tables that this version creates */

/* Compares two texts without their white space, which depends on the program that created the table. */
static bool is_same_text(const char *a, const char *b)
{
    for (;; a++, b++) {
        while (*a == ' ') a++;
        while (*b == ' ') b++;
        if (*a != *b || !*a) return *a == *b;
    }
}

static const char *column(sqlite3_stmt *s, int at)
{
    const char *found = (const char *)sqlite3_column_text(s, at);
    return found ? found : "";
}

/* Columns of a table that are missing or different in the other database. */
static bool compare_columns(sqlite3 *wanted, sqlite3 *database, const char *table, FILE *findings, int *count)
{
    sqlite3_stmt *want = NULL, *have = NULL;
    bool ok = sqlite3_prepare_v2(wanted, "SELECT name, type, \"notnull\", pk FROM pragma_table_xinfo(?1)", -1,
                                 &want, NULL) == SQLITE_OK &&
              sqlite3_prepare_v2(database,
                                 "SELECT 1 FROM pragma_table_xinfo(?1) WHERE name = ?2 AND type = ?3"
                                 " AND \"notnull\" = ?4 AND pk = ?5",
                                 -1, &have, NULL) == SQLITE_OK;
    if (ok) sqlite3_bind_text(want, 1, table, -1, SQLITE_STATIC);
    while (ok && sqlite3_step(want) == SQLITE_ROW) {
        sqlite3_bind_text(have, 1, table, -1, SQLITE_STATIC);
        for (int i = 0; i < 4; i++) sqlite3_bind_value(have, i + 2, sqlite3_column_value(want, i));
        int found = sqlite3_step(have);
        if (found == SQLITE_DONE) {
            fprintf(findings, "the table %s lacks the required column %s\n", table, column(want, 0));
            ++*count;
        }
        ok = found == SQLITE_DONE || found == SQLITE_ROW;
        sqlite3_reset(have);
    }
    sqlite3_finalize(want);
    sqlite3_finalize(have);
    return ok;
}

static bool compare_all(sqlite3 *wanted, sqlite3 *database, FILE *findings, int *count)
{
    sqlite3_stmt *want = NULL, *have = NULL;
    bool ok =
        sqlite3_prepare_v2(
            wanted, "SELECT type, name, sql FROM sqlite_schema WHERE name NOT LIKE 'sqlite\\_%' ESCAPE '\\'",
            -1, &want, NULL) == SQLITE_OK &&
        sqlite3_prepare_v2(database, "SELECT sql FROM sqlite_schema WHERE type = ?1 AND name = ?2", -1, &have,
                           NULL) == SQLITE_OK;
    while (ok && sqlite3_step(want) == SQLITE_ROW) {
        const char *type = column(want, 0), *name = column(want, 1);
        sqlite3_bind_text(have, 1, type, -1, SQLITE_STATIC);
        sqlite3_bind_text(have, 2, name, -1, SQLITE_STATIC);
        int found = sqlite3_step(have);
        bool is_table = strcmp(type, "table") == 0;
        ok = found == SQLITE_ROW || found == SQLITE_DONE;
        if (found == SQLITE_DONE ||
            (found == SQLITE_ROW && !is_table && !is_same_text(column(want, 2), column(have, 0)))) {
            fprintf(findings, "the %s %s is %s\n", type, name,
                    found == SQLITE_ROW ? "another one" : "missing");
            ++*count;
        }
        sqlite3_reset(have);
        if (found == SQLITE_ROW && is_table) ok = compare_columns(wanted, database, name, findings, count);
    }
    sqlite3_finalize(want);
    sqlite3_finalize(have);
    return ok;
}

bool schema_compare(sqlite3 *database, FILE *findings, int *count, error *e)
{
    sqlite3 *wanted = NULL;
    *count = 0;
    bool ok = sqlite3_open(":memory:", &wanted) == SQLITE_OK &&
              sqlite3_exec(wanted, tables, NULL, NULL, NULL) == SQLITE_OK;
    if (!ok)
        error_set(e, ERROR_INTERNAL, "the queue's tables: %s", wanted ? sqlite3_errmsg(wanted) : "no memory");
    if (ok) ok = compare_all(wanted, database, findings, count) || fail(database, e);
    sqlite3_close(wanted);
    return ok;
}

static bool check_tables(sqlite3 *database, error *e)
{
    char *findings = NULL;
    size_t length = 0;
    int count = 0;
    FILE *stream = open_memstream(&findings, &length);
    bool ok = schema_compare(database, stream, &count, e);
    fclose(stream);
    if (ok && count)
        ok = error_set(e, ERROR_DATABASE_DAMAGED, "the database is damaged (%.*s): %s",
                       (int)strcspn(findings, "\n"), findings, HEALTH_WAY_OUT);
    free(findings);
    return ok;
}

bool schema_check_version(int version, error *e)
{
    if (version > SCHEMA_VERSION)
        return error_set(
            e, ERROR_INTERNAL,
            "the database of the queue has version %d, and this hexad supports up to %d: run the "
            "newer hexad that wrote it, or choose another state_dir",
            version, SCHEMA_VERSION);
    return version == 0 || version >= SCHEMA_OLDEST ||
           error_set(
               e, ERROR_INTERNAL,
               "the database of the queue has version %d, and this hexad converts versions %d to %d. It is "
               "unchanged. Start the build that wrote it, or choose another state_dir",
               version, SCHEMA_OLDEST, SCHEMA_VERSION - 1);
}

bool schema_prepare(sqlite3 *database, error *e)
{
    int version = 0;
    /* closing a database that is refused must not move its log into it */
    sqlite3_db_config(database, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    if (!read_version(database, &version, e) || !schema_check_version(version, e)) return false;
    sqlite3_db_config(database, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 0, NULL);
    return run(database,
               "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
               "PRAGMA foreign_keys = ON; PRAGMA temp_store = MEMORY;",
               e) &&
           (version == SCHEMA_VERSION || make_tables(database, version, e)) && check_tables(database, e);
}
