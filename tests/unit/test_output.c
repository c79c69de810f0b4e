// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sched.h>
#include <sys/inotify.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "files/file.h"
#include "files/output.h"

static bool has_no_unnamed_files; /* as on a network file system */

/* Replaces the function of the C library. */
int openat(int directory, const char *name, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const bool is_unnamed = (flags & O_TMPFILE) == O_TMPFILE;
    const mode_t mode = flags & O_CREAT || is_unnamed ? va_arg(arguments, mode_t) : 0;
    va_end(arguments);
    if (!is_unnamed || !has_no_unnamed_files) return (int)syscall(SYS_openat, directory, name, flags, mode);
    errno = EOPNOTSUPP;
    return -1;
}

typedef struct place {
    char base[64];
    char *root, *from;
    store_outputs outputs;
} place;

#define TEMPORARY ".job.1.hexad-tmp"

static const store_output_file names[] = {{"points.ply", ""}, {"report.json", ""}};

static void put(const char *directory, const char *name, const char *text)
{
    char *path = mem_printf("%s/%s", directory, name);
    assert_true(store_file_write(path, text, strlen(text), NULL));
    free(path);
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-output-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->root = mem_printf("%s/show", p->base);
    p->from = mem_printf("%s/result", p->base);
    assert_true(store_directory_create(p->root, NULL));
    assert_true(store_directory_create(p->from, NULL));
    put(p->from, "points.ply", "points");
    put(p->from, "report.json", "report");
    put(p->from, "worker.log", "log");
    p->outputs = (store_outputs){(const char *const *)&p->root, 1, 0640, getgid(), NULL};
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    assert_true(store_remove(p->base, NULL));
    free(p->root);
    free(p->from);
    free(p);
    return 0;
}

static void expect_text(const char *root, const char *name, const char *expected)
{
    char *path = mem_printf("%s/%s", root, name);
    size_t length;
    char *text = store_file_read(path, 100, &length, NULL);
    assert_non_null(text);
    assert_string_equal(text, expected);
    free(text);
    free(path);
}

static void expect_mode(const char *root, const char *name, mode_t mode)
{
    char *path = mem_printf("%s/%s", root, name);
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_mode & 07777, mode);
    assert_int_equal(info.st_gid, getgid());
    free(path);
}

static bool copy(place *p, const char *where, error *e)
{
    char *path = mem_printf("%s/%s", p->root, where);
    int to = store_output_open(&p->outputs, path, e);
    bool ok = to >= 0 && store_output_copy(&p->outputs, p->from, names, 2, to, path, TEMPORARY, e);
    if (to >= 0) close(to);
    free(path);
    return ok;
}

static void test_a_copy_with_mode_and_group(void **state)
{
    place *p = *state;
    error e = {0};
    mode_t old = umask(0077);
    if (!copy(p, "a//b/", &e)) fail_msg("%s", e.message);
    umask(old);
    expect_text(p->root, "a/b/points.ply", "points");
    expect_text(p->root, "a/b/report.json", "report");
    expect_mode(p->root, "a/b/points.ply", 0640);
    expect_mode(p->root, "a/b", 0750);
    expect_mode(p->root, "a", 0750);
    char *log = mem_printf("%s/a/b/worker.log", p->root);
    assert_int_equal(access(log, F_OK), -1);
    free(log);
}

static void test_a_copy_over_another(void **state)
{
    place *p = *state;
    error e = {0};
    assert_true(copy(p, "a", &e));
    char *there = mem_printf("%s/a", p->root);
    put(there, "notes", "of somebody");
    put(p->from, "points.ply", "newer");
    assert_true(copy(p, "a", &e));
    expect_text(p->root, "a/points.ply", "newer");
    expect_text(p->root, "a/notes", "of somebody");
    DIR *listing = opendir(there); /* no temporary file remains */
    int entries = 0;
    while (readdir(listing)) entries++;
    closedir(listing);
    assert_int_equal(entries, 2 + 3);
    free(there);
}

