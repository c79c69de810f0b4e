// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "service/http/preconditions.h"

static void test_names(void **state)
{
    (void)state;
    assert_true(preconditions_match("\"a\"", "\"a\""));
    assert_true(preconditions_match("\"b\", \"a\"", "\"a\""));
    assert_true(preconditions_match(" , \"b\" ,\"a\"", "\"a\""));
    assert_true(preconditions_match("*", "\"a\""));
    assert_true(preconditions_match("W/\"a\"", "\"a\""));
    assert_true(preconditions_match("W/\"a\", \"a\"", "\"a\""));
    static const char *const others[] = {"", "a", "\"a", "\"b\"", "\"ab\"", "\"b\" nonsense", "W/", "\"\""};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (preconditions_match(others[i], "\"a\"")) fail_msg("%s", others[i]);
}

static void test_ranges(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        int64_t bytes;
        preconditions_range what;
        int64_t first, count;
    } cases[] = {
        {"bytes=0-9", 100, PRECONDITIONS_PART, 0, 10},
        {"bytes=0-0", 100, PRECONDITIONS_PART, 0, 1},
        {"bytes=99-", 100, PRECONDITIONS_PART, 99, 1},
        {"bytes=90-1000", 100, PRECONDITIONS_PART, 90, 10},
        {"bytes=-10", 100, PRECONDITIONS_PART, 90, 10},
        {"bytes=-1000", 100, PRECONDITIONS_PART, 0, 100},
        {"BYTES=1-1", 100, PRECONDITIONS_PART, 1, 1},
        {"bytes=100-", 100, PRECONDITIONS_UNSATISFIABLE, 0, 0},
        {"bytes=-0", 100, PRECONDITIONS_UNSATISFIABLE, 0, 0},
        {"bytes=0-", 0, PRECONDITIONS_UNSATISFIABLE, 0, 0},
        {"bytes=-5", 0, PRECONDITIONS_UNSATISFIABLE, 0, 0},
        {NULL, 100, PRECONDITIONS_WHOLE, 0, 0},
        {"", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=-", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=9-0", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=0-1,3-4", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=0-1 ", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=a-b", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"lines=0-1", 100, PRECONDITIONS_WHOLE, 0, 0},
        {"bytes=5-99999999999999999999", 100, PRECONDITIONS_PART, 5, 95},
        {"bytes=0-9223372036854775807", 100, PRECONDITIONS_PART, 0, 100},
        {"bytes=-99999999999999999999", 100, PRECONDITIONS_PART, 0, 100},
        {"bytes=18446744073709551615-", 100, PRECONDITIONS_UNSATISFIABLE, 0, 0},
        {"bytes=18446744073709551615-18446744073709551616", 100, PRECONDITIONS_UNSATISFIABLE, 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int64_t first = 0, count = 0;
        preconditions_range what = preconditions_read_range(cases[i].text, cases[i].bytes, &first, &count);
        if (what != cases[i].what || first != cases[i].first || count != cases[i].count)
            fail_msg("%s: %d %lld %lld", cases[i].text, what, (long long)first, (long long)count);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_names), cmocka_unit_test(test_ranges)};
    return cmocka_run_group_tests_name("preconditions", tests, NULL, NULL);
}
