// SPDX-License-Identifier: Apache-2.0
#include "service/database/database.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/database/backup_directory.h"
#include "service/database/filesystem.h"
#include "service/database/header.h"
#include "service/database/health.h"
#include "service/database/lock.h"
#include "service/database/place.h"
#include "service/database/reserve.h"
#include "service/database/schema.h"

/* At a start, wait this long for another program (sqlite3) that reads the database. */
#define OPEN_PATIENCE_MS 5000
/* More than the number of statements in the program. */
#define STATEMENTS 256

/* The memory that a reader keeps for pages, in KiB (negative: SQLite's unit). The kernel keeps the pages,
 * too. */
#define READER_CACHE "-256"
/* Readers that are opened at the start. More are opened when all of them are in use, and then kept. */
#define READERS_AT_START 8
/* Maximum time, in ms, until opening a reader is tried again. If no reader exists, none can be returned and
 * end the wait. */
#define READER_RETRY_MS 250

/* The log is checkpointed from this number of pages (of 4 KiB), SQLite's default. Larger: fewer checkpoints,
 * and a longer recovery after a crash. */
#define LOG_PAGES 1000
/* Remaining pages that are checkpointed while no change is stored; this takes two flushes. */
#define LOG_REST 100
/* From this number of pages a change waits until readers leave the log, at most LOG_PATIENCE_MS: otherwise a
 * log with permanent readers would grow without limit. If that fails, as during a backup, the next attempt is
 * at twice the length. */
#define LOG_MOST 4000
#define LOG_PATIENCE_MS 200
/* SQLite's files are exclusive to this process: other programs are excluded, and the index of the log is in
 * memory, so that a full disk does not block it (https://www.sqlite.org/vfs.html#standard_unix_vfses). */
#define OWN_VFS "unix-excl"

typedef STAILQ_HEAD(change_list, change) change_list;

struct database {
    sqlite3 *connection;
    struct {
        const char *sql;
        sqlite3_stmt *prepared;
    } statement[STATEMENTS];
    health *health;   /* in a reader: the health of its origin */
    database *origin; /* in a reader, which has only the members up to here: its database; otherwise NULL */
    SLIST_ENTRY(database) link; /* of idle readers */

    int lock_fd; /* holds the lock on the state directory; -1: a copy, which has no lock */
    /* for flushes; -1: a copy. Closed after all connections, because closing it ends the locks of the process
     * on the file */
    int file_fd;
    char *state_dir, *path;
    place *place;                      /* of the state directory; NULL: a copy, or it is not yet open */
    atomic_uint copies;                /* number of copies begun; used for their names */
    atomic_int_fast64_t reserve_bytes; /* 0: none */

    pthread_mutex_t reading; /* guards `idle` */
    pthread_cond_t returned;
    SLIST_HEAD(, database) idle; /* readers */

    pthread_mutex_t mutex; /* guards the connection that writes, and `trouble` */
    char *trouble;         /* why the last change could not be stored; NULL: it could */
    void (*call)(void *context);
    void *call_context;

    pthread_t log_thread;
    pthread_cond_t log_is_long; /* used with `mutex`, which guards the following members */
    database *log_reader;       /* the thread's connection; NULL: there is no thread */
    /* length of the log after the last change, and length at which it is checkpointed */
    int log_pages, log_limit;
    int log_most;   /* see LOG_MOST */
    bool log_stays; /* a flush of the database failed: only the log is known to have the changes */
    bool closing;

    pthread_mutex_t gate; /* guards the waiting changes; never held together with `mutex` */
    pthread_cond_t committed;
    change_list waiting;
    uint64_t turn; /* of the last change with a user that was applied */
    uint64_t arrivals;
    bool leading;
    int nice; /* nice value of the thread that opened the database */
    pthread_t commit_thread;
    pthread_cond_t entrusted;
    bool commits, ending; /* the thread exists; it has to end */
    unsigned slow; /* number of waiting threads of a lower priority: the thread commits their changes */

    runner_task **woken; /* tasks that database_signal wakes */
    size_t woken_count;
};

sqlite3 *database_connection(database *d)
{
    return d->connection;
}

health *database_health(database *d)
{
    return d->health;
}