static void test_a_file_with_another_hash_is_not_copied(void **state)
{
    place *p = *state;
    error e = {0};
    char hex[STORE_HASH_SIZE], *there = mem_printf("%s/a", p->root);
    store_hash("points", 6, hex);
    const store_output_file files[] = {{"points.ply", hex}, {"report.json", ""}};
    assert_true(store_directory_create(there, NULL));
    int to = store_output_open(&p->outputs, there, &e);
    assert_true(store_output_copy(&p->outputs, p->from, files, 2, to, there, TEMPORARY, &e));
    put(p->from, "points.ply", "pointz");
    assert_false(store_output_copy(&p->outputs, p->from, files, 2, to, there, TEMPORARY, &e));
    assert_int_equal(e.code, ERROR_INPUT_DAMAGED);
    assert_non_null(strstr(e.message, "points.ply is damaged"));
    expect_text(p->root, "a/points.ply", "points");
    assert_int_equal(faccessat(to, "report.json", F_OK, 0), -1);
    assert_int_equal(faccessat(to, TEMPORARY, F_OK, 0), -1);
    close(to);
    free(there);
}

/* The file that marks a set as complete must not exist while the set is incomplete. */
static void test_a_failed_copy_is_not_marked_complete(void **state)
{
    place *p = *state;
    error e = {0};
    assert_true(copy(p, "a", &e));
    char *points = mem_printf("%s/points.ply", p->from), *report = mem_printf("%s/a/report.json", p->root);
    assert_int_equal(unlink(points), 0);
    assert_false(copy(p, "a", &e));
    assert_non_null(strstr(e.message, "points.ply"));
    assert_int_equal(access(report, F_OK), -1);
    free(points);
    free(report);
}

static void test_a_root_of_users(void **state)
{
    (void)state;
    static const char *const roots[] = {"/srv/out", "/srv/all", "/srv/out/shared"};
    static const bool of_user[] = {true, false, false};
    const store_outputs outputs = {roots, 3, 0640, getgid(), of_user};
    static const struct {
        const char *user, *path;
        bool good;
    } cases[] = {
        {"ann", "/srv/out/ann/a", true},
        {"ann", "/srv/out//ann/./a", true},
        {"a b\\\xc3\xa4%u", "/srv/out/a b\\\xc3\xa4%u/x", true},
        {"ann", "/srv/all/bob/x", true},
        {"ann", "/srv/out/shared/x", true}, /* by the last root */
        {"ann", "/srv/out/ann", false},
        {"ann", "/srv/out/ann/", false},
        {"ann", "/srv/out/bob/a", false},
        {"ann", "/srv/out/anna/a", false},
        {"ann", "/srv/out/%u/a", false},
        {"ann", "/srv/out/./ann/a", false},
        {"ann", "/srv/out/ann/../bob/a", false},
        {".", "/srv/out/./bob", false},
        {"..", "/srv/out/../x", false},
        {"", "/srv/out//x", false},
        {"ann/x", "/srv/out/ann/x/y", false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        error e = {0};
        if (store_output_check_user(&outputs, cases[i].user, cases[i].path, &e) != cases[i].good)
            fail_msg("%s: %s", cases[i].user, cases[i].path);
        if (!cases[i].good) assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    }
}

static void test_paths_that_are_refused(void **state)
{
    place *p = *state;
    char *outside = mem_printf("%s/other", p->base), *beside = mem_printf("%sx/a", p->root);
    char *up = mem_printf("%s/a/../../b", p->root), *link = mem_printf("%s/link", p->root);
    const char *const refused[] = {outside, beside, up, "relative", "", "/", p->root};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        error e = {0};
        if (store_output_check(&p->outputs, refused[i], &e)) fail_msg("%s", refused[i]);
        assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
        assert_int_equal(store_output_open(&p->outputs, refused[i], &e), -1);
    }
    assert_int_equal(symlink(p->base, link), 0);
    error e = {0};
    assert_false(copy(p, "link/escaped", &e));
    assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    assert_false(copy(p, "link", &e));
    char *escaped = mem_printf("%s/escaped", p->base);
    assert_int_equal(access(escaped, F_OK), -1);
    free(escaped);
    free(outside);
    free(beside);
    free(up);
    free(link);
}

static int open_nearest(place *p, const char *where, bool *whole, error *e)
{
    char *path = mem_printf("%s/%s", p->root, where);
    int directory = store_output_open_nearest(&p->outputs, path, whole, e);
    free(path);
    return directory;
}

