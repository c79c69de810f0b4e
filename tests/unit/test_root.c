// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "files/file.h"
#include "files/root.h"

/* base/root (a file, links, a directory, a FIFO), base/outside, base/second */
typedef struct place {
    char base[64];
    char *root, *second;
    store_roots *roots;
} place;

static void put(const char *base, const char *name)
{
    char *path = mem_printf("%s/%s", base, name);
    assert_true(store_file_write(path, name, strlen(name), NULL));
    free(path);
}

static void put_link(const char *base, const char *target, const char *name)
{
    char *path = mem_printf("%s/%s", base, name);
    assert_int_equal(symlink(target, path), 0);
    free(path);
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-root-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->root = mem_printf("%s/root", p->base);
    p->second = mem_printf("%s/second", p->base);
    char *inner = mem_printf("%s/inner", p->root);
    char *fifo = mem_printf("%s/fifo", p->root);
    char *outside = mem_printf("%s/outside", p->base);
    assert_true(store_directory_create(inner, NULL));
    assert_true(store_directory_create(p->second, NULL));
    put(p->base, "outside");
    put(p->root, "file");
    put(p->root, "inner/deep");
    put(p->second, "other");
    put_link(p->root, "inner/deep", "inward");
    put_link(p->root, "../outside", "outward");
    put_link(p->root, outside, "absolute");
    put_link(p->root, "..", "up");
    put_link(p->root, "loop", "loop");
    assert_int_equal(mkfifo(fifo, 0600), 0);
    const char *paths[] = {p->root, p->second};
    error e = {0};
    p->roots = store_roots_open(NULL, paths, 2, &e);
    assert_non_null(p->roots);
    free(inner);
    free(fifo);
    free(outside);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    store_roots_close(p->roots);
    assert_true(store_remove(p->base, NULL));
    free(p->root);
    free(p->second);
    free(p);
    return 0;
}

static void expect_open(place *p, const char *path, const char *content)
{
    error e = {0};
    int fd = store_open_input(p->roots, path, &e);
    if (fd < 0) fail_msg("%s: %s", path, e.message);
    char text[128] = {0};
    assert_true(read(fd, text, sizeof text - 1) >= 0);
    assert_string_equal(text, content);
    close(fd);
}

static void expect_error(place *p, const char *path, error_code code)
{
    error e = {0};
    int fd = store_open_input(p->roots, path, &e);
    assert_int_equal(fd, -1);
    if (e.code != code) fail_msg("%s: %s: %s", path, error_code_name(e.code), e.message);
    assert_non_null(strstr(e.message, path));
}

static void test_files_inside_open(void **state)
{
    place *p = *state;
    expect_open(p, "file", "file");
    expect_open(p, "inner/deep", "inner/deep");
    expect_open(p, "./inner//deep", "inner/deep");
    expect_open(p, "inward", "inner/deep");
    expect_open(p, "other", "other"); /* it is below the second root */
    char *absolute = mem_printf("%s//inner/deep", p->root);
    expect_open(p, absolute, "inner/deep");
    free(absolute);
}

static void test_escapes_are_forbidden(void **state)
{
    place *p = *state;
    expect_error(p, "../outside", ERROR_PATH_FORBIDDEN);
    expect_error(p, "inner/../../outside", ERROR_PATH_FORBIDDEN);
    expect_error(p, "outward", ERROR_PATH_FORBIDDEN);
    expect_error(p, "absolute", ERROR_PATH_FORBIDDEN);
    expect_error(p, "up/outside", ERROR_PATH_FORBIDDEN);
    expect_error(p, "loop", ERROR_PATH_FORBIDDEN);
    expect_error(p, "/etc/passwd", ERROR_PATH_FORBIDDEN);
    expect_error(p, "/", ERROR_PATH_FORBIDDEN);
    /* its text begins with the root, but it is another directory */
    char *sibling = mem_printf("%s-not", p->root);
    expect_error(p, sibling, ERROR_PATH_FORBIDDEN);
    free(sibling);
    char *absolute = mem_printf("%s/../outside", p->root);
    expect_error(p, absolute, ERROR_PATH_FORBIDDEN);
    free(absolute);
}

static void test_unreadable_files_are_errors(void **state)
{
    place *p = *state;
    expect_error(p, "nothing", ERROR_INPUT_MISSING);
    expect_error(p, "file/below", ERROR_INPUT_MISSING);
    expect_error(p, "inner", ERROR_INPUT_UNSUPPORTED);
    expect_error(p, ".", ERROR_INPUT_UNSUPPORTED);
    expect_error(p, "fifo", ERROR_INPUT_UNSUPPORTED);
    char *whole = mem_printf("%s/", p->root);
    expect_error(p, whole, ERROR_INPUT_UNSUPPORTED);
    free(whole);
    error e = {0};
    assert_int_equal(store_open_input(p->roots, "", &e), -1);
    assert_int_equal(e.code, ERROR_INPUT_MISSING);
}

