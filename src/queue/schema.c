#include "queue/schema.h"

#include <stddef.h>

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

/* Which jobs read which of the files that clients sent. */
#define INPUTS                                                                                               \
    "CREATE TABLE input ("                                                                                   \
    "  name TEXT NOT NULL,"                                                                                  \
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"                                         \
    "  PRIMARY KEY (name, job)"                                                                              \
    ") STRICT, WITHOUT ROWID;"                                                                               \
    "CREATE INDEX input_by_job ON input (job);"

/* Up to which number events were removed with their jobs, in one row. */
#define REMOVED_EVENTS                                                                                       \
    "CREATE TABLE removed_events ("                                                                          \
    "  one INTEGER PRIMARY KEY CHECK (one = 1),"                                                             \
    "  up_to INTEGER NOT NULL"                                                                               \
    ") STRICT;"

/* Temporary files of copies of results into directories of others, written down before they are made. */
#define COPIES                                                                                               \
    "CREATE TABLE copy ("                                                                                    \
    "  name TEXT PRIMARY KEY,"                                                                               \
    "  directory TEXT NOT NULL"                                                                              \
    ") STRICT, WITHOUT ROWID;"

/* Whose database this is (one row), and of which tasks that were forgotten the directories are to be removed: those
 * of their results, and of their attempts up to that number. */
#define INSTANCE                                                                                             \
    "CREATE TABLE instance ("                                                                                \
    "  id TEXT NOT NULL,"                                                                                    \
    "  boot_id TEXT NOT NULL"                                                                                \
    ") STRICT;"                                                                                              \
    "CREATE TABLE removal ("                                                                                 \
    "  number INTEGER PRIMARY KEY,"                                                                          \
    "  id TEXT NOT NULL,"                                                                                    \
    "  frame INTEGER,"                                                                                       \
    "  attempts INTEGER NOT NULL"                                                                            \
    ") STRICT;"                                                                                              \
    "CREATE INDEX removal_by_id ON removal (id);"

/* Of its tasks the job has counts, so that its state follows from one row; `pending` counts the jobs that
 * it waits for. The spec stands apart, since it is long and never changes, and the row does often. */
static const char tables[] =
    "CREATE TABLE job ("
    "  seq INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  id TEXT NOT NULL UNIQUE,"
    "  revision INTEGER NOT NULL DEFAULT 1,"
    "  owner TEXT NOT NULL,"
    "  state TEXT NOT NULL CHECK (state IN ('queued', 'blocked', 'paused', 'running', 'cancelling',"
    "    " SCHEMA_FINAL_STATES ")),"
    "  outcome TEXT CHECK (outcome IN ('converged', 'not_converged')),"
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
    "  key TEXT,"
    "  body_hash TEXT,"
    "  CHECK (ready >= 0 AND delayed >= 0 AND running >= 0 AND"
    "    ready + delayed + running + succeeded + failed + cancelled + timed_out = tasks)"
    ") STRICT;"
    "CREATE INDEX job_by_state ON job (state, seq);"
    "CREATE INDEX job_by_owner ON job (owner, seq);"
    "CREATE UNIQUE INDEX job_by_key ON job (owner, key) WHERE key IS NOT NULL;"
    "CREATE INDEX job_expiring ON job (expires_ms) WHERE expires_ms IS NOT NULL;"
    "CREATE INDEX job_ready ON job (owner, priority DESC, seq, threads, memory_mb)"
    "  WHERE " SCHEMA_CLAIMABLE ";"

    "CREATE TABLE spec ("
    "  job INTEGER PRIMARY KEY REFERENCES job (seq) ON DELETE CASCADE,"
    "  spec TEXT NOT NULL,"
    "  paths TEXT"
    ") STRICT;"

    "CREATE TABLE task ("
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  number INTEGER NOT NULL,"
    "  frame INTEGER,"
    "  state TEXT NOT NULL DEFAULT 'queued' CHECK (state IN ('queued', 'delayed', 'running', " SCHEMA_FINAL_STATES
    ")),"
    "  outcome TEXT CHECK (outcome IN ('converged', 'not_converged')),"
    "  attempt INTEGER NOT NULL DEFAULT 0,"
    "  spent INTEGER NOT NULL DEFAULT 0,"
    "  interrupted INTEGER NOT NULL DEFAULT 0,"
    "  ran_ms INTEGER NOT NULL DEFAULT 0,"
    "  storage_faults INTEGER NOT NULL DEFAULT 0,"
    "  not_before_ms INTEGER,"
    "  started_ms INTEGER,"
    "  finished_ms INTEGER,"
    "  error_code TEXT,"
    "  error_message TEXT,"
    "  PRIMARY KEY (job, number)"
    ") STRICT, WITHOUT ROWID;"
    "CREATE UNIQUE INDEX task_by_frame ON task (job, frame) WHERE frame IS NOT NULL;"
    "CREATE INDEX task_ready ON task (job, number) WHERE state = 'queued';"
    "CREATE INDEX task_running ON task (job, number) WHERE state = 'running';"
    "CREATE INDEX task_delayed ON task (not_before_ms) WHERE state = 'delayed';"

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
    "  PRIMARY KEY (job, task, number),"
    "  FOREIGN KEY (job, task) REFERENCES task (job, number) ON DELETE CASCADE"
    ") STRICT, WITHOUT ROWID;"

    /* of those that have jobs which have not ended */
    "CREATE TABLE owner ("
    "  name TEXT PRIMARY KEY,"
    "  unfinished INTEGER NOT NULL CHECK (unfinished >= 0)," /* jobs */
    "  running INTEGER NOT NULL CHECK (running >= 0)"        /* tasks */
    ") STRICT, WITHOUT ROWID;"

    "CREATE TABLE label ("
    "  label TEXT NOT NULL,"
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  PRIMARY KEY (label, job)"
    ") STRICT, WITHOUT ROWID;"
    "CREATE INDEX label_by_job ON label (job);"

    "CREATE TABLE dependency ("
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  needs INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  PRIMARY KEY (job, needs)"
    ") STRICT, WITHOUT ROWID;"
    "CREATE INDEX dependency_by_need ON dependency (needs, job);"

    INPUTS COPIES INSTANCE
    "CREATE TABLE event ("
    "  seq INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  at_ms INTEGER NOT NULL,"
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  type TEXT NOT NULL CHECK (type IN ('state', 'task', 'started', 'ended', 'edited')),"
    "  state TEXT NOT NULL,"
    "  outcome TEXT,"
    "  frame INTEGER,"
    "  attempt INTEGER"
    ") STRICT;"
    "CREATE INDEX event_by_job ON event (job, seq);"
    REMOVED_EVENTS
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
    "  due_ms INTEGER NOT NULL"
    ") STRICT;"
    "CREATE INDEX outbox_by_time ON outbox (due_ms, number);"
    "CREATE INDEX outbox_by_job ON outbox (job);";

