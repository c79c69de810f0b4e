// SPDX-License-Identifier: Apache-2.0
/* Texts from others as terminals show them. The list tests/terminal_text.tsv is also the list of
 * tests/service/test_terminal_text.py. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "base/json/json.h"

enum { BYTES_MOST = 64 };

/* A row of the list. */
typedef struct row {
    char bytes[BYTES_MOST + 1];
    size_t length;
    char *shown, *what;
} row;

static row read_row(char *line)
{
    row r = {.shown = strchr(line, '\t') + 1};
    r.what = strchr(r.shown, '\t') + 1;
    r.what[-1] = r.shown[-1] = r.what[strcspn(r.what, "\n")] = '\0';
    for (const char *digits = line; *digits; digits += 2) {
        unsigned value;
        assert_in_range(r.length, 0, BYTES_MOST - 1);
        assert_int_equal(sscanf(digits, "%2x", &value), 1);
        r.bytes[r.length++] = (char)value;
    }
    return r;
}

/* Calls `check` for each row; returns their number. */
static size_t for_each_row(void (*check)(const row *r))
{
    const char *source = getenv("HEXAD_SOURCE");
    char *path = mem_printf("%s/tests/terminal_text.tsv", source ? source : "."), *line = NULL;
    FILE *list = fopen(path, "r");
    size_t capacity = 0, count = 0;
    assert_non_null(list);
    while (getline(&line, &capacity, list) > 0) {
        if (*line == '#') continue;
        const row r = read_row(line);
        check(&r);
        count++;
    }
    fclose(list);
    free(line);
    free(path);
    return count;
}

/* What terminal_text_write writes; the caller frees it. */
static char *written(terminal_text_form form, const char *text, size_t length)
{
    char *result = NULL;
    size_t size;
    FILE *file = open_memstream(&result, &size);
    terminal_text_write(file, form, text, length);
    fclose(file);
    return result;
}

static void check_shown(const row *r)
{
    char *once = written(TERMINAL_TEXT_LINE, r->bytes, r->length),
         *twice = written(TERMINAL_TEXT_LINE, once, strlen(once));
    if (strcmp(once, r->shown) != 0) fail_msg("%s: \"%s\" instead of \"%s\"", r->what, once, r->shown);
    assert_string_equal(twice, once);
    free(once);
    free(twice);
}

static void texts_of_the_list_are_shown(void **state)
{
    (void)state;
    assert_in_range(for_each_row(check_shown), 50, SIZE_MAX);
}

/* A text as a member of a printed document, whose value is the same after the escapes. */
static void check_json(const row *r)
{
    error e = {0};
    if (strlen(r->bytes) != r->length) return; /* strings of the tree end at byte 0 */
    json *document = json_new_object(), *again;
    json_put_string(document, "text", r->bytes);
    char *text = json_print_pretty(document), *safe = written(TERMINAL_TEXT_JSON, text, strlen(text)),
         *page = written(TERMINAL_TEXT_PAGE, safe, strlen(safe));
    assert_string_equal(page, safe);
    again = json_parse(safe, strlen(safe), &e);
    if (again) {
        char *same = json_print_pretty(again);
        assert_string_equal(same, text);
        free(same);
    } else {
        assert_string_equal(safe, text);
    }
    json_free(again);
    json_free(document);
    free(text);
    free(safe);
    free(page);
}

static void json_keeps_its_values(void **state)
{
    (void)state;
    for_each_row(check_json);
}

static void check_form(terminal_text_form form, const char *text, const char *expected)
{
    char *result = written(form, text, strlen(text));
    assert_string_equal(result, expected);
    free(result);
}

static void forms_keep_tabs_and_line_breaks(void **state)
{
    (void)state;
    check_form(TERMINAL_TEXT_LINE, "a\tb\nc\r", "a\\u{9}b\\u{a}c\\u{d}");
    check_form(TERMINAL_TEXT_RECORD, "a\tb\nc\r", "a\tb\\u{a}c\\u{d}");
    check_form(TERMINAL_TEXT_PAGE, "a\tb\nc\r", "a\tb\nc\\u{d}");
    check_form(TERMINAL_TEXT_JSON, "a\tb\nc\r", "a\tb\nc\\u000d");
    check_form(TERMINAL_TEXT_JSON, "\xF3\xA0\x81\xA1", "\\udb40\\udc61");
}

static void formatted_text_keeps_line_breaks_of_the_format(void **state)
{
    (void)state;
    char *result = NULL;
    size_t size;
    FILE *file = open_memstream(&result, &size);
    terminal_text_print(file, "%s: %d\n\n", "a\nb\x1b", 7);
    terminal_text_print(file, "%s", "c\n");
    fclose(file);
    assert_string_equal(result, "a\\u{a}b\\u{1b}: 7\n\nc\\u{a}");
    free(result);
}

static void copies_end_after_a_whole_character(void **state)
{
    (void)state;
    char to[8];
    assert_int_equal(terminal_text_copy(to, sizeof to, TERMINAL_TEXT_LINE, "abcdef\xC3\xA4z"), 9);
    assert_string_equal(to, "abcdef");
    assert_int_equal(terminal_text_copy(to, sizeof to, TERMINAL_TEXT_LINE,
                                        "ab\x1b"
                                        "cd"),
                     10);
    assert_string_equal(to, "ab");
    assert_int_equal(terminal_text_copy(to, sizeof to, TERMINAL_TEXT_LINE, "abcdefg"), 7);
    assert_string_equal(to, "abcdefg");
}

static void new_text_is_complete(void **state)
{
    (void)state;
    char *text = terminal_text_new("\x9b\xE2\x80\xAE");
    assert_string_equal(text, "\\x{9b}\\u{202e}");
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(texts_of_the_list_are_shown),
        cmocka_unit_test(json_keeps_its_values),
        cmocka_unit_test(forms_keep_tabs_and_line_breaks),
        cmocka_unit_test(formatted_text_keeps_line_breaks_of_the_format),
        cmocka_unit_test(copies_end_after_a_whole_character),
        cmocka_unit_test(new_text_is_complete),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
