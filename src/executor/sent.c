#include "executor/sent.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "json/json.h"
#include "store/inputs.h"

static void add(sent_files *files, const char *directory, const char *path)
{
    char name[STORE_INPUT_NAME_SIZE];
    if (!store_inputs_is_sent(path, name)) return;
    char *whole = mem_printf("%s/%s", directory, name);
    for (size_t i = 0; i < files->count; i++) {
        if (strcmp(files->path[i], whole) != 0) continue;
        free(whole);
        return;
    }
    files->path = mem_resize(files->path, (files->count + 1) * sizeof *files->path);
    files->path[files->count++] = whole;
}

/* As deep as json_parse admits. Long arrays are of numbers. */
static void look(sent_files *files, const char *directory, json_at at)
{
    json_at first = json_element(&at, 0);
    size_t count = json_type_of(first) == JSON_NUMBER && !first.key ? 0 : json_size(at);
    for (size_t i = 0; i < count; i++) {
        json_at member = json_element(&at, i);
        const char *path = member.key && strcmp(member.key, "path") == 0 ? json_string(member, NULL) : NULL;
        if (path) add(files, directory, path);
        look(files, directory, member);
    }
}

sent_files sent_files_of(const char *spec, const char *directory)
{
    sent_files files = {0};
    if (!directory) return files;
    json *document = json_parse(spec, strlen(spec), NULL);
    look(&files, directory, json_root(document));
    json_free(document);
    return files;
}

void sent_files_clear(sent_files *files)
{
    for (size_t i = 0; i < files->count; i++) free(files->path[i]);
    free(files->path);
    *files = (sent_files){0};
}