/* The check of a directory at a submission creates nothing. */
static void test_the_nearest_existing_directory_is_tried(void **state)
{
    place *p = *state;
    error e = {0};
    bool whole = true;
    char *there = mem_printf("%s/a/b", p->root);
    assert_true(store_directory_create(there, NULL));
    int directory = open_nearest(p, "a/b/c/d", &whole, &e);
    assert_true(directory >= 0 && !whole);
    assert_true(store_output_try(NULL, directory, there, &e));
    char *name = store_output_name(directory), *real = realpath(there, NULL);
    assert_string_equal(name, real);
    close(directory);
    DIR *listing = opendir(there); /* no file remains */
    int entries = 0;
    while (readdir(listing)) entries++;
    closedir(listing);
    assert_int_equal(entries, 2);
    directory = open_nearest(p, "a/b/", &whole, &e);
    assert_true(directory >= 0 && whole);
    close(directory);
    put(there, "file", "no directory");
    assert_int_equal(open_nearest(p, "a/b/file/x", &whole, &e), -1);
    assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    assert_true(store_remove(p->root, NULL));
    assert_int_equal(open_nearest(p, "a", &whole, &e), -1);
    assert_int_equal(e.code, ERROR_OUTPUT_UNWRITABLE);
    free(there);
    free(name);
    free(real);
}

static void expect_outside(const store_outputs *outputs, const char *path, const char *advice)
{
    error e = {0};
    assert_false(store_output_check(outputs, path, &e));
    assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    if (!strstr(e.message, advice)) fail_msg("%s", e.message);
}

static void test_the_message_on_a_path_outside_names_setting_and_roots(void **state)
{
    (void)state;
    const char *roots[] = {"/srv/a", "/srv/b/"};
    const store_outputs outputs = {roots, 2, 0640, (gid_t)-1, NULL}, none = {roots, 0, 0640, (gid_t)-1, NULL};
    expect_outside(&outputs, "/srv/c/x",
                   "(setting output_roots: /srv/a, /srv/b/): name a directory below one of them");
    expect_outside(&outputs, "/srv/a", "/srv/a is an output root: name a directory below it");
    expect_outside(&outputs, "/srv/b", "is an output root");
    expect_outside(&outputs, "srv/a/x", "give an absolute path");
    expect_outside(&none, "/srv/a/x", "add a directory to the setting output_roots");
}

/* A file system of the kernel, in which not even root can create files. */
static void test_a_directory_that_cannot_be_written(void **state)
{
    (void)state;
    error e = {0};
    const char *root = "/sys";
    const store_outputs outputs = {&root, 1, 0640, getgid(), NULL};
    assert_int_equal(store_output_open(&outputs, "/sys/kernel/hexad-test", &e), -1);
    assert_int_equal(e.code, ERROR_OUTPUT_UNWRITABLE);
    assert_non_null(strstr(e.message, "ReadWritePaths"));
    bool whole;
    int directory = store_output_open_nearest(&outputs, "/sys/kernel/hexad-test", &whole, &e);
    assert_true(directory >= 0 && !whole);
    assert_false(store_output_try(NULL, directory, "/sys/kernel/hexad-test", &e));
    assert_int_equal(e.code, ERROR_OUTPUT_UNWRITABLE);
    close(directory);
}

/* The directory itself may be missing when the unit of systemd starts, so its root is named. */
static void test_a_read_only_directory_names_its_root(void **state)
{
    place *p = *state;
    error of_copy = {0}, of_clear = {0};
    char *path = mem_printf("%s/a", p->root), *told = mem_printf("ReadWritePaths=%s,", p->root);
    assert_true(store_directory_create(path, NULL));
    if (unshare(CLONE_NEWNS) != 0 || mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0) {
        free(path);
        free(told);
        skip(); /* only root can mount */
    }
    assert_int_equal(mount("none", path, "tmpfs", MS_RDONLY, NULL), 0);
    const bool copied = copy(p, "a", &of_copy),
               cleared = store_output_clear(&p->outputs, path, TEMPORARY, &of_clear);
    assert_int_equal(umount(path), 0);
    assert_false(copied || cleared);
    assert_int_equal(of_copy.code, ERROR_OUTPUT_UNWRITABLE);
    assert_non_null(strstr(of_copy.message, told));
    assert_non_null(strstr(of_clear.message, told));
    free(path);
    free(told);
}

