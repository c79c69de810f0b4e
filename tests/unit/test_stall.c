// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "base/core/log.h"
#include "base/core/stall.h"

static int records;
static char newest[256]; /* message of the newest record */

static bool keep_record(const struct iovec *fields, size_t count)
{
    static const char message[] = "MESSAGE=";
    records++;
    for (size_t i = 0; i < count; i++)
        if (strncmp(fields[i].iov_base, message, strlen(message)) == 0) {
            memcpy(newest, fields[i].iov_base, fields[i].iov_len);
            newest[fields[i].iov_len] = '\0';
        }
    return true;
}

static void a_stall_and_its_end_are_logged_once(void **state)
{
    (void)state;
    stall s = {.loop = "the loop", .effect = "nothing is served"};
    assert_true(stall_check(&s, 7, 1000));
    assert_true(stall_check(&s, 8, 2000));
    assert_int_equal(records, 0);
    assert_false(stall_check(&s, 8, 4500));
    assert_int_equal(records, 1);
    assert_non_null(strstr(newest, "the loop has not advanced for 2.5 s: nothing is served"));
    assert_false(stall_check(&s, 8, 9000));
    assert_int_equal(records, 1);
    assert_true(stall_check(&s, 9, 9500));
    assert_int_equal(records, 2);
    assert_non_null(strstr(newest, "the loop advances again, after 7.5 s"));
    assert_true(stall_check(&s, 10, 9600));
    assert_int_equal(records, 2);
}

static void the_first_check_finds_no_stall(void **state)
{
    (void)state;
    stall s = {.loop = "the loop", .effect = "nothing is served"};
    assert_true(stall_check(&s, 0, 1000));
    assert_false(stall_check(&s, 0, 2000));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_stall_and_its_end_are_logged_once),
        cmocka_unit_test(the_first_check_finds_no_stall),
    };
    log_set_journal(keep_record);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
