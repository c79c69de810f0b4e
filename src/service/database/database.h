// SPDX-License-Identifier: Apache-2.0
/* database: the connection to SQLite, and transactions that threads share. Only src/service/database and
 * src/service/queue use SQLite.
 *
 * Any thread may call any function. To read, use the connection that database_begin_read returns. Readers
 * wait neither for each other nor for changes: SQLite's log keeps the pages that they read. To write, pass a
 * `change` to database_change. One of the waiting threads applies all changes that have arrived, one after
 * another in a single transaction, and commits. Then all of these threads return. They share one flush to
 * disk, and readers never see a change that could still be lost. Each change has a savepoint: a failed change
 * is rolled back alone. If the commit fails, all changes of the transaction fail. A change of many rows names a
 * user: a transaction has at most one of these, and the users take turns. So the time of a transaction is
 * bounded, whatever a user has stored. A thread with a higher nice
 * value than the one that opened the database never commits: a thread of the database does. Another thread
 * checkpoints the log, so that a change waits for the flush of the log only.
 */
#ifndef HEXAD_SERVICE_DATABASE_DATABASE_H
#define HEXAD_SERVICE_DATABASE_DATABASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/queue.h>

#include <sqlite3.h>

#include "base/core/error.h"
#include "base/core/runner.h"

typedef struct database database;

/* Opens or creates the database in an existing directory, which is locked until database_close. Fails if
 * another process has locked the directory, if it is on a network file system, or if a newer version of the
 * program created the database; the message has the reason. */
database *database_open(const char *state_dir, error *e);
/* Opens a copy of a database (service/database/backup) for reading. The copy is migrated if it has an
 * older version. */
database *database_open_copy(const char *path, error *e);
void database_close(database *d); /* accepts NULL */

/* Returns a connection for the functions of statements below; it reads the state at its first statement until
 * database_end_read, with every change whose database_change has returned. A thread has at most one. If all
 * connections are in use, another one is opened; if that fails, the call waits until one is returned. */
database *database_begin_read(database *d);
void database_end_read(database *reader);

/* Sets a function that is called after each commit, before database_change returns. Call it before other
 * threads use the database. */
void database_on_commit(database *d, void (*call)(void *context), void *context);

/* Maximum number of rows of a table that a change with a user may change: a piece of a larger one. Larger: fewer
 * flushes for an array; the changes of other users wait longer. 1000 rows take about 10 ms. */
#define DATABASE_PIECE_ROWS 1000
/* Maximum number of rows of a table that another change may change; a transaction has many of these. */
#define DATABASE_FEW_ROWS 50

typedef struct change change;
struct change {
    /* Runs inside the transaction, possibly in another thread. The change is the first member of a larger
     * struct that has the outputs. */
    bool (*apply)(database *d, change *c);
    const char *user; /* takes a turn of this user, for DATABASE_PIECE_ROWS; NULL: DATABASE_FEW_ROWS */
    bool wakes_none;  /* the tasks of database_wake_on_change have nothing to do after it */
    uint64_t turn,
        arrival; /* used by the database. A change that is made again keeps its place in its user's line */
    error fault;
    bool done, ok;
    STAILQ_ENTRY(change) link;
};

/* Returns when the change is on disk, or has failed (false, *e). */
bool database_change(database *d, change *c, error *e);

/* One value of a statement's parameters. */
typedef struct value {
    enum { VALUE_TEXT, VALUE_INTEGER, VALUE_REAL } type;
    const char *text; /* NULL binds NULL; must live until the statement ends */
    int64_t number;
    double real;
} value;

static inline value text(const char *t)
{
    return (value){.text = t};
}

static inline value integer(int64_t n)
{
    return (value){.type = VALUE_INTEGER, .number = n};
}

/* Binds NULL if the number is unknown. */
static inline value integer_if(int64_t n, bool known)
{
    return known ? integer(n) : text(NULL);
}

static inline value real(double x)
{
    return (value){.type = VALUE_REAL, .real = x};
}

/* `sql` must be a string constant: a statement is prepared once and found again by the address of its
 * text. */
sqlite3_stmt *database_ask(database *d, const char *sql, const value *values, size_t count, error *e);
bool database_run(database *d, const char *sql, const value *values, size_t count, error *e);

#define VALUES(...) (const value[]){__VA_ARGS__}, sizeof((const value[]){__VA_ARGS__}) / sizeof(value)
/* A statement that returns rows, to be read with database_next. NULL on failure. */
#define ASK(d, e, sql, ...) database_ask(d, sql, VALUES(__VA_ARGS__), e)
/* A statement that returns no rows. */
#define RUN(d, e, sql, ...) database_run(d, sql, VALUES(__VA_ARGS__), e)

/* True: there is a row. False: the statement has ended; *ok is true when it returned all rows, and false
 * on failure. */
bool database_next(database *d, sqlite3_stmt *s, bool *ok, error *e);
/* Ends a statement before its last row. */
void database_end(sqlite3_stmt *s);
/* Reads the integer in the first column of a statement's only row; 0: there is no row, or it is NULL. */
bool database_read_integer(database *d, sqlite3_stmt *s, int64_t *number, error *e);

/* Whether the state directory is still at its path (service/database/place). Otherwise every change fails
 * with the code state_lost before it is applied. True for a copy. */
bool database_has_place(database *d, error *e);

/* Whether the free disk space is at least the reserve of database_reserve, which a new job requires. */
bool database_has_space(database *d);

/* Reserves disk space for changes that must succeed on a full disk (service/database/reserve). 0: none. If
 * the space cannot be reserved, a warning is logged. */
void database_reserve(database *d, int64_t bytes);

/* Stored changes and database_signal wake the task. Call it before other threads use the database. */
void database_wake_on_change(database *d, runner_task *t);
void database_signal(database *d);
/* Ends that, before the task is freed. No other thread uses the database. */
void database_wake_no_more(database *d, const runner_task *t);

int database_changes(database *d); /* rows that the last RUN changed */
int64_t database_last_row(database *d);

char *database_text(sqlite3_stmt *s, int column); /* to be freed; NULL for NULL */

/* ---- for copies and checks (service/database/backup, service/database/checker) */

struct health;
sqlite3 *database_connection(database *d);
struct health *database_health(database *d);
const char *database_directory(database *d); /* the state directory */
uint64_t database_change_count(database *d); /* number of rows changed since the start */
char *database_copy_path(database *d);       /* path for a copy; to be freed */

#endif
