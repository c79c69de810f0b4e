// SPDX-License-Identifier: Apache-2.0
/* Copies to directories of users run one after another, and fail if another user has a result there. */
#include "queue_place.h"

#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "base/core/log.h"
#include "service/results/output_place.h"
#include "service/results/result.h"

enum { THREADS = 4, FILES = 3 };

/* A file system that does not complete the creation of an unnamed file, by which a directory is checked, until
 * the test permits it. */
static struct {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    _Atomic bool hangs;
    int waiting;
} disk = {.mutex = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};

static void wait_for_disk(void)
{
    pthread_mutex_lock(&disk.mutex);
    disk.waiting++;
    while (disk.hangs) pthread_cond_wait(&disk.changed, &disk.mutex);
    disk.waiting--;
    pthread_cond_broadcast(&disk.changed);
    pthread_mutex_unlock(&disk.mutex);
}

/* Replace functions of the C library. While the file system hangs, 2 s seem to have passed. */
int openat(int directory, const char *name, int flags, ...)
{
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = flags & O_CREAT || (flags & O_TMPFILE) == O_TMPFILE ? va_arg(arguments, mode_t) : 0;
    va_end(arguments);
    if ((flags & O_TMPFILE) == O_TMPFILE) wait_for_disk();
    return (int)syscall(SYS_openat, directory, name, flags, mode);
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int failed = (int)syscall(SYS_clock_gettime, clock, now);
    if (clock == CLOCK_MONOTONIC && disk.hangs) now->tv_sec -= 2;
    return failed;
}

typedef struct outputs {
    char *root;
    store_outputs roots;
    output_place *place;
} outputs;

static void begin(outputs *o, place *p, bool share)
{
    *o = (outputs){.root = mem_printf("%s/show", p->base)};
    assert_true(store_directory_create(o->root, NULL));
    o->roots = (store_outputs){(const char *const *)&o->root, 1, 0640, (gid_t)-1, NULL};
    o->place = output_place_new(p->q, &o->roots, share);
}

static void end(outputs *o)
{
    output_place_free(o->place);
    free(o->root);
}

/* Makes a result of three equal files of `bytes` bytes. Returns its path, which the caller frees. */
static char *make_result(place *p, const char *name, int bytes)
{
    char *directory = mem_printf("%s/%s", p->base, name), hash[STORE_HASH_SIZE], *text = NULL;
    size_t length;
    char *content = mem_alloc((size_t)bytes + 1);
    memset(content, 'a' + bytes % 26, (size_t)bytes);
    assert_true(store_directory_create(directory, NULL));
    store_hash(content, (size_t)bytes, hash);
    FILE *report = open_memstream(&text, &length);
    fputs("{\"outcome\":\"converged\",\"count\":7,\"outputs\":[", report);
    for (int i = 0; i < FILES; i++) {
        char *path = mem_printf("%s/%d.ply", directory, i);
        assert_true(store_file_write(path, content, (size_t)bytes, NULL));
        fprintf(report, "%s{\"name\":\"%d.ply\",\"bytes\":%d,\"sha256\":\"%s\"}", i ? "," : "", i, bytes,
                hash);
        free(path);
    }
    fputs("]}", report);
    fclose(report);
    char *path = mem_printf("%s/report.json", directory);
    assert_true(store_file_write(path, text, length, NULL));
    free(path);
    free(text);
    free(content);
    return directory;
}

/* Checks that the files in the directory are those that its report lists. */
static void expect_whole(const char *directory)
{
    result r = {0};
    error e = {0};
    if (!result_read(directory, &r, &e)) fail_msg("%s", e.message);
    assert_int_equal(r.output_count, FILES);
    for (size_t i = 0; i < r.output_count; i++) {
        char *path = mem_printf("%s/%s", directory, r.output[i].name), hash[STORE_HASH_SIZE];
        size_t length;
        char *text = store_file_read(path, 1 << 20, &length, NULL);
        store_hash(text, length, hash);
        assert_string_equal(hash, r.output[i].sha256);
        free(text);
        free(path);
    }
    result_clear(&r);
}

typedef struct copier {
    output_place *place;
    pthread_barrier_t *round;
    char *from, *to;
    int rounds;
    bool ok;
} copier;

static void *copy_often(void *argument)
{
    copier *c = argument;
    char *temporary = mem_printf(".%s.hexad-tmp", strrchr(c->from, '/') + 1);
    c->ok = true;
    for (int i = 0; i < c->rounds; i++) {
        pthread_barrier_wait(c->round);
        c->ok &= output_place_copy(c->place, "ann", c->from, c->to, QUEUE_NO_FRAME, temporary, NULL);
        pthread_barrier_wait(c->round);
        pthread_barrier_wait(c->round); /* the test has checked the directory */
    }
    free(temporary);
    return NULL;
}

