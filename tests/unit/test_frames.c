// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "base/core/frames.h"

static void expect(const char *text, const int *numbers, size_t expected)
{
    size_t count = 0;
    error e = {0};
    int *found = frames_parse(text, &count, &e);
    if (!found) fail_msg("%s: %s", text, e.message);
    assert_int_equal(count, expected);
    assert_memory_equal(found, numbers, expected * sizeof *numbers);
    free(found);
}

static void expect_refused(const char *text, const char *words)
{
    size_t count = 0;
    error e = {0};
    assert_null(frames_parse(text, &count, &e));
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    if (!strstr(e.message, words)) fail_msg("%s: %s", text, e.message);
}

static void test_numbers(void **state)
{
    (void)state;
    expect("7", (const int[]){7}, 1);
    expect("0", (const int[]){0}, 1);
    expect("0010-0013", (const int[]){10, 11, 12, 13}, 4);
    expect("1-10x4", (const int[]){1, 5, 9}, 3);
    expect("20,1-3,999999999", (const int[]){20, 1, 2, 3, 999999999}, 5);
    expect("5-5x100", (const int[]){5}, 1);
}

static void test_malformed_numbers_are_refused(void **state)
{
    (void)state;
    static const char *const bad[] = {"",     "a",   "1-",         "-3",     "3-1",  "1-3x0",
                                      "1-3x", "1,",  ",1",         "1 2",    "1--2", "1-2-3",
                                      "1x2",  "1.5", "1000000000", "1-10,x", "\xff"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) expect_refused(bad[i], "given");
    expect_refused("1-10,5", "frame 5 is listed twice");
    expect_refused("1-100001", "at most 100000");
    size_t count = 0;
    int *most = frames_parse("1-100000", &count, NULL);
    assert_int_equal(count, 100000);
    free(most);
    expect_refused("1-999999999,1-999999999", "at most 100000");
}

static void expect_printed(const char *expected, const int *numbers, size_t count)
{
    char *text = frames_print(numbers, count);
    assert_string_equal(text, expected);
    expect(text, numbers, count);
    free(text);
}

static void test_numbers_are_printed_as_ranges(void **state)
{
    (void)state;
    expect_printed("7", (const int[]){7}, 1);
    expect_printed("1-3", (const int[]){1, 2, 3}, 3);
    expect_printed("1-2,9", (const int[]){1, 2, 9}, 3);
    expect_printed("1,5", (const int[]){1, 5}, 2);
    expect_printed("1-9x4,10,12-15", (const int[]){1, 5, 9, 10, 12, 13, 14, 15}, 8);
    expect_printed("0,2-3", (const int[]){0, 2, 3}, 3);
}

static void expect_path(const char *pattern, int frame, const char *expected)
{
    char *path = frames_path(pattern, frame);
    assert_string_equal(path, expected);
    free(path);
}

static void test_paths(void **state)
{
    (void)state;
    expect_path("a/b.####.vdb", 7, "a/b.0007.vdb");
    expect_path("a/b.####.vdb", 123456, "a/b.123456.vdb");
    expect_path("b.#", 12, "b.12");
    expect_path("b.%04d.vdb", 7, "b.0007.vdb");
    expect_path("b.%d.vdb", 7, "b.7.vdb");
    expect_path("b.$F4.vdb", 7, "b.0007.vdb");
    expect_path("b_$F_v2.vdb", 12345, "b_12345_v2.vdb");
    expect_path("b.$F9", 7, "b.000000007");
    expect_path("plain", 7, "plain");
    expect_path("%s%n%%%05d", 7, "%s%n%%00007"); /* other conversions are plain text */
    char **paths = frames_paths("a.%03d.tif", (const int[]){8, 12, 1234}, 3);
    static const char *const expected[] = {"a.008.tif", "a.012.tif", "a.1234.tif"};
    for (size_t k = 0; k < 3; k++) {
        assert_string_equal(paths[k], expected[k]);
        free(paths[k]);
    }
    free(paths);
    assert_true(frames_is_pattern("x.%03d"));
    assert_false(frames_is_pattern("100%.vdb"));
    assert_false(frames_is_pattern("%0d%"));
    static const char *const others[] = {"$FF.vdb", "$FPS",  "$FSTART.vdb", "$FEND", "$F0.vdb",
                                         "$F12",    "$f4.x", "$",           "$4"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (frames_is_pattern(others[i])) fail_msg("%s", others[i]);
}

static void test_a_path_is_matched_with_a_pattern(void **state)
{
    (void)state;
    int frame = -1;
    assert_int_equal(frames_prefix("a/b.$F4.vdb"), 4);
    assert_int_equal(frames_shared("/a/b/c.####"), 5);
    char *above = frames_above("/a/%d/b");
    assert_string_equal(above, "/a");
    free(above);
    assert_null(frames_above("/####"));
    assert_null(frames_above("/a/b"));
    assert_true(frames_is_stage("points_stage.usda") && !frames_is_stage("_stage.usda") &&
                !frames_is_stage("points.usda"));
    assert_int_equal(frames_shared("/a/%d/b"), 3);
    assert_int_equal(frames_shared("$F/b"), 0);
    assert_true(frames_match("b.####.vdb", "b.0007.vdb", &frame));
    assert_int_equal(frame, 7);
    assert_true(frames_match("b$F.vdb", "b123456.vdb", &frame));
    assert_int_equal(frame, 123456);
    static const char *const others[] = {"b.7.vdb",    "b.00007.vdb", "b.0007.vd",        "b.0007.vdb2",
                                         "c.0007.vdb", "b.",          "b.9999999999.vdb", "b.-007.vdb"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (frames_match("b.####.vdb", others[i], &frame)) fail_msg("%s", others[i]);
    assert_int_equal(frame, 123456);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_numbers),
        cmocka_unit_test(test_malformed_numbers_are_refused),
        cmocka_unit_test(test_numbers_are_printed_as_ranges),
        cmocka_unit_test(test_paths),
        cmocka_unit_test(test_a_path_is_matched_with_a_pattern),
    };
    return cmocka_run_group_tests_name("frames", tests, NULL, NULL);
}
