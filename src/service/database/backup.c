// SPDX-License-Identifier: Apache-2.0
#include "service/database/backup.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "service/database/database.h"
#include "service/database/header.h"
#include "service/database/health.h"
#include "service/database/schema.h"

/* Pages between two tests of the stop flag. The copy is flushed at the same interval: otherwise the flush of
 * a change could wait for it. 512 pages are 2 MB, 6 ms on a disk of 350 MB/s. */
#define PAGES_A_STEP 512
/* The page cache of a check, in KiB (negative: SQLite's unit). */
#define CHECK_CACHE "-16000"
/* Instructions of SQLite's virtual machine between two tests of the stop flag. */
#define CHECK_TURNS 10000

/* Sets the error for a failed copy or check. A damaged copy means a damaged database: then the message is
 * only that of SQLite. */
static bool fail(const char *path, int code, error *e)
{
    const char *why = sqlite3_errstr(code);
    if (schema_error_is_damage(code)) return error_set(e, ERROR_DATABASE_DAMAGED, "%s", why);
    error_code kind = code == SQLITE_FULL        ? ERROR_STORAGE_FULL
                      : code == SQLITE_INTERRUPT ? ERROR_CANCELLED
                                                 : ERROR_INTERNAL;
    return error_set(e, kind, "%s: %s", path, why);
}

/* Opens a database file that no other process uses. `first` is executed before anything is read. */
static sqlite3 *open_own(const char *path, int flags, const char *first, error *e)
{
    sqlite3 *file = NULL;
    int code = sqlite3_open_v2(path, &file, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX | flags, NULL);
    if (code == SQLITE_OK) code = sqlite3_exec(file, first, NULL, NULL, NULL);
    if (code == SQLITE_OK) return file;
    fail(path, sqlite3_extended_errcode(file), e);
    sqlite3_close(file);
    return NULL;
}

static sqlite3 *open_target(const char *path, error *e)
{
    return open_own(path, SQLITE_OPEN_CREATE,
                    "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;",
                    e);
}

/* Clears the flag of a write-ahead log in the header of the copy, so that it can be read without one. */
static bool drop_log(const char *path, error *e)
{
    sqlite3 *file = open_own(
        path, 0, "PRAGMA locking_mode = EXCLUSIVE; PRAGMA synchronous = OFF; PRAGMA journal_mode = DELETE;",
        e);
    sqlite3_close(file);
    return file != NULL;
}

static bool check_room(const char *path, int64_t bytes, int64_t free_bytes, error *e)
{
    struct statvfs info;
    char *directory = mem_strdup(path);
    char *slash = strrchr(directory, '/');
    if (slash) slash[slash == directory] = '\0';
    bool ok = statvfs(slash ? directory : ".", &info) == 0 ||
              error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    int64_t available = ok ? (int64_t)info.f_bavail * (int64_t)info.f_frsize : 0;
    if (ok && available < bytes + free_bytes)
        ok = error_set(e, ERROR_STORAGE_FULL,
                       "%s: a copy of the database requires %lld MiB plus %lld MiB that remain free, and "
                       "%lld MiB are free: free some space",
                       path, (long long)(bytes >> 20) + 1, (long long)(free_bytes >> 20),
                       (long long)(available >> 20));
    free(directory);
    return ok;
}

/* Returns the result code of the last step. */
static int copy_steps(database *d, sqlite3_backup *copying, int fd)
{
    int code = SQLITE_OK;
    const atomic_bool *stop = health_stop_flag(database_health(d));
    while (code == SQLITE_OK && !atomic_load(stop)) {
        code = sqlite3_backup_step(copying, PAGES_A_STEP);
        fdatasync(fd); /* a failure does no harm: the flush only spreads the writes */
    }
    return code;
}

static int64_t database_bytes(const char *state_dir)
{
    int64_t bytes = 0;
    for (int i = 0; i < 2; i++) {
        struct stat info;
        char *path = mem_printf("%s/" DATABASE_FILE_NAME "%s", state_dir, i ? "-wal" : "");
        if (stat(path, &info) == 0) bytes += info.st_size;
        free(path);
    }
    return bytes;
}

static bool copy_online(database *d, sqlite3 *target, const char *path, int fd, error *e)
{
    database *reader = database_begin_read(d);
    sqlite3 *source = database_connection(reader);
    /* empties the page cache, so that the copy shows what is on the disk */
    sqlite3_db_release_memory(source);
    /* without a read transaction, each step would restart after a change */
    int code = sqlite3_get_autocommit(source)
                   ? SQLITE_ERROR
                   : sqlite3_exec(source, "SELECT 1 FROM sqlite_schema", NULL, NULL, NULL);
    sqlite3_backup *copying = code == SQLITE_OK ? sqlite3_backup_init(target, "main", source, "main") : NULL;
    if (copying) {
        code = copy_steps(d, copying, fd);
        sqlite3_backup_finish(copying);
    } else {
        code = sqlite3_extended_errcode(code == SQLITE_OK ? target : source);
    }
    database_end_read(reader);
    if (code == SQLITE_DONE) return true;
    if (code == SQLITE_OK) return error_set(e, ERROR_CANCELLED, "the service ends");
    if (schema_error_is_read_fault(code))
        health_note_damage(database_health(d), "copy", sqlite3_errstr(code), true);
    return fail(path, code, e);
}

