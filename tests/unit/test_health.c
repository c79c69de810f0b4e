// SPDX-License-Identifier: Apache-2.0
/* Damage of the queue's database: detection, consequences, and complete copies. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "service/database/backup.h"
#include "service/database/backup_directory.h"
#include "service/database/checker.h"
#include "service/database/database.h"
#include "service/database/health.h"
#include "queue_place.h"

#define PAGE 4096
/* More than SQLite caches, so that pages are read again. */
#define SPEC_BYTES 100000
#define JOBS 60

static checker *running;

static void start_checks(place *p)
{
    running = checker_start(queue_database(p->q), 0, 0, NULL);
    assert_non_null(running);
}

static void stop_checks(void)
{
    checker_stop(running);
    running = NULL;
}

static char *database_of(const place *p)
{
    return mem_printf("%s/queue.db", p->base);
}

static int open_place(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-health-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    error e = {0};
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
    *state = p;
    return 0;
}

static int close_place(void **state)
{
    place *p = *state;
    stop_checks(); /* left running by a failed test */
    queue_close(p->q);
    assert_true(store_remove(p->base, NULL));
    free(p);
    return 0;
}

static void submit_long_jobs(place *p, char id[JOBS][ULID_SIZE])
{
    char *spec = mem_alloc(SPEC_BYTES + 1);
    memset(spec, 'x', SPEC_BYTES);
    queue_submission s = plain;
    s.spec = spec;
    for (int i = 0; i < JOBS; i++) submit_for(p, &s, id[i]);
    free(spec);
}

/* Adds long jobs. The queue is closed and opened, so that they are in the database and not in its log. */
static void fill(place *p, char id[JOBS][ULID_SIZE])
{
    submit_long_jobs(p, id);
    queue_close(p->q);
    error e = {0};
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
}

static void overwrite(const char *path, int64_t first, int64_t count, int byte)
{
    int fd = open(path, O_RDWR);
    char page[PAGE];
    memset(page, byte, sizeof page);
    for (int64_t i = first; i < first + count; i++) assert_int_equal(pwrite(fd, page, PAGE, i * PAGE), PAGE);
    close(fd);
}

static int64_t pages_of(const char *path)
{
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    return info.st_size / PAGE;
}

/* Overwrites all pages except the first. */
static void ruin(const place *p)
{
    char *path = database_of(p);
    overwrite(path, 1, pages_of(path) - 1, 0xA5);
    free(path);
}

static health_report health_of(place *p)
{
    health_report known;
    queue_get_health(p->q, &known);
    return known;
}

/* Reads jobs until one cannot be read. */
static bool can_read_all(place *p, char id[JOBS][ULID_SIZE], error *e)
{
    bool ok = true;
    for (int i = 0; ok && i < JOBS; i++) {
        queue_job job = {0};
        bool found = false;
        ok = queue_get(p->q, id[i], &job, &found, e);
        if (ok) queue_job_clear(&job);
    }
    return ok;
}

static void test_an_intact_database_has_no_findings(void **state)
{
    place *p = *state;
    health_report known = health_of(p);
    assert_false(known.damaged);
    assert_int_equal(known.checked_ms, 0);
    assert_true(queue_allows_changes(p->q, NULL));
}

static void test_damage_found_by_a_statement_stops_all_changes(void **state)
{
    place *p = *state;
    static char id[JOBS][ULID_SIZE];
    error e = {0};
    queue_receipt receipt;
    fill(p, id);
    assert_true(can_read_all(p, id, &e));
    ruin(p);
    assert_false(can_read_all(p, id, &e));
    assert_int_equal(e.code, ERROR_DATABASE_DAMAGED);
    health_report known = health_of(p);
    assert_true(known.damaged);
    assert_string_equal(known.found_by, "statement");
    assert_true(*known.damage);
    e = (error){0};
    assert_false(queue_put(p->q, &plain, &receipt, &e));
    assert_int_equal(e.code, ERROR_DATABASE_DAMAGED);
    assert_non_null(strstr(e.message, "replace queue.db by the last backup"));
    bool found;
    queue_claimed claimed;
    assert_false(queue_claim(p->q, &wide, &claimed, &found, NULL));
}

static void wait_for_check(place *p, health_report *known)
{
    for (int64_t end = clock_monotonic_ms() + 120000;
         *known = health_of(p), !known->checked_ms || known->checking;) {
        assert_true(clock_monotonic_ms() < end);
        usleep(1000);
    }
}

static void test_the_checker_finds_damage_that_no_statement_reads(void **state)
{
    place *p = *state;
    static char id[JOBS][ULID_SIZE];
    health_report known;
    error e = {0};
    fill(p, id);
    start_checks(p);
    wait_for_check(p, &known);
    stop_checks();
    assert_false(known.damaged);
    queue_close(p->q); /* the checker must end before its queue */
    p->q = queue_open(p->base, &e);
    assert_non_null(p->q);
    char *path = database_of(p);
    overwrite(path, pages_of(path) / 2, 1, 0x5A);
    free(path);
    start_checks(p);
    wait_for_check(p, &known);
    stop_checks();
    assert_true(known.damaged);
    assert_string_equal(known.found_by, "quick_check");
}

