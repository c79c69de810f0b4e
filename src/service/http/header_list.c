// SPDX-License-Identifier: Apache-2.0
#include "service/http/header_list.h"

#include <stdbool.h>
#include <string.h>
#include <strings.h>

#include <microhttpd.h>

#include "base/core/memory.h"

typedef struct values {
    const char *name;
    size_t count, length; /* of the text with separators */
    char *text;           /* NULL: only count */
} values;

static enum MHD_Result take_value(void *context, enum MHD_ValueKind kind, const char *key, const char *value)
{
    values *v = context;
    (void)kind;
    if (strcasecmp(key, v->name) != 0) return MHD_YES;
    const char *separator = v->count++ ? ", " : "", *part = value ? value : "";
    if (v->text) stpcpy(stpcpy(v->text + v->length, separator), part);
    v->length += strlen(separator) + strlen(part);
    return MHD_YES;
}

char *header_list_join(struct MHD_Connection *connection, const char *name)
{
    values counted = {.name = name};
    MHD_get_connection_values(connection, MHD_HEADER_KIND, take_value, &counted);
    if (counted.count < 2) return NULL;
    values v = {.name = name, .text = mem_alloc(counted.length + 1)};
    MHD_get_connection_values(connection, MHD_HEADER_KIND, take_value, &v);
    return v.text;
}

/* The end of an element: a comma outside quotes, or the end of the list. */
static const char *skip_element(const char *at)
{
    for (bool quoted = false; *at && (quoted || *at != ','); at++) {
        if (*at == '"') quoted = !quoted;
        if (quoted && at[0] == '\\' && at[1]) at++;
    }
    return at;
}

const char *header_list_find(const char *list, const char *token)
{
    static const char blanks[] = " \t";
    const size_t length = strlen(token);
    for (const char *at = list; at && *at; at = skip_element(at)) {
        at += strspn(at, " \t,");
        const char *rest = at + strnlen(at, length);
        if (strncasecmp(at, token, length) == 0 && strchr(" \t=;,", *rest))
            return rest + strspn(rest, blanks);
    }
    return NULL;
}
