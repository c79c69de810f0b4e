// SPDX-License-Identifier: Apache-2.0
/* Unit tests of base/core/reader: no process remains after a failed start; a process ends when its caller needs it no
 * longer; findings of sanitizers in the process of the reader.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/core/reader.h"
#include "base/core/sandbox.h"

static bool fdopen_fails;

/* Replaces the function of the C library. */
FILE *fdopen(int fd, const char *mode)
{
    FILE *(*of_library)(int, const char *);
    *(void **)&of_library = dlsym(RTLD_NEXT, "fdopen");
    if (!fdopen_fails) return of_library(fd, mode);
    errno = ENOMEM;
    return NULL;
}

/* The process of the reader is this program with the command "read". */
static int read_as(const char *fault)
{
    volatile int number = INT_MAX;
    volatile char *block = malloc(strlen(fault));
    if (strcmp(fault, "address") == 0) number = block[strlen(fault)];
    if (strcmp(fault, "undefined") == 0) number++;
    free((void *)block);
    return number == 0;
}

/* CPU time, in s, after which a reader that does not end is stopped. The error is then another one. */
enum { COMPUTES_S = 5 };

/* A process with this command computes until something ends it. */
static int compute(int argc, char **argv)
{
    volatile unsigned number = 0;
    if (!reader_limit(argc, argv, STDERR_FILENO + 1) || !reader_write("x", 1)) return 1;
    for (;;) number++;
}

/* Whether a computing reader ends without an error when the caller needs no more of it. fd: see reader_params */
static bool ends_a_computation(int fd, bool begun)
{
    const reader_params params = {
        .command = "compute", .argument = "", .fd = fd, .memory_limit = 1 << 26, .seconds = COMPUTES_S};
    reader r = {0};
    error e = {0};
    if (!reader_start(&params, &r, &e) || fgetc(r.stream) != 'x') return false;
    r.begun = begun;
    return !reader_end(&r, false, &e) && e.code == ERROR_NONE;
}

static void test_a_reader_that_computes_ends_when_its_output_is_closed(void **state)
{
    (void)state;
    for (int k = 0; k < 4; k++) assert_true(ends_a_computation(k % 2 ? STDIN_FILENO : -1, k / 2));
}

/* No process can signal another one there. */
static void test_a_reader_in_the_sandbox_ends_when_its_output_is_closed(void **state)
{
    (void)state;
    int status = 0;
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        bool ok = sandbox_enter(SANDBOX_AVAILABLE, &(sandbox_places){0}, NULL);
        for (int k = 0; ok && k < 4; k++) ok = ends_a_computation(k % 2 ? STDIN_FILENO : -1, k / 2);
        _exit(ok ? 0 : 1);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
}

static void test_a_reader_without_a_stream_leaves_no_process(void **state)
{
    (void)state;
    reader r = {0};
    error e = {0};
    fdopen_fails = true;
    assert_false(reader_start(
        &(reader_params){.program = "/bin/cat", .command = "-", .argument = "-", .fd = -1}, &r, &e));
    fdopen_fails = false;
    assert_non_null(strstr(e.message, strerror(ENOMEM)));
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1);
    assert_int_equal(errno, ECHILD);
}

static error_code error_of(const char *fault, bool begun, bool ok)
{
    reader r = {0};
    error e = {.code = ERROR_INPUT_DAMAGED};
    assert_true(reader_start(&(reader_params){.command = "read", .argument = fault, .fd = -1}, &r, &e));
    assert_int_equal(fgetc(r.stream), EOF);
    r.begun = begun;
    return reader_end(&r, ok, &e) ? ERROR_NONE : e.code;
}

static void test_a_finding_of_a_sanitizer_is_an_internal_error(void **state)
{
    (void)state;
    assert_int_equal(error_of("none", false, true), ERROR_NONE);
#ifdef __SANITIZE_ADDRESS__
    assert_int_equal(error_of("address", false, false), ERROR_INTERNAL);
    assert_int_equal(error_of("address", true, false), ERROR_INTERNAL); /* the answer is incomplete */
    assert_int_equal(error_of("undefined", false, false), ERROR_INTERNAL);
#endif
}

int main(int argc, char **argv)
{
    if (argc > 2 && strcmp(argv[1], "read") == 0) return read_as(argv[2]);
    if (argc > 2 && strcmp(argv[1], "compute") == 0) return compute(argc - 1, argv + 1);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_reader_without_a_stream_leaves_no_process),
        cmocka_unit_test(test_a_reader_that_computes_ends_when_its_output_is_closed),
        cmocka_unit_test(test_a_reader_in_the_sandbox_ends_when_its_output_is_closed),
        cmocka_unit_test(test_a_finding_of_a_sanitizer_is_an_internal_error)};
    return cmocka_run_group_tests_name("reader", tests, NULL, NULL);
}