/* Number of further reads of the database by this thread that fail in the queue's VFS. Other threads
 * checkpoint pages of the log. */
static _Thread_local int faults;
static int (*real_open)(sqlite3_vfs *vfs, const char *name, sqlite3_file *file, int flags, int *out);
static const sqlite3_io_methods *real_methods;

static int read_or_fail(sqlite3_file *file, void *to, int count, sqlite3_int64 from)
{
    if (faults > 0) {
        faults--;
        return SQLITE_IOERR_READ;
    }
    return real_methods->xRead(file, to, count, from);
}

static int open_with_faults(sqlite3_vfs *vfs, const char *name, sqlite3_file *file, int flags, int *out)
{
    static sqlite3_io_methods methods;
    int code = real_open(vfs, name, file, flags, out);
    if (code != SQLITE_OK || !(flags & SQLITE_OPEN_MAIN_DB)) return code;
    if (!real_methods) methods = *(real_methods = file->pMethods);
    methods.xRead = read_or_fail;
    file->pMethods = &methods;
    return code;
}

/* A failed read may be a temporary fault of the disk: changes are refused until a check has read
 * everything. */
static void test_a_read_error_is_cleared_by_a_check(void **state)
{
    place *p = *state;
    static char id[JOBS][ULID_SIZE];
    error e = {0};
    queue_receipt receipt;
    health_report known;
    sqlite3_vfs *vfs = sqlite3_vfs_find("unix-excl"); /* the VFS of the queue (database.c) */
    real_open = vfs->xOpen;
    vfs->xOpen = open_with_faults;
    fill(p, id);
    faults = 1;
    assert_false(can_read_all(p, id, &e));
    assert_int_equal(e.code, ERROR_DATABASE_DAMAGED);
    assert_false(queue_put(p->q, &plain, &receipt, &e));
    start_checks(p);
    wait_for_check(p, &known);
    assert_false(known.damaged);
    assert_true(queue_put(p->q, &plain, &receipt, &e));
    faults = 1;
    assert_false(can_read_all(p, id, &e));
    for (int64_t end = clock_monotonic_ms() + 120000; health_of(p).damaged; usleep(1000))
        assert_true(clock_monotonic_ms() < end); /* the checker starts at once */
    stop_checks();
    vfs->xOpen = real_open;
}

/* Number of further reads of this thread that fail with EIO, which SQLite reports as damage while a
 * statement runs. */
static _Thread_local int disk_faults;

/* Replaces the function of the C library, for SQLite. */
ssize_t pread64(int fd, void *to, size_t count, off64_t from)
{
    if (disk_faults > 0) {
        disk_faults--;
        errno = EIO;
        return -1;
    }
    return syscall(SYS_pread64, fd, to, count, from);
}

static void test_an_io_error_of_the_disk_is_cleared_by_a_check(void **state)
{
    place *p = *state;
    static char id[JOBS][ULID_SIZE];
    error e = {0};
    queue_receipt receipt;
    fill(p, id);
    for (int round = 0; round < 2; round++) {
        if (round == 1) submit_long_jobs(p, id); /* these jobs are read from the log */
        disk_faults = 1;
        assert_false(can_read_all(p, id, &e));
        assert_int_equal(e.code, ERROR_DATABASE_DAMAGED);
        if (!running) {
            assert_false(queue_put(p->q, &plain, &receipt, &e));
            start_checks(p);
        }
        for (int64_t end = clock_monotonic_ms() + 120000; health_of(p).damaged; usleep(1000))
            assert_true(clock_monotonic_ms() < end);
        assert_true(queue_put(p->q, &plain, &receipt, &e));
    }
    stop_checks();
}

/* Between two steps of a copy these threads store more than one step copies; they stop at 600 MB. */
#define WRITERS 4
#define LONG_SPEC_BYTES 100000
#define MOST_WRITES 1500

typedef struct writer {
    place *p;
    atomic_bool enough;
    atomic_int count;
} writer;

static void *write_on(void *argument)
{
    writer *w = argument;
    char last[ULID_SIZE], *spec = mem_alloc(LONG_SPEC_BYTES + 1);
    memset(spec, 'y', LONG_SPEC_BYTES);
    queue_submission s = plain;
    s.spec = spec;
    while (!atomic_load(&w->enough) && atomic_load(&w->count) < MOST_WRITES) {
        submit_for(w->p, &s, last);
        atomic_fetch_add(&w->count, 1);
    }
    free(spec);
    return NULL;
}

