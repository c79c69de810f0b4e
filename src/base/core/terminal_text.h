// SPDX-License-Identifier: Apache-2.0
/* terminal_text: text from users, files, the network or other programs, written for terminals and logs.
 *
 * A terminal executes control characters. Direction controls and invisible characters make a text look like
 * another one. Each of them is written as an escape, \u{202e} with the code point in hexadecimal digits; a
 * byte that is not UTF-8 as \x{9b}. Escaped are
 *   - control characters (Cc), the line and paragraph separators (Zl, Zp), surrogates (encoded as ED A0 80
 *     ff.);
 *   - characters that display nothing (Default_Ignorable_Code_Point of Unicode 15.0,
 *     DerivedCoreProperties.txt), which include direction controls, zero-width spaces, variation selectors
 *     and tags; and interlinear annotations.
 * These stay: joiners (U+200C, U+200D) between letters or emoji, which the spelling of some languages and
 * composed emoji require, and one presentation selector (U+FE0E, U+FE0F) after an emoji or before U+20E3, a
 * keycap. Letters and emoji are ranges of the Unicode blocks, so that a few unassigned characters and signs
 * count as letters.
 * Backslashes stay, so the escapes are for reading and cannot be reversed. A second call changes nothing. Any
 * thread.
 */
#ifndef HEXAD_BASE_CORE_TERMINAL_TEXT_H
#define HEXAD_BASE_CORE_TERMINAL_TEXT_H

#include <stdio.h>

typedef enum terminal_text_form {
    TERMINAL_TEXT_LINE,   /* part of a line: line breaks and tabs are escaped, too */
    TERMINAL_TEXT_RECORD, /* a record of a log: tabs stay */
    TERMINAL_TEXT_PAGE,   /* several lines: line breaks (\n) and tabs stay */
    TERMINAL_TEXT_JSON    /* printed JSON: as a page, with the escapes of JSON, \u202e, so that the values are
                           * the same */
} terminal_text_form;

/* The functions that write to a file do it by one fwrite, which for standard error is one write(2).
 *
 * Writes `length` bytes of text, which may contain byte 0. */
void terminal_text_write(FILE *file, terminal_text_form form, const char *text, size_t length);

/* Writes a text as part of a line. */
void terminal_text_put(FILE *file, const char *text);

/* As fprintf: writes the formatted text as part of a line. Line breaks at the end of `format` itself stay. */
void terminal_text_print(FILE *file, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* As snprintf: writes as many whole characters or escapes as `size` bytes hold, and byte 0. Returns the
 * length of the complete result. */
size_t terminal_text_copy(char *to, size_t size, terminal_text_form form, const char *text);

/* The text as part of a line; the caller frees it. */
char *terminal_text_new(const char *text);

#endif
