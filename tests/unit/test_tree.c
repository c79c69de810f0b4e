// SPDX-License-Identifier: Apache-2.0
/* Unit tests of files/tree: files below a directory, and the hash of the opened files. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "files/tree.h"

static char place[32];

static int make_place(void **state)
{
    (void)state;
    strcpy(place, "/tmp/hexad-tree-XXXXXX");
    return mkdtemp(place) ? 0 : -1;
}

static int remove_place(void **state)
{
    (void)state;
    return store_remove(place, NULL) ? 0 : -1;
}

static void write_file(const char *name, const char *text)
{
    char *path = mem_printf("%s/%s", place, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
    free(path);
}

static store_tree *open_tree(void)
{
    const int directory = open(place, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    assert_true(directory >= 0);
    return store_tree_new(directory, true);
}

/* Whether the file can be opened; otherwise the code of the error, ERROR_NONE for a missing file. */
static bool can_open(store_tree *t, const char *path, error_code *code)
{
    error e = {0};
    bool is_missing = false;
    const int fd = store_tree_open(t, path, &is_missing, &e);
    *code = e.code;
    assert_true(fd >= 0 || is_missing == (e.code == ERROR_NONE));
    if (fd >= 0) close(fd);
    return fd >= 0;
}

static void test_the_hash_is_that_of_a_list(void **state)
{
    (void)state;
    error_code code;
    store_facts facts;
    bool has_changed;
    char hash[STORE_HASH_SIZE], *sub = mem_printf("%s/sub", place), *lines;
    assert_int_equal(mkdir(sub, 0700), 0);
    write_file("sub/b", "second");
    write_file("a", "first");
    write_file("unread", "");
    store_tree *t = open_tree();
    for (int round = 0; round < 2; round++) {
        assert_true(can_open(t, "sub/b", &code));
        assert_true(can_open(t, "a", &code));
    }
    store_tree_facts(t, &facts, &has_changed);
    assert_false(has_changed);
    assert_int_equal(facts.bytes, 11);
    char first[STORE_HASH_SIZE], second[STORE_HASH_SIZE];
    store_hash("first", 5, first);
    store_hash("second", 6, second);
    lines = mem_printf("%s  a\n%s  sub/b\n", first, second);
    store_hash(lines, strlen(lines), hash);
    assert_string_equal(facts.sha256, hash);
    write_file("a", "another");
    assert_true(can_open(t, "a", &code));
    store_tree_facts(t, &facts, &has_changed);
    assert_true(has_changed);
    store_tree_free(t);
    free(lines);
    free(sub);
}

static void test_many_files_are_listed_once(void **state)
{
    enum { FILES = 600 };
    (void)state;
    error_code code;
    store_facts facts;
    bool has_changed;
    store_tree *t = open_tree();
    for (int round = 0; round < 2; round++)
        for (int k = 0; k < FILES; k++) {
            char name[16];
            snprintf(name, sizeof name, "%d", k);
            if (round == 0) write_file(name, "x");
            assert_true(can_open(t, name, &code));
        }
    store_tree_facts(t, &facts, &has_changed);
    assert_false(has_changed);
    assert_int_equal(facts.bytes, FILES);
    store_tree_free(t);
}

static void test_links_and_other_places_are_refused(void **state)
{
    (void)state;
    error_code code;
    char *link = mem_printf("%s/link", place), *folder = mem_printf("%s/folder", place);
    write_file("a", "first");
    assert_int_equal(symlink("a", link), 0);
    assert_int_equal(mkdir(folder, 0700), 0);
    store_tree *t = open_tree();
    assert_false(can_open(t, "link", &code));
    assert_int_equal(code, ERROR_PATH_FORBIDDEN);
    assert_false(can_open(t, "../a", &code));
    assert_int_equal(code, ERROR_PATH_FORBIDDEN);
    assert_false(can_open(t, "/etc/passwd", &code));
    assert_int_equal(code, ERROR_PATH_FORBIDDEN);
    assert_false(can_open(t, "folder", &code));
    assert_int_equal(code, ERROR_INPUT_UNSUPPORTED);
    assert_false(can_open(t, "missing/file", &code));
    assert_int_equal(code, ERROR_NONE);
    store_tree_free(t);
    store_tree_free(NULL);
    free(link);
    free(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_the_hash_is_that_of_a_list, make_place, remove_place),
        cmocka_unit_test_setup_teardown(test_many_files_are_listed_once, make_place, remove_place),
        cmocka_unit_test_setup_teardown(test_links_and_other_places_are_refused, make_place, remove_place),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
