// SPDX-License-Identifier: Apache-2.0
#include "base/json/json_copy.h"

#include <string.h>

#define CHUNK_BYTES 65536

typedef struct scan {
    const char *key;
    long depth;   /* number of open brackets */
    bool ended;   /* the outermost bracket was closed */
    bool string;  /* in a string */
    bool escaped; /* the next byte of the string follows a backslash */
    bool value;   /* between a colon and the end of a member of the outermost object */
    bool inside;  /* in a value to replace */
    bool same;    /* the first `length` bytes of the member's name equal `key` */
    size_t length;
} scan;

static void scan_string(scan *s, char c)
{
    if (c == '"' && !s->escaped) {
        s->string = false;
        return;
    }
    if (s->depth == 1 && !s->value) {
        s->same = s->same && c && s->key[s->length] == c;
        s->length += s->same;
    }
    s->escaped = c == '\\' && !s->escaped;
}

static void end_member(scan *s)
{
    if (s->depth == 1) s->value = s->inside = false;
}

/* Whether the byte belongs to a value to replace. *begins: such a value begins after this byte. */
static bool scan_byte(scan *s, char c, bool *begins)
{
    if (s->string) {
        scan_string(s, c);
        return s->inside;
    }
    if (c == '"') {
        s->string = true;
        if (s->depth == 1 && !s->value) {
            s->same = true;
            s->length = 0;
        }
    } else if (c == ':' && s->depth == 1 && !s->value) {
        s->value = true;
        *begins = s->inside = s->same && !s->key[s->length];
        return false;
    } else if (c == ',') {
        end_member(s);
    } else if (c == '{' || c == '[') {
        s->depth++;
    } else if (c == '}' || c == ']') {
        end_member(s);
        s->ended = --s->depth == 0;
    }
    return s->inside;
}

bool json_copy_replacing(FILE *from, const char *key, const char *value, FILE *to, size_t *replaced)
{
    char bytes[CHUNK_BYTES];
    scan s = {.key = key};
    *replaced = 0;
    for (size_t got; (got = fread(bytes, 1, sizeof bytes, from)) > 0;) {
        size_t kept = 0;
        for (size_t i = 0; i < got; i++) {
            bool begins = false;
            char c = bytes[i];
            if (!scan_byte(&s, c, &begins)) bytes[kept++] = c;
            if (!begins) continue;
            if (fwrite(bytes, 1, kept, to) != kept || fputs(value, to) < 0) return false;
            kept = 0;
            ++*replaced;
        }
        if (fwrite(bytes, 1, kept, to) != kept) return false;
    }
    return !ferror(from) && s.ended && s.depth == 0 && !s.string;
}
