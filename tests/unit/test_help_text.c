// SPDX-License-Identifier: Apache-2.0
/* Unit tests of base/core/help_text. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "base/core/help_text.h"

static void expect_item(size_t column, const char *term, const char *text, bool brief, const char *expected)
{
    char *printed = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&printed, &size);
    help_text_item(file, column, term, text, brief);
    fclose(file);
    assert_string_equal(printed, expected);
    free(printed);
}

static void terms_and_texts_have_columns_of_their_own(void **state)
{
    (void)state;
    expect_item(13, "--count N", "the number of points", false, "  --count N  the number of points\n");
    expect_item(12, "--count N", "the number of points", false,
                "  --count N\n            the number of points\n");
}

static void short_help_has_first_sentences_and_no_options(void **state)
{
    (void)state;
    expect_item(14, "show ID [--picture FILE]", "print a job. With --picture a.png its preview", true,
                "  show ID     print a job\n");
    expect_item(14, "show ID", "print a.png.", true, "  show ID     print a.png\n");
}

static void lines_break_at_spaces(void **state)
{
    (void)state;
    enum { WORDS = 60 };
    char text[WORDS * 5] = "", *printed = NULL;
    size_t size = 0, words = 0, lines = 0;
    for (int i = 0; i < WORDS; i++) strcat(text, i ? " word" : "word");
    FILE *file = open_memstream(&printed, &size);
    help_text_wrap(file, "# ", text);
    fclose(file);
    for (char *line = strtok(printed, "\n"); line; line = strtok(NULL, "\n"), lines++) {
        assert_in_range(strlen(line), 1, HELP_TEXT_COLUMNS);
        assert_memory_equal(line, "# word", 6);
        assert_string_equal(line + strlen(line) - 4, "word");
        words += (strlen(line) - 1) / 5;
    }
    assert_int_equal(words, WORDS);
    assert_int_equal(lines, 4); /* 19 words of 4 letters and a space fit behind the indent */
    free(printed);
}

static void words_longer_than_a_line_stay_whole(void **state)
{
    (void)state;
    char word[HELP_TEXT_COLUMNS + 2] = "";
    memset(word, 'w', sizeof word - 1);
    char *printed = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&printed, &size);
    help_text_wrap(file, "", word);
    fclose(file);
    assert_int_equal(size, sizeof word);
    assert_memory_equal(printed, word, sizeof word - 1);
    free(printed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(terms_and_texts_have_columns_of_their_own),
        cmocka_unit_test(short_help_has_first_sentences_and_no_options),
        cmocka_unit_test(lines_break_at_spaces),
        cmocka_unit_test(words_longer_than_a_line_stay_whole),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