static void test_no_roots(void **state)
{
    place *p = *state;
    error e = {0};
    store_roots *none = store_roots_open(NULL, NULL, 0, &e);
    assert_non_null(none);
    char *path = mem_printf("%s/outside", p->base);
    assert_int_equal(store_open_input(none, path, &e), -1);
    assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    assert_non_null(strstr(e.message, "this service has no input roots: send the file with hexadctl upload"));
    assert_null(strstr(e.message, "below one of them"));
    assert_int_equal(store_open_input(none, "/nonexistent/a.####.off", &e), -1);
    assert_non_null(strstr(e.message, "this service has no input roots: add its directory"));
    assert_int_equal(store_open_input(p->roots, "/nonexistent/a.####.off", &e), -1);
    assert_non_null(strstr(e.message, "is outside the input roots: move it below one of them, or"));
    int fd = store_open_input(NULL, path, &e); /* a worker without a daemon */
    assert_true(fd >= 0);
    close(fd);
    store_roots_close(none);
    free(path);
    const char *missing[] = {"/nonexistent/root"};
    assert_null(store_roots_open(NULL, missing, 1, &e));
    assert_non_null(strstr(e.message, "/nonexistent/root"));
    assert_null(strstr(e.message, "absolute"));
}

static void expect_not_opened(const char *root, const char *advice)
{
    error e = {0};
    assert_null(store_roots_open(NULL, &root, 1, &e));
    assert_non_null(strstr(e.message, "input_roots: "));
    if (!strstr(e.message, advice)) fail_msg("%s", e.message);
}

static void test_a_mistyped_root_is_explained(void **state)
{
    (void)state;
    expect_not_opened("/nonexistent/a /nonexistent/b", "separate paths by a colon or a comma");
    expect_not_opened("nonexistent/a", "write an absolute path");
}

static void test_a_root_cannot_be_opened_as_a_file(void **state)
{
    place *p = *state;
    error e = {0};
    assert_int_equal(store_open_input(p->roots, p->root, &e), -1);
    assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    if (!strstr(e.message, "is an input root: name a file below it")) fail_msg("%s", e.message);
}

static void test_a_path_without_a_name_is_a_root(void **state)
{
    place *p = *state;
    static const char *const relative[] = {".", "./", "././/.", ".//"}, *const absolute[] = {"/", "/.",
                                                                                             "//./."};
    bool is_directory;
    for (size_t k = 0; k < 7; k++) {
        error e = {0};
        char *path = k < 4 ? mem_strdup(relative[k]) : mem_printf("%s%s", p->root, absolute[k - 4]);
        assert_int_equal(store_open_place(p->roots, path, &is_directory, &e), -1);
        assert_int_equal(e.code, ERROR_INPUT_UNSUPPORTED);
        if (!strstr(e.message, "is an input root: name a file below it")) fail_msg("%s: %s", path, e.message);
        free(path);
    }
}

static void test_roots_that_change_at_a_restart_are_mentioned(void **state)
{
    place *p = *state;
    static const char note[] = "restart hexad, which applies the changed setting input_roots";
    for (int changed = 0; changed < 2; changed++) {
        error e = {0};
        store_roots_note_change(p->roots, changed);
        assert_int_equal(store_open_input(p->roots, "/nonexistent/file", &e), -1);
        assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
        if ((strstr(e.message, note) != NULL) != changed) fail_msg("%s", e.message);
    }
}

static void test_a_root_may_be_a_single_file(void **state)
{
    place *p = *state;
    error e = {0};
    char *file = mem_printf("%s/file", p->root);
    const char *paths[] = {file};
    store_roots *roots = store_roots_open(NULL, paths, 1, &e);
    if (!roots) fail_msg("%s", e.message);
    const char *names[] = {"file", file};
    for (size_t i = 0; i < 2; i++) {
        int fd = store_open_input(roots, names[i], &e);
        if (fd < 0) fail_msg("%s", e.message);
        close(fd);
    }
    const char *others[] = {"inner/deep", "./file", ".", "../outside"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        assert_int_equal(store_open_input(roots, others[i], &e), -1);
        assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    }
    store_roots_close(roots);
    free(file);
}

/* Links like `latest` on render farms: absolute, through another link, out of the root and back, and to
 * another root. */