/* A process that is killed during the check leaves nothing: no file gets a name. */
static void test_a_check_of_a_directory_makes_no_named_file(void **state)
{
    place *p = *state;
    error e = {0};
    char events[4096];
    int watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC), directory = store_output_open_root(p->root, &e);
    assert_true(watch >= 0 && directory >= 0);
    assert_true(inotify_add_watch(watch, p->root, IN_CREATE | IN_MOVED_TO) >= 0);
    int unnamed = openat(directory, ".", O_TMPFILE | O_WRONLY, 0600);
    if (unnamed < 0) skip(); /* the file system has no such files */
    close(unnamed);
    assert_true(store_output_try(&p->outputs, directory, p->root, &e));
    assert_int_equal(read(watch, events, sizeof events), -1);
    assert_int_equal(errno, EAGAIN);
    close(watch);
    close(directory);
}

/* Another user has put a pipe in the place of the tried file: an open would wait for a process that reads it. */
static void test_a_check_of_a_directory_does_not_wait_for_a_pipe(void **state)
{
    place *p = *state;
    error e = {0};
    char *pipe = mem_printf("%s/.probe.hexad-tmp", p->root);
    int directory = store_output_open_root(p->root, &e);
    assert_true(directory >= 0);
    has_no_unnamed_files = true;
    assert_true(store_output_try(NULL, directory, p->root, &e));
    assert_int_equal(mkfifo(pipe, 0666), 0);
    assert_false(store_output_try(NULL, directory, p->root, &e));
    has_no_unnamed_files = false;
    assert_non_null(strstr(e.message, "cannot be written"));
    close(directory);
    free(pipe);
}

static void test_files_of_an_interrupted_copy_are_removed(void **state)
{
    place *p = *state;
    error e = {0};
    char *there = mem_printf("%s/a", p->root), *link = mem_printf("%s/link", p->root);
    /* the directory may be on a disk that is not mounted */
    assert_false(store_output_clear(&p->outputs, there, TEMPORARY, &e));
    assert_int_equal(access(there, F_OK), -1);
    assert_true(copy(p, "a", NULL));
    /* the temporary file does not exist */
    assert_true(store_output_clear(&p->outputs, there, TEMPORARY, NULL));
    put(there, TEMPORARY, "half");
    put(there, ".job.2.hexad-tmp", "of another");
    assert_true(store_output_clear(&p->outputs, there, TEMPORARY, NULL));
    expect_text(p->root, "a/points.ply", "points");
    expect_text(p->root, "a/.job.2.hexad-tmp", "of another");
    char *gone = mem_printf("%s/" TEMPORARY, there);
    assert_int_equal(access(gone, F_OK), -1);
    assert_int_equal(symlink(there, link), 0);
    put(there, TEMPORARY, "half");
    assert_false(store_output_clear(&p->outputs, link, TEMPORARY, &e));
    assert_int_equal(e.code, ERROR_PATH_FORBIDDEN);
    assert_int_equal(access(gone, F_OK), 0);
    assert_false(store_output_clear(&p->outputs, p->base, TEMPORARY, &e));
    free(gone);
    free(link);
    free(there);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_a_copy_with_mode_and_group, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_copy_over_another, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_file_with_another_hash_is_not_copied, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_failed_copy_is_not_marked_complete, set_up, tear_down),
        cmocka_unit_test(test_a_root_of_users),
        cmocka_unit_test_setup_teardown(test_paths_that_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_nearest_existing_directory_is_tried, set_up, tear_down),
        cmocka_unit_test(test_the_message_on_a_path_outside_names_setting_and_roots),
        cmocka_unit_test(test_a_directory_that_cannot_be_written),
        cmocka_unit_test_setup_teardown(test_a_read_only_directory_names_its_root, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_check_of_a_directory_makes_no_named_file, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_check_of_a_directory_does_not_wait_for_a_pipe, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_files_of_an_interrupted_copy_are_removed, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("output", tests, NULL, NULL);
}
