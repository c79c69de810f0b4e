// SPDX-License-Identifier: Apache-2.0
#include "base/core/help_text.h"

#include <assert.h>
#include <string.h>

enum { TERM_INDENT = 2, TERM_MORE_INDENT = 7 };

const char *option_rank_name(option_rank rank)
{
    static const char *const names[] = {
        [OPTION_BASIC] = "basic", [OPTION_ADVANCED] = "advanced", [OPTION_RESEARCH] = "research"};
    return names[rank];
}

/* The part of the text that fits into a number of columns: up to a space, or the first word. */
static size_t line_length(const char *text, size_t length, size_t columns)
{
    if (length <= columns) return length;
    size_t n = columns;
    while (n > 0 && text[n] != ' ') n--;
    return n > 0 ? n : strcspn(text, " ");
}

/* Prints a text that begins at the column `at`; further lines begin with `indent`. */
static void put_lines(FILE *file, size_t at, const char *indent, const char *text, size_t length)
{
    for (const char *end = text + length; text < end; at = strlen(indent)) {
        const size_t n = line_length(text, (size_t)(end - text), HELP_TEXT_COLUMNS - at);
        fprintf(file, "%.*s\n", (int)n, text);
        text += n + (text + n < end);
        if (text < end) fputs(indent, file);
    }
}

void help_text_wrap(FILE *file, const char *indent, const char *text)
{
    fputs(indent, file);
    put_lines(file, strlen(indent), indent, text, strlen(text));
}

/* The length of the term in front of its first option. */
static size_t length_without_options(const char *term)
{
    const char *option = strstr(term, " [");
    return option ? (size_t)(option - term) : strlen(term);
}

/* The length of the first sentence, without the full stop. */
static size_t first_sentence(const char *text)
{
    const size_t length = strlen(text);
    const char *stop = strstr(text, ". ");
    if (stop) return (size_t)(stop - text);
    return length && text[length - 1] == '.' ? length - 1 : length;
}

void help_text_item(FILE *file, size_t column, const char *term, const char *text, bool brief)
{
    static const char spaces[] = "                              ";
    assert(column < sizeof spaces);
    const char *indent = spaces + sizeof spaces - 1 - column;
    const size_t term_length = brief ? length_without_options(term) : strlen(term);
    const size_t text_length = brief ? first_sentence(text) : strlen(text);
    if (TERM_INDENT + term_length + 2 <= column) {
        fprintf(file, "%*s%-*.*s", TERM_INDENT, "", (int)column - TERM_INDENT, (int)term_length, term);
    } else {
        fprintf(file, "%*s", TERM_INDENT, "");
        put_lines(file, TERM_INDENT, spaces + sizeof spaces - 1 - TERM_MORE_INDENT, term, term_length);
        fputs(indent, file);
    }
    put_lines(file, column, indent, text, text_length);
}