const char *database_directory(database *d)
{
    return d->state_dir;
}

bool database_has_place(database *d, error *e)
{
    return place_check(d->place, e);
}

uint64_t database_change_count(database *d)
{
    pthread_mutex_lock(&d->mutex);
    int64_t count = sqlite3_total_changes64(d->connection);
    pthread_mutex_unlock(&d->mutex);
    return (uint64_t)count;
}

char *database_copy_path(database *d)
{
    char *directory = backup_directory_path(d->state_dir);
    char *path = mem_printf("%s/%u.db", directory, atomic_fetch_add(&d->copies, 1));
    free(directory);
    return path;
}

/* ---- statements */

/* Whether the last call failed because the disk is full. SQLite reports an exhausted quota as an I/O
 * error. */
static bool is_full(database *d)
{
    int why = sqlite3_errcode(d->connection) & 0xff;
    return why == SQLITE_FULL || (why == SQLITE_IOERR && sqlite3_system_errno(d->connection) == EDQUOT);
}

/* The last error of the kernel on the database or its log; 0: none. */
static int last_system_error(database *d)
{
    sqlite3_file *log = NULL;
    int of_database = 0, of_log = 0;
    sqlite3_file_control(d->connection, "main", SQLITE_FCNTL_LAST_ERRNO, &of_database);
    sqlite3_file_control(d->connection, "main", SQLITE_FCNTL_JOURNAL_POINTER, &log);
    if (log && log->pMethods) log->pMethods->xFileControl(log, SQLITE_FCNTL_LAST_ERRNO, &of_log);
    return of_log ? of_log : of_database;
}

/* Whether a file could not be read. A statement that meets EIO ends with SQLITE_CORRUPT, like one that
 * meets damage. */
static bool is_read_fault(database *d, int code)
{
    return schema_error_is_read_fault(code) || (code == SQLITE_CORRUPT && last_system_error(d) == EIO);
}

/* Sets the error of the last SQLite call. Damage is recorded in the health, which stops all writing. */
static bool fail(database *d, error *e)
{
    int code = sqlite3_extended_errcode(d->connection);
    bool unread = is_read_fault(d, code);
    const char *why = code == SQLITE_CORRUPT && unread ? strerror(EIO) : sqlite3_errmsg(d->connection);
    if (!schema_error_is_damage(code) && !unread)
        return error_set(e, is_full(d) ? ERROR_STORAGE_FULL : ERROR_INTERNAL, "the queue's database: %s",
                         why);
    health_note_damage(d->health, "statement", why, unread);
    return health_allows_changes(d->health, e) &&
           error_set(e, ERROR_INTERNAL, "the queue's database: %s", why);
}

static sqlite3_stmt *find_statement(database *d, const char *sql, error *e)
{
    size_t i = 0;
    while (d->statement[i].sql && d->statement[i].sql != sql) i++;
    if (d->statement[i].sql) return d->statement[i].prepared;
    sqlite3_stmt *s = NULL;
    if (i + 1 == STATEMENTS ||
        sqlite3_prepare_v3(d->connection, sql, -1, SQLITE_PREPARE_PERSISTENT, &s, NULL) != SQLITE_OK) {
        fail(d, e);
        return NULL;
    }
    d->statement[i].sql = sql;
    d->statement[i].prepared = s;
    return s;
}

sqlite3_stmt *database_ask(database *d, const char *sql, const value *values, size_t count, error *e)
{
    sqlite3_stmt *s = find_statement(d, sql, e);
    for (size_t i = 0; s && i < count; i++) {
        int at = (int)i + 1;
        if (values[i].type == VALUE_INTEGER)
            sqlite3_bind_int64(s, at, values[i].number);
        else if (values[i].type == VALUE_REAL)
            sqlite3_bind_double(s, at, values[i].real);
        else
            sqlite3_bind_text(s, at, values[i].text, -1, SQLITE_STATIC); /* NULL binds NULL */
    }
    return s;
}

void database_end(sqlite3_stmt *s)
{
    sqlite3_reset(s);
    sqlite3_clear_bindings(s);
}