static void test_copies_into_one_directory_run_one_after_another(void **state)
{
    place *p = *state;
    outputs o;
    enum { ROUNDS = 8 };
    copier c[THREADS];
    pthread_t thread[THREADS];
    pthread_barrier_t round;
    begin(&o, p, false);
    pthread_barrier_init(&round, NULL, THREADS + 1);
    char *to = mem_printf("%s/a", o.root);
    assert_true(store_directory_create(to, NULL));
    for (int i = 0; i < THREADS; i++) {
        char name[16];
        snprintf(name, sizeof name, "result.%d", i);
        /* the same directory under two paths */
        c[i] = (copier){o.place,
                        &round,
                        make_result(p, name, 100 + i),
                        i % 2 ? mem_strdup(to) : mem_printf("%s//a/", o.root),
                        ROUNDS,
                        false};
        assert_int_equal(pthread_create(&thread[i], NULL, copy_often, &c[i]), 0);
    }
    for (int i = 0; i < ROUNDS; i++) {
        pthread_barrier_wait(&round);
        pthread_barrier_wait(&round);
        expect_whole(to);
        pthread_barrier_wait(&round);
    }
    for (int i = 0; i < THREADS; i++) {
        pthread_join(thread[i], NULL);
        assert_true(c[i].ok);
        free(c[i].from);
        free(c[i].to);
    }
    pthread_barrier_destroy(&round);
    free(to);
    end(&o);
}

static void expect_copied(const outputs *o, const char *user, const char *from, const char *to,
                          error_code code)
{
    error e = {0};
    bool ok = output_place_copy(o->place, user, from, to, QUEUE_NO_FRAME, ".x.hexad-tmp", &e);
    if (ok != (code == ERROR_NONE) || e.code != code) fail_msg("%s", e.message);
}

static void expect_checked(const outputs *o, const char *user, const char *to, error_code code)
{
    error e = {0};
    bool ok = output_place_check(o->place, user, to, &e);
    if (ok != (code == ERROR_NONE) || e.code != code) fail_msg("%s", e.message);
}

static void test_a_directory_belongs_to_the_user_whose_report_is_there(void **state)
{
    place *p = *state;
    outputs o;
    begin(&o, p, false);
    char *from = make_result(p, "result", 10), *other = make_result(p, "other", 11);
    char *to = mem_printf("%s/a", o.root), *alias = mem_printf("%s/./a", o.root);
    char *report = mem_printf("%s/report.json", to), *file = mem_printf("%s/0.ply", to);
    expect_checked(&o, "ben", to, ERROR_NONE); /* the directory does not exist */
    expect_copied(&o, "ann", from, to, ERROR_NONE);
    expect_checked(&o, "ann", to, ERROR_NONE);
    expect_checked(&o, "ben", to, ERROR_OUTPUT_TAKEN);
    expect_checked(&o, "ben", alias, ERROR_OUTPUT_TAKEN);
    expect_copied(&o, "ben", other, to, ERROR_OUTPUT_TAKEN);
    expect_whole(to);
    struct stat info;
    assert_true(stat(file, &info) == 0 && info.st_size == 10);
    expect_copied(&o, "ann", other, to, ERROR_NONE);
    end(&o);
    begin(&o, p, true);
    expect_checked(&o, "ben", to, ERROR_NONE);
    expect_copied(&o, "ben", from, to, ERROR_NONE);
    end(&o);
    begin(&o, p, false);
    expect_checked(&o, "ann", to, ERROR_OUTPUT_TAKEN); /* now the report is ben's */
    assert_int_equal(unlink(report), 0);
    expect_checked(&o, "ann", to, ERROR_NONE);
    expect_copied(&o, "ann", other, to, ERROR_NONE);
    free(from);
    free(other);
    free(to);
    free(alias);
    free(report);
    free(file);
    end(&o);
}

static void test_a_report_that_no_job_delivered_has_no_owner(void **state)
{
    place *p = *state;
    outputs o;
    begin(&o, p, false);
    char *from = make_result(p, "result", 10), *to = make_result(p, "show/by hand", 11);
    expect_checked(&o, "ben", to, ERROR_NONE);
    expect_copied(&o, "ben", from, to, ERROR_NONE);
    free(from);
    free(to);
    end(&o);
}

static void test_a_file_system_that_does_not_respond_is_unwritable(void **state)
{
    place *p = *state;
    outputs o;
    begin(&o, p, false);
    char *to = mem_printf("%s/a", o.root);
    disk.hangs = true;
    expect_checked(&o, "ann", to, ERROR_OUTPUT_UNWRITABLE);
    output_place_check_roots(o.place);
    assert_string_equal(output_place_unwritable(o.place), o.root);
    pthread_mutex_lock(&disk.mutex);
    disk.hangs = false;
    pthread_cond_broadcast(&disk.changed);
    while (disk.waiting) pthread_cond_wait(&disk.changed, &disk.mutex);
    pthread_mutex_unlock(&disk.mutex);
    expect_checked(&o, "ann", to, ERROR_NONE);
    assert_null(output_place_unwritable(o.place)); /* it responds again */
    free(to);
    end(&o);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_copies_into_one_directory_run_one_after_another),
        CASE(test_a_directory_belongs_to_the_user_whose_report_is_there),
        CASE(test_a_report_that_no_job_delivered_has_no_owner),
        CASE(test_a_file_system_that_does_not_respond_is_unwritable),
    };
    sqlite3_auto_extension((void (*)(void))note_connection);
    log_set_level(LOG_LEVEL_ERROR); /* hides the expected warning about the root that is not writable */
    return cmocka_run_group_tests_name("output_place", tests, NULL, NULL);
}
