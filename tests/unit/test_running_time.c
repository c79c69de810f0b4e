// SPDX-License-Identifier: Apache-2.0
/* Unit tests of base/core/running_time, and of the watch of the wall clock in base/core/clock. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "set_clock.h"

#include "base/core/clock.h"
#include "base/core/running_time.h"

#define HOUR INT64_C(3600000)
#define DAY (24 * HOUR)

/* Starts the program again after a time without it. */
static running_time *start_again(running_time *t)
{
    running_period periods[RUNNING_PERIODS_MOST];
    size_t count = running_time_list(t, periods);
    running_time_free(t);
    return running_time_new(periods, count);
}

static void test_the_wall_clock_counts_for_objects_of_this_run(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    int64_t began = clock_wall_ms();
    assert_false(running_time_is_over(t, began, 10000));
    pass(9000);
    assert_false(running_time_is_over(t, began, 10000));
    pass(1000);
    assert_true(running_time_is_over(t, began, 10000));
    running_time_free(t);
}

static void test_a_clock_that_is_set_forward_ends_nothing(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    pass(DAY);
    int64_t began = clock_wall_ms();
    pass(HOUR);
    assert_true(running_time_is_over(t, began, HOUR));
    step_wall(365 * DAY);
    assert_false(running_time_is_over(t, began, DAY));
    /* its time was over, but within the hour after a step */
    assert_false(running_time_is_over(t, began, HOUR));
    int64_t later = clock_wall_ms();
    pass(HOUR);
    assert_true(running_time_is_over(t, began, HOUR));
    assert_false(running_time_is_over(t, began, DAY));
    pass(21 * HOUR);
    assert_false(running_time_is_over(t, began, DAY));
    pass(HOUR);
    assert_true(running_time_is_over(t, began, DAY));
    assert_false(running_time_is_over(t, later, DAY));
    step_wall(-365 * DAY);
    pass(HOUR);
    assert_true(running_time_is_over(t, began, DAY));
    assert_false(running_time_is_over(t, later, DAY)); /* not over by the wall clock */
    running_time_free(t);
}

static void test_a_start_counts_the_time_that_the_program_ran(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    pass(DAY);
    int64_t began = clock_wall_ms();
    pass(DAY);
    t = start_again(t);
    step_wall(365 * DAY);
    pass(2 * HOUR);
    t = start_again(t);
    assert_false(running_time_is_over(t, began, HOUR));
    pass(HOUR);
    assert_true(running_time_is_over(t, began, DAY + 3 * HOUR));
    assert_false(running_time_is_over(t, began, DAY + 3 * HOUR + 1000));
    /* created before the first start of the program */
    assert_false(running_time_is_over(t, began - 365 * DAY, 3 * DAY));
    running_time_free(t);
}

static void test_a_clock_that_is_set_back_ends_nothing_early(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    pass(10 * DAY);
    int64_t began = clock_wall_ms();
    assert_false(running_time_is_over(t, began, HOUR));
    step_wall(-5 * DAY);
    pass(5 * DAY);
    assert_false(running_time_is_over(t, began, HOUR));
    pass(HOUR);
    assert_true(running_time_is_over(t, began, HOUR));
    assert_false(running_time_is_over(t, began, 2 * HOUR));
    running_time_free(t);
}

static void test_a_small_step_changes_nothing(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    int64_t began = clock_wall_ms();
    step_wall(RUNNING_STEP_MS - 1000);
    assert_true(running_time_is_over(t, began, RUNNING_STEP_MS - 1000));
    running_time_free(t);
}

static void test_more_starts_than_periods_lose_no_running_time(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    int64_t began = clock_wall_ms();
    const int starts = 4 * RUNNING_PERIODS_MOST;
    for (int i = 0; i < starts; i++) {
        pass(2 * HOUR);
        t = start_again(t);
    }
    pass(2 * HOUR);
    assert_true(running_time_is_over(t, began, 2 * HOUR * (starts + 1)));
    assert_false(running_time_is_over(t, began, 2 * HOUR * (starts + 1) + 1000));
    running_time_free(t);
}

/* A daemon that is stopped for a minute every day, and once for a month. */
static void test_daily_starts_keep_longer_by_little_more_than_the_stops(void **state)
{
    (void)state;
    running_time *t = running_time_new(NULL, 0);
    int64_t began = 0;
    for (int day = 0; day < 200; day++) {
        if (day == 90) began = clock_wall_ms();
        pass(DAY);
        running_period periods[RUNNING_PERIODS_MOST];
        size_t count = running_time_list(t, periods);
        running_time_free(t);
        pass(day == 150 ? 30 * DAY : 60000);
        t = running_time_new(periods, count);
    }
    pass(HOUR);
    assert_true(running_time_is_over(t, began, 110 * DAY));
    /* the daemon did not run for longer */
    assert_false(running_time_is_over(t, began, 110 * DAY + HOUR + 1000));
    running_time_free(t);
}

static void test_a_clock_set_back_is_reported_once(void **state)
{
    (void)state;
    clock_watch w = CLOCK_WATCH;
    assert_true(clock_was_set_back(&w));
    assert_false(clock_was_set_back(&w));
    pass(HOUR);
    assert_false(clock_was_set_back(&w));
    step_wall(HOUR);
    assert_false(clock_was_set_back(&w));
    step_wall(-5000);
    assert_true(clock_was_set_back(&w));
    assert_false(clock_was_set_back(&w));
}

int main(void)
{
    stop_clocks();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_wall_clock_counts_for_objects_of_this_run),
        cmocka_unit_test(test_a_clock_that_is_set_forward_ends_nothing),
        cmocka_unit_test(test_a_start_counts_the_time_that_the_program_ran),
        cmocka_unit_test(test_a_clock_that_is_set_back_ends_nothing_early),
        cmocka_unit_test(test_a_small_step_changes_nothing),
        cmocka_unit_test(test_more_starts_than_periods_lose_no_running_time),
        cmocka_unit_test(test_daily_starts_keep_longer_by_little_more_than_the_stops),
        cmocka_unit_test(test_a_clock_set_back_is_reported_once),
    };
    return cmocka_run_group_tests_name("running_time", tests, NULL, NULL);
}
