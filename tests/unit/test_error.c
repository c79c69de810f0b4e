// SPDX-License-Identifier: Apache-2.0
/* Errors: names, context, and truncated messages. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <errno.h>
#include <string.h>
#include <cmocka.h>

#include "base/core/error.h"

static void names_are_stable(void **state)
{
    (void)state;
    assert_string_equal(error_code_name(ERROR_LIMIT_MEMORY), "limit_memory");
    for (int code = 0; code < ERROR_CODE_COUNT; code++)
        assert_int_equal(error_code_from_name(error_code_name((error_code)code)), code);
    assert_int_equal(error_code_from_name("no such code"), ERROR_INTERNAL);
    assert_string_equal(error_code_name((error_code)99), "internal");
}

static void disk_errors_are_distinguished_from_others(void **state)
{
    (void)state;
    assert_int_equal(error_code_of_errno(ENOSPC), ERROR_STORAGE_FULL);
    assert_int_equal(error_code_of_errno(EDQUOT), ERROR_STORAGE_FULL);
    assert_int_equal(error_code_of_errno(EIO), ERROR_STORAGE_FAILED);
    assert_int_equal(error_code_of_errno(EFBIG), ERROR_LIMIT_FILE); /* file_mb */
    assert_true(error_is_of_storage(ERROR_STORAGE_FAILED) && !error_is_of_storage(ERROR_INTERNAL));
}

static void context_comes_first(void **state)
{
    (void)state;
    error e = {0};
    assert_false(error_set(&e, ERROR_NO_SURFACE, "nothing at %g", 0.5));
    assert_false(error_prefix(&e, "grid '%s'", "density"));
    assert_string_equal(e.message, "grid 'density': nothing at 0.5");
    assert_int_equal(e.code, ERROR_NO_SURFACE);
    assert_false(error_set(NULL, ERROR_INTERNAL, "no error object"));
    error none = {0};
    error_prefix(&none, "context");
    assert_string_equal(none.message, "");
}

static void a_truncated_message_is_valid_utf8_on_one_line(void **state)
{
    (void)state;
    char text[3000];
    for (int shift = 0; shift < 4; shift++) {
        memset(text, 'x', sizeof text);
        for (size_t k = (size_t)shift; k + 3 < sizeof text - 1; k += 3) memcpy(text + k, "\xe2\x82\xac", 3);
        text[sizeof text - 1] = '\0';
        error e = {0};
        error_set(&e, ERROR_INTERNAL, "%s", text);
        size_t length = strlen(e.message);
        assert_in_range(length, 1000, sizeof e.message - 1);
        const char *tail = e.message + length - 3;
        assert_true(memcmp(tail, "\xe2\x82\xac", 3) == 0);
    }
    error e = {0};
    error_set(&e, ERROR_INTERNAL, "a\nb\tc");
    assert_string_equal(e.message, "a b c");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(names_are_stable),
                                       cmocka_unit_test(disk_errors_are_distinguished_from_others),
                                       cmocka_unit_test(context_comes_first),
                                       cmocka_unit_test(a_truncated_message_is_valid_utf8_on_one_line)};
    return cmocka_run_group_tests_name("error", tests, NULL, NULL);
}