static bool make_copy(database *d, const char *path, error *e)
{
    sqlite3 *target = open_target(path, e);
    int fd = target ? open(path, O_WRONLY | O_CLOEXEC) : -1;
    bool ok = target && copy_online(d, target, path, fd, e);
    sqlite3_close(target);
    if (fd >= 0) close(fd);
    ok = ok && drop_log(path, e);
    if (!ok && target) unlink(path);
    return ok;
}

int backup_open(database *d, int64_t free_bytes, int64_t *bytes, error *e)
{
    struct stat info;
    char *path = database_copy_path(d);
    bool ok = backup_make(d, path, free_bytes, e);
    int fd = ok ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (ok && (fd < 0 || fstat(fd, &info) != 0)) {
        error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
        if (fd >= 0) close(fd);
        fd = -1;
    }
    if (ok) unlink(path);
    free(path);
    if (fd >= 0) *bytes = info.st_size;
    return fd;
}

/* Opens the source so that its log is unchanged, and no log remains if there was none. */
static bool copy_idle(const char *from, sqlite3 *target, const char *path, error *e)
{
    char *log = mem_printf("%s-wal", from);
    bool has_log = access(log, F_OK) == 0;
    free(log);
    sqlite3 *source = open_own(from, 0, "PRAGMA locking_mode = EXCLUSIVE;", e);
    if (!source) return false;
    sqlite3_db_config(source, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, has_log, NULL);
    sqlite3_backup *copying = sqlite3_backup_init(target, "main", source, "main");
    int code = copying ? sqlite3_backup_step(copying, -1) : sqlite3_extended_errcode(target);
    if (copying) sqlite3_backup_finish(copying);
    sqlite3_close(source);
    return code == SQLITE_DONE || fail(path, code, e);
}

/* Whether there is a database to copy, and disk space for the copy. */
static bool check_source(const char *state_dir, const char *from, const char *path, error *e)
{
    struct stat info;
    if (stat(from, &info) != 0)
        return error_set(e, ERROR_INTERNAL, "cannot open the database %s: %s. Check state_dir.", from,
                         strerror(errno));
    if (!info.st_size) return error_set(e, ERROR_DATABASE_DAMAGED, "%s is empty: %s", from, HEALTH_WAY_OUT);
    return (header_check(from, e) || error_prefix(e, "%s", from)) &&
           check_room(path, database_bytes(state_dir), 0, e);
}

bool backup_make_idle(const char *state_dir, const char *path, error *e)
{
    char *from = mem_printf("%s/" DATABASE_FILE_NAME, state_dir);
    error why = {0};
    bool ok = check_source(state_dir, from, path, e);
    sqlite3 *target = ok ? open_target(path, &why) : NULL;
    if (ok) {
        ok = target && copy_idle(from, target, path, &why);
        sqlite3_close(target);
        ok = ok && drop_log(path, &why);
        if (!ok && target) unlink(path);
    }
    if (why.code == ERROR_DATABASE_DAMAGED)
        error_set(e, why.code, "%s: the database is damaged (%s): %s", from, why.message, HEALTH_WAY_OUT);
    else if (why.code != ERROR_NONE && e)
        *e = why;
    free(from);
    return ok;
}

/* ---- checks of copies */

/* SQLite returns several faults in one text, below a line of asterisks that names the database. A page that
 * could not be read because of the disk or of missing memory is not a fault of the database: then the
 * function returns that code. */
static int write_findings(FILE *findings, const char *text)
{
    static const char unread[] = "unable to get the page. error code=";
    const char *found = strstr(text, unread);
    int code = found ? atoi(found + strlen(unread)) : SQLITE_OK;
    if ((code & 0xFF) == SQLITE_IOERR || (code & 0xFF) == SQLITE_NOMEM) return code;
    while (*text) {
        size_t length = strcspn(text, "\n");
        if (length && strncmp(text, "***", 3) != 0) fprintf(findings, "%.*s\n", (int)length, text);
        text += length + (text[length] != '\0');
    }
    return SQLITE_OK;
}

/* Runs a check whose rows are faults, or the single row "ok". Returns SQLITE_DONE, or the code of a
 * failure. */
static int run_check(sqlite3 *file, const char *sql, FILE *findings)
{
    sqlite3_stmt *s = NULL;
    int code = sqlite3_prepare_v2(file, sql, -1, &s, NULL);
    while (code == SQLITE_OK || code == SQLITE_ROW) {
        code = sqlite3_step(s);
        const char *said = code == SQLITE_ROW ? (const char *)sqlite3_column_text(s, 0) : NULL;
        int unread = said && strcmp(said, "ok") != 0 ? write_findings(findings, said) : SQLITE_OK;
        if (unread != SQLITE_OK) code = unread;
    }
    sqlite3_finalize(s);
    return code;
}

