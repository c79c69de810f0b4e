// SPDX-License-Identifier: Apache-2.0
#include "files/sent_file.h"

#include <string.h>

bool sent_file_is_hash(const char *hex)
{
    return strlen(hex) == STORE_INPUT_HEX && strspn(hex, "0123456789abcdef") == STORE_INPUT_HEX;
}

bool sent_file_is_name(const char *name)
{
    size_t prefix = strlen(STORE_INPUT_PREFIX);
    return strncmp(name, STORE_INPUT_PREFIX, prefix) == 0 && sent_file_is_hash(name + prefix);
}

bool sent_file_match(const char *path, char name[STORE_INPUT_NAME_SIZE])
{
    size_t length = STORE_INPUT_NAME_SIZE - 1;
    if (strlen(path) < length || strchr(path, '/')) return false;
    memcpy(name, path, length);
    name[length] = '\0';
    return sent_file_is_name(name) && (!path[length] || path[length] == '.');
}

void sent_file_explain_header(const char *path, error *e)
{
    char name[STORE_INPUT_NAME_SIZE];
    if (!e || (e->code != ERROR_INPUT_MISSING && e->code != ERROR_PATH_FORBIDDEN) ||
        !sent_file_match(path, name))
        return;
    error_set(
        e, ERROR_INPUT_UNSUPPORTED,
        "it names other files, which an uploaded header cannot: upload one file (.mha with ElementDataFile = "
        "LOCAL, .nrrd with the data in it), or put header and data below an input root");
}
