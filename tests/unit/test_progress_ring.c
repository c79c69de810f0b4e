// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "service/executor/progress_ring.h"

static void test_lines_of_one_job(void **state)
{
    (void)state;
    progress_ring *r = progress_ring_new();
    progress_ring_line *lines;
    int64_t newest = -1;
    assert_int_equal(progress_ring_list(r, NULL, NULL, 0, 9, &lines, &newest), 0);
    assert_int_equal(newest, 0);
    progress_ring_lines_free(lines, 0);
    progress_ring_add(r, "one", "alice", 7, 2, "{\"a\":1}");
    progress_ring_add(r, "two", "bob", 8, 1, "{\"b\":1}");
    progress_ring_add(r, "one", "alice", 7, 2, "{\"a\":2}");
    assert_int_equal(progress_ring_list(r, "one", NULL, 0, 1, &lines, &newest), 1);
    assert_string_equal(lines[0].text, "{\"a\":1}");
    assert_int_equal(lines[0].frame, 7);
    assert_int_equal(lines[0].attempt, 2);
    progress_ring_lines_free(lines, 1);
    assert_int_equal(progress_ring_list(r, "one", NULL, newest, 9, &lines, &newest), 1);
    assert_string_equal(lines[0].text, "{\"a\":2}");
    assert_int_equal(newest, 3);
    progress_ring_lines_free(lines, 1);
    assert_int_equal(progress_ring_list(r, NULL, NULL, 0, 9, &lines, &newest), 3);
    progress_ring_lines_free(lines, 3);
    assert_int_equal(progress_ring_list(r, NULL, "bob", 0, 9, &lines, &newest), 1);
    assert_string_equal(lines[0].id, "two");
    progress_ring_lines_free(lines, 1);
    /* a number from before a restart */
    assert_int_equal(progress_ring_list(r, NULL, NULL, 1000, 9, &lines, &newest), 0);
    assert_int_equal(newest, 3);
    progress_ring_lines_free(lines, 0);
    progress_ring_free(r);
}

static void test_the_oldest_lines_are_replaced(void **state)
{
    (void)state;
    progress_ring *r = progress_ring_new();
    progress_ring_line *lines;
    int64_t newest;
    char text[32];
    for (int i = 1; i <= PROGRESS_RING_LINES + 10; i++) {
        snprintf(text, sizeof text, "%d", i);
        progress_ring_add(r, "job", "alice", 0, 1, text);
    }
    size_t count = progress_ring_list(r, "job", NULL, 5, 2 * PROGRESS_RING_LINES, &lines, &newest);
    assert_int_equal(count, PROGRESS_RING_LINES);
    assert_int_equal(lines[0].number, 11);
    assert_string_equal(lines[0].text, "11");
    assert_int_equal(newest, PROGRESS_RING_LINES + 10);
    progress_ring_lines_free(lines, count);
    progress_ring_free(r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines_of_one_job),
        cmocka_unit_test(test_the_oldest_lines_are_replaced),
    };
    return cmocka_run_group_tests_name("progress_ring", tests, NULL, NULL);
}
