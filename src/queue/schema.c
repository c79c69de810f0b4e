#include "queue/schema.h"

#include <stddef.h>

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

/* The spec stands last: a row that is listed is then read without its overflow pages. */
static const char version_1[] =
    "BEGIN IMMEDIATE;"
    "CREATE TABLE job ("
    "  seq INTEGER PRIMARY KEY AUTOINCREMENT,"
    "  id TEXT NOT NULL UNIQUE,"
    "  name TEXT,"
    "  labels TEXT NOT NULL,"
    "  state TEXT NOT NULL DEFAULT 'queued' CHECK (state IN ('queued', 'running', 'cancelling',"
    "    'succeeded', 'failed', 'cancelled', 'timed_out')),"
    "  outcome TEXT CHECK (outcome IN ('converged', 'not_converged')),"
    "  priority INTEGER NOT NULL,"
    "  created_ms INTEGER NOT NULL,"
    "  started_ms INTEGER,"
    "  finished_ms INTEGER,"
    "  attempt INTEGER NOT NULL DEFAULT 0,"
    "  spent INTEGER NOT NULL DEFAULT 0,"
    "  max_attempts INTEGER NOT NULL,"
    "  error_code TEXT,"
    "  error_message TEXT,"
    "  spec TEXT NOT NULL"
    ") STRICT;"
    "CREATE INDEX job_waiting ON job (priority DESC, seq) WHERE state = 'queued';"
    "CREATE INDEX job_by_state ON job (state, seq);"
    "CREATE TABLE attempt ("
    "  job INTEGER NOT NULL REFERENCES job (seq) ON DELETE CASCADE,"
    "  number INTEGER NOT NULL,"
    "  started_ms INTEGER NOT NULL,"
    "  finished_ms INTEGER,"
    "  exit_status INTEGER,"
    "  signal INTEGER,"
    "  peak_memory_bytes INTEGER,"
    "  reason TEXT,"
    "  PRIMARY KEY (job, number)"
    ") STRICT, WITHOUT ROWID;"
    "PRAGMA user_version = " TEXT(SCHEMA_VERSION) ";"
                                                  "COMMIT;";

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

bool schema_prepare(sqlite3 *database, error *e)
{
    int version = 0;
    if (!run(database,
             "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;",
             e) ||
        !read_version(database, &version, e))
        return false;
    if (version > SCHEMA_VERSION)
        return error_set(
            e, ERROR_INTERNAL,
            "the queue's database has version %d and this hexad knows %d: a newer hexad"
            " made it, run that one or take another state_dir",
            version, SCHEMA_VERSION);
    return version == SCHEMA_VERSION || run(database, version_1, e);
}
