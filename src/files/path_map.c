// SPDX-License-Identifier: Apache-2.0
#include "files/path_map.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core/memory.h"

typedef struct mapping {
    char *from, *to; /* as make_plain returns them */
} mapping;

struct path_map {
    size_t count;
    mapping *item;
};

static bool is_separator(char c)
{
    return c == '/' || c == '\\';
}

static bool is_windows(const char *path)
{
    return (isalpha((unsigned char)path[0]) && path[1] == ':') ||
           (is_separator(path[0]) && path[0] == path[1]);
}

/* One `/` between components, none at the end, two at the beginning of a share. */
static char *make_plain(const char *path)
{
    bool windows = is_windows(path);
    char *plain = mem_strdup(path);
    size_t n = 0;
    for (const char *t = path; *t; t++) {
        bool separator = *t == '/' || (windows && *t == '\\');
        if (separator && n > 0 && plain[n - 1] == '/' && !(windows && n == 1)) continue;
        plain[n++] = separator ? '/' : *t;
    }
    while (n > 0 && plain[n - 1] == '/') n--;
    plain[n] = '\0';
    return plain;
}

static bool begins_with(const char *plain, const char *from)
{
    size_t length = strlen(from);
    bool same = is_windows(from) ? strncasecmp(plain, from, length) == 0 : strncmp(plain, from, length) == 0;
    return same && (!plain[length] || plain[length] == '/');
}

static bool read_mapping(const path_map *before, const char *text, mapping *m, error *e)
{
    const char *equals = strchr(text, '=');
    if (!equals) return error_set(e, ERROR_SPEC_INVALID, "path_mappings: must be from=to (given %s)", text);
    char *from = mem_strndup(text, (size_t)(equals - text));
    bool absolute = is_windows(from) || *from == '/';
    *m = (mapping){make_plain(from), make_plain(equals + 1)};
    free(from);
    if (!absolute || !*m->from || (isalpha((unsigned char)m->from[0]) && m->from[2] && m->from[2] != '/'))
        return error_set(
            e, ERROR_SPEC_INVALID,
            "path_mappings: %s: the path before = must be absolute and not the root, or begin with a"
            " drive (Z:/) or a share (//server/share)",
            text);
    if (equals[1] != '/' || !*m->to || is_windows(equals + 1))
        return error_set(e, ERROR_SPEC_INVALID,
                         "path_mappings: %s: the path after = must be an absolute path of this machine",
                         text);
    for (size_t i = 0; i < before->count; i++)
        if (begins_with(before->item[i].from, m->from) && begins_with(m->from, before->item[i].from))
            return error_set(e, ERROR_SPEC_INVALID, "path_mappings: %s is mapped twice: remove one", m->from);
    return true;
}

path_map *path_map_read(const char *const *texts, size_t count, error *e)
{
    path_map *m = mem_alloc(sizeof *m);
    bool ok = true;
    m->item = mem_alloc((count + 1) * sizeof *m->item); /* + 1: never a size of 0 */
    for (size_t i = 0; ok && i < count; i++) {
        mapping read = {0};
        ok = read_mapping(m, texts[i], &read, e);
        m->item[m->count++] = read;
    }
    if (ok) return m;
    path_map_free(m);
    return NULL;
}

void path_map_free(path_map *m)
{
    if (!m) return;
    for (size_t i = 0; i < m->count; i++) {
        free(m->item[i].from);
        free(m->item[i].to);
    }
    free(m->item);
    free(m);
}

char *path_map_apply(const path_map *m, const char *path)
{
    const mapping *best = NULL;
    char *plain = make_plain(path), *here = NULL;
    for (size_t i = 0; m && i < m->count; i++) {
        const mapping *each = &m->item[i];
        bool longer = !best || strlen(each->from) > strlen(best->from);
        if (longer && begins_with(plain, each->from)) best = each;
    }
    if (best) here = mem_printf("%s%s", best->to, plain + strlen(best->from));
    free(plain);
    if (here && strcmp(here, path) != 0) return here;
    free(here);
    return NULL;
}
