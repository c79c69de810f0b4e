// SPDX-License-Identifier: Apache-2.0
#include "service/results/own_spec.h"

#include <string.h>

#include "base/json/json.h"

char *own_spec_make(const char *spec, const char *name)
{
    json *document = json_parse(spec, strlen(spec), NULL);
    if (json_type_of(json_root(document)) != JSON_OBJECT) {
        json_free(document);
        return NULL;
    }
    json *group = json_find(document, "/queue");
    if (!group) group = json_put_object(document, "queue");
    json_append_string(json_put_array(group, "files"), name);
    char *text = json_print(document);
    json_free(document);
    return text;
}