bool database_next(database *d, sqlite3_stmt *s, bool *ok, error *e)
{
    int status = s ? sqlite3_step(s) : SQLITE_ERROR;
    if (status == SQLITE_ROW) return true;
    *ok = status == SQLITE_DONE || (s && fail(d, e)); /* without a statement the error is set already */
    if (s) database_end(s);
    return false;
}

bool database_read_integer(database *d, sqlite3_stmt *s, int64_t *number, error *e)
{
    bool ok = false;
    *number = 0;
    while (database_next(d, s, &ok, e)) *number = sqlite3_column_int64(s, 0);
    return ok;
}

bool database_run(database *d, const char *sql, const value *values, size_t count, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = database_ask(d, sql, values, count, e);
    while (database_next(d, s, &ok, e)) continue;
    return ok;
}

int database_changes(database *d)
{
    return sqlite3_changes(d->connection);
}

int64_t database_last_row(database *d)
{
    return sqlite3_last_insert_rowid(d->connection);
}

char *database_text(sqlite3_stmt *s, int column)
{
    const char *found = (const char *)sqlite3_column_text(s, column);
    return found ? mem_strdup(found) : NULL;
}

/* ---- changes */

/* Logs the first failed change, and the first successful one after it. */
static void note_stored(database *d)
{
    if (!d->trouble) return;
    log_write(LOG_LEVEL_INFO, "the queue stores changes again");
    free(d->trouble);
    d->trouble = NULL;
}

static void note_trouble(database *d, const char *why)
{
    if (d->trouble && strcmp(d->trouble, why) == 0) return;
    log_write(LOG_LEVEL_ERROR, "the queue cannot store changes: %s", why);
    free(d->trouble);
    d->trouble = mem_strdup(why);
}

static bool plain(database *d, const char *sql, error *e)
{
    return database_run(d, sql, NULL, 0, e);
}

/* Applies one change; a failed one is rolled back. False when the whole transaction was rolled back. */
static bool apply_one(database *d, change *c)
{
    c->ok = plain(d, "SAVEPOINT one", &c->fault) && c->apply(d, c);
    if (c->ok) c->ok = plain(d, "RELEASE one", &c->fault);
    if (c->ok) return true;
    note_trouble(d, c->fault.message);
    return !sqlite3_get_autocommit(d->connection) && plain(d, "ROLLBACK TO one", NULL) &&
           plain(d, "RELEASE one", NULL);
}

static void refuse_all(const change_list *all, const error *why)
{
    change *c;
    STAILQ_FOREACH (c, all, link) {
        if (c->ok || c->fault.code == ERROR_NONE) c->fault = *why;
        c->ok = false;
    }
}

/* Applies all changes of the list in one transaction. Returns whether tasks have to be woken. */
static bool apply_all(database *d, const change_list *all)
{
    error e = {0};
    if (!database_has_place(d, &e)) {
        refuse_all(all, &e);
        return false;
    }
    bool any = false, wakes = false;
    int before = sqlite3_total_changes(d->connection);
    bool ok = plain(d, "BEGIN IMMEDIATE", &e);
    for (change *c = STAILQ_FIRST(all); ok && c; c = STAILQ_NEXT(c, link)) {
        ok = apply_one(d, c);
        if (!ok) e = c->fault;
        any |= c->ok;
        wakes |= c->ok && !c->wakes_none;
    }
    if (ok) ok = plain(d, "COMMIT", &e);
    if (ok) {
        if (d->call) d->call(d->call_context);
        bool different = sqlite3_total_changes(d->connection) != before;
        if (any && different) note_stored(d);
        return different && wakes;
    }
    note_trouble(d, e.message);
    if (!sqlite3_get_autocommit(d->connection)) plain(d, "ROLLBACK", NULL);
    refuse_all(all, &e);
    return false;
}

/* Sets the turn of a change with a user: after the turns of the same user's waiting changes (fair queueing). */
static void set_turn(database *d, change *c)
{
    const change *other;
    c->turn = d->turn;
    if (!c->arrival) c->arrival = ++d->arrivals;
    STAILQ_FOREACH (other, &d->waiting, link)
        if (other->user && strcmp(other->user, c->user) == 0 && other->turn > c->turn) c->turn = other->turn;
    c->turn++;
}

