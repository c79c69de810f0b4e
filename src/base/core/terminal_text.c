// SPDX-License-Identifier: Apache-2.0
#include "base/core/terminal_text.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/utf8.h"

#define ZERO_WIDTH_NON_JOINER 0x200C
#define ZERO_WIDTH_JOINER 0x200D
#define TEXT_PRESENTATION 0xFE0E
#define EMOJI_PRESENTATION 0xFE0F
#define KEYCAP 0x20E3

/* Size of the longest escape: two UTF-16 units of JSON, \udb40\udc41, and byte 0. */
enum { ESCAPE_SIZE = 16 };

typedef struct range {
    uint32_t first, last;
} range;

static const range escaped[] = {
    {0x0, 0x1F},      {0x7F, 0x9F},     {0xAD, 0xAD},       {0x34F, 0x34F},     {0x61C, 0x61C},
    {0x115F, 0x1160}, {0x17B4, 0x17B5}, {0x180B, 0x180F},   {0x200B, 0x200F},   {0x2028, 0x202E},
    {0x2060, 0x206F}, {0x3164, 0x3164}, {0xD800, 0xDFFF},   {0xFE00, 0xFE0F},   {0xFEFF, 0xFEFF},
    {0xFFA0, 0xFFA0}, {0xFFF0, 0xFFFB}, {0x1BCA0, 0x1BCA3}, {0x1D173, 0x1D17A}, {0xE0000, 0xE0FFF},
};

/* Letters and the marks on them. */
static const range letters[] = {
    {'A', 'Z'},         {'a', 'z'},         {0xAA, 0xAA},     {0xB5, 0xB5},     {0xBA, 0xBA},
    {0xC0, 0xD6},       {0xD8, 0xF6},       {0xF8, 0x1FFF},   {0x2C00, 0x2DFF}, {0x3041, 0xD7FF},
    {0xF900, 0xFDFF},   {0xFE70, 0xFEFC},   {0xFF21, 0xFF3A}, {0xFF41, 0xFF5A}, {0xFF66, 0xFFDC},
    {0x10000, 0x1EFFF}, {0x20000, 0x3FFFF},
};

static const range emoji[] = {
    {0xA9, 0xA9},     {0xAE, 0xAE},       {0x203C, 0x203C}, {0x2049, 0x2049}, {0x2122, 0x2122},
    {0x2139, 0x2139}, {0x2194, 0x21AA},   {0x231A, 0x23FF}, {0x24C2, 0x24C2}, {0x25AA, 0x25FE},
    {0x2600, 0x27BF}, {0x2934, 0x2935},   {0x2B05, 0x2B55}, {0x3030, 0x3030}, {0x303D, 0x303D},
    {0x3297, 0x3299}, {0x1F000, 0x1FAFF},
};

#define IS_IN(code, list) is_in(code, list, sizeof(list) / sizeof *(list))

static bool is_in(uint32_t code, const range *list, size_t count)
{
    size_t i = 0;
    while (i < count && code > list[i].last) i++;
    return i < count && code >= list[i].first;
}

/* What comes before a character. */
typedef enum neighbour { OTHER, LETTER, EMOJI, CHOSEN_EMOJI /* with a presentation selector */ } neighbour;

static neighbour neighbour_of(uint32_t code)
{
    if (IS_IN(code, escaped)) return OTHER;
    return IS_IN(code, emoji) ? EMOJI : IS_IN(code, letters) ? LETTER : OTHER;
}

static bool stays(uint32_t code, terminal_text_form form, neighbour before, uint32_t next)
{
    if (code == '\t') return form != TERMINAL_TEXT_LINE;
    if (code == '\n') return form == TERMINAL_TEXT_PAGE || form == TERMINAL_TEXT_JSON;
    if (code == ZERO_WIDTH_JOINER || code == ZERO_WIDTH_NON_JOINER)
        return before != OTHER && neighbour_of(next) != OTHER;
    if (code == TEXT_PRESENTATION || code == EMOJI_PRESENTATION) return before == EMOJI || next == KEYCAP;
    return !IS_IN(code, escaped);
}

