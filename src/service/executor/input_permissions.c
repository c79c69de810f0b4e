// SPDX-License-Identifier: Apache-2.0
#include "service/executor/input_permissions.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

char **input_permissions_list(const char *const *names, size_t name_count, store_inputs *inputs,
                              const char *const *given, size_t given_count, size_t *count)
{
    char **list = NULL;
    *count = 0;
    for (size_t i = 0; inputs && i < name_count;
         i++) /* a file that is gone: the worker reports it when it opens it */
        if (store_inputs_use(inputs, names[i] + strlen(STORE_INPUT_PREFIX)) >= 0)
            mem_add_text(&list, count, mem_printf("%s/%s", store_inputs_directory(inputs), names[i]));
    for (size_t i = 0; i < given_count; i++) mem_add_text(&list, count, mem_strdup(given[i]));
    return list;
}
