// SPDX-License-Identifier: Apache-2.0
/* Records as lines and as fields of a journal that this test replaces. `make bootcheck` tests the journal of
 * systemd.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/log.h"

/* ---- the journal */

static bool takes_records;
static char taken[8192]; /* received fields, each with a line break after it */

static bool write_journal(const struct iovec *fields, size_t count)
{
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        memcpy(taken + used, fields[i].iov_base, fields[i].iov_len);
        used += fields[i].iov_len;
        taken[used++] = '\n';
    }
    taken[used] = '\0';
    return takes_records;
}

/* ---- standard error, while something is logged */

static char lines[8192];

static int saved_stderr;
static FILE *captured;

static void begin_capture(void)
{
    captured = tmpfile();
    assert_non_null(captured);
    saved_stderr = dup(STDERR_FILENO);
    dup2(fileno(captured), STDERR_FILENO);
}

static void end_capture(void)
{
    dup2(saved_stderr, STDERR_FILENO);
    close(saved_stderr);
    rewind(captured);
    lines[fread(lines, 1, sizeof lines - 1, captured)] = '\0';
    fclose(captured);
}

static void test_lines(void **state)
{
    (void)state;
    log_set_journal(NULL);
    begin_capture();
    log_write(LOG_LEVEL_WARNING, "one\nline\x7f\tof \xE2\x80\xAE\xC2\x9B\x9B job=%s\n", "x");
    log_write(LOG_LEVEL_DEBUG, "not at this level");
    end_capture();
    assert_string_equal(lines + strlen("2026-01-01T00:00:00.000Z"),
                        " warning one\\u{a}line\\u{7f}\tof \\u{202e}\\u{9b}\\x{9b} job=x\n");
}

static void test_long_records_are_truncated(void **state)
{
    (void)state;
    char longest[5000];
    memset(longest, 'a', sizeof longest);
    longest[sizeof longest - 1] = '\0';
    log_set_journal(NULL);
    begin_capture();
    log_write(LOG_LEVEL_INFO, "%s", longest);
    end_capture();
    assert_in_range(strlen(lines), 2000, 2100);
    assert_string_equal(lines + strlen(lines) - 5, "a...\n");
}

static void test_fields(void **state)
{
    (void)state;
    log_set_journal(write_journal);
    takes_records = true;
    begin_capture();
    log_write(LOG_LEVEL_ERROR, "attempt not settled job=01abc attempt=3: no job=forged\n worker=7");
    end_capture();
    assert_string_equal(lines, "");
    assert_string_equal(taken,
                        "PRIORITY=3\nSYSLOG_IDENTIFIER=hexad\n"
                        "MESSAGE=attempt not settled job=01abc attempt=3: no job=forged\\u{a} worker=7\n"
                        "HEXAD_JOB=01abc\nHEXAD_ATTEMPT=3\nHEXAD_WORKER=7\n");
    log_write(LOG_LEVEL_INFO, "nothing of the kind");
    assert_string_equal(taken, "PRIORITY=6\nSYSLOG_IDENTIFIER=hexad\nMESSAGE=nothing of the kind\n");
}

static void test_invalid_field_values_are_omitted(void **state)
{
    (void)state;
    log_set_journal(write_journal);
    takes_records = true;
    log_write(LOG_LEVEL_INFO, "x job=%080d attempt=1", 7);
    assert_null(strstr(taken, "HEXAD_JOB"));
    assert_non_null(strstr(taken, "HEXAD_ATTEMPT=1\n"));
}

static void test_a_missing_journal_falls_back_to_lines(void **state)
{
    (void)state;
    log_set_journal(write_journal);
    takes_records = false;
    begin_capture();
    log_write(LOG_LEVEL_INFO, "still said");
    end_capture();
    assert_non_null(strstr(lines, " info still said\n"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines),
        cmocka_unit_test(test_long_records_are_truncated),
        cmocka_unit_test(test_fields),
        cmocka_unit_test(test_invalid_field_values_are_omitted),
        cmocka_unit_test(test_a_missing_journal_falls_back_to_lines),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
