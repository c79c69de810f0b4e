#include "client/list_query.h"

#include <stdio.h>
#include <stdlib.h>

char *list_query_path(client *c, const command_options *options, const char *cursor)
{
    const struct {
        const char *key, *value;
    } parts[] = {
        {"state", options->state},
        {"owner", options->owner},
        {"label", options->label_count ? options->label[0] : NULL},
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
    return path;
}