/* Returns the first change of the user whose turn it is; NULL: there is none. */
static change *choose_first(database *d)
{
    change *c, *turn = NULL, *first;
    STAILQ_FOREACH (c, &d->waiting, link)
        if (c->user && (!turn || c->turn < turn->turn)) turn = c;
    if (!turn) return NULL;
    first = turn;
    STAILQ_FOREACH (c, &d->waiting, link)
        if (c->user && strcmp(c->user, turn->user) == 0 && c->arrival < first->arrival) first = c;
    d->turn = turn->turn;
    turn->turn = first->turn;
    first->turn = d->turn;
    return first;
}

/* Moves the changes of the next transaction to `all`: those without a user, and one with a user. */
static void take_changes(database *d, change_list *all)
{
    change *c, *next, *first = choose_first(d);
    for (c = STAILQ_FIRST(&d->waiting); c; c = next) {
        next = STAILQ_NEXT(c, link);
        if (c->user && c != first) continue;
        STAILQ_REMOVE(&d->waiting, c, change, link);
        STAILQ_INSERT_TAIL(all, c, link);
    }
}

/* Commits waiting changes. The caller holds the gate, which is released during the commit. */
static void lead(database *d)
{
    d->leading = true;
    change_list all = STAILQ_HEAD_INITIALIZER(all);
    take_changes(d, &all);
    pthread_mutex_unlock(&d->gate);
    pthread_mutex_lock(&d->mutex);
    bool wakes = apply_all(d, &all);
    pthread_mutex_unlock(&d->mutex);
    if (wakes) database_signal(d);
    pthread_mutex_lock(&d->gate);
    for (change *c = STAILQ_FIRST(&all), *next; c; c = next) {
        next = STAILQ_NEXT(c, link);
        c->done = true; /* from here its thread may have returned, and the change may be gone */
    }
    d->leading = false;
    pthread_cond_broadcast(&d->committed);
    if (!STAILQ_EMPTY(&d->waiting) && d->slow) pthread_cond_signal(&d->entrusted);
}

/* Commits for threads of a lower priority than the process: such a thread may wait long for a CPU, and all
 * changes would wait with it. */
static void *commit_entrusted(void *argument)
{
    database *d = argument;
    pthread_mutex_lock(&d->gate);
    while (!d->ending) {
        if (!STAILQ_EMPTY(&d->waiting) && !d->leading)
            lead(d);
        else
            pthread_cond_wait(&d->entrusted, &d->gate);
    }
    pthread_mutex_unlock(&d->gate);
    return NULL;
}

static bool start_commit_thread(database *d, error *e)
{
    d->nice = getpriority(PRIO_PROCESS, 0); /* of this thread (Linux) */
    d->commits = background_start(&d->commit_thread, commit_entrusted, d, "the database", e);
    return d->commits;
}

static void stop_commit_thread(database *d)
{
    if (!d->commits) return;
    pthread_mutex_lock(&d->gate);
    d->ending = true;
    pthread_cond_signal(&d->entrusted);
    pthread_mutex_unlock(&d->gate);
    pthread_join(d->commit_thread, NULL);
}

bool database_change(database *d, change *c, error *e)
{
    c->done = c->ok = false;
    c->fault = (error){0};
    if (!health_allows_changes(d->health, e)) return false;
    const bool slow = d->commits && getpriority(PRIO_PROCESS, 0) > d->nice;
    pthread_mutex_lock(&d->gate);
    if (c->user) set_turn(d, c);
    STAILQ_INSERT_TAIL(&d->waiting, c, link);
    d->slow += slow;
    if (slow) pthread_cond_signal(&d->entrusted);
    while (!c->done) {
        if (slow || d->leading)
            pthread_cond_wait(&d->committed, &d->gate);
        else
            lead(d);
    }
    d->slow -= slow;
    pthread_mutex_unlock(&d->gate);
    if (!c->ok && e) *e = c->fault;
    return c->ok;
}

void database_on_commit(database *d, void (*call)(void *context), void *context)
{
    d->call = call;
    d->call_context = context;
}

/* ---- reading */

