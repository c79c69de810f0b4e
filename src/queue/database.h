/* database: the queue's connection to SQLite, and transactions that threads share.
 *
 * Private to src/queue. Who reads holds the connection between database_lock and database_unlock.
 * Who changes something hands in a `change`: one thread of those that wait takes all changes that
 * have come, applies each in turn within one transaction, and commits; then all of them return. So a
 * flush to disk is paid once for all of them, and readers never see a change that may yet be lost. A change
 * that fails is taken back alone (a savepoint); when the commit fails, all have failed.
 */
#ifndef HEXAD_QUEUE_DATABASE_H
#define HEXAD_QUEUE_DATABASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <sqlite3.h>

#include "base/error.h"

typedef struct queue database; /* the queue is its connection and nothing else */

void database_lock(database *d);
void database_unlock(database *d);

typedef struct change change;
struct change {
    /* Runs inside the transaction; may run in another thread. Outputs go into what surrounds the change. */
    bool (*apply)(database *d, change *c);
    error fault;
    bool done, ok;
    change *next;
};

/* Returns once the change is on disk, or failed: then *e says why. */
bool database_change(database *d, change *c, error *e);

/* One value of a statement's parameters. */
typedef struct value {
    const char *text; /* NULL with !integer: binds NULL; lives until the statement is over */
    int64_t number;
    bool integer;
} value;

static inline value text(const char *t)
{
    return (value){.text = t};
}

static inline value integer(int64_t n)
{
    return (value){.number = n, .integer = true};
}

/* NULL unless it is known. */
static inline value integer_if(int64_t n, bool known)
{
    return (value){.number = n, .integer = known};
}

/* Statements are string constants of the program: each is prepared once, known by its address. */
sqlite3_stmt *database_ask(database *d, const char *sql, const value *values, size_t count, error *e);
bool database_run(database *d, const char *sql, const value *values, size_t count, error *e);

#define VALUES(...) (const value[]){__VA_ARGS__}, sizeof((const value[]){__VA_ARGS__}) / sizeof(value)
/* A statement that gives rows, to be read by database_next; NULL on failure. */
#define ASK(d, e, sql, ...) database_ask(d, sql, VALUES(__VA_ARGS__), e)
/* A statement that gives none. */
#define RUN(d, e, sql, ...) database_run(d, sql, VALUES(__VA_ARGS__), e)

/* True: there is a row. False: *ok says whether that was the end of them; the statement is over. */
bool database_next(database *d, sqlite3_stmt *s, bool *ok, error *e);
/* Ends a statement whose other rows are not wanted. */
void database_end(sqlite3_stmt *s);

/* Whether the disk has as much room for another job as is set aside for the queue (queue_reserve). */
bool database_has_room(database *d);

int database_changes(database *d); /* rows that the last RUN changed */
int64_t database_last_row(database *d);

char *database_text(sqlite3_stmt *s, int column); /* to be freed; NULL for NULL */

/* What claims remember between them: the job that did not fit and how often it was passed by. Under the
 * lock. */
typedef struct overtaken {
    int64_t seq;
    int times;
} overtaken;
overtaken *database_overtaken(database *d);

/* ---- for copies and checks (queue/backup, queue/checker) */

struct health;
sqlite3 *database_connection(database *d); /* to be used under the lock */
struct health *database_health(database *d);
const char *database_directory(database *d); /* the state directory */
uint64_t database_change_count(database *d); /* rows that were changed since the start */
char *database_copy_path(database *d);       /* where a copy may be made; to be freed */

#endif
