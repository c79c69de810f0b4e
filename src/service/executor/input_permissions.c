// SPDX-License-Identifier: Apache-2.0
#include "service/executor/input_permissions.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

typedef struct list {
    char **item;
    size_t count;
} list;

static void append(list *l, char *item)
{
    l->item = mem_resize(l->item, (l->count + 1) * sizeof *l->item);
    l->item[l->count++] = item;
}

char **input_permissions_list(const char *const *names, size_t name_count, store_inputs *inputs,
                              const char *const *given, size_t given_count, size_t *count)
{
    list l = {0};
    for (size_t i = 0; inputs && i < name_count;
         i++) /* a file that is gone: the worker reports it when it opens it */
        if (store_inputs_use(inputs, names[i] + strlen(STORE_INPUT_PREFIX)) >= 0)
            append(&l, mem_printf("%s/%s", store_inputs_directory(inputs), names[i]));
    for (size_t i = 0; i < given_count; i++) append(&l, mem_strdup(given[i]));
    *count = l.count;
    return l.item;
}

void input_permissions_free(char **roots, size_t count)
{
    for (size_t i = 0; i < count; i++) free(roots[i]);
    free(roots);
}