static void close_connection(database *d)
{
    /* SQLite would remove the log by its path, which may be that of another service */
    if (!database_has_place(d->origin ? d->origin : d, NULL))
        sqlite3_db_config(d->connection, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, NULL);
    for (size_t i = 0; d->statement[i].sql; i++) sqlite3_finalize(d->statement[i].prepared);
    sqlite3_close(d->connection);
}

/* NULL if descriptors or memory are exhausted. */
static database *open_reader(database *d, error *e)
{
    database *r = mem_alloc(sizeof *r);
    r->origin = d;
    r->health = d->health;
    const char *vfs = d->lock_fd >= 0 ? OWN_VFS : NULL;
    const bool ok =
        sqlite3_open_v2(d->path, &r->connection, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, vfs) ==
            SQLITE_OK &&
        sqlite3_exec(r->connection,
                     "PRAGMA query_only = ON; PRAGMA temp_store = MEMORY; PRAGMA cache_size = " READER_CACHE
                     "; SELECT 1 FROM sqlite_schema" /* opens the log */,
                     NULL, NULL, NULL) == SQLITE_OK;
    if (ok && database_has_place(d, e)) return r; /* otherwise it may be another database */
    if (!ok)
        error_set(e, ERROR_INTERNAL, "the queue's database: %s",
                  r->connection ? sqlite3_errmsg(r->connection) : "no memory");
    close_connection(r);
    free(r);
    return NULL;
}

static bool open_readers(database *d, error *e)
{
    for (int k = 0; k < READERS_AT_START; k++) {
        database *r = open_reader(d, e);
        if (!r) return false;
        SLIST_INSERT_HEAD(&d->idle, r, link);
    }
    return true;
}

database *database_begin_read(database *d)
{
    database *r = NULL;
    pthread_mutex_lock(&d->reading);
    while (!(r = SLIST_FIRST(&d->idle)) && !(r = open_reader(d, NULL)))
        background_wait_until(&d->returned, &d->reading, clock_monotonic_ms() + READER_RETRY_MS);
    if (r == SLIST_FIRST(&d->idle)) SLIST_REMOVE_HEAD(&d->idle, link);
    pthread_mutex_unlock(&d->reading);
    plain(r, "BEGIN", NULL);
    return r;
}

void database_end_read(database *r)
{
    database *d = r->origin;
    plain(r, "COMMIT", NULL);
    if (!sqlite3_get_autocommit(r->connection)) plain(r, "ROLLBACK", NULL);
    const bool ended = sqlite3_get_autocommit(r->connection);
    if (!ended) { /* it would read an old state; another one is opened instead */
        close_connection(r);
        free(r);
    }
    pthread_mutex_lock(&d->reading);
    if (ended) SLIST_INSERT_HEAD(&d->idle, r, link);
    pthread_cond_signal(&d->returned);
    pthread_mutex_unlock(&d->reading);
}

/* ---- writing the log back */

/* SQLite calls this after each commit. */
static int note_log(void *context, sqlite3 *connection, const char *name, int pages)
{
    (void)connection, (void)name;
    database *d = context;
    if (pages < d->log_pages) { /* the log was restarted */
        d->log_limit = LOG_PAGES;
        d->log_most = LOG_MOST;
    }
    d->log_pages = pages;
    if (pages >= d->log_limit) pthread_cond_signal(&d->log_is_long);
    return SQLITE_OK;
}

/* Checkpoints pages that no reader needs, in SQLite's `mode`. Returns the number of pages of the log that are
 * checkpointed; 0: the disk is full or failed. */
static int write_back(database *d, int mode)
{
    int written = 0;
    int code = sqlite3_wal_checkpoint_v2(d->log_reader->connection, NULL, mode, NULL, &written);
    d->log_stays |= sqlite3_extended_errcode(d->log_reader->connection) == SQLITE_IOERR_FSYNC;
    return code == SQLITE_OK || code == SQLITE_BUSY ? written : 0;
}

/* Called while no change is stored: checkpoints the last pages. The next change then restarts the log if no
 * reader needs it. */
static void end_log(database *d)
{
    const bool waits = d->log_pages >= d->log_most;
    sqlite3_busy_timeout(d->log_reader->connection, waits ? LOG_PATIENCE_MS : 0);
    write_back(d, waits ? SQLITE_CHECKPOINT_RESTART : SQLITE_CHECKPOINT_PASSIVE);
    if (waits) d->log_most = 2 * d->log_pages;
    d->log_limit = d->log_pages + LOG_REST; /* unless it is restarted */
}

