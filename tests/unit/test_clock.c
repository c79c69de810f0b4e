// SPDX-License-Identifier: Apache-2.0
/* Unit tests of base/core/clock: times as texts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "base/core/clock.h"

static void test_a_printed_time_is_parsed_to_the_same_time(void **state)
{
    (void)state;
    static const int64_t times[] = {0, 1, 951782400123, 1763712000000, 4102444799999};
    for (size_t i = 0; i < sizeof times / sizeof *times; i++) {
        char text[CLOCK_TEXT_SIZE];
        int64_t read = -1;
        assert_true(clock_parse_utc(clock_format_utc(times[i], text), &read));
        assert_int_equal(read, times[i]);
    }
}

static void test_parts_and_offsets(void **state)
{
    (void)state;
    static const char *const same[] = {"2026-01-31",
                                       "2026-01-31T00:00",
                                       "2026-01-31T00:00:00",
                                       "2026-01-31T00:00:00.0Z",
                                       "2026-01-31t02:00+02:00",
                                       "2026-01-30T18:30:00-05:30",
                                       "2026-01-31T00:00:00.0004Z"};
    for (size_t i = 0; i < sizeof same / sizeof *same; i++) {
        int64_t read = -1;
        assert_true(clock_parse_utc(same[i], &read));
        assert_int_equal(read, 1769817600000);
    }
}

static void test_texts_that_are_no_times_are_refused(void **state)
{
    (void)state;
    static const char *const wrong[] = {"",
                                        "yesterday",
                                        "2026",
                                        "2026-13-01",
                                        "2026-02-30",
                                        "2026-01-31T25:00",
                                        "2026-01-31T00:00:00ZZ",
                                        "2026-01-31T00:00:00+2",
                                        "2026-01-31T00:00:00.Z",
                                        "2026-01-31 00:00",
                                        "2026-01-31T00:00:00+02:0-",
                                        "2026-01-31T"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        int64_t read = -7;
        assert_false(clock_parse_utc(wrong[i], &read));
        assert_int_equal(read, -7);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_printed_time_is_parsed_to_the_same_time),
        cmocka_unit_test(test_parts_and_offsets),
        cmocka_unit_test(test_texts_that_are_no_times_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