static const char set_version[] = "PRAGMA user_version = " TEXT(SCHEMA_VERSION);

/* From version 1, in which a job was its only task and had the attempts itself. */
static const char set_old_aside[] =
    "DROP INDEX job_waiting; DROP INDEX job_by_state;"
    "ALTER TABLE attempt RENAME TO attempt_1; ALTER TABLE job RENAME TO job_1;";

static const char carry_over[] =
    "INSERT INTO job (seq, id, owner, state, outcome, priority, threads, memory_mb, max_attempts, tasks, "
    "ready,"
    "  running, succeeded, failed, cancelled, timed_out, not_converged, is_cancelled, attempts, created_ms,"
    "  started_ms, finished_ms, name, labels, error_code, error_message)"
    " SELECT seq, id, '', state, outcome, priority, 1, 0, max_attempts, 1, state = 'queued',"
    "  state IN ('running', 'cancelling'), state = 'succeeded', state = 'failed', state = 'cancelled',"
    "  state = 'timed_out', coalesce(outcome = 'not_converged', 0), state IN ('cancelling', 'cancelled'), "
    "attempt,"
    "  created_ms, started_ms, finished_ms, name, labels, error_code, error_message FROM job_1;"
    "INSERT INTO spec (job, spec) SELECT seq, spec FROM job_1;"
    "INSERT INTO task (job, number, state, outcome, attempt, spent, started_ms, finished_ms, error_code,"
    "  error_message)"
    " SELECT seq, 0, CASE state WHEN 'cancelling' THEN 'running' ELSE state END, outcome, attempt, spent,"
    "  started_ms, finished_ms, error_code, error_message FROM job_1;"
    "INSERT INTO attempt (job, task, number, started_ms, finished_ms, exit_status, signal, "
    "peak_memory_bytes, reason)"
    " SELECT job, 0, number, started_ms, finished_ms, exit_status, signal, peak_memory_bytes, reason FROM "
    "attempt_1;"
    "INSERT INTO owner SELECT '', count(*), sum(state != 'queued') FROM job_1"
    "  WHERE state NOT IN (" SCHEMA_FINAL_STATES ") HAVING count(*) > 0;"
    "INSERT INTO label SELECT DISTINCT value, seq FROM job_1, json_each(labels);"
    "INSERT INTO event (at_ms, job, type, state, outcome)"
    " SELECT coalesce(finished_ms, started_ms, created_ms), seq, 'state', state, outcome FROM job_1 ORDER BY "
    "1;"
    "DROP TABLE attempt_1; DROP TABLE job_1;";