/* Checkpoints the log while changes are stored, until little is left or it is too long; then the rest. After
 * a failed flush the kernel considers the pages written: the log is kept then, and the next start
 * checkpoints all of it. */
static void *keep_log_short(void *argument)
{
    database *d = argument;
    int written = 0;
    pthread_mutex_lock(&d->mutex);
    while (!d->closing && !d->log_stays) {
        if (d->log_pages < d->log_limit) {
            pthread_cond_wait(&d->log_is_long, &d->mutex);
            continue;
        }
        int before = written;
        pthread_mutex_unlock(&d->mutex);
        written = write_back(d, SQLITE_CHECKPOINT_PASSIVE);
        /* SQLite does not flush if changes were stored meanwhile; the end would then take long */
        bool flushed = fdatasync(d->file_fd) == 0;
        pthread_mutex_lock(&d->mutex);
        d->log_stays |= !flushed;
        if (d->log_stays) {
            log_write(LOG_LEVEL_ERROR,
                      "the disk of the queue failed: the write-ahead log is kept until the next start");
        } else if (d->log_pages - written <= LOG_REST || d->log_pages >= d->log_most) {
            end_log(d);
            written = 0;
        } else if (written <= before) { /* a reader needs the rest, or the disk is full */
            d->log_limit = d->log_pages + LOG_REST;
        }
    }
    pthread_mutex_unlock(&d->mutex);
    return NULL;
}

static bool start_log_thread(database *d, error *e)
{
    d->log_limit = LOG_PAGES;
    d->log_most = LOG_MOST;
    d->log_reader = open_reader(d, e);
    if (!d->log_reader) return false;
    if (background_start(&d->log_thread, keep_log_short, d, "the database", e)) {
        sqlite3_wal_hook(d->connection, note_log, d);
        return true;
    }
    close_connection(d->log_reader);
    free(d->log_reader);
    d->log_reader = NULL;
    return false;
}

static void stop_log_thread(database *d)
{
    if (!d->log_reader) return;
    pthread_mutex_lock(&d->mutex);
    d->closing = true;
    pthread_cond_signal(&d->log_is_long);
    pthread_mutex_unlock(&d->mutex);
    pthread_join(d->log_thread, NULL);
    close_connection(d->log_reader);
    free(d->log_reader);
}

/* ---- waiting for changes */

void database_signal(database *d)
{
    for (size_t i = 0; i < d->woken_count; i++) runner_wake(d->woken[i]);
}

void database_wake_on_change(database *d, runner_task *t)
{
    d->woken = mem_resize(d->woken, (d->woken_count + 1) * sizeof(runner_task *));
    d->woken[d->woken_count++] = t;
}

void database_wake_no_more(database *d, const runner_task *t)
{
    size_t kept = 0;
    for (size_t i = 0; i < d->woken_count; i++)
        if (d->woken[i] != t) d->woken[kept++] = d->woken[i];
    d->woken_count = kept;
}

/* ---- opening */

/* Creates the directory of copies and removes the files that a killed process left there. */
static bool clear_copies(const char *state_dir, error *e)
{
    if (!backup_directory_make(state_dir, e)) return false;
    char *path = backup_directory_path(state_dir);
    DIR *listing = opendir(path);
    bool ok = listing || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    for (struct dirent *entry; listing && (entry = readdir(listing));)
        if (entry->d_name[0] != '.') unlinkat(dirfd(listing), entry->d_name, 0);
    if (listing) closedir(listing);
    free(path);
    return ok;
}

static void make_locks(database *d)
{
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&d->reading, NULL);
    pthread_cond_init(&d->returned, &monotonic);
    pthread_mutex_init(&d->mutex, NULL);
    pthread_cond_init(&d->log_is_long, NULL);
    pthread_mutex_init(&d->gate, NULL);
    pthread_cond_init(&d->committed, NULL);
    pthread_cond_init(&d->entrusted, NULL);
    pthread_condattr_destroy(&monotonic);
    STAILQ_INIT(&d->waiting);
}

