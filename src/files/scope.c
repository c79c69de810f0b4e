// SPDX-License-Identifier: Apache-2.0
#include "files/scope.h"

#include <stddef.h>
#include <string.h>

static const struct {
    const char *name;
    unsigned scope;
} names[] = {
    {"read", SCOPE_READ}, {"submit", SCOPE_SUBMIT}, {"cancel", SCOPE_CANCEL}, {"admin", SCOPE_ADMIN}};

#define COUNT (sizeof names / sizeof *names)

const char *scope_name(unsigned scope)
{
    for (size_t i = 0; i < COUNT; i++)
        if (names[i].scope == scope) return names[i].name;
    return "none";
}

bool scope_parse(const char *text, unsigned *scopes)
{
    unsigned read = 0;
    for (;;) {
        size_t length = strcspn(text, ","), i = 0;
        while (i < COUNT && (strlen(names[i].name) != length || memcmp(names[i].name, text, length) != 0))
            i++;
        if (i == COUNT || read & names[i].scope) return false;
        read |= names[i].scope;
        if (!text[length]) break;
        text += length + 1;
    }
    *scopes = read & SCOPE_ADMIN ? SCOPE_ALL : read;
    return true;
}

char *scope_print(unsigned scopes, char text[SCOPE_TEXT_SIZE])
{
    text[0] = '\0';
    for (size_t i = 0; i < COUNT; i++) {
        if (!(scopes & names[i].scope)) continue;
        if (*text) strcat(text, ",");
        strcat(text, names[i].name);
    }
    return text;
}
