// SPDX-License-Identifier: Apache-2.0
#include "service/config/config_edit.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "base/core/memory.h"

#define BLANKS " \t"

static bool is_blank(char c)
{
    return c == ' ' || c == '\t';
}

/* A line with its end. */
static size_t line_length(const char *line)
{
    size_t length = strcspn(line, "\n");
    return length + (line[length] == '\n');
}

/* Offset of the value if the line has this key; otherwise 0. */
static size_t value_offset(const char *line, const char *key)
{
    const char *at = line + strspn(line, BLANKS);
    for (; *key; key++, at++)
        if (*at != *key && !(*at == '-' && *key == '_')) return 0;
    at += strspn(at, BLANKS);
    return *at == '=' || *at == ':' ? (size_t)(at + 1 - line) : 0;
}

static bool is_about(const char *line, const char *key)
{
    const char *at = line + strspn(line, BLANKS);
    return value_offset(*at == '#' ? at + 1 : at, key) != 0;
}

/* The end of the last line with the key and of its continuation lines; otherwise the end of the text. */
static size_t place_of(const char *text, const char *key)
{
    const char *place = NULL;
    bool continues = false;
    for (const char *line = text; *line; line += line_length(line)) {
        continues = is_about(line, key) || (continues && is_blank(*line));
        if (continues) place = line + line_length(line);
    }
    return place ? (size_t)(place - text) : strlen(text);
}

char *config_edit_add(const char *text, const char *key, const char *value)
{
    size_t place = place_of(text, key);
    bool open = place && text[place - 1] != '\n'; /* the last line has no line break, and gets none */
    return mem_printf("%.*s%s%s = %s%s%s", (int)place, text, open ? "\n" : "", key, value, open ? "" : "\n",
                      text + place);
}

static bool is_value(const char *item, size_t length, const char *value)
{
    while (length && is_blank(*item)) item++, length--;
    while (length && (is_blank(item[length - 1]) || item[length - 1] == '\r')) length--;
    return length == strlen(value) && memcmp(item, value, length) == 0;
}

/* The end of the item that starts here, at most `end`. */
static const char *item_end(const char *item, const char *end)
{
    while (item < end && *item != ',' && *item != ':') item++;
    return item;
}

/* Copies the items from `item` to `end` except the value, with separators; returns the end of the
 * copy. *found: the value was one of them. */
static char *copy_others(char *to, const char *item, const char *end, const char *value, bool *found)
{
    bool first = true;
    for (const char *next; item <= end; item = next + 1) {
        next = item_end(item, end);
        if (is_value(item, (size_t)(next - item), value)) {
            *found = true;
            continue;
        }
        if (!first) *to++ = item[-1];
        first = false;
        to = mempcpy(to, item, (size_t)(next - item));
    }
    return to;
}

char *config_edit_remove(const char *text, const char *key, const char *value)
{
    char *edited = mem_alloc(strlen(text) + 1), *to = edited;
    for (const char *line = text, *next; *line; line = next) {
        next = line + line_length(line);
        const char *end = line + strcspn(line, "\n");
        size_t at = value_offset(line, key);
        bool found = false;
        char *items = mempcpy(to, line, at), *rest = items;
        if (at) rest = copy_others(items, line + at, end, value, &found);
        if (!found)
            to = mempcpy(to, line, (size_t)(next - line));
        else if (rest > items || is_blank(*next))
            to = mempcpy(rest, end, (size_t)(next - end));
        else if (next == end && to > edited)
            to--; /* the last line had no line break, and the new last line gets none */
    }
    *to = '\0';
    return edited;
}
