/* Unit tests of base/reader: what is left when it does not start. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

#include "base/reader.h"

/* Takes the place of the C library's function. */
FILE *fdopen(int fd, const char *mode)
{
    (void)fd;
    (void)mode;
    errno = ENOMEM;
    return NULL;
}

static void test_a_reader_without_a_stream_leaves_no_process(void **state)
{
    (void)state;
    reader r = {0};
    error e = {0};
    assert_false(reader_start(
        &(reader_params){.program = "/bin/cat", .command = "-", .argument = "-", .fd = -1}, &r, &e));
    assert_non_null(strstr(e.message, strerror(ENOMEM)));
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1);
    assert_int_equal(errno, ECHILD);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_a_reader_without_a_stream_leaves_no_process)};
    return cmocka_run_group_tests_name("reader", tests, NULL, NULL);
}
