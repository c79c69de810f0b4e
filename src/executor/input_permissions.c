#include "executor/input_permissions.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "json/json.h"

typedef struct list {
    char **item;
    size_t count;
} list;

static void append(list *l, char *item)
{
    l->item = mem_resize(l->item, (l->count + 1) * sizeof *l->item);
    l->item[l->count++] = item;
}

static void add(list *l, store_inputs *inputs, const char *path)
{
    char name[STORE_INPUT_NAME_SIZE];
    if (!store_inputs_is_sent(path, name)) return;
    char *whole = mem_printf("%s/%s", store_inputs_directory(inputs), name);
    for (size_t i = 0; i < l->count; i++) {
        if (strcmp(l->item[i], whole) != 0) continue;
        free(whole);
        return;
    }
    if (store_inputs_use(inputs, name + strlen(STORE_INPUT_PREFIX)) >= 0)
        append(l, whole);
    else
        free(whole); /* the file is gone: the worker reports that when it opens it */
}

/* Recursion is as deep as json_parse admits. Arrays of numbers are skipped, because they may be long. */
static void look(list *l, store_inputs *inputs, json_at at)
{
    json_at first = json_element(&at, 0);
    size_t count = json_type_of(first) == JSON_NUMBER && !first.key ? 0 : json_size(at);
    for (size_t i = 0; i < count; i++) {
        json_at member = json_element(&at, i);
        const char *path = member.key && strcmp(member.key, "path") == 0 ? json_string(member, NULL) : NULL;
        if (path) add(l, inputs, path);
        look(l, inputs, member);
    }
}

char **input_permissions_list(const char *spec, store_inputs *inputs, const char *const *given,
                              size_t given_count, size_t *count)
{
    list l = {0};
    if (inputs) {
        json *document = json_parse(spec, strlen(spec), NULL);
        look(&l, inputs, json_root(document));
        json_free(document);
    }
    for (size_t i = 0; i < given_count; i++) append(&l, mem_strdup(given[i]));
    *count = l.count;
    return l.item;
}

void input_permissions_free(char **roots, size_t count)
{
    for (size_t i = 0; i < count; i++) free(roots[i]);
    free(roots);
}