static bool open_for_flushes(database *d, error *e)
{
    d->file_fd = open(d->path, O_RDWR | O_CLOEXEC);
    return d->file_fd >= 0 || error_set(e, ERROR_INTERNAL, "%s", strerror(errno));
}

/* Opens the database of a state directory, or a copy that no other process uses. */
static database *open_file(const char *state_dir, int lock_fd, const char *path, error *e)
{
    database *d = mem_alloc(sizeof *d);
    make_locks(d);
    /* SQLite's count of its memory has one mutex for all connections. Has no effect after the first
     * database. */
    sqlite3_config(SQLITE_CONFIG_MEMSTATUS, 0);
    d->lock_fd = lock_fd;
    d->file_fd = -1;
    d->state_dir = mem_strdup(state_dir);
    d->path = mem_strdup(path);
    d->health = health_new();
    bool ok = true;
    if (sqlite3_open_v2(path, &d->connection,
                        SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX,
                        lock_fd >= 0 ? OWN_VFS : NULL) != SQLITE_OK)
        ok = d->connection ? fail(d, e) : error_set(e, ERROR_INTERNAL, "the queue's database: no memory");
    /* for other programs; later for a reader that restores the index of the log */
    if (ok) sqlite3_busy_timeout(d->connection, OPEN_PATIENCE_MS);
    ok = ok && schema_prepare(d->connection, e);
    if (ok && lock_fd >= 0) ok = open_for_flushes(d, e);
    if (ok && open_readers(d, e) &&
        (lock_fd < 0 ||
         ((d->place = place_note(state_dir, e)) && start_log_thread(d, e) && start_commit_thread(d, e))))
        return d;
    error_prefix(e, "%s", path);
    d->lock_fd = -1; /* the caller closes it */
    database_close(d);
    return NULL;
}

database *database_open(const char *state_dir, error *e)
{
    char *path = mem_printf("%s/" DATABASE_FILE_NAME, state_dir);
    int lock_fd = filesystem_check(state_dir, e) ? lock_take(state_dir, NULL, e) : -1;
    database *d = NULL;
    if (lock_fd < 0 || !header_check(path, e) || !clear_copies(state_dir, e))
        error_prefix(e, "%s", path);
    else {
        reserve_lend(state_dir);
        d = open_file(state_dir, lock_fd, path, e);
    }
    if (!d && lock_fd >= 0) close(lock_fd);
    free(path);
    return d;
}

void database_reserve(database *d, int64_t bytes)
{
    atomic_store(&d->reserve_bytes, bytes);
    pthread_mutex_lock(&d->mutex);
    reserve_keep(d->state_dir, bytes);
    pthread_mutex_unlock(&d->mutex);
}

bool database_has_space(database *d)
{
    int64_t wanted = atomic_load(&d->reserve_bytes);
    struct statvfs disk;
    if (wanted <= 0 || fstatvfs(d->lock_fd, &disk) != 0 || !disk.f_blocks)
        return true; /* a failure shows in the transaction */
    return (int64_t)(disk.f_bavail * disk.f_frsize) >= wanted;
}

database *database_open_copy(const char *path, error *e)
{
    return open_file("", -1, path, e);
}

void database_close(database *d)
{
    if (!d) return;
    stop_commit_thread(d);
    stop_log_thread(d);
    for (database *r; (r = SLIST_FIRST(&d->idle));) {
        SLIST_REMOVE_HEAD(&d->idle, link);
        close_connection(r);
        free(r);
    }
    close_connection(d);
    if (d->file_fd >= 0) close(d->file_fd);
    if (d->lock_fd >= 0) close(d->lock_fd);
    place_free(d->place);
    health_free(d->health);
    pthread_mutex_destroy(&d->reading);
    pthread_cond_destroy(&d->returned);
    pthread_mutex_destroy(&d->mutex);
    pthread_cond_destroy(&d->log_is_long);
    pthread_mutex_destroy(&d->gate);
    pthread_cond_destroy(&d->committed);
    pthread_cond_destroy(&d->entrusted);
    free(d->woken);
    free(d->trouble);
    free(d->state_dir);
    free(d->path);
    free(d);
}
