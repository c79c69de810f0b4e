// SPDX-License-Identifier: Apache-2.0
#include "job/phases/outputs.h"

json *outputs_add(json *outputs, const char *name)
{
    json *output = json_append_object(outputs);
    json_put_string(output, "name", name);
    return output;
}

void outputs_put_facts(json *output, const store_facts *facts)
{
    json_put_integer(output, "bytes", (int64_t)facts->bytes);
    json_put_string(output, "sha256", facts->sha256);
}

bool outputs_commit(store_file *file, const char *name, json *outputs, error *e)
{
    store_facts facts;
    if (!store_file_place_verified(file, &facts, e)) return false;
    outputs_put_facts(outputs_add(outputs, name), &facts);
    return true;
}
