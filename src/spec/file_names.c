// SPDX-License-Identifier: Apache-2.0
#include "spec/file_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

#define PLACE_LENGTH (sizeof FILE_NAMES_PLACE - 1)

bool file_names_has_place(const char *path)
{
    return strstr(path, FILE_NAMES_PLACE) != NULL;
}

char *file_names_path(const char *path, const char *name)
{
    char *text = NULL;
    size_t size = 0;
    if (!name) return mem_strdup(path);
    FILE *out = open_memstream(&text, &size);
    for (const char *place; (place = strstr(path, FILE_NAMES_PLACE)); path = place + PLACE_LENGTH)
        fprintf(out, "%.*s%s", (int)(place - path), path, name);
    fputs(path, out);
    fclose(out);
    return text;
}

bool file_names_is_pattern(const char *text)
{
    const char *first = strchr(text, '*');
    return first && !strchr(first, '/');
}

bool file_names_match(const char *pattern, const char *text, int length)
{
    const char *at = text, *end = text + length, *star = NULL, *resumed = NULL;
    while (at < end) {
        if (*pattern == '*') {
            star = ++pattern;
            resumed = at;
        } else if (*pattern == *at) {
            pattern++;
            at++;
        } else if (star) { /* the last star stands for one character more */
            pattern = star;
            at = ++resumed;
        } else {
            return false;
        }
    }
    while (*pattern == '*') pattern++;
    return !*pattern;
}