static int64_t count_jobs(const char *path, const char *id)
{
    sqlite3 *file;
    sqlite3_stmt *s;
    assert_int_equal(sqlite3_open_v2(path, &file, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_prepare_v2(file, "SELECT count(*), sum(id = ?1) FROM job", -1, &s, NULL),
                     SQLITE_OK);
    sqlite3_bind_text(s, 1, id, -1, SQLITE_STATIC);
    assert_int_equal(sqlite3_step(s), SQLITE_ROW);
    assert_int_equal(sqlite3_column_int(s, 1), 1);
    int64_t count = sqlite3_column_int64(s, 0);
    sqlite3_finalize(s);
    sqlite3_close(file);
    return count;
}

static void start_writers(place *p, writer w[WRITERS], pthread_t thread[WRITERS])
{
    for (int i = 0; i < WRITERS; i++) {
        w[i] = (writer){.p = p};
        assert_int_equal(pthread_create(&thread[i], NULL, write_on, &w[i]), 0);
    }
}

static void stop_writers(writer w[WRITERS], pthread_t thread[WRITERS])
{
    for (int i = 0; i < WRITERS; i++) atomic_store(&w[i].enough, true);
    for (int i = 0; i < WRITERS; i++) assert_int_equal(pthread_join(thread[i], NULL), 0);
}

static void test_a_copy_is_whole_while_threads_write(void **state)
{
    place *p = *state;
    static char id[JOBS][ULID_SIZE];
    error e = {0};
    fill(p, id);
    char *path = mem_printf("%s/copy.db", p->base);
    for (int round = 0; round < 2; round++) {
        writer w[WRITERS];
        pthread_t thread[WRITERS];
        char before[ULID_SIZE], *findings = NULL;
        put(p, "before", 0, before);
        start_writers(p, w, thread);
        if (!backup_make(queue_database(p->q), path, 0, &e)) fail_msg("%s", e.message);
        for (int i = 0; i < WRITERS; i++) /* the copy did not wait for the end of the writers */
            assert_true(atomic_load(&w[i].count) < MOST_WRITES);
        stop_writers(w, thread);
        assert_true(backup_check(path, true, NULL, &findings, &e));
        assert_string_equal(findings, "");
        free(findings);
        assert_true(count_jobs(path, before) >= JOBS + round + 1);
        assert_int_equal(unlink(path), 0);
    }
    free(path);
    assert_false(health_of(p).damaged);
}

static void test_faults_of_a_copy_are_listed(void **state)
{
    place *p = *state;
    static char id[JOBS][ULID_SIZE];
    error e = {0};
    char *findings = NULL, *path = mem_printf("%s/copy.db", p->base);
    fill(p, id);
    assert_true(backup_make(queue_database(p->q), path, 0, &e));
    sqlite3 *file;
    assert_int_equal(sqlite3_open(path, &file), SQLITE_OK);
    assert_int_equal(
        sqlite3_exec(file,
                     "DROP INDEX event_by_job; PRAGMA foreign_keys = OFF; DELETE FROM job WHERE seq = 3;",
                     NULL, NULL, NULL),
        SQLITE_OK);
    sqlite3_close(file);
    assert_true(backup_check(path, false, NULL, &findings, &e));
    assert_string_equal(findings, ""); /* its pages have no faults */
    free(findings);
    assert_true(backup_check(path, true, NULL, &findings, &e));
    assert_non_null(strstr(findings, "the index event_by_job is missing\n"));
    assert_non_null(strstr(findings, "a row of spec refers to one of job"));
    free(findings);
    atomic_bool stop = true;
    assert_false(backup_check(path, true, &stop, &findings, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    overwrite(path, 0, 1, 0);
    assert_true(backup_check(path, false, NULL, &findings, &e));
    assert_string_not_equal(findings, "");
    free(findings);
    assert_int_equal(unlink(path), 0);
    assert_false(backup_check(path, false, NULL, &findings, &e));
    free(path);
}

static void test_copies_of_a_killed_process_are_removed(void **state)
{
    place *p = *state;
    queue_close(p->q);
    char *directory = backup_directory_path(p->base), *path = mem_printf("%s/7.db", directory);
    assert_true(store_file_write(path, "x", 1, NULL));
    p->q = queue_open(p->base, NULL);
    assert_non_null(p->q);
    assert_int_equal(access(path, F_OK), -1);
    free(path);
    free(directory);
}

#define HEALTH_CASE(name) cmocka_unit_test_setup_teardown(name, open_place, close_place)

int main(void)
{
    const struct CMUnitTest tests[] = {
        HEALTH_CASE(test_an_intact_database_has_no_findings),
        HEALTH_CASE(test_damage_found_by_a_statement_stops_all_changes),
        HEALTH_CASE(test_the_checker_finds_damage_that_no_statement_reads),
        HEALTH_CASE(test_a_read_error_is_cleared_by_a_check),
        HEALTH_CASE(test_an_io_error_of_the_disk_is_cleared_by_a_check),
        HEALTH_CASE(test_a_copy_is_whole_while_threads_write),
        HEALTH_CASE(test_faults_of_a_copy_are_listed),
        HEALTH_CASE(test_copies_of_a_killed_process_are_removed),
    };
    return cmocka_run_group_tests_name("health", tests, NULL, NULL);
}