static void test_links_may_lead_below_a_root(void **state)
{
    place *p = *state;
    char *inner = mem_printf("%s/inner", p->root), *latest = mem_printf("%s/latest", p->root),
         *other = mem_printf("%s/./other", p->second),
         *round = mem_printf("%s/../second/../root/latest/deep", p->root);
    put_link(p->root, inner, "latest");
    put_link(p->root, latest, "newest");
    put_link(p->root, other, "across");
    put_link(p->root, "../second", "beside");
    put_link(p->root, round, "round");
    put_link(p->root, "newest/../latest/deep", "mixed");
    expect_open(p, "latest/deep", "inner/deep");
    expect_open(p, "newest//deep", "inner/deep");
    expect_open(p, "across", "other");
    expect_open(p, "beside/other", "other");
    expect_open(p, "round", "inner/deep");
    expect_open(p, "mixed", "inner/deep");
    char *absolute = mem_printf("%s/newest/deep", p->root);
    expect_open(p, absolute, "inner/deep");
    expect_error(p, "latest", ERROR_INPUT_UNSUPPORTED); /* a directory */
    expect_error(p, "latest/nothing", ERROR_INPUT_MISSING);
    expect_error(p, "across/below", ERROR_INPUT_MISSING);
    free(absolute);
    free(round);
    free(other);
    free(latest);
    free(inner);
}

static void test_links_do_not_lead_elsewhere(void **state)
{
    place *p = *state;
    char *near = mem_printf("%s-not/outside", p->root), *back = mem_printf("%s/absolute", p->root),
         *above = mem_printf("%s/../outside", p->root), *loop = mem_printf("%s/turn", p->root);
    put_link(p->root, near, "near");
    put_link(p->root, back, "back");
    put_link(p->root, above, "above");
    put_link(p->root, "/proc/self/root", "magic");
    put_link(p->root, "/..", "top");
    put_link(p->root, loop, "turn");
    const char *const bad[] = {"near", "back", "above", "magic/etc/passwd", "top/etc/passwd", "turn"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) expect_error(p, bad[i], ERROR_PATH_FORBIDDEN);
    free(loop);
    free(above);
    free(back);
    free(near);
}

/* Uploaded files can be opened by their hashes only. */
static void test_sent_files_are_named_by_their_hash(void **state)
{
    place *p = *state;
    error e = {0};
    const char name[] = "sha256:0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    char *link = mem_printf("%s/%s", p->second, name), *with_ending = mem_printf("%s.obj", name);
    put(p->second, name);
    put_link(p->root, link, "by-link");
    put_link(p->root, "../second/other", "by-step");
    const char *paths[] = {p->root};
    store_roots_close(p->roots);
    p->roots = store_roots_open(p->second, paths, 1, &e);
    assert_non_null(p->roots);
    expect_open(p, name, name);
    expect_open(p, with_ending, name);
    expect_error(p, link, ERROR_PATH_FORBIDDEN);
    expect_error(p, "by-link", ERROR_PATH_FORBIDDEN);
    expect_error(p, "by-step", ERROR_PATH_FORBIDDEN);
    expect_error(p, "other", ERROR_INPUT_MISSING);
    free(with_ending);
    free(link);
}

static void expect_walk(int directory, const char *path, int want)
{
    int fd = store_open_walking(directory, path);
    int got = fd >= 0 ? 0 : errno;
    if (fd >= 0) close(fd);
    if (got != want) fail_msg("%s: %s", path, strerror(got));
}

static void test_walk_without_openat2(void **state)
{
    place *p = *state;
    int directory = open(p->root, O_PATH | O_DIRECTORY | O_CLOEXEC);
    assert_true(directory >= 0);
    expect_walk(directory, "file", 0);
    expect_walk(directory, "inner/deep", 0);
    expect_walk(directory, "./inner//deep", 0);
    expect_walk(directory, "nothing", ENOENT);
    expect_walk(directory, "nothing/below", ENOENT);
    expect_walk(directory, "file/below", ENOTDIR);
    expect_walk(directory, "inward", EXDEV);
    expect_walk(directory, "outward", EXDEV);
    expect_walk(directory, "absolute", EXDEV);
    expect_walk(directory, "up/outside", EXDEV);
    expect_walk(directory, "../outside", EXDEV);
    close(directory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_files_inside_open, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_escapes_are_forbidden, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_links_may_lead_below_a_root, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_links_do_not_lead_elsewhere, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_sent_files_are_named_by_their_hash, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_unreadable_files_are_errors, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_no_roots, set_up, tear_down),
        cmocka_unit_test(test_a_mistyped_root_is_explained),
        cmocka_unit_test_setup_teardown(test_a_root_cannot_be_opened_as_a_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_path_without_a_name_is_a_root, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_roots_that_change_at_a_restart_are_mentioned, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_root_may_be_a_single_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_walk_without_openat2, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("root", tests, NULL, NULL);
}
