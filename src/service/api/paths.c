// SPDX-License-Identifier: Apache-2.0
#include "service/api/paths.h"

#include <stdlib.h>
#include <string.h>

#define OUTPUT_POINTER "/output/directory"

static void map_path(const path_map *mappings, const char *pointer, json *document, json **paths)
{
    json *node = json_find(document, pointer);
    const char *asked = json_string(json_root(node), NULL);
    char *opened = asked ? path_map_apply(mappings, asked) : NULL;
    if (!opened) return;
    if (!*paths) *paths = json_new_array();
    json *o = json_append_object(*paths);
    json_put_string(o, "pointer", pointer);
    json_put_string(o, "asked", asked);
    json_put_string(o, "opened", opened);
    json_set_string(node, opened);
    free(opened);
}

json *paths_map(const path_map *mappings, const spec *s, json *document)
{
    json *paths = NULL;
    spec_input input;
    const char *last = NULL;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        if (last == input.pointer) continue; /* several inputs of one member: the images of a stack */
        last = input.pointer;
        map_path(mappings, input.pointer, document, &paths);
    }
    if (s->directory) map_path(mappings, OUTPUT_POINTER, document, &paths);
    return paths;
}

void paths_restore(const json *paths, json *document)
{
    json_at list = json_root(paths);
    for (json_at entry = json_first(&list); entry.node; entry = json_next(&entry)) {
        json *node = json_find(document, json_string(json_member(&entry, "pointer"), ""));
        const char *asked = json_string(json_member(&entry, "asked"), NULL);
        if (node && asked) json_set_string(node, asked);
    }
}

const char *paths_asked(const json *paths, const char *pointer)
{
    json_at list = json_root(paths);
    for (json_at entry = json_first(&list); entry.node; entry = json_next(&entry)) {
        if (strcmp(json_string(json_member(&entry, "pointer"), ""), pointer) == 0)
            return json_string(json_member(&entry, "asked"), NULL);
    }
    return NULL;
}