static void write_escape(char *to, terminal_text_form form, uint32_t code)
{
    if (form != TERMINAL_TEXT_JSON)
        snprintf(to, ESCAPE_SIZE, "\\u{%x}", code);
    else if (code < 0x10000)
        snprintf(to, ESCAPE_SIZE, "\\u%04x", code);
    else
        snprintf(to, ESCAPE_SIZE, "\\u%04x\\u%04x", 0xD800 + ((code - 0x10000) >> 10),
                 0xDC00 + (code & 0x3FF));
}

typedef struct reader {
    terminal_text_form form;
    const char *text;
    size_t left; /* bytes */
    neighbour before;
    char escape[ESCAPE_SIZE];
} reader;

/* The next character or escape, of *length bytes. NULL: the text has ended. */
static const char *next_part(reader *r, size_t *length)
{
    if (r->left == 0) return NULL;
    const unsigned char *s = (const unsigned char *)r->text;
    const char *part = r->text;
    uint32_t code = 0, next = 0;
    const size_t n = utf8_decode(s, r->left, &code), used = n ? n : 1;
    if (used < r->left && !utf8_decode(s + used, r->left - used, &next)) next = 0;
    const bool plain = n > 0 && stays(code, r->form, r->before, next);
    r->text += used;
    r->left -= used;
    const bool selected = plain && (code == TEXT_PRESENTATION || code == EMOJI_PRESENTATION);
    r->before = !plain ? OTHER : selected ? CHOSEN_EMOJI : neighbour_of(code);
    *length = used;
    if (plain) return part;
    if (n > 0)
        write_escape(r->escape, r->form, code);
    else
        snprintf(r->escape, sizeof r->escape, "\\x{%02x}", *s);
    *length = strlen(r->escape);
    return r->escape;
}

/* As terminal_text_copy, for `length` bytes. */
static size_t copy(char *to, size_t size, terminal_text_form form, const char *text, size_t length)
{
    reader r = {.form = form, .text = text, .left = length};
    size_t whole = 0, used = 0, n;
    for (const char *part; (part = next_part(&r, &n)); whole += n) {
        if (used < whole || used + n >= size)
            continue; /* what follows a part that does not fit is dropped, too */
        memcpy(to + used, part, n);
        used += n;
    }
    if (size > 0) to[used] = '\0';
    return whole;
}

size_t terminal_text_copy(char *to, size_t size, terminal_text_form form, const char *text)
{
    return copy(to, size, form, text, strlen(text));
}

/* Returns the result, which the caller frees, with space for `more` bytes behind it. */
static char *make(terminal_text_form form, const char *text, size_t length, size_t more, size_t *made)
{
    *made = copy(NULL, 0, form, text, length);
    char *result = mem_alloc(*made + more + 1);
    copy(result, *made + 1, form, text, length);
    return result;
}

char *terminal_text_new(const char *text)
{
    size_t made;
    return make(TERMINAL_TEXT_LINE, text, strlen(text), 0, &made);
}

void terminal_text_write(FILE *file, terminal_text_form form, const char *text, size_t length)
{
    size_t made;
    char *result = make(form, text, length, 0, &made);
    fwrite(result, 1, made, file);
    free(result);
}

void terminal_text_put(FILE *file, const char *text)
{
    terminal_text_write(file, TERMINAL_TEXT_LINE, text, strlen(text));
}

void terminal_text_print(FILE *file, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    char *text = mem_print_list(format, arguments);
    va_end(arguments);
    size_t breaks = 0, made, length = strlen(format), end = strlen(text);
    while (breaks < length && format[length - 1 - breaks] == '\n') breaks++;
    char *line = make(TERMINAL_TEXT_LINE, text, end - breaks, breaks, &made);
    memset(line + made, '\n', breaks);
    fwrite(line, 1, made + breaks, file);
    free(line);
    free(text);
}