static int run_all_checks(sqlite3 *file, bool full, FILE *findings, error *e)
{
    int count = 0;
    int code = run_check(file, full ? "PRAGMA integrity_check" : "PRAGMA quick_check", findings);
    if (code == SQLITE_DONE && full)
        code = run_check(
            file,
            "SELECT 'a row of ' || \"table\" || ' refers to one of ' || parent || ' that is not there'"
            " FROM pragma_foreign_key_check LIMIT 100",
            findings);
    if (code == SQLITE_DONE && full && !schema_compare(file, findings, &count, e))
        code = sqlite3_extended_errcode(file);
    return code;
}

static int is_stopping(void *stop)
{
    return atomic_load((const atomic_bool *)stop);
}

bool backup_check(const char *path, bool full, const atomic_bool *stop, char **findings, error *e)
{
    char *text = NULL;
    size_t length = 0;
    FILE *stream = open_memstream(&text, &length);
    sqlite3 *file = NULL;
    int code = sqlite3_open_v2(path, &file, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, NULL);
    if (file) sqlite3_extended_result_codes(file, 1);
    if (code == SQLITE_OK)
        code = sqlite3_exec(file, "PRAGMA locking_mode = EXCLUSIVE; PRAGMA cache_size = " CHECK_CACHE, NULL,
                            NULL, NULL);
    if (code == SQLITE_OK && stop)
        sqlite3_progress_handler(file, CHECK_TURNS, is_stopping, (void *)(uintptr_t)stop);
    if (code == SQLITE_OK) code = run_all_checks(file, full, stream, e);
    if (!file) code = SQLITE_NOMEM;
    /* SQLITE_ERROR: SQLite cannot parse its own schema, so a table is incomplete */
    bool damaged = schema_error_is_damage(code) || code == SQLITE_ERROR;
    if (damaged) write_findings(stream, sqlite3_errmsg(file));
    fclose(stream);
    bool ok = code == SQLITE_DONE || damaged || fail(path, code, e);
    sqlite3_close(file);
    if (ok)
        *findings = text;
    else
        free(text);
    return ok;
}

char *backup_read_instance(const char *path, error *e)
{
    sqlite3 *file = NULL;
    sqlite3_stmt *row = NULL;
    char *id = NULL;
    int code = sqlite3_open_v2(path, &file, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, NULL);
    if (code == SQLITE_OK) code = sqlite3_prepare_v2(file, "SELECT id FROM instance", -1, &row, NULL);
    if (code == SQLITE_OK) code = sqlite3_step(row);
    if (code == SQLITE_ROW) id = mem_strdup((const char *)sqlite3_column_text(row, 0));
    if (code == SQLITE_DONE) id = mem_strdup("");
    if (!id) fail(path, code, e);
    sqlite3_finalize(row);
    sqlite3_close(file);
    return id;
}

/* ---- copies of an open queue, and their checks */

/* A requested copy. */
typedef struct request {
    database *d;
    const char *path;
    bool check, full; /* `check`: the copy is checked and removed; `full`: as backup_check's */
    char *findings;   /* of the check */
} request;

static bool try_once(request *r, error *e)
{
    free(r->findings);
    r->findings = NULL;
    if (!make_copy(r->d, r->path, e)) return false;
    if (!r->check) return true;
    bool ok = backup_check(r->path, r->full, health_stop_flag(database_health(r->d)), &r->findings, e);
    unlink(r->path);
    return ok;
}

/* Makes the copy a second time if the first one has damage: the disk of the copy may be at fault, and SQLite
 * also reports a schema that it cannot read as damaged. Only damage in both copies counts as damage of the
 * database. */
static bool try_twice(request *r, int64_t free_bytes, error *e)
{
    error why = {0};
    if (!database_has_place(r->d, e)) return false; /* the path of the copy may belong to another service */
    if (!check_room(r->path, database_bytes(database_directory(r->d)), free_bytes, e)) return false;
    bool ok = try_once(r, &why);
    if (ok ? r->findings && *r->findings : why.code == ERROR_DATABASE_DAMAGED) ok = try_once(r, &why);
    if (ok) return true;
    if (why.code != ERROR_DATABASE_DAMAGED) {
        if (e) *e = why;
        return false;
    }
    health_note_damage(database_health(r->d), "copy", why.message, false);
    return health_allows_changes(database_health(r->d), e);
}

bool backup_make(database *d, const char *path, int64_t free_bytes, error *e)
{
    request r = {.d = d, .path = path};
    return try_twice(&r, free_bytes, e);
}

bool backup_make_checked(database *d, int64_t free_bytes, bool full, char **findings, error *e)
{
    char *path = database_copy_path(d);
    request r = {.d = d, .path = path, .check = true, .full = full};
    bool ok = try_twice(&r, free_bytes, e);
    free(path);
    if (ok)
        *findings = r.findings;
    else
        free(r.findings);
    return ok;
}