/* From version 2, in which no path of a spec was mapped. */
static const char add_paths[] = "ALTER TABLE spec ADD COLUMN paths TEXT";

/* From version 3, in which each attempt had all the time of its job and files that were sent stayed for ever.
 * What the specs read of those is written down, as it is for new jobs. */
static const char add_times_and_inputs[] =
    "ALTER TABLE task ADD COLUMN ran_ms INTEGER NOT NULL DEFAULT 0;" INPUTS
    "INSERT OR IGNORE INTO input (name, job) SELECT substr(value, 1, 71), spec.job FROM spec, json_tree(spec)"
    "  WHERE json_tree.key = 'path' AND value GLOB 'sha256:*';";

/* From version 4, which did not say whether events were removed. Numbers are given without gaps: the last one that is
 * missing was removed. */
static const char add_removed_events[] =
    REMOVED_EVENTS
    "INSERT INTO removed_events SELECT 1, CASE WHEN given > kept THEN given ELSE"
    "  coalesce((SELECT seq - 1 FROM event AS first WHERE NOT EXISTS"
    "    (SELECT 1 FROM event WHERE seq = first.seq - 1) ORDER BY seq DESC LIMIT 1), 0) END"
    "  FROM (SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name = 'event'), 0) AS given,"
    "    coalesce((SELECT max(seq) FROM event), 0) AS kept);";

/* From version 4, in which a full disk failed jobs for good and copies left temporary files behind. */
static const char add_storage[] =
    "ALTER TABLE task ADD COLUMN storage_faults INTEGER NOT NULL DEFAULT 0;" COPIES;

/* From version 4, in which deaths of the daemon counted as attempts, and a start removed every directory without a job.
 * The database is some instance's, which has not told its name yet. */
static const char add_instance[] = INSTANCE "ALTER TABLE task ADD COLUMN interrupted INTEGER NOT NULL DEFAULT 0;";
static const char leave_unnamed[] = "INSERT INTO instance (id, boot_id) VALUES ('', '')";

static bool run(sqlite3 *database, const char *sql, error *e)
{
    if (sqlite3_exec(database, sql, NULL, NULL, NULL) == SQLITE_OK) return true;
    return error_set(e, ERROR_INTERNAL, "the queue's database: %s", sqlite3_errmsg(database));
}

static bool read_version(sqlite3 *database, int *version, error *e)
{
    sqlite3_stmt *statement = NULL;
    bool ok =
        sqlite3_prepare_v2(database, "PRAGMA user_version", -1, &statement, NULL) == SQLITE_OK &&
        sqlite3_step(statement) == SQLITE_ROW;
    if (ok)
        *version = sqlite3_column_int(statement, 0);
    else
        error_set(e, ERROR_INTERNAL, "the queue's database: %s", sqlite3_errmsg(database));
    sqlite3_finalize(statement);
    return ok;
}

static bool make_tables(sqlite3 *database, int version, error *e)
{
    bool ok = run(database, "BEGIN IMMEDIATE", e);
    if (ok && version == 1) ok = run(database, set_old_aside, e);
    if (ok && version < 2) ok = run(database, tables, e);
    if (ok && version == 1) ok = run(database, carry_over, e);
    if (ok && version == 2) ok = run(database, add_paths, e);
    if (ok && (version == 2 || version == 3)) ok = run(database, add_times_and_inputs, e);
    if (ok && version >= 2) ok = run(database, add_removed_events, e);
    if (ok && version >= 2) ok = run(database, add_storage, e);
    if (ok && version >= 2) ok = run(database, add_instance, e);
    if (ok && version >= 1) ok = run(database, leave_unnamed, e);
    ok = ok && run(database, set_version, e) && run(database, "COMMIT", e);
    if (!ok) run(database, "ROLLBACK", NULL);
    return ok;
}

bool schema_prepare(sqlite3 *database, error *e)
{
    int version = 0;
    if (!run(database,
             "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
             "PRAGMA foreign_keys = ON; PRAGMA temp_store = MEMORY;",
             e) ||
        !read_version(database, &version, e))
        return false;
    if (version > SCHEMA_VERSION)
        return error_set(
            e, ERROR_INTERNAL,
            "the queue's database has version %d and this hexad knows %d: a newer hexad"
            " made it, run that one or take another state_dir",
            version, SCHEMA_VERSION);
    return version == SCHEMA_VERSION || make_tables(database, version, e);
}
