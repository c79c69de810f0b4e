// SPDX-License-Identifier: Apache-2.0
#include "client/list_query.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"

/* The seconds of "90m" or "90m ago"; -1 for any other text. */
static int64_t seconds_of(const char *given)
{
    static const char units[] = "smhd";
    static const int64_t seconds[] = {1, 60, 3600, 86400};
    char *end = NULL;
    long long n = strtoll(given, &end, 10);
    const char *unit = end > given && *end ? strchr(units, *end) : NULL;
    if (unit && end[1] && strcmp(end + 1, " ago") != 0) unit = NULL;
    return unit && n >= 0 && n <= 1000000 ? n * seconds[unit - units] : -1;
}

bool list_query_is_moment(const char *given)
{
    return seconds_of(given) >= 0 || (strspn(given, "0123456789") == 4 && given[4] == '-');
}

/* A time in the form that the server accepts; the caller frees it. "90m" and "90m ago" are 90 minutes before
 * now. Any other text is copied, since the server checks it. */
static char *moment_of(const char *given)
{
    char text[CLOCK_TEXT_SIZE];
    if (!given) return NULL;
    const int64_t ago_s = seconds_of(given);
    return mem_strdup(ago_s < 0 ? given : clock_format_utc(clock_wall_ms() - ago_s * 1000, text));
}

char *list_query_path(client *c, const command_options *options, const char *cursor)
{
    char *since = moment_of(options->since), *until = moment_of(options->until);
    const struct {
        const char *key, *value;
    } parts[] = {
        {"state", options->state},
        {"owner", options->owner},
        {"label", options->label.count ? options->label.item[0] : NULL},
        {"name", options->name},
        {"text", options->text},
        {"created_after", since},
        {"created_before", until},
        {"limit", options->limit},
        {"cursor", cursor},
    };
    char *path = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&path, &size);
    char mark = '?';
    fputs("/v1/jobs", out);
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (!parts[i].value) continue;
        char *escaped = client_escape(c, parts[i].value);
        fprintf(out, "%c%s=%s", mark, parts[i].key, escaped);
        free(escaped);
        mark = '&';
    }
    fclose(out);
    free(since);
    free(until);
    return path;
}

int list_query_read_all(client *c, const command_options *options, json **jobs)
{
    command_options chosen = *options;
    char limit[24];
    snprintf(limit, sizeof limit, "%d", COMMAND_PAGE_MOST);
    chosen.limit = limit;
    char *path = list_query_path(c, &chosen, NULL);
    const int code = command_read_all(c, path, "jobs", jobs);
    free(path);
    return code;
}
