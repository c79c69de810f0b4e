// SPDX-License-Identifier: Apache-2.0
/* A state directory, its database, log or lock that is removed, renamed or replaced. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/database/place.h"
#include "files/file.h"

static const char *const files[] = {"queue.db", "queue.db-wal", "lock"};
enum { FILES = 3 };

typedef struct fixture {
    char base[64];
    char *directory, *away;
    place *p;
} fixture;

/* ---- counts of log records */

static int errors, infos;

static bool count_record(const struct iovec *fields, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (memmem(fields[i].iov_base, fields[i].iov_len, "PRIORITY=3", 10)) errors++;
        if (memmem(fields[i].iov_base, fields[i].iov_len, "PRIORITY=6", 10)) infos++;
    }
    return true;
}

static void write_file(const char *directory, const char *name)
{
    char *path = mem_printf("%s/%s", directory, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fclose(file);
    free(path);
}

static void make_directory(const char *directory)
{
    assert_int_equal(mkdir(directory, 0700), 0);
    for (int i = 0; i < FILES; i++) write_file(directory, files[i]);
}

static int set_up(void **state)
{
    fixture *f = mem_alloc(sizeof *f);
    error e = {0};
    strcpy(f->base, "/tmp/hexad-place-XXXXXX");
    assert_non_null(mkdtemp(f->base));
    f->directory = mem_printf("%s/state", f->base);
    f->away = mem_printf("%s/away", f->base);
    make_directory(f->directory);
    f->p = place_note(f->directory, &e);
    if (!f->p) fail_msg("%s", e.message);
    errors = infos = 0;
    log_set_journal(count_record);
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    fixture *f = *state;
    log_set_journal(NULL);
    place_free(f->p);
    store_remove(f->base, NULL);
    free(f->directory);
    free(f->away);
    free(f);
    return 0;
}

static void expect_lost(fixture *f, const char *what)
{
    error e = {0};
    assert_false(place_check(f->p, &e));
    assert_int_equal(e.code, ERROR_STATE_LOST);
    if (!strstr(e.message, what) || !strstr(e.message, "doc/operations.md"))
        fail_msg("%s lacks %s", e.message, what);
}

static void test_a_directory_that_is_moved_away_and_back_is_lost_meanwhile(void **state)
{
    fixture *f = *state;
    assert_true(place_check(f->p, NULL));
    for (int round = 1; round <= 2; round++) {
        assert_int_equal(rename(f->directory, f->away), 0);
        for (int i = 0; i < 3; i++) expect_lost(f, "was removed or renamed");
        assert_int_equal(errors, round);
        assert_int_equal(rename(f->away, f->directory), 0);
        for (int i = 0; i < 3; i++) assert_true(place_check(f->p, NULL));
        assert_int_equal(infos, round);
    }
}

/* A file system gives the inodes of removed files to new ones, unless they are open. */
static void test_a_directory_that_is_removed_and_made_again_is_lost(void **state)
{
    fixture *f = *state;
    for (int i = 0; i < 20; i++) {
        assert_true(store_remove(f->directory, NULL));
        make_directory(f->directory);
        expect_lost(f, "was replaced");
    }
    assert_int_equal(errors, 1);
}

static void test_each_file_is_missed(void **state)
{
    fixture *f = *state;
    for (int i = 0; i < FILES; i++) {
        char *path = mem_printf("%s/%s", f->directory, files[i]);
        assert_int_equal(rename(path, f->away), 0);
        expect_lost(f, path);
        write_file(f->directory, files[i]);
        expect_lost(f, "was replaced");
        assert_int_equal(rename(f->away, path), 0);
        assert_true(place_check(f->p, NULL));
        free(path);
    }
}

static void test_a_path_that_cannot_be_examined_is_lost(void **state)
{
    fixture *f = *state;
    assert_int_equal(rename(f->directory, f->away), 0);
    assert_int_equal(symlink("state", f->directory), 0); /* a loop */
    expect_lost(f, "cannot be examined: Too many levels of symbolic links");
    assert_int_equal(unlink(f->directory), 0);
    write_file(f->base, "state");
    expect_lost(f, "was replaced");
}

static void test_a_missing_file_cannot_be_noted(void **state)
{
    fixture *f = *state;
    error e = {0};
    char *path = mem_printf("%s/lock", f->directory);
    assert_int_equal(unlink(path), 0);
    assert_null(place_note(f->directory, &e));
    assert_non_null(strstr(e.message, path));
    assert_null(place_note(path, &e));
    assert_true(place_check(NULL, NULL));
    free(path);
}

int main(void)
{
#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        CASE(test_a_directory_that_is_moved_away_and_back_is_lost_meanwhile),
        CASE(test_a_directory_that_is_removed_and_made_again_is_lost),
        CASE(test_each_file_is_missed),
        CASE(test_a_path_that_cannot_be_examined_is_lost),
        CASE(test_a_missing_file_cannot_be_noted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
