// SPDX-License-Identifier: Apache-2.0
#include "service/http/route.h"

#include <stdio.h>
#include <string.h>

/* A {..} matches any component of the path that is not empty. */
static bool fits(const char *pattern, const char *path, size_t *starts, size_t *lengths)
{
    size_t count = 0;
    const char *start = path;
    while (*pattern && *path) {
        if (*pattern == '{') {
            size_t have = strcspn(path, "/");
            if (!have) return false;
            starts[count] = (size_t)(path - start);
            lengths[count++] = have;
            pattern += strcspn(pattern, "/");
            path += have;
        } else if (*pattern++ != *path++) {
            return false;
        }
    }
    return !*pattern && !*path;
}

static void allow(route_match *match, const char *method)
{
    size_t used = strlen(match->allow);
    snprintf(match->allow + used, sizeof match->allow - used, "%s%s%s", used ? ", " : "", method,
             strcmp(method, "GET") == 0 ? ", HEAD" : "");
}

void route_find(const route_table *table, const char *method, const char *path, route_match *match)
{
    *match = (route_match){0};
    if (strlen(path) >= sizeof match->path) return;
    if (strcmp(method, "HEAD") == 0) method = "GET";
    for (size_t i = 0; !match->found && i < table->count; i++) {
        size_t starts[HTTP_MAX_PARAMETERS] = {0}, lengths[HTTP_MAX_PARAMETERS] = {0};
        if (!fits(table->row[i].pattern, path, starts, lengths)) continue;
        match->known = true;
        if (strcmp(table->row[i].method, method) != 0) {
            allow(match, table->row[i].method);
            continue;
        }
        match->found = &table->row[i];
        strcpy(match->path, path);
        for (size_t p = 0; p < HTTP_MAX_PARAMETERS; p++) {
            if (!lengths[p]) continue;
            match->parameter[p] = match->path + starts[p];
            match->path[starts[p] + lengths[p]] = '\0';
        }
    }
}
